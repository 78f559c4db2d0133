//! `nearfield replay` on recordings of `nearfield run`: every decision of the controller again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use indicatif::{ProgressBar, ProgressStyle};
use nearfield_recording::Recording;
use nearfield_recording::folder::{Folder, is_recording_name};
use serde::Serialize;

use crate::run::redecide::{Redecided, redecide};

/// Exit code for a decision that is not the same.
const DIFFERENT: u8 = 1;

/// One line of `--json`.
#[derive(Debug, Serialize)]
struct Report {
    run: String,
    module: String,
    /// First and last file.
    segments: [u32; 2],
    same: bool,
    #[serde(flatten)]
    redecided: Redecided,
}

/// The recordings that a path names; `None` = it names none.
///
/// # Errors
/// The folder cannot be read.
pub fn recordings_at(path: &Path) -> anyhow::Result<Option<Vec<PathBuf>>> {
    if path.is_file() {
        let is_recording = path.file_name().and_then(|name| name.to_str()).is_some_and(is_recording_name);
        return Ok(is_recording.then(|| vec![path.to_path_buf()]));
    }
    if !path.is_dir() {
        return Ok(None);
    }
    let folder = Folder::open(path)?;
    let entries = folder.entries().with_context(|| format!("{}: cannot read the folder", path.display()))?;
    let paths: Vec<PathBuf> = entries.into_iter().map(|entry| path.join(entry.name)).collect();
    Ok(Some(paths).filter(|paths| !paths.is_empty()))
}

/// Decides all of them again, run by run; exit code 1 if anything is not the same.
///
/// # Errors
/// A recording cannot be read or used.
pub fn replay(paths: &[PathBuf], json: bool) -> anyhow::Result<u8> {
    let mut runs: BTreeMap<(String, String), Vec<(u32, PathBuf)>> = BTreeMap::new();
    for path in paths {
        let recording = Recording::open(path)?;
        let Some(configuration) = recording.configuration() else {
            eprintln!("warning: {}: breaks off before anything was recorded", path.display());
            continue;
        };
        let key = (configuration.run.clone(), configuration.module.clone());
        runs.entry(key).or_default().push((configuration.segment, path.clone()));
    }
    if runs.is_empty() {
        bail!(
            "there is nothing in {}",
            paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
        );
    }
    let bar = ProgressBar::new(paths.len() as u64).with_style(style());
    let mut code = 0;
    for ((run, module), mut segments) in runs {
        segments.sort();
        let mut recordings = Vec::new();
        for (_, path) in &segments {
            recordings.push(Recording::open(path)?);
            bar.inc(1);
        }
        let redecided = redecide(&recordings).with_context(|| format!("the run of {run}"))?;
        let numbers = segments.iter().map(|(number, _)| *number);
        let ends = [numbers.clone().min().unwrap_or(0), numbers.max().unwrap_or(0)];
        let report = Report { run, module, segments: ends, same: redecided.is_same(), redecided };
        if !report.same {
            code = DIFFERENT;
        }
        bar.suspend(|| tell(&report, json))?;
    }
    bar.finish_and_clear();
    Ok(code)
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{bar:30} {pos} of {len} recordings")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}

fn tell(report: &Report, json: bool) -> anyhow::Result<()> {
    if json {
        say!("{}", serde_json::to_string(report)?);
        return Ok(());
    }
    let Redecided {
        replies,
        different_replies,
        unasked,
        statuses,
        different_statuses,
        stops,
        cut_off,
        differences,
    } = &report.redecided;
    say!(
        "{} {}, segments {} to {}: {stops} stops",
        report.module,
        report.run,
        report.segments[0],
        report.segments[1]
    );
    say!(
        "  controller asked again: {replies} replies, {different_replies} different; {unasked} could not be asked"
    );
    say!("  line-scans judged again: {statuses} statuses, {different_statuses} different");
    if *cut_off > 0 {
        say!("  {cut_off} recordings were cut off; all that is whole in them was used");
    }
    for difference in differences {
        say!("  {difference}");
    }
    say!("  {}", if report.same { "every decision is the same, bit for bit" } else { "NOT the same" });
    Ok(())
}
