//! Finding the floor's stripe in many columns side by side: a ridge that stands out on both sides, near a known row.
//!
//! Only local contrast counts. The background is the lowest level that is reached on each side within a short way, and
//! the higher of the two sides is the one that the stripe must stand out from: neither the edge of a red line nor a
//! red floor is a stripe, but a stripe on either is. Of all rows in question the one with the most contrast is taken,
//! not the brightest: a plateau of red paint beside the stripe is brighter, and stands out from nothing.
//!
//! Every loop here runs over columns inside and rows outside, without branches, so that the compiler works on as many
//! columns at a time as the processor's registers hold.

mod kernel;

use crate::simd;
pub use kernel::Kernel;
use kernel::MOST_NEAR;

/// Farthest row from the middle that a block holds.
pub const MOST_ROWS_ASIDE: usize = 64;
/// Farthest row from the middle at which a crest can be looked for.
pub const MOST_REACH: usize = 16;
const ROWS: usize = 2 * MOST_ROWS_ASIDE + 1;
const CRESTS: usize = 2 * MOST_REACH + 1;
const RIMS: usize = 2 * MOST_NEAR + 1;
/// The second smallest of four medians of the magnitudes of differences of two normal values, in their standard
/// deviations: sqrt(2) times 0.6745, less for being the second smallest of four.
const QUIET_STEP: f32 = 0.8;

/// A ridge beside the middle of a block's column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ridge {
    /// Where, samples below the middle row.
    pub offset: f32,
    /// Mean height of the running sum over the higher background.
    pub contrast: f32,
    /// The same over the lower background.
    pub rise: f32,
    /// Samples above half of its height.
    pub width: f32,
    /// How far the core falls below its rims, samples' units.
    pub hollow: f32,
    /// It rises beyond the rows in question.
    pub outside: bool,
}

/// Some columns around their middle rows, rows outside, columns inside.
#[derive(Debug, Clone)]
pub struct Block<const LANES: usize> {
    samples: Box<[[i16; LANES]; ROWS]>,
    sums: Box<[[i16; LANES]; ROWS]>,
    above: Box<[[i16; LANES]; CRESTS]>,
    below: Box<[[i16; LANES]; CRESTS]>,
    rims: Box<[[i16; LANES]; RIMS]>,
    best: Best<LANES>,
}

/// The best crest of each column.
#[derive(Debug, Clone)]
struct Best<const LANES: usize> {
    crest: [i16; LANES],
    contrast: [i16; LANES],
    background: [i16; LANES],
    rise: [i16; LANES],
    most: [i16; LANES],
    weight: [i32; LANES],
    moment: [i32; LANES],
    width: [i16; LANES],
    hollow: [i16; LANES],
}

const fn at(row: isize) -> usize {
    row.saturating_add(MOST_ROWS_ASIDE as isize) as usize
}

impl<const LANES: usize> Default for Block<LANES> {
    fn default() -> Self {
        let best = Best {
            crest: [0; LANES],
            contrast: [0; LANES],
            background: [0; LANES],
            rise: [0; LANES],
            most: [0; LANES],
            weight: [0; LANES],
            moment: [0; LANES],
            width: [0; LANES],
            hollow: [0; LANES],
        };
        Self {
            samples: Box::new([[0; LANES]; ROWS]),
            sums: Box::new([[0; LANES]; ROWS]),
            above: Box::new([[0; LANES]; CRESTS]),
            below: Box::new([[0; LANES]; CRESTS]),
            rims: Box::new([[0; LANES]; RIMS]),
            best,
        }
    }
}

/// The search as vector instructions.
struct Search<'a, const LANES: usize> {
    block: &'a mut Block<LANES>,
    kernel: Kernel,
    reach: usize,
}

impl<const LANES: usize> simd::Kernel for Search<'_, LANES> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { block, kernel, reach } = self;
        block.sum_up(kernel, reach);
        block.find_backgrounds(kernel, reach);
        block.choose_crests(reach);
        block.weigh(kernel, reach);
        block.find_hollows(kernel);
    }
}

