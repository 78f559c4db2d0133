//! Shapes as signed distances: negative inside, in millimetres. Each is exact or smaller than the true distance, so a
//! ray that steps by it never passes through a wall. Formulas after Inigo Quilez, "distance functions".

use glam::{Vec2, Vec3, Vec3Swizzles};

/// A shape in its own frame, centred, its axis along z. Lengths in millimetres.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Sphere by radius.
    Sphere(f32),
    /// Ellipsoid by half axes.
    Ellipsoid(Vec3),
    /// Box.
    Cuboid {
        /// Half sizes.
        half: Vec3,
        /// Radius of the edges.
        round: f32,
    },
    /// Cylinder.
    Cylinder {
        /// Radius.
        radius: f32,
        /// Half the height.
        half: f32,
        /// Radius of the edges.
        round: f32,
    },
    /// Frustum of a cone.
    Frustum {
        /// Radius at z = -half.
        low: f32,
        /// Radius at z = +half.
        high: f32,
        /// Half the height.
        half: f32,
        /// Radius of the edges.
        round: f32,
    },
    /// Round-ended stick between two points.
    Stick {
        /// One end.
        from: Vec3,
        /// The other end.
        to: Vec3,
        /// Radius at `from`.
        start: f32,
        /// Radius at `to`.
        end: f32,
    },
    /// Torus in the xy plane.
    Torus {
        /// Radius of the ring.
        ring: f32,
        /// Radius of its tube.
        tube: f32,
    },
    /// Regular prism.
    Prism {
        /// How many sides.
        sides: u32,
        /// Half the width across flats.
        inradius: f32,
        /// Half the height.
        half: f32,
        /// Radius of the edges.
        round: f32,
    },
    /// A polygon extruded along z.
    Extrusion {
        /// Corners in the xy plane, closed by itself.
        outline: Vec<Vec2>,
        /// Half the height.
        half: f32,
        /// Radius of the edges.
        round: f32,
    },
    /// A polygon turned around z.
    Revolution {
        /// Corners as (radius, z), closed by itself.
        outline: Vec<Vec2>,
        /// By how much it is swollen.
        round: f32,
    },
    /// A rope along a curve.
    Rope(Rope),
    /// A strap or bar along a curve in the xy plane.
    Strap {
        /// Points of the curve.
        path: Vec<Vec2>,
        /// What it looks like when cut across.
        section: Section,
    },
    /// Screw thread.
    Thread {
        /// Radius at the bottom of the flanks.
        core: f32,
        /// Height of the flanks.
        depth: f32,
        /// Rise in one turn.
        pitch: f32,
        /// Half the height.
        half: f32,
    },
    /// Cylinder with flutes along its length.
    Fluted {
        /// Radius between the flutes.
        radius: f32,
        /// Depth of the flutes.
        depth: f32,
        /// How many flutes.
        count: u32,
        /// Half the height.
        half: f32,
        /// Radius of the edges.
        round: f32,
    },
}

/// The section of a strap, across its path.
#[derive(Debug, Clone, Copy)]
pub enum Section {
    /// A rectangle.
    Flat {
        /// Half the size in the plane of the path.
        across: f32,
        /// Half the size along z.
        along: f32,
    },
    /// A hexagon by half its width across flats.
    Hexagon(f32),
}

/// A rope along a curve: points with a radius each, in groups with a bounding sphere.
#[derive(Debug, Clone)]
pub struct Rope {
    points: Vec<(Vec3, f32)>,
    groups: Vec<(usize, usize, Vec3, f32)>,
}

/// How many segments share a bounding sphere.
const GROUP: usize = 6;

impl Rope {
    /// A rope through points, each with its radius.
    #[must_use]
    pub fn new(points: Vec<(Vec3, f32)>) -> Self {
        let mut groups = Vec::new();
        let mut start = 0;
        while start + 1 < points.len() {
            let end = (start + GROUP).min(points.len() - 1);
            let members = &points[start..=end];
            let centre = members.iter().map(|m| m.0).sum::<Vec3>() / members.len() as f32;
            let radius = members.iter().map(|m| m.0.distance(centre) + m.1).fold(0.0, f32::max);
            groups.push((start, end, centre, radius));
            start = end;
        }
        Self { points, groups }
    }

