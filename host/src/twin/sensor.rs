//! From light to bytes: the sensor's noise and saturation, the colour matrix and the tone curve of its processor.

use rayon::prelude::*;

use super::material::LinearColour;
use super::picture::Picture;
use super::random::{NoiseTable, scramble};
use super::scene::Look;
use crate::simd::{self, Kernel};

/// From the sensor's own colours to linear sRGB; each row sums to 1 so that grey stays grey. The negative entries are
/// why a pure red laser makes green *darker* on a grey floor, as real cameras show. Shaped after a typical colour
/// matrix for a Bayer sensor at 4000 K (an estimate, not one camera's calibration).
const COLOUR_MATRIX: [[f32; 3]; 3] = [[1.80, -0.70, -0.10], [-0.40, 1.75, -0.35], [0.02, -0.57, 1.55]];
/// What the sensor's red, green and blue pixels see of the laser's deep red.
const LASER_RESPONSE: [f32; 3] = [1.0, 0.10, 0.04];
/// Raw signal per laser irradiance on a white surface at exposure 1, drive 1.
const LASER_STRENGTH: f32 = 17.0;
/// Demosaicing and the processor's noise reduction leave this share of a single pixel's noise.
const NOISE_LEFT: f32 = 0.55;
/// What the sensor gives for darkness in a mosaic, of 65536.
pub const MOSAIC_BLACK: u16 = 4096;
/// Steps of the tone table.
const TONE_STEPS: usize = 4096;

/// Three planes of raw light, row by row; each row holds its red, green and blue values in turn.
#[derive(Debug, Clone, Default)]
pub struct RawPlanes {
    /// `3 * width * height` values at exposure 1.
    pub values: Vec<f32>,
}

/// Light that falls on the sensor at exposure 1: the hall's, and the laser's at full drive.
#[derive(Debug, Clone, Default)]
pub struct Incident {
    /// Daylight.
    pub day: RawPlanes,
    /// The laser's, one value a pixel.
    pub laser: Vec<f32>,
}

impl Incident {
    /// Adds a share of other light; an empty one takes its size.
    pub fn add(&mut self, day: &RawPlanes, laser: &[f32], share: f32) {
        self.day.values.resize(day.values.len(), 0.0);
        self.laser.resize(laser.len(), 0.0);
        let add = |sum: &mut [f32], more: &[f32]| {
            let chunks = sum.par_chunks_mut(1 << 14).zip(more.par_chunks(1 << 14));
            chunks.for_each(|(sum, more)| {
                sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += share * more)
            });
        };
        add(&mut self.day.values, &day.values);
        add(&mut self.laser, laser);
    }

    /// No light; keeps its memory.
    pub fn clear(&mut self) {
        self.day.values.clear();
        self.laser.clear();
    }
}

/// The sensor and its processor.
#[derive(Debug)]
pub struct Sensor {
    tone: Vec<u8>,
    noise: NoiseTable,
    to_raw: [[f32; 3]; 3],
    seed: u64,
}

