//! The rims of overexposed things.
//!
//! Where a coloured thing is so bright that the camera's scale ends, it looks white, and its own colour shows only along its
//! outline: two ridges in red, one on each side. Neither is a stripe, although one of them may lie where the stripe is
//! expected. A stripe's own overexposed core has two such rims as well, but then the ridge is measured in their middle.

use crate::vision::grid::GridColumn;
use crate::vision::peak::Peak;
use crate::vision::signal::Signal;

/// A clipped run is looked for so far beyond the ridge, samples: the colour takes one or two to bleach.
const PROBE_ASIDE: f32 = 1.75;
/// A run of clipped samples is followed so far.
const LONGEST_RUN: usize = 64;
/// A ridge whose middle is so near that of the clipped run is the run's, samples.
const NEAR_MIDDLE: f32 = 1.0;
/// A stripe's own core is clipped over at most so many times its width.
const WIDEST_CORE: f32 = 2.5;
/// The far rim lies within so many samples of the run's end, and the ground within so many more.
const RIM_SAMPLES: usize = 3;
const GROUND_SAMPLES: usize = 5;
/// A ridge of which the far rim leaves less than this share is a rim itself.
const LEAST_LEFT: f32 = 0.35;

/// Is a ridge one rim of an overexposed thing, the other of which is about as high?
pub fn is_rim<S: Signal>(signal: S, column: usize, peak: &Peak, place: &GridColumn) -> bool {
    let aside = peak.width / 2.0 + PROBE_ASIDE;
    is_rim_of_run(signal, column, peak, place, false, peak.row - aside)
        || is_rim_of_run(signal, column, peak, place, true, peak.row + aside)
}

/// The same for the clipped run, if there is one, that covers the row `probe`, on the ridge's lower side or its upper.
fn is_rim_of_run<S: Signal>(
    signal: S,
    column: usize,
    peak: &Peak,
    place: &GridColumn,
    below: bool,
    probe: f32,
) -> bool {
    let probe = probe.round();
    if probe < 0.0 || probe as usize >= signal.rows() || !signal.is_clipped(column, probe as usize) {
        return false;
    }
    let probe = probe as usize;
    let is_clipped = |row: usize| row < signal.rows() && signal.is_clipped(column, row);
    let up = (1..LONGEST_RUN).take_while(|step| probe.checked_sub(*step).is_some_and(is_clipped)).count();
    let down = (1..LONGEST_RUN).take_while(|step| is_clipped(probe + step)).count();
    let (first, last) = (probe - up, probe + down);
    let middle = (first + last) as f32 / 2.0;
    let is_core = (middle - place.floor_row).abs() <= place.tolerance
        && (last - first + 1) as f32 <= WIDEST_CORE * place.width;
    if is_core || (middle - peak.row).abs() <= NEAR_MIDDLE {
        return false;
    }
    let end = if below { last } else { first };
    let value = |step: usize| {
        let row = if below { Some(end + step) } else { end.checked_sub(step) };
        row.filter(|row| *row < signal.rows()).map(|row| signal.value(column, row))
    };
    let Some(rim) = (0..=RIM_SAMPLES).filter_map(value).max() else { return false };
    let Some(ground) = (RIM_SAMPLES..=RIM_SAMPLES + GROUND_SAMPLES).filter_map(value).min() else {
        return false;
    };
    peak.contrast - f32::from(rim - ground) < LEAST_LEFT * peak.contrast
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Plane;
    use crate::vision::signal::RedMinusGreen;

    /// A column of red and green, and a ridge of 60 levels in it where the floor is expected.
    fn looks_like_a_rim(red: impl Fn(usize) -> u8, green: impl Fn(usize) -> u8, row: f32) -> bool {
        let bytes: Vec<u8> = (0..60).flat_map(|row| [red(row), green(row), 20]).collect();
        let peak = Peak { row, contrast: 60.0, rise: 60.0, width: 4.0 };
        let place = GridColumn {
            floor_row: row,
            nearest_row: row.round() as isize,
            place: 0.0,
            tolerance: 2.0,
            width: 3.5,
            first_row: 0,
            end_row: 60,
        };
        is_rim(RedMinusGreen(Plane::new(&bytes, 3, 3, 60).unwrap()), 0, &peak, &place)
    }

    /// Clipped in red from `first` to `end`, its colour seen only in the two rows at its ends.
    fn of_overexposed(first: usize, end: usize, row: f32) -> bool {
        let red = |row: usize| if (first..end).contains(&row) { 255 } else { 90 };
        let green = |row: usize| match row {
            row if !(first..end).contains(&row) => 90,
            row if row < first + 2 || row + 2 >= end => 190,
            _ => 240,
        };
        looks_like_a_rim(red, green, row)
    }

    #[test]
    fn both_outlines_of_an_overexposed_orange_thing_are_rims() {
        assert!(of_overexposed(18, 34, 18.5));
        assert!(of_overexposed(18, 34, 32.5));
        assert!(!of_overexposed(18, 34, 25.5), "the middle, as of a stripe's own core");
        assert!(!of_overexposed(18, 34, 45.0), "elsewhere");
    }

    #[test]
    fn the_rims_of_a_stripes_own_overexposed_core_are_none() {
        for row in [18.5, 20.5, 22.5] {
            assert!(!of_overexposed(17, 25, row), "row {row}: a core of 8 rows, at most 2.5 times 3.5");
        }
        assert!(of_overexposed(17, 27, 18.5), "10 rows are more");
    }

    #[test]
    fn a_stripe_beside_an_overexposed_patch_is_none() {
        let red = |row: usize| match row {
            20..24 => 160,
            24..40 => 255,
            _ => 90,
        };
        let green = |row: usize| if (24..40).contains(&row) { 255 } else { 90 };
        assert!(!looks_like_a_rim(red, green, 21.5));
    }
}
