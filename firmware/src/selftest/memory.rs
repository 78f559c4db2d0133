//! RAM: a march over words that come in as [`Cells`], and slices of it that leave the content alone.
//!
//! **March C-** (van de Goor): `any(w0); up(r0,w1); up(r1,w0); down(r0,w1); down(r1,w0); any(r0)`. It finds every
//! stuck-at, transition and address-decoder fault, and every unlinked inversion, idempotent and state coupling between
//! two words. "0" and "1" are a background and its complement; the six [`BACKGROUNDS`] together put every pair of
//! bits of one word into all four combinations, so that coupling inside a word shows as well.
//!
//! * **At start** [`march_all`] overwrites everything with all six backgrounds, before any variable lives: 10 accesses a
//!   word and background, 60 in all; about 2 million accesses for 128 KiB.
//! * **While running** [`transparent`] saves a block, marches over it with two backgrounds and puts the content back.
//!   The caller masks interrupts for it and keeps its own variables elsewhere. Blocks overlap by one word, so that
//!   neighbours in different blocks meet too; coupling between words that are farther apart is the start's to find.
//!
//! A failure is reported as [`SelfTestKind::Memory`](super::SelfTestKind::Memory).

/// Words of memory under test.
pub trait Cells {
    /// How many.
    fn count(&self) -> usize;
    /// The word's content; what is outside reads as zero.
    fn read(&self, place: usize) -> u32;
    /// Changes the word; what is outside stays as it is.
    fn write(&mut self, place: usize, value: u32);
}

/// The "0" of each march. Rows of a Hadamard-like matrix: any two bits differ in at least one of them.
pub const BACKGROUNDS: [u32; 6] =
    [0x0000_0000, 0x5555_5555, 0x3333_3333, 0x0F0F_0F0F, 0x00FF_00FF, 0x0000_FFFF];

/// Words of a block of the running test.
pub const BLOCK_WORDS: usize = 32;
/// With the overlap into the next block.
pub const SAVED_WORDS: usize = BLOCK_WORDS + 1;
/// Backgrounds of the running test: solid and checkerboard.
const RUNNING_BACKGROUNDS: [u32; 2] = [0x0000_0000, 0x5555_5555];

/// A word that does not hold what was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryFault {
    /// Which word.
    pub place: usize,
    /// What it should hold.
    pub expected: u32,
    /// What it holds.
    pub found: u32,
}

fn expect<C: Cells>(cells: &C, place: usize, expected: u32) -> Result<(), MemoryFault> {
    let found = cells.read(place);
    if found == expected { Ok(()) } else { Err(MemoryFault { place, expected, found }) }
}

/// Reads `old`, writes `new`, at every place in this order.
fn sweep<C: Cells>(
    cells: &mut C,
    places: impl Iterator<Item = usize>,
    old: u32,
    new: u32,
) -> Result<(), MemoryFault> {
    for place in places {
        expect(cells, place, old)?;
        cells.write(place, new);
    }
    Ok(())
}

/// March C- with one background; overwrites everything. It leaves the background in all words.
///
/// # Errors
/// The first word that read wrong.
pub fn march<C: Cells>(cells: &mut C, background: u32) -> Result<(), MemoryFault> {
    let (zero, one) = (background, !background);
    let count = cells.count();
    for place in 0..count {
        cells.write(place, zero);
    }
    sweep(cells, 0..count, zero, one)?;
    sweep(cells, 0..count, one, zero)?;
    sweep(cells, (0..count).rev(), zero, one)?;
    sweep(cells, (0..count).rev(), one, zero)?;
    (0..count).try_for_each(|place| expect(cells, place, zero))
}

/// March C- with all backgrounds; overwrites everything.
///
/// # Errors
/// The first word that read wrong.
pub fn march_all<C: Cells>(cells: &mut C) -> Result<(), MemoryFault> {
    BACKGROUNDS.into_iter().try_for_each(|background| march(cells, background))
}

