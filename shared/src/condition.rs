//! The words in which the MCU tells its condition: states, faults, warnings, figures, and their codes on the wire.

use crate::units::{Micros, Millimetres};

/// The supervisor's state on the wire. The codes differ in at least four bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateCode {
    /// Testing itself after power-up or reset.
    SelfTest,
    /// All good as far as is known; waiting for the reset button.
    Interlocked,
    /// Relay closed.
    Running,
    /// Stopped by a cause that still holds or has not been reset.
    Stopped,
    /// A fault of the controller itself; only service or a power cycle leads out.
    Lockout,
    /// Reset was pressed; the sensor proves that it sees the laser go dark and come back.
    Arming,
}

impl StateCode {
    pub(crate) const ALL: [Self; 6] =
        [Self::SelfTest, Self::Interlocked, Self::Running, Self::Stopped, Self::Lockout, Self::Arming];

    pub(crate) const fn code(self) -> u8 {
        match self {
            Self::SelfTest => 0x0F,
            Self::Interlocked => 0x33,
            Self::Running => 0x55,
            Self::Stopped => 0x69,
            Self::Lockout => 0xF0,
            Self::Arming => 0xAA,
        }
    }

    /// The name that programs read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SelfTest => "self_test",
            Self::Interlocked => "interlocked",
            Self::Running => "running",
            Self::Stopped => "stopped",
            Self::Lockout => "lockout",
            Self::Arming => "arming",
        }
    }
}

/// How the laser is driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LaserMode {
    /// Off, for good.
    Off,
    /// Off for a moment: the sensor must see it (arming).
    Dark,
    /// Full and dimmed by the secret code.
    Coded,
}

impl LaserMode {
    pub(crate) const fn code(self) -> u8 {
        match self {
            Self::Off => 0,
            Self::Dark => 1,
            Self::Coded => 2,
        }
    }

    pub(crate) const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Off),
            1 => Some(Self::Dark),
            2 => Some(Self::Coded),
            _ => None,
        }
    }
}

/// A fault of the controller or its outputs that only service removes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultCode {
    /// A contact does not follow its command: welded, stuck, or its wire is broken.
    Feedback,
    /// A relay driver does not follow a test pulse: stuck, or shorted to the other channel.
    OutputStage,
    /// The relays' command in memory was damaged.
    RelayMemory,
    /// Memory that the decision rests on was damaged.
    CriticalData,
    /// A self-test failed.
    SelfTest,
}

impl FaultCode {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Feedback, Self::OutputStage, Self::RelayMemory, Self::CriticalData, Self::SelfTest];

    /// On the wire and in logs; 0 = no fault.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Feedback => 0x0F,
            Self::OutputStage => 0x33,
            Self::RelayMemory => 0x55,
            Self::CriticalData => 0x69,
            Self::SelfTest => 0xF0,
        }
    }

    /// The inverse of [`Self::code`].
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| fault.code() == code)
    }

    /// The name that programs read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Feedback => "feedback",
            Self::OutputStage => "output_stage",
            Self::RelayMemory => "relay_memory",
            Self::CriticalData => "critical_data",
            Self::SelfTest => "self_test",
        }
    }
}

/// What the MCU warns of while it lets the robot run, as bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Warnings(u16);

impl Warnings {
    /// Nothing.
    pub const NONE: Self = Self(0);
    /// The floor is not quite where the calibration says.
    pub const FLOOR_OFFSET: Self = Self(1);
    /// Small objects are seen with little margin somewhere.
    pub const VISIBILITY: Self = Self(1 << 1);
    /// Much ambient light.
    pub const AMBIENT: Self = Self(1 << 2);
    /// Much of the stripe is clipped in the picture.
    pub const SATURATED: Self = Self(1 << 3);
    /// The host asks for a warning.
    pub const HOST: Self = Self(1 << 4);
    /// Something on the stripe, not yet enough to stop.
    pub const STRIPE: Self = Self(1 << 5);
    /// A line-scan was refused within the last interval; a second one stops.
    pub const LINK: Self = Self(1 << 6);
    /// Small debris on the stripe passes under a run-over permit.
    pub const RUN_OVER: Self = Self(1 << 7);

    /// From the wire.
    #[must_use]
    pub const fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    /// For the wire.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// With others, if `holds`.
    #[must_use]
    pub const fn with_if(self, other: Self, holds: bool) -> Self {
        if holds { Self(self.0 | other.0) } else { self }
    }

    /// Is any of these among them?
    #[must_use]
    pub const fn has_any(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Each warning's bit, the name that programs read, and what a person reads.
    pub const NAMED: [(Self, &'static str, &'static str); 8] = [
        (Self::FLOOR_OFFSET, "floor_offset", "the floor is not quite where the calibration says"),
        (
            Self::VISIBILITY,
            "visibility",
            "small objects are seen with little margin; clean lens and laser window",
        ),
        (Self::AMBIENT, "ambient", "much ambient light on the stripe"),
        (Self::SATURATED, "saturated", "most of the stripe is clipped; shorten the exposure"),
        (Self::HOST, "host", "the host computer warns"),
        (Self::STRIPE, "stripe", "something is on the stripe, not enough to stop"),
        (Self::LINK, "link", "a message from the host computer was refused"),
        (Self::RUN_OVER, "run_over", "small debris is being run over"),
    ];
}

/// The state of the sensor's health.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HealthFigures {
    /// The floor's mean height, where the calibration says 0.
    pub floor_offset: Millimetres,
    /// The floor's rise from the stripe's first columns to its last.
    pub floor_rise: Millimetres,
    /// The lowest object that is surely told from the floor, where it is seen worst.
    pub smallest_object: Millimetres,
    /// Stripe coordinate s of that place.
    pub smallest_object_place: Millimetres,
    /// Per cent of the configured speed that the MCU permits.
    pub permitted_speed_percent: u8,
}

