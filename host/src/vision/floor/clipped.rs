//! A stripe so bright that its core is at the end of the camera's scale.
//!
//! Beside paint or where two surfaces meet, the rims of such a core are unlike and its colour is washed out, so that
//! the red has no ridge. But the core itself is a narrow band of samples at the end of the scale, with darker ones on
//! both sides, and its middle is the stripe's.

use crate::vision::signal::Signal;

/// The core is at most so many times as wide as the stripe is elsewhere ...
const WIDEST_SHARE: f32 = 2.5;
/// ... with so many rows more for what the lens spreads of it.
const SPREAD_ROWS: f32 = 2.0;
/// Rows beyond the core that must be darker, and by how much, levels.
const ROWS_BESIDE: usize = 4;
const LEAST_FALL: i16 = 20;
/// The end of the scale, levels.
const FULL: i16 = 248;

/// Middle row of the clipped core that covers `row`, if it is a stripe's `width` rows wide.
pub fn core<S: Signal>(signal: S, column: usize, row: f32, width: f32) -> Option<f32> {
    let start = row.round().max(0.0) as usize;
    let is_clipped = |row: usize| row < signal.rows() && signal.is_clipped(column, row);
    // The expected row may be a row beside the core.
    let inside = [Some(start), start.checked_sub(1), Some(start + 1)]
        .into_iter()
        .flatten()
        .find(|row| is_clipped(*row))?;
    let longest = (WIDEST_SHARE * width + SPREAD_ROWS) as usize;
    let above = (1..=longest).take_while(|step| inside.checked_sub(*step).is_some_and(is_clipped)).count();
    let below = (1..=longest).take_while(|step| is_clipped(inside + step)).count();
    let (first, last) = (inside - above, inside + below);
    if last - first + 1 > longest {
        return None;
    }
    let falls = |rows: [Option<usize>; ROWS_BESIDE]| {
        rows.into_iter()
            .flatten()
            .any(|row| row < signal.rows() && signal.glow(column, row) <= FULL - LEAST_FALL)
    };
    let bound = falls(std::array::from_fn(|step| first.checked_sub(step + 1)))
        && falls(std::array::from_fn(|step| Some(last + step + 1)));
    bound.then_some((first + last) as f32 / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Plane;
    use crate::vision::signal::RedMinusGreen;

    /// One column, red from `level`, green half of it.
    fn middle(level: impl Fn(usize) -> u8, row: f32) -> Option<f32> {
        let bytes: Vec<u8> = (0..60).flat_map(|row| [level(row), level(row) / 2, 20]).collect();
        core(RedMinusGreen(Plane::new(&bytes, 3, 3, 60).unwrap()), 0, row, 4.0)
    }

    #[test]
    fn the_middle_of_a_clipped_band_between_unlike_sides_is_the_stripe() {
        let stripe = |row: usize| match row {
            28..=32 => 255,
            0..28 => 200,
            _ => 60,
        };
        assert_eq!(middle(stripe, 31.0), Some(30.0));
        assert_eq!(middle(stripe, 40.0), None, "elsewhere");
    }

    #[test]
    fn what_is_overexposed_for_long_is_no_stripe() {
        assert_eq!(middle(|_| 255, 30.0), None, "everywhere");
        assert_eq!(middle(|row| if row < 32 { 255 } else { 60 }, 30.0), None, "on one side");
        assert_eq!(middle(|row| if (20..40).contains(&row) { 255 } else { 60 }, 30.0), None, "a broad band");
    }
}
