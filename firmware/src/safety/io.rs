//! What goes into the controller and what comes out of it: pins, commands, configuration.

use crate::flow::FeedPermit;
use crate::output_test::{Channel, PulseReadback};
use crate::relay::MirrorContacts;
use crate::secret::SECRET_LENGTH;
use crate::selftest::SelfTestReport;
use nearfield_shared::columns::GeometryError;
use nearfield_shared::condition::{Channels, ResetCause};
use nearfield_shared::rig::CompactRigError;

/// What a start knows.
#[derive(Debug, Clone, Copy)]
pub struct StartInputs<'a> {
    /// Why the chip was reset.
    pub reset_cause: ResetCause,
    /// The stored rig's compact form, or whatever the flash holds in its place.
    pub stored_rig: &'a [u8],
    /// From the chip's random number generator, anew for every start.
    pub secret: [u8; SECRET_LENGTH],
}

/// What the input pins say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PinInputs {
    /// The relays' mirror contacts.
    pub mirror: MirrorContacts,
    /// The reset button is pressed.
    pub reset_pressed: bool,
    /// The service key is turned.
    pub service_key: bool,
    /// The relay drivers' outputs as read back; true = the coil is driven.
    pub coils: Channels,
    /// What was read back during the pulse that the tick before asked for.
    pub pulse: Option<PulseReadback>,
}

/// What a tick takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TickInputs {
    /// The pins.
    pub pins: PinInputs,
    /// What the self-tests have found.
    pub self_test: SelfTestReport,
}

/// The lamp that tells people what the controller waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Indicator {
    /// Testing itself.
    Testing,
    /// Waiting for the reset button.
    WaitingForReset,
    /// The relays may close.
    Permitted,
    /// Stopped by a cause.
    Stopped,
    /// Locked out: call service.
    Service,
}

/// What the output pins are to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs {
    /// The relays' coils.
    pub relays: Channels,
    /// The laser's brightness, 0 = off, 255 = full.
    pub laser_level: u8,
    /// The lamp.
    pub indicator: Indicator,
    /// The warning output: the robot may go on, but slower, and somebody should look.
    pub warning: bool,
    /// Invert this channel's drive for [`PULSE_LENGTH`](nearfield_shared::limits::PULSE_LENGTH), read both coils back at
    /// the end of it, and hand the reading in with the next tick.
    pub pulse: Option<Channel>,
}

impl Outputs {
    /// What pins are before the controller has said anything, and after any reset: everything off.
    pub const SAFE: Self = Self {
        relays: Channels::OPEN,
        laser_level: crate::laser_code::LASER_OFF,
        indicator: Indicator::Testing,
        warning: false,
        pulse: None,
    };
}

/// What a tick yields.
#[derive(Debug)]
pub struct TickOutput {
    /// For the pins.
    pub outputs: Outputs,
    /// For the watchdogs, after the pins were set; `None` = do not feed them.
    pub permit: Option<FeedPermit>,
}

/// Why the stored rig cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConfigurationError {
    /// The stored bytes are no valid rig.
    Rig(CompactRigError),
    /// A valid rig that yields no column maps.
    Geometry(GeometryError),
}
