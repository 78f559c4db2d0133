//! Are the twin's pictures like those of another renderer? The same rig, floor, light and settings, and the same measures on
//! both: how wide the stripe is, how far it stands out, how much the ground varies, and how far a fixed estimator is off.
//!
//! Measured is red minus green (levels of 8 bits) in the columns in which the truth says that the floor is lit.

use std::path::Path;
use std::sync::Arc;

use nearfield_shared::rig::Rig;
use serde::{Deserialize, Serialize};

use super::render::Twin;
use super::scene::{Floor, FloorKind, Light, Look, Scene, SceneError};
use super::view::View;
use crate::capture::{CaptureError, read_frame};
use crate::scene_file::{self, LitPlace, SceneFileError};

/// Rows to both sides of the true one that are looked at.
const ROWS_ASIDE: usize = 28;
/// Rows beyond this distance are ground.
const GROUND_FROM: usize = 18;
/// The estimator is the centre of gravity within this distance of what rises above a quarter of the height.
const CREST_ROWS: usize = 12;
/// Median of the magnitude of a normal value, in standard deviations.
const MEDIAN_MAGNITUDE: f64 = 0.6745;
/// Fewest columns that a picture must offer.
const FEWEST_COLUMNS: usize = 50;
/// Illuminance for which both renderers define their exposure, lux.
const REFERENCE_LUX: f64 = 400.0;

/// Why pictures cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// The scene files.
    #[error(transparent)]
    Scene(#[from] SceneFileError),
    /// The picture.
    #[error(transparent)]
    Picture(#[from] CaptureError),
    /// The twin's own scene.
    #[error(transparent)]
    Twin(#[from] SceneError),
    /// The scene file does not tell the floor.
    #[error("{path}: no floor that the twin knows: {source}")]
    Look {
        /// The file.
        path: String,
        /// What is missing.
        source: serde_json::Error,
    },
}

/// What a scene file says about floor and camera settings.
#[derive(Deserialize)]
struct Settings {
    floor: FloorText,
    /// Left out: the twin's own settings.
    look: Option<LookText>,
}

#[derive(Deserialize)]
struct FloorText {
    kind: FloorKind,
}

#[derive(Deserialize)]
struct LookText {
    lux: f64,
    exposure: f64,
    gain: f64,
    fwc: f64,
    read: f64,
    speckle: f64,
    blur: f64,
    halo: f64,
    laser_power: f64,
}

impl Settings {
    /// A bare floor with these settings. The other renderer's exposure is that of its automatic exposure in the scene's own
    /// light, the twin's refers to [`REFERENCE_LUX`].
    fn scene(&self) -> Scene {
        let floor = Floor { kind: self.floor.kind, ..Floor::default() };
        let Some(look) = &self.look else { return Scene { floor, ..Scene::default() } };
        Scene {
            floor,
            light: Light { lux: look.lux, ..Light::default() },
            look: Look {
                exposure: Some(look.exposure * REFERENCE_LUX / look.lux.max(1.0)),
                gain: look.gain,
                full_well_electrons: look.fwc,
                read_noise_electrons: look.read,
                speckle: look.speckle,
                blur_pixels: look.blur,
                halo: look.halo,
                laser_power: look.laser_power,
                ..Look::default()
            },
            ..Scene::default()
        }
    }
}

/// What a stripe looks like in one picture: medians over its columns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Statistics {
    /// Columns measured.
    pub columns: usize,
    /// Rows above half of the stripe's height.
    pub width_rows: f64,
    /// Height over the ground, levels.
    pub contrast: f64,
    /// Robust standard deviation of that height from column to column, share of the median.
    pub unevenness: f64,
    /// Standard deviation of the ground around the stripe, levels.
    pub ground: f64,
    /// Median error of the fixed estimator, rows.
    pub bias_rows: f64,
    /// Its robust standard deviation, rows.
    pub error_rows: f64,
}

/// One picture and the twin's of the same scene.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// The scene's name.
    pub name: String,
    /// The given picture.
    pub given: Statistics,
    /// The twin's.
    pub twin: Statistics,
}

/// Compares one scene file's picture with the twin's of the same rig, floor and settings. `None` where too little of the floor
/// is lit.
///
/// # Errors
/// See [`CompareError`].
pub fn compare(scene: &scene_file::Scene, seed: u64) -> Result<Option<Comparison>, CompareError> {
    let path = scene.picture.with_extension("json");
    let settings = settings(&path)?;
    let given = read_frame(&scene.picture, scene.rig.image())?.to_rgb();
    let twin = Twin::new(Arc::new(View::new(&scene.rig)), &settings.scene(), seed)?.render(0, 1.0);
    let width = usize::from(scene.rig.image().width);
    let lit = if scene.lit_rows.is_empty() && scene.longest_gap == 0.0 {
        whole_stripe(&scene.rig)
    } else {
        scene.lit_rows.clone()
    };
    let of = |rgb: &[u8]| Statistics::of(rgb, width, &lit);
    Ok(of(&given).zip(of(&twin.rgb)).map(|(given, twin)| Comparison {
        name: scene.name.clone(),
        given,
        twin,
    }))
}

/// Where the whole stripe on the floor appears, every millimetre.
fn whole_stripe(rig: &Rig) -> Vec<LitPlace> {
    let stripe = rig.stripe();
    let places = (stripe.start.ceil() as i64..=stripe.end.floor() as i64).map(|place| place as f64);
    let pixels = places.filter_map(|place| Some((place, rig.camera().project(stripe.at(place))?)));
    pixels
        .map(|(place, pixel)| LitPlace { place: place as f32, column: pixel.u as f32, row: pixel.v as f32 })
        .collect()
}

