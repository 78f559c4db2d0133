//! Rigs for this crate's own unit tests, of the families that the project is made for.

use crate::camera::{Camera, Intrinsics, Pose, Vector};
use crate::laser::Laser;
use crate::rig::{ImageSize, Rig, RigError, Stripe};

/// A rig from a camera position with yaw and pitch in degrees, a laser origin and a stripe at y = 500 mm.
pub(crate) fn rig_of(
    position: Vector,
    yaw: f64,
    pitch: f64,
    focal: f64,
    size: (u16, u16),
    origin: Vector,
    span: (f64, f64),
) -> Result<Rig, RigError> {
    let (yaw, pitch) = (yaw.to_radians(), pitch.to_radians());
    let forward = Vector::new(yaw.sin() * pitch.cos(), yaw.cos() * pitch.cos(), -pitch.sin());
    let right = Vector::new(yaw.cos(), -yaw.sin(), 0.0);
    let down = forward.cross(right);
    let rotation = [right, down, forward];
    let translation = Pose { rotation, translation: Vector::default() }.to_camera(position).scaled(-1.0);
    let (width, height) = size;
    let intrinsics = Intrinsics {
        fx: focal,
        fy: focal,
        cx: f64::from(width) / 2.0 + 5.8,
        cy: f64::from(height) / 2.0 - 4.6,
        distortion: [-0.031, 0.011, 0.0003, -0.0002, 0.0],
    };
    let point = Vector::new(0.0, 500.0, 0.0);
    let direction = Vector::new(1.0, 0.0, 0.0);
    let normal = direction.cross(origin.minus(point));
    let normal = normal.scaled(1.0 / normal.dot(normal).sqrt());
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    let laser = Laser { origin, normal, offset: normal.dot(origin) };
    let (start, end) = span;
    Rig::new(ImageSize { width, height }, camera, laser, Stripe { point, direction, start, end })
}

/// Camera above the laser, both in the middle: the rig for heights.
pub(crate) fn height_rig() -> Rig {
    rig_of(
        Vector::new(0.0, 0.0, 400.0),
        0.0,
        50.0,
        1792.0,
        (2304, 1296),
        Vector::new(0.0, 0.0, 200.0),
        (-400.0, 400.0),
    )
    .unwrap()
}

/// Camera and laser at one end, looking along the stripe: it runs diagonally and its far end is small.
pub(crate) fn side_rig() -> Rig {
    rig_of(
        Vector::new(-450.0, 0.0, 500.0),
        33.0,
        37.0,
        1792.0,
        (2304, 1296),
        Vector::new(-520.0, 0.0, 200.0),
        (-500.0, 560.0),
    )
    .unwrap()
}
