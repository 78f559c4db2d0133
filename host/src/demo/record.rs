//! What the demo writes down: one record a frame, one an act, and the whole run as JSON.

use serde::Serialize;

/// One camera frame on its way through everything.
#[derive(Debug, Clone, Serialize)]
pub struct FrameRecord {
    /// Counts from 0.
    pub frame: u32,
    /// Virtual time at which its line-scan was sent, milliseconds since power-on.
    pub t_ms: f64,
    /// Index of the act.
    pub act: usize,
    /// The controller's state after the frame.
    pub state: &'static str,
    /// Relays commanded closed after the frame.
    pub commanded_closed: bool,
    /// Relays' main contacts closed after the frame.
    pub contacts_closed: bool,
    /// The controller's longest gap, millimetres; `None` = the stripe is whole.
    pub longest_gap_mm: Option<f32>,
    /// What is really there (longest gap of any kind); the sensor never sees this.
    pub true_gap_mm: f64,
    /// The controller's highest point, millimetres; `None` = nothing raised.
    pub highest_mm: Option<f32>,
    /// Highest point that is really lit and visible, millimetres.
    pub true_highest_mm: Option<f64>,
    /// Causes that hold.
    pub live_causes: Vec<&'static str>,
    /// Causes since the last reset.
    pub latched_causes: Vec<&'static str>,
    /// From exposure to decision, milliseconds, of the last accepted line-scan.
    pub decision_age_ms: f64,
    /// What became of the host's message.
    pub message: MessageFate,
    /// The host's own tier 1.
    pub host_cut: bool,
    /// The laser's brightness command in the picture, 0 to 255.
    pub laser_level: u8,
}

/// What became of a host's message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MessageFate {
    /// Sent as it should be.
    Sent,
    /// Never arrived.
    Dropped,
    /// Bits flipped.
    Damaged,
    /// An old one again.
    Repeated,
    /// Sent with a verdict that is a lie.
    FalseClear,
    /// Sent with a request to stop.
    StopRequest,
}

/// One expectation and what became of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckRecord {
    /// In words.
    pub expected: String,
    /// In words.
    pub happened: String,
    /// True if met.
    pub met: bool,
    /// Reaction: from the trigger to the relays' open command, milliseconds.
    pub reaction_ms: Option<f64>,
    /// From the trigger to the relays' contacts proven open, milliseconds.
    pub contacts_open_ms: Option<f64>,
    /// True if the trigger is the first interrupted light.
    pub from_light: bool,
}

/// One act.
#[derive(Debug, Clone, Serialize)]
pub struct ActRecord {
    /// The name that programs read.
    pub name: &'static str,
    /// What people read.
    pub title: &'static str,
    /// What must happen.
    pub promise: &'static str,
    /// Its beginning, milliseconds since power-on.
    pub start_ms: f64,
    /// Its end.
    pub end_ms: f64,
    /// The expectations.
    pub checks: Vec<CheckRecord>,
    /// Causes that appeared during the act, in the order of their first appearance.
    pub causes: Vec<&'static str>,
    /// Largest gap that the controller reported, millimetres.
    pub largest_gap_mm: Option<f32>,
    /// Highest point that the controller reported, millimetres.
    pub highest_mm: Option<f32>,
}

impl ActRecord {
    /// True if every expectation was met.
    #[must_use]
    pub fn met(&self) -> bool {
        self.checks.iter().all(|check| check.met)
    }
}

/// The link's figures at the end.
#[derive(Debug, Clone, Default, Serialize)]
pub struct LinkHealth {
    /// Line-scans accepted over the whole run.
    pub accepted: u32,
    /// Refused (and time-outs), by cause, over the whole run.
    pub refused: Vec<(&'static str, u32)>,
    /// Longest time from exposure to decision, milliseconds, over the whole run.
    pub longest_decision_age_ms: f64,
    /// The bound that such a time must keep.
    pub response_bound_ms: f64,
    /// Watchdog resets of the controller.
    pub watchdog_resets: u32,
}

/// The whole run.
#[derive(Debug, Clone, Serialize)]
pub struct DemoRecord {
    /// `nearfield-demo-1`.
    pub schema: &'static str,
    /// `in-process` or `emulated`.
    pub mcu: &'static str,
    /// The twin's seed.
    pub seed: u64,
    /// The rig's identity, as host and controller agree on it.
    pub calibration_id: String,
    /// The firmware's identity.
    pub firmware_id: String,
    /// Picture size, pixels.
    pub picture: [u16; 2],
    /// First and last watched s, millimetres.
    pub stripe_mm: [f64; 2],
    /// True if every expectation of every act was met.
    pub met: bool,
    /// Wall-clock seconds that the minute took.
    pub wall_seconds: f64,
    /// The acts.
    pub acts: Vec<ActRecord>,
    /// The link.
    pub link: LinkHealth,
    /// When the relays were commanded closed (true) or open, milliseconds.
    pub relay_changes: Vec<(f64, bool)>,
    /// Every frame.
    pub frames: Vec<FrameRecord>,
}

impl DemoRecord {
    /// Expectations met, and all of them.
    #[must_use]
    pub fn score(&self) -> (usize, usize) {
        let all = || self.acts.iter().flat_map(|act| &act.checks);
        (all().filter(|check| check.met).count(), all().count())
    }

    /// Reactions from the first interrupted light to the open command, milliseconds: median and slowest.
    #[must_use]
    pub fn light_reactions(&self) -> Option<(f64, f64)> {
        let checks = self.acts.iter().flat_map(|act| &act.checks).filter(|check| check.from_light);
        let mut times: Vec<f64> = checks.filter_map(|check| check.reaction_ms).collect();
        times.sort_by(f64::total_cmp);
        Some((*times.get(times.len() / 2)?, *times.last()?))
    }
}
