//! The laser's sheet: a thin fan of light that draws the stripe on whatever it meets.

use glam::Vec3;

/// A sheet of laser light.
#[derive(Debug, Clone, Copy)]
pub struct Laser {
    /// Where it comes from, mm.
    pub origin: Vec3,
    normal: Vec3,
    offset: f32,
    half: f32,
    strength: f32,
}

impl Laser {
    /// The sheet through `origin` that meets the floor in the line through `first` and `second`; `half` is half the width
    /// of the stripe, mm (to 1/e), `strength` its light relative to white under ordinary light.
    #[must_use]
    pub fn new(origin: Vec3, first: Vec3, second: Vec3, half: f32, strength: f32) -> Self {
        let normal = (first - origin).cross(second - origin).normalize_or(Vec3::Y);
        Self { origin, normal, offset: normal.dot(origin), half, strength }
    }

    /// Its light on a point with a normal; `footprint` is the size of a pixel there, mm.
    #[must_use]
    pub fn at(&self, p: Vec3, normal: Vec3, footprint: f32) -> f32 {
        let aside = self.normal.dot(p) - self.offset;
        // Never thinner than a pixel: the same light spread wider.
        let half = self.half.max(0.45 * footprint);
        if aside.abs() > 3.0 * half {
            return 0.0;
        }
        let facing = normal.dot((self.origin - p).normalize_or(Vec3::Z)).max(0.0);
        self.strength * (self.half / half) * (-(aside / half).powi(2)).exp() * (0.25 + 0.75 * facing)
    }
}