    fn distance(&self, p: Vec3) -> f32 {
        let mut best = f32::MAX;
        for &(start, end, centre, radius) in &self.groups {
            if p.distance(centre) - radius >= best {
                continue;
            }
            for pair in self.points[start..=end].windows(2) {
                best = best.min(stick(p, pair[0].0, pair[1].0, pair[0].1, pair[1].1));
            }
        }
        best
    }
}

fn stick(p: Vec3, from: Vec3, to: Vec3, start: f32, end: f32) -> f32 {
    let along = to - from;
    let t = ((p - from).dot(along) / along.length_squared().max(1e-9)).clamp(0.0, 1.0);
    (p - from - along * t).length() - (start + (end - start) * t)
}

/// Distance in the plane from a closed polygon, negative inside.
fn polygon(p: Vec2, outline: &[Vec2]) -> f32 {
    let Some(&last) = outline.last() else { return f32::MAX };
    let (mut nearest, mut inside, mut before) = (f32::MAX, 1.0_f32, last);
    for &corner in outline {
        let edge = before - corner;
        let to = p - corner;
        let off = to - edge * (to.dot(edge) / edge.length_squared().max(1e-9)).clamp(0.0, 1.0);
        nearest = nearest.min(off.length_squared());
        let crosses = [p.y >= corner.y, p.y < before.y, edge.x * to.y > edge.y * to.x];
        if crosses == [true; 3] || crosses == [false; 3] {
            inside = -inside;
        }
        before = corner;
    }
    inside * nearest.sqrt()
}

/// Distance in the plane from an open line through points.
fn polyline(p: Vec2, path: &[Vec2]) -> f32 {
    let mut nearest = f32::MAX;
    for pair in path.windows(2) {
        let (along, to) = (pair[1] - pair[0], p - pair[0]);
        let t = (to.dot(along) / along.length_squared().max(1e-9)).clamp(0.0, 1.0);
        nearest = nearest.min((to - along * t).length_squared());
    }
    nearest.sqrt()
}

/// Joins a distance in a plane and one across it: the extruded solid with rounded edges.
fn extruded(in_plane: f32, z: f32, half: f32, round: f32) -> f32 {
    let w = Vec2::new(in_plane + round, z.abs() - half + round);
    w.max_element().min(0.0) + w.max(Vec2::ZERO).length() - round
}

/// Distance from a frustum, exact.
fn frustum(p: Vec3, low: f32, high: f32, half: f32) -> f32 {
    let q = Vec2::new(p.xy().length(), p.z);
    let (k1, k2) = (Vec2::new(high, half), Vec2::new(high - low, 2.0 * half));
    let cap = Vec2::new(q.x - q.x.min(if q.y < 0.0 { low } else { high }), q.y.abs() - half);
    let side = q - k1 + k2 * ((k1 - q).dot(k2) / k2.length_squared().max(1e-9)).clamp(0.0, 1.0);
    let sign = if side.x < 0.0 && cap.y < 0.0 { -1.0 } else { 1.0 };
    sign * cap.length_squared().min(side.length_squared()).sqrt()
}

