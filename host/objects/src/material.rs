//! What a surface is made of, and how use has changed it.

use glam::Vec3;

use crate::noise;
use crate::random::Draw;

/// How the colour of a material varies over it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pattern {
    /// One colour.
    Plain,
    /// Fine lines along x, as of brushing or drawing.
    Brushed,
    /// Skin: redder and paler patches.
    Skin,
    /// Woven: a fine grid of this spacing, mm.
    Woven(f32),
    /// Rings across z of this spacing, mm, in the second colour.
    Rings(f32),
    /// Grain along x in the second colour.
    Grain,
}

/// A material: linear colours, metal or not, roughness, and wear.
#[derive(Debug, Clone, Copy)]
pub struct Material {
    /// Diffuse colour, or for metals the colour of the reflection; linear RGB.
    pub colour: Vec3,
    /// Second colour of the pattern, and what shows where the first is worn off; linear RGB.
    pub second: Vec3,
    /// A metal reflects in its own colour and has no diffuse part.
    pub metal: bool,
    /// Perceptual roughness, 0.03 (mirror) to 1 (chalk).
    pub roughness: f32,
    /// Light that enters and leaves beside: softens the terminator. 0 = stone, 1 = skin, wax.
    pub soft: f32,
    /// Share of the surface that dirt and wear cover, 0 to 1.
    pub wear: f32,
    /// Height of fine bumps relative to their width.
    pub bump: f32,
    /// How the colour varies.
    pub pattern: Pattern,
    /// Seed of the noise.
    pub seed: u32,
}

/// A material at one point.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Linear colour.
    pub colour: Vec3,
    /// Metal or not.
    pub metal: bool,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Softness of the terminator.
    pub soft: f32,
    /// What is added to the normal.
    pub tilt: Vec3,
}

