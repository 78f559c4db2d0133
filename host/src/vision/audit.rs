//! The pixels themselves, for somebody who does not trust the extraction: a short window down a few columns, pooled,
//! in the one channel in which the laser shows best and nothing has been computed yet.

use std::ops::Range;

use crate::capture::{FrameView, Plane};

/// Pools the pixels of some image columns, row by row, into `samples`, beginning with image row `first_row`.
///
/// A sample is the mean over `columns` (rounded to the nearest, halves up) of the red channel of an RGB picture and of
/// Y of every other: plain camera values, 0 to 255. Rows outside the picture give 0; columns outside it do not take
/// part, and if none is inside all samples are 0.
///
/// ```
/// use nearfield_host::capture::{Frame, Pixels};
/// use nearfield_host::vision::audit::pooled_window;
/// use nearfield_shared::rig::ImageSize;
///
/// let frame = Frame::new(ImageSize { width: 2, height: 2 }, Pixels::Grey(vec![10, 20, 30, 50]))?;
/// let mut samples = [9; 4];
/// pooled_window(&frame.view(), 0..2, -1, &mut samples);
/// assert_eq!(samples, [0, 15, 40, 0]);
/// # Ok::<(), nearfield_host::capture::SizeMismatch>(())
/// ```
pub fn pooled_window<const SAMPLES: usize>(
    frame: &FrameView<'_>,
    columns: Range<u32>,
    first_row: i32,
    samples: &mut [u8; SAMPLES],
) {
    let (plane, pitch) = match frame {
        FrameView::Rgb(plane) => (plane, 3),
        FrameView::Grey(plane) => (plane, 1),
        FrameView::Yuv420 { luma, .. } | FrameView::Nv12 { luma, .. } => (luma, 1),
    };
    for (row, sample) in (i64::from(first_row)..).zip(samples) {
        *sample = usize::try_from(row).map_or(0, |row| pooled(plane, row, columns.clone(), pitch));
    }
}

/// Mean of every `pitch`-th byte of a row, for the columns that exist.
fn pooled(plane: &Plane<'_>, row: usize, columns: Range<u32>, pitch: usize) -> u8 {
    let pixels = plane.row(row).chunks_exact(pitch);
    let from = columns.start as usize;
    let wanted = (columns.end as usize).saturating_sub(from);
    let (sum, count) = pixels
        .skip(from)
        .take(wanted)
        .filter_map(<[u8]>::first)
        .fold((0_u64, 0_u64), |(sum, count), value| (sum + u64::from(*value), count + 1));
    // At most 255: a mean of bytes.
    ((2 * sum + count) / (2 * count.max(1))) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Frame, Pixels};
    use nearfield_shared::rig::ImageSize;

    const SIZE: ImageSize = ImageSize { width: 6, height: 4 };

    fn window(frame: &Frame, columns: Range<u32>, first_row: i32) -> [u8; 5] {
        let mut samples = [7; 5];
        pooled_window(&frame.view(), columns, first_row, &mut samples);
        samples
    }

    /// Every layout gives the camera's own values, whatever lies in its other channels.
    #[test]
    fn the_channel_is_red_or_y_without_any_processing() {
        let ramp = |i: u8| 10 * (i / 6) + i % 6;
        let rgb = (0..24).flat_map(|i| [ramp(i), 200, 13]).collect();
        let luma: Vec<u8> = (0..24).map(ramp).collect();
        let with_chroma = |chroma: u8| [luma.clone(), vec![chroma; 12]].concat();
        let layouts = [
            Pixels::Rgb(rgb),
            Pixels::Grey(luma.clone()),
            Pixels::Yuv420(with_chroma(99)),
            Pixels::Nv12(with_chroma(255)),
        ];
        for pixels in layouts {
            let frame = Frame::new(SIZE, pixels).unwrap();
            assert_eq!(window(&frame, 2..4, 0), [3, 13, 23, 33, 0], "mean of 2 and 3 is 2.5: up");
            assert_eq!(window(&frame, 5..6, 2), [25, 35, 0, 0, 0]);
        }
    }

    #[test]
    fn what_lies_outside_the_picture_is_dark_and_moves_no_mean() {
        let frame = Frame::new(SIZE, Pixels::Grey(vec![80; 24])).unwrap();
        assert_eq!(window(&frame, 0..1, -2), [0, 0, 80, 80, 80]);
        assert_eq!(window(&frame, 4..9, 0), [80, 80, 80, 80, 0], "columns that do not exist take no part");
        for (columns, row) in
            [(6..8, 0), (3..3, 0), (0..1, i32::MAX), (0..1, i32::MIN), (u32::MAX - 1..u32::MAX, 0)]
        {
            assert_eq!(window(&frame, columns.clone(), row), [0; 5], "{columns:?} from row {row}");
        }
        #[expect(clippy::reversed_empty_ranges, reason = "a caller's mistake must not panic")]
        let reversed = 5..2;
        assert_eq!(window(&frame, reversed, 0), [0; 5]);
    }
}
