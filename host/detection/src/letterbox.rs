//! A piece of a picture, fitted into the network's square input, and boxes on their way back.
//!
//! Resizing is bilinear with a support that grows when it shrinks (as Pillow's BILINEAR), so that thin things do not
//! vanish between the samples; training shrinks pictures in the same way. What is left over is filled with grey.

use fast_image_resize::images::{Image, ImageRef};
use fast_image_resize::{FilterType, PixelType, ResizeAlg, ResizeOptions, Resizer};

use crate::boxes::BoundingBox;
use crate::detector::{Picture, Unknown};

/// Grey level of the filling, as in training.
pub const FILLING: u8 = 114;

/// A rectangle of a picture, in whole pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub left: u32,
    /// First row.
    pub top: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// How a window lies in the square input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// The window.
    pub window: Window,
    /// Columns and rows that the shrunk window has, pixels of the input.
    pub fitted: (u32, u32),
    /// Filling to the left of and above it, pixels of the input.
    pub margin: (u32, u32),
}

impl Placement {
    /// Fits a window into a square of `side` pixels: as large as it will go, in the middle, undistorted.
    #[must_use]
    pub fn new(window: Window, side: u32) -> Self {
        let longer = window.width.max(window.height).max(1);
        let fit = |length: u32| {
            let fitted = (f64::from(length) * f64::from(side) / f64::from(longer)).round() as u32;
            fitted.clamp(1, side)
        };
        let fitted = (fit(window.width), fit(window.height));
        Self { window, fitted, margin: ((side - fitted.0) / 2, (side - fitted.1) / 2) }
    }

    /// A box of the input, in pixels of the picture.
    #[must_use]
    pub fn to_picture(&self, place: &BoundingBox) -> BoundingBox {
        let across = self.window.width as f32 / self.fitted.0 as f32;
        let down = self.window.height as f32 / self.fitted.1 as f32;
        let column = |x: f32| (x - self.margin.0 as f32) * across + self.window.left as f32;
        let row = |y: f32| (y - self.margin.1 as f32) * down + self.window.top as f32;
        BoundingBox {
            left: column(place.left),
            top: row(place.top),
            right: column(place.right),
            bottom: row(place.bottom),
        }
    }
}

/// Fits windows into inputs; keeps its buffers from picture to picture.
pub struct Letterbox {
    side: u32,
    resizer: Resizer,
    shrunk: Image<'static>,
    /// Red, green and blue plane, 0 to 1.
    input: Vec<f32>,
    /// Each byte's share of 1: a table is quicker than a division.
    levels: [f32; 256],
}

impl Letterbox {
    /// For inputs of `side` x `side` pixels.
    #[must_use]
    pub fn new(side: u32) -> Self {
        let levels = std::array::from_fn(|level| level as f32 / 255.0);
        let input = vec![0.0; side as usize * side as usize * 3];
        Self { side, resizer: Resizer::new(), shrunk: Image::new(1, 1, PixelType::U8x3), input, levels }
    }

    /// The input for one window: planes of red, green, blue, 0 to 1, and where the window lies in it.
    ///
    /// # Errors
    /// [`Unknown::UnusablePicture`]: the window is not inside the picture.
    pub fn fit(&mut self, picture: Picture<'_>, window: Window) -> Result<(&[f32], Placement), Unknown> {
        let unusable = |what: String| Unknown::UnusablePicture { what };
        let placement = Placement::new(window, self.side);
        let (width, height) = placement.fitted;
        if (self.shrunk.width(), self.shrunk.height()) != (width, height) {
            self.shrunk = Image::new(width, height, PixelType::U8x3);
        }
        let source = ImageRef::new(picture.width(), picture.height(), picture.rgb(), PixelType::U8x3)
            .map_err(|error| unusable(error.to_string()))?;
        let Window { left, top, width: columns, height: rows } = window;
        let options = ResizeOptions::new().resize_alg(ResizeAlg::Convolution(FilterType::Bilinear)).crop(
            left.into(),
            top.into(),
            columns.into(),
            rows.into(),
        );
        self.resizer
            .resize(&source, &mut self.shrunk, &options)
            .map_err(|error| unusable(error.to_string()))?;
        self.fill(placement);
        Ok((&self.input, placement))
    }

