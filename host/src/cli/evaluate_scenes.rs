//! `nearfield evaluate-scenes`: how well the vision does on pictures whose truth is known.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;
use clap::{Args, ValueEnum};
use serde::Serialize;

use super::mcu::{Examiner, McuChoice, McuVerdict, relay_name};
use super::replay::Player;
use crate::capture::{Frame, read_frame};
use crate::line_scan::LineScanEncoder;
use crate::scene_file::{ExpectedCutoff, Scene};
use crate::vision::Analyser;

/// Measure host and safety controller on pictures whose truth is known (scene-1 JSON beside each picture).
///
/// Every picture by itself, then every sequence as such. Exit code 1 if a verdict is wrong.
#[derive(Debug, Args)]
pub struct EvaluateScenes {
    /// Directory with scene files, searched with its subdirectories.
    directory: PathBuf,
    /// One JSON object a picture instead of a table.
    #[arg(long)]
    json: bool,
    /// Which safety controller to ask.
    #[arg(long, value_enum, default_value_t)]
    mcu: McuChoice,
    /// Convert each picture to the layout that a camera would give.
    #[arg(long, value_enum, default_value_t = Layout::AsRead)]
    layout: Layout,
}

/// Layouts to evaluate in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Layout {
    /// As the file gives it.
    AsRead,
    /// YUV420 planar.
    Yuv420,
    /// YUV420 with interleaved chroma.
    Nv12,
}

impl Layout {
    fn of(self, frame: Frame) -> Frame {
        match self {
            Self::AsRead => frame,
            Self::Yuv420 => frame.to_yuv420(),
            Self::Nv12 => frame.to_nv12(),
        }
    }
}

/// One object's height against the truth.
#[derive(Debug, Clone, Serialize)]
pub struct HeightResult {
    /// The object's name.
    pub name: String,
    /// True 95 % height of the stripe on it, millimetres.
    pub expected_mm: f32,
    /// Measured; `None` where no stripe is seen on it.
    pub measured_mm: Option<f32>,
}

/// One picture against its truth.
#[derive(Debug, Clone, Serialize)]
pub struct SceneResult {
    /// The scene's name.
    pub name: String,
    /// `trip`, `no_trip`, `borderline` or `stripe_missing`.
    pub expected: &'static str,
    /// Did the host's tier 1 stop?
    pub cutoff: bool,
    /// The safety controller's own verdict.
    pub mcu: McuVerdict,
    /// Are both verdicts right (borderline ones always are)?
    pub right: bool,
    /// Longest gap found, millimetres.
    pub longest_gap_mm: f32,
    /// Longest true gap, millimetres.
    pub expected_gap_mm: f32,
    /// Heights of the objects.
    pub heights: Vec<HeightResult>,
    /// Mean deviation of the row on lit floor, pixels.
    pub row_bias_px: Option<f32>,
    /// Standard deviation of it.
    pub row_deviation_px: Option<f32>,
    /// Share of the lit places at which no floor was found.
    pub missed_floor: Option<f32>,
    /// Time for the whole picture, microseconds.
    pub time_us: u64,
}

/// Evaluates one scene with a controller in this process.
///
/// # Errors
/// The picture or its rig cannot be used.
pub fn evaluate(scene: &Scene, layout: Layout) -> anyhow::Result<SceneResult> {
    evaluate_with(scene, layout, McuChoice::InProcess)
}

fn evaluate_with(scene: &Scene, layout: Layout, mcu: McuChoice) -> anyhow::Result<SceneResult> {
    let context = || scene.name.clone();
    let frame = layout.of(read_frame(&scene.picture, scene.rig.image())?);
    let mut analyser = Analyser::new(&scene.rig).with_context(context)?;
    let started = Instant::now();
    analyser.judge(&frame.view()).with_context(context)?;
    let time_us = u64::try_from(started.elapsed().as_micros())?;
    let extractor = analyser.extractor();
    let mut encoder = LineScanEncoder::new(&scene.rig).with_context(context)?;
    let columns = encoder.encode(extractor.readings(), extractor.geometry());
    let verdict = Examiner::new(mcu, &scene.rig)?.judge(columns).with_context(context)?;
    Ok(compare(scene, &analyser, verdict, time_us))
}

