//! What the sections of the file mean.

use std::net::SocketAddr;
use std::path::PathBuf;

use crate::reader::Section;

/// Which module this is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Module {
    /// For people and for topics: `front`, `rear_left` ...
    pub name: String,
    /// The number that its controller is built with; line-scans carry it.
    pub source: u16,
}

/// Where pictures come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The built-in renderer.
    Twin,
    /// Pictures of the built-in renderer, made at the start and shown again and again.
    TwinLoop,
    /// A folder of pictures, again and again.
    Replay,
    /// `rpicam-vid` writes YUV420 into a pipe.
    RpicamVid,
    /// Any other program that does so: `input`, split at blanks.
    Command,
    /// libcamera itself (needs the feature `libcamera`).
    Libcamera,
}

impl Source {
    /// Its name in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Twin => "twin",
            Self::TwinLoop => "twin-loop",
            Self::Replay => "replay",
            Self::RpicamVid => "rpicam-vid",
            Self::Command => "command",
            Self::Libcamera => "libcamera",
        }
    }
}

/// How pictures are taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Where they come from.
    pub source: Source,
    /// What the source reads: a folder (replay), a scene (twin), a program (command).
    pub input: Option<String>,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pictures a second.
    pub frames_per_second: f64,
    /// Exposure, microseconds. Fixed: the laser's code must not be regulated away.
    pub exposure_us: u32,
    /// From the first row's read-out to the last one's, microseconds.
    pub read_out_us: u32,
    /// Analogue gain.
    pub gain: f64,
    /// Focus, dioptres.
    pub focus: f64,
    /// The ground that the laser's dimming tells is subtracted where the edge of a paint hides the stripe.
    pub background_subtraction: bool,
}

/// Which controller is at the other end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkKind {
    /// The firmware's library in this process.
    InProcess,
    /// The firmware's binary in QEMU.
    Emulated,
    /// The board, over SPI.
    Spi,
}

/// The SPI link.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Spi {
    /// Which controller.
    pub kind: LinkKind,
    /// spidev's file.
    pub device: PathBuf,
    /// Clock, Hz.
    pub hertz: u32,
    /// Label of the GPIO chip with the READY line.
    pub chip: String,
    /// The READY line's number on it.
    pub ready_line: u32,
}

/// What is used for the decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Profile {
    /// Any cut stops: tier 1.
    Cutoff,
    /// ... and heights are told: tiers 1 and 2.
    Height,
    /// ... and what it is, too: all three tiers.
    Semantics,
}

/// A stretch of the stripe with a name, `A` to `H` on the whole robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Zone {
    /// One letter.
    pub name: String,
    /// First stripe coordinate, millimetres.
    pub start_mm: f64,
    /// Last stripe coordinate, millimetres.
    pub end_mm: f64,
    /// What it does, unless cases say so.
    pub field: Field,
    /// Tier 3: what begins no farther behind the stripe than this is in the zone, too, millimetres.
    pub ahead_mm: f64,
}

/// What an interruption in a zone asks for. The controller's own field is always the whole stripe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Stop.
    Protective,
    /// Warn.
    Warning,
}

/// How the host learns how fast the robot is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpeedSource {
    /// Not at all: all cases are in force together.
    None,
    /// The robot sends it, one number in a UDP datagram.
    Udp,
}

/// The robot's speed, as an input that selects a case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SpeedInput {
    /// Where it comes from.
    pub source: SpeedSource,
    /// Where datagrams are taken.
    pub listen: SocketAddr,
    /// An older speed is none, milliseconds.
    pub longest_age_ms: u32,
}

/// Zones by speed.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedCase {
    /// Up to this speed, mm/s.
    pub up_to_mm_s: f64,
    /// Names of its protective zones.
    pub protective: Vec<String>,
    /// Names of its warning zones.
    pub warning: Vec<String>,
}

/// Tier 3.
#[derive(Debug, Clone, PartialEq)]
pub struct Detector {
    /// `rten`, `ort`, `hailo`, or `recorded`.
    pub backend: String,
    /// The model's file; `None` = the one that is built in.
    pub model: Option<PathBuf>,
    /// An answer that takes longer is none, milliseconds.
    pub deadline_ms: u32,
}

/// What is kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Where; `None` = nothing is recorded.
    pub directory: Option<PathBuf>,
    /// All recordings together, MiB; the oldest give way.
    pub limit_mib: u32,
    /// Seconds before a stop.
    pub before_s: f64,
    /// Seconds after it.
    pub after_s: f64,
}

