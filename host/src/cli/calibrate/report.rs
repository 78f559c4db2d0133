//! What a calibration says, to people and to programs.

use std::fmt::Write as _;
use std::path::Path;

use nearfield_shared::rig::ImageSize;
use serde::Serialize;

use crate::calibrate::drift::{Drift, NOTED_DRIFT_MM};
use crate::calibrate::lens::LensCalibration;
use crate::calibrate::model::{LENS_NAMES, lens_values};
use crate::calibrate::session::Calibration;
use crate::calibrate::verdict::Verdict;

/// A lens parameter with its uncertainty.
#[derive(Debug, Serialize)]
pub struct LensValue {
    name: &'static str,
    value: f64,
    sigma: f64,
}

fn lens_list(values: [f64; 9], sigmas: [f64; 9]) -> Vec<LensValue> {
    LENS_NAMES
        .into_iter()
        .zip(values.into_iter().zip(sigmas))
        .map(|(name, (value, sigma))| LensValue { name, value, sigma })
        .collect()
}

fn lens_table(values: &[LensValue]) -> String {
    let mut text = String::new();
    for LensValue { name, value, sigma } in values {
        let digits = if name.len() == 2 && (name.starts_with('f') || name.starts_with('c')) { 2 } else { 5 };
        // Writing to a String cannot fail.
        let _ = if *sigma > 0.0 {
            writeln!(text, "  {name:<14} {value:>10.digits$} +- {sigma:.digits$}")
        } else {
            writeln!(text, "  {name:<14} {value:>10.digits$} (given)")
        };
    }
    text
}

/// The JSON of `calibrate lens`.
#[derive(Debug, Serialize)]
pub struct LensReport {
    width: u16,
    height: u16,
    views: usize,
    views_left_out: usize,
    reprojection_error_pixels: f64,
    view_errors_pixels: Vec<f64>,
    coverage: f64,
    lens: Vec<LensValue>,
    notes: Vec<String>,
}

impl LensReport {
    /// Gathers it.
    #[must_use]
    pub fn new(image: ImageSize, calibration: &LensCalibration, left_out: usize) -> Self {
        Self {
            width: image.width,
            height: image.height,
            views: calibration.view_errors.len(),
            views_left_out: left_out,
            reprojection_error_pixels: calibration.reprojection_error(),
            view_errors_pixels: calibration.view_errors.clone(),
            coverage: calibration.coverage,
            lens: lens_list(lens_values(&calibration.fit.model.lens), calibration.fit.lens_sigmas()),
            notes: calibration.notes.clone(),
        }
    }
}

/// `calibrate lens` for people.
#[must_use]
pub fn lens_text(calibration: &LensCalibration, left_out: usize) -> String {
    let mut text = format!(
        "lens from {} views ({left_out} left out), reprojection error {:.3} px, {:.0} % of the picture covered\n",
        calibration.view_errors.len(),
        calibration.reprojection_error(),
        100.0 * calibration.coverage
    );
    text += &lens_table(&lens_list(lens_values(&calibration.fit.model.lens), calibration.fit.lens_sigmas()));
    for note in &calibration.notes {
        let _ = writeln!(text, "  note: {note}");
    }
    text
}

/// A block in the JSON.
#[derive(Debug, Serialize)]
struct BlockReport {
    stated_mm: f64,
    measured_mm: Option<f64>,
    columns: usize,
    problem: Option<String>,
}

/// The JSON of `calibrate rig`.
#[derive(Debug, Serialize)]
pub struct RigReport {
    calibration_id: String,
    board_residual_pixels: f64,
    stripe_noise_pixels: f64,
    camera_height_mm: f64,
    laser_origin_mm: [f64; 3],
    shadows_used: usize,
    stripe_mm: [f64; 2],
    lens: Vec<LensValue>,
    blocks: Vec<BlockReport>,
    verdict: Verdict,
}