fn compare(scene: &Scene, analyser: &Analyser, mcu: McuVerdict, time_us: u64) -> SceneResult {
    let cutoff = analyser.report().is_cut();
    let (expected, right) = match scene.cutoff {
        ExpectedCutoff::Trip => ("trip", cutoff && !mcu.is_closed()),
        ExpectedCutoff::NoTrip => ("no_trip", !cutoff && mcu.is_closed()),
        ExpectedCutoff::Borderline => ("borderline", true),
        ExpectedCutoff::StripeMissing => ("stripe_missing", cutoff && !mcu.is_closed()),
    };
    let rows = RowStatistics::of(scene, analyser);
    SceneResult {
        name: scene.name.clone(),
        expected,
        cutoff,
        mcu,
        right,
        longest_gap_mm: analyser.report().longest_gap().map_or(0.0, |gap| gap.length().get()),
        expected_gap_mm: scene.longest_gap,
        heights: heights(scene, analyser),
        row_bias_px: rows.as_ref().map(|rows| rows.bias),
        row_deviation_px: rows.as_ref().map(|rows| rows.deviation),
        missed_floor: rows.as_ref().map(|rows| rows.missed),
        time_us,
    }
}

/// For each true object the found one that covers most of it.
fn heights(scene: &Scene, analyser: &Analyser) -> Vec<HeightResult> {
    let overlap = |range: [f32; 2], start: f32, end: f32| range[1].min(end) - range[0].max(start);
    scene
        .heights
        .iter()
        .map(|(name, expected)| {
            let found = analyser
                .objects()
                .iter()
                .filter(|object| object.height.is_some())
                .map(|object| (overlap(expected.range, object.start.get(), object.end.get()), object))
                .filter(|(common, _)| *common > 0.0)
                .max_by(|(one, _), (other, _)| one.total_cmp(other));
            HeightResult {
                name: name.clone(),
                expected_mm: expected.high,
                measured_mm: found.and_then(|(_, object)| object.height).map(|height| height.get()),
            }
        })
        .collect()
}

struct RowStatistics {
    bias: f32,
    deviation: f32,
    missed: f32,
}

impl RowStatistics {
    fn of(scene: &Scene, analyser: &Analyser) -> Option<Self> {
        let (mut sum, mut square, mut count) = (0.0, 0.0, 0.0);
        let total = scene.lit_rows.len() as f32;
        let geometry = analyser.extractor().geometry();
        for lit in &scene.lit_rows {
            let column = lit.column.round();
            let Some(reading) = analyser.extractor().readings().get(column as usize) else { continue };
            let Some(map) = geometry.map(column as usize) else { continue };
            // The truth's own slope carries its row to the middle of the column.
            let slope = geometry.map(column as usize + 1).map_or(0.0, |next| next.floor_row - map.floor_row);
            let difference = reading.row - (lit.row + (column - lit.column) * slope);
            if difference.abs() < 3.0 {
                sum += difference;
                square += difference * difference;
                count += 1.0;
            }
        }
        (count > 0.0).then(|| {
            let bias: f32 = sum / count;
            Self {
                bias,
                deviation: (square / count - bias * bias).max(0.0).sqrt(),
                missed: 1.0 - count / total,
            }
        })
    }
}

impl EvaluateScenes {
    /// Runs the command; the exit code is 1 if a verdict is wrong.
    ///
    /// # Errors
    /// A scene or a picture cannot be used, or the safety controller cannot be reached.
    pub fn run(&self) -> anyhow::Result<u8> {
        let scenes = Scene::load_all(&self.directory)?;
        let mut results = Vec::with_capacity(scenes.len());
        if !self.json {
            say!("{HEADING}");
        }
        for scene in &scenes {
            let result = evaluate_with(scene, self.layout, self.mcu)?;
            if self.json {
                say!("{}", serde_json::to_string(&result)?);
            } else {
                say!("{}", row(&result));
            }
            results.push(result);
        }
        if !self.json {
            say!("{}", summary(&results));
        }
        let mut right = results.iter().all(|result| result.right);
        for sequence in sequences(&scenes) {
            let result = play(&sequence, self.mcu)?;
            right &= result.right;
            if self.json {
                say!("{}", serde_json::to_string(&result)?);
            } else {
                say!("{}", result.sentence());
            }
        }
        Ok(u8::from(!right))
    }
}

const HEADING: &str = "picture                  expected       host  relay     gap mm   true mm  bias px dev px  missed  \
                       time us  heights: found (true) mm";

fn row(result: &SceneResult) -> String {
    let number = |value: Option<f32>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
    let heights: Vec<String> = result
        .heights
        .iter()
        .map(|height| format!("{} {} ({:.2})", height.name, number(height.measured_mm), height.expected_mm))
        .collect();
    format!(
        "{:<24} {:<14} {:<5} {:<6} {:>9.2} {:>9.2}  {:>7} {:>6} {:>6}% {:>8}  {}{}",
        result.name,
        result.expected,
        if result.cutoff { "cut" } else { "whole" },
        result.mcu.relay,
        result.longest_gap_mm,
        result.expected_gap_mm,
        number(result.row_bias_px),
        number(result.row_deviation_px),
        number(result.missed_floor.map(|share| share * 100.0)),
        result.time_us,
        heights.join(", "),
        if result.right { "" } else { "   WRONG" },
    )
}

