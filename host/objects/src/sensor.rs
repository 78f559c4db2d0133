//! From linear light to a picture: exposure, white balance, tone curve, blur, noise, bloom of the laser.

use glam::Vec3;
use image::{Rgb, RgbImage};

use crate::random::Draw;
use crate::render::Rendering;

/// How a camera turns light into a picture.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    exposure: f32,
    white: Vec3,
    curve: Curve,
    contrast: f32,
    saturation: f32,
    /// Deviation of the blur, pixels.
    blur: f32,
    /// Length and direction of motion, pixels and rad.
    motion: (f32, f32),
    noise: f32,
    colour_noise: f32,
    vignette: f32,
    sharpen: f32,
    laser_colour: Vec3,
    /// Quality of the JPEG file, 1 to 100.
    pub quality: u8,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Curve {
    /// sRGB with a hard end.
    Standard,
    /// A soft shoulder, as of film.
    Film,
}

impl Look {
    /// A camera drawn at random: most are ordinary, some bad.
    pub fn draw(draw: &mut Draw) -> Self {
        let mut white = Vec3::ONE;
        if draw.chance(0.7) {
            white = Vec3::new(1.0 + 0.09 * draw.normal(), 1.0, 1.0 + 0.11 * draw.normal())
                .clamp(Vec3::splat(0.7), Vec3::splat(1.4));
        }
        let noisy = draw.chance(0.6);
        let level = if draw.chance(0.1) { draw.between(0.05, 0.14) } else { draw.octave(0.14, 0.5) };
        Self {
            exposure: level,
            white,
            curve: if draw.chance(0.6) { Curve::Standard } else { Curve::Film },
            contrast: 1.0 + 0.13 * draw.normal().clamp(-2.0, 2.0),
            saturation: draw.between(0.65, 1.25),
            blur: if draw.chance(0.5) { 0.0 } else { draw.between(0.3, 1.3) },
            motion: if draw.chance(0.12) { (draw.between(1.0, 5.0), draw.angle()) } else { (0.0, 0.0) },
            noise: if noisy { draw.octave(0.002, 0.035) } else { 0.0 },
            colour_noise: draw.unit(),
            vignette: if draw.chance(0.4) { draw.between(0.0, 0.4) } else { 0.0 },
            sharpen: if draw.chance(0.35) { draw.between(0.1, 0.8) } else { 0.0 },
            laser_colour: Vec3::new(1.0, draw.between(0.005, 0.09), draw.between(0.01, 0.22)),
            quality: if draw.chance(0.5) { draw.whole(85, 98) as u8 } else { draw.whole(45, 90) as u8 },
        }
    }

    /// A plain camera, for sheets to look at.
    #[must_use]
    pub fn plain() -> Self {
        Self {
            exposure: 0.3,
            white: Vec3::ONE,
            curve: Curve::Standard,
            contrast: 1.0,
            saturation: 1.0,
            blur: 0.0,
            motion: (0.0, 0.0),
            noise: 0.0,
            colour_noise: 0.0,
            vignette: 0.0,
            sharpen: 0.0,
            laser_colour: Vec3::new(1.0, 0.03, 0.08),
            quality: 92,
        }
    }

    /// The picture of a rendering.
    #[must_use]
    pub fn expose(&self, rendering: &Rendering, size: (usize, usize), draw: &mut Draw) -> RgbImage {
        let (width, height) = size;
        let mut plane = rendering.colour.clone();
        // Exposed for the scene without the laser, by the mean of its brightness, bright spots capped.
        let mean = plane.iter().map(|c| c.y.min(1.5)).sum::<f32>() / plane.len().max(1) as f32;
        let gain = self.exposure / mean.max(1e-4);
        for c in &mut plane {
            *c *= gain;
        }
        if !rendering.laser.is_empty() {
            self.add_laser(&mut plane, &rendering.laser, size, draw);
        }
        if self.blur > 0.0 {
            blur(&mut plane, size, self.blur);
        }
        if self.motion.0 > 0.0 {
            plane = self.moved(&plane, size);
        }
        if self.sharpen > 0.0 {
            let mut soft = plane.clone();
            blur(&mut soft, size, 0.9);
            for (c, s) in plane.iter_mut().zip(soft) {
                *c = (*c + (*c - s) * self.sharpen).max(Vec3::ZERO);
            }
        }
        let mut picture = RgbImage::new(width as u32, height as u32);
        let middle = glam::Vec2::new(width as f32 / 2.0, height as f32 / 2.0);
        for (index, pixel) in picture.pixels_mut().enumerate() {
            let at = glam::Vec2::new((index % width) as f32, (index / width) as f32);
            let fall = 1.0 - self.vignette * (at - middle).length_squared() / middle.length_squared();
            let mut c = plane[index] * self.white * fall;
            if self.noise > 0.0 {
                c += self.grain(c, draw);
            }
            let c = self.develop(c);
            *pixel = Rgb((c * 255.0 + 0.5).clamp(Vec3::ZERO, Vec3::splat(255.0)).to_array().map(|v| v as u8));
        }
        picture
    }

