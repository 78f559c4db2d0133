//! `nearfield blackbox`: the controller's record of a stop, fetched, shown and replayed.

use std::io::{IsTerminal as _, stderr};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use nearfield_shared::causes::StopCause;
use nearfield_shared::linescan::LineScanColumn;
use nearfield_shared::rig::Rig;
use nearfield_shared::service::{FaultEntry, Summary};
use nearfield_shared::units::{Micros, Millimetres};
use serde::Serialize;

use super::mcu::{McuChoice, arm, cause_names, clean_floor};
use super::twin::{load_rig, load_scene};
use crate::black_box::simulated::SessionLink;
use crate::black_box::{Recording, Replay, ServiceClient, plot};
use crate::line_scan::LineScanEncoder;
use crate::link::{FrameFacts, InProcess, McuSession};
use crate::rig_file;
use crate::twin::{Picture, Twin, View};
use crate::vision::Analyser;

/// The stop was not shown again by the replay.
const NOT_REPRODUCED: u8 = 1;

/// The safety controller's record of a stop: fetch it, show it, replay it.
///
/// The controller keeps the line-scans, states and margins around its newest stop until it runs again. `fetch` writes
/// them into a file; `show` prints and draws them; `replay` puts the line-scans through the controller's own stripe
/// monitor and names the limit that decided.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield blackbox fetch --scene box_45 -o stop.nfbb   a simulated controller is stopped by a box
  nearfield blackbox show stop.nfbb --svg stop.svg       exchange by exchange, and a picture of the heights
  nearfield blackbox replay stop.nfbb                    gap 119.2 mm > IMMEDIATE_GAP 20 mm in one frame ...
  nearfield blackbox replay --json stop.nfbb | jq .deciders")]
pub struct BlackBoxArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Fetch(Fetch),
    Show(Show),
    Replay(ReplayStop),
}

/// Fetch the kept stop of a controller over the link into a file.
///
/// This version reaches simulated controllers: one is armed over a clean floor, a scene of the twin stops it, and its
/// black box is read through the same requests as on the robot.
#[derive(Debug, Args)]
struct Fetch {
    /// What stops the controller: a scene file, a ready-made scene (`nearfield twin scenes`), or random:SEED.
    #[arg(long, value_name = "SCENE")]
    scene: String,
    /// Rig file, or a built-in rig: centre, side, wide.
    #[arg(long, default_value = "centre", value_name = "RIG")]
    rig: String,
    /// Which simulated controller.
    #[arg(long, value_enum, default_value_t)]
    mcu: McuChoice,
    /// Chooses the floor's pattern, the speckle and the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The file to write.
    #[arg(short, long, default_value = "stop.nfbb", value_name = "FILE")]
    output: PathBuf,
    /// What was fetched as JSON on standard output.
    #[arg(long)]
    json: bool,
}

/// Print a fetched stop: exchanges, heights, fault log.
#[derive(Debug, Args)]
struct Show {
    /// A file that `fetch` has written.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Rig file, where the recording holds none.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Draw the stripe's heights around the stop into this file.
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// Everything as JSON on standard output.
    #[arg(long)]
    json: bool,
}

/// Decide a fetched stop again and name the limit that decided.
///
/// Exit code 0 if the line-scans show the stop again, 1 if they do not, 2 if the file cannot be replayed.
#[derive(Debug, Args)]
struct ReplayStop {
    /// A file that `fetch` has written.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Rig file, where the recording holds none.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// The replay as JSON on standard output.
    #[arg(long)]
    json: bool,
}

impl BlackBoxArguments {
    /// Runs the command; the exit code is 1 if a replay does not show the stop again.
    ///
    /// # Errors
    /// A file, scene or rig that cannot be used, or a controller that cannot be reached.
    pub fn run(&self) -> anyhow::Result<u8> {
        match &self.command {
            Command::Fetch(fetch) => fetch.run(),
            Command::Show(show) => show.run(),
            Command::Replay(replay) => replay.run(),
        }
    }
}

