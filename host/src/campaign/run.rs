//! Judges one scene of a campaign.

use std::sync::Arc;
use std::time::Instant;

use nearfield_shared::columns::{Decimation, GeometryError};
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, LASER_DIMMED, LASER_FULL, VOTE_FRAMES};
use nearfield_shared::linescan::LineScanColumn;
use nearfield_shared::monitor::{ColumnReading, StripeMonitor};
use nearfield_shared::rig::Rig;

use super::{ObjectOutcome, Outcome, RELIABILITY_BINS};
use crate::capture::{Frame, Pixels};
use crate::line_scan::LineScanEncoder;
use crate::scene_file::ExpectedCutoff;
use crate::twin::gallery::{CENTRE, Mounting, SIDE, Theme, WIDE, random_scene};
use crate::twin::scene::MaterialChoice;
use crate::twin::{Scene, SceneError, Truth, Twin, View};
use crate::vision::Analyser;

/// The rigs that take turns.
const RIGS: [(&str, Mounting); 3] = [("centre", CENTRE), ("side", SIDE), ("wide", WIDE)];
/// The themes that take turns, one after all rigs.
const THEMES: [(&str, Theme); 3] =
    [("clean", Theme::Clean), ("object", Theme::Object), ("thin", Theme::Thin)];
/// The layouts that take turns, one after all themes.
const LAYOUTS: [&str; 3] = ["rgb", "yuv420", "nv12"];
/// The laser's brightness in the pictures of a sequence, as the controller's code may have it.
const CODE: [f32; 11] = [1.0, 1.0, DIMMED, DIMMED, 1.0, 1.0, DIMMED, DIMMED, DIMMED, 1.0, 1.0];
const DIMMED: f32 = LASER_DIMMED as f32 / LASER_FULL as f32;
/// A ratio that is written down is no larger: JSON has no infinity.
const MOST_RATIO: f64 = 1e6;
/// A reading is right if it lies within this many pixels of a true row of its column.
const RIGHT_PX: f64 = 2.0;

/// Why a campaign cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// A built-in rig cannot be used at this resolution.
    #[error("rig {name} at {width} columns: {source}")]
    Geometry {
        /// The rig's name.
        name: &'static str,
        /// Columns of its picture.
        width: u16,
        /// What is wrong.
        source: GeometryError,
    },
    /// A built-in rig makes no rig at this resolution.
    #[error("rig {name} at {width} columns: {source}")]
    Rig {
        /// The rig's name.
        name: &'static str,
        /// Columns of its picture.
        width: u16,
        /// What is wrong.
        source: nearfield_shared::rig::RigError,
    },
    /// A scene cannot be drawn.
    #[error("scene {scene}: {source}")]
    Scene {
        /// Its number.
        scene: u64,
        /// What is wrong.
        source: SceneError,
    },
    /// A drawn picture does not fit its rig.
    #[error("scene {scene}: the picture does not fit its rig; this is a mistake of the program")]
    Picture {
        /// Its number.
        scene: u64,
    },
}

/// One rig's lines of sight and analysis.
struct Bench {
    name: &'static str,
    rig: Rig,
    view: Arc<View>,
    analyser: Analyser,
    encoder: LineScanEncoder,
    controller: Box<StripeMonitor<LARGEST_COLUMN_COUNT>>,
}

impl Bench {
    fn new(name: &'static str, mounting: Mounting, width: u16) -> Result<Self, CampaignError> {
        let rig =
            mounting.with_width(width).rig().map_err(|source| CampaignError::Rig { name, width, source })?;
        let geometry = |source| CampaignError::Geometry { name, width, source };
        let mut controller = Box::new(StripeMonitor::new());
        controller.configure(&rig, Decimation::for_line_scan(width)).map_err(geometry)?;
        Ok(Self {
            name,
            view: Arc::new(View::new(&rig)),
            analyser: Analyser::new(&rig).map_err(geometry)?,
            encoder: LineScanEncoder::new(&rig).map_err(geometry)?,
            controller,
            rig,
        })
    }
}

/// Everything that judges scenes; owns one bench for each rig.
pub struct Judge {
    benches: Vec<Bench>,
    has_code: bool,
}

