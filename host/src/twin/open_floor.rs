//! [`super::light::openness`] of many places of the floor at once: the same numbers to the last bit, several at a time.
//!
//! Around objects most pixels show floor, and their contact shadow was most of the work of moving an object.

use super::body::{Surface, World};
use super::light::{PROBES_MM, SHADOW_REACH_MM, share_of_sky};
use super::shape::{Bounds, Frame, Primitive};
use crate::simd::Kernel;
use nearfield_shared::camera::Vector;

/// Places that are worked on at once.
const LANES: usize = 8;

type Lanes = [f64; LANES];

/// Places on the open floor and how much of the sky each sees.
pub struct OpenFloor<'a> {
    /// What stands on it; pits do not count.
    pub world: &'a World,
    /// The places' coordinates in the world, millimetres; three lists of one length.
    pub places: [&'a [f64]; 3],
    /// The answers, 1 in the open.
    pub open: &'a mut [f32],
}

impl Kernel for OpenFloor<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { world, places: [x, y, z], open } = self;
        let chunks = x.chunks(LANES).zip(y.chunks(LANES)).zip(z.chunks(LANES)).zip(open.chunks_mut(LANES));
        for (((x, y), z), open) in chunks {
            // The last chunk may be shorter: it is filled up with its last place.
            let whole = |from: &[f64]| -> Lanes {
                std::array::from_fn(|lane| from.get(lane).or(from.last()).copied().unwrap_or(0.0))
            };
            let free = clearances(world, &[whole(x), whole(y), whole(z)]);
            for (lane, open) in open.iter_mut().enumerate() {
                *open = share_of_sky(free.map(|probe| probe[lane])) as f32;
            }
        }
    }
}

/// As [`World::clearances`] from places on the floor, straight up.
#[inline(always)]
fn clearances(world: &World, place: &[Lanes; 3]) -> [Lanes; PROBES_MM.len()] {
    let square = SHADOW_REACH_MM * SHADOW_REACH_MM;
    let mut free = PROBES_MM.map(|height| [height; LANES]);
    for (bounds, parts) in world.solids() {
        if least(&distances_squared(bounds, place)) >= square {
            continue;
        }
        for (solid, bounds) in parts {
            let away = distances_squared(bounds, place);
            let nearest = least(&away);
            if nearest >= square {
                continue;
            }
            let is_true = !matches!(solid, Primitive::Ellipsoid(..));
            for (height, free) in PROBES_MM.iter().zip(&mut free) {
                // Farther from the floor's place than it can be from the probe.
                if is_true && nearest > 4.001 * height * height {
                    continue;
                }
                let mut probe = *place;
                probe[2].iter_mut().for_each(|z| *z += height);
                let distance = distances(solid, &probe);
                for lane in 0..LANES {
                    let nearer = free[lane].min(distance[lane]);
                    free[lane] = if away[lane] < square { nearer } else { free[lane] };
                }
            }
        }
    }
    free
}

#[inline(always)]
fn least(values: &Lanes) -> f64 {
    let mut least = values[0];
    for value in values {
        least = if *value < least { *value } else { least };
    }
    least
}

/// [`Bounds::distance_squared`].
#[inline(always)]
fn distances_squared(bounds: &Bounds, [x, y, z]: &[Lanes; 3]) -> Lanes {
    let (low, high) = (bounds.low, bounds.high);
    let mut squares = [0.0; LANES];
    for lane in 0..LANES {
        let beyond = |value: f64, low: f64, high: f64| (low - value).max(value - high).max(0.0);
        let away =
            [beyond(x[lane], low.x, high.x), beyond(y[lane], low.y, high.y), beyond(z[lane], low.z, high.z)];
        squares[lane] = away[0] * away[0] + away[1] * away[1] + away[2] * away[2];
    }
    squares
}

