//! Do raw pixels bear out the row that the host reports? The controller looks for the stripe itself.
//!
//! A window holds [`AUDIT_PIXELS`] rows of [the light signal](crate::light), pooled over the image columns of one
//! line-scan column. Over the straight line between its two ends' means (texture and lighting), a stripe is a hill. A
//! report is borne out if a hill's centre of gravity lies within [`AUDIT_TOLERANCE_ROWS`] of it, and that hill is no
//! dwarf beside the window's highest. Whether there is a second hill (a reflection, paint) is not the question.

use crate::limits::{AUDIT_TOLERANCE_ROWS, WEAKEST_SIGNAL};
use crate::linescan::{AUDIT_PIXELS, AuditWindow, LineScanColumn};

/// What a window says about a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AuditVerdict {
    /// The pixels show a stripe there.
    Confirmed,
    /// They do not, or the window does not show the reported row.
    Contradicted,
    /// The host reports no stripe that anything could rest on.
    NothingClaimed,
}

/// Rows at each end of a window whose mean is the background.
const BACKGROUND_ROWS: usize = 5;
/// A report must lie this many rows within the window, so that the hill around it is whole.
const MARGIN_ROWS: f32 = 6.0;
/// Rows on both sides of the report's row that the centre of gravity is taken over.
const HILL_ROWS: usize = 5;
/// The lowest hill that counts, steps of the light signal. Reason: three times the noise of two pooled pixels (0.9).
const LEAST_HILL: f32 = 3.0;
/// A hill below this share of the window's highest is a dwarf: a reflection, or nothing.
const LEAST_SHARE: f32 = 0.25;

/// The row on which the host should centre a window for a report.
#[must_use]
pub fn first_row_for(row: f32) -> u16 {
    let half = f32::from(u16::try_from(AUDIT_PIXELS / 2).unwrap_or(0));
    num_traits::ToPrimitive::to_u16(&(row - half + 0.5)).unwrap_or(0)
}

/// Judges one window against the report for its column.
#[must_use]
pub fn judge(window: &AuditWindow, column: LineScanColumn) -> AuditVerdict {
    let Some(row) = column.row.to_pixels().filter(|_| column.quality >= WEAKEST_SIGNAL) else {
        return AuditVerdict::NothingClaimed;
    };
    let place = row - f32::from(window.first_row);
    let last = f32::from(u16::try_from(AUDIT_PIXELS).unwrap_or(0)) - 1.0;
    if place < MARGIN_ROWS || place > last - MARGIN_ROWS {
        return AuditVerdict::Contradicted;
    }
    match centre_near(&window.pixels, place) {
        Some(centre) if (centre - place).abs() <= AUDIT_TOLERANCE_ROWS => AuditVerdict::Confirmed,
        Some(_) | None => AuditVerdict::Contradicted,
    }
}

/// The window's background as a straight line: its first row and its rise per row.
struct Background {
    first: f32,
    rise: f32,
}

impl Background {
    fn of(pixels: &[u8; AUDIT_PIXELS]) -> Self {
        let sum = |values: &[u8]| values.iter().fold(0.0_f32, |sum, value| sum + f32::from(*value));
        const ROWS: f32 = 5.0;
        const _: () = assert!(BACKGROUND_ROWS == 5);
        let head = pixels.first_chunk::<BACKGROUND_ROWS>().map_or(0.0, |rows| sum(rows)) / ROWS;
        let tail = pixels.last_chunk::<BACKGROUND_ROWS>().map_or(0.0, |rows| sum(rows)) / ROWS;
        // The means stand for the rows 2 and 29: 27 rows apart.
        const APART: f32 = 27.0;
        const _: () = assert!(AUDIT_PIXELS - BACKGROUND_ROWS == 27);
        let rise = (tail - head) / APART;
        Self { first: head - 2.0 * rise, rise }
    }
}