impl Sensor {
    /// A sensor whose noise follows from the seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let tone = (0..TONE_STEPS).map(|step| to_srgb(step as f32 / (TONE_STEPS - 1) as f32)).collect();
        Self { tone, noise: NoiseTable::new(seed ^ 0x006E_6F69_7365), to_raw: inverse(COLOUR_MATRIX), seed }
    }

    /// Linear sRGB light as the sensor's own colours.
    #[must_use]
    pub fn to_raw(&self, colour: LinearColour) -> LinearColour {
        apply(&self.to_raw, colour)
    }

    /// Takes the picture: daylight and laser light (both at exposure 1) become bytes. `frame` chooses the noise.
    pub fn expose(&self, daylight: &RawPlanes, laser: &[f32], shot: &Shot<'_>, picture: &mut Picture) {
        let width = picture.width;
        picture.rgb.par_chunks_mut(3 * width).enumerate().for_each_init(
            || (vec![0.0_f32; 3 * width], vec![0_u16; 3 * width]),
            |(raw, steps), (row, bytes)| {
                self.expose_row(daylight, laser, shot, row, NOISE_LEFT * shot.scale.clamp(0.1, 1.0), raw);
                self.process(raw, steps, bytes);
            },
        );
    }

    /// As [`Self::expose`], but tells the light of each pixel's own colour before any processing, in the order red green
    /// / green blue, black at [`MOSAIC_BLACK`].
    pub fn expose_mosaic(
        &self,
        daylight: &RawPlanes,
        laser: &[f32],
        shot: &Shot<'_>,
        columns: usize,
        mosaic: &mut [u16],
    ) {
        mosaic.par_chunks_mut(columns).enumerate().for_each_init(
            || vec![0.0_f32; 3 * columns],
            |raw, (row, values)| {
                self.expose_row(daylight, laser, shot, row, 1.0, raw);
                for (column, value) in values.iter_mut().enumerate() {
                    let light = raw[(row % 2 + column % 2) * columns + column];
                    *value = MOSAIC_BLACK + (light * f32::from(u16::MAX - MOSAIC_BLACK)) as u16;
                }
            },
        );
    }

    /// One row's light with the lens's losses and noise; `left` is the share of the noise that is left.
    fn expose_row(
        &self,
        daylight: &RawPlanes,
        laser: &[f32],
        shot: &Shot<'_>,
        row: usize,
        left: f32,
        raw: &mut [f32],
    ) {
        let width = raw.len() / 3;
        raw.copy_from_slice(&daylight.values[3 * width * row..3 * width * (row + 1)]);
        let light = &laser[width * row..width * (row + 1)];
        if shot.look.vignetting > 0.0 {
            let mut light = light.to_vec();
            let height = laser.len() / width.max(1);
            let centre = [width, height].map(|length| (length as f32 - 1.0) / 2.0);
            let farthest = centre[0].powi(2) + centre[1].powi(2);
            for column in 0..width {
                let square = (column as f32 - centre[0]).powi(2) + (row as f32 - centre[1]).powi(2);
                let share = 1.0 - shot.look.vignetting as f32 * square / farthest.max(1.0);
                light[column] *= share;
                (0..3).for_each(|channel| raw[channel * width + column] *= share);
            }
            self.collect(raw, &light, shot, row, left);
        } else {
            self.collect(raw, light, shot, row, left);
        }
    }

    /// Adds laser light and noise to one row, clips it at saturation.
    fn collect(&self, raw: &mut [f32], laser: &[f32], shot: &Shot<'_>, row: usize, left: f32) {
        let look = shot.look;
        let well = (look.full_well_electrons / look.gain) as f32;
        let read = (look.read_noise_electrons as f32 / well).powi(2);
        let exposure = shot.exposure;
        let strength = LASER_STRENGTH * exposure * shot.drive * look.laser_power as f32;
        let width = laser.len();
        let word = scramble(self.seed ^ scramble(shot.frame ^ ((row as u64) << 40)));
        for (channel, plane) in raw.chunks_exact_mut(width).enumerate() {
            let noise = self.noise.stretch(scramble(word ^ channel as u64), width);
            let response = LASER_RESPONSE[channel] * strength;
            simd::run(Collect { plane, laser, noise, exposure, response, well, read, left });
        }
    }

    /// What the laser adds to one pixel's raw red below saturation, and the standard deviation of that red.
    #[must_use]
    pub fn red_light(&self, daylight: f32, laser: f32, shot: &Shot<'_>) -> (f32, f32) {
        let look = shot.look;
        let well = (look.full_well_electrons / look.gain) as f32;
        let read = (look.read_noise_electrons as f32 / well).powi(2);
        let strength = LASER_STRENGTH * shot.exposure * shot.drive * look.laser_power as f32;
        let dark = (daylight * shot.exposure).clamp(0.0, 1.0);
        let lit = (dark + laser * LASER_RESPONSE[0] * strength).min(1.0);
        let left = NOISE_LEFT * shot.scale.clamp(0.1, 1.0);
        (lit - dark, left * (lit / well + read).sqrt())
    }

    /// Colour matrix and tone curve of one row; `steps` is working memory.
    fn process(&self, raw: &[f32], steps: &mut [u16], bytes: &mut [u8]) {
        simd::run(Mix { raw, steps });
        let width = raw.len() / 3;
        let (red, rest) = steps.split_at(width);
        let (green, blue) = rest.split_at(width);
        // A table of this length takes every masked step without a check.
        let Some(tone) = self.tone.first_chunk::<TONE_STEPS>() else { return };
        let tone = |step: &u16| tone[usize::from(*step) % TONE_STEPS];
        for (((pixel, r), g), b) in bytes.chunks_exact_mut(3).zip(red).zip(green).zip(blue) {
            pixel.copy_from_slice(&[tone(r), tone(g), tone(b)]);
        }
    }
}