impl<const LANES: usize> Block<LANES> {
    /// The samples of a row, counted from the middle.
    pub fn row(&self, row: isize) -> &[i16; LANES] {
        &self.samples[at(row)]
    }

    /// The samples of a row, to be filled in.
    pub fn row_mut(&mut self, row: isize) -> &mut [i16; LANES] {
        &mut self.samples[at(row)]
    }

    /// Looks for the best crest of every column within `reach` rows of the middle; [`Self::ridge`] tells it. All rows
    /// up to [`Kernel::rows_aside`] must be filled in.
    pub fn search(&mut self, kernel: Kernel, reach: usize) {
        simd::run(Search { block: self, kernel, reach: reach.min(MOST_REACH) });
    }

    /// Running sums over the kernel's length.
    #[inline(always)]
    fn sum_up(&mut self, kernel: Kernel, reach: usize) {
        let (half, end) = (kernel.half as isize, (kernel.far + reach) as isize);
        let mut sum = [0_i16; LANES];
        for row in -end - half..-end + half {
            add(&mut sum, &self.samples[at(row)]);
        }
        for row in -end..=end {
            add(&mut sum, &self.samples[at(row + half)]);
            self.sums[at(row)] = sum;
            for (sum, sample) in sum.iter_mut().zip(&self.samples[at(row - half)]) {
                *sum -= sample;
            }
        }
    }

    /// The lowest sums beyond [`Kernel::near`] on both sides of every row in question.
    #[inline(always)]
    fn find_backgrounds(&mut self, kernel: Kernel, reach: usize) {
        let (near, far, reach) = (kernel.near as isize, kernel.far as isize, reach as isize);
        for (lowest, sign) in [(&mut self.above, -1), (&mut self.below, 1)] {
            let mut least = [i16::MAX; LANES];
            let mut row = far + reach;
            for crest in (-reach..=reach).rev() {
                // Seen from its own side, the farthest crest comes first.
                while row >= near + crest {
                    lower(&mut least, &self.sums[at(sign * row)]);
                    row -= 1;
                }
                lowest[(sign * crest + MOST_REACH as isize) as usize] = least;
            }
        }
    }

    #[inline(always)]
    fn choose_crests(&mut self, reach: usize) {
        let reach = reach as isize;
        let best = &mut self.best;
        best.contrast = [i16::MIN; LANES];
        best.most = [0; LANES];
        for crest in -reach..=reach {
            let index = (crest + MOST_REACH as isize) as usize;
            let (sums, above, below) = (&self.sums[at(crest)], &self.above[index], &self.below[index]);
            for lane in 0..LANES {
                let (high, low) = (above[lane].max(below[lane]), above[lane].min(below[lane]));
                let contrast = sums[lane].saturating_sub(high);
                let better = contrast > best.contrast[lane];
                best.contrast[lane] = if better { contrast } else { best.contrast[lane] };
                best.crest[lane] = if better { crest as i16 } else { best.crest[lane] };
                best.background[lane] = if better { high } else { best.background[lane] };
                best.rise[lane] = if better { sums[lane].saturating_sub(low) } else { best.rise[lane] };
                best.most[lane] = best.most[lane].max(sums[lane].saturating_sub(low));
            }
        }
    }

    /// Centre of gravity of what rises above a quarter of the height, and the width at half of it. The centre is not
    /// moved by clipped cores, and little by what lies beside the stripe.
    #[inline(always)]
    fn weigh(&mut self, kernel: Kernel, reach: usize) {
        let beside = kernel.near as i16 - 1;
        let end = reach as i16 + beside;
        let length = kernel.length() as i16;
        let best = &mut self.best;
        best.weight = [0; LANES];
        best.moment = [0; LANES];
        best.width = [0; LANES];
        for row in -end..=end {
            let samples = &self.samples[at(isize::from(row))];
            #[allow(clippy::needless_range_loop, reason = "seven arrays in step, which become vectors")]
            for lane in 0..LANES {
                let distance = row - best.crest[lane];
                let level = (samples[lane] * length).saturating_sub(best.background[lane]);
                let inside = distance.abs() <= beside;
                let excess = if inside { level.saturating_sub(best.contrast[lane] / 4).max(0) } else { 0 };
                best.weight[lane] += i32::from(excess);
                best.moment[lane] += i32::from(excess) * i32::from(distance);
                best.width[lane] += i16::from(inside & (level > best.contrast[lane] / 2));
            }
        }
    }