/// The operator's page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Page {
    /// Where it listens; loopback unless somebody says otherwise.
    pub listen: SocketAddr,
    /// File with the token that allows remarks; `None` = read-only for everybody.
    pub token_file: Option<PathBuf>,
}

/// What is asked of the operating system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RealTime {
    /// SCHED_FIFO priority of the stripe's path; 0 = normal scheduling.
    pub priority: u32,
    /// Cores of the stripe's path; empty = any.
    pub cores: Vec<u32>,
    /// Lock all memory.
    pub lock_memory: bool,
}

/// The robot, for the stopping distance.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Greatest speed, mm/s.
    pub speed_mm_s: f64,
    /// Braking, mm/s^2, that it surely reaches with its load.
    pub deceleration_mm_s2: f64,
    /// From the open circuit to the beginning of braking, milliseconds.
    pub brake_delay_ms: f64,
    /// From the relay's command to its open contacts, milliseconds.
    pub relay_drop_out_ms: f64,
    /// Speed at which people walk towards it, mm/s (ISO 13855: 1600; 0 = things that lie still).
    pub approach_mm_s: f64,
    /// Distance from the stripe to the robot's front, millimetres; `None` = from the rig.
    pub distance_mm: Option<f64>,
    /// Added for measuring errors and intrusion (ISO 13855: C), millimetres.
    pub supplement_mm: f64,
}

pub(crate) fn module(section: &Section<'_>) -> Module {
    let name = section.text("name", "front");
    let sound = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    if !name.chars().all(sound) {
        section.object("name", "must consist of a-z, 0-9 and _: topics are named after it");
    }
    let source = u16::try_from(section.whole("source_id", 1, 1..=65_535, "")).unwrap_or(1);
    section.finish();
    Module { name, source }
}

pub(crate) fn camera(section: &Section<'_>) -> Camera {
    let source = section.choice(
        "source",
        Source::Twin,
        &[
            ("twin", Source::Twin),
            ("twin-loop", Source::TwinLoop),
            ("replay", Source::Replay),
            ("rpicam-vid", Source::RpicamVid),
            ("command", Source::Command),
            ("libcamera", Source::Libcamera),
        ],
    );
    let input = section.optional_text("input");
    let camera = Camera {
        source,
        input,
        width: section.whole("width", 2304, 64..=4608, "pixels"),
        height: section.whole("height", 1296, 64..=2592, "pixels"),
        frames_per_second: section.number("frames_per_second", 50.0, 5.0..=240.0, "pictures a second"),
        exposure_us: section.whole("exposure_us", 4000, 50..=10_000, "microseconds"),
        read_out_us: section.whole("read_out_us", 17_300, 0..=100_000, "microseconds"),
        gain: section.number("gain", 2.0, 1.0..=16.0, ""),
        focus: section.number("focus_dioptres", 2.0, 0.0..=15.0, "dioptres"),
        background_subtraction: section.flag("background_subtraction", false),
    };
    if camera.source == Source::Replay && camera.input.is_none() {
        section.object("input", "is missing; name the folder of pictures to replay");
    }
    if camera.source == Source::Command && camera.input.as_deref().is_none_or(|input| input.trim().is_empty())
    {
        section
            .object("input", "is missing; name the program that writes YUV420 pictures, with its arguments");
    }
    let period_us = 1e6 / camera.frames_per_second;
    if f64::from(camera.exposure_us) > period_us {
        section
            .object("exposure_us", format!("is longer than the frame period of {period_us:.0} microseconds"));
    }
    section.finish();
    camera
}

pub(crate) fn link(section: &Section<'_>) -> Spi {
    let kind = section.choice(
        "kind",
        LinkKind::InProcess,
        &[("in-process", LinkKind::InProcess), ("emulated", LinkKind::Emulated), ("spi", LinkKind::Spi)],
    );
    let link = Spi {
        kind,
        device: section.path("device").unwrap_or_else(|| PathBuf::from("/dev/spidev0.0")),
        hertz: section.whole("hertz", 16_000_000, 1_000_000..=16_000_000, "Hz"),
        chip: section.text("ready_chip", "pinctrl-rp1"),
        ready_line: section.whole("ready_line", 25, 0..=63, ""),
    };
    section.finish();
    link
}