/// A march over at most [`SAVED_WORDS`] words whose content is put back afterwards, and read back. The caller sees to
/// it that nothing else looks at the words meanwhile: about 30 accesses a word.
///
/// # Errors
/// The first word that read wrong; the content is put back all the same.
pub fn transparent<C: Cells>(cells: &mut C) -> Result<(), MemoryFault> {
    let mut saved = [0; SAVED_WORDS];
    for (place, word) in (0..cells.count()).zip(saved.iter_mut()) {
        *word = cells.read(place);
    }
    let marched = if cells.count() > SAVED_WORDS {
        // More than can be put back must not be overwritten.
        Err(MemoryFault { place: SAVED_WORDS, expected: 0, found: 0 })
    } else {
        RUNNING_BACKGROUNDS.into_iter().try_for_each(|background| march(cells, background))
    };
    for (place, word) in (0..cells.count()).zip(saved.iter()) {
        cells.write(place, *word);
    }
    marched?;
    (0..cells.count()).zip(saved.iter()).try_for_each(|(place, word)| expect(cells, place, *word))
}

/// A stretch of memory that the running test covers, in words from its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// Address of its first word.
    pub address: usize,
    /// Its length.
    pub words: usize,
}

impl Region {
    /// Blocks that cover it.
    #[must_use]
    pub const fn blocks(&self) -> usize {
        self.words.div_ceil(BLOCK_WORDS)
    }

    /// The words of one of its blocks, with the overlap; `None` behind its end.
    #[must_use]
    pub fn block(&self, number: usize) -> Option<Self> {
        let first = number.checked_mul(BLOCK_WORDS)?;
        let left = self.words.checked_sub(first).filter(|left| *left > 0)?;
        let address = self.address.checked_add(first.checked_mul(size_of::<u32>())?)?;
        Some(Self { address, words: left.min(SAVED_WORDS) })
    }
}

/// Blocks of all regions together.
#[must_use]
pub fn block_count(regions: &[Region]) -> usize {
    regions.iter().fold(0, |sum, region| sum.saturating_add(region.blocks()))
}

