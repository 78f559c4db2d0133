//! From the floor's frame, in which calibration works, to the rig's world: origin at the robot's edge, x along it.
//!
//! Pictures of a floor cannot tell where on it the robot's edge runs. Heights do not depend on that; places do. Unless
//! told otherwise the world's x runs along the stripe and its origin lies on the floor below the camera, as both sit
//! on the robot's edge.

use nalgebra::{Point2, Rotation2, Rotation3, Vector2, Vector3};
use nearfield_shared::camera::{Camera, Vector};
use nearfield_shared::laser::Laser;
use nearfield_shared::rig::{ImageSize, Rig, RigError, Stripe};

use super::model::{BoardPose, Model, Sheet};
use super::shadow::Apex;

/// What ties the floor's frame to the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WorldTie {
    /// The camera's foot stands at this place of the world, and the stripe runs in this direction (radians from x).
    Camera {
        /// World x and y of the camera, millimetres.
        foot: [f64; 2],
        /// Direction of the stripe, radians from x towards y.
        stripe: f64,
    },
    /// The board on the floor lies here.
    Board {
        /// World x and y of the middle of its pattern, millimetres.
        middle: [f64; 2],
        /// Direction of its long side, radians from x towards y; a board looks the same turned by half a turn.
        long_side: f64,
    },
}

impl Default for WorldTie {
    fn default() -> Self {
        Self::Camera { foot: [0.0, 0.0], stripe: 0.0 }
    }
}

/// `world = rotation * floor + shift`, on the floor.
#[derive(Debug, Clone, Copy)]
struct Planar {
    rotation: Rotation2<f64>,
    shift: Vector2<f64>,
}

impl Planar {
    fn new(tie: WorldTie, sheet: &Sheet, camera: &Camera, long_side_is_y: bool) -> Self {
        match tie {
            WorldTie::Camera { foot, stripe } => {
                // The stripe's direction in the floor's frame lies a quarter turn clockwise of the normal.
                let rotation = Rotation2::new(stripe - (sheet.heading - std::f64::consts::FRAC_PI_2));
                let centre = camera.pose.centre();
                let shift = Vector2::from(foot) - rotation * Vector2::new(centre.x, centre.y);
                Self { rotation, shift }
            }
            WorldTie::Board { middle, long_side } => {
                let own = if long_side_is_y { std::f64::consts::FRAC_PI_2 } else { 0.0 };
                let straight = Rotation2::new(long_side - own);
                // Of the two ways round the one in which the stripe lies outward of the camera.
                let normal = straight * Vector2::new(sheet.heading.cos(), sheet.heading.sin());
                let half_turn = if normal.y < 0.0 { std::f64::consts::PI } else { 0.0 };
                Self { rotation: Rotation2::new(half_turn) * straight, shift: Vector2::from(middle) }
            }
        }
    }

    fn point(&self, point: Point2<f64>, z: f64) -> Vector {
        let turned = self.rotation * point.coords + self.shift;
        Vector::new(turned.x, turned.y, z)
    }
}

/// What [`rig_of`] needs besides the model.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    /// What ties the floor to the robot.
    pub tie: WorldTie,
    /// Does the board's longer side run along the floor frame's y?
    pub long_side_is_y: bool,
    /// Where the laser's fan starts.
    pub apex: Apex,
    /// Watched stretch, places along the sheet's floor line, millimetres.
    pub extent: [f64; 2],
}

