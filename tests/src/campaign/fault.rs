//! Every fault that the campaign injects, by name, with the time within which the relays must be commanded open.

use nearfield_firmware::selftest::SelfTestKind;
use nearfield_host::link::{Channel, DriverFault, RelayFault};

/// What goes wrong, or what demands a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Three random bits of every message flip.
    BitFlips,
    /// Messages end early.
    Truncation,
    /// Random bytes instead of messages.
    Garbage,
    /// Another module's number, in a good message.
    WrongSource,
    /// Another rig's number, in a good message.
    WrongCalibration,
    /// The last message again and again.
    Repetition,
    /// Numbers jump ahead.
    SequenceJump,
    /// Messages answer a status of long ago.
    StaleMessage,
    /// Pictures are too old by the host's own word.
    OldPicture,
    /// No messages.
    Silence,
    /// Polls without line-scans.
    Polls,
    /// The host asks for a stop.
    HostStop,
    /// The camera delivers the same picture, in fresh messages.
    FrozenPicture,
    /// Pictures of half a second ago, in fresh messages.
    Replay,
    /// Pictures 200 ms older than the host says.
    LyingAge,
    /// A synthetic floor of constant brightness.
    SyntheticFloor,
    /// The lens is covered.
    CoveredLens,
    /// The laser gives no light.
    DeadLaser,
    /// A stripe of another robot, with its own code.
    NeighbourLaser,
    /// The laser is always at full brightness: its drive is stuck.
    StuckLaserDrive,
    /// The host shifts all rows by five.
    ShiftedRows,
    /// An object of 60 mm, reported as floor.
    InventedFloor,
    /// The audit is not answered.
    NoAudit,
    /// A cable of 10 mm.
    Cable,
    /// A foot of 100 mm.
    Foot,
    /// A foot of 100 mm that the host claims to be debris.
    FalseClaims,
    /// Debris that is claimed as such, lies low, and stays.
    StayingDebris,
    /// The floor drops by 20 mm over 150 mm.
    Drop,
    /// The mount has moved: the floor seems 1.3 mm higher.
    MovedMount,
    /// The relay's contact of channel A is welded, and something is on the stripe.
    WeldedA,
    /// The relay's contact of channel B is welded, and something is on the stripe.
    WeldedB,
    /// The relay of channel A drops out by itself.
    DeadCoilA,
    /// The relay of channel B drops out by itself.
    DeadCoilB,
    /// A driver of a coil is faulty.
    Driver(DriverFault),
    /// The reset button is taped down.
    StuckButton,
    /// The controller's program hangs.
    Hang,
    /// The controller's program is held up for 16 ms.
    LateTick,
    /// A self-test fails.
    SelfTest(SelfTestKind),
}

impl Fault {
    /// All of them.
    pub const ALL: [Self; 54] = [
        Self::BitFlips,
        Self::Truncation,
        Self::Garbage,
        Self::WrongSource,
        Self::WrongCalibration,
        Self::Repetition,
        Self::SequenceJump,
        Self::StaleMessage,
        Self::OldPicture,
        Self::Silence,
        Self::Polls,
        Self::HostStop,
        Self::FrozenPicture,
        Self::Replay,
        Self::LyingAge,
        Self::SyntheticFloor,
        Self::CoveredLens,
        Self::DeadLaser,
        Self::NeighbourLaser,
        Self::StuckLaserDrive,
        Self::ShiftedRows,
        Self::InventedFloor,
        Self::NoAudit,
        Self::Cable,
        Self::Foot,
        Self::FalseClaims,
        Self::StayingDebris,
        Self::Drop,
        Self::MovedMount,
        Self::WeldedA,
        Self::WeldedB,
        Self::DeadCoilA,
        Self::DeadCoilB,
        Self::Driver(DriverFault::StuckOn(Channel::A)),
        Self::Driver(DriverFault::StuckOn(Channel::B)),
        Self::Driver(DriverFault::StuckOff(Channel::A)),
        Self::Driver(DriverFault::StuckOff(Channel::B)),
        Self::Driver(DriverFault::Shorted),
        Self::Driver(DriverFault::NoReadback),
        Self::StuckButton,
        Self::Hang,
        Self::LateTick,
        Self::SelfTest(SelfTestKind::Processor),
        Self::SelfTest(SelfTestKind::FloatingPoint),
        Self::SelfTest(SelfTestKind::Memory),
        Self::SelfTest(SelfTestKind::Program),
        Self::SelfTest(SelfTestKind::Stack),
        Self::SelfTest(SelfTestKind::Clock),
        Self::SelfTest(SelfTestKind::Supply),
        Self::SelfTest(SelfTestKind::Configuration),
        Self::SelfTest(SelfTestKind::Watchdog),
        Self::SelfTest(SelfTestKind::Random),
        Self::SelfTest(SelfTestKind::Registers),
        Self::SelfTest(SelfTestKind::Schedule),
    ];

