//! A model at its place in a scene, with a coarse grid of its distances: far from the surface a ray steps by the grid, and
//! only near it asks the exact shapes.

use glam::{Mat3, Quat, Vec2, Vec3};

use crate::model::Model;

/// Cells along the longest side of the grid.
const CELLS: f32 = 26.0;

/// A grid of distances at the centres of its cells.
#[derive(Debug, Clone)]
struct Grid {
    low: Vec3,
    high: Vec3,
    cell: f32,
    counts: [usize; 3],
    values: Vec<f32>,
}

impl Grid {
    fn cover(model: &Model, low: Vec3, high: Vec3, cell: f32) -> Self {
        let counts = ((high - low) / cell).ceil().max(Vec3::ONE).to_array().map(|n| n as usize);
        let mut values = Vec::with_capacity(counts.iter().product());
        for z in 0..counts[2] {
            for y in 0..counts[1] {
                for x in 0..counts[0] {
                    let centre = low + (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * cell;
                    values.push(model.distance(centre));
                }
            }
        }
        let high = low + Vec3::from_array(counts.map(|n| n as f32)) * cell;
        Self { low, high, cell, counts, values }
    }

    fn centre(&self, index: usize) -> Vec3 {
        let [nx, ny, _] = self.counts;
        let cell = [index % nx, index / nx % ny, index / (nx * ny)].map(|n| n as f32 + 0.5);
        self.low + Vec3::from_array(cell) * self.cell
    }

    /// A cell's centre is at most this far from any of its points.
    fn half_diagonal(&self) -> f32 {
        0.867 * self.cell
    }

    /// The distance at a point of the grid, from the eight centres around it.
    fn blended(&self, p: Vec3) -> f32 {
        let q = ((p - self.low) / self.cell - 0.5).max(Vec3::ZERO);
        let [nx, ny, nz] = self.counts;
        let (x, y, z) = ((q.x as usize).min(nx - 1), (q.y as usize).min(ny - 1), (q.z as usize).min(nz - 1));
        let t = (q - Vec3::new(x as f32, y as f32, z as f32)).min(Vec3::ONE);
        let (dx, dy, dz) =
            (usize::from(x + 1 < nx), usize::from(y + 1 < ny) * nx, usize::from(z + 1 < nz) * nx * ny);
        let base = (z * ny + y) * nx + x;
        let at = |offset: usize| self.values[base + offset];
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let low = mix(mix(at(0), at(dx), t.x), mix(at(dy), at(dy + dx), t.x), t.y);
        let high = mix(mix(at(dz), at(dz + dx), t.x), mix(at(dz + dy), at(dz + dy + dx), t.x), t.y);
        mix(low, high, t.z)
    }

    fn value(&self, p: Vec3) -> f32 {
        let q = (p - self.low) / self.cell;
        let clamp = |v: f32, count: usize| (v.max(0.0) as usize).min(count - 1);
        let [nx, ny, nz] = self.counts;
        let (x, y, z) = (clamp(q.x, nx), clamp(q.y, ny), clamp(q.z, nz));
        self.values[(z * ny + y) * nx + x]
    }
}

/// The smallest box, to a cell, that holds the surface: the loose bounds, narrowed twice.
fn tight_bounds(model: &Model) -> (Vec3, Vec3) {
    let (mut low, mut high) = model.bounds();
    for _ in 0..3 {
        let cell = (high - low).max_element() / 15.0;
        let grid = Grid::cover(model, low, high, cell);
        let (mut least, mut most) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
        for (index, value) in grid.values.iter().enumerate() {
            if *value <= grid.half_diagonal() {
                let centre = grid.centre(index);
                least = least.min(centre - cell * 0.5);
                most = most.max(centre + cell * 0.5);
            }
        }
        if least.x > most.x {
            break;
        }
        (low, high) = (least.max(low), most.min(high));
    }
    (low, high)
}

/// A model at its place.
#[derive(Debug, Clone)]
pub struct Placed {
    /// The model, in its own frame.
    pub model: Model,
    /// Its mean colour, for the light that it throws on others.
    pub colour: Vec3,
    grid: Grid,
    /// Thick enough that the grid alone shows it.
    thick: bool,
    tight: (Vec3, Vec3),
    to_world: Mat3,
    origin: Vec3,
    raised: f32,
    /// Centre of its bounding sphere in the world, mm.
    pub centre: Vec3,
    /// Radius of that sphere, mm.
    pub radius: f32,
}

impl Placed {
    /// Puts a model at `place` on the floor, turned by `yaw` around the vertical, resting on the floor or hanging at its
    /// lift above it.
    #[must_use]
    pub fn new(model: Model, place: Vec2, yaw: f32, tilt: Quat) -> Self {
        let (low, high) = tight_bounds(&model);
        let cell = ((high - low).max_element() / CELLS).max(0.05);
        let grid = Grid::cover(&model, low - 2.0 * cell, high + 2.0 * cell, cell);
        let to_world = Mat3::from_quat(Quat::from_rotation_z(yaw) * tilt * model.rest);
        let colour =
            model.materials.iter().map(|m| m.colour).sum::<Vec3>() / model.materials.len().max(1) as f32;
        let centre = (low + high) / 2.0;
        let deepest = grid.values.iter().copied().fold(0.0, f32::min);
        let mut placed = Self {
            colour,
            thick: deepest < -1.5 * cell,
            radius: (high - low).length() / 2.0,
            origin: Vec3::ZERO,
            raised: 0.0,
            centre: Vec3::ZERO,
            tight: (low, high),
            to_world,
            grid,
            model,
        };
        let flat = to_world * centre;
        let bottom = placed.lowest();
        placed.origin = Vec3::new(place.x - flat.x, place.y - flat.y, placed.model.lift - bottom);
        placed.centre = to_world * centre + placed.origin;
        placed
    }

