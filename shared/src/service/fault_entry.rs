//! One line of the fault log, in RAM, in flash and on the wire alike.

use crate::causes::StopCauses;
use crate::status::{ResetCause, StateCode};
use crate::units::Micros;
use crate::wire::{Reader, Writer};

/// Bytes of an entry.
pub const FAULT_ENTRY_LENGTH: usize = 32;

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultEvent {
    /// The MCU started; the reset cause says why.
    Started,
    /// The relays were opened while running.
    Stopped,
    /// The controller locked itself out.
    LockedOut,
    /// A rig was put in force by service (for the next start).
    RigChanged,
}

impl FaultEvent {
    /// All events.
    pub const ALL: [Self; 4] = [Self::Started, Self::Stopped, Self::LockedOut, Self::RigChanged];

    const fn code(self) -> u8 {
        match self {
            Self::Started => 1,
            Self::Stopped => 2,
            Self::LockedOut => 3,
            Self::RigChanged => 4,
        }
    }

    /// The name that programs read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Started => "started",
            Self::Stopped => "stopped",
            Self::LockedOut => "locked_out",
            Self::RigChanged => "rig_changed",
        }
    }
}

/// Counts the MCU's starts, across resets and power cycles; the clock of an entry begins at its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct PowerCycle(u32);

impl PowerCycle {
    /// From the wire.
    #[must_use]
    pub const fn new(number: u32) -> Self {
        Self(number)
    }

    /// For the wire.
    #[must_use]
    pub const fn get(self) -> u32 {
        self.0
    }

    /// The one after; stays at the last number there is.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0.saturating_add(1))
    }
}

/// One entry. On the wire, little-endian, [`FAULT_ENTRY_LENGTH`] bytes:
///
/// | offset | field |
/// |---|---|
/// | 0 | number of the entry u32, from 1, never used again |
/// | 4 | number of the MCU's start u32 |
/// | 8 | MCU time since that start, microseconds u64 |
/// | 16 | number of the status that told it first u32 |
/// | 20 | causes u32 |
/// | 24 | event u8, state u8, reset cause u8, fault u8 |
/// | 28 | detail u32 |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultEntry {
    /// Number of the entry, from 1.
    pub number: u32,
    /// The MCU's start.
    pub power_cycle: PowerCycle,
    /// Time since that start.
    pub time: Micros,
    /// The status that told it first.
    pub status: u32,
    /// Why.
    pub causes: StopCauses,
    /// What happened.
    pub event: FaultEvent,
    /// The state that it led to.
    pub state: StateCode,
    /// Why the MCU had started.
    pub reset_cause: ResetCause,
    /// The fault that locks out, by its code; 0 = none.
    pub fault: u8,
    /// More about it: the new calibration id for [`FaultEvent::RigChanged`], the fault's own number, or 0.
    pub detail: u32,
}

impl FaultEntry {
    /// The bytes to keep.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; FAULT_ENTRY_LENGTH] {
        let mut bytes = [0; FAULT_ENTRY_LENGTH];
        let mut writer = Writer::new(&mut bytes);
        writer.u32(self.number);
        writer.u32(self.power_cycle.get());
        writer.u64(self.time.get());
        writer.u32(self.status);
        writer.u32(self.causes.bits());
        writer.u8(self.event.code());
        writer.u8(self.state.code());
        writer.u8(self.reset_cause.code());
        writer.u8(self.fault);
        writer.u32(self.detail);
        bytes
    }

    /// Reads an entry; `None` for anything that is none.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let bytes = <&[u8; FAULT_ENTRY_LENGTH]>::try_from(bytes).ok()?;
        let mut reader = Reader::new(bytes);
        let number = reader.u32().filter(|number| *number != 0)?;
        let power_cycle = PowerCycle::new(reader.u32()?);
        let (time, status) = (Micros::new(reader.u64()?), reader.u32()?);
        let causes = StopCauses::from_bits(reader.u32()?);
        let (event_code, state_code) = (reader.u8()?, reader.u8()?);
        let (reset_code, fault) = (reader.u8()?, reader.u8()?);
        let event = FaultEvent::ALL.into_iter().find(|event| event.code() == event_code)?;
        let state = StateCode::ALL.into_iter().find(|state| state.code() == state_code)?;
        let reset_cause = ResetCause::ALL.into_iter().find(|cause| cause.code() == reset_code)?;
        let detail = reader.u32()?;
        Some(Self { number, power_cycle, time, status, causes, event, state, reset_cause, fault, detail })
    }
}
