//! What a calibration estimates, and what it compares with pixels.
//!
//! Everything is in the floor's frame: the plane of the board that lies on the floor is z = board thickness, its
//! pattern's middle is x = y = 0, z is up. [`super::world`] turns the result into the rig's world.

use nalgebra::{Point2, Point3, Rotation3, Vector3};
use nearfield_shared::camera::{Camera, Intrinsics, Pixel, Pose, Vector};

use super::board::BoardCorner;

/// The lens parameters in the order in which they are estimated.
pub const LENS_NAMES: [&str; 9] = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"];

/// The lens as a list, in the order of [`LENS_NAMES`].
#[must_use]
pub fn lens_values(lens: &Intrinsics) -> [f64; 9] {
    let [k1, k2, p1, p2, k3] = lens.distortion;
    [lens.fx, lens.fy, lens.cx, lens.cy, k1, k2, p1, p2, k3]
}

/// The inverse of [`lens_values`].
#[must_use]
pub fn lens_of([fx, fy, cx, cy, k1, k2, p1, p2, k3]: [f64; 9]) -> Intrinsics {
    Intrinsics { fx, fy, cx, cy, distortion: [k1, k2, p1, p2, k3] }
}

/// Where a board is seen from: `x_cam = rotation * x_board + translation`, millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardPose {
    /// Board to camera.
    pub rotation: Rotation3<f64>,
    /// Camera frame.
    pub translation: Vector3<f64>,
}

impl BoardPose {
    /// The camera that stands so.
    #[must_use]
    pub fn camera(&self, lens: Intrinsics) -> Camera {
        let row = |row: usize| {
            let matrix = self.rotation.matrix();
            Vector::new(matrix[(row, 0)], matrix[(row, 1)], matrix[(row, 2)])
        };
        let translation = Vector::new(self.translation.x, self.translation.y, self.translation.z);
        Camera { intrinsics: lens, pose: Pose { rotation: [row(0), row(1), row(2)], translation } }
    }
}

/// The laser's sheet as `x cos(heading) + y sin(heading) + slant z = distance`: its line on the floor by `heading` and
/// `distance`, and how far the line shifts towards the laser for each millimetre of height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// Direction of the floor line's normal, radians from x towards y.
    pub heading: f64,
    /// Distance of the floor line from the origin along the normal, millimetres.
    pub distance: f64,
    /// Millimetres towards the laser per millimetre of height.
    pub slant: f64,
}

impl Sheet {
    /// How far a point is from the sheet's line at the point's height, millimetres along the floor line's normal.
    #[must_use]
    pub fn miss(&self, point: Point3<f64>) -> f64 {
        let (sine, cosine) = self.heading.sin_cos();
        point.x * cosine + point.y * sine + self.slant * point.z - self.distance
    }

    /// Place of a point along the floor line, millimetres (zero at the foot of the origin); with the normal pointing
    /// outward it grows along the rig's x.
    #[must_use]
    pub fn place(&self, point: Point3<f64>) -> f64 {
        let (sine, cosine) = self.heading.sin_cos();
        point.x * sine - point.y * cosine
    }

    /// The lit point over place `along` at height `z` on the line parallel to the stripe.
    #[must_use]
    pub fn point(&self, along: f64, z: f64) -> Point3<f64> {
        let (sine, cosine) = self.heading.sin_cos();
        let across = self.distance - self.slant * z;
        Point3::new(cosine * across + sine * along, sine * across - cosine * along, z)
    }

    /// Unit normal and offset: the sheet is `normal . X = offset`.
    #[must_use]
    pub fn plane(&self) -> (Vector3<f64>, f64) {
        let (sine, cosine) = self.heading.sin_cos();
        let length = self.slant.hypot(1.0);
        (Vector3::new(cosine, sine, self.slant) / length, self.distance / length)
    }
}

