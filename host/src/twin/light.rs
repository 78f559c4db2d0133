//! Daylight: how bright a point of a surface is under the hall's lamps, with soft contact shadows.

use nearfield_shared::camera::Vector;

use super::body::{FloorAxes, Surface, World};
use super::material::{LinearColour, Material};
use super::scene::Light;
use super::shape::normalised;

/// Contact shadows reach this far, millimetres.
pub const SHADOW_REACH_MM: f64 = 60.0;
/// Heights over the surface at which the open space is probed for the contact shadow, millimetres.
pub const PROBES_MM: [f64; 4] = [4.0, 12.0, 28.0, 56.0];
/// Share of the light that comes evenly from above and around; the rest comes from the main direction.
const EVEN_SHARE: f64 = 0.65;
/// Sine of the main light's height over the horizon.
const MAIN_ELEVATION: f64 = 0.8;
/// Illuminance that exposure 1 is made for, lux.
const REFERENCE_LUX: f64 = 400.0;

/// The light of a scene in the world.
#[derive(Debug, Clone)]
pub struct Daylight {
    axes: FloorAxes,
    level: f64,
    unevenness: f64,
    flat: Vector,
    main: Vector,
}

impl Daylight {
    /// Of a checked scene's light.
    #[must_use]
    pub fn new(axes: FloorAxes, light: &Light) -> Self {
        let (sine, cosine) = light.from_degrees.to_radians().sin_cos();
        let flat = axes.along.scaled(cosine).plus(axes.across.scaled(sine));
        let level_part = (1.0 - MAIN_ELEVATION * MAIN_ELEVATION).sqrt();
        let main = flat.scaled(level_part).plus(Vector::new(0.0, 0.0, MAIN_ELEVATION));
        Self { axes, level: light.lux / REFERENCE_LUX, unevenness: light.unevenness, flat, main }
    }

    /// Light on the open floor, relative to what exposure 1 is made for.
    #[must_use]
    pub fn on_floor(&self, point: Vector) -> f64 {
        let metres = self.flat.dot(point.minus(self.axes.origin)) / 1000.0;
        self.level * (1.0 + self.unevenness * metres).max(0.1)
    }

    /// What the slope of a floor that is not level makes of its light, 1 where it is level.
    #[must_use]
    pub fn on_slope(&self, normal: Vector) -> f64 {
        EVEN_SHARE + (1.0 - EVEN_SHARE) * normal.dot(self.main).max(0.0) / MAIN_ELEVATION
    }

    /// What a surface with this normal sends to the eye.
    #[must_use]
    pub fn on_body(
        &self,
        point: Vector,
        normal: Vector,
        towards_eye: Vector,
        material: &Material,
    ) -> LinearColour {
        let even = EVEN_SHARE * (0.55 + 0.45 * normal.z);
        let main = (1.0 - EVEN_SHARE) * (normal.dot(self.main).max(0.0) / MAIN_ELEVATION);
        let level = self.on_floor(point);
        let shine = if material.gloss > 0.0 {
            let half = normalised(self.main.plus(towards_eye));
            f64::from(material.gloss) * 0.35 * normal.dot(half).max(0.0).powf(f64::from(material.tightness))
        } else {
            0.0
        };
        material.albedo.map(|share| (level * (f64::from(share) * (even + main) + shine)) as f32)
    }
}

/// How much of the open sky a surface near bodies still sees, 1 in the open; from the distance field above it.
#[must_use]
pub fn openness(world: &World, surface: &Surface) -> f64 {
    let probes = PROBES_MM.map(|height| surface.point.plus(surface.normal.scaled(height)));
    let mut free = PROBES_MM;
    world.clearances(surface, SHADOW_REACH_MM, &probes, &PROBES_MM, &mut free);
    share_of_sky(free)
}

/// The share of the sky that is left where these are the distances to the nearest body from the probes.
#[must_use]
#[inline(always)]
pub fn share_of_sky(free: [f64; 4]) -> f64 {
    let mut lost = 0.0;
    let mut weight = 0.30;
    for (height, free) in PROBES_MM.into_iter().zip(free) {
        lost += weight * (height - free.max(0.0)) / height;
        weight *= 0.72;
    }
    (1.0 - lost).clamp(0.15, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery;
    use crate::twin::scene::{MaterialChoice, SceneObject, Shape};

    #[test]
    fn the_floor_darkens_towards_a_box_and_is_open_far_from_it() {
        let axes = FloorAxes::new(&gallery::default_rig());
        let object = SceneObject {
            name: "box".into(),
            shape: Shape::Box { width_mm: 100.0, depth_mm: 100.0, height_mm: 60.0 },
            material: MaterialChoice::named("cardboard"),
            along_mm: 0.0,
            across_mm: 0.0,
            yaw_degrees: 0.0,
            bottom_mm: 0.0,
            velocity_mm_per_s: [0.0; 2],
        };
        let world = World::new(&axes, &[object]).unwrap();
        let up = Vector::new(0.0, 0.0, 1.0);
        let at = |away: f64| {
            let point = axes.place(50.0 + away, 0.0, 0.0);
            openness(&world, &Surface { point, normal: up, body: None, part: None })
        };
        assert!(
            at(1.0) < at(10.0) && at(10.0) < at(40.0) && at(40.0) <= 1.0,
            "{} {} {}",
            at(1.0),
            at(10.0),
            at(40.0)
        );
        assert_eq!(at(100.0), 1.0);
    }

    #[test]
    fn a_level_white_surface_is_as_bright_as_the_floor_beside_it() {
        let axes = FloorAxes::new(&gallery::default_rig());
        let light = Light { lux: 400.0, from_degrees: 30.0, unevenness: 0.0 };
        let daylight = Daylight::new(axes, &light);
        let grey = crate::twin::material::named("grey_card").unwrap();
        let white = Material { albedo: [1.0; 3], laser_albedo: 1.0, ..grey };
        let up = Vector::new(0.0, 0.0, 1.0);
        let seen = daylight.on_body(axes.place(0.0, 0.0, 50.0), up, up, &white);
        assert!((seen[0] - 1.0).abs() < 1e-6 && (daylight.on_floor(axes.origin) - 1.0).abs() < 1e-9);
    }
}