/// A colour from sRGB bytes to linear light.
#[must_use]
pub fn srgb(red: u8, green: u8, blue: u8) -> Vec3 {
    let linear = |byte: u8| {
        let value = f32::from(byte) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    Vec3::new(linear(red), linear(green), linear(blue))
}

/// A colour from hue (turns), saturation and value, to linear light.
#[must_use]
pub fn hsv(hue: f32, saturation: f32, value: f32) -> Vec3 {
    let channel = |offset: f32| {
        let k = (offset + hue * 6.0).rem_euclid(6.0);
        let level = value - value * saturation * k.min(4.0 - k).clamp(0.0, 1.0);
        (level * 255.0).clamp(0.0, 255.0) as u8
    };
    srgb(channel(5.0), channel(3.0), channel(1.0))
}

impl Material {
    fn new(draw: &mut Draw, colour: Vec3, metal: bool, roughness: f32) -> Self {
        let wear = if draw.chance(0.5) { draw.between(0.0, 0.6) } else { draw.between(0.0, 0.12) };
        Self {
            colour,
            second: colour * 0.5,
            metal,
            roughness,
            soft: 0.0,
            wear,
            bump: 0.0,
            pattern: Pattern::Plain,
            seed: draw.seed(),
        }
    }

    /// Bare or plated steel: bright zinc, yellow chromate, stainless, black oxide, brass, copper.
    pub fn fastener(draw: &mut Draw) -> Self {
        let colour = match draw.weighted(&[4.0, 2.5, 1.2, 2.0, 0.8, 0.3]) {
            0 => Vec3::splat(draw.between(0.42, 0.72)) * Vec3::new(0.98, 1.0, 1.03),
            1 => Vec3::splat(draw.between(0.30, 0.55)),
            2 => srgb(206, 178, 98) * draw.between(0.8, 1.1),
            3 => Vec3::splat(draw.between(0.035, 0.11)),
            4 => srgb(222, 176, 92) * draw.between(0.8, 1.1),
            _ => srgb(216, 138, 106),
        };
        let roughness = draw.between(0.16, 0.6);
        let mut material = Self::new(draw, colour, true, roughness);
        material.second = if draw.chance(0.35) { srgb(110, 62, 36) } else { colour * 0.45 };
        material.bump = draw.between(0.0, 0.06);
        material
    }

    /// Chrome or satin tool steel, sometimes black or raw cast iron.
    pub fn tool_steel(draw: &mut Draw) -> Self {
        let (colour, roughness) = match draw.weighted(&[4.0, 2.0, 1.5, 1.0]) {
            0 => (Vec3::splat(draw.between(0.5, 0.78)), draw.between(0.08, 0.28)),
            1 => (Vec3::splat(draw.between(0.4, 0.6)), draw.between(0.3, 0.55)),
            2 => (Vec3::splat(draw.between(0.03, 0.09)), draw.between(0.3, 0.55)),
            _ => (Vec3::splat(draw.between(0.16, 0.32)), draw.between(0.4, 0.7)),
        };
        let mut material = Self::new(draw, colour, true, roughness);
        material.second = if draw.chance(0.25) { srgb(105, 62, 40) } else { colour * 0.5 };
        if draw.chance(0.25) {
            material.pattern = Pattern::Brushed;
        }
        material
    }

    /// Plastic of a given colour, from glossy to matt.
    pub fn plastic(draw: &mut Draw, colour: Vec3) -> Self {
        let roughness = draw.between(0.2, 0.65);
        let mut material = Self::new(draw, colour, false, roughness);
        material.second = colour * 0.6 + Vec3::splat(0.03);
        material.soft = draw.between(0.0, 0.3);
        material
    }

    /// Plastic in one of the colours that tools and cables come in.
    pub fn coloured_plastic(draw: &mut Draw) -> Self {
        let colour = tool_colour(draw);
        Self::plastic(draw, colour)
    }

    /// Rubber, dull.
    pub fn rubber(draw: &mut Draw, colour: Vec3) -> Self {
        let roughness = draw.between(0.6, 0.95);
        let mut material = Self::new(draw, colour, false, roughness);
        material.bump = draw.between(0.0, 0.12);
        material
    }

    /// Bare metal of one colour.
    pub fn metal(draw: &mut Draw, colour: Vec3, roughness: f32) -> Self {
        Self::new(draw, colour, true, roughness)
    }

    /// Cloth or leather of one colour.
    pub fn cloth(draw: &mut Draw, colour: Vec3) -> Self {
        let mut material = Self::new(draw, colour, false, 0.9);
        material.roughness = draw.between(0.7, 1.0);
        material.pattern =
            if draw.chance(0.6) { Pattern::Woven(draw.between(0.8, 2.2)) } else { Pattern::Plain };
        material.bump = draw.between(0.05, 0.25);
        material.second = colour * draw.between(0.6, 0.85);
        material.soft = 0.2;
        material
    }

    /// Human skin, over the range of Fitzpatrick's scale.
    pub fn skin(draw: &mut Draw) -> Self {
        const TONES: [(u8, u8, u8); 9] = [
            (244, 208, 186),
            (232, 190, 165),
            (225, 172, 140),
            (208, 152, 118),
            (186, 128, 94),
            (160, 104, 74),
            (128, 82, 58),
            (98, 62, 45),
            (70, 46, 36),
        ];
        let (red, green, blue) = draw.pick(&TONES);
        let colour = srgb(red, green, blue) * draw.between(0.85, 1.1);
        let roughness = draw.between(0.4, 0.65);
        let mut material = Self::new(draw, colour, false, roughness);
        material.second = colour * Vec3::new(1.05, 0.75, 0.7);
        material.pattern = Pattern::Skin;
        material.soft = draw.between(0.3, 0.6);
        material.bump = draw.between(0.02, 0.12);
        material.wear = if draw.chance(0.2) { draw.between(0.02, 0.2) } else { 0.0 };
        material
    }

    /// The material at a point of the model, mm.
    #[must_use]
    pub fn at(&self, p: Vec3) -> Surface {
        let (mut colour, mut roughness) = (self.colour, self.roughness);
        match self.pattern {
            Pattern::Plain => {}
            Pattern::Brushed => {
                let lines = noise::space(Vec3::new(p.x * 0.15, p.y * 7.0, p.z * 7.0), self.seed);
                colour *= 0.88 + 0.24 * lines;
                roughness *= 0.8 + 0.5 * lines;
            }
            Pattern::Skin => {
                let patch = noise::octaves_in_space(p / 18.0, 3, self.seed);
                colour = colour.lerp(self.second, ((patch - 0.45) * 2.5).clamp(0.0, 0.7));
            }
            Pattern::Woven(spacing) => {
                let turn = std::f32::consts::TAU / spacing;
                let weave = ((p.x + p.z * 0.5) * turn).sin() * ((p.y - p.z * 0.5) * turn).sin();
                colour = colour.lerp(self.second, 0.5 + 0.4 * weave);
            }
            Pattern::Rings(spacing) => {
                if (p.z / spacing).rem_euclid(1.0) < 0.5 {
                    colour = self.second;
                }
            }
            Pattern::Grain => {
                let along = Vec3::new(p.x * 0.02, p.y * 0.25, p.z * 0.25);
                colour = colour.lerp(self.second, noise::octaves_in_space(along, 4, self.seed));
            }
        }
        if self.wear > 0.0 {
            let worn = noise::octaves_in_space(p / 9.0, 4, self.seed ^ 0xA5A5);
            let amount = ((worn - 0.72 + 0.45 * self.wear) * 6.0).clamp(0.0, 1.0) * (0.35 + 0.65 * self.wear);
            colour = colour.lerp(self.second, amount);
            roughness += (0.75 - roughness) * amount * 0.6;
            // A film of dust over everything that lies about.
            colour = colour.lerp(Vec3::splat(0.28), 0.10 * self.wear);
        }
        let tilt = if self.bump > 0.0 { self.tilt_at(p) } else { Vec3::ZERO };
        Surface { colour, metal: self.metal, roughness: roughness.clamp(0.03, 1.0), soft: self.soft, tilt }
    }

    fn tilt_at(&self, p: Vec3) -> Vec3 {
        let q = p / 1.6;
        let sample = |shift: u32| noise::space(q, self.seed.wrapping_add(shift)) - 0.5;
        Vec3::new(sample(11), sample(12), sample(13)) * (2.0 * self.bump)
    }
}

/// A colour that tools, handles and cables come in; linear RGB.
pub fn tool_colour(draw: &mut Draw) -> Vec3 {
    match draw.weighted(&[2.4, 2.0, 1.6, 1.6, 1.2, 1.2, 0.8, 1.0, 0.6, 0.6]) {
        0 => Vec3::splat(draw.between(0.008, 0.035)),
        1 => hsv(draw.between(0.98, 1.02), draw.between(0.75, 0.95), draw.between(0.55, 0.85)),
        2 => hsv(draw.between(0.57, 0.64), draw.between(0.6, 0.95), draw.between(0.3, 0.8)),
        3 => hsv(draw.between(0.11, 0.16), draw.between(0.75, 0.95), draw.between(0.75, 0.95)),
        4 => hsv(draw.between(0.04, 0.08), draw.between(0.8, 1.0), draw.between(0.75, 0.95)),
        5 => hsv(draw.between(0.28, 0.42), draw.between(0.5, 0.9), draw.between(0.3, 0.65)),
        6 => Vec3::splat(draw.between(0.1, 0.35)),
        7 => Vec3::splat(draw.between(0.5, 0.82)),
        8 => hsv(draw.between(0.72, 0.9), draw.between(0.4, 0.8), draw.between(0.4, 0.8)),
        _ => hsv(draw.unit(), draw.between(0.2, 0.95), draw.between(0.2, 0.9)),
    }
}
