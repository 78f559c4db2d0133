//! `nearfield run`: the host at work.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use clap::Args;
use nearfield_configuration::{Configuration, LinkKind, Profile, Source as SourceKind};
use nearfield_detection::model::{Backend, Choice};
use nearfield_detection::network::Settings;
use nearfield_detection::tiles::Tiling;
use nearfield_detection::watch::Watched;
use nearfield_fusion::Motion;
use nearfield_shared::causes::StopCauses;
use nearfield_shared::rig::{ImageSize, Rig};
use nearfield_shared::units::{Micros, SourceId};
use serde::Serialize;

use super::mcu::{McuChoice, cause_names, relay_name};
use super::twin::load_scene;
use crate::link::board::{Board, BoardError};
use crate::link::{FrameFacts, McuSession};
use crate::rig_file;
use crate::run::controller::ControllerError;
use crate::run::detector_eye::DetectorEye;
use crate::run::source::{FolderSource, PipeSource, Source, TwinSource};
use crate::run::stripe_path::StripeError;
use crate::run::{Controller, Semantics, StripePath};

/// Run: pictures in, line-scans out, the controller's verdict told whenever it changes.
///
/// The source and the controller are the configuration's. Simulated controllers run on a virtual clock, a frame period a
/// picture, and are armed by themselves (nobody presses their button); the board runs on its own. SIGINT and SIGTERM end it
/// cleanly. With profile "semantics" the detector runs beside it. What this version leaves out: recording and the operator's page.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield config print > nearfield.toml && nearfield run --config nearfield.toml --seconds 10
  nearfield run --config nearfield.toml --json | jq -c 'select(.relay)'")]
pub struct Run {
    /// The configuration.
    #[arg(long, value_name = "NEARFIELD.toml")]
    config: PathBuf,
    /// End after so many seconds of pictures; without it, on a signal.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Simulated controllers: as fast as this computer can, not at the frame rate.
    #[arg(long)]
    fast: bool,
    /// One JSON object a line.
    #[arg(long)]
    json: bool,
}

/// A change that is told.
#[derive(Debug, Serialize)]
struct Change {
    picture: u64,
    relay: &'static str,
    causes: Vec<&'static str>,
}

/// The sum at the end.
#[derive(Debug, Serialize)]
struct Sum {
    pictures: u64,
    /// The source gave none in time, or one that could not be used.
    missing: u64,
    /// The controller did not take them.
    lost: u64,
    restarts: u64,
    /// From the picture in memory to the status received, milliseconds.
    latency_ms: Quantiles,
}

#[derive(Debug, Serialize)]
struct Quantiles {
    p50: f64,
    p99: f64,
    p999: f64,
    longest: f64,
}

/// Pauses before a broken source is opened again.
const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);

