//! The sheet of laser light, and the paper's closed form for heights as the special case that it is.

use crate::camera::{Camera, Pixel, Vector};

/// The laser: where the fan of light starts and the plane `normal . X = offset` in which it spreads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Laser {
    /// The fan's apex, world millimetres.
    pub origin: Vector,
    /// Unit normal of the sheet.
    pub normal: Vector,
    /// Distance of the sheet from the world's origin along the normal, millimetres.
    pub offset: f64,
}

/// A line of sight that meets the sheet at less than this sine is useless (and the division unsafe).
const SMALLEST_CROSSING: f64 = 1e-6;

impl Laser {
    /// Where the line from `start` along `direction` meets the sheet, ahead of `start`. `None` if it runs (almost)
    /// within the sheet or away from it.
    #[must_use]
    pub fn meet(&self, start: Vector, direction: Vector) -> Option<Vector> {
        let crossing = self.normal.dot(direction);
        if crossing * crossing < SMALLEST_CROSSING * SMALLEST_CROSSING * direction.dot(direction) {
            return None;
        }
        let along = (self.offset - self.normal.dot(start)) / crossing;
        let point = start.plus(direction.scaled(along));
        (along > 0.0 && point.is_finite()).then_some(point)
    }

    /// The lit point that a camera sees at `pixel`, world millimetres: exact triangulation, the reference for
    /// [`crate::columns`].
    #[must_use]
    pub fn triangulate(&self, camera: &Camera, pixel: Pixel) -> Option<Vector> {
        let sight = camera.line_of_sight(pixel)?;
        self.meet(camera.pose.centre(), sight)
    }

    /// Where the laser ray through `point` would meet the floor (z = 0) if nothing were in its way; it names the ray.
    /// `None` for a point at or above the laser's own height.
    #[must_use]
    pub fn shadow_on_floor(&self, point: Vector) -> Option<Vector> {
        let drop = self.origin.z - point.z;
        if drop <= 0.0 {
            return None;
        }
        let reach = self.origin.z / drop;
        Some(self.origin.plus(point.minus(self.origin).scaled(reach)))
    }
}

/// What the paper's closed form needs to know of a rig: camera and laser at the same horizontal distance from where
/// the laser meets the floor, no distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperGeometry {
    /// Laser height over the floor `h_light`, millimetres.
    pub laser_height: f64,
    /// Camera height over the floor `h_cam`, millimetres.
    pub camera_height: f64,
    /// Horizontal distance `d_light` from camera and laser to where the laser meets the floor, millimetres.
    pub distance: f64,
    /// Focal length in pixels `f_x`.
    pub focal_length: f64,
}

impl PaperGeometry {
    /// The paper's Eqs. (phi1) and (hobj): height from two image coordinates measured from the principal point along
    /// the direction of displacement, in pixels. `nadir` is where a point straight below the camera would appear (the
    /// paper's `x_corner`, `theta = atan(x_corner / f_x)`), `seen` where the stripe is; positive to the floor side.
    ///
    /// With `p = nadir / f`, `q = seen / f` the paper's `tan(atan p - atan q)` is `(p - q) / (1 + p q)`, exactly: no
    /// trigonometry is left. `None` where a line of sight is level or the formula's denominator vanishes.
    ///
    /// Note: the paper's figure is not in its text; `phi_1` is taken as the angle from straight down to the line of
    /// sight, the only reading for which Eq. (tanphi1) holds.
    #[must_use]
    pub fn height(&self, nadir: f64, seen: f64) -> Option<f64> {
        let p = nadir / self.focal_length;
        let q = seen / self.focal_length;
        let level = 1.0 + p * q;
        if level <= 0.0 {
            return None;
        }
        let tangent = (p - q) / level;
        let denominator = self.distance - self.laser_height * tangent;
        let height = self.laser_height * (self.distance - self.camera_height * tangent) / denominator;
        height.is_finite().then_some(height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Intrinsics, Pose};
    use proptest::prelude::*;

    fn paper_rig(camera_height: f64, laser_height: f64, distance: f64, tilt: f64) -> (Camera, Laser) {
        let (sine, cosine) = tilt.sin_cos();
        let rotation =
            [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, -cosine, -sine), Vector::new(0.0, sine, -cosine)];
        let centre = Vector::new(0.0, 0.0, camera_height);
        let turned = Pose { rotation, translation: Vector::default() }.to_camera(centre);
        let intrinsics = Intrinsics { fx: 1800.0, fy: 1800.0, cx: 1151.5, cy: 647.5, distortion: [0.0; 5] };
        let camera = Camera { intrinsics, pose: Pose { rotation, translation: turned.scaled(-1.0) } };
        let length = (laser_height * laser_height + distance * distance).sqrt();
        let normal = Vector::new(0.0, laser_height / length, distance / length);
        let origin = Vector::new(0.0, 0.0, laser_height);
        (camera, Laser { origin, normal, offset: normal.dot(origin) })
    }

