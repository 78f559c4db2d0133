//! Painted lines and hazard bands.

use glam::{Vec2, Vec3};

use super::FloorPoint;
use crate::material::srgb;
use crate::noise;
use crate::random::Draw;

/// A straight painted line, worn in places; lengths in mm.
#[derive(Debug, Clone, Copy)]
pub struct PaintedLine {
    normal: Vec2,
    offset: f32,
    half: f32,
    colour: Vec3,
    hazard: bool,
}

impl PaintedLine {
    /// A line drawn at random.
    pub fn draw(d: &mut Draw) -> Self {
        let colour = d.pick(&[
            srgb(240, 190, 30),
            srgb(240, 190, 30),
            srgb(225, 225, 220),
            srgb(180, 30, 30),
            srgb(40, 90, 170),
        ]);
        let normal = Vec2::from_angle(d.angle());
        Self {
            normal,
            offset: d.between(-160.0, 160.0),
            half: d.between(20.0, 55.0),
            colour,
            hazard: d.chance(0.2),
        }
    }

    /// Paints the floor where the line is.
    pub fn paint(&self, p: Vec2, footprint: f32, seed: u32, point: &mut FloorPoint) {
        let aside = p.dot(self.normal) - self.offset;
        let cover = ((self.half - aside.abs()) / footprint.max(0.5) + 0.5).clamp(0.0, 1.0);
        if cover <= 0.0 {
            return;
        }
        let worn =
            ((noise::octaves(p / 25.0, 4, footprint / 25.0, seed ^ 0x41) - 0.62) * 8.0).clamp(0.0, 1.0);
        let along = p.dot(self.normal.perp()) + aside;
        let black = self.hazard && (along / 80.0).rem_euclid(1.0) < 0.5;
        let paint = if black { Vec3::splat(0.02) } else { self.colour };
        let amount = cover * (1.0 - 0.8 * worn);
        point.colour = point.colour.lerp(paint, amount);
        point.roughness += (0.5 - point.roughness) * amount;
        point.metal &= amount < 0.5;
    }
}
