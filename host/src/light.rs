//! The host's part of proving itself to the safety controller: how bright the stripe is, and the raw pixels that the
//! controller asks for. Both are the light signal of [`nearfield_shared::light`], read from the picture as it is.

use nearfield_shared::audit::first_row_for;
use nearfield_shared::columns::Decimation;
use nearfield_shared::light::{BRIGHTNESS_SCALE, BrightnessProfile, LIGHT_BLOCKS};
use nearfield_shared::limits::WEAKEST_SIGNAL;
use nearfield_shared::linescan::{AUDIT_PIXELS, AuditWindow, LARGEST_AUDIT_COUNT, LineScanColumn};
use nearfield_shared::status::Challenge;

use crate::capture::FrameView;

/// Rows above and below the stripe's at which its background is read.
const BACKGROUND_ROWS: i32 = 12;
/// Brightness from which a pixel counts as clipped.
const CLIPPED: u8 = 250;

/// What a line-scan tells besides rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LightReport {
    /// How bright the stripe is.
    pub brightness: BrightnessProfile,
    /// The pixels that the controller asked for.
    pub windows: Vec<AuditWindow>,
    /// Mean brightness beside the stripe.
    pub ambient: u8,
    /// Share of the columns whose stripe is clipped, 255 = all.
    pub saturated: u8,
}

impl LightReport {
    /// No light anywhere, nothing asked for.
    pub const DARK: Self =
        Self { brightness: BrightnessProfile::DARK, windows: Vec::new(), ambient: 0, saturated: 0 };

    /// Room for every window: measuring allocates nothing any more.
    #[must_use]
    pub fn new() -> Self {
        Self { windows: Vec::with_capacity(LARGEST_AUDIT_COUNT), ..Self::DARK }
    }

    /// Measures a picture, in place. `columns` is its line-scan; `floor_row` gives the row at which a column without
    /// stripe would see the floor.
    pub fn measure(
        &mut self,
        view: &FrameView<'_>,
        columns: &[LineScanColumn],
        decimation: Decimation,
        challenge: &Challenge,
        floor_row: impl Fn(usize) -> Option<f32>,
    ) {
        let width = usize::from(decimation.image_columns());
        self.measure_brightness(view, columns, width);
        self.windows.clear();
        let asked = challenge.columns.iter().take(usize::from(challenge.count));
        for column in asked {
            let index = usize::from(*column);
            let reported = columns.get(index).and_then(|column| column.row.to_pixels());
            let row = reported.or_else(|| floor_row(index)).unwrap_or(0.0);
            let first_row = first_row_for(row);
            let mut pixels = [0; AUDIT_PIXELS];
            for (row, pixel) in (i32::from(first_row)..).zip(&mut pixels) {
                *pixel = pooled(view, index * width, width, row);
            }
            self.windows.push(AuditWindow { column: *column, first_row, pixels });
        }
    }

    fn measure_brightness(&mut self, view: &FrameView<'_>, columns: &[LineScanColumn], width: usize) {
        let mut sums = [0_i64; LIGHT_BLOCKS];
        let mut counts = [0_i64; LIGHT_BLOCKS];
        let (mut ambient, mut clipped, mut seen) = (0_u64, 0_u64, 0_u64);
        for (index, column) in columns.iter().enumerate() {
            let Some(row) = column.row.to_pixels().filter(|_| column.quality >= WEAKEST_SIGNAL) else {
                continue;
            };
            let row = row.round() as i32;
            let first = index * width;
            let at = |row: i32| i64::from(pooled(view, first, width, row));
            let peak = at(row - 1) + at(row) + at(row + 1);
            let background = at(row - BACKGROUND_ROWS) + at(row + BACKGROUND_ROWS);
            let block = BrightnessProfile::block_of(index, columns.len());
            // Six times the peak over its background, so that nothing is divided yet.
            sums[block] += 2 * peak - 3 * background;
            counts[block] += 1;
            seen += 1;
            ambient += u64::from(brightness(view, first, row - BACKGROUND_ROWS))
                + u64::from(brightness(view, first, row + BACKGROUND_ROWS));
            clipped += u64::from(brightness(view, first, row) >= CLIPPED);
        }
        for ((block, sum), count) in self.brightness.blocks.iter_mut().zip(sums).zip(counts) {
            let scaled = i64::from(BRIGHTNESS_SCALE) * sum / (6 * count.max(1));
            *block = scaled.clamp(0, i64::from(u16::MAX)) as u16;
        }
        let share = |sum: u64, of: u64| sum.checked_div(of).unwrap_or(0).min(255) as u8;
        self.ambient = share(ambient, 2 * seen);
        self.saturated = share(255 * clipped, seen);
    }
}