    proptest! {
        /// The paper's closed form is the general model where its assumptions hold: an undistorted camera straight
        /// above the laser, tilted about the stripe's direction only, seen in the central column.
        #[test]
        fn the_papers_closed_form_equals_the_general_model(
            height in 0.0..180.0_f64, camera_height in 250.0..600.0_f64, laser_height in 190.0..240.0_f64,
            distance in 300.0..700.0_f64, tilt in 0.5..1.0_f64,
        ) {
            let (camera, laser) = paper_rig(camera_height, laser_height, distance, tilt);
            let lit = Vector::new(0.0, distance * (laser_height - height) / laser_height, height);
            let pixel = camera.project(lit).unwrap();
            let general = laser.triangulate(&camera, pixel).unwrap().z;
            let paper = PaperGeometry { laser_height, camera_height, distance, focal_length: 1800.0 };
            // The optical axis leaves the vertical by `tilt`, and rows grow towards the robot.
            let nadir = 1800.0 * tilt.tan();
            let closed = paper.height(nadir, pixel.v - 647.5).unwrap();
            prop_assert!((closed - height).abs() < 1e-6, "closed {closed}, true {height}");
            prop_assert!((closed - general).abs() < 1e-6, "closed {closed}, general {general}");
        }

        #[test]
        fn a_ray_keeps_its_name_whatever_it_hits(share in 0.01..0.99_f64, x in -500.0..500.0_f64) {
            let (_, laser) = paper_rig(400.0, 200.0, 500.0, 0.8);
            let floor = Vector::new(x, 500.0, 0.0);
            let lit = floor.plus(laser.origin.minus(floor).scaled(share));
            let named = laser.shadow_on_floor(lit).unwrap().minus(floor);
            prop_assert!(named.dot(named) < 1e-15);
        }
    }

    #[test]
    fn a_line_of_sight_within_the_sheet_or_away_from_it_meets_nothing() {
        let (_, laser) = paper_rig(400.0, 200.0, 500.0, 0.8);
        assert_eq!(laser.meet(Vector::new(0.0, 0.0, 400.0), Vector::new(1.0, 0.0, 0.0)), None);
        assert_eq!(laser.meet(Vector::new(0.0, 0.0, 400.0), Vector::new(0.0, 0.0, 1.0)), None);
        assert_eq!(laser.shadow_on_floor(Vector::new(0.0, 0.0, 200.0)), None);
    }

    #[test]
    fn the_paper_formula_refuses_a_level_line_of_sight() {
        let paper = PaperGeometry {
            laser_height: 200.0,
            camera_height: 400.0,
            distance: 500.0,
            focal_length: 1000.0,
        };
        assert_eq!(paper.height(1000.0, -1000.0), None);
    }

    /// The sine between line of sight and sheet decides, not the length of the vector that names the direction.
    #[test]
    fn a_line_of_sight_that_grazes_the_sheet_meets_nothing() {
        let (floor, start) = (Vector::new(0.0, 0.0, 1.0), Vector::new(0.0, 0.0, 100.0));
        let sheet = Laser { origin: start, normal: floor, offset: 0.0 };
        for length in [1e-3, 1.0, 1e3] {
            let down = |sine: f64| sheet.meet(start, Vector::new(length, 0.0, -sine * length));
            assert_eq!(down(0.9 * SMALLEST_CROSSING), None);
            assert!(down(1.1 * SMALLEST_CROSSING).is_some(), "{length}");
            assert!(down(0.5).is_some(), "{length}");
        }
    }

    #[test]
    fn the_sheet_lies_ahead_or_nowhere() {
        let sheet =
            Laser { origin: Vector::new(0.0, 0.0, 200.0), normal: Vector::new(0.0, 0.0, 1.0), offset: 0.0 };
        let down = Vector::new(0.0, 0.0, -1.0);
        assert_eq!(sheet.meet(Vector::new(0.0, 0.0, 0.0), down), None, "it begins on the sheet");
        assert_eq!(sheet.meet(Vector::new(0.0, 0.0, -1.0), down), None, "the sheet is behind it");
        assert_eq!(sheet.meet(Vector::new(3.0, 4.0, 1.0), down), Some(Vector::new(3.0, 4.0, 0.0)));
    }
}
