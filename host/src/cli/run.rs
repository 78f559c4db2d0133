//! `nearfield run`: the host at work.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::{Context as _, bail};
use clap::Args;
use nearfield_configuration::{Camera, Configuration, LinkKind, Profile, Source as SourceKind};
use nearfield_fields::Fields;
use nearfield_fields::speed::SpeedListener;
use nearfield_machine::real_time;
use nearfield_operator::commission::{Hands, HandsAsked};
use nearfield_recording::Taps;
use nearfield_shared::rig::{ImageSize, Rig};
use nearfield_shared::status::StateCode;
use nearfield_shared::units::{Micros, SourceId};
use serde::Serialize;

use super::mcu::{McuChoice, cause_names, relay_name};
use super::twin::load_scene;
use crate::link::McuSession;
use crate::link::board::Board;
use crate::run::journal::Journal;
use crate::run::outlets::{self, Outlets, recording_folder};
use crate::run::rig;
use crate::run::runner::{Change, Pace, Runner, Said};
use crate::run::source::{FolderSource, PipeSource, Source, TwinLoop, TwinSource};
use crate::run::supervised::{Supervised, elsewhere};
use crate::run::tier_three;
use crate::run::{Controller, Semantics, StripePath};

/// Run: pictures in, line-scans out, the controller's verdict told whenever it changes.
///
/// The source and the controller are the configuration's. Simulated controllers run on a virtual clock, a frame period a
/// picture, and are armed by themselves (nobody presses their button); the board runs on its own. With profile "semantics" the
/// detector runs beside it. Line-scans, statuses and decisions are recorded where recording.directory (or --record) says;
/// the operator's page is at page.listen. A source that breaks is opened again; in the meantime nothing is sent. SIGINT and
/// SIGTERM end it cleanly.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield config print > nearfield.toml && nearfield run --config nearfield.toml --seconds 10
  nearfield run --config nearfield.toml --record recordings     and a page at http://127.0.0.1:8033
  nearfield replay recordings                                   the controller decides again, bit for bit
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
    /// Record into this folder, whatever the configuration says.
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// Without the operator's page.
    #[arg(long)]
    no_page: bool,
    /// One JSON object a line.
    #[arg(long)]
    json: bool,
}

/// From one press of a simulated controller's button to the next.
const PRESS_INTERVAL: Micros = Micros::from_millis(1000);

/// A change that is told.
#[derive(Debug, Serialize)]
struct ToldChange {
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
    /// `None` = nothing was to be recorded.
    recording: Option<RecordingSum>,
}

#[derive(Debug, Serialize)]
struct Quantiles {
    p50: f64,
    p99: f64,
    p999: f64,
    longest: f64,
}

#[derive(Debug, Serialize)]
struct RecordingSum {
    bytes: u64,
    /// Events that did not fit into the recorder's queue.
    dropped: u64,
    /// Times that recording had to stop.
    stops: u64,
    problem: Option<String>,
}