pub(crate) fn zone(section: &Section<'_>) -> Zone {
    let name = section.text("name", "A");
    if !matches!(name.as_bytes(), [b'A'..=b'H']) {
        section.object("name", "must be one letter from A to H");
    }
    let start_mm = section.number("start_mm", 0.0, -5000.0..=5000.0, "millimetres");
    let end_mm = section.number("end_mm", 0.0, -5000.0..=5000.0, "millimetres");
    if start_mm >= end_mm {
        section.object("end_mm", "must be greater than start_mm");
    }
    let field = section.choice(
        "field",
        Field::Protective,
        &[("protective", Field::Protective), ("warning", Field::Warning)],
    );
    let ahead_mm = section.number("ahead_mm", 400.0, 0.0..=2000.0, "millimetres");
    section.finish();
    Zone { name, start_mm, end_mm, field, ahead_mm }
}

pub(crate) fn speed_input(section: &Section<'_>) -> SpeedInput {
    let source = section.choice(
        "source",
        SpeedSource::None,
        &[("none", SpeedSource::None), ("udp", SpeedSource::Udp)],
    );
    let listen = section.address("listen", 8034);
    let longest_age_ms = section.whole("longest_age_ms", 500, 20..=5000, "milliseconds");
    section.finish();
    SpeedInput { source, listen, longest_age_ms }
}

pub(crate) fn speed_case(section: &Section<'_>, zones: &[Zone]) -> SpeedCase {
    let up_to_mm_s = section.number("up_to_mm_s", 1000.0, 1.0..=10_000.0, "mm/s");
    let names = |key: &'static str| {
        let names = section.names(key);
        for name in &names {
            if !zones.iter().any(|zone| zone.name == *name) {
                section.object(key, format!("zone {name} is not defined; add a [[zone]] with this name"));
            }
        }
        names
    };
    let (protective, warning) = (names("protective"), names("warning"));
    if protective.is_empty() {
        section.object("protective", "names no zone: nothing would stop in this case");
    }
    section.finish();
    SpeedCase { up_to_mm_s, protective, warning }
}

pub(crate) fn detector(section: &Section<'_>) -> Detector {
    let backends = ["rten", "ort", "hailo", "recorded"].map(|name| (name, name));
    let detector = Detector {
        backend: section.choice("backend", "rten", &backends).to_owned(),
        model: section.path("model"),
        deadline_ms: section.whole("deadline_ms", 200, 10..=2000, "milliseconds"),
    };
    section.finish();
    detector
}

pub(crate) fn recording(section: &Section<'_>) -> Recording {
    let recording = Recording {
        directory: section.path("directory"),
        limit_mib: section.whole("limit_mib", 2048, 16..=1_048_576, "MiB"),
        before_s: section.number("before_s", 5.0, 0.0..=60.0, "seconds"),
        after_s: section.number("after_s", 5.0, 0.0..=60.0, "seconds"),
    };
    section.finish();
    recording
}

pub(crate) fn page(section: &Section<'_>) -> Page {
    let listen = section.address("listen", 8033);
    let token_file = section.path("token_file");
    section.finish();
    Page { listen, token_file }
}

pub(crate) fn real_time(section: &Section<'_>) -> RealTime {
    let real_time = RealTime {
        priority: section.whole("priority", 60, 0..=98, ""),
        cores: section.wholes("cores", 0..=255),
        lock_memory: section.flag("lock_memory", true),
    };
    section.finish();
    real_time
}

pub(crate) fn robot(section: &Section<'_>) -> Robot {
    let distance = section.has("distance_mm");
    let distance_mm = section.number("distance_mm", 500.0, 10.0..=10_000.0, "millimetres");
    let robot = Robot {
        speed_mm_s: section.number("speed_mm_s", 1000.0, 1.0..=10_000.0, "mm/s"),
        deceleration_mm_s2: section.number("deceleration_mm_s2", 2000.0, 10.0..=20_000.0, "mm/s^2"),
        brake_delay_ms: section.number("brake_delay_ms", 30.0, 0.0..=2000.0, "milliseconds"),
        relay_drop_out_ms: section.number("relay_drop_out_ms", 20.0, 0.0..=500.0, "milliseconds"),
        approach_mm_s: section.number("approach_mm_s", 0.0, 0.0..=5000.0, "mm/s"),
        distance_mm: distance.then_some(distance_mm),
        supplement_mm: section.number("supplement_mm", 30.0, 0.0..=1000.0, "millimetres"),
    };
    section.finish();
    robot
}
