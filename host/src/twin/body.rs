//! Objects of a scene turned into solids of the world, and what a ray meets among them.

mod build;

use nearfield_shared::camera::Vector;
use nearfield_shared::rig::Rig;

use self::build::build;

use super::material::Material;
use super::relief::Relief;
use super::scene::{SceneError, SceneObject, Shape};
use super::shape::{Bounds, Hit, NEAREST_HIT, Primitive, Ray};

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
    /// The floor's waves; `None` for a level floor.
    relief: Option<Relief>,
}

impl World {
    /// Builds the bodies of a checked scene's objects.
    ///
    /// # Errors
    /// An unknown material.
    pub fn new(axes: &FloorAxes, objects: &[SceneObject]) -> Result<Self, SceneError> {
        Self::on(axes, objects, None)
    }

    /// As [`Self::new`], on a floor that may have waves: every object stands as high as the floor is below its middle.
    ///
    /// # Errors
    /// An unknown material.
    pub fn on(axes: &FloorAxes, objects: &[SceneObject], relief: Option<Relief>) -> Result<Self, SceneError> {
        let body = |object: &SceneObject| match &relief {
            Some(relief) if !matches!(object.shape, Shape::Pit { .. }) => {
                let rise = relief.height(axes.place(object.along_mm, object.across_mm, 0.0));
                Body::new(axes, &SceneObject { bottom_mm: object.bottom_mm + rise, ..object.clone() })
            }
            _ => Body::new(axes, object),
        };
        Ok(Self { bodies: objects.iter().map(body).collect::<Result<_, _>>()?, relief })
    }

    /// A floor without bodies.
    #[must_use]
    pub const fn bare(relief: Option<Relief>) -> Self {
        Self { bodies: Vec::new(), relief }
    }

    /// Has the floor no waves?
    #[must_use]
    pub const fn is_level(&self) -> bool {
        self.relief.is_none()
    }

    /// Distance from a point to a part of a body, negative inside (see [`Primitive::distance`]).
    #[must_use]
    pub fn distance_to(&self, part: PartOfBody, point: Vector) -> f64 {
        let solid = self.bodies.get(part.body).and_then(|body| body.parts.get(part.part));
        solid.map_or(f64::INFINITY, |(solid, _)| solid.distance(point))
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
        if let Some((along, normal)) = self.relief.as_ref().and_then(|relief| relief.meet(ray, along))
            && ray.direction.z < 0.0
            && along > NEAREST_HIT
        {
            return Some((along, Surface { point: ray.at(along), normal, body: None, part: None }));
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

#[cfg(test)]
mod tests;