impl Run {
    /// Runs until the end.
    ///
    /// # Errors
    /// The configuration, the rig, the source or the controller cannot be used.
    pub fn run(&self) -> anyhow::Result<u8> {
        let configuration = Configuration::load(&self.config)?;
        let rig = rig_file::load(&configuration.rig)?;
        let camera = &configuration.camera;
        let size = rig.image();
        if (u32::from(size.width), u32::from(size.height)) != (camera.width, camera.height) {
            bail!(
                "{}: the camera's pictures have {} x {} pixels, the rig's {} x {}; change camera.width and camera.height",
                self.config.display(),
                camera.width,
                camera.height,
                size.width,
                size.height
            );
        }
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot watch for signals")?;
        }
        match configuration.link.kind {
            LinkKind::InProcess => self.simulated(&configuration, &rig, McuChoice::InProcess, &stop),
            LinkKind::Emulated => self.simulated(&configuration, &rig, McuChoice::Emulated, &stop),
            LinkKind::Spi => self.on_board(&configuration, &rig, &stop),
        }
    }

    fn simulated(
        &self,
        configuration: &Configuration,
        rig: &Rig,
        choice: McuChoice,
        stop: &AtomicBool,
    ) -> anyhow::Result<u8> {
        let mut session = choice.start(rig)?;
        let period = 1e6 / configuration.camera.frames_per_second;
        session.set_frame_period(Micros::new(period.round() as u64));
        let path = StripePath::new(rig, session, semantics(configuration)?)?;
        let mut runner = Runner::new(self, configuration, rig, path)?;
        runner.pace = (!self.fast).then(|| Duration::from_secs_f64(period / 1e6));
        runner.go(stop, |path, exposed, exposure| {
            let session: &mut McuSession = path.controller();
            if session.status().state == nearfield_shared::status::StateCode::Interlocked {
                session.press_reset();
            }
            session.mean_laser_drive(exposed, exposure)
        })
    }

    #[cfg(target_os = "linux")]
    fn on_board(&self, configuration: &Configuration, rig: &Rig, stop: &AtomicBool) -> anyhow::Result<u8> {
        use crate::link::spi_bus::SpiBus;
        let link = configuration.link.clone();
        let open = move || SpiBus::open(&link.device, link.hertz, &link.chip, link.ready_line);
        let source = SourceId::new(configuration.module.source);
        let board = Board::new(Box::new(open), source, rig.calibration_id());
        let path = StripePath::new(rig, board, semantics(configuration)?)?;
        // The laser is the board's own; the camera sees it.
        Runner::new(self, configuration, rig, path)?.go(stop, |_, _, _| 1.0)
    }

    #[cfg(not(target_os = "linux"))]
    fn on_board(&self, _: &Configuration, _: &Rig, _: &AtomicBool) -> anyhow::Result<u8> {
        bail!("the SPI link needs Linux; choose link.kind = \"in-process\" or \"emulated\"")
    }
}

/// Tier 3 in its own thread, if the profile asks for it.
fn semantics(configuration: &Configuration) -> anyhow::Result<Option<Semantics>> {
    if configuration.profile != Profile::Semantics {
        return Ok(None);
    }
    let chosen = &configuration.detector;
    let backend = match chosen.backend.as_str() {
        "rten" => Backend::Rten,
        "ort" => Backend::Ort,
        "hailo" => Backend::Hailo,
        other => bail!("detector.backend = \"{other}\" replays files and cannot look at live pictures"),
    };
    let settings = Settings { tiling: Tiling::Windows(5), least_score: None };
    let choice = Choice { model: chosen.model.clone(), backend, settings, threads: 1 };
    let deadline = Duration::from_millis(chosen.deadline_ms.into());
    let watched = Watched::new(choice.load()?, deadline).context("cannot start the detector's thread")?;
    let semantics = Semantics::start(DetectorEye::new(watched)).context("cannot start tier 3's thread")?;
    Ok(Some(semantics))
}

fn open(configuration: &Configuration, rig: &Rig) -> anyhow::Result<Box<dyn Source>> {
    let camera = &configuration.camera;
    let input = camera.input.as_deref();
    let size = ImageSize { width: rig.image().width, height: rig.image().height };
    Ok(match camera.source {
        SourceKind::Twin => Box::new(TwinSource::new(rig, &load_scene(input.unwrap_or("clean"), rig)?, 1)?),
        SourceKind::Replay => Box::new(FolderSource::new(input.unwrap_or(".").as_ref(), size)?),
        SourceKind::RpicamVid => Box::new(PipeSource::rpicam_vid(camera)?),
        SourceKind::Libcamera => {
            bail!("camera.source = \"libcamera\" is not built into this version; use \"rpicam-vid\"")
        }
    })
}

struct Runner<'a, C> {
    options: &'a Run,
    configuration: &'a Configuration,
    rig: &'a Rig,
    path: StripePath<C>,
    source: Option<Box<dyn Source>>,
    pace: Option<Duration>,
    pause: Duration,
    sum: Sum,
    told: Option<(bool, StopCauses)>,
}

