//! What the host saw, drawn onto the camera's picture.

use image::codecs::jpeg::JpegEncoder;
use nearfield_shared::cutoff::is_floor;

use crate::twin::Picture;
use crate::vision::Extractor;

/// Colours that colour-blind people tell apart (Okabe and Ito): lit floor sky blue, off the floor orange.
const FLOOR_COLOUR: [u8; 3] = [86, 180, 233];
const RAISED_COLOUR: [u8; 3] = [230, 159, 0];
/// Distance of the floor's marks from the stripe, so that they do not hide it, in pixels of a 1152-wide picture.
const MARK_OFFSET: usize = 14;
/// Thickness of the marks, in pixels of a 1152-wide picture.
const MARK_SIZE: usize = 3;
/// JPEG quality of pictures in the report.
const QUALITY: u8 = 82;

/// The camera's picture with a mark above the stripe wherever the host found lit floor, and one below every point at
/// which it found the stripe off the floor.
#[must_use]
pub fn annotate(picture: &Picture, extractor: &Extractor) -> Picture {
    let mut drawn = picture.clone();
    let scale = (picture.width / 1152).max(1);
    for (column, reading) in extractor.readings().iter().enumerate() {
        let Some(map) = extractor.geometry().map(column) else { continue };
        if reading.row.is_finite() && is_floor(map.height(reading.row)) {
            let row = (reading.row as usize).saturating_sub(MARK_OFFSET * scale);
            mark(&mut drawn, column, row, MARK_SIZE * scale, FLOOR_COLOUR);
        }
    }
    for point in extractor.points().iter().filter(|point| !is_floor(point.height)) {
        mark(
            &mut drawn,
            point.column,
            point.row as usize + MARK_OFFSET / 2 * scale,
            2 * scale,
            RAISED_COLOUR,
        );
    }
    drawn
}

fn mark(picture: &mut Picture, column: usize, row: usize, size: usize, colour: [u8; 3]) {
    for y in row..(row + size).min(picture.height) {
        for x in column..(column + size).min(picture.width) {
            let start = 3 * (y * picture.width + x);
            picture.rgb[start..start + 3].copy_from_slice(&colour);
        }
    }
}

/// The picture as JPEG bytes.
///
/// # Errors
/// The encoder's own.
pub fn to_jpeg(picture: &Picture) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Vec::new();
    let side = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
    let (width, height) = (side(picture.width), side(picture.height));
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode(
        &picture.rgb,
        width,
        height,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}