/// Where the line of sight through a pixel meets the horizontal plane at height `z`. `None` beyond the lens model, or
/// where the line does not come down to it.
#[must_use]
pub fn on_level(camera: &Camera, pixel: Pixel, z: f64) -> Option<Point3<f64>> {
    let sight = camera.line_of_sight(pixel)?;
    let centre = camera.pose.centre();
    let reach = (z - centre.z) / sight.z;
    (reach.is_finite() && reach > 0.0)
        .then(|| Point3::new(centre.x + reach * sight.x, centre.y + reach * sight.y, z))
}

/// A pixel of the laser's stripe on a surface of known height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripePoint {
    /// Where it is seen.
    pub pixel: Pixel,
    /// Pixels per millimetre across the stripe there: turns a miss into pixels. Kept fixed during a fit.
    pub scale: f64,
}

/// All stripe pixels on one surface of known height.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// Stated height over the floor, millimetres.
    pub height: f64,
    /// How well that height is known, millimetres (one sigma); zero for the floor itself.
    pub height_sigma: f64,
    /// The pixels.
    pub points: Vec<StripePoint>,
}

/// Everything that was seen.
#[derive(Debug, Clone, Default)]
pub struct Observations {
    /// Corners of each board view; the first is that of the board on the floor where there is one.
    pub boards: Vec<Vec<BoardCorner>>,
    /// Height of the corners of each view over its frame's z = 0, millimetres (the board's thickness on the floor).
    pub board_height: f64,
    /// The stripe on surfaces of known height, in the frame of the first board.
    pub levels: Vec<Level>,
}

/// What is estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// The lens.
    pub lens: Intrinsics,
    /// One pose for each board view.
    pub poses: Vec<BoardPose>,
    /// The laser's sheet in the first board's frame, if the stripe was seen.
    pub sheet: Option<Sheet>,
    /// True heights of the levels, near the stated ones.
    pub heights: Vec<f64>,
}

impl Model {
    /// The camera over the first board.
    #[must_use]
    pub fn camera(&self) -> Option<Camera> {
        self.poses.first().map(|pose| pose.camera(self.lens))
    }

    /// Where a board corner misses its pixel, across and down, pixels. A corner that the model cannot image is far
    /// off, so that no fit ends there.
    #[must_use]
    pub fn corner_miss(&self, view: usize, corner: &BoardCorner, board_height: f64) -> [f64; 2] {
        let Point2 { coords } = corner.place;
        let seen = self.poses.get(view).and_then(|pose| {
            let world = Vector::new(coords.x, coords.y, board_height);
            pose.camera(self.lens).project(world)
        });
        seen.map_or([FAR_OFF; 2], |seen| [seen.u - corner.pixel.u, seen.v - corner.pixel.v])
    }

    /// How far a stripe pixel is from the sheet's line at its level, pixels.
    #[must_use]
    pub fn stripe_miss(&self, camera: &Camera, level: usize, point: &StripePoint) -> f64 {
        let height = self.heights.get(level).copied().unwrap_or(0.0);
        self.sheet
            .zip(on_level(camera, point.pixel, height))
            .map_or(FAR_OFF, |(sheet, place)| sheet.miss(place) * point.scale)
    }
}

/// The miss of what a model cannot image at all, pixels.
const FAR_OFF: f64 = 1e4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_of_the_sheet_lies_in_it_at_its_own_place_and_in_its_plane() {
        let sheet = Sheet { heading: 1.1, distance: 480.0, slant: 2.4 };
        for (along, z) in [(0.0, 0.0), (-300.0, 60.0), (250.0, 120.0)] {
            let point = sheet.point(along, z);
            assert!(sheet.miss(point).abs() < 1e-9 && (sheet.place(point) - along).abs() < 1e-9);
            let (normal, offset) = sheet.plane();
            assert!((normal.dot(&point.coords) - offset).abs() < 1e-9 && (normal.norm() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn lens_values_keep_their_order() {
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
        assert_eq!(lens_values(&lens_of(values)), values);
        assert_eq!(lens_of(values).distortion, [5.0, 6.0, 7.0, 8.0, 9.0], "k1, k2, p1, p2, k3");
    }
}
