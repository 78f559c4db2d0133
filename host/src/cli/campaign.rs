//! `nearfield evaluate-twin`: thousands of made-up scenes, how often host and controller are wrong about them.

use std::collections::HashSet;
use std::fs::{File, OpenOptions};
use std::io::{BufRead as _, BufReader, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc;

use anyhow::{Context as _, bail};
use clap::Args;

use crate::campaign::Outcome;
use crate::campaign::run::{CampaignError, Judge};
use crate::campaign::tables::Summary;

/// Judge thousands of made-up scenes and count what is wrong, by family, with 95 % intervals.
///
/// Scene number N is always the same scene: any floor, light, paint, object and material, seen by three rigs in three
/// pixel layouts in turn. With --out every outcome is kept, one JSON object a line, and a second run goes on where the
/// first one stopped. Exit code 1 if an object was missed or a clean floor stopped.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield evaluate-twin                                       scenes 0 to 1999
  nearfield evaluate-twin --first 10000 --scenes 500 --json     other scenes; the summary as one JSON object
  nearfield evaluate-twin --scenes 20000 --out outcomes.jsonl   can be stopped and started again")]
pub struct Campaign {
    /// How many scenes.
    #[arg(long, default_value_t = 2000)]
    scenes: u64,
    /// Number of the first scene.
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Columns of the pictures.
    #[arg(long, default_value_t = 1152, value_parser = clap::value_parser!(u16).range(320..=4608))]
    width: u16,
    /// Keep every outcome in this file, and do not judge again what it holds: one file for one set of the other options.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Show every scene as a sequence of pictures, with the laser dimmed as by the controller's code.
    #[arg(long)]
    laser_code: bool,
    /// Subtract the ground that this tells.
    #[arg(long, requires = "laser_code")]
    subtract_background: bool,
    /// The summary as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Scenes between two lines of progress where nobody watches a terminal.
const PROGRESS_STEP: usize = 500;

impl Campaign {
    /// Runs the command; the exit code is 1 if any verdict was wrong.
    ///
    /// # Errors
    /// The file of outcomes cannot be used, or a scene cannot be drawn.
    pub fn run(&self) -> anyhow::Result<u8> {
        let end = self.first.checked_add(self.scenes).context("--first and --scenes: numbers end at 2^64")?;
        let mut outcomes = self.out.as_deref().map_or(Ok(Vec::new()), load)?;
        outcomes.retain(|outcome| (self.first..end).contains(&outcome.scene));
        let known: HashSet<u64> = outcomes.iter().map(|outcome| outcome.scene).collect();
        let wanted: Vec<u64> = (self.first..end).filter(|scene| !known.contains(scene)).collect();
        let mut file = self.out.as_deref().map(append).transpose()?;
        judge_all(&wanted, (self.width, [self.laser_code, self.subtract_background]), |outcome| {
            if let Some((path, file)) = &mut file {
                writeln!(file, "{}", serde_json::to_string(&outcome)?)
                    .with_context(|| format!("{}: cannot write", path.display()))?;
            }
            outcomes.push(outcome);
            Ok(())
        })?;
        outcomes.sort_unstable_by_key(|outcome| outcome.scene);
        let summary = Summary::of(&outcomes);
        if self.json {
            say!("{}", serde_json::to_string(&summary)?);
        } else {
            say!("{}", summary.text().trim_end());
        }
        Ok(u8::from(!summary.false_stops.is_empty() || !summary.misses.is_empty()))
    }
}

/// Judges on all cores; `take` gets the outcomes as they come.
fn judge_all(
    scenes: &[u64],
    (width, [has_code, subtracts]): (u16, [bool; 2]),
    mut take: impl FnMut(Outcome) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let workers = std::thread::available_parallelism().map_or(1, usize::from).min(scenes.len().max(1));
    let (sender, receiver) = mpsc::sync_channel::<Result<Outcome, CampaignError>>(workers);
    std::thread::scope(|scope| {
        for worker in 0..workers {
            let sender = sender.clone();
            scope.spawn(move || {
                let mut judge = match Judge::new(width) {
                    Ok(judge) if has_code => judge.with_laser_code(subtracts),
                    Ok(judge) => judge,
                    Err(error) => {
                        // Nobody listens any more only if another worker has failed before.
                        let _ = sender.send(Err(error));
                        return;
                    }
                };
                for scene in scenes.iter().skip(worker).step_by(workers) {
                    if sender.send(judge.judge(*scene)).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        let mut done = 0;
        // Moved in, so that the workers see it gone if this ends early.
        for outcome in receiver {
            take(outcome?)?;
            done += 1;
            show_progress(done, scenes.len());
        }
        Ok(())
    })
}

fn show_progress(done: usize, count: usize) {
    let mut stream = std::io::stderr().lock();
    // Progress that cannot be shown is no reason to stop.
    let _ = if stream.is_terminal() {
        let filled = 40 * done / count.max(1);
        let end = if done == count { "\n" } else { "" };
        write!(stream, "\r[{:<40}] {done} of {count} scenes{end}", "#".repeat(filled))
    } else if done.is_multiple_of(PROGRESS_STEP) {
        writeln!(stream, "{done} of {count} scenes")
    } else {
        Ok(())
    };
}

/// The outcomes of an earlier run.
fn load(path: &Path) -> anyhow::Result<Vec<Outcome>> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(|| format!("{}: cannot read", path.display())),
    };
    let mut outcomes = Vec::new();
    for (number, line) in BufReader::new(file).lines().enumerate() {
        let line = line.with_context(|| format!("{}: cannot read", path.display()))?;
        match serde_json::from_str(&line) {
            Ok(outcome) => outcomes.push(outcome),
            Err(error) => bail!(
                "{}: line {} is no outcome of a campaign ({error}); remove the line, or give another file",
                path.display(),
                number + 1
            ),
        }
    }
    Ok(outcomes)
}

fn append(path: &Path) -> anyhow::Result<(PathBuf, File)> {
    let file = OpenOptions::new().create(true).append(true).open(path);
    Ok((path.to_path_buf(), file.with_context(|| format!("{}: cannot write", path.display()))?))
}