    /// Moves it to another place on the floor, its lowest point `lift` mm (and its own lift) above it.
    pub fn move_to(&mut self, place: Vec2, lift: f32) {
        let by = place.extend(lift) - self.centre.truncate().extend(self.raised);
        self.raised = lift;
        self.origin += by;
        self.centre += by;
    }

    /// Half the extent of the resting model along x, y and z of the world, mm, from its box.
    #[must_use]
    pub fn half_extent(&self) -> Vec3 {
        let half = (self.tight.1 - self.tight.0) / 2.0;
        let m = self.to_world;
        m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z
    }

    /// The lowest point of the turned model, to about a tenth of a millimetre; dents of crumpled cloth
    /// may reach a hundredth of its size lower.
    fn lowest(&self) -> f32 {
        let height = |p: Vec3| (self.to_world * p).z;
        let reach = self.grid.half_diagonal();
        let near: Vec<Vec3> = (0..self.grid.values.len())
            .filter(|&index| self.grid.values[index].abs() <= reach)
            .map(|index| self.grid.centre(index))
            .collect();
        let floor = near.iter().map(|p| height(*p)).fold(f32::MAX, f32::min);
        let mut lowest = f32::MAX;
        for start in near.iter().filter(|p| height(**p) < floor + 2.0 * self.grid.cell) {
            // A few steps towards the surface.
            let mut p = *start;
            for _ in 0..3 {
                p -= self.model.normal(p, 0.05) * self.model.distance(p);
            }
            if self.model.distance(p).abs() < 0.2 {
                lowest = lowest.min(height(p));
            }
        }
        if lowest == f32::MAX { floor } else { lowest }
    }

    /// A world point in the model's frame.
    #[must_use]
    pub fn local(&self, p: Vec3) -> Vec3 {
        self.to_world.transpose() * (p - self.origin)
    }

    /// A direction of the model's frame in the world.
    #[must_use]
    pub fn turned(&self, direction: Vec3) -> Vec3 {
        self.to_world * direction
    }