    /// Shot noise and read noise; part of it in the colours.
    fn grain(&self, c: Vec3, draw: &mut Draw) -> Vec3 {
        let deviation =
            |v: f32| (self.noise * self.noise * 0.3 + self.noise * 0.12 * v.max(0.0)).sqrt() * 0.8;
        let grey = draw.normal();
        let one = |v: f32, draw: &mut Draw| {
            let own = draw.normal();
            deviation(v) * (own * self.colour_noise + grey * (1.0 - self.colour_noise))
        };
        Vec3::new(one(c.x, draw), one(c.y, draw), one(c.z, draw))
    }

    fn develop(&self, c: Vec3) -> Vec3 {
        let c = c.max(Vec3::ZERO);
        let grey = c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
        let c = (Vec3::splat(grey) + (c - grey) * self.saturation).max(Vec3::ZERO);
        let curved = match self.curve {
            Curve::Standard => c.min(Vec3::ONE),
            // Narkowicz's fit of the ACES curve.
            Curve::Film => {
                let x = c * 0.85;
                (x * (x * 2.51 + 0.03)) / (x * (x * 2.43 + 0.59) + 0.14)
            }
        };
        let encode = |v: f32| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        let display = Vec3::new(encode(curved.x), encode(curved.y), encode(curved.z));
        (display - 0.45) * self.contrast + 0.45
    }

    /// The laser's light with its speckle and its bloom.
    fn add_laser(&self, plane: &mut [Vec3], laser: &[f32], size: (usize, usize), draw: &mut Draw) {
        let speckle = draw.between(0.0, 0.5);
        let mut light: Vec<Vec3> = laser
            .iter()
            .map(|l| {
                let grain = if *l > 0.0 { 1.0 + speckle * draw.normal().clamp(-1.8, 2.5) } else { 1.0 };
                self.laser_colour * (l * grain.max(0.1))
            })
            .collect();
        for (c, l) in plane.iter_mut().zip(&light) {
            *c += *l * 0.8;
        }
        let wide = draw.between(1.5, 5.0);
        blur(&mut light, size, wide);
        let share = draw.between(0.05, 0.3);
        for (c, l) in plane.iter_mut().zip(&light) {
            *c += *l * share;
        }
    }

    fn moved(&self, plane: &[Vec3], (width, height): (usize, usize)) -> Vec<Vec3> {
        const STEPS: usize = 7;
        let along = glam::Vec2::from_angle(self.motion.1) * self.motion.0;
        let mut sum = vec![Vec3::ZERO; plane.len()];
        for step in 0..STEPS {
            let t = step as f32 / (STEPS - 1) as f32 - 0.5;
            let (dx, dy) = ((along.x * t).round() as i64, (along.y * t).round() as i64);
            for y in 0..height {
                let from = (y as i64 + dy).clamp(0, height as i64 - 1) as usize * width;
                for x in 0..width {
                    let column = (x as i64 + dx).clamp(0, width as i64 - 1) as usize;
                    sum[y * width + x] += plane[from + column] / STEPS as f32;
                }
            }
        }
        sum
    }
}

/// Gaussian blur in two passes; `deviation` in pixels.
fn blur(plane: &mut [Vec3], (width, height): (usize, usize), deviation: f32) {
    let reach = (2.5 * deviation).ceil() as usize;
    let weights: Vec<f32> = (0..=reach).map(|i| (-(i as f32 / deviation).powi(2) / 2.0).exp()).collect();
    let total = weights[0] + 2.0 * weights[1..].iter().sum::<f32>();
    let mut line = Vec::new();
    let mut pass = |plane: &mut [Vec3], start: usize, stride: usize, count: usize| {
        line.clear();
        line.extend((0..count).map(|i| plane[start + i * stride]));
        for i in 0..count {
            let mut sum = line[i] * weights[0];
            for (k, w) in weights.iter().enumerate().skip(1) {
                sum += (line[i.saturating_sub(k)] + line[(i + k).min(count - 1)]) * *w;
            }
            plane[start + i * stride] = sum / total;
        }
    };
    for y in 0..height {
        pass(plane, y * width, 1, width);
    }
    for x in 0..width {
        pass(plane, x, width, height);
    }
}