fn settings(path: &Path) -> Result<Settings, CompareError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| SceneFileError::Read { path: path.to_path_buf(), source })?;
    serde_json::from_str(&text)
        .map_err(|source| CompareError::Look { path: path.display().to_string(), source })
}

/// One column's stripe.
struct Crest {
    width: f64,
    contrast: f64,
    ground: f64,
    error: f64,
}

impl Statistics {
    /// Measures a picture of 8-bit colours; `None` where too few columns show their surroundings.
    #[must_use]
    pub fn of(rgb: &[u8], width: usize, lit: &[LitPlace]) -> Option<Self> {
        let crests: Vec<Crest> =
            lit.windows(2).filter_map(|places| Crest::of(rgb, width, [places[0], places[1]])).collect();
        if crests.len() < FEWEST_COLUMNS {
            return None;
        }
        let values = |of: fn(&Crest) -> f64| crests.iter().map(of).collect::<Vec<_>>();
        let (contrast, contrast_spread) = median_and_spread(values(|crest| crest.contrast));
        let (bias_rows, error_rows) = median_and_spread(values(|crest| crest.error));
        Some(Self {
            columns: crests.len(),
            width_rows: median_and_spread(values(|crest| crest.width)).0,
            contrast,
            unevenness: contrast_spread / contrast.max(1.0),
            ground: median_and_spread(values(|crest| crest.ground)).0,
            bias_rows,
            error_rows,
        })
    }
}

impl Crest {
    /// The column nearest to the first of two neighbouring places, whose true row follows from both.
    fn of(rgb: &[u8], width: usize, [place, next]: [LitPlace; 2]) -> Option<Self> {
        let (column, row) = (f64::from(place.column), f64::from(place.row));
        let slope = (f64::from(next.row) - row) / (f64::from(next.column) - column);
        let whole = column.round();
        let truth = row + slope * (whole - column);
        if !truth.is_finite() || (f64::from(next.column) - column).abs() > 8.0 {
            return None;
        }
        let first = (truth.round() as usize).checked_sub(ROWS_ASIDE)?;
        let level = |index: usize| -> Option<f64> {
            let start = 3 * ((first + index) * width + whole as usize);
            let pixel = rgb.get(start..start + 2)?;
            Some(f64::from(pixel[0]) - f64::from(pixel[1]))
        };
        let levels: Vec<f64> = (0..=2 * ROWS_ASIDE).map(level).collect::<Option<_>>()?;
        let is_ground = |(index, _): &(usize, &f64)| index.abs_diff(ROWS_ASIDE) > GROUND_FROM;
        let beside = levels.iter().enumerate().filter(is_ground).map(|(_, level)| *level).collect();
        let (floor, ground) = ground(beside);
        let near = ROWS_ASIDE - CREST_ROWS..=ROWS_ASIDE + CREST_ROWS;
        let contrast = near.clone().map(|index| levels[index] - floor).fold(0.0, f64::max);
        let (mut weight, mut moment) = (0.0, 0.0);
        for index in near.clone() {
            let excess = (levels[index] - floor - contrast / 4.0).max(0.0);
            weight += excess;
            moment += excess * (first + index) as f64;
        }
        let above = near.filter(|index| levels[*index] - floor > contrast / 2.0).count();
        (weight > 0.0).then(|| Self { width: above as f64, contrast, ground, error: moment / weight - truth })
    }
}

/// The median, and the standard deviation that normal values with such a mean deviation have: levels are whole, so a median
/// deviation would be too.
fn ground(levels: Vec<f64>) -> (f64, f64) {
    let deviations = |middle: f64| levels.iter().map(|level| (level - middle).abs()).sum::<f64>();
    let count = levels.len().max(1) as f64;
    let (median, _) = median_and_spread(levels.clone());
    (median, deviations(median) / count * std::f64::consts::FRAC_PI_2.sqrt())
}

/// The median, and the standard deviation that normal values with such a median deviation have.
fn median_and_spread(mut values: Vec<f64>) -> (f64, f64) {
    let middle = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let median = middle(&mut values);
    let mut deviations: Vec<f64> = values.iter().map(|value| (value - median).abs()).collect();
    (median, middle(&mut deviations) / MEDIAN_MAGNITUDE)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stripe of known width, height and place on a ground of known roughness.
    #[test]
    fn the_measures_are_those_of_a_picture_that_was_made_to_have_them() {
        let (width, height) = (200, 120);
        let mut dice = crate::twin::random::Dice::new(3);
        let row_at = |column: f64| 60.3 + 0.05 * column;
        let mut rgb = Vec::new();
        for row in 0..height {
            for column in 0..width {
                let distance = f64::from(row) - row_at(f64::from(column));
                let light = 90.0 * (-0.5 * (distance / 3.0).powi(2)).exp() + 2.0 * dice.normal();
                rgb.extend([(100.0 + light).round() as u8, 80, 60]);
            }
        }
        let lit: Vec<LitPlace> = (10..190)
            .map(|column| {
                let at = f64::from(column) + 0.4;
                LitPlace { place: at as f32, column: at as f32, row: row_at(at) as f32 }
            })
            .collect();
        let found = Statistics::of(&rgb, width as usize, &lit).unwrap();
        assert!((found.contrast - 92.0).abs() < 3.0, "{found:?}");
        assert!((found.width_rows - 7.0).abs() <= 1.0, "2.355 times 3 rows: {found:?}");
        assert!((found.ground - 2.0).abs() < 0.5, "{found:?}");
        assert!(found.bias_rows.abs() < 0.05 && (0.02..0.2).contains(&found.error_rows), "{found:?}");
        assert!(Statistics::of(&rgb, width as usize, &lit[..20]).is_none(), "too few columns");
    }
}
