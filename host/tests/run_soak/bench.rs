//! A sensor at work in this process, with switches for what shall fail.

use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nearfield_configuration::{Configuration, Profile};
use nearfield_fields::Fields;
use nearfield_fusion::Sighting;
use nearfield_host::capture::Frame;
use nearfield_host::link::{Emulated, InProcess, McuLink, McuSession};
use nearfield_host::run::journal::Journal;
use nearfield_host::run::outlets::{self, Outlets};
use nearfield_host::run::runner::{Pace, Runner};
use nearfield_host::run::semantics::SemanticPicture;
use nearfield_host::run::source::{Source, TwinLoop};
use nearfield_host::run::supervised::Supervised;
use nearfield_host::run::{Eye, Semantics, StripePath, tier_three};
use nearfield_host::twin::gallery;
use nearfield_operator::Tally;
use nearfield_recording::queue;
use nearfield_shared::rig::Rig;
use nearfield_shared::status::StateCode;
use nearfield_shared::units::Micros;

use super::tally::{Listener, Phase};

/// What shall fail.
#[derive(Clone, Default)]
pub struct Switches {
    /// Each look of tier 3 takes so long and finds nothing out; 0 = it looks.
    pub stall_ms: Arc<AtomicU64>,
    /// The source breaks after so long; 0 = never.
    pub dies_every_ms: Arc<AtomicU64>,
}

const FRAMES_PER_SECOND: u64 = 50;
/// The recorder's disk.
const DISK: &str = "size=48m";

/// The built-in network, or nothing for a long time.
struct StalledEye<E>(E, Arc<AtomicU64>);

impl<E: Eye> Eye for StalledEye<E> {
    fn look(&mut self, picture: &SemanticPicture) -> Result<Vec<Sighting>, String> {
        match self.1.load(Ordering::Relaxed) {
            0 => self.0.look(picture),
            stall => {
                std::thread::sleep(Duration::from_millis(stall));
                Err("stalled".to_owned())
            }
        }
    }
}

/// A source with a life.
struct Mortal {
    source: TwinLoop,
    born: Instant,
    life_ms: Arc<AtomicU64>,
}

impl Source for Mortal {
    fn advance(&mut self, drive: f32) -> anyhow::Result<bool> {
        let life = Duration::from_millis(self.life_ms.load(Ordering::Relaxed));
        if !life.is_zero() && self.born.elapsed() > life {
            anyhow::bail!("dead after {life:?}");
        }
        self.source.advance(drive)
    }

    fn frame(&self) -> &Frame {
        self.source.frame()
    }
}

/// A small disk of its own, unmounted at the end.
struct Disk(PathBuf);

impl Disk {
    fn mount(path: PathBuf) -> Option<Self> {
        std::fs::create_dir(&path).unwrap();
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", DISK, "tmpfs"]).arg(&path).status();
        mounted.is_ok_and(|status| status.success()).then_some(Self(path))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

/// What the sensor's thread tells when it has begun.
struct Begun {
    page: String,
    tally: Arc<Tally>,
    listener: Listener,
}

/// See the module's documentation.
pub struct Bench {
    begun: Begun,
    tier_three: bool,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<String>,
    disk: Option<Disk>,
    _folder: tempfile::TempDir,
}

impl Bench {
    /// Everything on; returns when the relay has closed.
    pub fn start(switches: &Switches) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::mount(folder.path().join("disk"));
        let width = u16::try_from(super::number("NEARFIELD_SOAK_WIDTH", 1152)).unwrap();
        let rig = gallery::CENTRE.with_width(width).rig().unwrap();
        let profile = std::env::var("NEARFIELD_SOAK_PROFILE").unwrap_or_else(|_| "semantics".to_owned());
        let text = format!(
            "profile = \"{profile}\"\n[page]\nlisten = \"127.0.0.1:0\"\n[recording]\nlimit_mib = 32\n\
             [camera]\nsource = \"twin-loop\"\nwidth = {}\nheight = {}\n\
             [[zone]]\nname = \"A\"\nstart_mm = -200\nend_mm = 0\n\
             [[zone]]\nname = \"B\"\nstart_mm = 0\nend_mm = 200\nfield = \"warning\"\n",
            rig.image().width,
            rig.image().height
        );
        let configuration = Configuration::read(&text, &folder.path().join("soak.toml")).unwrap();
        let record = disk.as_ref().map_or_else(|| folder.path().to_path_buf(), |disk| disk.0.clone());
        let stop = Arc::new(AtomicBool::new(false));
        let tier_three = configuration.profile == Profile::Semantics;
        let (tell, told) = channel();
        let (switches, end) = (switches.clone(), Arc::clone(&stop));
        let thread =
            std::thread::spawn(move || sensor(&configuration, &text, &rig, &record, &switches, &end, &tell));
        let begun = told.recv().expect("the sensor did not start");
        let bench = Self { begun, tier_three, stop, thread, disk, _folder: folder };
        bench.wait_until_closed();
        bench
    }

    fn wait_until_closed(&self) {
        let begun = Instant::now();
        loop {
            std::thread::sleep(Duration::from_secs(1));
            let seen = self.begun.listener.take();
            if seen.pictures > 0 && seen.closed == seen.pictures {
                return;
            }
            assert!(begun.elapsed() < Duration::from_secs(120), "the relay does not close: {seen:?}");
        }
    }

    pub fn has_tier_three(&self) -> bool {
        self.tier_three
    }

    /// The recorder's disk, if one could be mounted.
    pub fn disk(&self) -> Option<PathBuf> {
        self.disk.as_ref().map(|disk| disk.0.clone())
    }

    pub fn page_address(&self) -> String {
        self.begun.page.clone()
    }

    /// What the page says about the recording.
    pub fn recording_problem(&self) -> Option<String> {
        let answer = super::flood::get(&self.begun.page, "/api/status").unwrap();
        let (_, body) = answer.split_once("\r\n\r\n").unwrap();
        let status: serde_json::Value = serde_json::from_str(body).unwrap();
        status["recording"]["problem"].as_str().map(str::to_owned)
    }

    /// Everything that is seen for a time, `disturb` at its beginning.
    pub fn phase(&self, name: &str, length: Duration, disturb: impl FnOnce()) -> Phase {
        let tally = &self.begun.tally;
        let counted = || [tally.missing.get(), tally.lost.get(), tally.restarts.get()];
        let before = counted();
        let refused = self.begun.listener.take().refused;
        let begun = Instant::now();
        disturb();
        std::thread::sleep(length.saturating_sub(begun.elapsed()));
        let seen = self.begun.listener.take();
        let [missing, lost, restarts] = std::array::from_fn(|index| counted()[index] - before[index]);
        Phase {
            name: name.to_owned(),
            seconds: begun.elapsed().as_secs_f64(),
            pictures: seen.pictures,
            missing,
            lost,
            restarts,
            refused: seen.refused.saturating_sub(refused),
            closed: seen.closed,
            stops: seen.stops,
            answers: seen.answers,
            latency_ms: seen.latency.summary_ms(),
            memory_mib: memory_mib(),
        }
    }

    /// Ends it as a signal does; how the whole went.
    pub fn end(self) -> String {
        self.stop.store(true, Ordering::Relaxed);
        let sum = self.thread.join().unwrap();
        let missed = self.begun.listener.end();
        assert_eq!(missed, 0, "the figures are not of all pictures");
        sum
    }
}

/// Resident memory of this process, the harness's share included.
fn memory_mib() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").trim().parse::<f64>().unwrap() / 1024.0
}

