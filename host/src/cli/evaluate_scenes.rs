//! `nearfield evaluate-scenes`: how well the vision does on pictures whose truth is known.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::capture::read_frame;
use crate::scene_file::{ExpectedCutoff, Scene};
use crate::vision::Analyser;

/// Measure the vision on pictures whose truth is known (scene-1 JSON beside each picture).
#[derive(Debug, Args)]
pub struct EvaluateScenes {
    /// Directory with scene files, searched with its subdirectories.
    directory: PathBuf,
    /// One JSON object a picture instead of a table.
    #[arg(long)]
    json: bool,
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
    /// Did tier 1 stop?
    pub cutoff: bool,
    /// Is the verdict right (borderline ones always are)?
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
    pub time_us: u128,
}

/// Evaluates one scene.
///
/// # Errors
/// The picture or its rig cannot be used.
pub fn evaluate(scene: &Scene, layout: Layout) -> anyhow::Result<SceneResult> {
    let frame = read_frame(&scene.picture, scene.rig.image())?;
    let frame = match layout {
        Layout::AsRead => frame,
        Layout::Yuv420 => frame.to_yuv420(),
        Layout::Nv12 => frame.to_nv12(),
    };
    let mut analyser = Analyser::new(&scene.rig).with_context(|| scene.name.clone())?;
    analyser.judge(&frame.view()).with_context(|| scene.name.clone())?;
    let started = Instant::now();
    analyser.judge(&frame.view()).with_context(|| scene.name.clone())?;
    let time_us = started.elapsed().as_micros();
    Ok(compare(scene, &analyser, time_us))
}

fn compare(scene: &Scene, analyser: &Analyser, time_us: u128) -> SceneResult {
    let cutoff = analyser.report().is_cut();
    let (expected, right) = match scene.cutoff {
        ExpectedCutoff::Trip => ("trip", cutoff),
        ExpectedCutoff::NoTrip => ("no_trip", !cutoff),
        ExpectedCutoff::Borderline => ("borderline", true),
        ExpectedCutoff::StripeMissing => ("stripe_missing", cutoff),
    };
    let rows = RowStatistics::of(scene, analyser);
    SceneResult {
        name: scene.name.clone(),
        expected,
        cutoff,
        right,
        longest_gap_mm: analyser.report().cutoff.voted.map_or(0.0, |gap| gap.length().get()),
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
    /// A scene or a picture cannot be used.
    pub fn run(&self) -> anyhow::Result<u8> {
        let scenes = Scene::load_all(&self.directory)?;
        let mut results = Vec::with_capacity(scenes.len());
        if !self.json {
            println!(
                "{:<24} {:<14} {:<5} {:>9} {:>9}  {:>7} {:>6} {:>7} {:>8}  heights: found (true) mm",
                "picture", "expected", "host", "gap mm", "true mm", "bias px", "dev px", "missed", "time us"
            );
        }
        for scene in &scenes {
            let result = evaluate(scene, self.layout)?;
            if self.json {
                println!("{}", serde_json::to_string(&result)?);
            } else {
                println!("{}", row(&result));
            }
            results.push(result);
        }
        if !self.json {
            println!("{}", summary(&results));
        }
        Ok(u8::from(results.iter().any(|result| !result.right)))
    }
}

fn row(result: &SceneResult) -> String {
    let number = |value: Option<f32>, factor: f32| {
        value.map_or("-".to_owned(), |value| format!("{:.2}", value * factor))
    };
    let heights: Vec<String> = result
        .heights
        .iter()
        .map(|height| {
            let measured = height.measured_mm.map_or("?".to_owned(), |measured| format!("{measured:.2}"));
            format!("{} {measured} ({:.2})", height.name, height.expected_mm)
        })
        .collect();
    format!(
        "{:<24} {:<14} {:<5} {:>9.2} {:>9.2}  {:>7} {:>6} {:>6}% {:>8}  {}{}",
        result.name,
        result.expected,
        if result.cutoff { "cut" } else { "whole" },
        result.longest_gap_mm,
        result.expected_gap_mm,
        number(result.row_bias_px, 1.0),
        number(result.row_deviation_px, 1.0),
        number(result.missed_floor, 100.0),
        result.time_us,
        heights.join(", "),
        if result.right { "" } else { "   WRONG" },
    )
}

fn summary(results: &[SceneResult]) -> String {
    let wrong = results.iter().filter(|result| !result.right).count();
    let errors: Vec<f32> = results
        .iter()
        .flat_map(|result| &result.heights)
        .filter_map(|height| height.measured_mm.map(|measured| measured - height.expected_mm))
        .collect();
    let count = errors.len().max(1) as f32;
    let square: f32 = errors.iter().map(|error| error * error).sum();
    let bias: f32 = errors.iter().sum::<f32>() / count;
    format!(
        "{} pictures, {wrong} wrong; heights of {} objects: RMSE {:.2} mm, bias {bias:.2} mm",
        results.len(),
        errors.len(),
        (square / count).sqrt(),
    )
}