/// One colour of one row: daylight becomes signal with laser light and noise, clipped at saturation.
struct Collect<'a> {
    plane: &'a mut [f32],
    laser: &'a [f32],
    noise: &'a [f32],
    exposure: f32,
    response: f32,
    well: f32,
    read: f32,
    left: f32,
}

impl Kernel for Collect<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { plane, laser, noise, exposure, response, well, read, left } = self;
        for ((value, light), random) in plane.iter_mut().zip(laser).zip(noise) {
            let signal = *value * exposure + *light * response;
            let deviation = left * (signal.max(0.0) / well + read).sqrt();
            *value = (signal + deviation * random).clamp(0.0, 1.0);
        }
    }
}

/// The colour matrix over one row, as steps of the tone table.
struct Mix<'a> {
    raw: &'a [f32],
    steps: &'a mut [u16],
}

impl Kernel for Mix<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.raw.len() / 3;
        let (red, rest) = self.raw.split_at(width);
        let (green, blue) = rest.split_at(width);
        for (steps, [x, y, z]) in self.steps.chunks_exact_mut(width.max(1)).zip(COLOUR_MATRIX) {
            for (((step, r), g), b) in steps.iter_mut().zip(red).zip(green).zip(blue) {
                let value = x * r + y * g + z * b;
                // `as` saturates; the value lies between the table's ends.
                *step = (value.clamp(0.0, 1.0) * (TONE_STEPS - 1) as f32 + 0.5) as i32 as u16;
            }
        }
    }
}

/// One exposure.
#[derive(Debug, Clone, Copy)]
pub struct Shot<'a> {
    /// The scene's settings.
    pub look: &'a Look,
    /// Exposure (see [`Look::exposure`]), resolved.
    pub exposure: f32,
    /// The laser's brightness command, 0 to 1.
    pub drive: f32,
    /// Number of the frame; chooses the noise.
    pub frame: u64,
    /// This picture's width in widths of the camera's: a picture that was scaled down has averaged its noise.
    pub scale: f32,
}

fn apply(matrix: &[[f32; 3]; 3], [x, y, z]: LinearColour) -> LinearColour {
    matrix.map(|row| row[0] * x + row[1] * y + row[2] * z)
}

/// The inverse of a 3x3 matrix by cofactors.
fn inverse(m: [[f32; 3]; 3]) -> [[f32; 3]; 3] {
    let minor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant = (0..3).map(|c| m[0][c] * minor(0, c)).sum::<f32>();
    std::array::from_fn(|r| std::array::from_fn(|c| minor(c, r) / determinant))
}

