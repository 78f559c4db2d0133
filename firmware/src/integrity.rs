//! Is the memory that the decision rests on what the program left there?
//!
//! Between two calls of the controller nothing may write to its state. So each call ends with a digest over all that
//! permission rests on, and the next one begins by comparing. Any single changed word changes the digest for sure (each
//! step of it is a bijection of the one before); the odds against several at once are 2^-64. What is found locks the
//! controller out.

const OFFSET: u64 = 0xCBF2_9CE4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01B3;

/// FNV-1a over 64-bit words, with a rotation so that high bits reach low ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Digest(u64);

impl Digest {
    /// Of nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self(OFFSET)
    }

    /// With another word.
    #[must_use]
    pub const fn with(self, word: u64) -> Self {
        Self((self.0 ^ word).wrapping_mul(PRIME).rotate_left(29))
    }

    /// With more words.
    #[must_use]
    pub fn with_all(self, words: impl IntoIterator<Item = u64>) -> Self {
        words.into_iter().fold(self, Self::with)
    }

    /// The digest, to be kept, complemented: memory that was cleared is no digest of anything.
    #[must_use]
    pub const fn sealed(self) -> Seal {
        Seal(!self.0)
    }
}

impl Default for Digest {
    fn default() -> Self {
        Self::new()
    }
}

/// A digest as it is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seal(u64);

impl Seal {
    /// As it is kept.
    pub(crate) const fn bits(self) -> u64 {
        self.0
    }

    /// Is it the digest's?
    #[must_use]
    pub const fn holds(self, digest: Digest) -> bool {
        self.0 == !digest.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_single_changed_word_is_found(
            words in proptest::collection::vec(any::<u64>(), 1..40),
            at in any::<proptest::sample::Index>(),
            change in 1..=u64::MAX,
        ) {
            let seal = Digest::new().with_all(words.iter().copied()).sealed();
            prop_assert!(seal.holds(Digest::new().with_all(words.iter().copied())));
            let mut damaged = words.clone();
            damaged[at.index(words.len())] ^= change;
            prop_assert!(!seal.holds(Digest::new().with_all(damaged)));
        }
    }

    #[test]
    fn order_and_length_matter_and_cleared_memory_is_no_seal() {
        let digest = |words: &[u64]| Digest::new().with_all(words.iter().copied());
        assert_ne!(digest(&[1, 2]), digest(&[2, 1]));
        assert_ne!(digest(&[0]), digest(&[0, 0]));
        assert!(!Seal(0).holds(digest(&[])) && !Seal(u64::MAX).holds(digest(&[])));
        assert_eq!(Digest::default(), Digest::new());
    }
}