    /// The corners of its box in the world.
    pub fn corners(&self) -> impl Iterator<Item = Vec3> + '_ {
        let (low, high) = self.tight;
        (0..8).map(move |bits| {
            let pick = |bit: usize, low: f32, high: f32| if bits & bit == 0 { low } else { high };
            let corner = Vec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z));
            self.to_world * corner + self.origin
        })
    }

    /// A step that never passes through the surface, for a point inside the grid.
    fn step(&self, p: Vec3) -> f32 {
        let far = self.grid.value(p) - self.grid.half_diagonal();
        if far > 0.5 * self.grid.cell { far } else { self.model.distance(p) }
    }

    /// About the distance from a world point, mm: exact near the surface, coarse away from it.
    #[must_use]
    pub fn about(&self, p: Vec3) -> f32 {
        let q = self.local(p);
        let inside = q.clamp(self.grid.low, self.grid.high);
        let beyond = (q - inside).length();
        if beyond > 0.0 {
            return self.grid.value(inside).max(0.0).hypot(beyond);
        }
        let coarse = self.grid.value(q);
        if coarse > 2.0 * self.grid.cell { coarse } else { self.model.distance(q) }
    }

    /// Follows a ray from `from` along the unit vector `toward`. Returns the distance to the surface, and how near it came,
    /// as the least distance per distance travelled.
    #[must_use]
    pub fn trace(&self, from: Vec3, toward: Vec3, spread: f32) -> (Option<f32>, f32) {
        let (origin, along) = (self.local(from), self.to_world.transpose() * toward);
        let Some((mut t, end)) = slab(origin, along, self.grid.low, self.grid.high) else {
            return (None, f32::MAX);
        };
        let mut nearest = f32::MAX;
        for _ in 0..160 {
            let d = self.step(origin + along * t);
            let tolerance = (0.25 * spread * t).max(0.004);
            if d < tolerance {
                return (Some(t), 0.0);
            }
            nearest = nearest.min(d / t.max(1e-3));
            t += d.max(0.5 * tolerance);
            if t > end {
                break;
            }
        }
        (None, nearest)
    }

    /// How much of a cone from `from` towards `toward` stays open: 1 = all, 0 = none. `width` is the tangent of half its
    /// angle.
    #[must_use]
    pub fn open(&self, from: Vec3, toward: Vec3, width: f32) -> f32 {
        // Most cones miss its bounding sphere by far.
        let to = self.centre - from;
        let ahead = to.dot(toward);
        let reach = self.radius + 1.1 * width * ahead.max(0.0);
        if ahead < -self.radius || to.length_squared() - ahead * ahead > reach * reach {
            return 1.0;
        }
        let (origin, along) = (self.local(from), self.to_world.transpose() * toward);
        let pad = Vec3::splat(width * 0.7 * from.distance(self.centre));
        let Some((start, end)) = slab(origin, along, self.grid.low - pad, self.grid.high + pad) else {
            return 1.0;
        };
        let (mut t, mut open) = (start.max(0.6), 1.0_f32);
        // A wide cone is soft: the grid will do, and large steps.
        let wide = width > 0.3;
        let (count, stride) = if wide { (9, 0.9 * width) } else { (40, 0.2 * width) };
        for _ in 0..count {
            let p = origin + along * t;
            let inside = p.clamp(self.grid.low, self.grid.high);
            let beyond = (p - inside).length_squared();
            let d = if beyond > 0.0 {
                (self.grid.value(inside).max(0.0).powi(2) + beyond).sqrt()
            } else if wide && self.thick {
                self.grid.blended(p)
            } else {
                self.step(p)
            };
            open = open.min(0.5 + 0.5 * d / (width * t));
            if open <= 0.03 {
                return 0.0;
            }
            t += d.max(stride * t).max(0.3);
            if t > end {
                break;
            }
        }
        open * open * (3.0 - 2.0 * open)
    }
}

/// Where a ray enters and leaves a box, from 0 on.
fn slab(origin: Vec3, along: Vec3, low: Vec3, high: Vec3) -> Option<(f32, f32)> {
    let inverse = along.recip();
    let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
    let enter = a.min(b).max_element().max(0.0);
    let leave = a.max(b).min_element();
    (enter < leave).then_some((enter, leave))
}
