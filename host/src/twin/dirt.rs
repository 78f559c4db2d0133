//! Dirt on the lens's front glass: what it takes from the light that comes through it, and where it sends it.
//!
//! The glass is so near that dirt on it is out of focus: a grain of dust is a soft dim spot, a smear of grease a soft area
//! in which a part of the light is scattered: most of it a little (the picture is blurred there), the rest far (a veil).
//! Nothing is added: every pixel gets at most the light that it got before, or other pixels' light instead of it.

use rayon::prelude::*;

use super::patch::{Patch, gaussian};
use super::random::Dice;
use super::render::{cut, paste};
use super::scene::{Dirt, DirtKind, DirtSpot};
use super::sensor::RawPlanes;
use super::truth::SpotTruth;
use super::view::{PixelRectangle, disjoint};

/// What a smear scatters, it scatters a little: standard deviation in widths of the picture.
const NEAR_REACH: f64 = 0.003;
/// The stripe's light that is scattered far falls off over this, in widths of the picture.
const FAR_REACH: f64 = 0.04;

/// Brighter places give no more than this to the veil, in units of a white surface's light at exposure 1: towards the horizon the
/// model of the hall's light grows without bound, and a real hall ends.
const BRIGHTEST: f32 = 2.0;

/// Shares of the light that a kind of dirt meets, which are scattered a little and far; the rest is lost.
const fn fate(kind: DirtKind) -> (f32, f32) {
    match kind {
        DirtKind::Smudge => (0.55, 0.35),
        DirtKind::Dust => (0.0, 0.15),
    }
}

/// A dirty glass before a picture of one size.
#[derive(Debug, Clone)]
pub struct DirtyGlass {
    width: usize,
    height: usize,
    spots: Vec<DirtSpot>,
    areas: Vec<Area>,
}

/// A rectangle of the picture with dirt before it: shares of light that come straight through, scattered a little, far.
#[derive(Debug, Clone)]
struct Area {
    rectangle: PixelRectangle,
    straight: Vec<f32>,
    near: Vec<f32>,
    far: Vec<f32>,
}

impl DirtyGlass {
    /// A checked scene's dirt; `None` for a clean glass. The same seed gives the same spots for ever.
    #[must_use]
    pub fn new(dirt: &Dirt, width: usize, height: usize, seed: u64) -> Option<Self> {
        let spots = all_spots(dirt, seed);
        if spots.is_empty() {
            return None;
        }
        let rectangles = spots.iter().map(|spot| rectangle_of(spot, width, height)).collect();
        let areas = disjoint(rectangles)
            .into_iter()
            .map(|rectangle| Area::new(rectangle, &spots, width, height))
            .collect();
        Some(Self { width, height, spots, areas })
    }

    /// Sends light through the glass: daylight and the laser's, each with its own veil.
    pub fn dim(&self, day: &mut RawPlanes, laser: &mut [f32]) {
        let veils = [0, 1, 2].map(|channel| self.mean(day, channel));
        let kernel = gaussian(NEAR_REACH * self.width as f64);
        let clean = day.clone();
        for area in &self.areas {
            let around = area.rectangle.grown(kernel.len(), self.width, self.height);
            for (channel, veil) in veils.into_iter().enumerate() {
                let mut near = cut(&clean, channel, around, self.width);
                near.blur(&kernel);
                let mut mixed = cut(&clean, channel, area.rectangle, self.width);
                area.mix(&mut mixed, &near, |_, _| veil);
                paste(day, channel, &mixed, area.rectangle, self.width);
            }
        }
        self.dim_laser(laser, &kernel);
    }

    fn dim_laser(&self, laser: &mut [f32], kernel: &[f32]) {
        let whole = PixelRectangle { left: 0, top: 0, right: self.width, bottom: self.height };
        let clean = Patch { area: whole, values: laser.to_vec() };
        let mut far = clean.clone();
        far.spread(FAR_REACH * self.width as f64);
        for area in &self.areas {
            let mut near = clean.part(area.rectangle.grown(kernel.len(), self.width, self.height));
            near.blur(kernel);
            let mut mixed = clean.part(area.rectangle);
            area.mix(&mut mixed, &near, |column, row| far.values[row * self.width + column]);
            for (line, row) in mixed.values.chunks_exact(mixed.width()).zip(area.rectangle.top..) {
                let start = row * self.width + area.rectangle.left;
                laser[start..start + line.len()].copy_from_slice(line);
            }
        }
    }

