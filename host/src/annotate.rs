//! What the host found, drawn onto the camera's picture.
//!
//! Colours are Okabe and Ito's, which colour-blind people tell apart: the stripe on the floor sky blue, off the floor
//! orange, missing vermilion; gaps are yellow bars with their lengths, objects carry their heights.

use font8x8::UnicodeFonts as _;
use image::{Rgb, RgbImage};
use nearfield_shared::cutoff::is_floor;
use nearfield_shared::rig::ImageSize;

use crate::vision::Analyser;

const FLOOR: Rgb<u8> = Rgb([86, 180, 233]);
const RAISED: Rgb<u8> = Rgb([230, 159, 0]);
const MISSING: Rgb<u8> = Rgb([213, 94, 0]);
const GAP: Rgb<u8> = Rgb([240, 228, 66]);
const TEXT: Rgb<u8> = Rgb([255, 255, 255]);
const SHADE: Rgb<u8> = Rgb([0, 0, 0]);
/// Side of a character, pixels of the font.
const GLYPH: i64 = 8;
/// Marks are one pixel wide in a picture of this width.
const UNIT_WIDTH: u32 = 1152;
/// Distance of the floor's and the missing stripe's marks from it, so that they do not hide it, units.
const MARK_DISTANCE: i64 = 10;
/// Distance of gap bars, units.
const BAR_DISTANCE: i64 = 18;

/// Draws the analyser's last frame onto its picture, whose `rgb` bytes are of this size; a picture that is not stays
/// black.
#[must_use]
pub fn draw(rgb: &[u8], size: ImageSize, analyser: &Analyser, relay_closed: bool) -> RgbImage {
    let (width, height) = (u32::from(size.width), u32::from(size.height));
    let picture =
        RgbImage::from_raw(width, height, rgb.to_vec()).unwrap_or_else(|| RgbImage::new(width, height));
    let mut canvas = Canvas { picture, unit: i64::from((width / UNIT_WIDTH).max(1)) };
    draw_stripe(&mut canvas, analyser);
    draw_gaps(&mut canvas, analyser);
    draw_objects(&mut canvas, analyser);
    let report = analyser.report();
    let gap = report.longest_gap().map_or(0.0, |gap| gap.length().get());
    let stripe = match (analyser.is_stripe_found(), report.is_cut()) {
        (false, _) => "NOT FOUND".to_owned(),
        (true, true) => format!("CUT, longest gap {gap:.1} mm"),
        (true, false) => "WHOLE".to_owned(),
    };
    let relay = if relay_closed { "closed" } else { "OPEN" };
    canvas.text(4, 4, &format!("stripe {stripe}   relay {relay}"));
    canvas.picture
}

fn draw_stripe(canvas: &mut Canvas, analyser: &Analyser) {
    let extractor = analyser.extractor();
    let watched = extractor.geometry().watched();
    let columns = extractor.geometry().maps().iter().zip(watched);
    for (map, column) in columns {
        let Some(reading) = extractor.readings().get(column) else { continue };
        let (colour, row) =
            if is_floor(map.height(reading.row)) { (FLOOR, reading.row) } else { (MISSING, map.floor_row) };
        canvas.mark(column as i64, row.round() as i64 - MARK_DISTANCE * canvas.unit, canvas.unit, colour);
    }
    for point in extractor.points() {
        canvas.mark(point.column as i64, point.row.round() as i64, 2 * canvas.unit, RAISED);
    }
}

fn draw_gaps(canvas: &mut Canvas, analyser: &Analyser) {
    let geometry = analyser.extractor().geometry();
    for gap in analyser.gaps() {
        let inside = geometry.watched().filter(|column| {
            geometry
                .map(*column)
                .is_some_and(|map| (gap.start.get()..=gap.end.get()).contains(&map.floor_place))
        });
        let mut middle = None;
        let columns: Vec<usize> = inside.collect();
        for (index, column) in columns.iter().enumerate() {
            let Some(map) = geometry.map(*column) else { continue };
            let row = map.floor_row.round() as i64 - BAR_DISTANCE * canvas.unit;
            canvas.mark(*column as i64, row, 3 * canvas.unit, GAP);
            if index == columns.len() / 2 {
                middle = Some((*column as i64, row));
            }
        }
        if let Some((column, row)) = middle {
            canvas.text(column, row - 2 * GLYPH * canvas.unit - 4, &format!("gap {:.1}", gap.length().get()));
        }
    }
}

fn draw_objects(canvas: &mut Canvas, analyser: &Analyser) {
    for object in analyser.objects() {
        let Some(height) = object.height else { continue };
        let range = object.start.get()..=object.end.get();
        let points = analyser.extractor().points().iter().filter(|point| range.contains(&point.place));
        let lowest = points.max_by(|one, other| one.row.total_cmp(&other.row));
        if let Some(point) = lowest {
            let row = point.row.round() as i64 + 4 * canvas.unit;
            let deviation = object.uncertainty.map_or(0.0, |deviation| deviation.get());
            canvas.text(point.column as i64, row, &format!("{:.1} +- {deviation:.1} mm high", height.get()));
        }
    }
}

/// A picture and the size of a mark in it.
struct Canvas {
    picture: RgbImage,
    unit: i64,
}

impl Canvas {
    fn dot(&mut self, column: i64, row: i64, colour: Rgb<u8>) {
        if let (Ok(column), Ok(row)) = (u32::try_from(column), u32::try_from(row))
            && let Some(pixel) = self.picture.get_pixel_mut_checked(column, row)
        {
            *pixel = colour;
        }
    }

    fn mark(&mut self, column: i64, row: i64, side: i64, colour: Rgb<u8>) {
        for down in 0..side {
            for right in 0..side {
                self.dot(column + right, row + down, colour);
            }
        }
    }

    /// Writes a line of text with its top left corner there, moved into the picture where it would leave it.
    fn text(&mut self, column: i64, row: i64, text: &str) {
        let scale = 2 * self.unit;
        let length = i64::try_from(text.chars().count()).unwrap_or(0) * GLYPH * scale;
        let left = column.min(i64::from(self.picture.width()) - length).max(0);
        let top = row.min(i64::from(self.picture.height()) - GLYPH * scale).max(0);
        for (place, character) in (0..).zip(text.chars()) {
            let Some(glyph) = font8x8::BASIC_FONTS.get(character) else { continue };
            for (down, bits) in (0..).zip(glyph) {
                for right in 0..GLYPH {
                    let colour = if bits >> right & 1 == 1 { TEXT } else { SHADE };
                    let (x, y) = (left + (place * GLYPH + right) * scale, top + down * scale);
                    self.mark(x, y, scale, colour);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn writing_at_any_place_stays_within_the_picture() {
        let mut canvas = Canvas { picture: RgbImage::new(200, 40), unit: 1 };
        for (column, row) in [(-50, -50), (190, 39), (5000, 5000)] {
            canvas.text(column, row, "gap 12.5");
        }
        let white = |picture: &RgbImage, right: bool| {
            picture.enumerate_pixels().filter(|(x, _, pixel)| **pixel == TEXT && (*x > 100) == right).count()
        };
        assert!(white(&canvas.picture, false) > 20 && white(&canvas.picture, true) > 20);
    }
}
