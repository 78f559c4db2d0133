//! The laser's stripe in a picture of a camera that is not calibrated yet: all places that could be it, sub-pixel.
//!
//! The vision of the running sensor knows where to look from its rig; here every column of the whole picture is
//! searched, several candidates are kept, and [`super::sheet`] chooses by what one plane of light can do.

use nearfield_shared::camera::Pixel;

use super::picture::CalibrationPicture;

/// Candidates kept per column, strongest first.
const MOST_CANDIDATES: usize = 4;
/// The weakest contrast that can be a stripe, grey levels of red minus green.
const LEAST_CONTRAST: f64 = 8.0;
/// A candidate stands out of the column's own noise this many times.
const LEAST_SIGNIFICANCE: f64 = 6.0;
/// A stripe is at most this share of the picture's height wide.
const WIDEST_SHARE: f64 = 1.0 / 30.0;
/// The row is the centroid of the profile between these shares of the peak: above them the core is clipped or
/// hollow, below them the floor's texture begins.
const CENTROID_SHARES: [f64; 2] = [0.2, 0.55];

/// A place that could be the stripe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Where: an image column and a sub-pixel row.
    pub pixel: Pixel,
    /// How far it stands out of its surroundings, grey levels.
    pub contrast: f64,
}

/// All candidates of a picture, column by column.
#[must_use]
pub fn candidates(picture: &CalibrationPicture) -> Vec<Candidate> {
    let (width, height) = picture.colours.dimensions();
    let mut column = Column::new(height as usize);
    let mut found = Vec::new();
    for u in 0..width {
        column.read(picture, u);
        column.find(&mut found);
    }
    found
}

/// One image column and working memory.
struct Column {
    u: u32,
    /// Red minus green, or brightness.
    strength: Vec<f64>,
    /// Smoothed over three rows.
    smooth: Vec<f64>,
    /// Half of the window in which a stripe rises and falls, rows.
    reach: usize,
    differences: Vec<f64>,
}

impl Column {
    fn new(height: usize) -> Self {
        let reach = ((height as f64 * WIDEST_SHARE) as usize).max(4);
        Self {
            u: 0,
            strength: vec![0.0; height],
            smooth: vec![0.0; height],
            reach,
            differences: Vec::with_capacity(height),
        }
    }

    fn read(&mut self, picture: &CalibrationPicture, u: u32) {
        self.u = u;
        for (v, strength) in (0_u32..).zip(&mut self.strength) {
            *strength = if picture.is_monochrome {
                f64::from(picture.brightness.get_pixel(u, v).0[0])
            } else {
                let [red, green, _] = picture.colours.get_pixel(u, v).0;
                f64::from(red) - f64::from(green)
            };
        }
        let last = self.strength.len() - 1;
        for v in 0..=last {
            let (above, below) = (self.strength[v.saturating_sub(1)], self.strength[(v + 1).min(last)]);
            self.smooth[v] = (above + self.strength[v] + below) / 3.0;
        }
    }

    /// Noise of the smoothed column: from the median step between rows that are three apart, and so independent.
    fn noise(&mut self) -> f64 {
        self.differences.clear();
        let pairs = self.smooth.iter().zip(self.smooth.iter().skip(3));
        self.differences.extend(pairs.map(|(one, other)| (one - other).abs()));
        if self.differences.is_empty() {
            return 0.0;
        }
        let middle = self.differences.len() / 2;
        let (_, median, _) = self.differences.select_nth_unstable_by(middle, f64::total_cmp);
        *median / (0.6745 * std::f64::consts::SQRT_2)
    }

    fn find(&mut self, found: &mut Vec<Candidate>) {
        let least = LEAST_CONTRAST.max(LEAST_SIGNIFICANCE * self.noise());
        let first = found.len();
        let mut row = self.reach;
        while row + self.reach < self.smooth.len() {
            if self.is_peak(row)
                && let Some(candidate) = self.measure(row, least)
            {
                found.push(candidate);
                row += self.reach / 2;
            }
            row += 1;
        }
        found[first..].sort_by(|one, other| other.contrast.total_cmp(&one.contrast));
        found.truncate(first + MOST_CANDIDATES);
    }

    /// Is this row the highest of the window around it? The first of equals counts.
    fn is_peak(&self, row: usize) -> bool {
        let half = self.reach / 2;
        let here = self.smooth[row];
        self.smooth[row - half..row].iter().all(|value| *value < here)
            && self.smooth[row + 1..=row + half].iter().all(|value| *value <= here)
    }

    fn measure(&self, row: usize, least: f64) -> Option<Candidate> {
        let lowest = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
        let bases =
            [lowest(&self.smooth[row - self.reach..row]), lowest(&self.smooth[row..=row + self.reach])];
        let base = bases[0].max(bases[1]);
        let contrast = self.smooth[row] - base;
        if contrast < least {
            return None;
        }
        let [low, high] = CENTROID_SHARES.map(|share| share * contrast);
        let weight = |v: usize| (self.strength[v] - base).clamp(low, high) - low;
        let is_within = |v: &usize| self.smooth[*v] - base > low;
        let top = (0..=row).rev().take_while(is_within).last()?.saturating_sub(1);
        let bottom = ((row..self.smooth.len()).take_while(is_within).last()? + 1).min(self.smooth.len() - 1);
        if bottom - top > 2 * self.reach {
            return None;
        }
        let (mut sum, mut moment) = (0.0, 0.0);
        for v in top..=bottom {
            sum += weight(v);
            moment += weight(v) * v as f64;
        }
        let pixel = Pixel { u: f64::from(self.u), v: moment / sum };
        pixel.v.is_finite().then_some(Candidate { pixel, contrast })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{DynamicImage, Rgb, RgbImage};
    use std::path::Path;

    fn picture(paint: impl Fn(u32, u32) -> [u8; 3]) -> CalibrationPicture {
        let colours = RgbImage::from_fn(40, 240, |u, v| Rgb(paint(u, v)));
        CalibrationPicture::new(Path::new("made.png"), &DynamicImage::ImageRgb8(colours))
    }

    /// The rule: 0.15 px for a narrow stripe in whole grey levels, and a clipped core is no worse.
    #[test]
    fn the_row_is_found_well_within_a_pixel_also_with_a_clipped_core() {
        for gain in [60.0, 180.0, 500.0] {
            let picture = picture(|u, v| {
                let away = f64::from(v) - (100.0 + 0.37 * f64::from(u));
                let lit = gain * (-away * away / 8.0).exp();
                [(70.0 + lit).min(255.0) as u8, (70.0 + 0.1 * lit).min(255.0) as u8, 70]
            });
            let found = candidates(&picture);
            assert_eq!(found.len(), 40);
            for candidate in found {
                let truth = 100.0 + 0.37 * candidate.pixel.u;
                assert!((candidate.pixel.v - truth).abs() < 0.15, "gain {gain}: {candidate:?}, true {truth}");
            }
        }
    }

    #[test]
    fn an_even_floor_has_no_candidate() {
        let even = picture(|u, v| [90 + (u % 3) as u8, 88 + (v % 4) as u8, 85]);
        assert_eq!(candidates(&even), Vec::new());
    }
}
