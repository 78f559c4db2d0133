//! From a box in the picture to the floor: where a thing stands, and how high it can be at most.

use nearfield_shared::camera::{Pixel, Vector};
use nearfield_shared::height::SizeClass;
use nearfield_shared::rig::{Rig, Stripe};
use nearfield_shared::units::{Millimetres, narrow};

/// A box in the picture, pixels; edges at pixel centres, top < bottom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoxPixels {
    /// Left edge's column.
    pub left: f64,
    /// Upper edge's row.
    pub top: f64,
    /// Right edge's column.
    pub right: f64,
    /// Lower edge's row.
    pub bottom: f64,
}

/// A point of the floor, world millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorPoint {
    /// Along the robot's edge.
    pub x: f64,
    /// Outward.
    pub y: f64,
}

/// What a thing covers of the floor, as far as a box tells: its near edge, and how far it can reach behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Left end of the edge that the box's lower side shows.
    pub near_left: FloorPoint,
    /// Right end of it.
    pub near_right: FloorPoint,
    /// How far it reaches outward at most, millimetres.
    pub depth: f64,
    /// How high it is at most, millimetres: as if it stood upright on its near edge.
    pub greatest_height: f64,
}

/// A depth beyond this says nothing: the box's upper side is the thing's height, not its far end. The largest thing of the
/// action table that lies flat is a plank.
const GREATEST_DEPTH: f64 = 600.0;
/// Rays that leave less steeply than this (sine of the angle) meet the floor at no useful place.
const LEAST_FALL: f64 = 0.02;

impl Footprint {
    /// Of a box in the picture of this rig's camera; `None` if its lower side shows no floor.
    #[must_use]
    pub fn of(rig: &Rig, seen: &BoxPixels) -> Option<Self> {
        let near_left = floor_under(rig, Pixel { u: seen.left, v: seen.bottom })?;
        let near_right = floor_under(rig, Pixel { u: seen.right, v: seen.bottom })?;
        let top = Pixel { u: f64::midpoint(seen.left, seen.right), v: seen.top };
        let near = FloorPoint {
            x: f64::midpoint(near_left.x, near_right.x),
            y: f64::midpoint(near_left.y, near_right.y),
        };
        let depth =
            floor_under(rig, top).map_or(GREATEST_DEPTH, |far| far.y - near.y).clamp(0.0, GREATEST_DEPTH);
        Some(Self { near_left, near_right, depth, greatest_height: height_above(rig, near, top) })
    }

    /// The middle of the near edge.
    #[must_use]
    pub fn near(&self) -> FloorPoint {
        FloorPoint {
            x: f64::midpoint(self.near_left.x, self.near_right.x),
            y: f64::midpoint(self.near_left.y, self.near_right.y),
        }
    }

    /// Length of the near edge, millimetres.
    #[must_use]
    pub fn width(&self) -> f64 {
        (self.near_right.x - self.near_left.x).hypot(self.near_right.y - self.near_left.y)
    }

    /// From which to which stripe coordinate it reaches, millimetres.
    #[must_use]
    pub fn along(&self, stripe: &Stripe) -> (f64, f64) {
        let [one, other] =
            [self.near_left, self.near_right].map(|point| stripe.coordinate_of(on_floor(point)));
        (one.min(other), one.max(other))
    }

    /// How far its near edge and its far end lie behind the stripe, millimetres; negative = between robot and stripe.
    #[must_use]
    pub fn behind(&self, stripe: &Stripe) -> (f64, f64) {
        let nearest = [self.near_left, self.near_right]
            .map(|point| {
                let foot = stripe.at(stripe.coordinate_of(on_floor(point)));
                point.y - foot.y
            })
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        (nearest, nearest + self.depth)
    }

    /// The size as far as one picture without the stripe can tell: small only if it cannot be large.
    #[must_use]
    pub fn size(&self) -> SizeClass {
        match SizeClass::of(Millimetres::new(narrow(self.greatest_height))) {
            SizeClass::Small => SizeClass::Small,
            SizeClass::Large | SizeClass::Unknown => SizeClass::Unknown,
        }
    }
}

const fn on_floor(point: FloorPoint) -> Vector {
    Vector::new(point.x, point.y, 0.0)
}

