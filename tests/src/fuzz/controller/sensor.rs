//! The sensor of the fuzzed robot: its rig, and what its pictures show.

use nearfield_shared::audit::first_row_for;
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::laser::Laser;
use nearfield_shared::linescan::{AUDIT_PIXELS, AuditWindow};
use nearfield_shared::rig::{ImageSize, Rig, Stripe};

/// Columns of its camera.
pub(super) const COLUMNS: u16 = 128;

/// A camera over a laser, 128 columns of about a millimetre.
pub(super) fn rig() -> Rig {
    let pitch = 50.0_f64.to_radians();
    let forward = Vector::new(0.0, pitch.cos(), -pitch.sin());
    let right = Vector::new(1.0, 0.0, 0.0);
    let rotation = [right, forward.cross(right), forward];
    let position = Vector::new(0.0, 0.0, 400.0);
    let translation = Pose { rotation, translation: Vector::default() }.to_camera(position).scaled(-1.0);
    let intrinsics = Intrinsics { fx: 640.0, fy: 640.0, cx: 64.0, cy: 240.0, distortion: [0.0; 5] };
    let origin = Vector::new(0.0, 0.0, 200.0);
    let (point, direction) = (Vector::new(0.0, 500.0, 0.0), right);
    let normal = direction.cross(origin.minus(point));
    let normal = normal.scaled(1.0 / normal.dot(normal).sqrt());
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    let laser = Laser { origin, normal, offset: normal.dot(origin) };
    let stripe = Stripe { point, direction, start: -55.0, end: 55.0 };
    Rig::new(ImageSize { width: COLUMNS, height: 480 }, camera, laser, stripe).expect("a sound rig")
}

/// A window that shows a stripe at this row.
pub(super) fn window(column: u16, row: f32) -> AuditWindow {
    let first_row = first_row_for(row);
    let mut pixels = [100_u8; AUDIT_PIXELS];
    for (pixel, offset) in pixels.iter_mut().zip(0_u8..) {
        let distance = f32::from(first_row) + f32::from(offset) - row;
        // A bell of 60 grey levels; the shape does not matter, only its middle.
        #[allow(clippy::as_conversions, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let light = (60.0 * (-distance * distance / 6.0).exp()) as u8;
        *pixel += light;
    }
    AuditWindow { column, first_row, pixels }
}
