//! A finished camera picture, and its way into the layouts that the vision part takes.

use nearfield_shared::rig::ImageSize;
use rayon::prelude::*;

use crate::capture::{Frame, Pixels, SizeMismatch};

/// 8-bit colour picture, row by row, red green blue (sRGB).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `3 * width * height` bytes.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// All black.
    #[must_use]
    pub fn black(width: usize, height: usize) -> Self {
        Self { width, height, rgb: vec![0; 3 * width * height] }
    }

    /// Red, green, blue of a pixel.
    #[must_use]
    pub fn at(&self, column: usize, row: usize) -> [u8; 3] {
        let start = 3 * (row * self.width + column);
        [self.rgb[start], self.rgb[start + 1], self.rgb[start + 2]]
    }

    /// As a frame of interleaved colours.
    ///
    /// # Errors
    /// A size that a frame cannot have.
    pub fn to_rgb_frame(&self) -> Result<Frame, SizeMismatch> {
        Frame::new(self.size(), Pixels::Rgb(self.rgb.clone()))
    }

    /// As a frame of luma and chroma planes, what the camera's processor gives: BT.601 full range, each chroma sample
    /// the mean of its 2x2 pixels.
    ///
    /// # Errors
    /// An odd width or height.
    pub fn to_yuv420_frame(&self) -> Result<Frame, SizeMismatch> {
        let (width, height) = (self.width, self.height);
        let area = width * height;
        if width % 2 != 0 || height % 2 != 0 {
            return Frame::new(self.size(), Pixels::Yuv420(Vec::new()));
        }
        let mut bytes = vec![0; area / 2 * 3];
        let (luma, chroma) = bytes.split_at_mut(area);
        let (blue, red) = chroma.split_at_mut(area / 4);
        let pairs = luma.par_chunks_mut(2 * width).zip(self.rgb.par_chunks(6 * width));
        let halves = blue.par_chunks_mut(width / 2).zip(red.par_chunks_mut(width / 2));
        pairs.zip(halves).for_each(|((luma, rgb), (blue, red))| two_rows(rgb, luma, blue, red));
        Frame::new(self.size(), Pixels::Yuv420(bytes))
    }

    fn size(&self) -> ImageSize {
        let narrow = |length: usize| u16::try_from(length).unwrap_or(u16::MAX);
        ImageSize { width: narrow(self.width), height: narrow(self.height) }
    }
}

/// BT.601's weights in 1/65536, rounded so that each row sums to 65536 (luma) or 0 (chroma).
const LUMA: [i32; 3] = [19_595, 38_470, 7_471];
const BLUE: [i32; 3] = [-11_058, -21_710, 32_768];
const RED: [i32; 3] = [32_768, -27_439, -5_329];
const HALF: i32 = 1 << 15;

fn two_rows(rgb: &[u8], luma: &mut [u8], blue: &mut [u8], red: &mut [u8]) {
    for (value, pixel) in luma.iter_mut().zip(rgb.chunks_exact(3)) {
        *value = ((weigh(LUMA, [pixel[0], pixel[1], pixel[2]].map(i32::from)) + HALF) >> 16) as u8;
    }
    let (upper, lower) = rgb.split_at(rgb.len() / 2);
    let blocks = upper.chunks_exact(6).zip(lower.chunks_exact(6));
    for ((blue, red), (above, below)) in blue.iter_mut().zip(red).zip(blocks) {
        let sum: [i32; 3] = std::array::from_fn(|channel| {
            [above[channel], above[channel + 3], below[channel], below[channel + 3]]
                .map(i32::from)
                .iter()
                .sum()
        });
        // Sums of four pixels: two bits more to shift away.
        *blue = (128 + ((weigh(BLUE, sum) + 4 * HALF) >> 18)).clamp(0, 255) as u8;
        *red = (128 + ((weigh(RED, sum) + 4 * HALF) >> 18)).clamp(0, 255) as u8;
    }
}

fn weigh(weights: [i32; 3], values: [i32; 3]) -> i32 {
    weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_those_of_the_capture_modules_own_conversion() {
        let mut picture = Picture::black(34, 12);
        let mut dice = crate::twin::random::Dice::new(9);
        picture.rgb.iter_mut().for_each(|byte| *byte = dice.word() as u8);
        let fast = picture.to_yuv420_frame().unwrap();
        let exact = picture.to_rgb_frame().unwrap().to_yuv420();
        let bytes = |frame: &Frame| match frame.pixels() {
            Pixels::Yuv420(bytes) => bytes.clone(),
            other => panic!("{other:?}"),
        };
        for (index, (one, other)) in bytes(&fast).into_iter().zip(bytes(&exact)).enumerate() {
            assert!(one.abs_diff(other) <= 1, "byte {index}: {one} and {other}");
        }
    }

    #[test]
    fn odd_sizes_are_refused_by_name() {
        let error = Picture::black(5, 4).to_yuv420_frame().unwrap_err();
        assert_eq!(error, SizeMismatch::Odd { width: 5, height: 4 });
    }
}
