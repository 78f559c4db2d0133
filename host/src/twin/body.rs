//! Objects of a scene turned into solids of the world, and what a ray meets among them.

use nearfield_shared::camera::Vector;
use nearfield_shared::rig::Rig;

use super::material::Material;
use super::scene::{SceneError, SceneObject, Shape};
use super::shape::{Bounds, Frame, Hit, NEAREST_HIT, Primitive, Ray};

/// The floor's own directions: along the stripe, outward across it, up.
#[derive(Debug, Clone, Copy)]
pub struct FloorAxes {
    /// Stripe coordinate 0.
    pub origin: Vector,
    /// Unit vector along the stripe.
    pub along: Vector,
    /// Unit vector across the stripe, away from the laser.
    pub across: Vector,
}

impl FloorAxes {
    /// Of a rig's stripe.
    #[must_use]
    pub fn new(rig: &Rig) -> Self {
        let stripe = rig.stripe();
        let along = stripe.direction;
        let sideways = Vector::new(-along.y, along.x, 0.0);
        let away = stripe.point.minus(rig.laser().origin);
        let across = if sideways.dot(away) < 0.0 { sideways.scaled(-1.0) } else { sideways };
        Self { origin: stripe.point, along, across }
    }

    /// A place of the floor in the world.
    #[must_use]
    pub fn place(&self, along_mm: f64, across_mm: f64, height_mm: f64) -> Vector {
        let floor = self.origin.plus(self.along.scaled(along_mm)).plus(self.across.scaled(across_mm));
        Vector::new(floor.x, floor.y, height_mm)
    }

    /// Along and across of a point of the world.
    #[must_use]
    pub fn coordinates(&self, point: Vector) -> [f64; 2] {
        let from = point.minus(self.origin);
        [self.along.dot(from), self.across.dot(from)]
    }
}

/// One object in the world.
#[derive(Debug, Clone)]
pub struct Body {
    /// Its name in the truth.
    pub name: String,
    /// What it is made of.
    pub material: Material,
    /// True height of its highest point, millimetres; negative for a pit.
    pub height_mm: f64,
    /// The box around it.
    pub bounds: Bounds,
    /// Its parts, each with the box around it; a pit is one box below the floor, seen from within.
    parts: Vec<(Primitive, Bounds)>,
    is_pit: bool,
}

/// What a ray met.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Where.
    pub point: Vector,
    /// Unit normal towards the free side.
    pub normal: Vector,
    /// Which body; `None` is the floor.
    pub body: Option<usize>,
    /// Which part of it; none of the floor and of a pit.
    pub part: Option<PartOfBody>,
}

/// One convex part of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartOfBody {
    body: usize,
    part: usize,
}

/// All bodies of a scene and the floor.
#[derive(Debug, Clone, Default)]
pub struct World {
    /// The bodies, in the scene's order.
    pub bodies: Vec<Body>,
}

impl World {
    /// Builds the bodies of a checked scene's objects.
    ///
    /// # Errors
    /// An unknown material.
    pub fn new(axes: &FloorAxes, objects: &[SceneObject]) -> Result<Self, SceneError> {
        let bodies = objects.iter().map(|object| Body::new(axes, object)).collect::<Result<_, _>>()?;
        Ok(Self { bodies })
    }

    /// The first surface on the ray, the floor included; `None` for the sky.
    #[must_use]
    pub fn trace(&self, ray: &Ray) -> Option<Surface> {
        let solid = self.bodies.iter().enumerate().filter(|(_, body)| !body.is_pit);
        let near = solid.filter(|(_, body)| body.bounds.meets(ray, f64::INFINITY));
        self.trace_parts(
            ray,
            near.flat_map(|(index, body)| {
                (0..body.parts.len()).map(move |part| PartOfBody { body: index, part })
            }),
        )
    }

    /// As [`Self::trace`], where the caller knows that the ray can meet no other solid than these parts, which are in
    /// the order of [`Self::parts`].
    pub fn trace_parts(&self, ray: &Ray, parts: impl Iterator<Item = PartOfBody>) -> Option<Surface> {
        let floor = self.meet_floor(ray);
        let mut nearest = floor.map_or(f64::INFINITY, |(along, _)| along);
        let mut surface = floor.map(|(_, surface)| surface);
        for reference in parts {
            let PartOfBody { body, part } = reference;
            let Some((solid, bounds)) = self.bodies.get(body).and_then(|body| body.parts.get(part)) else {
                continue;
            };
            if bounds.meets(ray, nearest)
                && let Some(hit) = solid.meet(ray)
                && hit.along < nearest
            {
                nearest = hit.along;
                surface = Some(Surface {
                    point: ray.at(hit.along),
                    normal: hit.normal,
                    body: Some(body),
                    part: Some(reference),
                });
            }
        }
        surface
    }

