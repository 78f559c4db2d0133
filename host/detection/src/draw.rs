//! Boxes and names, drawn into pictures.

use font8x8::UnicodeFonts as _;
use image::{Rgb, RgbImage};

use crate::boxes::BoundingBox;

/// Side of a letter, pixels, before it is enlarged for large pictures.
const LETTER: i64 = 8;
/// Width of a picture for each step of enlargement, pixels.
const ENLARGE: u32 = 900;

/// Draws a rectangle with a label at its upper left corner.
pub fn labelled_box(picture: &mut RgbImage, place: &BoundingBox, label: &str, colour: Rgb<u8>) {
    let scale = i64::from(1 + picture.width() / ENLARGE);
    let (left, top) = (place.left.round() as i64, place.top.round() as i64);
    let (right, bottom) = (place.right.round() as i64 - 1, place.bottom.round() as i64 - 1);
    for step in 0..2 * scale {
        for x in left - step..=right + step {
            set(picture, x, top - step, colour);
            set(picture, x, bottom + step, colour);
        }
        for y in top - step..=bottom + step {
            set(picture, left - step, y, colour);
            set(picture, right + step, y, colour);
        }
    }
    let height = (LETTER + 2) * scale;
    let baseline = if top - 2 * scale >= height { top - 2 * scale - height } else { top + 2 * scale };
    text(picture, left.max(0), baseline, label, colour, scale);
}

/// Dark letters on a coloured ground.
fn text(picture: &mut RgbImage, left: i64, top: i64, label: &str, ground: Rgb<u8>, scale: i64) {
    let dark = u32::from(ground[0]) * 3 + u32::from(ground[1]) * 6 + u32::from(ground[2]) < 900;
    let ink = Rgb(if dark { [255; 3] } else { [0; 3] });
    for (index, letter) in label.chars().enumerate() {
        let glyph = font8x8::BASIC_FONTS.get(letter).unwrap_or([0; 8]);
        let start = left + index as i64 * LETTER * scale;
        for v in 0..(LETTER + 2) * scale {
            for u in 0..LETTER * scale {
                let (row, column) = (v / scale - 1, u / scale);
                let lit = usize::try_from(row)
                    .ok()
                    .and_then(|row| glyph.get(row))
                    .is_some_and(|bits| bits >> column & 1 == 1);
                set(picture, start + u, top + v, if lit { ink } else { ground });
            }
        }
    }
}

/// Outside the picture nothing is drawn.
fn set(picture: &mut RgbImage, x: i64, y: i64, colour: Rgb<u8>) {
    if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
        && x < picture.width()
        && y < picture.height()
    {
        picture.put_pixel(x, y, colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_frames_what_it_is_around_and_may_leave_the_picture() {
        let mut picture = RgbImage::new(60, 60);
        let red = Rgb([255, 0, 0]);
        let place = BoundingBox { left: 20.0, top: 30.0, right: 40.0, bottom: 50.0 };
        labelled_box(&mut picture, &place, "nut", red);
        assert_eq!((*picture.get_pixel(20, 30), *picture.get_pixel(39, 49)), (red, red));
        assert_eq!(*picture.get_pixel(30, 40), Rgb([0; 3]), "the inside stays");
        assert!((0..30).any(|y| (20..44).any(|x| *picture.get_pixel(x, y) == red)), "the label is there");
        let outside = BoundingBox { left: -500.0, top: -10.0, right: 900.0, bottom: 900.0 };
        labelled_box(&mut picture, &outside, "a long label beyond the rim", red);
    }
}
