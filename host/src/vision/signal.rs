//! How much a pixel looks like the laser: the one number per pixel that the extraction works on.
//!
//! The laser is red, floors are grey, brown, green, sometimes red. Red minus green is what the stripe changes most and
//! what lighting, shadows and texture change least: on the rendered pictures it gives five to ten times the
//! stripe-to-background ratio of brightness, and two times that of red minus the larger of green and blue. In YUV the
//! V plane carries the same at half the resolution; a monochrome camera (behind the laser's band-pass) has brightness
//! only. All are scaled so that a fully saturated stripe on black is about 255.

use crate::capture::Plane;

/// Bits of a seed key that hold the row within its segment.
pub const SEGMENT_BITS: u32 = 4;
/// Rows of a segment.
pub const SEGMENT_ROWS: usize = 1 << SEGMENT_BITS;

/// A picture as laser strength. Samples are pixels, or 2 x 2 pixels where only chroma tells.
pub trait Signal: Copy {
    /// Image pixels per sample, in both directions.
    const STEP: usize;

    /// Samples in a row.
    fn columns(&self) -> usize;

    /// Rows of samples.
    fn rows(&self) -> usize;

    /// Laser strength of one sample within the picture, about -255 to 255; zero beyond its last row.
    fn value(&self, column: usize, row: usize) -> i16;

    /// Brightness of one sample in light that is not the laser's, 0 to 255; zero beyond the picture, and where the
    /// layout cannot tell.
    fn tone(&self, column: usize, row: usize) -> i16;

    /// Has the laser's colour reached the end of its scale in one sample? Its strength is then too low: the brighter the
    /// core of a stripe, the whiter it looks.
    fn is_clipped(&self, column: usize, row: usize) -> bool;

    /// Brightness of one sample in the laser's own colour, 0 to 255; zero beyond the picture. The laser adds light, so it
    /// rises here; red pigment only takes other colours away.
    fn glow(&self, column: usize, row: usize) -> i16;
}

/// A signal that can be searched row by row, as it lies in memory.
pub trait RowSearch: Signal {
    /// For the columns from `first` on, one for each of `keys`: raises `key` to `strength << SEGMENT_BITS | tag`,
    /// strength being coarse (8 bits, monotonic in [`Signal::value`]). A row-by-row maximum over many rows costs one
    /// pass at the speed of memory.
    fn raise(&self, row: usize, first: usize, tag: u16, keys: &mut [u16]);

    /// [`Signal::value`] of the columns from `first` on, one for each of `values`; those beyond the picture stay.
    fn copy(&self, row: usize, first: usize, values: &mut [i16]);
}

/// A picture turned by its diagonal: its rows are the columns. For stripes that run down the picture.
#[derive(Debug, Clone, Copy)]
pub struct Transposed<S>(pub S);

impl<S: Signal> Signal for Transposed<S> {
    const STEP: usize = S::STEP;

    fn columns(&self) -> usize {
        self.0.rows()
    }

    fn rows(&self) -> usize {
        self.0.columns()
    }

    fn value(&self, column: usize, row: usize) -> i16 {
        self.0.value(row, column)
    }

    fn tone(&self, column: usize, row: usize) -> i16 {
        self.0.tone(row, column)
    }

    fn is_clipped(&self, column: usize, row: usize) -> bool {
        self.0.is_clipped(row, column)
    }

    fn glow(&self, column: usize, row: usize) -> i16 {
        self.0.glow(row, column)
    }
}

/// From here on a channel counts as clipped: noise reduction and JPEG move 255 by a few steps.
const CLIPPED: i16 = 248;

#[inline(always)]
fn raise_key(key: &mut u16, strength: u8, tag: u16) {
    *key = (*key).max(u16::from(strength) << SEGMENT_BITS | tag);
}

/// Red minus green of interleaved RGB.
#[derive(Debug, Clone, Copy)]
pub struct RedMinusGreen<'a>(pub Plane<'a>);