    /// The boxes around all bodies that stand on or over the floor, and their parts.
    pub(super) fn solids(&self) -> impl Iterator<Item = (&Bounds, &[(Primitive, Bounds)])> {
        self.bodies.iter().filter(|body| !body.is_pit).map(|body| (&body.bounds, body.parts.as_slice()))
    }

    /// All parts that stand on or over the floor, with the boxes around them.
    pub fn parts(&self) -> impl Iterator<Item = (PartOfBody, &Bounds)> {
        let solid = self.bodies.iter().enumerate().filter(|(_, body)| !body.is_pit);
        solid.flat_map(|(index, body)| {
            let parts = body.parts.iter().enumerate();
            parts.map(move |(part, (_, bounds))| (PartOfBody { body: index, part }, bounds))
        })
    }

    /// True if anything stands between two points; surfaces at the far end do not count.
    #[must_use]
    pub fn blocked(&self, from: Vector, to: Vector) -> bool {
        /// Share of the way that is left unchecked at the end: 0.02 mm of a metre.
        const END: f64 = 1.0 - 2e-5;
        let ray = Ray { start: from, direction: to.minus(from) };
        if let Some((along, _)) = self.meet_floor(&ray)
            && along < END
        {
            return true;
        }
        self.bodies.iter().any(|body| !body.is_pit && body.meet(&ray, END).is_some())
    }

    /// For each of several points over a surface, along its normal: distance to the nearest body (not the floor), at most
    /// that point's limit, which is what `nearest` holds before. `away` is how far each point lies from the surface; only
    /// parts of bodies within `reach` of it are looked at.
    pub fn clearances<const N: usize>(
        &self,
        surface: &Surface,
        reach: f64,
        points: &[Vector; N],
        away: &[f64; N],
        nearest: &mut [f64; N],
    ) {
        /// Rounding, millimetres.
        const SLACK: f64 = 1e-6;
        let (around, square) = (surface.point, reach * reach);
        for (index, body) in self.bodies.iter().enumerate() {
            if body.is_pit || !body.bounds.is_within(around, reach) {
                continue;
            }
            for (part, (solid, bounds)) in body.parts.iter().enumerate() {
                // The ellipsoid's distance is no true one: less than that to its box.
                let is_true = !matches!(solid, Primitive::Ellipsoid(..));
                let from_here = bounds.distance_squared(around);
                // A convex solid does not come nearer to what leaves it along its normal.
                let is_own = surface.part == Some(PartOfBody { body: index, part });
                if from_here >= square || (is_true && is_own) {
                    continue;
                }
                let from_here = from_here.sqrt();
                for ((point, away), nearest) in points.iter().zip(away).zip(nearest.iter_mut()) {
                    // What is too far from here to be nearer to the point is not asked.
                    if is_true && from_here - away > *nearest + SLACK {
                        continue;
                    }
                    *nearest = nearest.min(solid.distance(*point));
                }
            }
        }
    }

    fn meet_floor(&self, ray: &Ray) -> Option<(f64, Surface)> {
        let along = -ray.start.z / ray.direction.z;
        if along.is_nan() || along <= NEAREST_HIT || !along.is_finite() {
            return None;
        }
        let point = ray.at(along);
        for (index, body) in self.bodies.iter().enumerate().filter(|(_, body)| body.is_pit) {
            let Some((pit, _)) = body.parts.first() else { continue };
            if pit.distance(Vector::new(point.x, point.y, point.z - 1e-6)) < 0.0 {
                // Inside the pit: the ray goes on until it leaves the hollow through a wall or the bottom.
                let inside = Ray { start: point.plus(ray.direction.scaled(1e-9)), direction: ray.direction };
                let hit = pit.meet(&inside)?;
                let far = along + hit.along;
                let normal = hit.normal.scaled(-1.0);
                let surface = Surface { point: ray.at(far), normal, body: Some(index), part: None };
                return Some((far, surface));
            }
        }
        let up = if ray.direction.z < 0.0 { 1.0 } else { -1.0 };
        Some((along, Surface { point, normal: Vector::new(0.0, 0.0, up), body: None, part: None }))
    }
}

impl Body {
    fn new(axes: &FloorAxes, object: &SceneObject) -> Result<Self, SceneError> {
        let material = object.material.resolve().ok_or_else(|| SceneError::Material {
            object: object.name.clone(),
            material: format!("{:?}", object.material),
            known: super::material::MATERIALS.map(|(known, _)| known).join(", "),
        })?;
        let parts: Vec<_> = build(axes, object).into_iter().map(|part| (part, part.bounds())).collect();
        let mut bounds = Bounds::EMPTY;
        parts.iter().for_each(|(_, part)| bounds.merge(part));
        let is_pit = matches!(object.shape, Shape::Pit { .. });
        let height_mm = if is_pit { bounds.low.z } else { bounds.high.z };
        Ok(Self { name: object.name.clone(), material, height_mm, bounds, parts, is_pit })
    }

    /// True for a hole in the floor.
    #[must_use]
    pub const fn is_pit(&self) -> bool {
        self.is_pit
    }

