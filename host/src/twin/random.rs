//! Counter-based pseudo-random numbers: every value is a pure function of a seed and a place, so that a picture does
//! not depend on how many threads made it.

/// SplitMix64's finaliser (Steele, Lea, Flood: "Fast splittable pseudorandom number generators", OOPSLA 2014).
#[must_use]
pub fn scramble(value: u64) -> u64 {
    let mut mixed = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    mixed ^ (mixed >> 31)
}

/// One word for a place on a lattice; unlike neighbours for unlike seeds.
#[must_use]
pub fn lattice(seed: u64, x: i64, y: i64) -> u64 {
    scramble(seed ^ scramble((x as u64) ^ (y as u64).rotate_left(32)))
}

/// The word as a number in 0..1.
#[must_use]
pub fn unit(word: u64) -> f64 {
    (word >> 11) as f64 / (1_u64 << 53) as f64
}

/// A seeded sequence of random numbers.
#[derive(Debug, Clone)]
pub struct Dice {
    state: u64,
}

impl Dice {
    /// The same seed gives the same sequence for ever.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { state: scramble(seed) }
    }

    /// The next 64 random bits.
    pub fn word(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        scramble(self.state)
    }

    /// Uniform in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * unit(self.word())
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        unit(self.word()) < probability
    }

    /// One of the items; `None` of an empty list.
    pub fn choose<'a, T>(&mut self, items: &'a [T]) -> Option<&'a T> {
        let index = (unit(self.word()) * items.len() as f64) as usize;
        items.get(index)
    }

    /// Normal with mean 0 and standard deviation 1 (Box-Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - unit(self.word())).ln()).sqrt();
        radius * (std::f64::consts::TAU * unit(self.word())).cos()
    }
}

/// Number of values in a [`NoiseTable`]; a power of two.
const TABLE_LENGTH: usize = 1 << 16;
/// Rows are read from a random start and may run this far beyond the table's length.
const TABLE_OVERHANG: usize = 4608;

/// Normally distributed numbers made once and read in long stretches from random starts: a picture needs millions of
/// them, and a table is ten times faster than computing each.
#[derive(Debug)]
pub struct NoiseTable {
    values: Vec<f32>,
}

impl NoiseTable {
    /// Builds the table from a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut dice = Dice::new(seed);
        let mut values: Vec<f32> = (0..TABLE_LENGTH).map(|_| dice.normal() as f32).collect();
        values.extend_from_within(..TABLE_OVERHANG);
        Self { values }
    }

    /// A stretch of `length` values; `word` chooses where. At most 4608 values.
    #[must_use]
    pub fn stretch(&self, word: u64, length: usize) -> &[f32] {
        let start = (word as usize) % TABLE_LENGTH;
        let length = length.min(TABLE_OVERHANG);
        &self.values[start..start + length]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_sequence_and_another_seed_another() {
        let take = |seed| {
            let mut dice = Dice::new(seed);
            [dice.word(), dice.word(), dice.word()]
        };
        assert_eq!(take(7), take(7));
        assert_ne!(take(7), take(8));
    }

    #[test]
    fn the_noise_is_standard_normal() {
        let table = NoiseTable::new(1);
        let stretch = &table.values[..TABLE_LENGTH];
        let count = TABLE_LENGTH as f64;
        let mean = stretch.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
        let variance = stretch.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / count - mean * mean;
        assert!(mean.abs() < 0.015, "{mean}");
        assert!((variance - 1.0).abs() < 0.02, "{variance}");
    }

    #[test]
    fn every_start_yields_a_whole_row() {
        let table = NoiseTable::new(2);
        for word in [0, TABLE_LENGTH as u64 - 1, u64::MAX] {
            assert_eq!(table.stretch(word, TABLE_OVERHANG).len(), TABLE_OVERHANG);
        }
    }

    #[test]
    fn choosing_covers_every_item() {
        let mut dice = Dice::new(3);
        let mut seen = [false; 4];
        for _ in 0..200 {
            seen[*dice.choose(&[0_usize, 1, 2, 3]).unwrap()] = true;
        }
        assert_eq!(seen, [true; 4]);
        assert_eq!(dice.choose::<u8>(&[]), None);
    }
}
