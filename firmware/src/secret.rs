//! What the host must not be able to guess: the laser's code and the audit's columns.
//!
//! Both come from SipHash-2-4, a keyed pseudo-random function, over a counter; the key is drawn from the chip's random
//! number generator at every start. Two uses of one key are kept apart by a domain number.

use siphasher::sip::SipHasher24;

/// Bytes of a secret.
pub const SECRET_LENGTH: usize = 16;

/// The key; see the module's documentation. It is never sent, and `Debug` does not show it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Secret {
    key: [u64; 2],
}

/// What a word is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// A symbol of the laser's code.
    LaserSymbol,
    /// The first four columns of an audit.
    AuditFirst,
    /// The other four.
    AuditSecond,
}

impl Secret {
    /// Not secret at all: before the chip's generator has given one.
    pub const NONE: Self = Self { key: [0; 2] };

    /// From the chip's random number generator.
    #[must_use]
    pub const fn new(bytes: [u8; SECRET_LENGTH]) -> Self {
        let [a0, a1, a2, a3, a4, a5, a6, a7, b0, b1, b2, b3, b4, b5, b6, b7] = bytes;
        Self {
            key: [
                u64::from_le_bytes([a0, a1, a2, a3, a4, a5, a6, a7]),
                u64::from_le_bytes([b0, b1, b2, b3, b4, b5, b6, b7]),
            ],
        }
    }

    /// The pseudo-random word for a use and a counter.
    #[must_use]
    pub fn word(&self, purpose: Use, counter: u64) -> u64 {
        let [first, second] = self.key;
        let domain = match purpose {
            Use::LaserSymbol => 1_u8,
            Use::AuditFirst => 2,
            Use::AuditSecond => 3,
        };
        let [c0, c1, c2, c3, c4, c5, c6, c7] = counter.to_le_bytes();
        SipHasher24::new_with_keys(first, second).hash(&[domain, c0, c1, c2, c3, c4, c5, c6, c7])
    }

    /// Its bits, for the check of the controller's memory.
    pub(crate) const fn bits(&self) -> [u64; 2] {
        self.key
    }
}

impl core::fmt::Debug for Secret {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Secret")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reference's own test vector (key 00 01 .. 0f, message 00 01 .. 08, J.-P. Aumasson and D. J. Bernstein,
    /// "SipHash: a fast short-input PRF", 2012): the library is SipHash-2-4, and the key's bytes are in their places.
    #[test]
    fn words_are_siphash_2_4() {
        let secret = Secret::new(core::array::from_fn(|index| index as u8));
        let [first, second] = secret.bits();
        assert_eq!((first, second), (0x0706_0504_0302_0100, 0x0F0E_0D0C_0B0A_0908));
        let message: Vec<u8> = (0..9).collect();
        assert_eq!(SipHasher24::new_with_keys(first, second).hash(&message), 0x9E00_82DF_0BA9_E4B0);
    }

    #[test]
    fn uses_counters_and_keys_are_kept_apart() {
        let (one, other) = (Secret::new([1; 16]), Secret::new([2; 16]));
        let words = [
            one.word(Use::LaserSymbol, 0),
            one.word(Use::AuditFirst, 0),
            one.word(Use::AuditSecond, 0),
            one.word(Use::LaserSymbol, 1),
            other.word(Use::LaserSymbol, 0),
            Secret::NONE.word(Use::LaserSymbol, 0),
        ];
        let different: std::collections::BTreeSet<_> = words.into();
        assert_eq!(different.len(), words.len());
        assert_eq!(one.word(Use::AuditFirst, 7), Secret::new([1; 16]).word(Use::AuditFirst, 7));
    }

    #[test]
    fn a_secret_is_not_shown() {
        assert_eq!(format!("{:?}", Secret::new([7; 16])), "Secret");
    }
}
