//! Solid shapes: where a ray meets them, how far a point is from them, and the box around them. World millimetres.

mod meet;

use nearfield_shared::camera::Vector;

use self::meet::{meet_box, meet_capsule, meet_cylinder, meet_ellipsoid};

/// A half-line; the direction need not be of unit length.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Where it begins.
    pub start: Vector,
    /// Where it goes.
    pub direction: Vector,
}

impl Ray {
    /// The point at `along` lengths of the direction.
    #[must_use]
    pub fn at(&self, along: f64) -> Vector {
        self.start.plus(self.direction.scaled(along))
    }
}

/// Where a ray meets a surface.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// In lengths of the ray's direction.
    pub along: f64,
    /// Unit normal, pointing out of the solid.
    pub normal: Vector,
}

/// Hits nearer than this to the ray's start (in lengths of its direction times this) do not count: a surface must not
/// shade itself.
pub const NEAREST_HIT: f64 = 1e-7;

/// A vector of unit length; the zero vector stays zero.
#[must_use]
pub fn normalised(vector: Vector) -> Vector {
    let length = vector.dot(vector).sqrt();
    if length > 0.0 { vector.scaled(1.0 / length) } else { vector }
}

/// Length of a vector.
#[must_use]
pub fn length(vector: Vector) -> f64 {
    vector.dot(vector).sqrt()
}

/// A box parallel to the world's axes around something; used to skip what a ray cannot meet.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// Smallest coordinates.
    pub low: Vector,
    /// Largest coordinates.
    pub high: Vector,
}

impl Bounds {
    /// Around nothing; grows with [`Self::include`].
    pub const EMPTY: Self = Self {
        low: Vector::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        high: Vector::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// Grows to hold a ball.
    pub fn include(&mut self, centre: Vector, reach: Vector) {
        let (a, b) = (centre.minus(reach), centre.plus(reach));
        self.low = Vector::new(self.low.x.min(a.x), self.low.y.min(a.y), self.low.z.min(a.z));
        self.high = Vector::new(self.high.x.max(b.x), self.high.y.max(b.y), self.high.z.max(b.z));
    }

    /// Grows to hold other bounds.
    pub fn merge(&mut self, other: &Self) {
        let half = other.high.minus(other.low).scaled(0.5);
        self.include(other.low.plus(half), half);
    }

    /// True if a point lies inside or within `reach` of it.
    #[must_use]
    pub fn is_within(&self, point: Vector, reach: f64) -> bool {
        self.distance_squared(point) < reach * reach
    }

    /// Square of a point's distance from it, 0 inside.
    #[must_use]
    pub fn distance_squared(&self, point: Vector) -> f64 {
        let beyond = |value: f64, low: f64, high: f64| (low - value).max(value - high).max(0.0);
        let away = Vector::new(
            beyond(point.x, self.low.x, self.high.x),
            beyond(point.y, self.low.y, self.high.y),
            beyond(point.z, self.low.z, self.high.z),
        );
        away.dot(away)
    }

    /// Points on its twelve edges, no two neighbours farther apart than `step`, with all corners.
    pub fn edge_points(&self, step: f64) -> impl Iterator<Item = Vector> {
        /// Ends of the edges by the numbers of the corners (see [`Self::corners`]).
        const EDGES: [(usize, usize); 12] =
            [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];
        let corners = self.corners(0.0);
        EDGES.into_iter().flat_map(move |(from, to)| {
            let way = corners[to].minus(corners[from]);
            let pieces = (length(way) / step).ceil().clamp(1.0, 1000.0) as u32;
            (0..=pieces)
                .map(move |piece| corners[from].plus(way.scaled(f64::from(piece) / f64::from(pieces))))
        })
    }

    /// The eight corners, after growing by `margin` sideways and upwards.
    #[must_use]
    pub fn corners(&self, margin: f64) -> [Vector; 8] {
        let (low, high) = (self.low, self.high);
        let xs = [low.x - margin, high.x + margin];
        let ys = [low.y - margin, high.y + margin];
        let zs = [low.z, high.z + margin];
        std::array::from_fn(|i| Vector::new(xs[i & 1], ys[(i >> 1) & 1], zs[(i >> 2) & 1]))
    }

    /// True if the ray passes through between its start and `farthest` lengths.
    #[must_use]
    pub fn meets(&self, ray: &Ray, farthest: f64) -> bool {
        let mut enter = 0.0_f64;
        let mut leave = farthest;
        for (start, direction, low, high) in [
            (ray.start.x, ray.direction.x, self.low.x, self.high.x),
            (ray.start.y, ray.direction.y, self.low.y, self.high.y),
            (ray.start.z, ray.direction.z, self.low.z, self.high.z),
        ] {
            let (a, b) = ((low - start) / direction, (high - start) / direction);
            // A ray parallel to the slab: NaN or infinities of like sign, which min and max carry through rightly.
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter <= leave
    }
}

/// An orthonormal frame: where a shape's own axes point.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// The shape's centre or base.
    pub origin: Vector,
    /// Its own x, y and z axes in the world.
    pub axes: [Vector; 3],
}

impl Frame {
    /// A point of the world in the shape's own coordinates.
    #[must_use]
    pub fn localise(&self, point: Vector) -> Vector {
        self.localise_direction(point.minus(self.origin))
    }