impl Signal for RedMinusGreen<'_> {
    const STEP: usize = 1;

    fn columns(&self) -> usize {
        self.0.width() / 3
    }

    fn rows(&self) -> usize {
        self.0.height()
    }

    #[inline]
    fn value(&self, column: usize, row: usize) -> i16 {
        let start = row * self.0.stride() + 3 * column;
        match self.0.bytes().get(start..start + 2) {
            Some([red, green]) => i16::from(*red) - i16::from(*green),
            _ => 0,
        }
    }

    fn tone(&self, column: usize, row: usize) -> i16 {
        self.0.row(row).get(3 * column + 1).copied().map_or(0, i16::from)
    }

    fn is_clipped(&self, column: usize, row: usize) -> bool {
        self.0.row(row).get(3 * column).is_some_and(|red| i16::from(*red) >= CLIPPED)
    }

    fn glow(&self, column: usize, row: usize) -> i16 {
        self.0.row(row).get(3 * column).copied().map_or(0, i16::from)
    }
}

impl RowSearch for RedMinusGreen<'_> {
    #[inline(always)]
    fn raise(&self, row: usize, first: usize, tag: u16, keys: &mut [u16]) {
        let pixels = self.0.row(row).get(3 * first..).unwrap_or(&[]);
        for (pixel, key) in pixels.chunks_exact(3).zip(keys) {
            // (red - green + 255) / 2 without leaving 8 bits: the average of red and not-green.
            let strength = (u16::from(pixel[0]) + u16::from(!pixel[1])).div_ceil(2) as u8;
            raise_key(key, strength, tag);
        }
    }

    #[inline(always)]
    fn copy(&self, row: usize, first: usize, values: &mut [i16]) {
        let pixels = self.0.row(row).get(3 * first..).unwrap_or(&[]);
        for (pixel, value) in pixels.chunks_exact(3).zip(values) {
            *value = i16::from(pixel[0]) - i16::from(pixel[1]);
        }
    }
}

/// Brightness of a monochrome picture.
#[derive(Debug, Clone, Copy)]
pub struct Brightness<'a>(pub Plane<'a>);

impl Signal for Brightness<'_> {
    const STEP: usize = 1;

    fn columns(&self) -> usize {
        self.0.width()
    }

    fn rows(&self) -> usize {
        self.0.height()
    }

    #[inline]
    fn value(&self, column: usize, row: usize) -> i16 {
        self.0.bytes().get(row * self.0.stride() + column).copied().map_or(0, i16::from)
    }

    fn tone(&self, _column: usize, _row: usize) -> i16 {
        0
    }

    /// Brightness that is clipped is highest all the same.
    fn is_clipped(&self, _column: usize, _row: usize) -> bool {
        false
    }

    fn glow(&self, column: usize, row: usize) -> i16 {
        self.0.row(row).get(column).copied().map_or(0, i16::from)
    }
}

impl RowSearch for Brightness<'_> {
    #[inline(always)]
    fn raise(&self, row: usize, first: usize, tag: u16, keys: &mut [u16]) {
        for (strength, key) in self.0.row(row).get(first..).unwrap_or(&[]).iter().zip(keys) {
            raise_key(key, *strength, tag);
        }
    }

    #[inline(always)]
    fn copy(&self, row: usize, first: usize, values: &mut [i16]) {
        for (strength, value) in self.0.row(row).get(first..).unwrap_or(&[]).iter().zip(values) {
            *value = i16::from(*strength);
        }
    }
}

/// The V (Cr) plane of YUV420, `PITCH` bytes from one sample to the next, the first at `OFFSET`: 1, 0 for a plane of
/// its own, 2, 1 for V after U (NV12).
#[derive(Debug, Clone, Copy)]
pub struct RedChroma<'a, const PITCH: usize, const OFFSET: usize> {
    /// The plane that holds V.
    pub red: Plane<'a>,
    /// Y.
    pub luma: Plane<'a>,
}