    /// From the fault's first effect (the first frame or tick under it) until both relays are commanded open, at most,
    /// milliseconds. Each is derived in `firmware/SAFETY.md`.
    #[must_use]
    pub const fn bound_ms(self) -> u64 {
        match self {
            // The second refused message.
            Self::BitFlips
            | Self::Truncation
            | Self::Garbage
            | Self::WrongSource
            | Self::WrongCalibration
            | Self::Repetition
            | Self::OldPicture => 45,
            // Numbers and statuses run on while nothing is accepted.
            Self::SequenceJump | Self::StaleMessage => 65,
            // The link's time-out, a tick, and the frame period before the first message that is missed.
            Self::Silence | Self::Polls => 90,
            // One frame: the gap trips at once; a request is one voice.
            Self::HostStop
            | Self::CoveredLens
            | Self::DeadLaser
            | Self::Foot
            | Self::FalseClaims
            | Self::NoAudit
            | Self::ShiftedRows => 25,
            // The vote over three frames.
            Self::Cable | Self::Drop => 65,
            // Three frames until it lies there, the permit's longest time, a frame.
            Self::StayingDebris => 1_105,
            // Two changes of the laser's code (160), the ages of picture and message (110), a frame.
            Self::FrozenPicture | Self::SyntheticFloor | Self::StuckLaserDrive => 290,
            // Chance: each change finds a wrong code by one half, twelve times a second (see `liveness`).
            Self::Replay | Self::LyingAge | Self::NeighbourLaser => 2_500,
            // Chance: 0.6 contradictions a line-scan, six needed (see `audit`).
            Self::InventedFloor => 1_500,
            // A running mean over 50 pictures.
            Self::MovedMount => 4_000,
            // The demand that comes with them: a foot, one frame.
            Self::WeldedA | Self::WeldedB => 25,
            // The discrepancy time of the mirror contacts and a tick; a frame until it is looked at.
            Self::DeadCoilA | Self::DeadCoilB => 75,
            // Two pulse periods and three ticks.
            Self::Driver(_) => 1_020,
            // The longest press.
            Self::StuckButton => 3_020,
            // The watchdog's time and a tick.
            Self::Hang => 125,
            // The late tick itself.
            Self::LateTick => 45,
            // The tick that is told.
            Self::SelfTest(_) => 25,
        }
    }

    /// The fault of the relays that belongs to it: channel A's and channel B's.
    #[must_use]
    pub const fn relays(self) -> [Option<RelayFault>; 2] {
        match self {
            Self::WeldedA => [Some(RelayFault::Welded), None],
            Self::WeldedB => [None, Some(RelayFault::Welded)],
            Self::DeadCoilA => [Some(RelayFault::DeadCoil), None],
            Self::DeadCoilB => [None, Some(RelayFault::DeadCoil)],
            _ => [None; 2],
        }
    }

    /// Over as soon as it has happened: after a reset by a person the relays may close again.
    #[must_use]
    pub const fn is_momentary(self) -> bool {
        matches!(self, Self::Hang | Self::LateTick)
    }

    /// Does it keep this channel's contact from opening: 0 = A, 1 = B?
    #[must_use]
    pub const fn holds_closed(self, channel: usize) -> bool {
        match self {
            Self::WeldedA | Self::Driver(DriverFault::StuckOn(Channel::A)) => channel == 0,
            Self::WeldedB | Self::Driver(DriverFault::StuckOn(Channel::B)) => channel == 1,
            _ => false,
        }
    }

    /// A name for tables.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Driver(fault) => format!("Driver {fault:?}"),
            Self::SelfTest(kind) => format!("SelfTest {}", kind.name()),
            other => format!("{other:?}"),
        }
    }
}