/// Camera's place and the direction of a pixel's line of sight, world frame.
fn ray(rig: &Rig, pixel: Pixel) -> Option<(Vector, Vector)> {
    let sight = rig.camera().intrinsics.undistort(pixel)?;
    let pose = &rig.camera().pose;
    let [right, down, forward] = pose.rotation;
    let to_world = |v: Vector| right.scaled(v.x).plus(down.scaled(v.y)).plus(forward.scaled(v.z));
    let direction = to_world(sight);
    let length = direction.dot(direction).sqrt();
    Some((to_world(pose.translation).scaled(-1.0), direction.scaled(1.0 / length)))
}

/// Where a pixel's line of sight meets the floor; `None` if it does not.
fn floor_under(rig: &Rig, pixel: Pixel) -> Option<FloorPoint> {
    let (eye, direction) = ray(rig, pixel)?;
    (direction.z < -LEAST_FALL).then(|| {
        let point = eye.plus(direction.scaled(-eye.z / direction.z));
        FloorPoint { x: point.x, y: point.y }
    })
}

/// Height at which a pixel's line of sight passes over a point of the floor; infinite if it does not come near.
fn height_above(rig: &Rig, place: FloorPoint, pixel: Pixel) -> f64 {
    let Some((eye, direction)) = ray(rig, pixel) else { return f64::INFINITY };
    let (dx, dy) = (place.x - eye.x, place.y - eye.y);
    let reach = direction.x.hypot(direction.y);
    if reach <= 0.0 {
        return f64::INFINITY;
    }
    (eye.z + direction.z * dx.hypot(dy) / reach).max(0.0)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::track::tests::rig;

    /// The box that a camera sees of an upright box standing on the floor.
    pub(crate) fn seen(rig: &Rig, x: (f64, f64), y: (f64, f64), height: f64) -> BoxPixels {
        let mut seen = BoxPixels { left: f64::MAX, top: f64::MAX, right: f64::MIN, bottom: f64::MIN };
        for x in [x.0, x.1] {
            for y in [y.0, y.1] {
                for z in [0.0, height] {
                    let pixel = rig.camera().project(Vector::new(x, y, z)).unwrap();
                    seen.left = seen.left.min(pixel.u);
                    seen.right = seen.right.max(pixel.u);
                    seen.top = seen.top.min(pixel.v);
                    seen.bottom = seen.bottom.max(pixel.v);
                }
            }
        }
        seen
    }

    #[test]
    fn a_flat_thing_is_where_it_lies() {
        let rig = rig();
        let footprint = Footprint::of(&rig, &seen(&rig, (-40.0, 60.0), (480.0, 560.0), 0.0)).unwrap();
        let near = footprint.near();
        assert!((near.y - 480.0).abs() < 1.0 && (footprint.depth - 80.0).abs() < 2.0, "{footprint:?}");
        // The far edge's corners are nearer to the middle of the picture than the near ones.
        assert!((footprint.width() - 100.0).abs() < 12.0, "{footprint:?}");
        let (from, to) = footprint.along(rig.stripe());
        assert!((from + 40.0).abs() < 12.0 && (to - 60.0).abs() < 12.0, "{from} {to}");
        let (near, far) = footprint.behind(rig.stripe());
        assert!((near + 20.0).abs() < 1.5 && (far - 60.0).abs() < 2.5, "{near} {far}");
    }

    #[test]
    fn the_height_is_never_under_reported() {
        let rig = rig();
        for height in [5.0, 20.0, 45.0, 60.0, 150.0] {
            for y in [400.0, 500.0, 650.0] {
                let footprint = Footprint::of(&rig, &seen(&rig, (0.0, 50.0), (y, y + 10.0), height)).unwrap();
                assert!(footprint.greatest_height >= height - 0.5, "{height} {y} {footprint:?}");
                if height >= 50.0 {
                    assert_eq!(footprint.size(), SizeClass::Unknown);
                }
            }
        }
        let low = Footprint::of(&rig, &seen(&rig, (0.0, 50.0), (500.0, 510.0), 10.0)).unwrap();
        assert_eq!(low.size(), SizeClass::Small);
    }

    #[test]
    fn a_box_over_the_horizon_has_no_footprint() {
        let rig = rig();
        let sky = BoxPixels { left: 100.0, right: 200.0, top: -4000.0, bottom: -3000.0 };
        assert_eq!(Footprint::of(&rig, &sky), None);
    }
}
