//! Events as messages: JSON with exact wire bytes (base64) beside readable fields, and the schemas that describe them.
//!
//! | topic | schema | content |
//! |---|---|---|
//! | `/camera` | `foxglove.CompressedImage` | a JPEG, some pictures a second, around stops only |
//! | `/line_scan` | `nearfield.LineScan` | every line-scan sent |
//! | `/status` | `nearfield.Status` | every status received in a transaction |
//! | `/decision` | `nearfield.Decision` | the host's verdict and the relays, per picture |
//! | `/detections` | `nearfield.Detections` | tier 3's answers |
//! | `/controller` | `nearfield.LockStep` | simulated controllers: every request and reply, which make it decide again |
//! | `/configuration` | `nearfield.Configuration` | at the beginning of every file |
//! | `/log` | `foxglove.Log` | stops in words, remarks, warnings, lost events |

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use nearfield_shared::action::Action;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::linescan::{HostVerdict, LineScan};
use nearfield_shared::status::{Channels, Status};
use nearfield_shared::units::Micros;
use serde::{Deserialize, Serialize};

use crate::event::{Decision, Detections, LockStep, Picture};

/// A topic and how its messages are described.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topic {
    /// Its name.
    pub name: &'static str,
    /// Name of the schema.
    pub schema: &'static str,
    /// The schema: JSON Schema.
    pub text: &'static str,
}

macro_rules! topics {
    ($($constant:ident $name:literal $schema:literal $file:literal;)*) => {
        $(#[doc = concat!("`", $name, "`")]
        pub const $constant: Topic =
            Topic { name: $name, schema: $schema, text: include_str!(concat!("schemas/", $file)) };)*
        /// All of them.
        pub const TOPICS: &[Topic] = &[$($constant),*];
    };
}

topics! {
    CAMERA "/camera" "foxglove.CompressedImage" "compressed_image.json";
    LINE_SCAN "/line_scan" "nearfield.LineScan" "line_scan.json";
    STATUS "/status" "nearfield.Status" "status.json";
    DECISION "/decision" "nearfield.Decision" "decision.json";
    DETECTIONS "/detections" "nearfield.Detections" "detections.json";
    CONTROLLER "/controller" "nearfield.LockStep" "lock_step.json";
    CONFIGURATION "/configuration" "nearfield.Configuration" "configuration.json";
    LOG "/log" "foxglove.Log" "log.json";
}

/// Base64, standard alphabet with padding.
#[must_use]
pub fn to_text(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

/// Back.
#[must_use]
pub fn from_text(text: &str) -> Option<Vec<u8>> {
    STANDARD.decode(text).ok()
}

/// Seconds and nanoseconds since 1970, as Foxglove's schemas have them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds.
    pub sec: u64,
    /// The rest.
    pub nsec: u64,
}

impl Time {
    /// Of nanoseconds since 1970.
    #[must_use]
    pub const fn of(nanoseconds: u64) -> Self {
        Self { sec: nanoseconds / 1_000_000_000, nsec: nanoseconds % 1_000_000_000 }
    }
}

/// `foxglove.CompressedImage`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CompressedImage {
    /// When it was exposed.
    pub timestamp: Time,
    /// The camera's frame of reference.
    pub frame_id: String,
    /// The JPEG, base64.
    pub data: String,
    /// `jpeg`.
    pub format: String,
}

impl CompressedImage {
    /// Of a picture.
    #[must_use]
    pub fn of(picture: &Picture, exposed: u64) -> Self {
        Self {
            timestamp: Time::of(exposed),
            frame_id: "camera".to_owned(),
            data: to_text(&picture.jpeg),
            format: "jpeg".to_owned(),
        }
    }
}

/// `foxglove.Log`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Log {
    /// When.
    pub timestamp: Time,
    /// 2 information, 3 warning, 4 error.
    pub level: u8,
    /// In words.
    pub message: String,
    /// Who says so.
    pub name: String,
    /// Not used.
    pub file: String,
    /// Not used.
    pub line: u32,
}

/// `nearfield.LineScan`.
#[derive(Debug, Serialize, Deserialize)]
pub struct LineScanMessage {
    /// Readable fields; missing if the bytes are no line-scan.
    #[serde(flatten)]
    pub fields: Option<LineScanFields>,
    /// The bytes as they were sent, base64.
    pub wire: String,
}

/// What a line-scan's header says.
#[derive(Debug, Serialize, Deserialize)]
pub struct LineScanFields {
    /// Sequence number.
    pub sequence: u32,
    /// Age of the picture when it was sent, microseconds.
    pub capture_age_us: u64,
    /// Exposure, microseconds.
    pub exposure_us: u64,
    /// The host's verdict.
    pub verdict: String,
    /// Columns.
    pub columns: usize,
    /// Columns that show a stripe.
    pub columns_with_stripe: usize,
}