    /// Mean of one colour over the picture; summed row by row, so that threads do not change it.
    fn mean(&self, planes: &RawPlanes, channel: usize) -> f32 {
        let rows: Vec<f64> = planes
            .values
            .par_chunks(3 * self.width)
            .map(|row| {
                row[channel * self.width..(channel + 1) * self.width]
                    .iter()
                    .map(|v| f64::from(v.min(BRIGHTEST)))
                    .sum()
            })
            .collect();
        (rows.into_iter().sum::<f64>() / (self.width * self.height) as f64) as f32
    }

    /// The share of the light of a place of the picture that comes straight through.
    #[must_use]
    pub fn straight_at(&self, column: f64, row: f64) -> f64 {
        let place = |value: f64| value.round().max(0.0) as usize;
        let (column, row) = (place(column), place(row));
        let area = self.areas.iter().find(|area| area.rectangle.contains(column, row));
        area.map_or(1.0, |area| {
            let PixelRectangle { left, top, right, .. } = area.rectangle;
            f64::from(area.straight[(row - top) * (right - left) + column - left])
        })
    }

    /// The spots for the truth, in this picture's pixels.
    pub fn truth(&self) -> Vec<SpotTruth> {
        let (width, height) = (self.width as f64, self.height as f64);
        let tell = |spot: &DirtSpot| SpotTruth {
            kind: spot.kind,
            column: spot.at[0] * width,
            row: spot.at[1] * height,
            radius_pixels: spot.radius * width,
            strength: spot.strength,
        };
        self.spots.iter().map(tell).collect()
    }
}

impl Area {
    fn new(rectangle: PixelRectangle, spots: &[DirtSpot], width: usize, height: usize) -> Self {
        let PixelRectangle { left, top, right, bottom } = rectangle;
        let pixels = (right - left) * (bottom - top);
        let mut area =
            Self { rectangle, straight: vec![1.0; pixels], near: vec![0.0; pixels], far: vec![0.0; pixels] };
        for spot in spots {
            let (near, far) = fate(spot.kind);
            let places = (top..bottom).flat_map(|row| (left..right).map(move |column| (column, row)));
            for (index, (column, row)) in places.enumerate() {
                let share = cover(spot, column, row, width, height);
                let met = area.straight[index] * share;
                area.straight[index] -= met;
                area.near[index] += near * met;
                area.far[index] += far * met;
            }
        }
        area
    }

    /// Mixes what comes straight, a little scattered (`near` covers more than this area) and far scattered (`veil` tells it by
    /// column and row).
    fn mix(&self, straight: &mut Patch, near: &Patch, veil: impl Fn(usize, usize) -> f32) {
        let PixelRectangle { left, top, right, .. } = self.rectangle;
        let columns = right - left;
        for (index, value) in straight.values.iter_mut().enumerate() {
            let (column, row) = (index % columns + left, index / columns + top);
            let soft = near.values[(row - near.area.top) * near.width() + column - near.area.left];
            *value =
                self.straight[index] * *value + self.near[index] * soft + self.far[index] * veil(column, row);
        }
    }
}

/// The pixels before which a spot lies.
fn rectangle_of(spot: &DirtSpot, width: usize, height: usize) -> PixelRectangle {
    let radius = spot.radius * width as f64;
    let span = |at: f64, length: usize| {
        let middle = at * length as f64;
        let within = |value: f64| value.clamp(0.0, length as f64) as usize;
        (within((middle - radius).floor()), within((middle + radius).ceil() + 1.0))
    };
    let ((left, right), (top, bottom)) = (span(spot.at[0], width), span(spot.at[1], height));
    PixelRectangle { left, top, right, bottom }
}

/// The share of a pixel's light that meets a spot: its strength in the middle, fading to nothing at its radius.
fn cover(spot: &DirtSpot, column: usize, row: usize, width: usize, height: usize) -> f32 {
    let x = column as f64 - spot.at[0] * width as f64;
    let y = row as f64 - spot.at[1] * height as f64;
    let square = (x * x + y * y) / (spot.radius * width as f64).powi(2);
    (spot.strength * (1.0 - square).max(0.0).powi(2)) as f32
}