impl Judge {
    /// Prepares for pictures of `width` columns.
    ///
    /// # Errors
    /// [`CampaignError`] for a width at which a rig does not resolve its stripe.
    pub fn new(width: u16) -> Result<Self, CampaignError> {
        let benches = RIGS.iter().map(|(name, mounting)| Bench::new(name, *mounting, width));
        Ok(Self { benches: benches.collect::<Result<_, _>>()?, has_code: false })
    }

    /// From now on every scene is a sequence of pictures with the laser dimmed by a code, and backgrounds are subtracted or not.
    #[must_use]
    pub fn with_laser_code(mut self, subtracts: bool) -> Self {
        self.has_code = true;
        for bench in self.benches.iter_mut().filter(|_| subtracts) {
            bench.analyser = bench.analyser.clone().with_background_subtraction();
        }
        self
    }

    /// Draws scene number `scene` and judges its picture.
    ///
    /// # Errors
    /// [`CampaignError`].
    pub fn judge(&mut self, scene: u64) -> Result<Outcome, CampaignError> {
        let turn = |after: u64, count: usize| (scene / after % count as u64) as usize;
        let bench = &mut self.benches[turn(1, RIGS.len())];
        let (theme_name, theme) = THEMES[turn(RIGS.len() as u64, THEMES.len())];
        let layout = LAYOUTS[turn((RIGS.len() * THEMES.len()) as u64, LAYOUTS.len())];
        let content = random_scene(scene, theme, bench.rig.stripe());
        let twin = Twin::new(Arc::clone(&bench.view), &content, scene)
            .map_err(|source| CampaignError::Scene { scene, source })?;
        let image = bench.rig.image();
        let picture = |number: u64, drive: f32| {
            let frame = Frame::new(image, Pixels::Rgb(twin.render(number, drive).rgb))
                .map_err(|_| CampaignError::Picture { scene })?;
            Ok::<Frame, CampaignError>(match layout {
                "yuv420" => frame.to_yuv420(),
                "nv12" => frame.to_nv12(),
                _ => frame,
            })
        };
        let frames = if self.has_code {
            (0..).zip(CODE).map(|(number, drive)| picture(number, drive)).collect::<Result<_, _>>()?
        } else {
            vec![picture(0, 1.0)?; VOTE_FRAMES]
        };
        let truth = twin.truth(1.0);
        let (controller_cut, time_us) = bench.look(&frames).ok_or(CampaignError::Picture { scene })?;
        let mut families =
            vec![format!("theme:{theme_name}"), format!("rig:{}", bench.name), format!("layout:{layout}")];
        families.extend(families_of(&content));
        Ok(Outcome {
            scene,
            families,
            expected: expected(truth.cutoff),
            true_gap_mm: truth.longest_gap_mm.tolerance_5,
            faintest: twin.faintest_stretch(&truth, 1.0).min(MOST_RATIO),
            host_cut: bench.analyser.report().is_cut(),
            controller_cut,
            gap_mm: bench.analyser.report().longest_gap().map_or(0.0, |gap| gap.length().get()),
            objects: objects(&content, &truth, &bench.analyser),
            reliability: reliability(&truth, &bench.analyser),
            time_us,
        })
    }
}

impl Bench {
    /// The controller's verdict after the last of some frames, and the time that it took; `None` for a foreign frame.
    fn look(&mut self, frames: &[Frame]) -> Option<(bool, u64)> {
        self.analyser.reset();
        self.controller.reset();
        let mut time_us = 0;
        let mut cut = true;
        for frame in frames {
            let started = Instant::now();
            self.analyser.update(&frame.view()).ok()?;
            let extractor = self.analyser.extractor();
            let columns = self.encoder.encode(extractor.readings(), extractor.geometry());
            time_us = u64::try_from(started.elapsed().as_micros()).unwrap_or(u64::MAX);
            cut = self.controller.update(columns.iter().map(reading_of)).is_cut();
        }
        Some((cut, time_us))
    }
}

fn reading_of(column: &LineScanColumn) -> ColumnReading {
    ColumnReading { row: column.row.to_pixels().unwrap_or(f32::NAN), quality: column.quality }
}