impl LineScanMessage {
    /// Of its bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let fields = LineScan::parse(bytes).ok().map(|scan| {
            let header = scan.header();
            LineScanFields {
                sequence: header.sequence.get(),
                capture_age_us: header.capture_age.get(),
                exposure_us: header.exposure.get(),
                verdict: verdict_name(header.verdict).to_owned(),
                columns: scan.column_count(),
                columns_with_stripe: scan.columns().filter(|one| one.row.to_pixels().is_some()).count(),
            }
        });
        Self { fields, wire: to_text(bytes) }
    }
}

/// `nearfield.Status`.
#[derive(Debug, Serialize, Deserialize)]
pub struct StatusMessage {
    /// Readable fields; missing if the bytes are no status.
    #[serde(flatten)]
    pub fields: Option<StatusFields>,
    /// The bytes as they came, base64.
    pub wire: String,
}

/// What a status says.
#[derive(Debug, Serialize, Deserialize)]
pub struct StatusFields {
    /// Counts the statuses.
    pub number: u32,
    /// The last accepted line-scan.
    pub echoed_sequence: u32,
    /// The supervisor's state.
    pub state: String,
    /// What both relay channels are told.
    pub relay_command: String,
    /// What both contacts say.
    pub relay_readback: String,
    /// Causes that hold now.
    pub live_causes: Vec<String>,
    /// Causes since the last reset.
    pub latched_causes: Vec<String>,
    /// Longest gap in the stripe, millimetres; 0 = whole.
    pub longest_gap_mm: f32,
    /// Highest point over the floor, millimetres.
    pub highest_mm: Option<f32>,
    /// From the exposure to the decision, microseconds.
    pub decision_age_us: u64,
    /// Line-scans accepted since start.
    pub accepted: u32,
    /// Line-scans refused since start.
    pub refused: u32,
    /// Permitted speed, per cent.
    pub permitted_speed_percent: u8,
}

impl StatusMessage {
    /// Of its bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let fields = Status::parse(bytes).ok().map(|status| StatusFields {
            number: status.number,
            echoed_sequence: status.echoed_sequence.get(),
            state: status.state.name().to_owned(),
            relay_command: channels_name(status.relay_command).to_owned(),
            relay_readback: channels_name(status.relay_readback).to_owned(),
            live_causes: cause_names(status.live_causes),
            latched_causes: cause_names(status.latched_causes),
            longest_gap_mm: status.longest_gap.map_or(0.0, |gap| gap.length().get()),
            highest_mm: status.highest.map(|highest| highest.height.get()),
            decision_age_us: status.decision_age.get(),
            accepted: status.accepted,
            refused: status.refused.iter().fold(0, |sum: u32, count| sum.saturating_add(*count)),
            permitted_speed_percent: status.health.permitted_speed_percent,
        });
        Self { fields, wire: to_text(bytes) }
    }
}

/// `nearfield.Decision`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct DecisionMessage {
    /// Pictures since the program began.
    pub picture: u64,
    /// Middle of the exposure, microseconds of the host's clock.
    pub exposed_us: u64,
    /// What the host told the controller: `clear`, `warn` or `stop`.
    pub verdict: String,
    /// `open` or `closed`.
    pub relay: String,
    /// From the picture in memory to the status received, milliseconds.
    pub latency_ms: f64,
    /// The robot's speed, mm/s; none = it was not known.
    #[serde(default)]
    pub speed_mm_s: Option<f32>,
    /// The case in force, from 1; none = there are none, or all were in force together.
    #[serde(default)]
    pub case: Option<u8>,
    /// The zones of this module.
    #[serde(default)]
    pub zones: Vec<ZoneMessage>,
    /// What the robot's planner was advised to do: `run_over`, `go_around`, `stop_and_warn`; none = drive on.
    #[serde(default)]
    pub advice: Option<String>,
}

/// A zone in a decision.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ZoneMessage {
    /// A to H.
    pub name: char,
    /// `named`, `warning` or `protective`.
    pub role: String,
    /// `free`, `suspect` or `infringed`.
    pub finding: String,
}

