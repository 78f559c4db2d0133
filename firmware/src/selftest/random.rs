//! The random number generator, whose bytes seed the laser's secret code.
//!
//! The generator has health tests of its own, which the binaries ask first. Here its output is looked at: a generator
//! that repeats itself, or is stuck, is not random.
//!
//! **Time:** about 100 instructions, at start. **Failure:** [`SelfTestKind::Random`](super::SelfTestKind::Random).

/// Words that are drawn: the secret and as many that are only compared.
pub const DRAWN_WORDS: usize = 8;

/// The secret, if all the words differ from each other, from all zeros and from all ones. A sound generator fails
/// this once in 100 million starts (44 pairs and patterns among 2^32 values).
#[must_use]
pub fn secret_of(words: &[u32; DRAWN_WORDS]) -> Option<[u8; 16]> {
    let mut rest = words.as_slice();
    while let Some((word, others)) = rest.split_first() {
        if *word == 0 || *word == u32::MAX || others.contains(word) {
            return None;
        }
        rest = others;
    }
    let mut secret = [0; 16];
    let (slots, _) = secret.as_chunks_mut::<4>();
    for (slot, word) in slots.iter_mut().zip(words) {
        *slot = word.to_le_bytes();
    }
    Some(secret)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: [u32; DRAWN_WORDS] = [0x0403_0201, 0x0807_0605, 0x0C0B_0A09, 0x100F_0E0D, 5, 6, 7, 8];

    #[test]
    fn the_secret_is_the_first_half() {
        let expected: Vec<u8> = (1..=16).collect();
        assert_eq!(secret_of(&SOUND).unwrap().to_vec(), expected);
    }

    #[test]
    fn every_repetition_is_refused() {
        for one in 0..DRAWN_WORDS {
            for other in 0..one {
                let mut words = SOUND;
                words[one] = words[other];
                assert_eq!(secret_of(&words), None, "{one} repeats {other}");
            }
        }
    }

    #[test]
    fn words_of_a_dead_generator_are_refused() {
        for place in 0..DRAWN_WORDS {
            for dead in [0, u32::MAX] {
                let mut words = SOUND;
                words[place] = dead;
                assert_eq!(secret_of(&words), None);
            }
        }
    }
}