/// How sure the MCU is of the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TrustFigures {
    /// From the laser's change to the first line-scan that showed it: the last one measured; zero = none yet.
    pub light_age: Micros,
    /// The longest such time since start.
    pub longest_light_age: Micros,
    /// Doubt that the pictures are live.
    pub liveness_doubt: u16,
    /// Doubt that the host reports what its pixels show.
    pub audit_doubt: u16,
    /// Audit windows that bore the host's report out.
    pub audits_confirmed: u32,
    /// Audit windows that did not.
    pub audits_contradicted: u32,
}

/// Why the MCU started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResetCause {
    /// Power came on, or dipped.
    PowerOn,
    /// The reset pin.
    Pin,
    /// A watchdog.
    Watchdog,
    /// The program asked for it.
    Software,
    /// Something else, or nothing that the chip told.
    Unknown,
}

impl ResetCause {
    pub(crate) const ALL: [Self; 5] =
        [Self::PowerOn, Self::Pin, Self::Watchdog, Self::Software, Self::Unknown];

    pub(crate) const fn code(self) -> u8 {
        match self {
            Self::PowerOn => 1,
            Self::Pin => 2,
            Self::Watchdog => 3,
            Self::Software => 4,
            Self::Unknown => 5,
        }
    }
}

/// Two relay channels: commanded to close, or read back as closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Channels {
    /// Channel A.
    pub a: bool,
    /// Channel B.
    pub b: bool,
}

impl Channels {
    /// Both open: the safe state.
    pub const OPEN: Self = Self { a: false, b: false };
    /// Both closed: permission to run.
    pub const CLOSED: Self = Self { a: true, b: true };

    pub(crate) const fn code(self) -> u8 {
        match (self.a, self.b) {
            (false, false) => 0,
            (true, false) => 1,
            (false, true) => 2,
            (true, true) => 3,
        }
    }

    pub(crate) const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::OPEN),
            1 => Some(Self { a: true, b: false }),
            2 => Some(Self { a: false, b: true }),
            3 => Some(Self::CLOSED),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Codes that differ in at least four bits: no single, double or triple bit error turns one into another.
    fn are_far_apart(codes: &[u8]) {
        for (index, one) in codes.iter().enumerate() {
            for other in &codes[index + 1..] {
                assert!((one ^ other).count_ones() >= 4, "{one:#x} {other:#x}");
            }
        }
    }

    #[test]
    fn state_and_fault_codes_are_far_apart() {
        are_far_apart(&StateCode::ALL.map(StateCode::code));
        are_far_apart(&FaultCode::ALL.map(FaultCode::code));
        assert!(FaultCode::ALL.iter().all(|fault| fault.code().count_ones() >= 4), "far from no fault");
    }

    #[test]
    fn every_name_is_told_once() {
        let states: std::collections::BTreeSet<_> = StateCode::ALL.map(StateCode::name).into();
        let faults: std::collections::BTreeSet<_> = FaultCode::ALL.map(FaultCode::name).into();
        let warnings: std::collections::BTreeSet<_> = Warnings::NAMED.map(|(_, name, _)| name).into();
        assert_eq!((states.len(), faults.len(), warnings.len()), (6, 5, 8));
    }

    #[test]
    fn warnings_have_a_bit_each_and_add_up() {
        let mut all = Warnings::NONE;
        for (index, (warning, _, words)) in Warnings::NAMED.into_iter().enumerate() {
            assert_eq!(warning.bits(), 1 << index);
            assert!(!all.has_any(warning) && !words.is_empty());
            all = all.with_if(warning, false);
            assert!(!all.has_any(warning));
            all = all.with_if(warning, true);
            assert!(all.has_any(warning));
        }
        assert_eq!(Warnings::from_bits(all.bits()), all);
        assert_eq!(all.bits(), 0xFF);
    }

    #[test]
    fn fault_codes_and_laser_modes_lead_back() {
        for fault in FaultCode::ALL {
            assert_eq!(FaultCode::from_code(fault.code()), Some(fault));
        }
        assert_eq!(FaultCode::from_code(0), None);
        for mode in [LaserMode::Off, LaserMode::Dark, LaserMode::Coded] {
            assert_eq!(LaserMode::from_code(mode.code()), Some(mode));
        }
        assert_eq!(LaserMode::from_code(3), None);
    }

    /// A set: what is in it twice is in it.
    #[test]
    fn a_warning_that_is_added_twice_is_there() {
        let once = Warnings::from_bits(0).with_if(Warnings::from_bits(4), true);
        assert_eq!(once.with_if(Warnings::from_bits(4), true), once);
        assert_eq!(once.with_if(Warnings::from_bits(8), false), once);
    }
}