    fn meet(&self, ray: &Ray, farthest: f64) -> Option<Hit> {
        if !self.bounds.meets(ray, farthest) {
            return None;
        }
        let mut nearest: Option<Hit> = None;
        for (part, bounds) in &self.parts {
            let limit = nearest.map_or(farthest, |known| known.along);
            if bounds.meets(ray, limit)
                && let Some(hit) = part.meet(ray)
                && hit.along < limit
            {
                nearest = Some(hit);
            }
        }
        nearest
    }
}

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

fn build(axes: &FloorAxes, object: &SceneObject) -> Vec<Primitive> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery;
    use crate::twin::scene::MaterialChoice;

    fn axes() -> FloorAxes {
        FloorAxes::new(&gallery::default_rig())
    }

    fn object(shape: Shape) -> SceneObject {
        SceneObject {
            name: "thing".into(),
            shape,
            material: MaterialChoice::named("grey_card"),
            along_mm: 20.0,
            across_mm: -30.0,
            yaw_degrees: 25.0,
            bottom_mm: 0.0,
            velocity_mm_per_s: [0.0; 2],
        }
    }

    fn straight_down(axes: &FloorAxes, along: f64, across: f64) -> Ray {
        Ray { start: axes.place(along, across, 900.0), direction: Vector::new(0.0, 0.0, -1.0) }
    }

    #[test]
    fn every_shape_stands_on_the_floor_with_its_stated_height() {
        for (shape, height) in [
            (Shape::Box { width_mm: 80.0, depth_mm: 60.0, height_mm: 45.0 }, 45.0),
            (Shape::Post { diameter_mm: 40.0, height_mm: 160.0 }, 160.0),
            (Shape::Rod { diameter_mm: 22.0, length_mm: 150.0 }, 22.0),
            (Shape::Cable { diameter_mm: 6.0, path_mm: vec![[-50.0, 0.0], [0.0, 10.0], [50.0, 0.0]] }, 6.0),
            (Shape::Pit { width_mm: 100.0, depth_mm: 80.0, deep_mm: 40.0 }, -40.0),
        ] {
            let world = World::new(&axes(), &[object(shape.clone())]).unwrap();
            assert!((world.bodies[0].height_mm - height).abs() < 1e-9, "{shape:?}");
            let across = if matches!(shape, Shape::Cable { .. }) {
                -30.0 + 10.0 * 25.0_f64.to_radians().cos()
            } else {
                -30.0
            };
            let along = if matches!(shape, Shape::Cable { .. }) {
                20.0 - 10.0 * 25.0_f64.to_radians().sin()
            } else {
                20.0
            };
            let hit = world.trace(&straight_down(&axes(), along, across)).unwrap();
            assert!((hit.point.z - height).abs() < 1e-3, "{shape:?}: {}", hit.point.z);
            assert_eq!(hit.body, Some(0));
        }
    }

    #[test]
    fn a_forearm_is_as_high_as_it_says_and_a_palm_lower() {
        let world = World::new(&axes(), &[object(Shape::Hand { height_mm: 52.0 })]).unwrap();
        assert!((world.bodies[0].height_mm - 52.0).abs() < 1e-9);
        assert!(world.bodies[0].bounds.low.z.abs() < 2.0);
    }

    #[test]
    fn across_points_away_from_the_laser() {
        let axes = axes();
        let rig = gallery::default_rig();
        assert!(axes.across.dot(axes.origin.minus(rig.laser().origin)) > 0.0);
        let [along, across] = axes.coordinates(axes.place(12.0, -34.0, 56.0));
        assert!((along - 12.0).abs() < 1e-9 && (across + 34.0).abs() < 1e-9);
    }

    #[test]
    fn light_reaches_a_pit_only_through_its_opening() {
        let pit = object(Shape::Pit { width_mm: 100.0, depth_mm: 80.0, deep_mm: 40.0 });
        let world = World::new(&axes(), &[pit]).unwrap();
        let bottom = axes().place(20.0, -30.0, -40.0);
        assert!(!world.blocked(axes().place(20.0, -30.0, 500.0), bottom));
        assert!(world.blocked(axes().place(700.0, -30.0, 100.0), bottom), "below the rim from a low side");
    }

    #[test]
    fn a_box_blocks_what_lies_behind_it_and_not_itself() {
        let solid = object(Shape::Box { width_mm: 80.0, depth_mm: 60.0, height_mm: 45.0 });
        let world = World::new(&axes(), &[solid]).unwrap();
        let lamp = axes().place(20.0, -500.0, 200.0);
        assert!(world.blocked(lamp, axes().place(20.0, 20.0, 0.0)));
        assert!(!world.blocked(lamp, axes().place(20.0, -30.0, 45.0)), "its own top is lit");
        assert!(!world.blocked(lamp, axes().place(200.0, 20.0, 0.0)), "beside it");
    }
}
