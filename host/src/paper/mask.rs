//! Which pixels have the laser's colour: hue and saturation, thresholded adaptively, and morphology.

use std::ops::Range;

use image::{GrayImage, Luma, Rgb, RgbImage};
use imageproc::contrast::adaptive_threshold;
use imageproc::distance_transform::Norm;
use imageproc::morphology::{close, open};

/// Hue of 653 nm as a colour camera gives it, degrees.
const LASER_HUE: f32 = 350.0;
/// Hues within this of the laser's are kept, degrees.
const HUE_WINDOW: f32 = 25.0;
/// Block over which the threshold adapts, as a share of the picture's width.
const BLOCK_SHARE: f32 = 1.0 / 40.0;
/// A pixel is this much more saturated than its block (0 to 255).
const SATURATION_STEP: i32 = 18;
/// A pixel's hue is this much nearer to the laser's than its block's (0 to 255).
const HUE_STEP: i32 = 4;
/// Below this saturation a hue means nothing (0 to 255).
const LEAST_SATURATION: u8 = 30;
/// A core that clips to white keeps no saturation; from this brightness on it counts with its saturated rim.
const CLOSING: u8 = 2;

/// The mask of a picture, white where the colour is the laser's; black outside of `rows`.
#[must_use]
pub fn laser_mask(picture: &RgbImage, rows: Range<u32>) -> GrayImage {
    let (width, height) = picture.dimensions();
    let rows = rows.start.min(height)..rows.end.min(height);
    let size = (width, rows.len() as u32);
    let mut closeness = GrayImage::new(size.0, size.1);
    let mut saturation = GrayImage::new(size.0, size.1);
    for (v, row) in rows.clone().enumerate() {
        for u in 0..width {
            let (hue, colour) = hue_saturation(*picture.get_pixel(u, row));
            let away = (hue - LASER_HUE).abs();
            let away = away.min(360.0 - away);
            let near =
                if colour >= LEAST_SATURATION { (1.0 - away / HUE_WINDOW).max(0.0) * 255.0 } else { 0.0 };
            closeness.put_pixel(u, v as u32, Luma([near as u8]));
            saturation.put_pixel(u, v as u32, Luma([colour]));
        }
    }
    let block = ((width as f32 * BLOCK_SHARE) as u32).max(4);
    let by_hue = adaptive_threshold(&closeness, block, -HUE_STEP);
    let by_saturation = adaptive_threshold(&saturation, block, -SATURATION_STEP);
    let mut both = by_hue;
    for (pixel, other) in both.pixels_mut().zip(by_saturation.pixels()) {
        pixel.0[0] &= other.0[0];
    }
    let clean = open(&close(&both, Norm::LInf, CLOSING), Norm::LInf, 1);
    let mut mask = GrayImage::new(width, height);
    image::imageops::replace(&mut mask, &clean, 0, i64::from(rows.start));
    mask
}

/// Hue in degrees and saturation 0 to 255.
fn hue_saturation(Rgb([red, green, blue]): Rgb<u8>) -> (f32, u8) {
    let (most, least) = (red.max(green).max(blue), red.min(green).min(blue));
    let spread = f32::from(most - least);
    if most == least {
        return (0.0, 0);
    }
    let (red, green, blue) = (f32::from(red), f32::from(green), f32::from(blue));
    let top = f32::from(most);
    let sixth = if top == red {
        (green - blue) / spread
    } else if top == green {
        2.0 + (blue - red) / spread
    } else {
        4.0 + (red - green) / spread
    };
    ((sixth * 60.0).rem_euclid(360.0), (255.0 * spread / top) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hue_and_saturation_are_those_of_the_colour_circle() {
        assert_eq!(hue_saturation(Rgb([255, 0, 0])), (0.0, 255));
        assert_eq!(hue_saturation(Rgb([0, 200, 0])), (120.0, 255));
        assert_eq!(hue_saturation(Rgb([100, 100, 200])), (240.0, 127));
        assert_eq!(hue_saturation(Rgb([77, 77, 77])), (0.0, 0));
    }

    #[test]
    fn a_red_line_is_kept_and_a_grey_floor_is_not() {
        let picture = RgbImage::from_fn(200, 100, |_, v| {
            if (48..52).contains(&v) { Rgb([220, 60, 90]) } else { Rgb([100, 98, 95]) }
        });
        let mask = laser_mask(&picture, 0..100);
        assert_eq!(mask.get_pixel(100, 50).0, [255]);
        assert_eq!(mask.get_pixel(100, 20).0, [0]);
        assert_eq!(
            laser_mask(&picture, 0..40).get_pixel(100, 50).0,
            [0],
            "outside of the region of interest"
        );
    }
}
