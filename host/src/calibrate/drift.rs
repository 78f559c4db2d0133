//! Is a calibrated rig still true? A clean floor's stripe must lie where the rig puts it.
//!
//! The whole picture is searched, not only the rows that the rig allows: a camera that was knocked shows its stripe
//! elsewhere. One picture of the floor tells how far the stripe has moved, not whether camera or laser moved it.

use nearfield_shared::camera::Vector;
use nearfield_shared::rig::Rig;
use serde::Serialize;

use super::CalibrationError;
use super::picture::CalibrationPicture;
use super::sheet::{Placed, find_floor_line, on_line, placed};
use super::stripe::candidates;

/// A floor that reads higher or lower than this has drifted, millimetres: half of what tier 1 takes for floor is left
/// for floor and object.
pub const LARGEST_DRIFT_MM: f64 = 0.8;
/// From here on it should be watched, millimetres.
pub const NOTED_DRIFT_MM: f64 = 0.4;
/// The stripe lies on one line to this, pixels; more is not one stripe.
const LINE_TOLERANCE: f64 = 3.0;
/// Heights are told in this many stretches of the stripe.
const STRETCHES: usize = 5;

/// How the floor reads in one stretch of the stripe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Stretch {
    /// Its middle, millimetres along the stripe.
    pub place_mm: f64,
    /// Median height at which the rig sees the floor there, millimetres; should be zero. `None` where the stripe is not
    /// seen.
    pub height_mm: Option<f64>,
}

/// The drift of a rig.
#[derive(Debug, Clone, Serialize)]
pub struct Drift {
    /// Median height at which the rig sees the whole floor, millimetres.
    pub height_mm: f64,
    /// Median distance of the stripe from its calibrated row, pixels (down is positive).
    pub rows: f64,
    /// Along the stripe.
    pub stretches: Vec<Stretch>,
    /// The largest of the stretches' magnitudes, millimetres.
    pub worst_mm: f64,
    /// Share of the watched columns in which the stripe was seen.
    pub seen: f64,
}

impl Drift {
    /// Has the rig drifted?
    #[must_use]
    pub fn has_drifted(&self) -> bool {
        self.worst_mm > LARGEST_DRIFT_MM
    }
}

/// Compares the stripe of a clean floor with the rig.
///
/// # Errors
/// [`CalibrationError::Picture`] if there is no stripe, or the picture is not of the rig's size.
pub fn measure_drift(rig: &Rig, picture: &CalibrationPicture) -> Result<Drift, CalibrationError> {
    let refused = |problem: String| CalibrationError::Picture { path: picture.path.clone(), problem };
    if picture.size()? != rig.image() {
        return Err(refused(format!(
            "the picture is not of the rig's size {} x {}; use the rig file that belongs to it",
            rig.image().width,
            rig.image().height
        )));
    }
    let camera = rig.camera();
    let on_floor = placed(camera, &candidates(picture), 0.0);
    let line = find_floor_line(camera, &on_floor, f64::from(rig.image().width)).ok_or_else(|| {
        refused("no laser stripe is found on the floor: is the laser on and the floor clear?".to_owned())
    })?;
    let stripe = on_line(&on_floor, &line, LINE_TOLERANCE);
    let mut readings: Vec<Reading> = stripe.iter().filter_map(|point| Reading::of(rig, point)).collect();
    let (start, end) = (rig.stripe().start, rig.stripe().end);
    readings.retain(|reading| reading.place >= start && reading.place <= end);
    if readings.is_empty() {
        return Err(refused(
            "the stripe lies nowhere near the watched stretch: camera or laser has been moved, calibrate anew".to_owned(),
        ));
    }
    let stretches: Vec<Stretch> = (0..STRETCHES).map(|index| stretch(&readings, start, end, index)).collect();
    let worst = stretches
        .iter()
        .filter_map(|stretch| stretch.height_mm)
        .fold(0.0_f64, |worst, height| worst.max(height.abs()));
    let columns = (camera.project(rig.stripe().at(start)), camera.project(rig.stripe().at(end)));
    let watched = columns.0.zip(columns.1).map_or(f64::INFINITY, |(one, other)| (one.u - other.u).abs());
    Ok(Drift {
        height_mm: median(&mut readings.iter().map(|reading| reading.height)).unwrap_or(0.0),
        rows: median(&mut readings.iter().map(|reading| reading.rows)).unwrap_or(0.0),
        worst_mm: worst,
        seen: (readings.len() as f64 / watched.max(1.0)).min(1.0),
        stretches,
    })
}

/// One stripe pixel as the rig sees it.
struct Reading {
    place: f64,
    height: f64,
    rows: f64,
}

impl Reading {
    fn of(rig: &Rig, point: &Placed) -> Option<Self> {
        let lit = rig.laser().triangulate(rig.camera(), point.pixel)?;
        // The calibrated row in this column: where the floor line at the same place is imaged, moved to this column.
        let foot = rig.stripe().at(rig.stripe().coordinate_of(lit));
        let (here, beside) =
            (rig.camera().project(foot)?, rig.camera().project(foot.plus(rig.stripe().direction))?);
        let slope = (beside.v - here.v) / (beside.u - here.u);
        let row = here.v + slope * (point.pixel.u - here.u);
        Some(Self { place: rig.stripe().coordinate_of(flat(lit)), height: lit.z, rows: point.pixel.v - row })
            .filter(|reading| reading.rows.is_finite())
    }
}

fn flat(point: Vector) -> Vector {
    Vector { z: 0.0, ..point }
}

fn stretch(readings: &[Reading], start: f64, end: f64, index: usize) -> Stretch {
    let width = (end - start) / STRETCHES as f64;
    let low = start + index as f64 * width;
    let mut heights = readings
        .iter()
        .filter(|reading| reading.place >= low && reading.place < low + width)
        .map(|reading| reading.height);
    Stretch { place_mm: low + width / 2.0, height_mm: median(&mut heights) }
}

fn median(values: &mut dyn Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}
