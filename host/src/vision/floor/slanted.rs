//! A stripe that the edge of a paint crosses, seen along that edge.
//!
//! Straight down a column, an edge within the stripe's own rows is a step that hides the ridge. Along the edge there is
//! no step: what lies beside the stripe in that direction is of the same mixture of paint and floor as what the stripe
//! falls on. So the column is read along the direction in which the rows beside the stripe are most alike, through the
//! column's own point of the stripe. Edges of paints and tiles are straight for longer than this looks aside.

use super::strip::{MOST_ASIDE, Strip};
use crate::vision::ridge::Kernel;

/// Directions that are tried, columns to a row.
const SLANTS: [f32; 25] = [
    0.0, 0.5, -0.5, 1.0, -1.0, 1.5, -1.5, 2.0, -2.0, 2.75, -2.75, 3.75, -3.75, 5.0, -5.0, 6.5, -6.5, 8.5,
    -8.5, 11.0, -11.0, 14.0, -14.0, 18.0, -18.0,
];
/// Columns to both sides that a direction may need.
pub const COLUMNS_ASIDE: usize = 18 * (MOST_NEAR + MOST_LENGTH);
/// A better direction is looked for between those so many times, halving the distance.
const REFINEMENTS: usize = 3;
/// Most rows to each side that belong to the stripe.
const MOST_NEAR: usize = 9;
/// Most rows of background on each side.
const MOST_LENGTH: usize = 6;
const MOST_ROWS: usize = 2 * (MOST_NEAR + MOST_LENGTH) + 1;
/// The ridge must be so many times as high as what it leaves unexplained along the direction (root mean square).
const LEAST_OF_REST: f32 = 5.0;
/// Rows by which the ridge is tried elsewhere, and how far.
const STEP_ROWS: f32 = 0.25;
const STEPS: i16 = 8;

/// A column's ridge, read along an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlantedRidge {
    /// Height over the background.
    pub height: f32,
    /// Rows below the floor's row.
    pub offset: f32,
}

/// What a stripe looks like: width at half of its height, rows, and where it is looked for.
#[derive(Debug, Clone, Copy)]
pub struct Expected {
    /// Rows.
    pub width: f32,
    /// The middle, rows below the strip's middle row.
    pub offset: f32,
    /// Farthest from there, rows.
    pub tolerance: f32,
}

/// A column's rows, read along one direction.
#[derive(Debug, Clone, Copy)]
struct Reading {
    rows: [f32; MOST_ROWS],
    far: usize,
    middle: isize,
}

/// A constant and a ridge, fitted to all rows.
#[derive(Debug, Clone, Copy)]
struct Fit {
    height: f32,
    /// Squared error per row.
    rest: f32,
}

impl Reading {
    fn new(expected: &Expected) -> Self {
        let kernel = Kernel::for_width(expected.width);
        let far = kernel.near.min(MOST_NEAR) + kernel.length().clamp(2, MOST_LENGTH);
        Self { rows: [0.0; MOST_ROWS], far, middle: expected.offset.round() as isize }
    }

    /// Reads along a direction; false where the strip ends before.
    fn read(&mut self, strip: &Strip, column: usize, slant: f32) -> bool {
        let far = self.far as isize;
        let columns = strip.columns() as isize;
        let most = (slant.abs() * far as f32).ceil() as isize;
        let ends = self.middle.abs() + far > MOST_ASIDE as isize;
        if ends || (column as isize) < most || column as isize + most >= columns {
            return false;
        }
        for aside in -far..=far {
            let at = column as f32 + slant * aside as f32;
            let lower = at.floor();
            let share = at - lower;
            let row = strip.row(self.middle + aside);
            let one = f32::from(row[lower as usize]);
            let other = row.get(lower as usize + 1).copied().map_or(one, f32::from);
            self.rows[(aside + far) as usize] = one + share * (other - one);
        }
        true
    }

    /// Fits a ridge of this shape.
    fn fit(&self, shape: &Bell) -> Fit {
        let rows = &self.rows[..=2 * self.far];
        let count = rows.len() as f32;
        let [mut sum, mut square, mut product] = [0.0_f32; 3];
        for (value, bell) in rows.iter().zip(&shape.rows) {
            sum += value;
            square += value * value;
            product += bell * value;
        }
        let covariance = product - shape.sum * sum / count;
        let height = (covariance / shape.about_mean).max(0.0);
        let rest = square - sum * sum / count - height * covariance;
        Fit { height, rest: rest.max(0.0) / count }
    }
}

/// A ridge's shape over a reading's rows: the same for all directions.
struct Bell {
    rows: [f32; MOST_ROWS],
    sum: f32,
    /// Sum of squares about the mean.
    about_mean: f32,
}

impl Bell {
    /// Of this width at half of its height, `offset` rows below the middle of `far` rows to both sides.
    fn new(far: usize, width: f32, offset: f32) -> Self {
        let deviation = width.clamp(1.5, 18.0) / 2.355;
        let mut rows = [0.0; MOST_ROWS];
        let (mut sum, mut square) = (0.0_f32, 0.0_f32);
        let count = 2 * far + 1;
        for (index, bell) in rows.iter_mut().enumerate().take(count) {
            let distance = (index as f32 - far as f32 - offset) / deviation;
            *bell = (-0.5 * distance * distance).exp();
            sum += *bell;
            square += *bell * *bell;
        }
        Self { rows, sum, about_mean: (square - sum * sum / count as f32).max(1e-3) }
    }
}

