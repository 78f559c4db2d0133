//! `nearfield evaluate`: how good is the detector on pictures whose objects are known?

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use serde::Serialize;

use super::detect::progress;
use super::{BAD_INPUT, DetectorArguments};
use crate::card::Card;
use crate::detector::Detector;
use crate::evaluate::coco::{Dataset, parts};
use crate::evaluate::run::{Part, PartReport, detect_all, from_coco, to_coco};
use crate::evaluate::{page, paper};

/// Judge the detector on pictures whose objects are known.
///
/// The dataset is a folder with images/ and annotations.json (COCO), or a folder of such folders, which are judged one by
/// one. Classes are matched by name: case, spaces, hyphens and common synonyms do not matter ("Allen Key" = "hex-key" =
/// "allen_key"). Names that the detector does not know are listed and left out.
///
/// Told: COCO's twelve numbers as pycocotools defines them; precision, recall and F1 for each class at the operating
/// point, beside the source paper's; people found, with 95 % intervals; confusion; calibration of the confidences. Exit
/// code 2 if a picture has no answer: its objects count as not found.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield evaluate --dataset pictures/
  nearfield evaluate --dataset pictures/ --json | jq '.[].coco.ap50'
  nearfield evaluate --dataset pictures/ --html report/           report/index.html shows the worst pictures
  nearfield evaluate --dataset pictures/val --fit-card new.json   operating points and calibration from these pictures
  nearfield evaluate --dataset pictures/val --write-detections found.json   for other tools, as COCO results")]
pub struct Evaluate {
    #[command(flatten)]
    detector: DetectorArguments,
    /// Folder with images/ and annotations.json, or folder of such folders.
    #[arg(long, value_name = "DIR")]
    dataset: PathBuf,
    /// A JSON list with all figures of each part on standard output.
    #[arg(long)]
    json: bool,
    /// Write a page with tables, diagrams and the worst pictures into this directory.
    #[arg(long, value_name = "DIR")]
    html: Option<PathBuf>,
    /// Judge these detections (COCO results) instead of running a detector; the dataset must be a single part.
    #[arg(long, value_name = "FILE", conflicts_with = "write_detections")]
    detections: Option<PathBuf>,
    /// Write all detections as COCO results; the dataset must be a single part.
    #[arg(long, value_name = "FILE")]
    write_detections: Option<PathBuf>,
    /// Write the model's card with operating points and calibration fitted on this dataset; it must be a single part.
    #[arg(long, value_name = "FILE")]
    fit_card: Option<PathBuf>,
}

/// Scores below this do not count for the curves either.
const LEAST_SCORE: f32 = 0.005;

impl Evaluate {
    /// Runs the command; the exit code is 2 if a picture has no answer.
    ///
    /// # Errors
    /// The dataset or the network cannot be used, a file cannot be written.
    pub fn run(&self) -> anyhow::Result<u8> {
        let folders = parts(&self.dataset)?;
        let single = self.detections.is_some() || self.write_detections.is_some() || self.fit_card.is_some();
        anyhow::ensure!(
            !single || folders.len() == 1,
            "{}: has {} parts; name one of them",
            self.dataset.display(),
            folders.len()
        );
        let mut detector = self.detector.choice(Some(LEAST_SCORE)).load()?;
        let card = detector.card().clone();
        let datasets = folders
            .iter()
            .map(|folder| Dataset::read(folder, detector.classes()))
            .collect::<Result<Vec<_>, _>>()?;
        let pictures: usize = datasets.iter().map(|dataset| dataset.pictures.len()).sum();
        let bar = progress(pictures as u64, "pictures");
        let mut judged = Vec::new();
        for dataset in datasets {
            let (detections, unanswered) = match &self.detections {
                Some(path) => (from_coco(&dataset, path)?, Vec::new()),
                None => detect_all(&dataset, &mut detector, || bar.inc(1)),
            };
            let part = Part::new(dataset, detections, &card);
            let report = part.report(&card, unanswered);
            judged.push((part, report));
        }
        bar.finish_and_clear();
        self.tell(&card, &judged)?;
        let incomplete = judged.iter().any(|(_, report)| !report.unanswered.is_empty());
        Ok(if incomplete { BAD_INPUT } else { 0 })
    }

    fn tell(&self, card: &Card, judged: &[(Part, PartReport)]) -> anyhow::Result<()> {
        if self.json {
            let reports: Vec<&PartReport> = judged.iter().map(|(_, report)| report).collect();
            say!("{}", serde_json::to_string(&reports)?);
        } else {
            for (_, report) in judged {
                say!("{}", sentences(report));
            }
        }
        if let Some(directory) = &self.html {
            page::write(directory, &format!("Evaluation of {}", card.name), judged)?;
        }
        let Some((part, _)) = judged.first() else { return Ok(()) };
        if let Some(path) = &self.write_detections {
            write_json(path, &to_coco(&part.dataset, &part.detections))?;
        }
        if let Some(path) = &self.fit_card {
            write_json(path, &part.fitted(card))?;
        }
        Ok(())
    }
}

fn write_json(path: &PathBuf, value: &impl Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value)?;
    std::fs::write(path, text + "\n").with_context(|| format!("{}: cannot be written", path.display()))
}

/// A part's report for people.
fn sentences(report: &PartReport) -> String {
    let number = |value: Option<f64>| value.map_or("    -".to_owned(), |value| format!("{value:.3}"));
    let mut lines = vec![format!(
        "{}: {} pictures, {} objects; mAP50 {:.3}, mAP50:95 {:.3}",
        report.part, report.pictures, report.objects, report.coco.ap50, report.coco.ap
    )];
    lines.push(format!(
        "  {:<15} {:>7} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6}   {}",
        "class", "objects", "AP50", "AP", "score", "prec.", "recall", "F1", "paper: P, R, F1"
    ));
    for (figures, precision) in report.classes.iter().zip(&report.average_precision) {
        let paper = paper::figures(&figures.class)
            .map_or(String::new(), |row| format!("{:.2}, {:.2}, {:.2}", row.precision, row.recall, row.f1));
        let line = format!(
            "  {:<15} {:>7} {:>6} {:>6} {:>6.3} {:>6} {:>6} {:>6}   {}",
            figures.class,
            figures.objects,
            number(precision.ap50),
            number(precision.ap),
            figures.operating_score,
            number(figures.precision.share),
            number(figures.recall.share),
            number(figures.f1),
            paper,
        );
        lines.push(line.trim_end().to_owned());
    }
    lines.push(format!("  people found as that class:      {}", report.people.as_that_class));
    lines.push(format!("  people found as any human class: {}", report.people.as_a_person));
    lines.push(format!("  alarms with a person there:      {}", report.people.alarms_right));
    lines.push(format!(
        "  calibration error {:.3} (scores as they are: {:.3})",
        report.reliability.error, report.reliability_of_scores.error
    ));
    for (name, count) in &report.left_out {
        lines.push(format!("  not judged, the detector does not know it: {name} ({count} objects)"));
    }
    if !report.unanswered.is_empty() {
        lines.push(format!("  pictures without an answer: {}", report.unanswered.len()));
        for unanswered in report.unanswered.iter().take(5) {
            lines.push(format!("    {}", unanswered.unknown));
        }
    }
    lines.join("\n")
}