impl<'a, C: Controller> Runner<'a, C> {
    /// The first opening of the source must work: a mistake in the configuration is told at once.
    fn new(
        options: &'a Run,
        configuration: &'a Configuration,
        rig: &'a Rig,
        path: StripePath<C>,
    ) -> anyhow::Result<Self> {
        let source = Some(open(configuration, rig)?);
        let latency_ms = Quantiles { p50: 0.0, p99: 0.0, p999: 0.0, longest: 0.0 };
        let sum = Sum { pictures: 0, missing: 0, lost: 0, restarts: 0, latency_ms };
        Ok(Self {
            options,
            configuration,
            rig,
            path,
            source,
            pace: None,
            pause: FIRST_PAUSE,
            sum,
            told: None,
        })
    }

    /// Picture after picture until the end; `drive` is asked for the laser's drive over an exposure.
    fn go(
        mut self,
        stop: &AtomicBool,
        mut drive: impl FnMut(&mut StripePath<C>, Micros, Micros) -> f32,
    ) -> anyhow::Result<u8> {
        let rate = self.configuration.camera.frames_per_second;
        let last = self.options.seconds.map(|seconds| (seconds * rate).round() as u64);
        let facts = FrameFacts::default();
        let mut due = Instant::now();
        while !stop.load(Ordering::Relaxed) && last.is_none_or(|last| self.sum.pictures < last) {
            let exposed = self.path.controller().now().since(facts.capture_age);
            let level = drive(&mut self.path, exposed, facts.exposure);
            self.sum.pictures += 1;
            self.picture(exposed, level)?;
            if let Some(pace) = self.pace {
                due += pace;
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
        }
        self.finish()
    }

    fn picture(&mut self, exposed: Micros, level: f32) -> anyhow::Result<()> {
        let Some(source) = &mut self.source else { return self.reopen() };
        let frame = match source.next(level) {
            Ok(Some(frame)) => frame,
            Ok(None) => {
                self.sum.missing += 1;
                return Ok(());
            }
            Err(error) => {
                eprintln!("warning: the source of pictures: {error:#}");
                self.sum.missing += 1;
                self.source = None;
                return Ok(());
            }
        };
        self.pause = FIRST_PAUSE;
        if let Err(error) = self.path.step(frame, exposed, &Motion::default()) {
            self.sum.lost += 1;
            // What closed the bus was told when it did.
            if !matches!(&error, StripeError::Controller(ControllerError::Board(BoardError::Closed { .. }))) {
                eprintln!("warning: {error}");
            }
        }
        self.tell_changes()
    }

    /// A broken source is opened again, with a growing pause; until then nothing is sent, and the controller stops.
    fn reopen(&mut self) -> anyhow::Result<()> {
        std::thread::sleep(self.pause);
        self.pause = (self.pause * 2).min(LONGEST_PAUSE);
        match open(self.configuration, self.rig) {
            Ok(source) => {
                self.source = Some(source);
                self.sum.restarts += 1;
            }
            Err(error) => eprintln!("warning: {error:#}; next try in {:.1} s", self.pause.as_secs_f64()),
        }
        Ok(())
    }

    fn tell_changes(&mut self) -> anyhow::Result<()> {
        let controller = self.path.controller();
        let causes = controller.status().map_or(StopCauses::NONE, |status| status.live_causes);
        let now = (controller.is_circuit_closed(), causes);
        if self.told == Some(now) {
            return Ok(());
        }
        self.told = Some(now);
        let change =
            Change { picture: self.sum.pictures, relay: relay_name(now.0), causes: cause_names(causes) };
        if self.options.json {
            say!("{}", serde_json::to_string(&change)?);
        } else {
            say!("picture {:>6}  {:<6}  {}", change.picture, change.relay, change.causes.join(", "));
        }
        Ok(())
    }

    fn finish(mut self) -> anyhow::Result<u8> {
        let [p50, p99, p999, longest] = self.path.latency().summary_ms();
        self.sum.latency_ms = Quantiles { p50, p99, p999, longest };
        if self.options.json {
            say!("{}", serde_json::to_string(&self.sum)?);
        } else {
            let Sum { pictures, missing, lost, .. } = &self.sum;
            say!("{pictures} pictures, {missing} missing, {lost} lost");
            say!(
                "picture to status: p50 {p50:.2} ms, p99 {p99:.2} ms, p99.9 {p999:.2} ms, longest {longest:.2} ms"
            );
        }
        Ok(0)
    }
}