    /// How far the core lies below what is reached above and below it.
    #[inline(always)]
    fn find_hollows(&mut self, kernel: Kernel) {
        let end = kernel.near as isize;
        let hollow = &mut self.best.hollow;
        *hollow = [0; LANES];
        let rim = |row: isize| (row + end) as usize;
        let mut highest = [i16::MIN; LANES];
        for row in (-end..=end).rev() {
            raise(&mut highest, &self.samples[at(row)]);
            self.rims[rim(row)] = highest;
        }
        highest = [i16::MIN; LANES];
        for row in -end..=end {
            let samples = &self.samples[at(row)];
            raise(&mut highest, samples);
            for lane in 0..LANES {
                let rims = highest[lane].min(self.rims[rim(row)][lane]);
                hollow[lane] = hollow[lane].max(rims - samples[lane]);
            }
        }
    }

    /// What the last search found in one column; `None` where nothing stands out on both sides.
    #[must_use]
    pub fn ridge(&self, lane: usize, kernel: Kernel, reach: usize) -> Option<Ridge> {
        let best = &self.best;
        let length = kernel.length() as f32;
        if best.contrast[lane] <= 0 {
            return None;
        }
        let offset = best.moment[lane] as f32 / best.weight[lane].max(1) as f32;
        Some(Ridge {
            offset: f32::from(best.crest[lane]) + offset,
            contrast: f32::from(best.contrast[lane]) / length,
            rise: f32::from(best.rise[lane]) / length,
            width: f32::from(best.width[lane]),
            hollow: f32::from(best.hollow[lane]),
            outside: usize::from(best.crest[lane].unsigned_abs()) >= reach.min(MOST_REACH),
        })
    }

    /// How much the running mean varies where there is no stripe, as the standard deviation that normal noise would
    /// have: from the steps between neighbouring, not overlapping sums beyond the nearest background. Of two stretches on
    /// each side the second quietest is told, so that edges of paint that cross two of them count for nothing. NaN
    /// without room.
    #[must_use]
    pub fn roughness(&self, lane: usize, kernel: Kernel, reach: usize) -> f32 {
        let (length, end) = (kernel.length() as isize, (kernel.far + reach) as isize);
        let first = kernel.near as isize + kernel.half as isize;
        let middle = (first + end - length + 1) / 2;
        let quiet = |rows: std::ops::Range<isize>, sign: isize| {
            let mut steps = [0_i16; ROWS];
            let count = rows.len();
            for (step, row) in steps.iter_mut().zip(rows) {
                let pair = [row, row + length].map(|row| self.sums[at(sign * row)][lane]);
                *step = pair[0].saturating_sub(pair[1]).saturating_abs();
            }
            if count == 0 { i16::MAX } else { *steps[..count].select_nth_unstable(count / 2).1 }
        };
        let mut stretches = [
            quiet(first..middle, -1),
            quiet(middle..end - length + 1, -1),
            quiet(first..middle, 1),
            quiet(middle..end - length + 1, 1),
        ];
        stretches.sort_unstable();
        let [_, quiet, ..] = stretches;
        if quiet == i16::MAX {
            return f32::NAN;
        }
        f32::from(quiet) / length as f32 / QUIET_STEP
    }

    /// How far any row in question stands out from the lower side, whether or not it does from the other.
    #[must_use]
    pub fn rise(&self, lane: usize, kernel: Kernel) -> f32 {
        f32::from(self.best.most[lane]) / kernel.length() as f32
    }
}

#[inline(always)]
fn add<const LANES: usize>(sum: &mut [i16; LANES], samples: &[i16; LANES]) {
    for (sum, sample) in sum.iter_mut().zip(samples) {
        *sum += sample;
    }
}