/// The sRGB tone curve (IEC 61966-2-1) as a byte.
fn to_srgb(linear: f32) -> u8 {
    let toned = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (toned * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shot(look: &Look) -> Shot<'_> {
        Shot { look, exposure: 1.0, drive: 1.0, frame: 3, scale: 1.0 }
    }

    fn flat(sensor: &Sensor, colour: LinearColour, width: usize, height: usize) -> RawPlanes {
        let raw = sensor.to_raw(colour);
        let row: Vec<f32> = raw.iter().flat_map(|value| vec![*value; width]).collect();
        RawPlanes { values: row.repeat(height) }
    }

    #[test]
    fn colours_come_out_as_they_went_in() {
        let sensor = Sensor::new(1);
        let look = Look { full_well_electrons: 1e6, read_noise_electrons: 0.0, ..Look::default() };
        let mut picture = Picture::black(64, 8);
        sensor.expose(&flat(&sensor, [0.5, 0.2, 0.1], 64, 8), &[0.0; 512], &shot(&look), &mut picture);
        let expected = [188, 124, 89];
        for pixel in picture.rgb.chunks_exact(3) {
            assert!((0..3).all(|c| pixel[c].abs_diff(expected[c]) <= 2), "{pixel:?}");
        }
    }

    #[test]
    fn noise_grows_with_light_as_its_square_root_and_differs_by_frame() {
        let sensor = Sensor::new(1);
        let look = Look::default();
        let deviation = |level: f32| {
            let mut raw = vec![level; 3 * 4096];
            sensor.collect(&mut raw, &[0.0; 4096], &shot(&look), 0, NOISE_LEFT);
            let mean = raw.iter().sum::<f32>() / raw.len() as f32;
            (raw.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / raw.len() as f32).sqrt()
        };
        let ratio = deviation(0.4) / deviation(0.1);
        assert!((ratio - 2.0).abs() < 0.1, "{ratio}");
        let picture = |frame| {
            let mut picture = Picture::black(64, 8);
            let shot = Shot { frame, ..shot(&look) };
            sensor.expose(&flat(&sensor, [0.3; 3], 64, 8), &[0.0; 512], &shot, &mut picture);
            picture
        };
        assert_eq!(picture(1), picture(1));
        assert_ne!(picture(1), picture(2));
    }

    /// The lens loses the stated share in the farthest corner, a quarter of it half-way there, and nothing in the middle.
    #[test]
    fn vignetting_grows_with_the_square_of_the_distance_from_the_middle() {
        let sensor = Sensor::new(1);
        let look =
            Look { vignetting: 0.4, full_well_electrons: 1e6, read_noise_electrons: 0.0, ..Look::default() };
        let (width, height) = (201, 101);
        let mut mosaic = vec![0; width * height];
        let daylight = RawPlanes { values: vec![0.5; 3 * width * height] };
        sensor.expose_mosaic(&daylight, &vec![0.0; width * height], &shot(&look), width, &mut mosaic);
        let light = |column: usize, row: usize| {
            f64::from(mosaic[row * width + column] - MOSAIC_BLACK) / f64::from(u16::MAX - MOSAIC_BLACK)
        };
        for (column, row, share) in [(100, 50, 1.0), (0, 0, 0.6), (200, 100, 0.6), (150, 75, 0.9)] {
            let found = light(column, row) / 0.5;
            assert!((found - share).abs() < 0.02, "{column}, {row}: {found} instead of {share}");
        }
    }

    /// A mosaic has one colour to a pixel, red first, and its noise is a single pixel's: nothing has averaged it.
    #[test]
    fn a_mosaic_tells_each_pixels_own_colour_with_all_of_its_noise() {
        let sensor = Sensor::new(1);
        let look = Look { read_noise_electrons: 0.0, ..Look::default() };
        let (width, height) = (64, 64);
        let row: Vec<f32> = [0.2, 0.4, 0.6].into_iter().flat_map(|level| vec![level; width]).collect();
        let daylight = RawPlanes { values: row.repeat(height) };
        let mut mosaic = vec![0; width * height];
        sensor.expose_mosaic(&daylight, &vec![0.0; width * height], &shot(&look), width, &mut mosaic);
        for (first, level) in [([0, 0], 0.2), ([1, 0], 0.4), ([0, 1], 0.4), ([1, 1], 0.6)] {
            let values: Vec<f64> = (first[1]..height)
                .step_by(2)
                .flat_map(|row| (first[0]..width).step_by(2).map(move |column| row * width + column))
                .map(|at| f64::from(mosaic[at] - MOSAIC_BLACK) / f64::from(u16::MAX - MOSAIC_BLACK))
                .collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let variance =
                values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64;
            assert!((mean - level).abs() < 0.002, "{first:?}: {mean}");
            let electrons = look.full_well_electrons / look.gain;
            assert!(
                (variance.sqrt() / (level / electrons).sqrt() - 1.0).abs() < 0.12,
                "{first:?}: {variance}"
            );
        }
    }

    #[test]
    fn the_laser_reddens_a_grey_floor_and_darkens_its_green() {
        let sensor = Sensor::new(1);
        let look = Look { full_well_electrons: 1e6, ..Look::default() };
        let mut picture = Picture::black(64, 2);
        let laser = [vec![0.0; 64], vec![0.04; 64]].concat();
        sensor.expose(&flat(&sensor, [0.18; 3], 64, 2), &laser, &shot(&look), &mut picture);
        let (dark, lit) = (picture.at(30, 0), picture.at(30, 1));
        assert!(lit[0] > dark[0] + 60 && lit[1] + 20 < dark[1], "{dark:?} {lit:?}");
    }
}
