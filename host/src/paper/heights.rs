//! Heights by the paper's closed form, Eq. (hobj), from the rows of the mask.

use image::{GrayImage, RgbImage};
use nearfield_shared::camera::Vector;
use nearfield_shared::laser::PaperGeometry;
use nearfield_shared::rig::Rig;

use super::top_down::TopDown;

/// An object's height is this quantile of its columns' heights, as in the project's own tier 2.
const QUANTILE: f32 = 0.95;
/// Rows this near to the baseline are the floor's own stripe, as a share of the picture's height.
const FLOOR_SHARE: f32 = 0.01;
/// A stripe is no thicker than this, as a share of the picture's height.
const THICKEST_SHARE: f32 = 0.03;
/// Objects have this many columns at least.
const FEWEST_COLUMNS: usize = 8;
/// Columns of one object lie no farther apart than this along the baseline, millimetres.
const SEPARATION_MM: f32 = 8.0;

/// What the closed form assumes: camera and laser one above the other, no lens distortion, only a pitch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperHeights {
    geometry: PaperGeometry,
    /// Where a point straight below the camera would appear, pixels below the principal point.
    nadir: f64,
    principal_row: f64,
}

/// An object with its height by the closed form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperObject {
    /// Where on the floor's baseline its first column is, millimetres along the stripe.
    pub start_mm: f32,
    /// Where its last column is.
    pub end_mm: f32,
    /// Its height, millimetres.
    pub height_mm: f32,
}

impl PaperHeights {
    /// The closed form for a rig whose pitch is believed to be `pitch_error_degrees` more than it is.
    #[must_use]
    pub fn of(rig: &Rig, pitch_error_degrees: f64) -> Self {
        let (camera, laser) = (rig.camera(), rig.laser());
        let [_, down, forward] = camera.pose.rotation;
        let straight_down = Vector::new(0.0, 0.0, -1.0);
        // Angle from straight down to the optical axis, about the camera's horizontal axis.
        let tilt = down.dot(straight_down).atan2(forward.dot(straight_down));
        let centre = camera.pose.centre();
        let foot = Vector { z: 0.0, ..centre };
        // Where the vertical plane through the optical axis meets the stripe.
        let across = Vector::new(-rig.stripe().direction.y, rig.stripe().direction.x, 0.0);
        let distance = across.dot(rig.stripe().point.minus(foot)).abs();
        let focal_length = camera.intrinsics.fy;
        Self {
            geometry: PaperGeometry {
                laser_height: laser.origin.z,
                camera_height: centre.z,
                distance,
                focal_length,
            },
            nadir: focal_length * (tilt + pitch_error_degrees.to_radians()).tan(),
            principal_row: camera.intrinsics.cy,
        }
    }

    /// Height of a stripe pixel in this row, millimetres.
    #[must_use]
    pub fn height(&self, row: f64) -> Option<f64> {
        self.geometry.height(self.nadir, row - self.principal_row)
    }

    /// One object for each stretch of columns in which the mask shows the stripe away from the floor's baseline.
    #[must_use]
    pub fn objects(&self, picture: &RgbImage, mask: &GrayImage, top_down: &TopDown) -> Vec<PaperObject> {
        let baseline = top_down.baseline();
        let displaced: Vec<(f32, f32)> = (0..mask.width())
            .filter_map(|column| {
                let floor_row = baseline.row(column as f32);
                let row = displaced_row(picture, mask, column, floor_row)?;
                Some((top_down.place(column as f32, floor_row), self.height(row)? as f32))
            })
            .collect();
        displaced
            .chunk_by(|one, other| (other.0 - one.0).abs() <= SEPARATION_MM)
            .filter(|columns| columns.len() >= FEWEST_COLUMNS)
            .map(|columns| {
                let places = || columns.iter().map(|column| column.0);
                let mut heights: Vec<f32> = columns.iter().map(|column| column.1).collect();
                heights.sort_by(f32::total_cmp);
                let rank = (QUANTILE * (heights.len() - 1) as f32).round() as usize;
                PaperObject {
                    start_mm: places().fold(f32::INFINITY, f32::min),
                    end_mm: places().fold(f32::NEG_INFINITY, f32::max),
                    height_mm: heights[rank],
                }
            })
            .collect()
    }
}

/// Middle of the brightest vertical run of the mask that is off the floor's stripe and thin enough to be a stripe: skin
/// and leather have the laser's colour too, but are neither.
fn displaced_row(picture: &RgbImage, mask: &GrayImage, column: u32, floor_row: f32) -> Option<f64> {
    let height = mask.height();
    let (reach, thickest) = (FLOOR_SHARE * height as f32, (THICKEST_SHARE * height as f32) as u32);
    let mut best: Option<(f64, f64)> = None;
    let mut start: Option<u32> = None;
    for row in 0..=height {
        let lit = row < height && mask.get_pixel(column, row).0[0] > 0;
        match (lit, start) {
            (true, None) => start = Some(row),
            (false, Some(first)) => {
                let middle = f64::midpoint(f64::from(first), f64::from(row - 1));
                let red: u32 = (first..row).map(|row| u32::from(picture.get_pixel(column, row).0[0])).sum();
                let brightness = f64::from(red) / f64::from(row - first);
                let is_candidate = row - first <= thickest && (middle as f32 - floor_row).abs() > reach;
                if is_candidate && best.is_none_or(|(brightest, _)| brightness > brightest) {
                    best = Some((brightness, middle));
                }
                start = None;
            }
            _ => {}
        }
    }
    best.map(|(_, middle)| middle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery::CENTRE;

    /// In the central column of a rig that is as the paper assumes, the closed form is exact but for distortion; with a
    /// pitch that is 2 degrees off its floor is far off.
    #[test]
    fn the_closed_form_is_right_with_a_right_pitch_and_far_off_with_a_wrong_one() {
        let rig = crate::twin::gallery::Mounting { distortion: [0.0, 0.0], ..CENTRE }.rig().unwrap();
        let (right, wrong) = (PaperHeights::of(&rig, 0.0), PaperHeights::of(&rig, 2.0));
        for height in [0.0, 40.0, 80.0, 120.0] {
            let origin = rig.laser().origin;
            let foot = rig.stripe().at(0.0);
            let lit = foot.plus(origin.minus(foot).scaled(height / origin.z));
            let row = rig.camera().project(lit).unwrap().v;
            let found = right.height(row).unwrap();
            assert!((found - height).abs() < 0.3, "{height}: {found}");
            let off = wrong.height(row).unwrap() - height;
            assert!(off.abs() > 3.0, "{height}: {off}");
        }
    }
}