impl RigReport {
    /// Gathers it.
    #[must_use]
    pub fn new(calibration: &Calibration, verdict: &Verdict) -> Self {
        let rig = &calibration.rig;
        let origin = rig.laser().origin;
        Self {
            calibration_id: format!("{:08x}", rig.calibration_id().get()),
            board_residual_pixels: calibration.board_error,
            stripe_noise_pixels: calibration.fit.stripe_noise,
            camera_height_mm: rig.camera().pose.centre().z,
            laser_origin_mm: [origin.x, origin.y, origin.z],
            shadows_used: calibration.apex.rays,
            stripe_mm: [rig.stripe().start, rig.stripe().end],
            lens: lens_list(lens_values(&calibration.fit.model.lens), calibration.fit.lens_sigmas()),
            blocks: calibration
                .blocks
                .iter()
                .map(|block| BlockReport {
                    stated_mm: block.stated_mm,
                    measured_mm: block.measured_mm,
                    columns: block.columns,
                    problem: block.problem.clone(),
                })
                .collect(),
            verdict: verdict.clone(),
        }
    }
}

/// To whole millimetres, without a minus before zero.
fn whole(millimetres: f64) -> f64 {
    millimetres.round() + 0.0
}

/// `calibrate rig` for people.
#[must_use]
pub fn rig_text(calibration: &Calibration, verdict: &Verdict) -> String {
    let rig = &calibration.rig;
    let (camera, laser) = (rig.camera().pose.centre(), rig.laser().origin);
    let mut text = format!(
        "verdict: {}\n  board          {} of {} corners, {:.3} px off\n  stripe         {:.3} px off, watched {:.0} to {:.0} mm\n",
        verdict.grade.words(),
        calibration.corners[0],
        calibration.corners[1],
        calibration.board_error,
        calibration.fit.stripe_noise,
        rig.stripe().start,
        rig.stripe().end,
    );
    for block in &calibration.blocks {
        let found = block.measured_mm.map_or("not used".to_owned(), |measured| {
            format!("comes out as {measured:.2} mm ({} columns)", block.columns)
        });
        let _ = writeln!(text, "  block {:<8} {found}", format!("{} mm", block.stated_mm));
    }
    let _ = writeln!(
        text,
        "  camera         {:.1} mm over the floor at ({:.0}, {:.0})",
        camera.z,
        whole(camera.x),
        whole(camera.y)
    );
    let _ = writeln!(
        text,
        "  laser          {:.1} mm over the floor at ({:.0}, {:.0}); sheet sure to {:.3} degrees",
        laser.z,
        whole(laser.x),
        whole(laser.y),
        verdict.plane_sigma_degrees
    );
    text += &lens_table(&lens_list(lens_values(&calibration.fit.model.lens), calibration.fit.lens_sigmas()));
    text += "  heights are sure to (one sigma, mm)\n       along      0 mm     50 mm    100 mm high\n";
    for places in verdict.height_sigmas.chunk_by(|one, other| one.place_mm == other.place_mm) {
        let _ = write!(text, "  {:>8.0} mm", places.first().map_or(0.0, |place| place.place_mm));
        for sigma in places {
            let _ = if sigma.sigma_mm.is_finite() {
                write!(text, "{:>10.2}", sigma.sigma_mm)
            } else {
                write!(text, "    unseen")
            };
        }
        text.push('\n');
    }
    for note in &verdict.notes {
        let _ = writeln!(text, "  note: {note}");
    }
    text
}

/// The JSON of `calibrate check`.
#[derive(Debug, Serialize)]
pub struct DriftReport<'a> {
    image: String,
    drifted: bool,
    #[serde(flatten)]
    drift: &'a Drift,
}

impl<'a> DriftReport<'a> {
    /// Gathers it.
    #[must_use]
    pub fn new(image: &Path, drift: &'a Drift) -> Self {
        Self { image: image.display().to_string(), drifted: drift.has_drifted(), drift }
    }
}

/// `calibrate check` for people.
#[must_use]
pub fn drift_text(image: &Path, drift: &Drift) -> String {
    let words = if drift.has_drifted() {
        "has drifted: tighten the mounts and calibrate anew"
    } else if drift.worst_mm > NOTED_DRIFT_MM {
        "still true, but watch it"
    } else {
        "true"
    };
    let mut text = format!(
        "{}: {words}\n  the floor reads {:+.2} mm high ({:+.2} rows), {:.0} % of the stripe seen\n",
        image.display(),
        drift.height_mm,
        drift.rows,
        100.0 * drift.seen
    );
    for stretch in &drift.stretches {
        let height = stretch.height_mm.map_or("not seen".to_owned(), |height| format!("{height:+.2} mm"));
        let _ = writeln!(text, "  at {:>6.0} mm  {height}", stretch.place_mm);
    }
    text
}