impl<const PITCH: usize, const OFFSET: usize> Signal for RedChroma<'_, PITCH, OFFSET> {
    const STEP: usize = 2;

    fn columns(&self) -> usize {
        self.red.width() / PITCH
    }

    fn rows(&self) -> usize {
        self.red.height()
    }

    #[inline]
    fn value(&self, column: usize, row: usize) -> i16 {
        // V spans half of what red minus green spans.
        let at = row * self.red.stride() + PITCH * column + OFFSET;
        self.red.bytes().get(at).map_or(0, |red| 2 * (i16::from(*red) - 128))
    }

    fn tone(&self, column: usize, row: usize) -> i16 {
        let sample = self.red.row(row).get(PITCH * column + OFFSET);
        let pair = |row: usize| match self.luma.row(row).get(2 * column..2 * column + 2) {
            Some([one, other]) => Some(i16::from(*one) + i16::from(*other)),
            _ => None,
        };
        // The four that the chroma sample lies in the middle of: one of them alone is half a pixel off.
        let (Some(red), Some(upper), Some(lower)) = (sample, pair(2 * row), pair(2 * row + 1)) else {
            return 0;
        };
        // Green without the (small) share of U.
        (upper + lower + 2) / 4 - (i16::from(*red) - 128) * 5 / 7
    }

    #[inline]
    fn is_clipped(&self, column: usize, row: usize) -> bool {
        if row >= self.rows() {
            return false;
        }
        let sample = self.red.bytes().get(row * self.red.stride() + PITCH * column + OFFSET);
        let luma = self.luma.bytes().get(2 * row * self.luma.stride() + 2 * column);
        let (Some(red), Some(luma)) = (sample, luma) else { return false };
        i16::from(*luma) + (i16::from(*red) - 128) * 7 / 5 >= CLIPPED
    }

    fn glow(&self, column: usize, row: usize) -> i16 {
        let sample = self.red.row(row).get(PITCH * column + OFFSET);
        let (Some(red), Some(luma)) = (sample, self.luma.row(2 * row).get(2 * column)) else { return 0 };
        (i16::from(*luma) + (i16::from(*red) - 128) * 7 / 5).clamp(0, 255)
    }
}

impl<const PITCH: usize, const OFFSET: usize> RowSearch for RedChroma<'_, PITCH, OFFSET> {
    #[inline(always)]
    fn raise(&self, row: usize, first: usize, tag: u16, keys: &mut [u16]) {
        let samples = self.red.row(row).get(PITCH * first..).unwrap_or(&[]);
        for (sample, key) in samples.chunks_exact(PITCH).zip(keys) {
            raise_key(key, sample[OFFSET], tag);
        }
    }

    #[inline(always)]
    fn copy(&self, row: usize, first: usize, values: &mut [i16]) {
        let samples = self.red.row(row).get(PITCH * first..).unwrap_or(&[]);
        for (sample, value) in samples.chunks_exact(PITCH).zip(values) {
            *value = 2 * (i16::from(sample[OFFSET]) - 128);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Frame, FrameView, Pixels};
    use nearfield_shared::rig::ImageSize;

    fn check<S: RowSearch>(signal: S, stripe: i16, ground: i16) {
        let (column, row) = (6 / S::STEP, 4 / S::STEP);
        assert!((signal.value(column, row) - stripe).abs() <= 3, "{}", signal.value(column, row));
        assert!((signal.value(column, 0) - ground).abs() <= 3, "{}", signal.value(column, 0));
        assert_eq!(signal.value(0, 99), 0);
        let mut keys = vec![0_u16; signal.columns() - column];
        for row in 0..signal.rows() {
            signal.raise(row, column, row as u16, &mut keys);
        }
        for key in keys {
            assert_eq!(usize::from(key & 15) / (2 / S::STEP), 4 / 2, "the strongest row of the column");
        }
    }

    /// Whatever the layout, the stripe has the same strength and the search finds its row.
    #[test]
    fn every_layout_tells_the_stripe_from_the_ground() {
        let size = ImageSize { width: 8, height: 8 };
        let rgb: Vec<u8> = (0..64)
            .flat_map(|i| if (4..6).contains(&(i / 8)) { [255, 15, 90] } else { [90, 90, 90] })
            .collect();
        let frame = Frame::new(size, Pixels::Rgb(rgb)).unwrap();
        let FrameView::Rgb(plane) = frame.view() else { unreachable!() };
        check(RedMinusGreen(plane), 240, 0);
        let (planar, interleaved) = (frame.to_yuv420(), frame.to_nv12());
        let FrameView::Yuv420 { luma, red, .. } = planar.view() else { unreachable!() };
        check(RedChroma::<1, 0> { red, luma }, 228, 0);
        let FrameView::Nv12 { luma, chroma } = interleaved.view() else { unreachable!() };
        check(RedChroma::<2, 1> { red: chroma, luma }, 228, 0);
        let grey: Vec<u8> = (0..64).map(|i| if (4..6).contains(&(i / 8)) { 200 } else { 90 }).collect();
        let grey = Frame::new(size, Pixels::Grey(grey)).unwrap();
        let FrameView::Grey(plane) = grey.view() else { unreachable!() };
        check(Brightness(plane), 200, 90);
    }
}