/// [`Primitive::distance`].
#[inline(always)]
fn distances(solid: &Primitive, points: &[Lanes; 3]) -> Lanes {
    let mut distances = [0.0; LANES];
    match solid {
        Primitive::Box(frame, half) => {
            let [x, y, z] = localised(frame, points);
            for lane in 0..LANES {
                let q = [x[lane].abs() - half.x, y[lane].abs() - half.y, z[lane].abs() - half.z];
                let outside = q.map(|q| q.max(0.0));
                distances[lane] = norm(outside) + q[0].max(q[1]).max(q[2]).min(0.0);
            }
        }
        Primitive::Cylinder(frame, radius, tall) => {
            let [x, y, z] = localised(frame, points);
            for lane in 0..LANES {
                let side = (x[lane] * x[lane] + y[lane] * y[lane]).sqrt() - radius;
                let end = (z[lane] - tall / 2.0).abs() - tall / 2.0;
                let (beside, beyond) = (side.max(0.0), end.max(0.0));
                distances[lane] = (beside * beside + beyond * beyond).sqrt() + side.max(end).min(0.0);
            }
        }
        Primitive::Capsule(a, b, radius) => {
            let axis = b.minus(*a);
            let square = axis.x * axis.x + axis.y * axis.y + axis.z * axis.z;
            let [x, y, z] = points;
            for lane in 0..LANES {
                let from = [x[lane] - a.x, y[lane] - a.y, z[lane] - a.z];
                let along = from[0] * axis.x + from[1] * axis.y + from[2] * axis.z;
                let share = if square > 0.0 { (along / square).clamp(0.0, 1.0) } else { 0.0 };
                let nearest = [a.x + axis.x * share, a.y + axis.y * share, a.z + axis.z * share];
                distances[lane] =
                    norm([x[lane] - nearest[0], y[lane] - nearest[1], z[lane] - nearest[2]]) - radius;
            }
        }
        Primitive::Ellipsoid(frame, half) => {
            let [x, y, z] = localised(frame, points);
            let least = half.x.min(half.y).min(half.z);
            for lane in 0..LANES {
                let scaled = norm([x[lane] / half.x, y[lane] / half.y, z[lane] / half.z]);
                distances[lane] = (scaled - 1.0) * least;
            }
        }
    }
    distances
}

#[inline(always)]
fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// [`Frame::localise`].
#[inline(always)]
fn localised(frame: &Frame, [x, y, z]: &[Lanes; 3]) -> [Lanes; 3] {
    let origin = frame.origin;
    let mut local = [[0.0; LANES]; 3];
    for (local, axis) in local.iter_mut().zip(&frame.axes) {
        for lane in 0..LANES {
            let from = [x[lane] - origin.x, y[lane] - origin.y, z[lane] - origin.z];
            local[lane] = axis.x * from[0] + axis.y * from[1] + axis.z * from[2];
        }
    }
    local
}

/// The floor's surface at a place, as a ray from above meets it.
#[must_use]
pub const fn floor_at(point: Vector) -> Surface {
    Surface { point, normal: Vector::new(0.0, 0.0, 1.0), body: None, part: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd;
    use crate::twin::body::FloorAxes;
    use crate::twin::gallery::{self, Theme};
    use crate::twin::light::openness;

    /// Whatever stands there: the quick way gives the numbers of the slow one.
    #[test]
    fn many_places_at_once_are_as_open_as_one_by_one() {
        let rig = gallery::default_rig();
        let axes = FloorAxes::new(&rig);
        let random = (0..40).map(|seed| gallery::random_scene(seed, Theme::Object, rig.stripe()));
        let scenes = ["hand", "box_75_glossy"].into_iter().filter_map(gallery::scene).chain(random);
        let mut shaded = 0;
        for scene in scenes {
            let world = World::new(&axes, &scene.objects).unwrap();
            let points: Vec<Vector> = (0..2003)
                .map(|index| {
                    let (column, row) = (f64::from(index % 50), f64::from(index / 50));
                    axes.place(-300.0 + 12.3 * column, -280.0 + 14.1 * row, 1e-13 * (column - row))
                })
                .collect();
            let list = |part: fn(&Vector) -> f64| points.iter().map(part).collect::<Vec<_>>();
            let (x, y, z) = (list(|p| p.x), list(|p| p.y), list(|p| p.z));
            let mut open = vec![0.0; points.len()];
            simd::run(OpenFloor { world: &world, places: [&x, &y, &z], open: &mut open });
            for (point, open) in points.iter().zip(open) {
                assert_eq!(open, openness(&world, &floor_at(*point)) as f32, "{} at {point:?}", scene.note);
                shaded += usize::from(open < 1.0);
            }
        }
        assert!(shaded > 1000, "only {shaded} places lie near anything");
    }
}
