//! The least-squares fits behind [`super::EdgeModel`], many steps at a time.
//!
//! One column is compared with more than a hundred steps, and with a ridge on some fifty of them. The sums over rows
//! that these fits need are taken for all steps side by side, rows outside and steps inside, so that they become vector
//! instructions; what depends on the steps alone is summed up once. Each sum adds up its rows in order, so a step's fit
//! is to the last bit what it would be alone.

use super::{BLURS, Explanation, ROWS, STEPS, STEPS_ASIDE};
use crate::simd::Kernel;

/// Steps that are compared at a time around the best one; the last one is none.
const NEAR: usize = 2 * STEPS_ASIDE + 2;
/// Room for [`NEAR`] steps from any on.
const ROOM: usize = (STEPS + NEAR).next_multiple_of(8);
/// A shape that is nearly none (the ridge's part behind a far edge) must not explode.
const LEAST_SQUARE: f32 = 1e-3;
/// Number of rows.
const COUNT: f32 = ROWS as f32;

/// Steps of one blur, at every half row.
#[derive(Debug, Clone, Copy)]
pub struct Steps {
    /// Rows outside, steps inside.
    rows: [[f32; ROOM]; ROWS],
    means: [f32; ROOM],
    /// Sums of squares about the mean, see [`LEAST_SQUARE`].
    squares: [f32; ROOM],
}

impl Steps {
    /// Before [`Self::fill`].
    pub const NONE: Self = Self { rows: [[0.0; ROOM]; ROWS], means: [0.0; ROOM], squares: [1.0; ROOM] };

    /// Makes steps blurred by this standard deviation, rows.
    pub fn fill(&mut self, deviation: f32) {
        for (row, values) in self.rows.iter_mut().enumerate() {
            for (index, value) in values.iter_mut().enumerate() {
                let edge = index as f32 / 2.0 - super::FARTHEST_STEP as f32;
                let distance = (row as f32 - super::EXPLAINED_ROWS as f32 - edge) / deviation;
                // The logistic curve differs from the normal integral by less than 0.01.
                *value = 1.0 / (1.0 + (-1.702 * distance).exp());
            }
        }
        for index in 0..ROOM {
            let mean = self.rows.iter().map(|row| row[index]).sum::<f32>() / COUNT;
            let square: f32 = self.rows.iter().map(|row| row[index] * row[index]).sum();
            self.means[index] = mean;
            self.squares[index] = square - COUNT * mean * mean + LEAST_SQUARE;
        }
    }
}

/// Sums over all rows of values (of row and lane) that lie side by side.
#[inline(always)]
fn sum_rows<const LANES: usize>(value: impl Fn(usize, usize) -> f32) -> [f32; LANES] {
    let mut sums = [0.0_f32; LANES];
    for row in 0..ROWS {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += value(row, lane);
        }
    }
    sums
}

/// [`NEAR`] steps from one on, rows outside.
#[inline(always)]
fn near(steps: &Steps, first: usize) -> [[f32; NEAR]; ROWS] {
    let mut near = [[0.0; NEAR]; ROWS];
    for (near, row) in near.iter_mut().zip(&steps.rows) {
        near.copy_from_slice(&row[first..first + NEAR]);
    }
    near
}

/// Mean of some rows, and sum of squares about it.
#[inline(always)]
fn moments(values: &[f32; ROWS]) -> (f32, f32) {
    let mean = values.iter().sum::<f32>() / COUNT;
    (mean, values.iter().map(|value| value * value).sum::<f32>() - COUNT * mean * mean)
}

/// A fit of a constant and up to three shapes, from sums about the means: the right-hand side is the fourth column.
#[inline(always)]
fn solve<const SHAPES: usize>(mut matrix: [[f32; 4]; 3], total: f32) -> ([f32; 3], f32) {
    let right = matrix.map(|row| row[3]);
    let mut factors = [0.0; 3];
    for pivot in 0..SHAPES {
        for row in pivot + 1..SHAPES {
            let factor = matrix[row][pivot] / matrix[pivot][pivot];
            let above = matrix[pivot];
            for (value, above) in matrix[row].iter_mut().zip(above) {
                *value -= factor * above;
            }
        }
    }
    for row in (0..SHAPES).rev() {
        let known: f32 = (row + 1..SHAPES).map(|other| matrix[row][other] * factors[other]).sum();
        factors[row] = (matrix[row][3] - known) / matrix[row][row];
    }
    let explained: f32 = factors.iter().zip(right).map(|(factor, right)| factor * right).sum();
    (factors, (total - explained).max(0.0))
}