impl Default for LightReport {
    fn default() -> Self {
        Self::new()
    }
}

/// The light signal of a row, mean over `width` image columns from `first` on; 0 outside the picture.
fn pooled(view: &FrameView<'_>, first: usize, width: usize, row: i32) -> u8 {
    let Ok(row) = usize::try_from(row) else { return 0 };
    let mean = |values: &mut dyn Iterator<Item = u8>| {
        let (sum, count) =
            values.fold((0_u32, 0_u32), |(sum, count), value| (sum + u32::from(value), count + 1));
        ((2 * sum + count) / (2 * count.max(1))) as u8
    };
    let span = first..first + width;
    match view {
        FrameView::Rgb(plane) => {
            let line = plane.row(row).get(3 * span.start..).unwrap_or(&[]);
            mean(
                &mut line
                    .chunks_exact(3)
                    .take(width)
                    .map(|pixel| red_difference([pixel[0], pixel[1], pixel[2]])),
            )
        }
        FrameView::Grey(plane) => mean(&mut plane.row(row).iter().skip(span.start).take(width).copied()),
        FrameView::Yuv420 { red, .. } => {
            let line = red.row(row / 2);
            mean(&mut span.filter_map(|column| line.get(column / 2).copied()))
        }
        FrameView::Nv12 { chroma, .. } => {
            let line = chroma.row(row / 2);
            mean(&mut span.filter_map(|column| line.get(column / 2 * 2 + 1).copied()))
        }
    }
}

/// Plain brightness of one pixel; 0 outside the picture.
fn brightness(view: &FrameView<'_>, column: usize, row: i32) -> u8 {
    let Ok(row) = usize::try_from(row) else { return 0 };
    let (plane, pitch) = match view {
        FrameView::Rgb(plane) => (plane, 3),
        FrameView::Grey(plane) => (plane, 1),
        FrameView::Yuv420 { luma, .. } | FrameView::Nv12 { luma, .. } => (luma, 1),
    };
    // Of an RGB picture the red channel: it is the one that clips.
    plane.row(row).get(pitch * column).copied().unwrap_or(0)
}

