//! A pinhole camera with a little radial distortion.

use glam::{Vec2, Vec3};

/// A camera above the floor. World: millimetres, z up, floor at z = 0.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    /// Where it is, mm.
    pub position: Vec3,
    forward: Vec3,
    right: Vec3,
    down: Vec3,
    focal: f32,
    distortion: f32,
    /// Size of the picture, pixels.
    pub size: (usize, usize),
}

impl Camera {
    /// A camera at `position` that looks at `target` with the given roll around its axis (rad), focal length (pixels) and
    /// radial distortion (at the picture's half width, as a share).
    #[must_use]
    pub fn new(
        position: Vec3,
        target: Vec3,
        roll: f32,
        focal: f32,
        distortion: f32,
        size: (usize, usize),
    ) -> Self {
        let forward = (target - position).normalize_or(-Vec3::Z);
        let up = if forward.z.abs() > 0.999 { Vec3::Y } else { Vec3::Z };
        let level = forward.cross(up).normalize_or(Vec3::X);
        let below = forward.cross(level);
        let (sin, cos) = roll.sin_cos();
        Self {
            position,
            forward,
            right: level * cos + below * sin,
            down: below * cos - level * sin,
            focal,
            distortion,
            size,
        }
    }

    fn centre(&self) -> Vec2 {
        Vec2::new(self.size.0 as f32 / 2.0, self.size.1 as f32 / 2.0)
    }

    /// The direction of the line of sight of a point of the picture, unit length; (0, 0) is its upper left corner.
    #[must_use]
    pub fn ray(&self, x: f32, y: f32) -> Vec3 {
        let off = Vec2::new(x, y) - self.centre();
        let half = self.size.0 as f32 / 2.0;
        let off = off * (1.0 + self.distortion * off.length_squared() / (half * half));
        (self.forward * self.focal + self.right * off.x + self.down * off.y).normalize()
    }

    /// Where a point of the world appears, without distortion; none behind the camera.
    #[must_use]
    pub fn project(&self, p: Vec3) -> Option<Vec2> {
        let to = p - self.position;
        let depth = to.dot(self.forward);
        if depth < 1.0 {
            return None;
        }
        let flat = Vec2::new(to.dot(self.right), to.dot(self.down)) * (self.focal / depth);
        Some(flat + self.centre())
    }

    /// Size of a pixel per distance, rad.
    #[must_use]
    pub fn spread(&self) -> f32 {
        1.0 / self.focal
    }
}