/// A column explained by a blurred step, without and with a ridge at a known row.
pub struct Explain<'a> {
    pub steps: &'a [Steps; BLURS.len()],
    pub samples: &'a [f32; ROWS],
    pub ridge: &'a [f32; ROWS],
}

impl Kernel for Explain<'_> {
    type Output = Explanation;

    #[inline(always)]
    fn run(self) -> Explanation {
        let (level, total) = moments(self.samples);
        let mut best = Explanation { without: f32::INFINITY, with: f32::INFINITY, ..Explanation::default() };
        let mut nearest = 0;
        let mut fits = [[0.0; ROOM]; BLURS.len()];
        for (steps, fits) in self.steps.iter().zip(&mut fits) {
            let sums: [f32; ROOM] = sum_rows(|row, index| steps.rows[row][index] * self.samples[row]);
            for (index, fit) in fits.iter_mut().enumerate() {
                *fit = sums[index] - COUNT * steps.means[index] * level;
            }
            for (index, fit) in fits.iter().enumerate().take(STEPS) {
                let factor = fit / steps.squares[index];
                let error = (total - factor * fit).max(0.0);
                if error < best.without {
                    (best.without, nearest) = (error, index);
                }
            }
        }
        // A ridge pulls the best step towards itself, not farther than its own width.
        let first = nearest.saturating_sub(STEPS_ASIDE);
        let count = (nearest + STEPS_ASIDE + 1).min(STEPS) - first;
        for (blur, (steps, fits)) in self.steps.iter().zip(&fits).enumerate() {
            let sums = RidgeSums::new(steps, self.ridge, self.samples, first, level);
            for lane in 0..count {
                let matrix = sums.matrix(steps, fits, lane);
                if let Some((heights, step, error)) = fit_ridge(matrix, total)
                    && error < best.with
                {
                    best.with = error;
                    best.at = [blur, first + lane];
                    best.ridge = self.highest(&steps.rows, first + lane, heights);
                    best.step = step;
                }
            }
        }
        best.with = best.with.min(best.without);
        best
    }
}

impl Explain<'_> {
    /// Height of a ridge with one height before the step and another behind it.
    fn highest(&self, steps: &[[f32; ROOM]; ROWS], index: usize, heights: [f32; 2]) -> f32 {
        let height = |row: usize| {
            let (ridge, step) = (self.ridge[row], steps[row][index]);
            heights[0] * (ridge * (1.0 - step)) + heights[1] * (ridge * step)
        };
        (0..ROWS).map(height).fold(0.0, f32::max)
    }
}

/// Heights of the ridge on both sides, of the step, and what is left unexplained; `None` where no ridge helps.
#[inline(always)]
fn fit_ridge(matrix: [[f32; 4]; 3], total: f32) -> Option<([f32; 2], f32, f32)> {
    let (factors, error) = solve::<3>(matrix, total);
    let is_negative = factors[1] < 0.0 || factors[2] < 0.0;
    if !is_negative {
        return Some(([factors[1], factors[2]], factors[0], error));
    }
    // Light adds: a ridge on one side only, the side on which it is one.
    let only = |shape: usize| {
        let pick = |row: usize| [matrix[row][0], matrix[row][shape], 0.0, matrix[row][3]];
        solve::<2>([pick(0), pick(shape), [0.0; 4]], total)
    };
    let candidates = [(only(1), 0), (only(2), 1)];
    let admitted = candidates.into_iter().filter(|((factors, _), _)| factors[1] > 0.0);
    let ((factors, error), side) = admitted.min_by(|one, other| one.0.1.total_cmp(&other.0.1))?;
    let mut heights = [0.0; 2];
    heights[side] = factors[1];
    Some((heights, factors[0], error))
}

/// What the fits of a ridge, cut in two by each of [`NEAR`] steps, need: sums over rows, one for each step.
struct RidgeSums {
    first: usize,
    /// Means of the ridge's part before the step and of that behind it.
    means: [[f32; NEAR]; 2],
    level: f32,
    step_before: [f32; NEAR],
    step_behind: [f32; NEAR],
    before_before: [f32; NEAR],
    before_behind: [f32; NEAR],
    behind_behind: [f32; NEAR],
    before_samples: [f32; NEAR],
    behind_samples: [f32; NEAR],
}

