//! `nearfield replay`: a sequence of pictures through host and safety controller, or a recording's decisions again.

pub mod recorded;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::Args;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::rig::Rig;
use nearfield_shared::units::Micros;
use serde::Serialize;

use super::mcu::{McuChoice, arm, cause_names, relay_name};
use crate::capture::{is_picture_name, read_frame};
use crate::line_scan::LineScanEncoder;
use crate::link::{FrameFacts, McuSession};
use crate::rig_file;
use crate::vision::Analyser;

/// Play pictures, or a recording of `nearfield run`, through the safety controller again.
///
/// A recording (a file of `nearfield run --record`, or the folder of them): the controller is asked everything again and must
/// answer the same, bit for bit; exit code 1 if it does not. The rig is in the recording.
///
/// A folder of pictures, in the order of their names, with --rig: the reset is pressed once at the start: the first usable picture stands still until the controller has come up, tested
/// itself and closed its relays (or would long have), then time begins. A picture that cannot be used is a lost
/// frame, which is reported, and the exit code is 2.
#[derive(Debug, Args)]
pub struct Replay {
    /// The rig that took the pictures; recordings carry theirs.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Frames per second.
    #[arg(long, default_value_t = 50.0)]
    fps: f64,
    /// Which safety controller to ask.
    #[arg(long, value_enum, default_value_t)]
    mcu: McuChoice,
    /// One JSON object a frame on standard output.
    #[arg(long)]
    json: bool,
    /// Folder with pictures or recordings, or one recording.
    #[arg(value_name = "PATH")]
    directory: PathBuf,
}

/// One line of `nearfield replay --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameReport {
    /// Number of the frame, from 0.
    pub frame: usize,
    /// Time of its exposure since the first one, milliseconds.
    pub t_ms: f64,
    /// Host, tier 1 with its vote: is the stripe cut?
    pub cutoff: bool,
    /// Host: longest gap, millimetres; 0 if the stripe is whole.
    pub longest_gap_mm: f32,
    /// Host: highest object, millimetres; `None` if nothing is seen raised.
    pub highest_mm: Option<f32>,
    /// The contacts at the end of the frame's period: `open` or `closed`.
    pub relay: &'static str,
    /// Why the controller stopped.
    pub causes: Vec<&'static str>,
}

/// Fewest and most frames a second that make sense.
const FRAME_RATES: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

impl Replay {
    /// Runs the command; the exit code is 2 if a picture could not be used.
    ///
    /// # Errors
    /// The rig or the directory cannot be used, or the safety controller cannot be reached.
    pub fn run(&self) -> anyhow::Result<u8> {
        if !FRAME_RATES.contains(&self.fps) {
            bail!("--fps {}: must be 1 to 1000", self.fps);
        }
        let Some(rig_path) = &self.rig else {
            return match recorded::recordings_at(&self.directory)? {
                Some(paths) => recorded::replay(&paths, self.json),
                None => bail!("{}: no recording; pictures need --rig RIG.toml", self.directory.display()),
            };
        };
        let rig = rig_file::load(rig_path)?;
        let pictures = pictures_of(&self.directory)?;
        let mut player =
            Player::new(&rig, self.mcu, self.fps).with_context(|| rig_path.display().to_string())?;
        if !self.json {
            say!("frame      t ms  stripe  longest gap  highest  relay   causes");
        }
        let mut code = 0;
        for picture in &pictures {
            let (report, error) = player.play(picture)?;
            if let Some(error) = error {
                eprintln!("error: {error:#}");
                code = 2;
            }
            if self.json {
                say!("{}", serde_json::to_string(&report)?);
            } else {
                say!("{}", row(&report));
            }
        }
        Ok(code)
    }
}

fn pictures_of(directory: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let failed = || format!("{}: cannot read the directory", directory.display());
    let mut pictures = Vec::new();
    for entry in std::fs::read_dir(directory).with_context(failed)? {
        let path = entry.with_context(failed)?.path();
        if path.is_file() && is_picture_name(&path) {
            pictures.push(path);
        }
    }
    if pictures.is_empty() {
        bail!("{}: no pictures in it (PNG, JPEG, PGM or raw frames)", directory.display());
    }
    pictures.sort();
    Ok(pictures)
}

/// Host and controller in step, one frame after the other.
pub struct Player {
    rig: Rig,
    analyser: Analyser,
    encoder: LineScanEncoder,
    session: McuSession,
    period_ms: f64,
    frame: usize,
    armed: bool,
}

impl Player {
    /// Powers up.
    ///
    /// # Errors
    /// The rig's picture does not resolve the stripe, or the controller cannot be started.
    pub fn new(rig: &Rig, mcu: McuChoice, frames_per_second: f64) -> anyhow::Result<Self> {
        let mut session = mcu.start(rig)?;
        session.set_frame_period(Micros::new((1e6 / frames_per_second).round() as u64));
        Ok(Self {
            rig: *rig,
            analyser: Analyser::new(rig)?,
            encoder: LineScanEncoder::new(rig)?,
            session,
            period_ms: 1000.0 / frames_per_second,
            frame: 0,
            armed: false,
        })
    }

    /// Plays the next frame. The inner error says why its picture could not be used.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn play(&mut self, picture: &Path) -> anyhow::Result<(FrameReport, Option<anyhow::Error>)> {
        let error = match read_frame(picture, self.rig.image()) {
            Ok(frame) => {
                let view = frame.view();
                if !self.armed {
                    self.armed = true;
                    self.analyser.judge(&view)?;
                    let extractor = self.analyser.extractor();
                    let columns = self.encoder.encode(extractor.readings(), extractor.geometry());
                    arm(&mut self.session, columns)?;
                }
                self.analyser.update(&view)?;
                self.exchange()?;
                None
            }
            Err(error) => {
                self.analyser.lose_frame();
                self.session.run_frame(None)?;
                Some(error.into())
            }
        };
        let report = self.report();
        self.frame += 1;
        Ok((report, error))
    }

    fn exchange(&mut self) -> anyhow::Result<()> {
        let extractor = self.analyser.extractor();
        let columns = self.encoder.encode(extractor.readings(), extractor.geometry());
        let verdict = if self.analyser.report().is_cut() { HostVerdict::Stop } else { HostVerdict::Clear };
        self.session.run_columns(columns, FrameFacts { verdict, ..FrameFacts::default() })?;
        Ok(())
    }

    fn report(&self) -> FrameReport {
        let report = self.analyser.report();
        let status = self.session.status();
        let heights = self.analyser.objects().iter().filter_map(|object| object.height);
        FrameReport {
            frame: self.frame,
            t_ms: (self.frame as f64 * self.period_ms * 1000.0).round() / 1000.0,
            cutoff: report.is_cut(),
            longest_gap_mm: report.longest_gap().map_or(0.0, |gap| gap.length().get()),
            highest_mm: heights.map(|height| height.get()).reduce(f32::max),
            relay: relay_name(self.session.relay_closed()),
            causes: cause_names(status.live_causes.union(status.latched_causes)),
        }
    }
}

fn row(report: &FrameReport) -> String {
    let highest = report.highest_mm.map_or("-".to_owned(), |height| format!("{height:.1} mm"));
    format!(
        "{:5} {:9.1}  {:6}  {:8.1} mm  {highest:>7}  {:6}  {}",
        report.frame,
        report.t_ms,
        if report.cutoff { "cut" } else { "whole" },
        report.longest_gap_mm,
        report.relay,
        report.causes.join(", "),
    )
}