/// Frames of a scene in which a controller that is going to stop has stopped: liveness is the slowest.
const SCENE_FRAMES: u64 = 50;
/// Frames after the stop that fill the black box: its summaries, and some to spare.
const FRAMES_AFTER: u64 = 20;

impl Fetch {
    fn run(&self) -> anyhow::Result<u8> {
        let rig = load_rig(&self.rig)?;
        let mut session = self.mcu.start(&rig)?;
        self.stop(&rig, &mut session)?;
        let bar = progress_bar();
        let mut link = SessionLink::new(&mut session);
        let mut client = ServiceClient::new(&mut link, InProcess::SOURCE, first_number());
        let recording = client.fetch(|page, pages| {
            bar.set_length(u64::from(pages));
            bar.set_position(u64::from(page));
        })?;
        bar.finish_and_clear();
        let recording = recording.context("the controller keeps no stop")?;
        recording.save(&self.output)?;
        if self.json {
            say!("{}", serde_json::to_string(&StopFacts::of(&recording))?);
        } else {
            say!("{}", headline(&recording));
            say!(
                "{}: {} summaries, {} line-scans",
                self.output.display(),
                recording.summaries.len(),
                recording.scans.len()
            );
        }
        Ok(0)
    }

    /// Arms over the clean floor, then shows the scene until the relays open, and a little longer.
    fn stop(&self, rig: &Rig, session: &mut McuSession) -> anyhow::Result<()> {
        let mut camera = Camera::new(rig, &load_scene(&self.scene, rig)?, self.seed)?;
        if !arm(session, &clean_floor(rig)?)? {
            bail!(
                "the controller does not arm over a clean floor: {:?}",
                cause_names(session.status().live_causes)
            );
        }
        let mut left = SCENE_FRAMES;
        for frame in 0.. {
            session.run_columns(camera.columns(frame)?, FrameFacts::default())?;
            left -= 1;
            if left == 0 {
                break;
            }
            if !session.relay_commanded_closed() {
                left = left.min(FRAMES_AFTER);
            }
        }
        if session.relay_commanded_closed() {
            bail!("the scene {:?} does not stop the controller: there is nothing to fetch", self.scene);
        }
        Ok(())
    }
}

/// The twin's pictures of a scene as line-scan columns.
struct Camera {
    twin: Twin,
    picture: Picture,
    analyser: Analyser,
    encoder: LineScanEncoder,
}

impl Camera {
    fn new(rig: &Rig, scene: &crate::twin::Scene, seed: u64) -> anyhow::Result<Self> {
        Ok(Self {
            twin: Twin::new(Arc::new(View::new(rig)), scene, seed)?,
            picture: Picture::black(0, 0),
            analyser: Analyser::new(rig)?,
            encoder: LineScanEncoder::new(rig)?,
        })
    }

    fn columns(&mut self, frame: u64) -> anyhow::Result<&[LineScanColumn]> {
        self.twin.render_into(frame, 1.0, &mut self.picture);
        self.analyser.update(&self.picture.to_yuv420_frame()?.view())?;
        let extractor = self.analyser.extractor();
        Ok(self.encoder.encode(extractor.readings(), extractor.geometry()))
    }
}

/// On standard error; silent where that is no terminal.
pub(super) fn progress_bar() -> ProgressBar {
    let style = ProgressStyle::with_template("reading {wide_bar} {pos}/{len} pages")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = if stderr().is_terminal() { ProgressBar::new(1) } else { ProgressBar::hidden() };
    bar.with_style(style)
}

/// Different from run to run, so that no request looks like the last run's.
pub(super) fn first_number() -> u32 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(0, |since| (since.as_millis() & u128::from(u32::MAX)) as u32)
}