impl Shape {
    /// The signed distance from `p`, mm.
    #[must_use]
    pub fn distance(&self, p: Vec3) -> f32 {
        match self {
            Self::Sphere(radius) => p.length() - radius,
            Self::Ellipsoid(half) => {
                let k0 = (p / *half).length();
                let k1 = (p / (*half * *half)).length();
                // Between the bound and the first-order distance: far enough for speed, near enough to be safe.
                if k1 < 1e-9 { -half.min_element() } else { k0 * (k0 - 1.0) / k1 * 0.9 }
            }
            Self::Cuboid { half, round } => {
                let q = p.abs() - *half + Vec3::splat(*round);
                q.max(Vec3::ZERO).length() + q.max_element().min(0.0) - round
            }
            Self::Cylinder { radius, half, round } => extruded(p.xy().length() - radius, p.z, *half, *round),
            Self::Frustum { low, high, half, round } => {
                frustum(p, low - round, high - round, half - round) - round
            }
            Self::Stick { from, to, start, end } => stick(p, *from, *to, *start, *end),
            Self::Torus { ring, tube } => Vec2::new(p.xy().length() - ring, p.z).length() - tube,
            Self::Prism { sides, inradius, half, round } => {
                let sector = std::f32::consts::TAU / *sides as f32;
                let angle = p.y.atan2(p.x);
                let folded = angle - sector * (angle / sector).round();
                extruded(p.xy().length() * folded.cos() - inradius, p.z, *half, *round)
            }
            Self::Extrusion { outline, half, round } => {
                extruded(polygon(p.xy(), outline), p.z, *half, *round)
            }
            Self::Revolution { outline, round } => polygon(Vec2::new(p.xy().length(), p.z), outline) - round,
            Self::Rope(rope) => rope.distance(p),
            Self::Strap { path, section } => {
                let aside = polyline(p.xy(), path);
                match section {
                    Section::Flat { across, along } => extruded(aside - across, p.z, *along, 0.15),
                    Section::Hexagon(inradius) => {
                        let (u, w) = (aside, p.z.abs());
                        w.max(0.866 * u + 0.5 * w) - inradius
                    }
                }
            }
            Self::Thread { core, depth, pitch, half } => {
                let turn = p.y.atan2(p.x) / std::f32::consts::TAU;
                let phase = (p.z / pitch + turn).rem_euclid(1.0);
                let flank = 1.0 - (2.0 * phase - 1.0).abs();
                let side = p.xy().length() - core - depth * flank;
                // A flank of 60 degrees: its gradient is at most 2.
                side.max(p.z.abs() - half) * 0.6
            }
            Self::Fluted { radius, depth, count, half, round } => {
                let wave = (p.y.atan2(p.x) * *count as f32).cos();
                extruded((p.xy().length() - radius + depth * (0.5 + 0.5 * wave)) * 0.8, p.z, *half, *round)
            }
        }
    }

    /// A sphere that holds the shape: centre and radius, mm.
    #[must_use]
    pub fn bound(&self) -> (Vec3, f32) {
        let centred = |radius: f32| (Vec3::ZERO, radius);
        match self {
            Self::Sphere(radius) => centred(*radius),
            Self::Ellipsoid(half) => centred(half.max_element()),
            Self::Cuboid { half, .. } => centred(half.length()),
            Self::Cylinder { radius, half, .. } | Self::Fluted { radius, half, .. } => {
                centred(radius.hypot(*half))
            }
            Self::Frustum { low, high, half, .. } => centred(low.max(*high).hypot(*half)),
            Self::Stick { from, to, start, end } => {
                ((*from + *to) / 2.0, from.distance(*to) / 2.0 + start.max(*end))
            }
            Self::Torus { ring, tube } => centred(ring + tube),
            Self::Prism { sides, inradius, half, .. } => {
                centred((inradius / (std::f32::consts::PI / *sides as f32).cos()).hypot(*half))
            }
            Self::Extrusion { outline, half, .. } => {
                centred(outline.iter().map(|c| c.length()).fold(0.0, f32::max).hypot(*half))
            }
            Self::Revolution { outline, round } => {
                centred(outline.iter().map(|c| c.length()).fold(0.0, f32::max) + round)
            }
            Self::Rope(rope) => {
                let count = rope.points.len().max(1) as f32;
                let centre = rope.points.iter().map(|q| q.0).sum::<Vec3>() / count;
                (centre, rope.points.iter().map(|q| q.0.distance(centre) + q.1).fold(0.0, f32::max))
            }
            Self::Strap { path, section } => {
                let extra = match section {
                    Section::Flat { across, along } => across + along,
                    Section::Hexagon(inradius) => 1.2 * inradius,
                };
                centred(path.iter().map(|q| q.length()).fold(0.0, f32::max) + extra)
            }
            Self::Thread { core, depth, half, .. } => centred((core + depth).hypot(*half)),
        }
    }
}