impl Run {
    /// Runs until the end.
    ///
    /// # Errors
    /// The configuration, the rig, the source, the controller or the folder of recordings cannot be used.
    pub fn run(&self) -> anyhow::Result<u8> {
        let configuration = Configuration::load(&self.config)?;
        let text = std::fs::read_to_string(&self.config).unwrap_or_default();
        let rig = rig::of(&configuration)?;
        if rig::is_built_in(&configuration) {
            eprintln!("{}: names no rig: {}", self.config.display(), rig::name(&configuration));
        }
        self.check_sizes(&configuration.camera, &rig)?;
        Fields::check(&configuration, rig.stripe()).with_context(|| self.config.display().to_string())?;
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot watch for signals")?;
        }
        // A simulated sensor has simulated hands.
        let hands = (configuration.link.kind != LinkKind::Spi).then(Hands::default);
        let source = open_source(&configuration, &rig, hands.clone())?;
        let record = recording_folder(self.record.as_deref(), &configuration);
        let about = outlets::Run {
            configuration: &configuration,
            text: &text,
            rig: &rig,
            record: record.as_deref(),
            page: !self.no_page,
            hands: hands.clone(),
        };
        let (mut outlets, said) = Outlets::start(&about)?;
        for warning in said {
            eprintln!("warning: {warning}");
        }
        if let Some(address) = outlets.page_address().filter(|_| !self.json) {
            say!("the page: http://{address}");
        }
        let work = Work { options: self, configuration: &configuration, rig: &rig, stop: &stop, hands };
        let latency_ms = match configuration.link.kind {
            LinkKind::InProcess => work.simulated(McuChoice::InProcess, source, &mut outlets),
            LinkKind::Emulated => work.simulated(McuChoice::Emulated, source, &mut outlets),
            LinkKind::Spi => work.on_board(source, &mut outlets),
        }?;
        self.finish(outlets, latency_ms)
    }

    fn check_sizes(&self, camera: &Camera, rig: &Rig) -> anyhow::Result<()> {
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
        Ok(())
    }

    fn finish(&self, outlets: Outlets, latency_ms: Quantiles) -> anyhow::Result<u8> {
        let tally = Arc::clone(&outlets.tally);
        let recording = outlets.finish().map(|state| RecordingSum {
            bytes: state.written,
            dropped: state.dropped,
            stops: state.stops,
            problem: state.problem,
        });
        let (pictures, missing) = (tally.pictures.get(), tally.missing.get());
        let (lost, restarts) = (tally.lost.get(), tally.restarts.get());
        let sum = Sum { pictures, missing, lost, restarts, latency_ms, recording };
        if self.json {
            say!("{}", serde_json::to_string(&sum)?);
            return Ok(0);
        }
        let Quantiles { p50, p99, p999, longest } = sum.latency_ms;
        say!(
            "{pictures} pictures, {missing} missing, {lost} lost; the source was opened again {restarts} times"
        );
        say!(
            "picture to status: p50 {p50:.2} ms, p99 {p99:.2} ms, p99.9 {p999:.2} ms, longest {longest:.2} ms"
        );
        if let Some(recording) = &sum.recording {
            let problem =
                recording.problem.as_ref().map_or(String::new(), |problem| format!("; stopped: {problem}"));
            say!(
                "recorded {:.1} MiB, {} events lost{problem}",
                recording.bytes as f64 / 1048576.0,
                recording.dropped
            );
        }
        Ok(0)
    }

    fn say(&self, said: &Said<'_>) -> anyhow::Result<()> {
        match said {
            Said::Warning(warning) => eprintln!("warning: {warning}"),
            Said::Change(Change { picture, relay_closed, causes }) => {
                let (relay, causes) = (relay_name(*relay_closed), cause_names(*causes));
                if self.json {
                    let change = ToldChange { picture: *picture, relay, causes };
                    say!("{}", serde_json::to_string(&change)?);
                } else {
                    say!("picture {picture:>6}  {relay:<6}  {}", causes.join(", "));
                }
            }
        }
        Ok(())
    }
}

/// Everything that a run works with.
struct Work<'a> {
    options: &'a Run,
    configuration: &'a Configuration,
    rig: &'a Rig,
    stop: &'a AtomicBool,
    hands: Option<Hands>,
}

impl Work<'_> {
    fn simulated(
        &self,
        choice: McuChoice,
        source: Supervised,
        outlets: &mut Outlets,
    ) -> anyhow::Result<Quantiles> {
        let taps = outlets.taps.clone();
        let mut session = McuSession::start(Box::new(Journal::new(choice.link()?, taps)), self.rig)?;
        let period = 1e6 / self.configuration.camera.frames_per_second;
        session.set_frame_period(Micros::new(period.round() as u64));
        let pace = (!self.options.fast).then(|| Duration::from_secs_f64(period / 1e6));
        let mut pressed = Micros::ZERO;
        let path = self.path(session, outlets)?;
        let hands = self.hands.clone().unwrap_or_default();
        self.go(path, source, outlets, pace, move |session, exposed, exposure| {
            let may_press = matches!(hands.asked(), HandsAsked::Nothing | HandsAsked::Press);
            // Pressed, released, and time for the controller to arm before it is tried again.
            if may_press
                && session.status().state == StateCode::Interlocked
                && session.now().since(pressed) >= PRESS_INTERVAL
            {
                pressed = session.now();
                session.press_reset();
            }
            session.mean_laser_drive(exposed, exposure)
        })
    }

    #[cfg(target_os = "linux")]
    fn on_board(&self, source: Supervised, outlets: &mut Outlets) -> anyhow::Result<Quantiles> {
        let board = board(self.configuration, self.rig);
        let path = self.path(board, outlets)?;
        // Only here does time matter; and only this thread, whose work ends with the line-scan, is to be preferred: all
        // others run by now, and a source that is opened again is opened by one of them.
        for asked in real_time::ask(&self.configuration.real_time) {
            eprintln!("{}{asked}", if asked.refused.is_some() { "warning: " } else { "" });
        }
        // The laser is the board's own; the camera sees it.
        self.go(path, source, outlets, None, |_, _, _| 1.0)
    }

    #[cfg(not(target_os = "linux"))]
    fn on_board(&self, _: Supervised, _: &mut Outlets) -> anyhow::Result<Quantiles> {
        bail!("the SPI link needs Linux; choose link.kind = \"in-process\" or \"emulated\"")
    }

    /// The stripe's path, with the threads beside it.
    fn path<C: Controller>(&self, controller: C, outlets: &Outlets) -> anyhow::Result<StripePath<C>> {
        let semantics = semantics(self.configuration, outlets.taps.clone())?;
        let speed = SpeedListener::start(&self.configuration.speed)?;
        let fields = Fields::new(self.configuration);
        let exposure = Micros::new(self.configuration.camera.exposure_us.into());
        let path = StripePath::new(self.rig, controller, semantics)?.with_exposure(exposure);
        let path = if self.configuration.camera.background_subtraction {
            path.with_background_subtraction()
        } else {
            path
        };
        Ok(path.with_fields(fields, speed))
    }

    fn go<C: Controller>(
        &self,
        path: StripePath<C>,
        source: Supervised,
        outlets: &mut Outlets,
        period: Option<Duration>,
        drive: impl FnMut(&mut C, Micros, Micros) -> f32,
    ) -> anyhow::Result<Quantiles> {
        let rate = self.configuration.camera.frames_per_second;
        let pictures = self.options.seconds.map(|seconds| (seconds * rate).round() as u64);
        let mut runner = Runner { path, source, outlets, pace: Pace { pictures, period } };
        runner.run(self.stop, drive, |said| self.options.say(&said))?;
        let [p50, p99, p999, longest] = runner.path.latency().summary_ms();
        Ok(Quantiles { p50, p99, p999, longest })
    }
}