fn load(file: &Path, rig: Option<&Path>) -> anyhow::Result<Recording> {
    let mut recording = Recording::load(file)?;
    if let Some(path) = rig {
        recording.rig = Some(rig_file::load(path)?.to_bytes());
    }
    Ok(recording)
}

impl Show {
    fn run(&self) -> anyhow::Result<u8> {
        let recording = load(&self.file, self.rig.as_deref())?;
        let replay = Replay::of(&recording).with_context(|| self.file.display().to_string())?;
        if let Some(path) = &self.svg {
            std::fs::write(path, plot::to_svg(&replay))
                .with_context(|| format!("{}: cannot write the picture", path.display()))?;
        }
        if self.json {
            say!("{}", serde_json::to_string(&Shown::of(&recording, &replay))?);
            return Ok(0);
        }
        say!("{}\n", headline(&recording));
        say!(
            "     t ms  number  what                    state      gap mm  voted  highest  causes that came up"
        );
        for (position, summary) in recording.summaries.iter().enumerate() {
            if position == usize::from(recording.index.summaries_before) {
                say!("          --- stop ---");
            }
            say!("{}", row(&Exchange::of(summary, recording.index.time)));
        }
        say!("\nstripe (_ floor, bars up to {FULL_BAR_MM} mm, v below, ? no stripe):");
        for scan in &replay.scans {
            say!("{}\n  {}", plot::to_line(scan, TERMINAL_COLUMNS, FULL_BAR_MM), plot::heading(scan));
        }
        say!("\nfault log:");
        for fault in recording.faults.iter().map(Fault::of) {
            say!("  {}", fault_row(&fault));
        }
        Ok(0)
    }
}

const TERMINAL_COLUMNS: usize = 100;
const FULL_BAR_MM: f32 = 60.0;

impl ReplayStop {
    fn run(&self) -> anyhow::Result<u8> {
        let recording = load(&self.file, self.rig.as_deref())?;
        let replay = Replay::of(&recording).with_context(|| self.file.display().to_string())?;
        if self.json {
            say!("{}", serde_json::to_string(&replay)?);
        } else {
            say!("{}", headline(&recording));
            for scan in &replay.scans {
                say!("  {}", plot::heading(scan));
            }
            for decider in &replay.deciders {
                let by = if decider.replayed { "replayed" } else { "told by the controller" };
                say!("{}: {} ({by})", decider.cause, decider.words);
            }
            for mismatch in &replay.mismatches {
                say!("DIFFERS {mismatch}");
            }
            say!(
                "{}",
                if replay.reproduced { "the stop is reproduced" } else { "the stop is NOT reproduced" }
            );
        }
        Ok(if replay.reproduced { 0 } else { NOT_REPRODUCED })
    }
}

fn headline(recording: &Recording) -> String {
    let index = &recording.index;
    let causes: Vec<_> = index.causes.without(StopCause::Interlock).iter().map(StopCause::words).collect();
    format!("stop {} at {:.3} s: {}", index.stop, millis(index.time) / 1000.0, causes.join("; "))
}

fn millis(time: Micros) -> f64 {
    time.get() as f64 / 1000.0
}

/// A stop as programs read it.
#[derive(Debug, Serialize)]
struct StopFacts {
    stop: u32,
    time_ms: f64,
    causes: Vec<&'static str>,
    firmware: String,
    calibration: Option<String>,
    summaries: usize,
    line_scans: usize,
    complete: bool,
}

impl StopFacts {
    fn of(recording: &Recording) -> Self {
        let index = &recording.index;
        Self {
            stop: index.stop,
            time_ms: millis(index.time),
            causes: cause_names(index.causes),
            firmware: format!("{:08x}", index.firmware),
            calibration: index.calibration.map(|id| format!("{:08x}", id.get())),
            summaries: recording.summaries.len(),
            line_scans: recording.scans.len(),
            complete: index.complete,
        }
    }
}

