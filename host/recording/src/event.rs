//! What happens in a running host, as its recorder and its page are told: plain values of fixed size where the stripe's path
//! makes them, so that telling costs a copy and no allocation.

use std::sync::Arc;
use std::time::Duration;

use nearfield_fields::Report;
use nearfield_shared::action::Action;
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH};
use nearfield_shared::status::STATUS_LENGTH;
use nearfield_shared::units::Micros;

/// Bytes of a lock-step request without its payload (see the firmware's module `lockstep`).
pub const REQUEST_LENGTH: usize = 16;
/// Bytes of a lock-step reply: 8 about pins and watchdog, then the status.
pub const REPLY_LENGTH: usize = 8 + STATUS_LENGTH;

/// What a simulated controller was asked and what it answered, byte for byte: these make it decide again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LockStep {
    /// Counts the requests since power-up; a hole says that some were lost on the way to the recorder.
    pub number: u64,
    /// The request, without its payload.
    pub request: [u8; REQUEST_LENGTH],
    /// The reply.
    pub reply: [u8; REPLY_LENGTH],
}

/// What the host made of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    /// Pictures since the program began.
    pub picture: u64,
    /// Middle of its exposure, the host's clock.
    pub exposed: Micros,
    /// What the host told the controller.
    pub verdict: HostVerdict,
    /// May the robot move, as far as the contacts tell?
    pub relay_closed: bool,
    /// Zones and the case in force.
    pub fields: Report,
    /// What the robot's planner is advised to do; `None` = drive on.
    pub advice: Option<Action>,
    /// From the picture in memory to the status received.
    pub latency: Duration,
}

/// Something that tier 3 saw.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    /// Category of the action table.
    pub category: String,
    /// How sure, 0 to 1, calibrated.
    pub confidence: f64,
    /// Left, top, right, bottom; pixels of the full picture, an integer is a pixel's centre.
    pub pixels: [f64; 4],
}

/// What tier 3 said about one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Detections {
    /// Middle of that picture's exposure, the host's clock.
    pub exposed: Micros,
    /// What it saw, or why it does not know.
    pub seen: Result<Vec<Sighting>, String>,
}

/// A picture for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Middle of its exposure, the host's clock.
    pub exposed: Micros,
    /// JPEG file.
    pub jpeg: Vec<u8>,
    /// Columns and rows of the full picture that it was made from.
    pub full_size: (u16, u16),
}

/// What happens.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "one fixed size in a queue that is allocated once")]
pub enum Event {
    /// A simulated controller was switched on; `payload` is its secret and its stored rig.
    PowerUp {
        /// Request and reply.
        step: LockStep,
        /// The request's payload.
        payload: Arc<[u8]>,
    },
    /// A simulated controller's tick.
    Tick(LockStep),
    /// A transaction with any controller.
    Exchange {
        /// Simulated controllers only.
        step: Option<LockStep>,
        /// What was sent; `None` = the host only asked for the status.
        line_scan: Option<[u8; LINE_SCAN_LENGTH]>,
        /// What came back.
        status: [u8; STATUS_LENGTH],
    },
    /// A picture was dealt with.
    Decision(Decision),
    /// Tier 3 answered.
    Detections(Arc<Detections>),
    /// A picture for people.
    Picture(Arc<Picture>),
    /// A person's remark, or something to be told: it keeps the pictures around it.
    Mark(Arc<str>),
    /// Something that went wrong.
    Warning(Arc<str>),
}

/// An event and when it happened.
#[derive(Debug, Clone, PartialEq)]
pub struct Stamped {
    /// The host's clock: time since the program began, virtual with a simulated controller.
    pub at: Micros,
    /// What.
    pub event: Event,
}
