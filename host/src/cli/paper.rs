//! `nearfield paper`: the source paper's own method beside this project's.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use indicatif::ProgressBar;

use crate::paper::table::{Count, PAPER_WIDTH, TableRow, compare, error_mm, seven_objects};
use crate::paper::trials::{self, PLACES, Pair, Trial, counted};
use crate::scene_file::Scene;

/// The source paper's own method (colour thresholds, Hough, top-down view, closed-form heights) beside this project's.
#[derive(Debug, Args)]
pub struct PaperArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The paper's table of seven objects, made again in the twin with the paper's rig, as Markdown.
    Table {
        /// One JSON object a row on standard output.
        #[arg(long)]
        json: bool,
    },
    /// The paper's detection trials, made again in the twin: kinds of objects in four directions at five places, by both methods.
    Trials {
        /// Columns of the pictures.
        #[arg(long, value_name = "PIXELS", default_value_t = 1152, value_parser = clap::value_parser!(u16).range(256..=4608))]
        width: u16,
        /// One JSON object a picture on standard output.
        #[arg(long)]
        json: bool,
    },
    /// Both methods' verdicts on pictures with known truth.
    Compare {
        /// One JSON object a picture on standard output, and one with the counts.
        #[arg(long)]
        json: bool,
        /// Directory with pictures and their scene files ("schema": "scene-1").
        #[arg(value_name = "DIR")]
        directory: PathBuf,
    },
}

impl PaperArguments {
    /// Does what was asked.
    ///
    /// # Errors
    /// Pictures that cannot be used.
    pub fn run(&self) -> anyhow::Result<u8> {
        match &self.command {
            Command::Table { json } => table(*json)?,
            Command::Trials { width, json } => detection(*width, *json)?,
            Command::Compare { json, directory } => count(*json, &Scene::load_all(directory)?)?,
        }
        Ok(0)
    }
}

fn table(json: bool) -> anyhow::Result<()> {
    let rows = seven_objects(PAPER_WIDTH)?;
    if json {
        for row in &rows {
            say!("{}", serde_json::to_string(row)?);
        }
        return Ok(());
    }
    let shown = |height: Option<f64>| height.map_or("none".to_owned(), |height| format!("{height:.1}"));
    say!(
        "| object | the paper measured | true | true on the stripe (95 %) | ours | closed form | closed form, pitch 2 degrees off |"
    );
    say!("|---|---|---|---|---|---|---|");
    for row in &rows {
        say!(
            "| {} | {:.0} | {:.1} | {} | {} | {} | {} |",
            row.object,
            row.paper_mm,
            row.true_mm,
            shown(row.lit_mm),
            shown(row.ours_mm),
            shown(row.closed_form_mm),
            shown(row.closed_form_off_mm)
        );
    }
    let error = |column: fn(&TableRow) -> Option<f64>| shown(error_mm(&rows, column));
    say!(
        "| RMSE against the stripe's truth | 18.1 (against true) | | | {} | {} | {} |",
        error(|row| row.ours_mm),
        error(|row| row.closed_form_mm),
        error(|row| row.closed_form_off_mm)
    );
    Ok(())
}

fn detection(width: u16, json: bool) -> anyhow::Result<()> {
    let bar = ProgressBar::new(trials::count());
    let all = trials::play(width, || bar.inc(1))?;
    bar.finish_and_clear();
    if json {
        for trial in &all {
            say!("{}", serde_json::to_string(trial)?);
        }
        return Ok(());
    }
    let (laid, clean): (Vec<Trial>, Vec<Trial>) = all.into_iter().partition(|trial| trial.expected_trip);
    say!("| object | trials | found by ours | by the paper's pipeline |");
    say!("|---|---|---|---|");
    let row = |name: &str, Pair { ours, paper }: &Pair| -> anyhow::Result<()> {
        let of = ours.trips + ours.misses;
        say!("| {name} | {of} | {} | {} |", ours.trips, paper.trips);
        Ok(())
    };
    for (name, pair) in counted(&laid, |trial| trial.object) {
        row(name, &pair)?;
    }
    for (direction, pair) in counted(&laid, |trial| trial.direction_degrees) {
        row(&format!("turned by {direction} degrees"), &pair)?;
    }
    for (place, pair) in counted(&laid, |trial| trial.place) {
        row(&format!("at {:.0} % of the stripe, from the near end", 100.0 * PLACES[place]), &pair)?;
    }
    row("all", &counted(&laid, |_| ()).remove(&()).unwrap_or_default())?;
    let Pair { ours, paper } = counted(&clean, |_| ()).remove(&()).unwrap_or_default();
    let of = ours.clear + ours.false_trips;
    say!(
        "\nClean floors that tripped, of {of}: ours {}, the paper's pipeline {}.",
        ours.false_trips,
        paper.false_trips
    );
    Ok(())
}

fn count(json: bool, scenes: &[Scene]) -> anyhow::Result<()> {
    let (mut ours, mut paper, mut borderline) = (Count::default(), Count::default(), 0);
    let bar = ProgressBar::new(scenes.len() as u64);
    for scene in scenes {
        let verdicts = compare(scene)?;
        bar.inc(1);
        let Some(verdicts) = verdicts else {
            borderline += 1;
            continue;
        };
        ours.add(verdicts.expected_trip, verdicts.ours);
        paper.add(verdicts.expected_trip, verdicts.paper);
        if json {
            say!("{}", serde_json::to_string(&verdicts)?);
        }
    }
    bar.finish_and_clear();
    if json {
        let counts = serde_json::json!({ "ours": ours, "paper": paper, "borderline": borderline });
        say!("{counts}");
        return Ok(());
    }
    say!("| method | cuts found | cuts missed | clear floors passed | false trips |");
    say!("|---|---|---|---|---|");
    for (name, count) in [("ours", ours), ("paper's pipeline", paper)] {
        say!("| {name} | {} | {} | {} | {} |", count.trips, count.misses, count.clear, count.false_trips);
    }
    say!("({borderline} borderline pictures left out)");
    Ok(())
}