/// `show --json`.
#[derive(Debug, Serialize)]
struct Shown<'a> {
    #[serde(flatten)]
    facts: StopFacts,
    exchanges: Vec<Exchange>,
    scans: &'a [crate::black_box::replay::ReplayedScan],
    faults: Vec<Fault>,
}

impl<'a> Shown<'a> {
    fn of(recording: &Recording, replay: &'a Replay) -> Self {
        Self {
            facts: StopFacts::of(recording),
            exchanges: recording
                .summaries
                .iter()
                .map(|summary| Exchange::of(summary, recording.index.time))
                .collect(),
            scans: &replay.scans,
            faults: recording.faults.iter().map(Fault::of).collect(),
        }
    }
}

/// A summary as programs read it; `t_ms` counts from the stop.
#[derive(Debug, Serialize)]
struct Exchange {
    t_ms: f64,
    sequence: u32,
    kind: &'static str,
    state: &'static str,
    causes: Vec<&'static str>,
    new_causes: Vec<&'static str>,
    single_gap_mm: Option<f32>,
    voted_gap_mm: Option<f32>,
    highest_mm: Option<f32>,
    lowest_mm: Option<f32>,
    laser_level: u8,
    capture_age_ms: f64,
    decision_age_ms: f64,
    liveness_doubt: u16,
    audit_doubt: u16,
    floor_columns: u16,
    watched_columns: u16,
}

impl Exchange {
    fn of(summary: &Summary, stop: Micros) -> Self {
        Self {
            t_ms: millis(summary.time) - millis(stop),
            sequence: summary.sequence.get(),
            kind: summary.kind.name(),
            state: summary.state.name(),
            causes: cause_names(summary.live_causes),
            new_causes: cause_names(summary.new_causes),
            single_gap_mm: summary.single_gap.map(Millimetres::get),
            voted_gap_mm: summary.voted_gap.map(Millimetres::get),
            highest_mm: summary.highest.map(Millimetres::get),
            lowest_mm: summary.lowest.map(Millimetres::get),
            laser_level: summary.laser_level,
            capture_age_ms: millis(summary.capture_age),
            decision_age_ms: millis(summary.decision_age),
            liveness_doubt: summary.liveness_score,
            audit_doubt: summary.audit_score,
            floor_columns: summary.floor_columns,
            watched_columns: summary.watched_columns,
        }
    }
}

fn row(exchange: &Exchange) -> String {
    let mm = |value: Option<f32>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
    format!(
        "{:9.1}  {:6}  {:22}  {:11} {:>6} {:>6}  {:>7}  {}",
        exchange.t_ms,
        exchange.sequence,
        exchange.kind,
        exchange.state,
        mm(exchange.single_gap_mm),
        mm(exchange.voted_gap_mm),
        mm(exchange.highest_mm),
        exchange.new_causes.join(", ")
    )
    .trim_end()
    .to_owned()
}

/// A fault entry as programs read it.
#[derive(Debug, Serialize)]
struct Fault {
    number: u32,
    power_cycle: u32,
    time_ms: f64,
    event: &'static str,
    state: &'static str,
    causes: Vec<&'static str>,
    fault: u8,
    detail: u32,
}

impl Fault {
    fn of(entry: &FaultEntry) -> Self {
        Self {
            number: entry.number,
            power_cycle: entry.power_cycle.get(),
            time_ms: millis(entry.time),
            event: entry.event.name(),
            state: entry.state.name(),
            causes: cause_names(entry.causes),
            fault: entry.fault,
            detail: entry.detail,
        }
    }
}

fn fault_row(fault: &Fault) -> String {
    format!(
        "{:4}  start {:3}  {:10.3} s  {:10}  {}",
        fault.number,
        fault.power_cycle,
        fault.time_ms / 1000.0,
        fault.event,
        fault.causes.join(", ")
    )
    .trim_end()
    .to_owned()
}