/// V of BT.601, full range: 0.5 R - 0.4187 G - 0.0813 B + 128, in 1/65536.
fn red_difference([red, green, blue]: [u8; 3]) -> u8 {
    let value =
        32_768 * i32::from(red) - 27_439 * i32::from(green) - 5_329 * i32::from(blue) + 128 * 65_536 + 32_768;
    (value >> 16).clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Frame, Pixels};
    use nearfield_shared::audit::{AuditVerdict, judge};
    use nearfield_shared::light::LightChange;
    use nearfield_shared::rig::ImageSize;
    use nearfield_shared::units::{SignalQuality, SubpixelRow};

    const SIZE: ImageSize = ImageSize { width: 128, height: 64 };
    const ROW: usize = 30;

    /// A red stripe of this strength on a grey floor, five rows wide.
    fn picture(strength: u8) -> Vec<u8> {
        let mut rgb = vec![90; 3 * 128 * 64];
        for row in ROW - 2..=ROW + 2 {
            for column in 0..128 {
                let fade = if row.abs_diff(ROW) == 2 { strength / 3 } else { strength };
                rgb[3 * (row * 128 + column)] = 90 + fade;
            }
        }
        rgb
    }

    fn columns(row: f32) -> Vec<LineScanColumn> {
        let row = SubpixelRow::from_pixels(row).unwrap();
        vec![LineScanColumn { row, quality: SignalQuality::BEST }; 128]
    }

    fn measured(frame: &Frame, columns: &[LineScanColumn]) -> LightReport {
        let mut report = LightReport::new();
        let challenge = Challenge { count: 8, columns: [0, 5, 17, 64, 99, 126, 127, 3] };
        let decimation = Decimation::for_line_scan(128);
        report.measure(&frame.view(), columns, decimation, &challenge, |_| Some(20.0));
        report
    }

    fn rgb(strength: u8) -> Frame {
        Frame::new(SIZE, Pixels::Rgb(picture(strength))).unwrap()
    }

    /// The same as planes; the picture is the same in every pair of columns and rows but the stripe's.
    fn yuv(strength: u8) -> Frame {
        let rgb = picture(strength);
        let luma = (0..64 * 128).map(|at| rgb[3 * at]).collect::<Vec<_>>();
        let v = (0..32 * 64).map(|at| {
            let (row, column) = (at / 64 * 2, at % 64 * 2);
            let at = 3 * (row * 128 + column);
            red_difference([rgb[at], rgb[at + 1], rgb[at + 2]])
        });
        let bytes = luma.into_iter().chain([128; 32 * 64]).chain(v).collect();
        Frame::new(SIZE, Pixels::Yuv420(bytes)).unwrap()
    }

    #[test]
    fn the_red_difference_is_bt_601s() {
        assert_eq!(red_difference([90, 90, 90]), 128);
        assert_eq!(red_difference([255, 0, 0]), 255);
        assert_eq!(red_difference([0, 255, 255]), 1, "128 - 127.5, rounded up");
        assert_eq!(red_difference([200, 100, 50]), (128.0 + 100.0 - 41.87 - 4.07_f64).round() as u8);
    }

    #[test]
    fn a_dimmed_stripe_is_dimmer_in_every_layout() {
        for frame in [rgb, yuv] {
            let (full, dimmed) =
                (measured(&frame(150), &columns(30.0)), measured(&frame(90), &columns(30.0)));
            assert_eq!(dimmed.brightness.change_since(&full.brightness), LightChange::Dimmer);
            assert_eq!(full.brightness.change_since(&dimmed.brightness), LightChange::Brighter);
            let same = measured(&frame(148), &columns(30.0));
            assert_eq!(same.brightness.change_since(&full.brightness), LightChange::Same);
        }
    }

    #[test]
    fn windows_bear_out_what_is_there_and_nothing_else() {
        for frame in [rgb(100), yuv(100)] {
            for (row, verdict) in [(30.0, AuditVerdict::Confirmed), (45.0, AuditVerdict::Contradicted)] {
                let columns = columns(row);
                let report = measured(&frame, &columns);
                assert_eq!(report.windows.len(), 8);
                for window in &report.windows {
                    assert_eq!(judge(window, columns[usize::from(window.column)]), verdict, "{row}");
                }
            }
        }
    }

    #[test]
    fn a_column_without_stripe_shows_the_floor_and_no_light() {
        let report = measured(&rgb(100), &[LineScanColumn::MISSING; 128]);
        assert_eq!(report.brightness, BrightnessProfile::DARK);
        assert!(report.windows.iter().all(|window| window.first_row == first_row_for(20.0)));
        assert_eq!((report.ambient, report.saturated), (0, 0));
    }

    #[test]
    fn surroundings_are_measured_beside_and_on_the_stripe() {
        let report = measured(&rgb(100), &columns(30.0));
        assert_eq!((report.ambient, report.saturated), (90, 0));
        assert_eq!(measured(&rgb(165), &columns(30.0)).saturated, 255);
        // The lower background lies outside the picture.
        assert_eq!(measured(&rgb(100), &columns(60.0)).ambient, 45);
    }
}
