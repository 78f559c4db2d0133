//! A mount, and the rig that it makes.

use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::laser::Laser;
use nearfield_shared::rig::{ImageSize, Rig, RigError, Stripe};
use serde::Serialize;

/// How a rig is mounted. The camera looks at the middle of the stripe, raised by `tilt_degrees`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Mount {
    /// Columns and rows of the picture.
    pub image: [u16; 2],
    /// Horizontal field of view, degrees.
    pub view_degrees: f64,
    /// Place of the camera: along the robot's edge, outward from it, over the floor, millimetres.
    pub camera_mm: [f64; 3],
    /// The camera's axis is raised (positive) or lowered from the stripe's middle by this, degrees.
    pub tilt_degrees: f64,
    /// Place of the laser, as the camera's.
    pub laser_mm: [f64; 3],
    /// Distance of the stripe from the robot's edge, millimetres.
    pub distance_mm: f64,
    /// Length of the stripe that is watched, its middle before the laser, millimetres.
    pub zone_mm: f64,
}

impl Mount {
    /// The source paper's second tier: camera 400 mm and laser 200 mm over the floor, stripe 500 mm away, a lens of 66 degrees.
    pub const PAPER: Self = Self {
        image: [2304, 1296],
        view_degrees: 66.0,
        camera_mm: [0.0, 0.0, 400.0],
        tilt_degrees: 0.0,
        laser_mm: [0.0, 0.0, 200.0],
        distance_mm: 500.0,
        zone_mm: 800.0,
    };

    /// The rig.
    ///
    /// # Errors
    /// [`RigError`] if this makes no rig: an end of the zone out of the picture, a place that no rig has; the field is the
    /// rig file's.
    pub fn rig(&self) -> Result<Rig, RigError> {
        let [width, height] = self.image;
        let laser_origin = vector(self.laser_mm);
        // The sheet holds the laser and a line along x through the middle.
        let down_the_sheet = unit(self.middle().minus(laser_origin));
        let normal = unit(Vector::new(1.0, 0.0, 0.0).cross(down_the_sheet));
        let laser = Laser { origin: laser_origin, normal, offset: normal.dot(laser_origin) };
        let stripe = Stripe {
            point: Vector::new(0.0, self.distance_mm, 0.0),
            direction: Vector::new(1.0, 0.0, 0.0),
            start: laser_origin.x - self.zone_mm / 2.0,
            end: laser_origin.x + self.zone_mm / 2.0,
        };
        Rig::new(ImageSize { width, height }, self.camera(), laser, stripe)
    }

    /// The camera, with a lens free of distortion.
    #[must_use]
    pub fn camera(&self) -> Camera {
        let [width, height] = self.image;
        let focal = f64::from(width) / 2.0 / (self.view_degrees / 2.0).to_radians().tan();
        let intrinsics = Intrinsics {
            fx: focal,
            fy: focal,
            cx: (f64::from(width) - 1.0) / 2.0,
            cy: (f64::from(height) - 1.0) / 2.0,
            distortion: [0.0; 5],
        };
        Camera { intrinsics, pose: self.pose(self.middle()) }
    }

    /// The stripe's middle on the floor.
    fn middle(&self) -> Vector {
        Vector::new(self.laser_mm[0], self.distance_mm, 0.0)
    }

    fn pose(&self, middle: Vector) -> Pose {
        let centre = vector(self.camera_mm);
        let sight = unit(middle.minus(centre));
        let right = unit(Vector::new(sight.y, -sight.x, 0.0));
        let above = right.cross(sight);
        let (sine, cosine) = self.tilt_degrees.to_radians().sin_cos();
        let forward = sight.scaled(cosine).plus(above.scaled(sine));
        let rotation = [right, forward.cross(right), forward];
        let turned = Pose { rotation, translation: Vector::default() }.to_camera(centre);
        Pose { rotation, translation: turned.scaled(-1.0) }
    }
}

fn vector([x, y, z]: [f64; 3]) -> Vector {
    Vector::new(x, y, z)
}

fn unit(direction: Vector) -> Vector {
    direction.scaled(1.0 / direction.dot(direction).sqrt())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_camera_looks_at_the_middle_of_the_stripe_with_the_horizon_level() {
        for camera in [[0.0, 0.0, 400.0], [-300.0, -120.0, 350.0], [200.0, 90.0, 700.0]] {
            let rig = Mount { camera_mm: camera, ..Mount::PAPER }.rig().unwrap();
            let seen = rig.camera().project(Vector::new(0.0, 500.0, 0.0)).unwrap();
            assert!((seen.u - 1151.5).abs() < 1e-6 && (seen.v - 647.5).abs() < 1e-6, "{camera:?}: {seen:?}");
            let higher = rig.camera().project(Vector::new(0.0, 500.0, 50.0)).unwrap();
            assert!(higher.v < seen.v, "up is up in the picture");
            let right = rig.camera().pose.rotation[0];
            assert!(right.z.abs() < 1e-12 && right.x > 0.0);
        }
    }

    #[test]
    fn a_raised_camera_sees_the_stripe_lower_by_the_tilt() {
        let rig = Mount { tilt_degrees: 5.0, ..Mount::PAPER }.rig().unwrap();
        let seen = rig.camera().project(Vector::new(0.0, 500.0, 0.0)).unwrap();
        let focal = rig.camera().intrinsics.fy;
        assert!((seen.v - 647.5 - focal * 5_f64.to_radians().tan()).abs() < 1e-6);
    }

    #[test]
    fn the_sheet_meets_the_floor_in_the_stripe() {
        let rig = Mount { laser_mm: [40.0, -60.0, 150.0], ..Mount::PAPER }.rig().unwrap();
        for s in [-300.0, 0.0, 250.0] {
            let point = rig.stripe().at(s);
            assert!((rig.laser().normal.dot(point) - rig.laser().offset).abs() < 1e-9);
        }
        assert!((rig.stripe().start + 360.0).abs() < 1e-9);
    }

    #[test]
    fn a_camera_within_the_sheet_resolves_nothing() {
        let mount = Mount { camera_mm: [0.0, 0.0, 200.0], ..Mount::PAPER };
        let resolved = crate::measure::measure(&mount).least_rows_per_mm;
        assert!(resolved < 1e-6, "{resolved}");
    }
}