    /// Spreads the shrunk window's bytes over three planes.
    fn fill(&mut self, placement: Placement) {
        let side = self.side as usize;
        let (width, margin) = (placement.fitted.0 as usize, placement.margin);
        self.input.fill(self.levels[FILLING as usize]);
        let plane = side * side;
        let (red, rest) = self.input.split_at_mut(plane);
        let (green, blue) = rest.split_at_mut(plane);
        for (row, bytes) in self.shrunk.buffer().chunks_exact(width * 3).enumerate() {
            let start = (row + margin.1 as usize) * side + margin.0 as usize;
            let places = start..start + width;
            let planes =
                red[places.clone()].iter_mut().zip(&mut green[places.clone()]).zip(&mut blue[places]);
            for (((red, green), blue), pixel) in planes.zip(bytes.chunks_exact(3)) {
                *red = self.levels[usize::from(pixel[0])];
                *green = self.levels[usize::from(pixel[1])];
                *blue = self.levels[usize::from(pixel[2])];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_picture_of_the_inputs_size_passes_unchanged() {
        let rgb: Vec<u8> = (0..8 * 8 * 3).map(|index| (index % 251) as u8).collect();
        let mut letterbox = Letterbox::new(8);
        let window = Window { left: 0, top: 0, width: 8, height: 8 };
        let (input, placement) = letterbox.fit(Picture::new(8, 8, &rgb).unwrap(), window).unwrap();
        assert_eq!((placement.fitted, placement.margin), ((8, 8), (0, 0)));
        for (pixel, bytes) in rgb.chunks_exact(3).enumerate() {
            for (plane, byte) in bytes.iter().enumerate() {
                assert_eq!(input[plane * 64 + pixel], f32::from(*byte) / 255.0);
            }
        }
    }

    #[test]
    fn what_is_left_over_is_grey_also_after_a_larger_window() {
        let rgb = vec![255; 8 * 8 * 3];
        let picture = Picture::new(8, 8, &rgb).unwrap();
        let mut letterbox = Letterbox::new(8);
        letterbox.fit(picture, Window { left: 0, top: 0, width: 8, height: 8 }).unwrap();
        let (input, _) = letterbox.fit(picture, Window { left: 0, top: 0, width: 8, height: 4 }).unwrap();
        for row in 0..8 {
            let expected = if (2..6).contains(&row) { 1.0 } else { f32::from(FILLING) / 255.0 };
            assert!(input[row * 8..row * 8 + 8].iter().all(|level| *level == expected), "row {row}");
        }
    }

    #[test]
    fn a_window_outside_the_picture_is_an_error() {
        let rgb = vec![0; 8 * 8 * 3];
        let window = Window { left: 4, top: 0, width: 8, height: 8 };
        let outcome = Letterbox::new(8).fit(Picture::new(8, 8, &rgb).unwrap(), window).map(|_| ());
        assert!(matches!(outcome, Err(Unknown::UnusablePicture { .. })));
    }

    proptest! {
        /// Into the input and back again is where it was.
        #[test]
        fn boxes_come_back(
            left in 0u32..900, top in 0u32..900, width in 1u32..2500, height in 1u32..2500,
            x in 0.0f32..1.0, y in 0.0f32..1.0,
        ) {
            let placement = Placement::new(Window { left, top, width, height }, 320);
            let (u, v) = (x * placement.fitted.0 as f32, y * placement.fitted.1 as f32);
            let (u, v) = (u + placement.margin.0 as f32, v + placement.margin.1 as f32);
            let place = placement.to_picture(&BoundingBox { left: u, top: v, right: u, bottom: v });
            prop_assert!((place.left - (left as f32 + x * width as f32)).abs() < 0.02);
            prop_assert!((place.top - (top as f32 + y * height as f32)).abs() < 0.02);
            prop_assert!(placement.fitted.0 == 320 || placement.fitted.1 == 320);
        }
    }
}
