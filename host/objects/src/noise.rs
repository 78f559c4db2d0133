//! Smooth value noise and its sums, for wear, dirt, grain and cracks.

use glam::{Vec2, Vec3};

/// A hash of a lattice point to [0, 1).
fn lattice(x: i32, y: i32, z: i32, seed: u32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x8DA6_B343)
        ^ (y as u32).wrapping_mul(0xD816_3841)
        ^ (z as u32).wrapping_mul(0xCB1A_B31F)
        ^ seed.wrapping_mul(0x9E37_79B1);
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    ((h ^ (h >> 15)) >> 8) as f32 / (1_u32 << 24) as f32
}

/// A number in [0, 1) that belongs to a cell of a plane lattice.
#[must_use]
pub fn cell(x: i32, y: i32, seed: u32) -> f32 {
    lattice(x, y, 0x51, seed)
}

/// The whole number below, without a call into the mathematics library.
fn below(v: f32) -> i32 {
    let cut = v as i32;
    cut - i32::from(v < cut as f32)
}

fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Value noise in the plane: [0, 1], one bump a unit.
#[must_use]
pub fn plane(p: Vec2, seed: u32) -> f32 {
    let (x, y) = (below(p.x), below(p.y));
    let (tx, ty) = (smooth(p.x - x as f32), smooth(p.y - y as f32));
    let low = mix(lattice(x, y, 0, seed), lattice(x + 1, y, 0, seed), tx);
    let high = mix(lattice(x, y + 1, 0, seed), lattice(x + 1, y + 1, 0, seed), tx);
    mix(low, high, ty)
}

/// Value noise in space: [0, 1], one bump a unit.
#[must_use]
pub fn space(p: Vec3, seed: u32) -> f32 {
    let (x, y, z) = (below(p.x), below(p.y), below(p.z));
    let (tx, ty, tz) = (smooth(p.x - x as f32), smooth(p.y - y as f32), smooth(p.z - z as f32));
    let layer = |z: i32| {
        let low = mix(lattice(x, y, z, seed), lattice(x + 1, y, z, seed), tx);
        let high = mix(lattice(x, y + 1, z, seed), lattice(x + 1, y + 1, z, seed), tx);
        mix(low, high, ty)
    };
    mix(layer(z), layer(z + 1), tz)
}

/// A sum of octaves in the plane, about [0, 1] with mean 0.5. Octaves finer than `footprint` (the size of a pixel, in
/// units of `p`) fade out: they would only shimmer.
#[must_use]
pub fn octaves(p: Vec2, count: u32, footprint: f32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total, mut scale) = (0.0, 0.5, 0.0, 1.0);
    for octave in 0..count {
        let visible = (1.5 - 2.0 * footprint * scale).clamp(0.0, 1.0);
        if visible > 0.0 {
            sum += weight * visible * (plane(p * scale, seed.wrapping_add(octave * 7919)) - 0.5);
        }
        total += weight;
        weight *= 0.5;
        scale *= 2.03;
    }
    0.5 + sum / total
}

/// A sum of octaves in space, about [0, 1] with mean 0.5.
#[must_use]
pub fn octaves_in_space(p: Vec3, count: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total, mut scale) = (0.0, 0.5, 0.0, 1.0);
    for octave in 0..count {
        sum += weight * (space(p * scale, seed.wrapping_add(octave * 7919)) - 0.5);
        total += weight;
        weight *= 0.5;
        scale *= 2.03;
    }
    0.5 + sum / total
}

/// Cells around random points (Worley 1996): the distances to the nearest and the second nearest point, in cells, and a
/// number in [0, 1) that names the nearest.
#[must_use]
pub fn cells(p: Vec2, seed: u32) -> (f32, f32, f32) {
    let (left, low) = (below(p.x), below(p.y));
    let (mut first, mut second, mut name) = (f32::MAX, f32::MAX, 0.0);
    for dy in -1..=1 {
        for dx in -1..=1 {
            let (x, y) = (left + dx, low + dy);
            let point = Vec2::new(x as f32 + lattice(x, y, 1, seed), y as f32 + lattice(x, y, 2, seed));
            let distance = p.distance_squared(point);
            if distance < first {
                (second, first, name) = (first, distance, lattice(x, y, 3, seed));
            } else if distance < second {
                second = distance;
            }
        }
    }
    (first.sqrt(), second.sqrt(), name)
}
