//! `nearfield detect`: what lies on the floor in these pictures?

use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::Args;
use image::{Rgb, RgbImage};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::{BAD_INPUT, DetectorArguments, parse_share};
use crate::class::is_human;
use crate::detector::{Detection, Detector, Picture, Unknown};
use crate::draw::labelled_box;
use crate::evaluate::run::read_picture;
use crate::watch::Watched;

/// Find and name objects in pictures.
///
/// For each picture: the objects with class, score (0 to 1, for ranking), confidence (a calibrated probability) and box
/// (left, top, width, height in pixels), or "unknown" with the reason. A detector that is late or fails has not seen an
/// empty floor. Exit code 2 if a picture cannot be used or stays unknown; the others are still reported.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield detect photo.jpg
  nearfield detect --json *.png | jq -r '.objects[]? | select(.human) | .class'
  nearfield detect --annotate seen/ --windows 1 photo.jpg      the whole picture only: quicker, misses small things
  nearfield detect --model mine.onnx --min-score 0.2 photo.jpg")]
pub struct Detect {
    #[command(flatten)]
    detector: DetectorArguments,
    /// One JSON object a picture on standard output.
    #[arg(long)]
    json: bool,
    /// Write the pictures with boxes drawn on them into this directory.
    #[arg(long, value_name = "DIR")]
    annotate: Option<PathBuf>,
    /// Report from this score on; default: each class's operating point from the model's card.
    #[arg(long, value_name = "SCORE", value_parser = parse_share)]
    min_score: Option<f32>,
    /// An answer that takes longer than this is "unknown", milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 60_000)]
    deadline: u64,
    /// Pictures: PNG or JPEG.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

/// One object as programs read it.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct ObjectReport {
    class: String,
    human: bool,
    score: f32,
    confidence: f32,
    /// Left, top, width, height, pixels; (0, 0) is the corner of the top left pixel.
    #[serde(rename = "box")]
    place: [f32; 4],
}

/// One picture as programs read it: either objects or unknown.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct PictureReport {
    image: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    objects: Option<Vec<ObjectReport>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    unknown: Option<String>,
    /// Milliseconds that it took, reading the file included.
    milliseconds: f64,
}

/// Boxes with more digits than they mean only make the output longer.
fn rounded(value: f32, digits: i32) -> f32 {
    let factor = 10f32.powi(digits);
    (value * factor).round() / factor
}

impl ObjectReport {
    fn new(detection: &Detection, classes: &[String]) -> Self {
        let class = classes[detection.class].clone();
        Self {
            human: is_human(&class),
            class,
            score: rounded(detection.score, 4),
            confidence: rounded(detection.confidence, 4),
            place: detection.place.as_coco().map(|value| rounded(value, 2)),
        }
    }
}

impl PictureReport {
    fn sentence(&self) -> String {
        let Some(objects) = &self.objects else {
            return format!("{}: unknown: {}", self.image, self.unknown.as_deref().unwrap_or_default());
        };
        if objects.is_empty() {
            return format!("{}: no known object", self.image);
        }
        let each = objects.iter().map(|object| {
            let [left, top, width, height] = object.place.map(f32::round);
            let (class, confidence) = (&object.class, object.confidence);
            let human = if object.human { " (human)" } else { "" };
            format!("  {class}{human}, confidence {confidence:.2}, at {left}, {top}, {width} x {height}")
        });
        format!("{}:\n{}", self.image, each.collect::<Vec<_>>().join("\n"))
    }
}

impl Detect {
    /// Runs the command; the exit code is 2 if a picture cannot be used or stays unknown.
    ///
    /// # Errors
    /// The network cannot be loaded, a drawing cannot be written.
    pub fn run(&self) -> anyhow::Result<u8> {
        if let Some(directory) = &self.annotate {
            std::fs::create_dir_all(directory)
                .with_context(|| format!("{}: cannot make the directory", directory.display()))?;
        }
        let detector = self.detector.choice(self.min_score).load()?;
        let mut detector = Watched::new(detector, Duration::from_millis(self.deadline))
            .context("no thread for the detector; end other programs")?;
        let bar = progress(self.images.len() as u64, "pictures");
        let mut used = HashSet::new();
        let mut code = 0;
        for path in &self.images {
            let start = Instant::now();
            let pixels = read_picture(path);
            let outcome = pixels
                .as_ref()
                .map_err(Clone::clone)
                .and_then(|pixels| detector.detect(Picture::try_from(pixels)?).map(<[Detection]>::to_vec));
            let milliseconds = start.elapsed().as_secs_f64() * 1000.0;
            let report = report(path, &outcome, detector.classes(), (milliseconds * 100.0).round() / 100.0);
            bar.suspend(|| self.tell(&report))?;
            if report.unknown.is_some() {
                code = BAD_INPUT;
            }
            if let (Some(directory), Ok(pixels), Some(objects)) = (&self.annotate, pixels, &report.objects) {
                draw(directory, path, pixels, objects, &mut used)?;
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(code)
    }

    fn tell(&self, report: &PictureReport) -> anyhow::Result<()> {
        if self.json {
            say!("{}", serde_json::to_string(report)?);
        } else if report.unknown.is_some() {
            eprintln!("{}", report.sentence());
        } else {
            say!("{}", report.sentence());
        }
        Ok(())
    }
}

fn report(
    path: &Path,
    outcome: &Result<Vec<Detection>, Unknown>,
    classes: &[String],
    milliseconds: f64,
) -> PictureReport {
    let objects =
        outcome.as_ref().ok().map(|found| found.iter().map(|one| ObjectReport::new(one, classes)).collect());
    let unknown = outcome.as_ref().err().map(ToString::to_string);
    PictureReport { image: path.display().to_string(), objects, unknown, milliseconds }
}

/// Red for people, green for things.
fn draw(
    directory: &Path,
    path: &Path,
    mut picture: RgbImage,
    objects: &[ObjectReport],
    used: &mut HashSet<OsString>,
) -> anyhow::Result<()> {
    for object in objects.iter().rev() {
        let [left, top, width, height] = object.place;
        let place = crate::boxes::BoundingBox { left, top, right: left + width, bottom: top + height };
        let colour = if object.human { Rgb([230, 40, 40]) } else { Rgb([60, 200, 90]) };
        labelled_box(&mut picture, &place, &format!("{} {:.2}", object.class, object.confidence), colour);
    }
    let stem = path.file_stem().unwrap_or_default();
    let mut name = stem.to_owned();
    let mut copy = 2;
    while !used.insert(name.clone()) {
        name = stem.to_owned();
        name.push(format!("-{copy}"));
        copy += 1;
    }
    name.push(".png");
    let target = directory.join(name);
    picture.save(&target).with_context(|| format!("{}: cannot be written", target.display()))
}

/// A bar on the terminal; nothing where there is none.
pub(super) fn progress(length: u64, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template(&format!("{{bar:40}} {{pos}}/{{len}} {what}, {{eta}} to go"))
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length).with_style(style)
}
