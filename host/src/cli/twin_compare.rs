//! `nearfield twin compare`: the twin's pictures beside another renderer's.

use std::path::PathBuf;

use clap::Args;
use indicatif::ProgressBar;

use crate::scene_file::Scene;
use crate::twin::compare::{Comparison, Statistics, compare};

/// Compare the twin with pictures of another renderer, by measures of the stripe.
///
/// For every scene file ("schema": "scene-1") of DIR whose kind of floor the twin knows, the same bare floor is rendered with
/// the same rig and, where the file tells them, the same light and camera settings (`look`), and both pictures are measured
/// where the truth (`profile`; without it, a stripe without gaps) says that the floor is lit:
/// width of the stripe, its height over the ground and how uneven that is, how much the ground varies, and the error of a
/// fixed estimator (centre of gravity). Medians over columns; spreads are robust standard deviations.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield twin compare tests/pictures
  nearfield twin compare --json pictures | jq .given.contrast")]
pub struct Compare {
    /// Directory with scene files and their pictures.
    #[arg(value_name = "DIR")]
    directory: PathBuf,
    /// Chooses the twin's floor pattern, speckle and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON object a picture on standard output.
    #[arg(long)]
    json: bool,
}

/// A measure by name.
type Measure = (&'static str, fn(&Statistics) -> f64);
const MEASURES: [Measure; 6] = [
    ("width, rows", |statistics| statistics.width_rows),
    ("height, levels", |statistics| statistics.contrast),
    ("its unevenness", |statistics| statistics.unevenness),
    ("ground's variation, levels", |statistics| statistics.ground),
    ("estimator's bias, rows", |statistics| statistics.bias_rows),
    ("its deviation, rows", |statistics| statistics.error_rows),
];

impl Compare {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let scenes = Scene::load_all(&self.directory)?;
        let bar = ProgressBar::new(scenes.len() as u64);
        let mut compared = Vec::new();
        for scene in &scenes {
            match compare(scene, self.seed) {
                Ok(Some(comparison)) => compared.push(comparison),
                Ok(None) => {
                    bar.suspend(|| eprintln!("{}: too little of the floor is lit, left out", scene.name))
                }
                Err(error) => bar.suspend(|| eprintln!("{}: left out: {error}", scene.name)),
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        if self.json {
            for comparison in &compared {
                say!("{}", serde_json::to_string(comparison)?);
            }
            return Ok(());
        }
        let names: Vec<&str> = MEASURES.iter().map(|(name, _)| *name).collect();
        say!("| picture | {} |", names.join(" | "));
        say!("|---|{}", "---|".repeat(MEASURES.len()));
        for comparison in &compared {
            let cells: Vec<String> = MEASURES.iter().map(|(_, of)| cell(comparison, *of)).collect();
            say!("| {} | {} |", comparison.name, cells.join(" | "));
        }
        let middle: Vec<String> = MEASURES.iter().map(|(_, of)| medians(&compared, *of)).collect();
        say!("| **median of {}** | {} |", compared.len(), middle.join(" | "));
        Ok(())
    }
}

/// Given, then the twin's.
fn cell(comparison: &Comparison, of: fn(&Statistics) -> f64) -> String {
    format!("{}, {}", short(of(&comparison.given)), short(of(&comparison.twin)))
}

fn medians(compared: &[Comparison], of: fn(&Statistics) -> f64) -> String {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let given = median(compared.iter().map(|comparison| of(&comparison.given)).collect());
    let twin = median(compared.iter().map(|comparison| of(&comparison.twin)).collect());
    format!("{}, {}", short(given), short(twin))
}

fn short(value: f64) -> String {
    if value.abs() >= 10.0 { format!("{value:.0}") } else { format!("{value:.2}") }
}