/// Centre of gravity of the hill around `place`; `None` if there is none worth the name.
fn centre_near(pixels: &[u8; AUDIT_PIXELS], place: f32) -> Option<f32> {
    let background = Background::of(pixels);
    let (mut highest, mut peak) = (0.0_f32, 0.0_f32);
    let (mut weight, mut moment) = (0.0_f32, 0.0_f32);
    let mut row = 0.0_f32;
    const REACH: f32 = 5.5;
    const _: () = assert!(HILL_ROWS == 5);
    for pixel in pixels {
        let over = (f32::from(*pixel) - (background.first + background.rise * row)).max(0.0);
        highest = highest.max(over);
        if (row - place).abs() <= REACH {
            peak = peak.max(over);
            // Squared: the hill's own light decides, not the noise at its foot.
            weight += over * over;
            moment += over * over * row;
        }
        row += 1.0;
    }
    (peak >= LEAST_HILL && peak >= LEAST_SHARE * highest).then_some(moment / weight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{SignalQuality, SubpixelRow};
    use proptest::prelude::*;

    const FIRST_ROW: u16 = 400;

    /// A hill of this height around each of these rows of the window, over a slope.
    fn window(hills: &[(f32, f32)], rise: f32) -> AuditWindow {
        let mut pixels = [0; AUDIT_PIXELS];
        for (row, pixel) in pixels.iter_mut().enumerate() {
            let light: f32 = hills
                .iter()
                .map(|(at, height)| height * (-((row as f32 - at) / 2.0).powi(2) / 2.0).exp())
                .sum();
            *pixel = (120.0 + rise * row as f32 + light + 0.5) as u8;
        }
        AuditWindow { column: 7, first_row: FIRST_ROW, pixels }
    }

    fn claim(row: f32) -> LineScanColumn {
        let row = SubpixelRow::from_pixels(f32::from(FIRST_ROW) + row).unwrap();
        LineScanColumn { row, quality: WEAKEST_SIGNAL }
    }

    #[test]
    fn a_stripe_where_it_is_reported_bears_the_report_out() {
        for rise in [-1.0, 0.0, 1.0] {
            for at in [7.0, 12.3, 16.0, 24.0] {
                let window = window(&[(at, 40.0)], rise);
                assert_eq!(judge(&window, claim(at)), AuditVerdict::Confirmed, "{at} {rise}");
            }
        }
    }

    #[test]
    fn a_report_may_be_off_by_the_tolerance_and_no_more() {
        let window = window(&[(16.0, 60.0)], 0.0);
        for side in [-1.0, 1.0] {
            let at = |rows: f32| judge(&window, claim(16.0 + side * rows));
            assert_eq!(at(AUDIT_TOLERANCE_ROWS - 0.2), AuditVerdict::Confirmed);
            assert_eq!(at(AUDIT_TOLERANCE_ROWS + 0.5), AuditVerdict::Contradicted);
        }
    }

    #[test]
    fn an_invented_stripe_is_contradicted() {
        assert_eq!(judge(&window(&[], 0.0), claim(16.0)), AuditVerdict::Contradicted, "bare floor");
        assert_eq!(
            judge(&window(&[(26.0, 60.0)], 0.0), claim(10.0)),
            AuditVerdict::Contradicted,
            "elsewhere"
        );
        assert_eq!(judge(&window(&[], 2.0), claim(16.0)), AuditVerdict::Contradicted, "a slope is no stripe");
    }

    #[test]
    fn the_lowest_hill_counts_from_its_limit() {
        let with = |height: u8| {
            let mut pixels = [100; AUDIT_PIXELS];
            pixels[16] += height;
            judge(&AuditWindow { column: 0, first_row: FIRST_ROW, pixels }, claim(16.0))
        };
        assert_eq!(with(2), AuditVerdict::Contradicted);
        assert_eq!(with(3), AuditVerdict::Confirmed);
        assert_eq!(with(4), AuditVerdict::Confirmed);
    }

    #[test]
    fn a_dwarf_beside_a_giant_is_no_stripe() {
        let with = |height: u8| {
            let mut pixels = [100; AUDIT_PIXELS];
            pixels[8] += height;
            pixels[20] += 100;
            judge(&AuditWindow { column: 0, first_row: FIRST_ROW, pixels }, claim(8.0))
        };
        assert_eq!(with(24), AuditVerdict::Contradicted);
        assert_eq!(with(25), AuditVerdict::Confirmed);
        assert_eq!(with(26), AuditVerdict::Confirmed);
    }

    #[test]
    fn the_report_must_lie_well_within_the_window() {
        let hill = |at: f32| judge(&window(&[(at, 60.0)], 0.0), claim(at));
        assert_eq!(hill(MARGIN_ROWS - 0.0625), AuditVerdict::Contradicted);
        assert_eq!(hill(MARGIN_ROWS + 0.5), AuditVerdict::Confirmed);
        assert_eq!(hill(25.0 - 0.5), AuditVerdict::Confirmed);
        assert_eq!(hill(25.0 + 0.0625), AuditVerdict::Contradicted);
    }

    #[test]
    fn what_is_not_claimed_is_not_judged() {
        let window = window(&[], 0.0);
        assert_eq!(judge(&window, LineScanColumn::MISSING), AuditVerdict::NothingClaimed);
        let weak = SignalQuality::new(WEAKEST_SIGNAL.get() - 1);
        let weak = LineScanColumn { quality: weak, ..claim(16.0) };
        assert_eq!(judge(&window, weak), AuditVerdict::NothingClaimed);
        assert_eq!(judge(&window, claim(16.0)), AuditVerdict::Contradicted);
    }

    #[test]
    fn a_window_is_centred_on_its_row() {
        assert_eq!([15.9, 16.0, 16.6, 100.0, -5.0].map(first_row_for), [0, 0, 1, 84, 0]);
    }

    proptest! {
        /// Whatever the pixels, no panic, and a claim outside the window is never borne out.
        #[test]
        fn any_pixels_are_judged(pixels in any::<[u8; 32]>(), row in 0.0_f32..4095.0, first_row in any::<u16>()) {
            let column = LineScanColumn { row: SubpixelRow::from_pixels(row).unwrap(), quality: SignalQuality::BEST };
            let verdict = judge(&AuditWindow { column: 0, first_row, pixels }, column);
            let place = column.row.to_pixels().unwrap() - f32::from(first_row);
            if !(6.0..=25.0).contains(&place) {
                prop_assert_eq!(verdict, AuditVerdict::Contradicted);
            }
        }
    }

    /// The window's margin itself still counts as well within.
    #[test]
    fn a_report_on_the_margin_is_judged() {
        for at in [MARGIN_ROWS, 25.0] {
            assert_eq!(judge(&window(&[(at, 60.0)], 0.0), claim(at)), AuditVerdict::Confirmed, "{at}");
        }
    }

    /// The background is taken away where it is, not where it would be if it fell instead of rising.
    #[test]
    fn a_low_hill_on_a_steep_slope_is_seen() {
        for rise in [-3.0, 3.0] {
            let window = window(&[(16.0, 12.0)], rise);
            assert_eq!(judge(&window, claim(16.0)), AuditVerdict::Confirmed, "{rise}");
        }
    }
}
