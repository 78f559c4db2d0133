//! The paper's comparisons, made again: its table of seven objects in the twin, and its verdicts on pictures with known
//! truth, beside this project's.

use std::sync::Arc;

use serde::Serialize;

use super::PaperMethod;
use super::heights::PaperHeights;
use crate::scene_file::{ExpectedCutoff, Scene as PictureScene};
use crate::twin::gallery::{CENTRE, hand, plain};
use crate::twin::scene::{Scene, SceneObject, Shape};
use crate::twin::{Twin, View};
use crate::vision::Analyser;

/// Pictures as wide as the paper's.
pub const PAPER_WIDTH: u16 = 2304;
/// How far off the camera's pitch is in the "uncalibrated" column, degrees; of this sign heights read too high, as the
/// paper's do.
pub const PITCH_ERROR_DEGREES: f64 = -2.0;
/// The floor's pattern, speckle and noise.
const SEED: u64 = 54;

/// One object of the table; heights in millimetres.
#[derive(Debug, Clone, Serialize)]
pub struct TableRow {
    /// The paper's name for it.
    pub object: &'static str,
    /// What the paper measured.
    pub paper_mm: f64,
    /// Its highest point.
    pub true_mm: f64,
    /// The height that 95 % of the stripe on it do not exceed: what a stripe can tell.
    pub lit_mm: Option<f64>,
    /// This project's tier 2.
    pub ours_mm: Option<f64>,
    /// The paper's mask and closed form, everything calibrated perfectly.
    pub closed_form_mm: Option<f64>,
    /// The same with the camera's pitch 2 degrees off.
    pub closed_form_off_mm: Option<f64>,
}

/// Root of the mean squared error of a column of the table against the lit height; `None` if a height is missing.
#[must_use]
pub fn error_mm(rows: &[TableRow], column: impl Fn(&TableRow) -> Option<f64>) -> Option<f64> {
    let squares: Option<Vec<f64>> =
        rows.iter().map(|row| Some((column(row)? - row.lit_mm?).powi(2))).collect();
    let squares = squares?;
    Some((squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt())
}

/// The seven objects: the paper's name, height and measurement, and what stands for it in the twin. Each is placed so
/// that the light falls on it near its top edge, as in the paper.
fn objects() -> Vec<(&'static str, f64, SceneObject)> {
    // The sheet comes down by 200 mm over 500 mm: it meets the height z this far before the stripe.
    let before = |height: f64| -2.5 * height;
    let block = |height_mm: f64, width_mm: f64, material: &str| {
        let depth_mm = 110.0;
        let shape = Shape::Box { width_mm, depth_mm, height_mm };
        plain("object", shape, before(height_mm) + depth_mm / 2.0 - 20.0, material)
    };
    let knee = Shape::Rod { diameter_mm: 120.0, length_mm: 220.0 };
    vec![
        ("Box (1)", 63.0, block(40.0, 160.0, "cardboard")),
        ("Box (2)", 78.0, block(60.0, 160.0, "cardboard")),
        ("Box (3)", 104.0, block(80.0, 160.0, "cardboard")),
        ("Aluminum extrusion", 59.0, block(40.0, 200.0, "aluminium")),
        ("Hand", 60.0, hand("object", 50.0, -190.0)),
        ("Shoes", 79.0, block(60.0, 100.0, "leather_brown")),
        ("Knee", 113.0, plain("object", knee, -270.0, "denim")),
    ]
}

/// Makes the table again in the twin, with the paper's rig, from pictures so many pixels wide.
///
/// # Errors
/// A rig or scene that cannot be used: a mistake in this table.
pub fn seven_objects(width: u16) -> anyhow::Result<Vec<TableRow>> {
    let rig = CENTRE.with_width(width).rig()?;
    let view = Arc::new(View::new(&rig));
    let mut ours = Analyser::new(&rig)?;
    let mut methods =
        [0.0, PITCH_ERROR_DEGREES].map(|off| PaperMethod::new(&rig, PaperHeights::of(&rig, off)));
    let mut rows = Vec::new();
    for (object, paper_mm, body) in objects() {
        let scene = Scene { objects: vec![body], ..Scene::default() };
        let twin = Twin::new(Arc::clone(&view), &scene, SEED)?;
        let frame = twin.render(0, 1.0).to_rgb_frame()?;
        ours.judge(&frame.view())?;
        let truth = twin.truth(1.0);
        let known = truth.objects.first();
        let [perfect, off] = &mut methods;
        let highest = |method: &mut Result<PaperMethod, super::PaperError>| -> anyhow::Result<Option<f64>> {
            let found = method.as_mut().map_err(|error| *error)?.judge(&frame)?;
            Ok(found.objects.iter().map(|object| f64::from(object.height_mm)).max_by(f64::total_cmp))
        };
        rows.push(TableRow {
            object,
            paper_mm,
            true_mm: known.map_or(f64::NAN, |known| known.true_height_mm),
            lit_mm: known.and_then(|known| known.heights).map(|heights| heights.p95_mm),
            ours_mm: ours
                .objects()
                .iter()
                .filter_map(|object| object.height)
                .map(|height| f64::from(height.get()))
                .max_by(f64::total_cmp),
            closed_form_mm: highest(perfect)?,
            closed_form_off_mm: highest(off)?,
        });
    }
    Ok(rows)
}

/// How often a method's verdict on a picture was right.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Count {
    /// Something cuts the stripe, and it says so.
    pub trips: usize,
    /// Something cuts the stripe, and it does not say so.
    pub misses: usize,
    /// Nothing cuts the stripe, and it says so.
    pub clear: usize,
    /// Nothing cuts the stripe, but it trips.
    pub false_trips: usize,
}

impl Count {
    /// Adds a verdict.
    pub fn add(&mut self, expected_trip: bool, trips: bool) {
        *match (expected_trip, trips) {
            (true, true) => &mut self.trips,
            (true, false) => &mut self.misses,
            (false, false) => &mut self.clear,
            (false, true) => &mut self.false_trips,
        } += 1;
    }
}

/// Verdicts of both methods on one picture.
#[derive(Debug, Clone, Serialize)]
pub struct Verdicts {
    /// The picture's name.
    pub picture: String,
    /// Must the sensor trip?
    pub expected_trip: bool,
    /// Does this project's vision?
    pub ours: bool,
    /// Does the paper's pipeline?
    pub paper: bool,
}

/// Judges a picture with known truth by both methods; `None` for one that is borderline.
///
/// # Errors
/// The picture cannot be read, or its rig not be used.
pub fn compare(scene: &PictureScene) -> anyhow::Result<Option<Verdicts>> {
    let expected_trip = match scene.cutoff {
        ExpectedCutoff::Trip | ExpectedCutoff::StripeMissing => true,
        ExpectedCutoff::NoTrip => false,
        ExpectedCutoff::Borderline => return Ok(None),
    };
    let frame = crate::capture::read_frame(&scene.picture, scene.rig.image())?;
    let mut analyser = Analyser::new(&scene.rig)?;
    analyser.judge(&frame.view())?;
    let paper = super::analyse(&frame, &scene.rig)?;
    Ok(Some(Verdicts {
        picture: scene.name.clone(),
        expected_trip,
        ours: analyser.report().is_cut(),
        paper: paper.is_cut,
    }))
}
