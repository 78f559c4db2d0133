//! The solids of each kind of object.

use nearfield_shared::camera::Vector;

use super::FloorAxes;
use crate::twin::scene::{SceneObject, Shape};
use crate::twin::shape::{Frame, Primitive};

/// A frame standing at a place of the object's own plan, turned with it.
struct Plan<'a> {
    axes: &'a FloorAxes,
    object: &'a SceneObject,
}

impl Plan<'_> {
    /// The object's own x (width) and y (depth) directions in the world.
    fn directions(&self) -> (Vector, Vector) {
        let (sine, cosine) = self.object.yaw_degrees.to_radians().sin_cos();
        let (along, across) = (self.axes.along, self.axes.across);
        (along.scaled(cosine).plus(across.scaled(sine)), across.scaled(cosine).minus(along.scaled(sine)))
    }

    fn point(&self, x: f64, y: f64, z: f64) -> Vector {
        let (width, depth) = self.directions();
        let origin = self.axes.place(self.object.along_mm, self.object.across_mm, self.object.bottom_mm);
        origin.plus(width.scaled(x)).plus(depth.scaled(y)).plus(Vector::new(0.0, 0.0, z))
    }

    fn upright(&self, x: f64, y: f64, z: f64) -> Frame {
        let (width, depth) = self.directions();
        Frame { origin: self.point(x, y, z), axes: [width, depth, Vector::new(0.0, 0.0, 1.0)] }
    }
}

/// The solids that make up an object, in the world.
pub(super) fn build(axes: &FloorAxes, object: &SceneObject) -> Vec<Primitive> {
    let plan = Plan { axes, object };
    match &object.shape {
        Shape::Box { width_mm, depth_mm, height_mm } => {
            let half = Vector::new(width_mm / 2.0, depth_mm / 2.0, height_mm / 2.0);
            vec![Primitive::Box(plan.upright(0.0, 0.0, half.z), half)]
        }
        Shape::Pit { width_mm, depth_mm, deep_mm } => {
            let half = Vector::new(width_mm / 2.0, depth_mm / 2.0, deep_mm / 2.0);
            vec![Primitive::Box(plan.upright(0.0, 0.0, -half.z - object.bottom_mm), half)]
        }
        Shape::Post { diameter_mm, height_mm } => {
            vec![Primitive::Cylinder(plan.upright(0.0, 0.0, 0.0), diameter_mm / 2.0, *height_mm)]
        }
        Shape::Rod { diameter_mm, length_mm } => {
            let (width, depth) = plan.directions();
            let origin = plan.point(-length_mm / 2.0, 0.0, diameter_mm / 2.0);
            let frame = Frame { origin, axes: [depth, Vector::new(0.0, 0.0, 1.0), width] };
            vec![Primitive::Cylinder(frame, diameter_mm / 2.0, *length_mm)]
        }
        Shape::Cable { diameter_mm, path_mm } => {
            let radius = diameter_mm / 2.0;
            let curve = smooth(path_mm);
            let points: Vec<Vector> = curve.iter().map(|[x, y]| plan.point(*x, *y, radius)).collect();
            points.windows(2).map(|pair| Primitive::Capsule(pair[0], pair[1], radius)).collect()
        }
        Shape::Hand { height_mm } => hand(&plan, *height_mm),
    }
}

/// Steps between two places of a cable's path.
const CURVE_STEPS: u32 = 8;

/// A Catmull-Rom curve through the places.
fn smooth(path: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let at = |index: isize| {
        let last = path.len() as isize - 1;
        path[index.clamp(0, last) as usize]
    };
    let mut curve = Vec::with_capacity(path.len() * CURVE_STEPS as usize);
    for segment in 0..path.len() as isize - 1 {
        let [p0, p1, p2, p3] = [at(segment - 1), at(segment), at(segment + 1), at(segment + 2)];
        for step in 0..CURVE_STEPS {
            let t = f64::from(step) / f64::from(CURVE_STEPS);
            curve.push(std::array::from_fn(|axis| {
                let (a, b, c, d) = (p0[axis], p1[axis], p2[axis], p3[axis]);
                let bend = (2.0 * a - 5.0 * b + 4.0 * c - d) * t + (3.0 * (b - c) + d - a) * t * t;
                0.5 * (2.0 * b + (c - a + bend) * t)
            }));
        }
    }
    curve.push(at(path.len() as isize - 1));
    curve
}

/// A forearm (thickest at the elbow, which is outward), a palm, four fingers and a thumb.
fn hand(plan: &Plan<'_>, height: f64) -> Vec<Primitive> {
    let radius = height / 2.0;
    let finger = 0.16 * height;
    let mut parts = vec![
        Primitive::Capsule(plan.point(0.0, 3.2 * height, radius), plan.point(0.0, 0.0, radius), radius),
        Primitive::Capsule(
            plan.point(0.0, -0.2 * height, 0.44 * height),
            plan.point(0.0, -0.9 * height, 0.40 * height),
            0.40 * height,
        ),
        Primitive::Ellipsoid(
            plan.upright(0.0, -1.15 * height, 0.40 * height),
            Vector::new(0.78 * height, 1.2 * height, 0.40 * height),
        ),
    ];
    for (index, long) in [0.8, 1.0, 1.05, 0.9].into_iter().enumerate() {
        let x = (index as f64 - 1.5) * 0.36 * height;
        let knuckle = plan.point(x, -2.0 * height, 0.30 * height);
        let tip = plan.point(x * 1.15, -(2.0 + 1.1 * long) * height, finger);
        parts.push(Primitive::Capsule(knuckle, tip, finger));
    }
    let thumb =
        [plan.point(0.6 * height, -height, 0.3 * height), plan.point(1.3 * height, -1.9 * height, finger)];
    parts.push(Primitive::Capsule(thumb[0], thumb[1], 1.15 * finger));
    parts
}