fn summary(results: &[SceneResult]) -> String {
    let wrong = results.iter().filter(|result| !result.right).count();
    let all = results.iter().flat_map(|result| &result.heights);
    let unseen = all.clone().filter(|height| height.measured_mm.is_none()).count();
    let errors: Vec<f32> =
        all.filter_map(|height| height.measured_mm.map(|measured| measured - height.expected_mm)).collect();
    let count = errors.len().max(1) as f32;
    let square: f32 = errors.iter().map(|error| error * error).sum();
    let bias: f32 = errors.iter().sum::<f32>() / count;
    format!(
        "{} pictures, {wrong} wrong; heights of {} objects ({unseen} without one): RMSE {:.2} mm, bias {bias:.2} mm",
        results.len(),
        errors.len(),
        (square / count).sqrt(),
    )
}

/// When the relay opened in a sequence, against when it should.
#[derive(Debug, Clone, Serialize)]
pub struct SequenceResult {
    /// The sequence's name.
    pub sequence: String,
    /// Frames in it.
    pub frames: usize,
    /// First frame in which anything interrupts the stripe.
    pub first_interruption: Option<u32>,
    /// First frame that must stop.
    pub first_trip: Option<u32>,
    /// First frame at whose end the relay was open.
    pub relay_opened: Option<u32>,
    /// Not before the first interruption, not later than [`LATEST_STOP_FRAMES`] after the first frame that must stop.
    pub right: bool,
}

/// Frames after the first one that must stop, in which the relay must have opened.
pub const LATEST_STOP_FRAMES: u32 = 3;

impl SequenceResult {
    fn sentence(&self) -> String {
        let frame = |frame: Option<u32>| frame.map_or("never".to_owned(), |frame| format!("frame {frame}"));
        format!(
            "sequence {} of {} frames: first interruption {}, must stop {}, relay opened {}{}",
            self.sequence,
            self.frames,
            frame(self.first_interruption),
            frame(self.first_trip),
            frame(self.relay_opened),
            if self.right { "" } else { "   WRONG" },
        )
    }
}

/// The sequences among the scenes, each in the order of its frames.
#[must_use]
pub fn sequences(scenes: &[Scene]) -> Vec<Vec<&Scene>> {
    let mut by_name: BTreeMap<&str, Vec<(u32, &Scene)>> = BTreeMap::new();
    for scene in scenes {
        if let Some((name, frame)) = &scene.sequence {
            by_name.entry(name).or_default().push((*frame, scene));
        }
    }
    by_name
        .into_values()
        .map(|mut frames| {
            frames.sort_by_key(|(frame, _)| *frame);
            frames.into_iter().map(|(_, scene)| scene).collect()
        })
        .collect()
}

/// Plays a sequence at 50 frames per second through host and controller, and compares when the relay opens.
///
/// # Errors
/// A picture cannot be used, or the controller cannot be reached.
pub fn play(sequence: &[&Scene], mcu: McuChoice) -> anyhow::Result<SequenceResult> {
    let first = sequence.first().context("a sequence has at least one frame")?;
    let number = |scene: &&Scene| scene.sequence.as_ref().map_or(0, |(_, frame)| *frame);
    let mut player = Player::new(&first.rig, mcu, 50.0).with_context(|| first.name.clone())?;
    let mut relay_opened = None;
    for scene in sequence {
        let (report, error) = player.play(&scene.picture)?;
        if let Some(error) = error {
            return Err(error);
        }
        if relay_opened.is_none() && report.relay == relay_name(false) {
            relay_opened = Some(number(scene));
        }
    }
    let first_interruption = sequence.iter().find(|scene| scene.longest_gap > 0.0).map(number);
    let must_stop =
        |scene: &&&Scene| matches!(scene.cutoff, ExpectedCutoff::Trip | ExpectedCutoff::StripeMissing);
    let first_trip = sequence.iter().find(must_stop).map(number);
    let too_early = relay_opened.is_some_and(|opened| first_interruption.is_none_or(|first| opened < first));
    let too_late =
        first_trip.is_some_and(|trip| relay_opened.is_none_or(|opened| opened > trip + LATEST_STOP_FRAMES));
    Ok(SequenceResult {
        sequence: first.sequence.as_ref().map_or_else(String::new, |(name, _)| name.clone()),
        frames: sequence.len(),
        first_interruption,
        first_trip,
        relay_opened,
        right: !too_early && !too_late,
    })
}