const fn expected(cutoff: crate::twin::ExpectedCutoff) -> ExpectedCutoff {
    match cutoff {
        crate::twin::ExpectedCutoff::Trip => ExpectedCutoff::Trip,
        crate::twin::ExpectedCutoff::NoTrip => ExpectedCutoff::NoTrip,
        crate::twin::ExpectedCutoff::Borderline => ExpectedCutoff::Borderline,
        crate::twin::ExpectedCutoff::StripeMissing => ExpectedCutoff::StripeMissing,
    }
}

fn families_of(scene: &Scene) -> Vec<String> {
    let kind = serde_json::to_value(scene.floor.kind).ok();
    let floor = kind.as_ref().and_then(serde_json::Value::as_str).unwrap_or("other");
    let light = match scene.light.lux {
        lux if lux < 200.0 => "dim",
        lux if lux < 1000.0 => "office",
        _ => "bright",
    };
    let paint = if scene.floor.paint.is_empty() { "none" } else { "some" };
    vec![format!("floor:{floor}"), format!("light:{light}"), format!("paint:{paint}")]
}

fn material_name(choice: &MaterialChoice) -> String {
    match choice {
        MaterialChoice::Named(name) => name.clone(),
        MaterialChoice::Own(_) => "own".to_owned(),
    }
}

/// For each object that the stripe is seen on: the found one that shares most of its rays.
fn objects(scene: &Scene, truth: &Truth, analyser: &Analyser) -> Vec<ObjectOutcome> {
    let pairs = scene.objects.iter().zip(&truth.objects);
    pairs
        .filter_map(|(object, truth)| {
            let heights = truth.heights.as_ref()?;
            let common = |start: f64, end: f64| heights.end_mm.min(end) - heights.start_mm.max(start);
            let found = analyser
                .objects()
                .iter()
                .filter(|found| found.height.is_some())
                .map(|found| (common(f64::from(found.start.get()), f64::from(found.end.get())), found))
                .filter(|(common, _)| *common > 0.0)
                .max_by(|(one, _), (other, _)| one.total_cmp(other));
            Some(ObjectOutcome {
                material: material_name(&object.material),
                width_mm: heights.end_mm - heights.start_mm,
                expected_mm: heights.p95_mm,
                measured_mm: found.and_then(|(_, found)| found.height).map(|height| height.get()),
            })
        })
        .collect()
}

fn reliability(truth: &Truth, analyser: &Analyser) -> [[u32; 2]; RELIABILITY_BINS] {
    let readings = analyser.extractor().readings();
    let mut true_rows: Vec<Vec<f64>> = vec![Vec::new(); readings.len()];
    let profile = &truth.profile;
    for ((visible, column), row) in profile.visible.iter().zip(&profile.column).zip(&profile.row) {
        let (true, Some(column), Some(row)) = (*visible, column, row) else { continue };
        // A millimetre of the stripe is up to three columns; `as` saturates at zero.
        let middle = column.round() as usize;
        for near in middle.saturating_sub(1)..(middle + 2).min(true_rows.len()) {
            true_rows[near].push(*row);
        }
    }
    let mut bins = [[0; 2]; RELIABILITY_BINS];
    for (reading, rows) in readings.iter().zip(&true_rows) {
        if reading.row.is_nan() || rows.is_empty() {
            continue;
        }
        let right = rows.iter().any(|row| (row - f64::from(reading.row)).abs() <= RIGHT_PX);
        let bin = &mut bins[usize::from(reading.quality.get()) * RELIABILITY_BINS / 256];
        *bin = [bin[0] + 1, bin[1] + u32::from(right)];
    }
    bins
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_has_one_outcome_whenever_it_is_judged() {
        let mut judge = Judge::new(1152).unwrap();
        let mut outcomes = |scene: u64| {
            let outcome = judge.judge(scene).unwrap();
            Outcome { time_us: 0, ..outcome }
        };
        let before = [3, 10].map(&mut outcomes);
        let _ = outcomes(4);
        assert_eq!(before, [3, 10].map(&mut outcomes));
        assert!(before[0].families.contains(&"theme:object".to_owned()), "{:?}", before[0].families);
        assert!(before[1].families.contains(&"layout:yuv420".to_owned()), "{:?}", before[1].families);
    }
}