fn link() -> Box<dyn McuLink> {
    match std::env::var("NEARFIELD_SOAK_MCU").as_deref() {
        Ok("emulated") => Box::new(Emulated::new().unwrap()),
        _ => Box::new(InProcess::new()),
    }
}

/// The sensor, as `nearfield run` puts it together.
fn sensor(
    configuration: &Configuration,
    text: &str,
    rig: &Rig,
    record: &std::path::Path,
    switches: &Switches,
    stop: &AtomicBool,
    tell: &Sender<Begun>,
) -> String {
    let run = outlets::Run { configuration, text, rig, record: Some(record), page: true, hands: None };
    let (mut outlets, said) = Outlets::start(&run).unwrap();
    assert!(said.is_empty(), "{said:?}");
    let (tap, drain) = queue(16 * 1024);
    outlets.taps.add(tap);
    let period = Micros::new(1_000_000 / FRAMES_PER_SECOND);
    let mut session = McuSession::start(Box::new(Journal::new(link(), outlets.taps.clone())), rig).unwrap();
    session.set_frame_period(period);
    let semantics = (configuration.profile == Profile::Semantics).then(|| {
        let eye = tier_three::eye(&configuration.detector).unwrap();
        Semantics::start_told(StalledEye(eye, Arc::clone(&switches.stall_ms)), outlets.taps.clone()).unwrap()
    });
    let path =
        StripePath::new(rig, session, semantics).unwrap().with_fields(Fields::new(configuration), None);
    let life_ms = Arc::clone(&switches.dies_every_ms);
    let source = TwinLoop::new(rig, &gallery::scene("clean").unwrap(), 1).unwrap();
    let open = move || -> anyhow::Result<Box<dyn Source>> {
        let (source, born) = (source.clone(), Instant::now());
        Ok(Box::new(Mortal { source, born, life_ms: Arc::clone(&life_ms) }))
    };
    let period = Duration::from_micros(period.get());
    let source = Supervised::open(Box::new(open), period).unwrap();
    let page = outlets.page_address().unwrap().to_string();
    let begun = Begun { page, tally: Arc::clone(&outlets.tally), listener: Listener::start(drain) };
    assert!(tell.send(begun).is_ok(), "nobody waits for the sensor");
    let pace = Pace { pictures: None, period: Some(period) };
    let mut runner = Runner { path, source, outlets: &mut outlets, pace };
    let mut pressed = Micros::ZERO;
    let drive = |session: &mut McuSession, exposed, exposure| {
        // Somebody presses the button whenever it is asked for, a second after the last time.
        if session.status().state == StateCode::Interlocked
            && session.now().since(pressed) >= Micros::from_millis(1000)
        {
            pressed = session.now();
            session.press_reset();
        }
        session.mean_laser_drive(exposed, exposure)
    };
    runner.run(stop, drive, |_| Ok(())).unwrap();
    let [p50, p99, p999, longest] = runner.path.latency().summary_ms();
    let pictures = runner.path.latency().count();
    let state = outlets.finish().unwrap();
    format!(
        "all {pictures} pictures: p50 {p50:.2}, p99 {p99:.2}, p99.9 {p999:.2}, longest {longest:.2} ms; recorded {:.1} MiB, \
         {} events lost, {} stops of recording",
        state.written as f64 / 1048576.0,
        state.dropped,
        state.stops
    )
}
