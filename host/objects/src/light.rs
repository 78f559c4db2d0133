//! Light of a place: an even or graded surround and lamps with a shape, so that glossy things show them.

use glam::Vec3;

use crate::material::hsv;
use crate::random::Draw;

/// A lamp or window far away: a rectangle of directions.
#[derive(Debug, Clone, Copy)]
pub struct Lamp {
    /// Direction to its middle, unit length.
    pub direction: Vec3,
    across: Vec3,
    along: Vec3,
    half_across: f32,
    half_along: f32,
    /// What it adds to a white matt surface that faces it (albedo 1), linear RGB.
    pub strength: Vec3,
    /// Brightness of the lamp itself, in the same unit.
    radiance: Vec3,
}

impl Lamp {
    fn new(direction: Vec3, half_across: f32, half_along: f32, turn: f32, strength: Vec3) -> Self {
        let (first, second) = direction.any_orthonormal_pair();
        let across = first * turn.cos() + second * turn.sin();
        let solid_angle = 4.0 * half_across * half_along;
        let radiance = strength * std::f32::consts::PI / solid_angle.max(1e-4);
        Self {
            direction,
            across,
            along: direction.cross(across),
            half_across,
            half_along,
            strength,
            radiance,
        }
    }

    /// Half the angle that it fills, rad: how soft its shadows are.
    #[must_use]
    pub fn radius(&self) -> f32 {
        (self.half_across * self.half_along).sqrt()
    }

    /// How much of it a lobe of a roughness sees around a direction.
    fn seen(&self, direction: Vec3, blur: f32) -> Vec3 {
        let facing = direction.dot(self.direction);
        if facing <= 0.05 {
            return Vec3::ZERO;
        }
        let u = direction.dot(self.across) / facing;
        let v = direction.dot(self.along) / facing;
        self.radiance * (smeared(u, self.half_across, blur) * smeared(v, self.half_along, blur))
    }
}

/// The share of a box of half width `half` under a bell curve of width `blur` at `x`.
fn smeared(x: f32, half: f32, blur: f32) -> f32 {
    let step = |t: f32| 1.0 / (1.0 + (-1.7 * t).exp());
    step((x + half) / blur) - step((x - half) / blur)
}

/// The light of a place.
#[derive(Debug, Clone)]
pub struct Light {
    zenith: Vec3,
    horizon: Vec3,
    /// One side may be brighter: direction and strength of the slope.
    slope: Vec3,
    /// The lamps, the strongest first.
    pub lamps: Vec<Lamp>,
    /// What comes from below, where no floor is modelled: set by the scene from the floor's colour.
    pub ground: Vec3,
}

/// A colour temperature from warm (-1) to cold (+1).
fn tint(draw: &mut Draw, spread: f32) -> Vec3 {
    let t = draw.between(-spread, spread);
    Vec3::new(1.0 - 0.18 * t, 1.0, 1.0 + 0.28 * t)
}

fn direction(azimuth: f32, elevation: f32) -> Vec3 {
    Vec3::new(azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin())
}

impl Light {
    /// Light without lamps, about as bright as `level`.
    fn surrounding(draw: &mut Draw, level: f32) -> Self {
        Self {
            zenith: tint(draw, 0.5) * level * draw.between(0.7, 1.4),
            horizon: tint(draw, 0.5) * level * draw.between(0.4, 1.2),
            slope: direction(draw.angle(), 0.0) * draw.between(0.0, 0.5),
            lamps: Vec::new(),
            ground: Vec3::ZERO,
        }
    }

    fn add(&mut self, toward: Vec3, half: (f32, f32), turn: f32, strength: Vec3) {
        self.lamps.push(Lamp::new(toward, half.0, half.1, turn, strength));
    }

    /// A place: office, hall, window, sun, overcast, one lamp, a studio; rarely with a coloured machine lamp.
    pub fn draw(draw: &mut Draw) -> Self {
        let mut light = match draw.weighted(&[2.0, 1.6, 1.2, 1.5, 1.2, 1.0, 1.4]) {
            0 => Self::office(draw),
            1 => Self::hall(draw),
            2 => Self::window(draw),
            3 => Self::sun(draw),
            4 => Self::surrounding(draw, 1.0),
            5 => Self::one_lamp(draw),
            _ => Self::studio(draw),
        };
        if draw.chance(0.06) {
            let strength = hsv(draw.unit(), 0.6, 0.9) * draw.between(0.1, 0.4);
            light.add(direction(draw.angle(), draw.between(0.2, 0.9)), (0.06, 0.06), 0.0, strength);
        }
        light
    }

