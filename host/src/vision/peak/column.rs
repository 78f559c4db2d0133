//! A column that is looked at many times.

use super::search::{HOLLOW_STRENGTH, find_above, window};
use super::{Kernel, LONGEST_WINDOW, Peak, Ridge, Sums};
use crate::vision::signal::Signal;

/// One column of a picture with its running sums, for many looks at it: the samples of a column lie far apart in memory.
#[derive(Debug, Clone, Default)]
pub struct Column {
    /// Row of the first sample.
    first: usize,
    samples: Vec<i16>,
    sums: Vec<i32>,
}

impl Column {
    /// Room for so many rows.
    #[must_use]
    pub fn new(rows: usize) -> Self {
        Self { first: 0, samples: Vec::with_capacity(rows), sums: Vec::with_capacity(rows) }
    }

    /// Takes a column's rows, and as many beside them as a look at one of them needs.
    pub fn fill<S: Signal>(&mut self, signal: S, column: usize, rows: std::ops::Range<usize>) {
        let kernel = Kernel::for_step(S::STEP);
        self.first = rows.start.saturating_sub(LONGEST_WINDOW);
        let end = (rows.end + LONGEST_WINDOW).min(signal.rows());
        self.samples.clear();
        self.samples.extend((self.first..end).map(|row| signal.value(column, row)));
        self.sums.clear();
        self.sums.resize(self.samples.len(), 0);
        let mut sum = 0;
        for (index, sample) in self.samples.iter().enumerate() {
            sum += i32::from(*sample);
            if index >= kernel.length() {
                sum -= i32::from(self.samples[index - kernel.length()]);
            }
            if index + 1 >= kernel.length() {
                self.sums[index - kernel.half] = sum;
            }
        }
    }

    /// [`find_above`] in this column, which `signal` has at `column`: the same result, sooner where there is nothing.
    pub fn find_above<S: Signal>(
        &self,
        signal: S,
        column: usize,
        centre: usize,
        reach: usize,
        least: f32,
    ) -> Option<Peak> {
        let kernel = Kernel::for_step(S::STEP);
        let rows = window(centre, kernel.reach() + reach, signal.rows());
        let inside = rows.start.checked_sub(self.first)..rows.end.checked_sub(self.first);
        let range = inside.start.zip(inside.end).map(|(start, end)| start..end);
        let pair = range.and_then(|range| Some((self.samples.get(range.clone())?, self.sums.get(range)?)));
        let Some((samples, sums)) = pair else { return find_above(signal, column, centre, reach, least) };
        // What is as strong as this may be hollow, and the samples themselves must be mended first.
        if samples.iter().all(|sample| *sample < HOLLOW_STRENGTH) {
            let ridge = Ridge { samples, sums: Sums::OfColumn(sums), kernel };
            let middle = centre - rows.start;
            let crest = ridge.crest(middle.saturating_sub(reach)..middle + reach + 1)?;
            let rises = ridge.over(crest.at, crest.above.min(crest.below)) >= least
                && ridge.over(crest.at, crest.above.max(crest.below)) > 0.0;
            if !rises {
                return None;
            }
        }
        find_above(signal, column, centre, reach, least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Plane;
    use crate::vision::signal::RedMinusGreen;

    /// A column that is kept gives what looking into the picture each time gives, at its ends and beyond clipped cores too.
    #[test]
    fn a_kept_column_gives_what_the_picture_gives() {
        let seed = 20_261_123;
        let mut dice = crate::twin::random::Dice::new(seed);
        let mut found = 0;
        for round in 0..60 {
            let (middle, height) = (dice.between(0.0, 200.0), dice.between(5.0, 400.0));
            let bytes: Vec<u8> = (0..200)
                .flat_map(|row| {
                    let bell = (-0.5 * ((f64::from(row) - middle) / 2.5).powi(2)).exp();
                    let red = 90.0 + height * bell + 3.0 * dice.normal();
                    [red.round() as u8, (90.0 + 0.3 * height * bell) as u8, 80]
                })
                .collect();
            let signal = RedMinusGreen(Plane::new(&bytes, 3, 3, 200).unwrap());
            let mut column = Column::new(200);
            column.fill(signal, 0, 30..170);
            for centre in 30..170 {
                let expected = find_above(signal, 0, centre, 1, 6.0);
                found += usize::from(expected.is_some());
                let kept = column.find_above(signal, 0, centre, 1, 6.0);
                assert_eq!(kept, expected, "seed {seed}, round {round}, row {centre}");
            }
        }
        assert!(found > 200, "{found} ridges");
    }
}