impl RidgeSums {
    #[inline(always)]
    fn new(steps: &Steps, ridge: &[f32; ROWS], samples: &[f32; ROWS], first: usize, level: f32) -> Self {
        let step = near(steps, first);
        let (mut before, mut behind) = ([[0.0; NEAR]; ROWS], [[0.0; NEAR]; ROWS]);
        for row in 0..ROWS {
            for lane in 0..NEAR {
                before[row][lane] = ridge[row] * (1.0 - step[row][lane]);
                behind[row][lane] = ridge[row] * step[row][lane];
            }
        }
        let mut means = [sum_rows(|row, lane| before[row][lane]), sum_rows(|row, lane| behind[row][lane])];
        means.iter_mut().flatten().for_each(|mean| *mean /= COUNT);
        Self {
            first,
            means,
            level,
            step_before: sum_rows(|row, lane| step[row][lane] * before[row][lane]),
            step_behind: sum_rows(|row, lane| step[row][lane] * behind[row][lane]),
            before_before: sum_rows(|row, lane| before[row][lane] * before[row][lane]),
            before_behind: sum_rows(|row, lane| before[row][lane] * behind[row][lane]),
            behind_behind: sum_rows(|row, lane| behind[row][lane] * behind[row][lane]),
            before_samples: sum_rows(|row, lane| before[row][lane] * samples[row]),
            behind_samples: sum_rows(|row, lane| behind[row][lane] * samples[row]),
        }
    }

    /// The system of equations of one step: step, ridge before it, ridge behind it, and the samples.
    #[inline(always)]
    fn matrix(&self, steps: &Steps, fits: &[f32; ROOM], lane: usize) -> [[f32; 4]; 3] {
        let index = self.first + lane;
        let means = [steps.means[index], self.means[0][lane], self.means[1][lane]];
        let about = |sum: f32, one: usize, other: usize| sum - COUNT * means[one] * means[other];
        let of_samples = |sum: f32, one: usize| sum - COUNT * means[one] * self.level;
        let (step_before, step_behind) = (self.step_before[lane], self.step_behind[lane]);
        let both = self.before_behind[lane];
        [
            [steps.squares[index], about(step_before, 0, 1), about(step_behind, 0, 2), fits[index]],
            [
                about(step_before, 1, 0),
                about(self.before_before[lane], 1, 1) + LEAST_SQUARE,
                about(both, 1, 2),
                of_samples(self.before_samples[lane], 1),
            ],
            [
                about(step_behind, 2, 0),
                about(both, 2, 1),
                about(self.behind_behind[lane], 2, 2) + LEAST_SQUARE,
                of_samples(self.behind_samples[lane], 2),
            ],
        ]
    }
}

/// The least error that a ridge elsewhere leaves with any of some steps (every second one); infinite where it would
/// have to be a groove.
pub struct Elsewhere<'a> {
    pub steps: &'a Steps,
    pub samples: &'a [f32; ROWS],
    pub ridge: &'a [f32; ROWS],
    pub near: std::ops::Range<usize>,
}