    /// Panels in the ceiling of an office.
    fn office(draw: &mut Draw) -> Self {
        let mut light = Self::surrounding(draw, 0.45);
        let (turn, count) = (draw.angle(), draw.whole(1, 4));
        for _ in 0..count {
            let toward = direction(draw.angle(), draw.between(0.7, 1.5));
            let strength = tint(draw, 0.3) * draw.between(0.35, 0.8) / count as f32;
            light.add(toward, (draw.between(0.08, 0.2), draw.between(0.1, 0.25)), turn, strength);
        }
        light
    }

    /// Strip lights in a hall.
    fn hall(draw: &mut Draw) -> Self {
        let mut light = Self::surrounding(draw, 0.3);
        let (turn, count, azimuth) = (draw.angle(), draw.whole(2, 5), draw.angle());
        for strip in 0..count {
            let toward = direction(azimuth + 0.4 * strip as f32, draw.between(0.6, 1.5));
            let strength = tint(draw, 0.4) * draw.between(0.4, 0.9) / count as f32;
            light.add(toward, (draw.between(0.015, 0.05), draw.between(0.2, 0.5)), turn, strength);
        }
        light
    }

    /// A window at one side.
    fn window(draw: &mut Draw) -> Self {
        let mut light = Self::surrounding(draw, 0.3);
        let toward = direction(draw.angle(), draw.between(0.25, 0.7));
        let strength = Vec3::new(0.92, 1.0, 1.12) * draw.between(0.5, 1.1);
        let half = (draw.between(0.15, 0.4), draw.between(0.2, 0.5));
        light.add(toward, half, draw.between(-0.1, 0.1), strength);
        light
    }

    /// Sun and sky.
    fn sun(draw: &mut Draw) -> Self {
        let mut light = Self::surrounding(draw, 0.35);
        light.zenith *= Vec3::new(0.8, 0.95, 1.25);
        let toward = direction(draw.angle(), draw.between(0.35, 1.4));
        let radius = draw.between(0.005, 0.04);
        light.add(toward, (radius, radius), 0.0, Vec3::new(1.08, 1.0, 0.88) * draw.between(0.7, 1.5));
        light
    }

    /// One lamp in a dark place.
    fn one_lamp(draw: &mut Draw) -> Self {
        let mut light = Self::surrounding(draw, 0.08);
        let toward = direction(draw.angle(), draw.between(0.4, 1.5));
        let radius = draw.between(0.03, 0.12);
        light.add(toward, (radius, radius), 0.0, tint(draw, 0.9) * draw.between(0.6, 1.1));
        light
    }

    /// A grey surround, a large key light, often a fill light.
    fn studio(draw: &mut Draw) -> Self {
        let mut light = Self::surrounding(draw, 0.35);
        light.slope = Vec3::ZERO;
        light.horizon = light.zenith;
        let azimuth = draw.angle();
        let size = draw.between(0.08, 0.5);
        let key = direction(azimuth, draw.between(0.5, 1.3));
        light.add(key, (size, size), 0.0, tint(draw, 0.3) * draw.between(0.4, 0.9));
        if draw.chance(0.6) {
            let fill = direction(azimuth + draw.between(1.5, 4.0), draw.between(0.3, 1.2));
            light.add(fill, (0.25, 0.25), 0.0, tint(draw, 0.4) * draw.between(0.1, 0.4));
        }
        light
    }

    /// Brightness of the surround in a direction, without the lamps.
    #[must_use]
    pub fn surround(&self, direction: Vec3) -> Vec3 {
        if direction.z < 0.0 {
            let near = (-4.0 * direction.z).min(1.0);
            return self.horizon.lerp(self.ground, near);
        }
        let up = direction.z.sqrt();
        self.horizon.lerp(self.zenith, up) * (1.0 + self.slope.dot(direction))
    }

    /// What a glossy surface of a roughness reflects from a direction: surround and lamps.
    #[must_use]
    pub fn reflected(&self, direction: Vec3, roughness: f32) -> Vec3 {
        let blur = (roughness * roughness * 0.7).max(0.004);
        let lamps: Vec3 = self.lamps.iter().map(|lamp| lamp.seen(direction, blur)).sum();
        // A rough lobe also takes in what is beside: pulled towards the mean.
        let wide = self.surround(direction.lerp(Vec3::Z, 0.4 * roughness).normalize_or(Vec3::Z));
        wide + lamps
    }
}