/// The ground above and below a stripe of this width in one column.
pub fn grounds(strip: &Strip, column: usize, width: f32) -> [f32; 2] {
    let kernel = Kernel::for_width(width);
    let near = kernel.near.min(MOST_NEAR) as isize;
    let length = kernel.length().clamp(2, MOST_LENGTH) as isize;
    [-1, 1].map(|sign| {
        (near..near + length).map(|aside| strip.value(column, sign * aside)).sum::<f32>() / length as f32
    })
}

/// The ridge of a column, if there is one that is believed.
pub fn read(strip: &Strip, column: usize, expected: &Expected) -> Option<SlantedRidge> {
    let fraction = expected.offset - expected.offset.round();
    let mut reading = Reading::new(expected);
    let far = reading.far;
    let shape = Bell::new(far, expected.width, fraction);
    // The direction in which a stripe at its place explains most; a direction across the edge leaves a rest.
    let mut best: Option<(f32, f32)> = None;
    let mut try_slant = |slant: f32, best: &mut Option<(f32, f32)>| {
        if reading.read(strip, column, slant) {
            let fit = reading.fit(&shape);
            if best.is_none_or(|(least, _)| fit.rest < least) {
                *best = Some((fit.rest, slant));
            }
        }
    };
    for slant in SLANTS {
        try_slant(slant, &mut best);
    }
    let (_, mut slant) = best?;
    let mut step = (0.15 * slant.abs()).max(0.25);
    for _ in 0..REFINEMENTS {
        for next in [slant - step, slant + step] {
            try_slant(next, &mut best);
        }
        (slant, step) = (best?.1, step / 2.0);
    }
    reading.read(strip, column, slant).then_some(())?;
    let (mut offset, mut fit) = (0.0, reading.fit(&shape));
    for number in -STEPS..=STEPS {
        let other = f32::from(number) * STEP_ROWS;
        let there = reading.fit(&Bell::new(far, expected.width, fraction + other));
        if there.rest < fit.rest {
            (offset, fit) = (other, there);
        }
    }
    let sure = fit.height >= LEAST_OF_REST * fit.rest.sqrt();
    (sure && offset.abs() <= expected.tolerance.max(2.0 * STEP_ROWS))
        .then_some(SlantedRidge { height: fit.height, offset })
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: usize = 400;
    const MIDDLE: usize = 200;
    const EXPECTED: Expected = Expected { width: 3.0, offset: 0.0, tolerance: 1.5 };

    /// Paint of this strength below an edge that rises by one row in `columns_to_row` columns through the middle, and a
    /// stripe of this height at a row.
    fn strip(paint: f32, columns_to_row: f32, height: f32, at: f32) -> Strip {
        Strip::drawn(COLUMNS, |column, row| {
            let edge = (column as f32 - MIDDLE as f32) / columns_to_row;
            let step = 1.0 / (1.0 + (-1.4 * (row as f32 - edge)).exp());
            let deviation = EXPECTED.width / 2.355;
            let bell = (-0.5 * ((row as f32 - at) / deviation).powi(2)).exp();
            (5.0 + paint * step + height * bell).round() as i16
        })
    }

    #[test]
    fn along_the_edge_a_stripe_is_seen_that_the_step_hides_down_the_column() {
        for columns_to_row in [2.0, 5.0, -5.0, 10.0] {
            let ridge = read(&strip(160.0, columns_to_row, 60.0, 0.0), MIDDLE, &EXPECTED);
            let ridge = ridge.unwrap_or_else(|| panic!("{columns_to_row} columns to a row: none"));
            assert!((ridge.height - 60.0).abs() < 15.0, "{columns_to_row}: {ridge:?}");
            assert!(ridge.offset.abs() <= 0.5, "{columns_to_row}: {ridge:?}");
        }
    }

    #[test]
    fn an_edge_without_a_stripe_has_none() {
        for columns_to_row in [2.0, 5.0, -5.0, 10.0] {
            let ridge = read(&strip(160.0, columns_to_row, 0.0, 0.0), MIDDLE, &EXPECTED);
            assert!(ridge.is_none_or(|ridge| ridge.height < 10.0), "{columns_to_row}: {ridge:?}");
        }
    }

    #[test]
    fn a_stripe_farther_off_than_the_tolerance_is_not_the_floors() {
        for (at, seen) in [(1.0, true), (-1.0, true), (1.9, false), (-1.9, false)] {
            let ridge = read(&strip(0.0, 5.0, 60.0, at), MIDDLE, &EXPECTED);
            assert_eq!(ridge.is_some(), seen, "{at} rows off: {ridge:?}");
        }
    }

    #[test]
    fn where_the_strip_ends_nothing_is_read_across_its_end() {
        let strip = strip(160.0, 10.0, 60.0, 0.0);
        for column in [0, 1, COLUMNS - 1] {
            // Straight down there is no edge at these columns, and the stripe is seen; no direction may leave the strip.
            let ridge = read(&strip, column, &EXPECTED);
            assert!(ridge.is_none_or(|ridge| (ridge.height - 60.0).abs() < 15.0), "{column}: {ridge:?}");
        }
    }
}