impl Kernel for Elsewhere<'_> {
    type Output = f32;

    #[inline(always)]
    fn run(self) -> f32 {
        let Self { steps, samples, ridge, near: range } = self;
        let (level, total) = moments(samples);
        let (middle, square) = moments(ridge);
        let ridge_samples = ridge.iter().zip(samples).map(|(ridge, sample)| ridge * sample).sum::<f32>();
        let step = near(steps, range.start);
        let step_ridge: [f32; NEAR] = sum_rows(|row, lane| step[row][lane] * ridge[row]);
        let step_samples: [f32; NEAR] = sum_rows(|row, lane| step[row][lane] * samples[row]);
        let mut least = f32::INFINITY;
        for (lane, index) in range.clone().enumerate().step_by(2) {
            let mean = steps.means[index];
            let rows = [
                [
                    steps.squares[index],
                    step_ridge[lane] - COUNT * mean * middle,
                    0.0,
                    step_samples[lane] - COUNT * mean * level,
                ],
                [
                    step_ridge[lane] - COUNT * middle * mean,
                    square + LEAST_SQUARE,
                    0.0,
                    ridge_samples - COUNT * middle * level,
                ],
                [0.0; 4],
            ];
            let (factors, error) = solve::<2>(rows, total);
            if factors[1] > 0.0 {
                least = least.min(error);
            }
        }
        least
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::edge::{EXPLAINED_ROWS, EdgeModel, FARTHEST_STEP};

    /// Plain least squares of a constant and some shapes.
    fn plain<const SHAPES: usize>(samples: &[f32; ROWS], shapes: &[[f32; ROWS]; SHAPES]) -> ([f32; 3], f32) {
        let mean = |values: &[f32; ROWS]| values.iter().sum::<f32>() / COUNT;
        let about = |one: &[f32; ROWS], other: &[f32; ROWS]| {
            one.iter().zip(other).map(|(one, other)| one * other).sum::<f32>()
                - COUNT * mean(one) * mean(other)
        };
        let mut matrix = [[0.0; 4]; 3];
        for (row, one) in shapes.iter().enumerate() {
            for (column, other) in shapes.iter().enumerate() {
                matrix[row][column] = about(one, other);
            }
            matrix[row][row] += LEAST_SQUARE;
            matrix[row][3] = about(one, samples);
        }
        solve::<SHAPES>(matrix, about(samples, samples))
    }

    /// The same search one step after the other.
    fn explain_plainly(samples: &[f32; ROWS], ridge: &[f32; ROWS], width: f32) -> Explanation {
        let deviation = (width / 2.355).clamp(0.7, 4.0);
        let step = |blur: f32, index: usize| -> [f32; ROWS] {
            std::array::from_fn(|row| {
                let edge = index as f32 / 2.0 - FARTHEST_STEP as f32;
                let distance = (row as f32 - EXPLAINED_ROWS as f32 - edge) / (blur * deviation);
                1.0 / (1.0 + (-1.702 * distance).exp())
            })
        };
        let mut best = Explanation { without: f32::INFINITY, with: f32::INFINITY, ..Explanation::default() };
        let mut nearest = 0;
        for blur in BLURS {
            for index in 0..STEPS {
                let (_, error) = plain(samples, &[step(blur, index)]);
                if error < best.without {
                    (best.without, nearest) = (error, index);
                }
            }
        }
        for (number, blur) in BLURS.into_iter().enumerate() {
            for index in nearest.saturating_sub(STEPS_ASIDE)..(nearest + STEPS_ASIDE + 1).min(STEPS) {
                let step = step(blur, index);
                let before = std::array::from_fn(|row| ridge[row] * (1.0 - step[row]));
                let behind = std::array::from_fn(|row| ridge[row] * step[row]);
                let (mut factors, mut error) = plain(samples, &[step, before, behind]);
                if factors[1] < 0.0 || factors[2] < 0.0 {
                    let (first, second) = (plain(samples, &[step, before]), plain(samples, &[step, behind]));
                    let turned = ([second.0[0], 0.0, second.0[1]], second.1);
                    let believed = [(first, first.0[1]), (turned, second.0[1])];
                    let admitted = believed.into_iter().filter(|(_, height)| *height > 0.0);
                    let Some((better, _)) = admitted.min_by(|a, b| a.0.1.total_cmp(&b.0.1)) else { continue };
                    (factors, error) = better;
                }
                if error < best.with {
                    let height = |row: usize| factors[1] * before[row] + factors[2] * behind[row];
                    best.with = error;
                    best.at = [number, index];
                    best.ridge = (0..ROWS).map(height).fold(0.0, f32::max);
                    best.step = factors[0];
                }
            }
        }
        best.with = best.with.min(best.without);
        best
    }

    /// Speed must not change a decision: many steps side by side give what one after the other gives, to the last bit.
    #[test]
    fn steps_side_by_side_are_fitted_as_each_alone() {
        let seed = 20_261_122;
        let mut dice = crate::twin::random::Dice::new(seed);
        for round in 0..200 {
            let width = dice.between(1.5, 9.0) as f32;
            let (edge, step) = (dice.between(-10.0, 10.0), dice.between(-150.0, 150.0));
            let (at, height) = (dice.between(-4.0, 4.0), dice.between(-40.0, 120.0));
            let samples: [f32; ROWS] = std::array::from_fn(|row| {
                let row = row as f64 - EXPLAINED_ROWS as f64;
                let bell = (-0.5 * ((row - at) / 1.5).powi(2)).exp();
                (step / (1.0 + (edge - row).exp()) + height * bell + 2.0 * dice.normal()).round() as f32
            });
            let mut model = EdgeModel::new();
            model.set_width(width);
            let offset = dice.between(-2.0, 2.0) as f32;
            let expected = explain_plainly(&samples, &model.ridge(offset), width);
            assert_eq!(model.explain(&samples, offset), expected, "seed {seed}, round {round}");
        }
    }
}