#[inline(always)]
fn lower<const LANES: usize>(least: &mut [i16; LANES], samples: &[i16; LANES]) {
    for (least, sample) in least.iter_mut().zip(samples) {
        *least = (*least).min(*sample);
    }
}

#[inline(always)]
fn raise<const LANES: usize>(most: &mut [i16; LANES], samples: &[i16; LANES]) {
    for (most, sample) in most.iter_mut().zip(samples) {
        *most = (*most).max(*sample);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNEL: Kernel = Kernel { half: 2, near: 6, far: 18 };
    const REACH: usize = 4;

    /// A block whose column number `lane` holds `samples(row)`.
    fn block(lane: usize, samples: impl Fn(f32) -> f32) -> Block<4> {
        let mut block = Block::default();
        let rows = KERNEL.rows_aside(REACH) as isize;
        for row in -rows..=rows {
            block.row_mut(row)[lane] = samples(row as f32).clamp(-255.0, 255.0).round() as i16;
        }
        block.search(KERNEL, REACH);
        block
    }

    fn bell(row: f32, middle: f32, height: f32) -> f32 {
        height * (-(row - middle).powi(2) / (2.0 * 2.0 * 2.0)).exp()
    }

    #[test]
    fn the_row_is_right_to_a_tenth_of_a_sample_clipped_or_not() {
        for step in 0..20 {
            let middle = step as f32 / 10.0 - 1.0;
            for height in [30.0, 180.0, 500.0] {
                let block = block(2, |row| 4.0 + bell(row, middle, height));
                let ridge = block.ridge(2, KERNEL, REACH).unwrap();
                assert!((ridge.offset - middle).abs() < 0.1, "{middle} at {height}: {ridge:?}");
                assert_eq!(block.ridge(1, KERNEL, REACH), None, "a column of nothing beside it");
            }
        }
    }

    #[test]
    fn a_stripe_beside_brighter_paint_is_taken_and_the_paint_is_not() {
        let edge = |row: f32| if row > 9.0 { 150.0 } else { 5.0 };
        let bare = block(0, edge);
        assert_eq!(bare.ridge(0, KERNEL, REACH), None, "an edge stands out on one side only");
        let lit = block(0, |row| edge(row) + bell(row, 0.0, 60.0));
        let ridge = lit.ridge(0, KERNEL, REACH).unwrap();
        assert!(ridge.offset.abs() < 0.5 && ridge.contrast > 30.0, "{ridge:?}");
    }

    #[test]
    fn a_crest_beyond_the_rows_in_question_is_told_as_one() {
        let ridge = block(0, |row| bell(row, 7.0, 100.0)).ridge(0, KERNEL, REACH);
        assert!(ridge.is_none_or(|ridge| ridge.outside), "{ridge:?}");
    }

    #[test]
    fn a_hollow_core_is_told_as_deep_as_it_is() {
        let hollow = |row: f32| if row.abs() < 1.5 { 40.0 } else { bell(row, 0.0, 120.0) };
        let ridge = block(0, hollow).ridge(0, KERNEL, REACH).unwrap();
        assert!(ridge.hollow > 20.0, "{ridge:?}");
        assert_eq!(block(0, |row| bell(row, 0.0, 120.0)).ridge(0, KERNEL, REACH).unwrap().hollow, 0.0);
    }

    #[test]
    fn roughness_sees_texture_but_neither_the_stripe_nor_an_edge() {
        let rough = |samples: &dyn Fn(f32) -> f32| block(0, samples).roughness(0, KERNEL, REACH);
        assert!(rough(&|row| 7.0 + bell(row, 0.0, 200.0)) < 0.5);
        assert!(rough(&|row| if row < -9.0 { 150.0 } else { 7.0 }) < 0.5, "one edge of paint is no texture");
        let stripes = |row: f32| if (row / 5.0).floor() as i32 % 2 == 0 { 0.0 } else { 10.0 };
        assert!(rough(&stripes) > 2.0);
    }
}