    /// A direction of the world in the shape's own coordinates.
    #[must_use]
    pub fn localise_direction(&self, direction: Vector) -> Vector {
        let [x, y, z] = self.axes;
        Vector::new(x.dot(direction), y.dot(direction), z.dot(direction))
    }

    /// A direction of the shape's own coordinates in the world.
    #[must_use]
    pub fn globalise(&self, direction: Vector) -> Vector {
        let [x, y, z] = self.axes;
        x.scaled(direction.x).plus(y.scaled(direction.y)).plus(z.scaled(direction.z))
    }
}

/// One convex solid.
#[derive(Debug, Clone, Copy)]
pub enum Primitive {
    /// A box: its centre's frame and its half sizes.
    Box(Frame, Vector),
    /// A cylinder with flat ends: base centre with the axis along the frame's z, radius, length.
    Cylinder(Frame, f64, f64),
    /// All points within a radius of a segment: two ends, radius.
    Capsule(Vector, Vector, f64),
    /// An ellipsoid: its centre's frame and its half axes.
    Ellipsoid(Frame, Vector),
}

impl Primitive {
    /// The nearest place ahead where the ray enters (or, from inside, leaves) the solid.
    #[must_use]
    pub fn meet(&self, ray: &Ray) -> Option<Hit> {
        match self {
            Self::Box(frame, half) => meet_box(frame, *half, ray),
            Self::Cylinder(frame, radius, length) => meet_cylinder(frame, *radius, *length, ray),
            Self::Capsule(a, b, radius) => meet_capsule(*a, *b, *radius, ray),
            Self::Ellipsoid(frame, half) => meet_ellipsoid(frame, *half, ray),
        }
    }

    /// Distance from a point to the surface, negative inside; for the ellipsoid a close underestimate.
    #[must_use]
    pub fn distance(&self, point: Vector) -> f64 {
        match self {
            Self::Box(frame, half) => {
                let p = frame.localise(point);
                let q = Vector::new(p.x.abs() - half.x, p.y.abs() - half.y, p.z.abs() - half.z);
                let outside = Vector::new(q.x.max(0.0), q.y.max(0.0), q.z.max(0.0));
                length(outside) + q.x.max(q.y).max(q.z).min(0.0)
            }
            Self::Cylinder(frame, radius, tall) => {
                let p = frame.localise(point);
                let side = (p.x * p.x + p.y * p.y).sqrt() - radius;
                let end = (p.z - tall / 2.0).abs() - tall / 2.0;
                let (beside, beyond) = (side.max(0.0), end.max(0.0));
                (beside * beside + beyond * beyond).sqrt() + side.max(end).min(0.0)
            }
            Self::Capsule(a, b, radius) => length(point.minus(nearest_on_segment(*a, *b, point))) - radius,
            Self::Ellipsoid(frame, half) => {
                let p = frame.localise(point);
                let scaled = length(Vector::new(p.x / half.x, p.y / half.y, p.z / half.z));
                (scaled - 1.0) * half.x.min(half.y).min(half.z)
            }
        }
    }

