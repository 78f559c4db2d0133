//! Light of the stripe that a body throws on what is around it: scattered on all sides, and mirrored by a glossy one.
//!
//! The lit line of every body is cut into pieces of a millimetre, each a small lamp: it scatters its material's share
//! evenly (Lambert) and sends its gloss around the mirrored ray (a normalised Phong lobe). What lies between a lamp and
//! the surface that it lights is not asked; light that bounces twice is left out.

use nearfield_shared::camera::Vector;
use nearfield_shared::rig::Rig;

use super::body::World;
use super::shape::{Ray, length, normalised};
use super::sheet::Sheet;

/// Length of the stripe to one lamp, millimetres.
const PIECE_MM: f64 = 1.0;
/// Light farther from its lamp than this is left out, and fades out before, millimetres: redrawn are only the
/// surroundings of objects.
pub const REACH_MM: f64 = 90.0;
/// A mirrored ray closer to grazing than this lights nothing.
const LEAST_COSINE: f64 = 1e-3;

/// A piece of a lit line.
#[derive(Debug, Clone, Copy)]
struct Lamp {
    point: Vector,
    normal: Vector,
    /// Unit vector in which a mirror would send the laser's light.
    mirrored: Vector,
    /// Light scattered, per steradian and cosine.
    scattered: f64,
    /// Light mirrored, per steradian in the lobe's middle.
    mirrored_light: f64,
    tightness: f64,
}

/// All lamps of a scene.
#[derive(Debug, Clone, Default)]
pub struct Bounce {
    lamps: Vec<Lamp>,
}

impl Bounce {
    /// Follows the laser's rays to the bodies that they light.
    #[must_use]
    pub fn of(rig: &Rig, sheet: &Sheet, world: &World) -> Self {
        let (stripe, origin) = (rig.stripe(), sheet.origin());
        let count = ((stripe.end - stripe.start) / PIECE_MM).max(0.0) as usize;
        let lamps = (0..count).filter_map(|piece| {
            let floor = stripe.at(stripe.start + (piece as f64 + 0.5) * PIECE_MM);
            let towards = floor.minus(origin);
            let ray = normalised(towards);
            let surface = world.trace(&Ray { start: origin, direction: ray })?;
            let material = world.bodies.get(surface.body?)?.material;
            let facing = -ray.dot(surface.normal);
            // The piece's share of the fan: the same wherever the ray ends.
            let sine = (1.0 - ray.dot(stripe.direction).powi(2)).max(0.0).sqrt();
            let power = sheet.line_strength(length(towards)) * PIECE_MM * sine;
            let (gloss, tightness) = (f64::from(material.gloss).min(1.0), f64::from(material.tightness));
            (facing > 0.0).then(|| Lamp {
                point: surface.point,
                normal: surface.normal,
                mirrored: ray.plus(surface.normal.scaled(2.0 * facing)),
                scattered: power * f64::from(material.laser_albedo) / std::f64::consts::PI,
                mirrored_light: power * gloss * (tightness + 1.0) / std::f64::consts::TAU,
                tightness,
            })
        });
        Self { lamps: lamps.collect() }
    }

    /// Light on a surface, in the unit of [`Sheet::irradiance`].
    #[must_use]
    pub fn irradiance(&self, point: Vector, normal: Vector) -> f64 {
        self.lamps.iter().map(|lamp| lamp.on(point, normal)).sum()
    }
}

impl Lamp {
    fn on(&self, point: Vector, normal: Vector) -> f64 {
        let way = point.minus(self.point);
        let square = way.dot(way);
        if square >= REACH_MM * REACH_MM {
            return 0.0;
        }
        let distance = square.sqrt().max(PIECE_MM);
        let direction = way.scaled(1.0 / distance);
        let (leaving, arriving) = (direction.dot(self.normal), -direction.dot(normal));
        if leaving <= LEAST_COSINE || arriving <= LEAST_COSINE {
            return 0.0;
        }
        let along_mirror = direction.dot(self.mirrored);
        let mirrored = if self.mirrored_light > 0.0 && along_mirror > 0.0 {
            self.mirrored_light * along_mirror.powf(self.tightness)
        } else {
            0.0
        };
        let fade = (1.0 - square / (REACH_MM * REACH_MM)).powi(2);
        (self.scattered * leaving + mirrored) * arriving * fade / (distance * distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::body::FloorAxes;
    use crate::twin::gallery;
    use crate::twin::scene::{Look, MaterialChoice, SceneObject, Shape};

    fn bounce(material: &str) -> (Bounce, FloorAxes) {
        let rig = gallery::default_rig();
        let axes = FloorAxes::new(&rig);
        let object = SceneObject {
            name: "box".into(),
            shape: Shape::Box { width_mm: 80.0, depth_mm: 60.0, height_mm: 60.0 },
            material: MaterialChoice::named(material),
            along_mm: 0.0,
            across_mm: 0.0,
            yaw_degrees: 0.0,
            bottom_mm: 0.0,
            velocity_mm_per_s: [0.0; 2],
        };
        let world = World::new(&axes, &[object]).unwrap();
        (Bounce::of(&rig, &Sheet::new(&rig, &Look::default()), &world), axes)
    }

    const UP: Vector = Vector::new(0.0, 0.0, 1.0);

    /// A low laser hits the side that faces the robot; the mirrored sheet goes down to the floor in front of it.
    #[test]
    fn a_polished_side_throws_a_second_stripe_on_the_floor_and_a_matt_one_only_a_glow() {
        // The sheet comes down by 2 in 5 and meets the side 12 mm high: mirrored, it reaches the floor 30 mm before it.
        let light = |material: &str, away: f64| {
            let (bounce, axes) = bounce(material);
            bounce.irradiance(axes.place(0.0, -30.0 - away, 0.0), UP)
        };
        let of_matt = |away: f64| light("steel", away) / light("cardboard", away);
        assert!(of_matt(4.0) < 1.0, "beside the mirrored sheet: {}", of_matt(4.0));
        assert!(of_matt(30.0) > 10.0 * of_matt(4.0), "where it arrives: {}", of_matt(30.0));
        let most = light("steel", 30.0);
        assert!((0.002..0.5).contains(&most), "a share of the stripe's own light: {most}");
    }

    #[test]
    fn nothing_is_thrown_behind_the_body_or_far_away() {
        let (bounce, axes) = bounce("steel");
        assert_eq!(bounce.irradiance(axes.place(0.0, 60.0, 0.0), UP), 0.0, "behind it");
        assert_eq!(bounce.irradiance(axes.place(0.0, -30.0 - REACH_MM - 10.0, 0.0), UP), 0.0, "far away");
        assert_eq!(bounce.irradiance(axes.place(0.0, -40.0, 0.0), UP.scaled(-1.0)), 0.0, "from below");
    }

    /// No more light may leave a body than the laser sends there.
    #[test]
    fn energy_is_not_made() {
        let (bounce, _) = bounce("steel");
        let lamp = bounce.lamps[bounce.lamps.len() / 2];
        let power = lamp.mirrored_light * std::f64::consts::TAU / (lamp.tightness + 1.0)
            + lamp.scattered * std::f64::consts::PI;
        let rig = gallery::default_rig();
        let sheet = Sheet::new(&rig, &Look::default());
        let sent = sheet.line_strength(length(rig.stripe().at(0.0).minus(sheet.origin()))) * PIECE_MM;
        assert!(power <= 1.31 * sent, "gloss 1 on top of 0.3 scattered: {power} of {sent}");
    }
}
