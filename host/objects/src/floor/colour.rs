//! Colours that floors come in; linear RGB.

use glam::Vec3;

use crate::material::hsv;
use crate::random::Draw;

/// Epoxy resin: grey, green, blue, red, sand.
pub fn epoxy(d: &mut Draw) -> Vec3 {
    match d.weighted(&[3.0, 1.4, 1.2, 0.8, 0.6]) {
        0 => Vec3::splat(d.between(0.12, 0.55)) * Vec3::new(0.97, 1.0, 1.04),
        1 => hsv(d.between(0.36, 0.46), d.between(0.4, 0.8), d.between(0.25, 0.55)),
        2 => hsv(d.between(0.55, 0.63), d.between(0.3, 0.7), d.between(0.3, 0.6)),
        3 => hsv(d.between(0.0, 0.05), d.between(0.5, 0.75), d.between(0.3, 0.55)),
        _ => hsv(d.between(0.10, 0.15), d.between(0.3, 0.6), d.between(0.5, 0.8)),
    }
}

/// Tiles and sheets.
pub fn tile_colour(d: &mut Draw) -> Vec3 {
    if d.chance(0.6) {
        Vec3::splat(d.between(0.12, 0.75)) * Vec3::new(1.03, 1.0, d.between(0.85, 1.0))
    } else {
        hsv(d.between(0.02, 0.6), d.between(0.1, 0.55), d.between(0.25, 0.8))
    }
}

/// Wood.
pub fn wood_colour(d: &mut Draw) -> Vec3 {
    hsv(d.between(0.06, 0.1), d.between(0.25, 0.6), d.between(0.35, 0.85))
}