    /// The box around it.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        match self {
            Self::Box(frame, half) | Self::Ellipsoid(frame, half) => {
                bounds.include(frame.origin, reach(&frame.axes, [half.x, half.y, half.z]));
            }
            Self::Cylinder(frame, radius, tall) => {
                let [x, y, z] = frame.axes;
                let middle = frame.origin.plus(z.scaled(tall / 2.0));
                bounds.include(middle, reach(&[x, y, z], [*radius, *radius, tall / 2.0]));
            }
            Self::Capsule(a, b, radius) => {
                let ball = Vector::new(*radius, *radius, *radius);
                bounds.include(*a, ball);
                bounds.include(*b, ball);
            }
        }
        bounds
    }
}

fn reach(axes: &[Vector; 3], half: [f64; 3]) -> Vector {
    let mut total = Vector::default();
    for (axis, size) in axes.iter().zip(half) {
        total = total.plus(Vector::new(axis.x.abs(), axis.y.abs(), axis.z.abs()).scaled(size));
    }
    total
}

fn nearest_on_segment(a: Vector, b: Vector, point: Vector) -> Vector {
    let axis = b.minus(a);
    let square = axis.dot(axis);
    let share = if square > 0.0 { (point.minus(a).dot(axis) / square).clamp(0.0, 1.0) } else { 0.0 };
    a.plus(axis.scaled(share))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn turned(origin: Vector, degrees: f64) -> Frame {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let axes =
            [Vector::new(cosine, sine, 0.0), Vector::new(-sine, cosine, 0.0), Vector::new(0.0, 0.0, 1.0)];
        Frame { origin, axes }
    }

    fn solids(x: f64, y: f64, yaw: f64) -> [Primitive; 4] {
        let frame = turned(Vector::new(x, y, 20.0), yaw);
        [
            Primitive::Box(frame, Vector::new(40.0, 25.0, 20.0)),
            Primitive::Cylinder(frame, 18.0, 60.0),
            Primitive::Capsule(Vector::new(x, y, 10.0), Vector::new(x + 50.0, y - 20.0, 30.0), 10.0),
            Primitive::Ellipsoid(frame, Vector::new(40.0, 30.0, 20.0)),
        ]
    }

    proptest! {
        /// Three independent statements about a solid must agree: what the ray meets has distance zero, lies within
        /// the bounds, and before it the ray is outside.
        #[test]
        fn a_ray_stops_exactly_on_the_surface(
            x in -100.0..100.0_f64, y in -100.0..100.0_f64, yaw in 0.0..360.0_f64, aim_x in -60.0..60.0_f64,
            aim_y in -60.0..60.0_f64, aim_z in 0.0..60.0_f64,
        ) {
            let start = Vector::new(300.0, -400.0, 350.0);
            for solid in solids(x, y, yaw) {
                let aim = Vector::new(x + aim_x, y + aim_y, aim_z);
                let ray = Ray { start, direction: aim.minus(start) };
                let walk = |steps: f64| (0..2000).map(move |i| steps * f64::from(i) / 2000.0);
                match solid.meet(&ray) {
                    Some(hit) => {
                        let point = ray.at(hit.along);
                        prop_assert!(solid.distance(point).abs() < 1e-6, "{solid:?} {}", solid.distance(point));
                        prop_assert!((length(hit.normal) - 1.0).abs() < 1e-9);
                        prop_assert!(hit.normal.dot(ray.direction) <= 1e-9, "seen from outside");
                        prop_assert!(solid.distance(point.plus(hit.normal.scaled(0.5))) > 0.0);
                        prop_assert!(solid.bounds().meets(&ray, hit.along + 1e-9));
                        for along in walk(hit.along - 1e-6) {
                            prop_assert!(solid.distance(ray.at(along)) > -1e-7);
                        }
                    }
                    None => for along in walk(3.0) {
                        prop_assert!(solid.distance(ray.at(along)) > -1e-7, "{solid:?} passed through at {along}");
                    },
                }
            }
        }
    }

    #[test]
    fn a_ray_along_a_face_or_pointing_away_meets_nothing() {
        let solid = Primitive::Box(turned(Vector::default(), 0.0), Vector::new(10.0, 10.0, 10.0));
        let away = Ray { start: Vector::new(20.0, 0.0, 0.0), direction: Vector::new(1.0, 0.0, 0.0) };
        assert!(solid.meet(&away).is_none());
        let beside = Ray { start: Vector::new(20.0, 11.0, 0.0), direction: Vector::new(-1.0, 0.0, 0.0) };
        assert!(solid.meet(&beside).is_none());
    }
}