/// The block of this number, counted through all regions; `None` behind the last one.
#[must_use]
pub fn block_of(regions: &[Region], number: usize) -> Option<Region> {
    let mut left = number;
    for region in regions {
        match left.checked_sub(region.blocks()) {
            Some(rest) => left = rest,
            None => return region.block(left),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is wrong with the memory.
    #[derive(Debug, Clone, Copy)]
    enum Defect {
        None,
        /// A bit that always reads so.
        StuckAt {
            place: usize,
            bit: u32,
            high: bool,
        },
        /// A bit that cannot rise (or fall).
        Transition {
            place: usize,
            bit: u32,
            rises: bool,
        },
        /// A rising (falling) aggressor bit inverts the victim.
        Inversion {
            aggressor: (usize, u32),
            rises: bool,
            victim: (usize, u32),
        },
        /// A rising (falling) aggressor bit forces the victim.
        Idempotent {
            aggressor: (usize, u32),
            rises: bool,
            victim: (usize, u32),
            high: bool,
        },
        /// While the aggressor bit has this level, the victim is forced.
        State {
            aggressor: (usize, u32),
            level: bool,
            victim: (usize, u32),
            high: bool,
        },
        /// Two addresses reach the same word.
        Alias {
            one: usize,
            other: usize,
        },
        /// An address reaches no word: it reads as zeros.
        Missing {
            place: usize,
        },
    }

    struct Memory {
        words: Vec<u32>,
        defect: Defect,
    }

    fn set(word: &mut u32, bit: u32, high: bool) {
        *word = if high { *word | (1 << bit) } else { *word & !(1 << bit) };
    }

    const fn is_set(word: u32, bit: u32) -> bool {
        word >> bit & 1 == 1
    }

    impl Memory {
        fn new(count: usize, defect: Defect) -> Self {
            Self { words: vec![0; count], defect }
        }

        fn place(&self, place: usize) -> usize {
            match self.defect {
                Defect::Alias { one, other } if place == other => one,
                _ => place,
            }
        }
    }

    impl Cells for Memory {
        fn count(&self) -> usize {
            self.words.len()
        }

        fn read(&self, place: usize) -> u32 {
            let mut word = self.words[self.place(place)];
            match self.defect {
                Defect::StuckAt { place: at, bit, high } if at == place => set(&mut word, bit, high),
                Defect::State { aggressor, level, victim, high }
                    if victim.0 == place && is_set(self.words[aggressor.0], aggressor.1) == level =>
                {
                    set(&mut word, victim.1, high);
                }
                Defect::Missing { place: at } if at == place => word = 0,
                _ => {}
            }
            word
        }

        fn write(&mut self, place: usize, value: u32) {
            let place = self.place(place);
            let before = self.words[place];
            let mut value = value;
            if let Defect::Transition { place: at, bit, rises } = self.defect
                && at == place
                && is_set(before, bit) != rises
                && is_set(value, bit) == rises
            {
                set(&mut value, bit, !rises);
            }
            self.words[place] = value;
            let triggered = |(at, bit): (usize, u32), rises: bool| {
                at == place && is_set(before, bit) != rises && is_set(value, bit) == rises
            };
            match self.defect {
                Defect::Inversion { aggressor, rises, victim } if triggered(aggressor, rises) => {
                    self.words[victim.0] ^= 1 << victim.1;
                }
                Defect::Idempotent { aggressor, rises, victim, high } if triggered(aggressor, rises) => {
                    set(&mut self.words[victim.0], victim.1, high);
                }
                _ => {}
            }
        }
    }

    const COUNT: usize = SAVED_WORDS;

    fn both() -> [bool; 2] {
        [false, true]
    }

    #[test]
    fn sound_memory_of_any_length_passes() {
        for count in [0, 1, 2, COUNT] {
            assert_eq!(march_all(&mut Memory::new(count, Defect::None)), Ok(()));
        }
    }

    #[test]
    fn every_stuck_bit_and_every_missing_transition_is_found() {
        for place in [0, 1, 17, COUNT - 1] {
            for bit in 0..32 {
                for high in both() {
                    for defect in
                        [Defect::StuckAt { place, bit, high }, Defect::Transition { place, bit, rises: high }]
                    {
                        let fault = march(&mut Memory::new(COUNT, defect), 0).unwrap_err();
                        assert_eq!(fault.place, place, "{defect:?}");
                        assert_eq!(fault.expected ^ fault.found, 1 << bit, "{defect:?}");
                        assert!(transparent(&mut Memory::new(COUNT, defect)).is_err(), "{defect:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn coupling_between_any_two_words_is_found() {
        for aggressor in 0..COUNT {
            for victim in (0..COUNT).filter(|victim| *victim != aggressor) {
                for rises in both() {
                    let (aggressor, victim) = ((aggressor, 3), (victim, 3));
                    let mut defects = vec![Defect::Inversion { aggressor, rises, victim }];
                    for high in both() {
                        defects.push(Defect::Idempotent { aggressor, rises, victim, high });
                        defects.push(Defect::State { aggressor, level: rises, victim, high });
                    }
                    for defect in defects {
                        assert!(march(&mut Memory::new(COUNT, defect), 0).is_err(), "{defect:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn coupling_between_any_two_bits_of_a_word_is_found_by_the_backgrounds_together() {
        for aggressor in 0..32 {
            for victim in (0..32).filter(|victim| *victim != aggressor) {
                for level in both() {
                    for high in both() {
                        let (aggressor, victim) = ((5, aggressor), (5, victim));
                        let defect = Defect::State { aggressor, level, victim, high };
                        assert!(march_all(&mut Memory::new(8, defect)).is_err(), "{defect:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn addresses_that_reach_the_wrong_word_or_none_are_found() {
        for one in 0..COUNT {
            for other in (0..COUNT).filter(|other| *other != one) {
                assert!(march(&mut Memory::new(COUNT, Defect::Alias { one, other }), 0).is_err());
            }
            assert!(march(&mut Memory::new(COUNT, Defect::Missing { place: one }), 0).is_err());
        }
    }

    #[test]
    fn the_running_test_leaves_the_content_alone() {
        for count in [0, 1, BLOCK_WORDS, SAVED_WORDS] {
            let mut memory = Memory::new(count, Defect::None);
            for (place, word) in memory.words.iter_mut().enumerate() {
                *word = 0x9E37_79B9_u32.wrapping_mul(place as u32 + 1);
            }
            let before = memory.words.clone();
            assert_eq!(transparent(&mut memory), Ok(()));
            assert_eq!(memory.words, before, "{count} words");
        }
    }

    #[test]
    fn the_running_test_puts_the_content_back_even_beside_a_faulty_word() {
        let mut memory = Memory::new(COUNT, Defect::StuckAt { place: 9, bit: 4, high: true });
        memory.words.iter_mut().for_each(|word| *word = 0x1234_5678);
        let fault = transparent(&mut memory).unwrap_err();
        assert_eq!(fault.place, 9);
        for (place, word) in memory.words.iter().enumerate().filter(|(place, _)| *place != 9) {
            assert_eq!(*word, 0x1234_5678, "word {place}");
        }
    }

    #[test]
    fn a_block_that_cannot_be_put_back_is_refused_untouched() {
        let mut memory = Memory::new(SAVED_WORDS + 1, Defect::None);
        memory.words.iter_mut().for_each(|word| *word = 7);
        assert!(transparent(&mut memory).is_err());
        assert!(memory.words.iter().all(|word| *word == 7));
    }

    #[test]
    fn a_word_that_loses_its_content_on_the_way_back_is_found() {
        /// Forgets the last thing that is written to it.
        struct Forgetful {
            words: [u32; 4],
            writes: usize,
        }
        impl Cells for Forgetful {
            fn count(&self) -> usize {
                4
            }
            fn read(&self, place: usize) -> u32 {
                self.words[place]
            }
            fn write(&mut self, place: usize, value: u32) {
                self.writes += 1;
                // Two marches of 5 writes a word come before the content is put back.
                if !(self.writes > 40 && place == 2) {
                    self.words[place] = value;
                }
            }
        }
        let mut memory = Forgetful { words: [9; 4], writes: 0 };
        assert_eq!(transparent(&mut memory).map_err(|fault| (fault.place, fault.expected)), Err((2, 9)));
    }

    #[test]
    fn any_two_bits_differ_in_some_background_and_agree_in_another() {
        for one in 0..32 {
            for other in 0..one {
                let differ = |word: &u32| is_set(*word, one) != is_set(*word, other);
                assert!(BACKGROUNDS.iter().any(differ) && !BACKGROUNDS.iter().all(differ));
            }
        }
        assert!(RUNNING_BACKGROUNDS.iter().all(|background| BACKGROUNDS.contains(background)));
    }

    #[test]
    fn blocks_cover_every_word_of_every_region_and_overlap_by_one() {
        let regions =
            [Region { address: 0x2000_0000, words: 70 }, Region { address: 0x1000_0000, words: 32 }];
        assert_eq!(block_count(&regions), 3 + 1);
        let blocks: Vec<_> = (0..4).map(|number| block_of(&regions, number).unwrap()).collect();
        assert_eq!(blocks[0], Region { address: 0x2000_0000, words: 33 });
        assert_eq!(blocks[1], Region { address: 0x2000_0080, words: 33 });
        assert_eq!(blocks[2], Region { address: 0x2000_0100, words: 6 });
        assert_eq!(blocks[3], Region { address: 0x1000_0000, words: 32 });
        assert_eq!(block_of(&regions, 4), None);
        assert_eq!(regions[0].block(3), None);
        assert_eq!(regions[0].block(usize::MAX), None);
        assert_eq!(Region { address: usize::MAX, words: 70 }.block(1), None);
        assert_eq!((block_count(&[]), block_of(&[], 0)), (0, None));
    }

    #[test]
    fn behind_the_last_block_there_is_none() {
        for words in [BLOCK_WORDS, 2 * BLOCK_WORDS, 2 * BLOCK_WORDS - 1] {
            let region = Region { address: 0, words };
            assert!(region.block(region.blocks() - 1).is_some_and(|block| block.words > 0));
            assert_eq!(region.block(region.blocks()).map(|block| block.words), None, "{words} words");
        }
    }
}