impl DecisionMessage {
    /// Of a decision.
    #[must_use]
    pub fn of(decision: &Decision) -> Self {
        Self {
            picture: decision.picture,
            exposed_us: decision.exposed.get(),
            verdict: verdict_name(decision.verdict).to_owned(),
            relay: if decision.relay_closed { "closed" } else { "open" }.to_owned(),
            latency_ms: decision.latency.as_secs_f64() * 1e3,
            speed_mm_s: decision.fields.speed_mm_s,
            case: decision.fields.case,
            zones: decision
                .fields
                .named()
                .map(|(name, zone)| ZoneMessage {
                    name,
                    role: zone.role.name().to_owned(),
                    finding: zone.finding.name().to_owned(),
                })
                .collect(),
            advice: decision.advice.map(|action| action_name(action).to_owned()),
        }
    }
}

/// An action's name for programs.
#[must_use]
pub const fn action_name(action: Action) -> &'static str {
    match action {
        Action::RunOver => "run_over",
        Action::GoAround => "go_around",
        Action::StopAndWarn => "stop_and_warn",
    }
}

/// `nearfield.Detections`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct DetectionsMessage {
    /// Middle of the picture's exposure, microseconds of the host's clock.
    pub exposed_us: u64,
    /// Did the detector answer? `false` is never "nothing there".
    pub known: bool,
    /// Why it did not.
    pub reason: String,
    /// What it saw.
    pub objects: Vec<DetectedObject>,
}

/// One object that tier 3 saw.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct DetectedObject {
    /// Category of the action table.
    pub category: String,
    /// 0 to 1.
    pub confidence: f64,
    /// Left, top, right, bottom; pixels of the full picture.
    pub pixels: [f64; 4],
}

impl DetectionsMessage {
    /// Of an answer.
    #[must_use]
    pub fn of(detections: &Detections) -> Self {
        let object = |one: &crate::event::Sighting| DetectedObject {
            category: one.category.clone(),
            confidence: one.confidence,
            pixels: one.pixels,
        };
        Self {
            exposed_us: detections.exposed.get(),
            known: detections.seen.is_ok(),
            reason: detections.seen.as_ref().err().cloned().unwrap_or_default(),
            objects: detections.seen.iter().flatten().map(object).collect(),
        }
    }
}

/// `nearfield.LockStep`.
#[derive(Debug, Serialize, Deserialize)]
pub struct LockStepMessage {
    /// `power_up`, `tick` or `exchange`.
    pub kind: String,
    /// Counts the requests since power-up.
    pub number: u64,
    /// The request without its payload, base64.
    pub request: String,
    /// The payload of `power_up`, base64. That of `exchange` is the message on `/line_scan` before this one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub payload: Option<String>,
    /// `exchange` only: was there a line-scan?
    #[serde(default)]
    pub with_line_scan: bool,
    /// The reply, base64.
    pub reply: String,
}

impl LockStepMessage {
    /// Of a step.
    #[must_use]
    pub fn of(kind: &str, step: &LockStep, payload: Option<&[u8]>, with_line_scan: bool) -> Self {
        Self {
            kind: kind.to_owned(),
            number: step.number,
            request: to_text(&step.request),
            payload: payload.map(to_text),
            with_line_scan,
            reply: to_text(&step.reply),
        }
    }

    /// Back; `None` = it makes no sense.
    #[must_use]
    pub fn step(&self) -> Option<LockStep> {
        Some(LockStep {
            number: self.number,
            request: from_text(&self.request)?.try_into().ok()?,
            reply: from_text(&self.reply)?.try_into().ok()?,
        })
    }
}

/// `nearfield.Configuration`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ConfigurationMessage {
    /// The module's name.
    pub module: String,
    /// The program's version.
    pub version: String,
    /// When the program began, for instance `2026-01-31T12:00:00Z`: names the run.
    pub run: String,
    /// Which file of the run this is, from 0.
    pub segment: u32,
    /// The configuration file's text.
    pub configuration: String,
    /// The rig's compact form, base64.
    pub rig: String,
}

/// `clear`, `warn` or `stop`.
#[must_use]
pub const fn verdict_name(verdict: HostVerdict) -> &'static str {
    match verdict {
        HostVerdict::Clear => "clear",
        HostVerdict::Warn => "warn",
        HostVerdict::Stop => "stop",
    }
}

/// `open`, `closed`, or the one channel that is closed.
#[must_use]
pub const fn channels_name(channels: Channels) -> &'static str {
    match (channels.a, channels.b) {
        (true, true) => "closed",
        (false, false) => "open",
        (true, false) => "a",
        (false, true) => "b",
    }
}

/// The causes' names.
#[must_use]
pub fn cause_names(causes: StopCauses) -> Vec<String> {
    causes.iter().map(|cause| StopCause::name(cause).to_owned()).collect()
}

/// The host's clock as nanoseconds since 1970.
#[must_use]
pub const fn nanoseconds(begun: u64, at: Micros) -> u64 {
    begun.saturating_add(at.get().saturating_mul(1000))
}
