//! Where each column of the line-scan looks, in the frame of reference that ROS uses (REP 103: x forward, y left, z up, metres).
//!
//! The frame lies on the floor at the robot's edge, where the rig's own world lies: its x is the world's y (outward), its y is
//! the world's -x. From its origin the stripe is seen as a scanner would see it: every column of the line-scan watches a range
//! of angles, and the columns' ranges follow each other without a hole.

use std::f64::consts::PI;
use std::ops::Range;

use nearfield_shared::camera::Vector;
use nearfield_shared::columns::{ColumnMap, Decimation, GeometryError, StripeGeometry};
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::rig::{Rig, Stripe};

/// The column maps of line-scans.
pub type Geometry = StripeGeometry<LARGEST_COLUMN_COUNT>;

/// Why a rig has no scan.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FloorError {
    /// The rig's picture does not resolve the stripe.
    #[error("the rig's picture does not resolve the stripe: {0:?}")]
    Geometry(GeometryError),
    /// Seen from the origin, a scan cannot show it.
    #[error(
        "the stripe passes within {NEAREST_MM} mm of the world's origin, or around it: no scan can show it from there; \
         put the rig's world origin at the robot's edge, behind the stripe"
    )]
    AroundOrigin,
}

/// A stripe that passes nearer to the origin is not seen as a scan.
const NEAREST_MM: f64 = 50.0;
/// ... nor one that is seen under a greater angle, radians.
const WIDEST: f64 = 0.97 * PI;

/// See the module's documentation.
#[derive(Debug, Clone)]
pub struct Floor {
    geometry: Box<Geometry>,
    stripe: Stripe,
    /// What the sheet of light moves by in the world for each millimetre of height.
    lean: Vector,
    beams: Vec<Range<usize>>,
    angle_min: f64,
    increment: f64,
    count: usize,
}

/// A point in the ROS frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Forward.
    pub x: f64,
    /// Left.
    pub y: f64,
    /// Up.
    pub z: f64,
}

impl Point {
    /// Of a point in the rig's world, millimetres.
    #[must_use]
    pub fn of(world: Vector) -> Self {
        Self { x: world.y / 1000.0, y: -world.x / 1000.0, z: world.z / 1000.0 }
    }

    /// Counter-clockwise from forward, radians.
    #[must_use]
    pub fn angle(self) -> f64 {
        self.y.atan2(self.x)
    }

    /// Along the floor, metres.
    #[must_use]
    pub fn range(self) -> f64 {
        self.x.hypot(self.y)
    }
}

impl Floor {
    /// Of a rig.
    ///
    /// # Errors
    /// See [`FloorError`].
    pub fn new(rig: &Rig) -> Result<Self, FloorError> {
        let mut geometry = Box::new(Geometry::empty());
        geometry.fill(rig, Decimation::for_line_scan(rig.image().width)).map_err(FloorError::Geometry)?;
        let stripe = *rig.stripe();
        let in_sheet = rig.laser().normal.cross(stripe.direction);
        let lean = in_sheet.scaled(1.0 / in_sheet.z);
        let place = |map: &ColumnMap| Point::of(stripe.at(f64::from(map.floor_place)));
        let places: Vec<Point> = geometry.maps().iter().map(place).collect();
        let is_near = places.iter().any(|place| place.range() * 1000.0 < NEAREST_MM);
        let angles: Vec<f64> = unwrapped(places.iter().map(|place| place.angle()));
        let (edges, angle_min, angle_max) = edges(&angles);
        if is_near || !lean.is_finite() || angles.len() < 2 || angle_max - angle_min > WIDEST {
            return Err(FloorError::AroundOrigin);
        }
        let count = angles.len();
        let increment = (angle_max - angle_min) / (count - 1) as f64;
        let beam = |angle: f64| (angle - angle_min) / increment;
        let beams = edges
            .windows(2)
            .zip(&angles)
            .map(|(edge, angle)| {
                let (low, high) = (edge[0].min(edge[1]), edge[0].max(edge[1]));
                // Half a beam more on each side: what a column watches reaches the beams beside it, too.
                let own = beam(*angle).round();
                let first = (beam(low) - 0.5).ceil().min(own).max(0.0) as usize;
                let last = (beam(high) + 0.5).floor().max(own) as usize;
                first..(last + 1).min(count)
            })
            .collect();
        Ok(Self { geometry, stripe, lean, beams, angle_min, increment, count })
    }

    /// The column maps.
    #[must_use]
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// How many beams a scan has.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.count
    }

    /// First beam and distance from beam to beam, radians.
    #[must_use]
    pub const fn angles(&self) -> (f64, f64) {
        (self.angle_min, self.increment)
    }

    /// The beams that the watched column `index` (in the order of the maps) speaks for.
    #[must_use]
    pub fn beams(&self, index: usize) -> Range<usize> {
        self.beams.get(index).cloned().unwrap_or(0..0)
    }

    /// The beam nearest to a point's angle; `None` = the scan does not look there.
    #[must_use]
    pub fn beam_of(&self, point: Point) -> Option<usize> {
        let from_first = (point.angle() - self.angle_min).rem_euclid(2.0 * PI);
        let beam = (from_first / self.increment).round();
        (beam < self.count as f64).then_some(beam as usize)
    }

    /// Where a column sees the floor.
    #[must_use]
    pub fn on_floor(&self, map: &ColumnMap) -> Point {
        Point::of(self.stripe.at(f64::from(map.floor_place)))
    }

    /// Where the sheet of light is in this column at a height, millimetres; `None` = there is no such point.
    #[must_use]
    pub fn at_height(&self, map: &ColumnMap, height: f32) -> Option<Point> {
        let along = map.floor_place + map.place_per_height * height;
        let point = self.stripe.at(f64::from(along)).plus(self.lean.scaled(f64::from(height)));
        point.is_finite().then(|| Point::of(point))
    }

    /// The farthest watched place of the floor, metres.
    #[must_use]
    pub fn farthest(&self) -> f64 {
        self.geometry.maps().iter().map(|map| self.on_floor(map).range()).fold(0.0, f64::max)
    }
}

/// Angles without jumps by a full turn.
fn unwrapped(angles: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut last: Option<f64> = None;
    angles
        .map(|angle| {
            let angle = last.map_or(angle, |last| last + (angle - last + PI).rem_euclid(2.0 * PI) - PI);
            last = Some(angle);
            angle
        })
        .collect()
}

/// Halfway between neighbours, and as far beyond the ends; then the smallest and the greatest of all.
fn edges(angles: &[f64]) -> (Vec<f64>, f64, f64) {
    let mut edges: Vec<f64> = angles.windows(2).map(|two| f64::midpoint(two[0], two[1])).collect();
    if let (Some(first), Some(last)) = (edges.first().copied(), edges.last().copied()) {
        edges.insert(0, 2.0 * angles[0] - first);
        edges.push(2.0 * angles[angles.len() - 1] - last);
    }
    let (low, high) = edges
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), edge| (low.min(*edge), high.max(*edge)));
    (edges, low, high)
}