/// Tier 3 in its own thread, if the profile asks for it.
fn semantics(configuration: &Configuration, taps: Taps) -> anyhow::Result<Option<Semantics>> {
    if configuration.profile != Profile::Semantics {
        return Ok(None);
    }
    let eye = tier_three::eye(&configuration.detector)?;
    Ok(Some(Semantics::start_told(eye, taps).context("cannot start tier 3's thread")?))
}

/// The board on the configuration's bus, which its first exchange opens.
#[cfg(target_os = "linux")]
pub(super) fn board(configuration: &Configuration, rig: &Rig) -> Board<crate::link::spi_bus::SpiBus> {
    use crate::link::spi_bus::SpiBus;
    let link = configuration.link.clone();
    let open = move || SpiBus::open(&link.device, link.hertz, &link.chip, link.ready_line);
    Board::new(Box::new(open), SourceId::new(configuration.module.source), rig.calibration_id())
}

pub(super) fn open_source(
    configuration: &Configuration,
    rig: &Rig,
    hands: Option<Hands>,
) -> anyhow::Result<Supervised> {
    let period = Duration::from_secs_f64(1.0 / configuration.camera.frames_per_second);
    let (camera, rig) = (configuration.camera.clone(), *rig);
    Supervised::open(elsewhere(Box::new(move || open(&camera, &rig, hands.clone())))?, period)
}

fn open(camera: &Camera, rig: &Rig, hands: Option<Hands>) -> anyhow::Result<Box<dyn Source>> {
    let input = camera.input.as_deref();
    let size = ImageSize { width: rig.image().width, height: rig.image().height };
    Ok(match camera.source {
        SourceKind::Twin => {
            let scene = load_scene(input.unwrap_or("clean"), rig)?;
            let twin = TwinSource::new(rig, &scene, 1)?.moving(&scene, 1, camera.frames_per_second)?;
            Box::new(match hands {
                Some(hands) => twin.with_hands(&scene, hands),
                None => twin,
            })
        }
        SourceKind::TwinLoop => Box::new(TwinLoop::new(rig, &load_scene(input.unwrap_or("clean"), rig)?, 1)?),
        SourceKind::Replay => Box::new(FolderSource::new(Path::new(input.unwrap_or(".")), size)?),
        SourceKind::RpicamVid => Box::new(PipeSource::rpicam_vid(camera)?),
        SourceKind::Command => Box::new(PipeSource::command_line(input.unwrap_or_default(), camera)?),
        #[cfg(all(feature = "libcamera", target_os = "linux"))]
        SourceKind::Libcamera => Box::new(crate::run::libcamera_source::LibcameraSource::open(camera, rig)?),
        #[cfg(not(all(feature = "libcamera", target_os = "linux")))]
        SourceKind::Libcamera => anyhow::bail!(
            "camera.source = \"libcamera\", but this program was built without it; build it with `--features libcamera`, or use \
             \"rpicam-vid\""
        ),
    })
}
