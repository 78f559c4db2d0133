//! Looking for a ridge in a picture, with the kernel that explains it best.

use super::{Kernel, LONGEST_WINDOW, Peak, Ridge, fill_hollows};
use crate::vision::signal::Signal;

/// A core is only looked at for clipping where something around is as strong as this.
pub(super) const HOLLOW_STRENGTH: i16 = 30;
/// A ridge whose contrast is a smaller share of its rise may have a paint's edge close by.
const EVEN_SHARE: f32 = 0.5;
/// The refined kernel's sums vary so much more: the root of the ratio of the kernels' lengths.
const FINE_SHARE: f32 = 0.77;
/// A ridge whose contrast is a smaller share of its rise may be one rim of a wide, hollow one.
const RIM_SHARE: f32 = 0.2;
/// A wider kernel must find so much more contrast to be believed.
const WIDE_GAIN: f32 = 1.2;

/// A ridge with its crest within `reach` samples of `centre` in one column of a picture, its row within the picture.
///
/// A stripe may be too wide for the usual kernel (near the camera, or clipped), or the edge of a paint may run so close
/// to it that only a finer kernel fits between. So what looks wide or has unequal sides is measured again, and another
/// kernel is believed if it explains more. `refine` allows the finer one, which is for places where a stripe is expected:
/// texture has many fine ridges.
pub fn find<S: Signal>(signal: S, column: usize, centre: usize, reach: usize, refine: bool) -> Option<Peak> {
    let usual = find_with(signal, column, centre, reach, Kernel::for_step(S::STEP));
    improve(signal, column, centre, reach, refine, usual)
}

/// As [`find`] without refining, for places of which most show nothing: what rises by less than `least` over its lower
/// background is given up at once, unless it is so strong that its middle may be hollow.
pub fn find_above<S: Signal>(
    signal: S,
    column: usize,
    centre: usize,
    reach: usize,
    least: f32,
) -> Option<Peak> {
    let usual = find_with(signal, column, centre, reach, Kernel::for_step(S::STEP));
    let low = usual.is_none_or(|peak| peak.rise < least);
    if low && signal.value(column, centre) < HOLLOW_STRENGTH {
        return None;
    }
    improve(signal, column, centre, reach, false, usual)
}

/// Rows up to `reach` from `centre`, as far as picture and window go.
pub(super) fn window(centre: usize, reach: usize, rows: usize) -> std::ops::Range<usize> {
    let first = centre.saturating_sub(reach.min(LONGEST_WINDOW / 2));
    first..(centre + reach + 1).min(rows).min(first + LONGEST_WINDOW).max(first)
}

fn improve<S: Signal>(
    signal: S,
    column: usize,
    centre: usize,
    reach: usize,
    refine: bool,
    usual: Option<Peak>,
) -> Option<Peak> {
    let kernel = Kernel::for_step(S::STEP);
    let share = usual.map_or(0.0, |peak| peak.contrast / peak.rise);
    let fits = usual.is_some_and(|peak| peak.width <= kernel.widest() as f32);
    if fits && share >= EVEN_SHARE {
        return usual;
    }
    let stronger = |one: Option<Peak>, other: Option<Peak>, gain: f32| match (one, other) {
        (Some(one), Some(other)) if other.contrast <= gain * one.contrast => Some(one),
        (one, other) => other.or(one),
    };
    let mut best = usual;
    if refine {
        // The finer kernel's sums vary more, for which its contrast pays.
        let fine = find_with(signal, column, centre, reach, kernel.refined())
            .map(|peak| Peak { contrast: peak.contrast * FINE_SHARE, ..peak });
        best = stronger(usual, fine, 1.0);
    }
    if fits && share >= RIM_SHARE {
        return best;
    }
    stronger(best, find_with(signal, column, centre, reach, kernel.widened()), WIDE_GAIN)
}

fn find_with<S: Signal>(
    signal: S,
    column: usize,
    centre: usize,
    reach: usize,
    kernel: Kernel,
) -> Option<Peak> {
    let mut window = [0_i16; LONGEST_WINDOW];
    let (samples, first) = gather(signal, column, centre, kernel.reach() + reach, &mut window);
    let middle = centre - first;
    let peak = Ridge::new(samples, kernel).peak(middle.saturating_sub(reach)..middle + reach + 1)?;
    Some(Peak { row: peak.row + first as f32, ..peak })
}

/// The samples of a column up to `reach` rows from `centre`, as far as picture and window go, and the first's row.
fn gather<S: Signal>(
    signal: S,
    column: usize,
    centre: usize,
    reach: usize,
    window: &mut [i16; LONGEST_WINDOW],
) -> (&[i16], usize) {
    let rows = self::window(centre, reach, signal.rows());
    let first = rows.start;
    let samples = &mut window[..rows.len()];
    let mut strongest = 0;
    for (sample, row) in samples.iter_mut().zip(rows) {
        *sample = signal.value(column, row);
        strongest = strongest.max(*sample);
    }
    if strongest >= HOLLOW_STRENGTH {
        // A hollow has rims; what lies beyond them needs no look.
        let is_rim = |sample: &i16| *sample >= HOLLOW_STRENGTH;
        let from = samples.iter().position(is_rim).unwrap_or(0);
        let to = samples.iter().rposition(is_rim).map_or(0, |last| last + 1);
        fill_hollows(&mut samples[from..to], |position| signal.is_clipped(column, first + from + position));
    }
    (samples, first)
}