/// Those that the scene names and those that follow from its numbers and the seed: a smudge is a stroke of a finger.
fn all_spots(dirt: &Dirt, seed: u64) -> Vec<DirtSpot> {
    let mut dice = Dice::new(seed ^ 0x6469_7274);
    let mut spots = dirt.spots.clone();
    for _ in 0..dirt.smudges {
        let at = [dice.between(0.0, 1.0), dice.between(0.0, 1.0)];
        let radius = dice.between(0.03, 0.08);
        let strength = dirt.strength * dice.between(0.6, 1.0);
        let (sine, cosine) = dice.between(0.0, std::f64::consts::TAU).sin_cos();
        for step in [-0.8, 0.0, 0.8] {
            // Heights are counted in shares of the picture's height; strokes are not quite straight on wide pictures.
            let at = [at[0] + step * radius * cosine, at[1] + step * radius * sine];
            spots.push(DirtSpot { kind: DirtKind::Smudge, at, radius, strength });
        }
    }
    for _ in 0..dirt.dust {
        let at = [dice.between(0.0, 1.0), dice.between(0.0, 1.0)];
        let radius = dice.between(0.003, 0.010);
        let strength = dirt.strength * dice.between(0.5, 1.0);
        spots.push(DirtSpot { kind: DirtKind::Dust, at, radius, strength });
    }
    spots
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 400;
    const HEIGHT: usize = 300;

    fn glass(kind: DirtKind, strength: f64) -> DirtyGlass {
        let spots = vec![DirtSpot { kind, at: [0.5, 0.5], radius: 0.1, strength }];
        DirtyGlass::new(&Dirt { spots, ..Dirt::default() }, WIDTH, HEIGHT, 1).unwrap()
    }

    /// Daylight of this level, and a laser line a pixel high through the middle.
    fn through(glass: &DirtyGlass, level: f32) -> (RawPlanes, Vec<f32>) {
        let mut day = RawPlanes { values: vec![level; 3 * WIDTH * HEIGHT] };
        let mut laser = vec![0.0; WIDTH * HEIGHT];
        laser[HEIGHT / 2 * WIDTH..(HEIGHT / 2 + 1) * WIDTH].fill(1.0);
        glass.dim(&mut day, &mut laser);
        (day, laser)
    }

    #[test]
    fn an_even_area_only_loses_what_the_dirt_swallows() {
        for (kind, left) in [(DirtKind::Smudge, 0.9), (DirtKind::Dust, 0.15)] {
            let (day, _) = through(&glass(kind, 0.8), 0.4);
            let middle = f64::from(day.values[(3 * (HEIGHT / 2) + 1) * WIDTH + WIDTH / 2]);
            // Far-scattered light is the picture's mean, which is that of the even area.
            let expected = 0.4 * (0.2 + 0.8 * left);
            assert!((middle - expected).abs() < 1e-3, "{kind:?}: {middle} instead of {expected}");
            assert!((day.values[WIDTH / 20] - 0.4).abs() < 1e-6, "beside the spot nothing changes");
        }
    }

    /// The stripe behind a smear is fainter and wider; no light is made.
    #[test]
    fn a_smear_makes_the_stripe_fainter_and_wider_and_adds_nothing() {
        let glass = glass(DirtKind::Smudge, 0.9);
        let (_, laser) = through(&glass, 0.0);
        let column =
            |column: usize| -> Vec<f32> { laser.chunks_exact(WIDTH).map(|row| row[column]).collect() };
        let (behind, beside) = (column(WIDTH / 2), column(WIDTH / 10));
        assert!(behind[HEIGHT / 2] < 0.4 * beside[HEIGHT / 2], "{}", behind[HEIGHT / 2]);
        assert!((glass.straight_at(200.0, 150.0) - 0.1).abs() < 1e-6);
        let spread = |column: &[f32]| {
            let total: f32 = column.iter().sum();
            let moment: f32 =
                column.iter().enumerate().map(|(row, v)| v * (row as f32 - 150.0).powi(2)).sum();
            (moment / total).sqrt()
        };
        assert!(spread(&behind) > spread(&beside) + 1.0, "{} {}", spread(&behind), spread(&beside));
        assert!(laser.iter().sum::<f32>() < WIDTH as f32);
    }

    #[test]
    fn spots_follow_from_the_seed_and_a_clean_glass_is_none() {
        let dirt = Dirt { smudges: 4, dust: 30, ..Dirt::default() };
        let spots = |seed| DirtyGlass::new(&dirt, WIDTH, HEIGHT, seed).unwrap().truth();
        assert_eq!(spots(1), spots(1));
        assert_ne!(spots(1), spots(2));
        assert_eq!(spots(1).len(), 3 * 4 + 30);
        assert!(DirtyGlass::new(&Dirt::default(), WIDTH, HEIGHT, 1).is_none());
    }
}