/// The calibrated rig. `None` if the model has no camera or no sheet.
///
/// # Errors
/// [`RigError`] if the parts contradict each other, for instance a laser below the floor.
pub fn rig_of(image: ImageSize, model: &Model, placement: &Placement) -> Option<Result<Rig, RigError>> {
    let (camera, sheet) = (model.camera()?, model.sheet?);
    let planar = Planar::new(placement.tie, &sheet, &camera, placement.long_side_is_y);
    let pose = model.poses.first()?;
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), planar.rotation.angle());
    let rotation = pose.rotation * turn.inverse();
    let shift = Vector3::new(planar.shift.x, planar.shift.y, 0.0);
    let world_pose = BoardPose { rotation, translation: pose.translation - rotation * shift };

    let (normal, _) = sheet.plane();
    let normal = turn * normal;
    let normal = Vector::new(normal.x, normal.y, normal.z);
    let on_floor = |along: f64| planar.point(sheet.point(along, 0.0).xy(), 0.0);
    let ends = placement.extent.map(on_floor);
    let apex = sheet.point(placement.apex.along, placement.apex.height);
    let origin = planar.point(apex.xy(), apex.z);
    let laser = Laser { origin, normal, offset: normal.dot(on_floor(0.0)) };

    let span = ends[1].minus(ends[0]);
    let direction = span.scaled(1.0 / span.dot(span).sqrt());
    // s = 0 at the foot of the world's origin, so that s is x where the stripe runs along the robot's edge.
    let point = ends[0].minus(direction.scaled(direction.dot(ends[0])));
    let stripe = Stripe { point, direction, start: direction.dot(ends[0]), end: direction.dot(ends[1]) };
    Some(Rig::new(image, world_pose.camera(model.lens), laser, stripe))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_shared::camera::Intrinsics;

    /// A camera 400 mm over the floor that looks outward (+y of the floor's frame turned by `turn`), stripe 500 mm away.
    fn model(turn: f64) -> Model {
        let (sine, cosine) = 50.0_f64.to_radians().sin_cos();
        let down = nalgebra::Matrix3::new(1.0, 0.0, 0.0, 0.0, -sine, -cosine, 0.0, cosine, -sine);
        let own = Rotation3::from_axis_angle(&Vector3::z_axis(), turn);
        let rotation = Rotation3::from_matrix_unchecked(down) * own.inverse();
        let translation = rotation * Vector3::new(0.0, 0.0, -400.0);
        Model {
            lens: Intrinsics { fx: 1800.0, fy: 1800.0, cx: 1150.0, cy: 640.0, distortion: [0.0; 5] },
            poses: vec![BoardPose { rotation, translation }],
            sheet: Some(Sheet { heading: std::f64::consts::FRAC_PI_2 + turn, distance: 500.0, slant: 2.5 }),
            heights: Vec::new(),
        }
    }

    fn placement(tie: WorldTie) -> Placement {
        let apex = Apex { along: 20.0, height: 200.0, rays: 2 };
        Placement { tie, long_side_is_y: false, apex, extent: [-300.0, 280.0] }
    }

    const IMAGE: ImageSize = ImageSize { width: 2304, height: 1296 };

    /// The rule: whatever the board's own direction on the floor, the world's x runs along the stripe.
    #[test]
    fn the_world_lies_below_the_camera_with_x_along_the_stripe() {
        for turn in [0.0, 0.7, -2.5] {
            let rig = rig_of(IMAGE, &model(turn), &placement(WorldTie::default())).unwrap().unwrap();
            let centre = rig.camera().pose.centre();
            assert!(centre.x.abs() < 1e-6 && centre.y.abs() < 1e-6 && (centre.z - 400.0).abs() < 1e-6);
            let stripe = rig.stripe();
            assert!((stripe.direction.x - 1.0).abs() < 1e-9 && (stripe.point.y - 500.0).abs() < 1e-6);
            assert!((stripe.start + 300.0).abs() < 1e-6 && (stripe.end - 280.0).abs() < 1e-6);
            let origin = rig.laser().origin;
            assert!(
                (origin.x - 20.0).abs() < 1e-6 && origin.y.abs() < 1e-6 && (origin.z - 200.0).abs() < 1e-6
            );
        }
    }

    #[test]
    fn a_board_of_known_place_ties_the_world_whichever_way_round_it_is_found() {
        for turn in [0.0, std::f64::consts::PI] {
            let tie = WorldTie::Board { middle: [-90.0, 480.0], long_side: 0.0 };
            let rig = rig_of(IMAGE, &model(turn), &placement(tie)).unwrap().unwrap();
            let centre = rig.camera().pose.centre();
            assert!((centre.x + 90.0).abs() < 1e-6 && (centre.y - 480.0).abs() < 1e-6, "{centre:?}");
            assert!(rig.stripe().point.y > 900.0, "the stripe lies outward of the camera");
        }
    }
}
