//! The status: what the MCU answers to the host in every SPI transaction.
//!
//! Little-endian, always [`STATUS_LENGTH`] bytes at the beginning of the transaction:
//!
//! | offset | field |
//! |---|---|
//! | 0 | magic `NFST` |
//! | 4 | version u16 (3) |
//! | 6 | source id u16 |
//! | 8 | calibration id u32 (0 = none stored) |
//! | 12 | firmware id u32 |
//! | 16 | number of this status u32 |
//! | 20 | sequence number of the last accepted line-scan u32 |
//! | 24 | MCU time, microseconds u64 |
//! | 32 | state u8, relay command u8, relay read-back u8, reset cause u8 |
//! | 36 | live causes u32, latched causes u32 |
//! | 44 | longest gap, its start, its end: micrometres i32 each (length -1 = whole) |
//! | 56 | highest point, its place: micrometres i32 each (`i32::MIN` = nothing raised) |
//! | 64 | lowest point: micrometres i32 (`i32::MAX` = nothing below the floor) |
//! | 68 | longest stretch without stripe: micrometres i32 |
//! | 72 | size class u8 (0 none, 1 small, 2 large, 3 unknown), laser mode u8, warnings u16 |
//! | 76 | decision age u32, longest decision age u32, response bound u32: microseconds |
//! | 88 | line-scans accepted u32 |
//! | 92 | line-scans refused u32, by the eight link causes in the order of their bits (timeout first) |
//! | 124 | challenge: count u16, 8 columns u16 |
//! | 142 | fault u8 (0 none), failed self-test u8 (0 none) |
//! | 144 | light age u32, longest light age u32: microseconds (0 = not measured yet) |
//! | 152 | liveness doubt u16, audit doubt u16 |
//! | 156 | audit windows confirmed u32, contradicted u32 |
//! | 164 | floor's offset and its rise from end to end: micrometres i32 each |
//! | 172 | lowest object that is surely seen, where it is worst: micrometres i32 each |
//! | 180 | permitted speed u8, per cent; zero u8, zero u16 |
//! | 184 | run-over permit: its first and last place micrometres i32 each, time left microseconds u32 (0 = no permit in use) |
//! | 196 | CRC-32 (see [`crate::wire`]) of all before |
//!
//! The laser's level is not told: it is the secret that the light must echo.

use crate::causes::StopCauses;
pub use crate::condition::{
    Channels, FaultCode, HealthFigures, LaserMode, ResetCause, StateCode, TrustFigures, Warnings,
};
use crate::cutoff::Gap;
use crate::height::{Extreme, SizeClass};
use crate::linescan::LARGEST_AUDIT_COUNT;
use crate::units::{CalibrationId, Micros, Millimetres, SequenceNumber, SourceId};
use crate::wire::{self, Reader, Writer};

/// `NFST`, little-endian.
pub const STATUS_MAGIC: u32 = 0x5453_464E;
/// Version of the format.
pub const STATUS_VERSION: u16 = 3;
/// Length of every status in bytes.
pub const STATUS_LENGTH: usize = 200;
/// Kinds of refused line-scans that are counted apart.
pub const REFUSAL_KINDS: usize = 8;

/// The columns whose raw pixels the next line-scan must carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Challenge {
    /// How many of `columns` are asked for.
    pub count: u16,
    /// Columns of the line-scan.
    pub columns: [u16; LARGEST_AUDIT_COUNT],
}

/// A run-over permit in use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PermitInUse {
    /// What has passed under it in the last frame, from end to end.
    pub stretch: Gap,
    /// Time until it ends.
    pub time_left: Micros,
}

/// Everything that the MCU tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Status {
    /// The module that sends.
    pub source: SourceId,
    /// The rig in use; `None` if none is stored or it was refused.
    pub calibration: Option<CalibrationId>,
    /// Names the firmware's build.
    pub firmware: u32,
    /// Counts the statuses.
    pub number: u32,
    /// The last accepted line-scan.
    pub echoed_sequence: SequenceNumber,
    /// The MCU's clock.
    pub now: Micros,
    /// The supervisor's state.
    pub state: StateCode,
    /// What the relay channels are told.
    pub relay_command: Channels,
    /// What their feedback contacts say: true = the channel's contacts are closed.
    pub relay_readback: Channels,
    /// Why the MCU started.
    pub reset_cause: ResetCause,
    /// Causes that hold now.
    pub live_causes: StopCauses,
    /// Causes that held since the last reset.
    pub latched_causes: StopCauses,
    /// Tier 1.
    pub longest_gap: Option<Gap>,
    /// Tier 2, highest point.
    pub highest: Option<Extreme>,
    /// Tier 2, lowest point's height.
    pub lowest: Option<Millimetres>,
    /// Tier 2, longest stretch without stripe.
    pub longest_unknown: Millimetres,
    /// Tier 2, class of what is on the stripe.
    pub size: Option<SizeClass>,
    /// How the laser is driven.
    pub laser_mode: LaserMode,
    /// What the MCU warns of.
    pub warnings: Warnings,
    /// From the picture's exposure to the decision, for the last accepted line-scan.
    pub decision_age: Micros,
    /// The longest such time since start.
    pub longest_decision_age: Micros,
    /// The bound that such a time must keep (else [`crate::causes::StopCause::LinkDelay`]).
    pub response_bound: Micros,
    /// Line-scans accepted since start.
    pub accepted: u32,
    /// Line-scans refused (and time-outs) since start, by kind.
    pub refused: [u32; REFUSAL_KINDS],
    /// The audit's next columns.
    pub challenge: Challenge,
    /// Why it is locked out.
    pub fault: Option<FaultCode>,
    /// The self-test that failed, as its code; 0 = none.
    pub failed_self_test: u8,
    /// How sure it is of the host.
    pub trust: TrustFigures,
    /// The sensor's health.
    pub health: HealthFigures,
    /// The run-over permit in use, if any.
    pub run_over: Option<PermitInUse>,
}

/// Why a status was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StatusError {
    /// Fewer than [`STATUS_LENGTH`] bytes.
    Length,
    /// The CRC does not match.
    Corrupted,
    /// Another kind of message.
    Magic,
    /// Another version.
    Version,
    /// A field has a value that the format does not allow.
    Field,
}

impl core::fmt::Display for StatusError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Length => "status too short",
            Self::Corrupted => "status damaged (CRC)",
            Self::Magic => "not a status",
            Self::Version => "status of another version",
            Self::Field => "status with an impossible field",
        })
    }
}

impl core::error::Error for StatusError {}

const NOTHING_RAISED: i32 = i32::MIN;
const NOTHING_BELOW: i32 = i32::MAX;
const WHOLE: i32 = -1;

impl Status {
    /// The bytes to send.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; STATUS_LENGTH] {
        let mut bytes = [0; STATUS_LENGTH];
        let mut writer = Writer::new(&mut bytes);
        writer.u32(STATUS_MAGIC);
        writer.u16(STATUS_VERSION);
        writer.u16(self.source.get());
        writer.u32(self.calibration.map_or(0, CalibrationId::get));
        writer.u32(self.firmware);
        writer.u32(self.number);
        writer.u32(self.echoed_sequence.get());
        writer.u64(self.now.get());
        writer.u8(self.state.code());
        writer.u8(self.relay_command.code());
        writer.u8(self.relay_readback.code());
        writer.u8(self.reset_cause.code());
        writer.u32(self.live_causes.bits());
        writer.u32(self.latched_causes.bits());
        self.write_findings(&mut writer);
        writer.u32(self.decision_age.to_wire());
        writer.u32(self.longest_decision_age.to_wire());
        writer.u32(self.response_bound.to_wire());
        writer.u32(self.accepted);
        for count in self.refused {
            writer.u32(count);
        }
        writer.u16(self.challenge.count);
        for column in self.challenge.columns {
            writer.u16(column);
        }
        self.write_trust_and_health(&mut writer);
        let permit = self.run_over;
        writer.i32(permit.map_or(0, |permit| permit.stretch.start.to_micrometres()));
        writer.i32(permit.map_or(0, |permit| permit.stretch.end.to_micrometres()));
        writer.u32(permit.map_or(0, |permit| permit.time_left.to_wire()));
        wire::seal(&mut bytes);
        bytes
    }

    fn write_findings(&self, writer: &mut Writer<'_>) {
        match self.longest_gap {
            Some(gap) => {
                writer.i32(gap.length().to_micrometres());
                writer.i32(gap.start.to_micrometres());
                writer.i32(gap.end.to_micrometres());
            }
            None => {
                writer.i32(WHOLE);
                writer.i32(0);
                writer.i32(0);
            }
        }
        writer.i32(self.highest.map_or(NOTHING_RAISED, |highest| highest.height.to_micrometres()));
        writer.i32(self.highest.map_or(0, |highest| highest.place.to_micrometres()));
        writer.i32(self.lowest.map_or(NOTHING_BELOW, Millimetres::to_micrometres));
        writer.i32(self.longest_unknown.to_micrometres());
        writer.u8(match self.size {
            None => 0,
            Some(SizeClass::Small) => 1,
            Some(SizeClass::Large) => 2,
            Some(SizeClass::Unknown) => 3,
        });
        writer.u8(self.laser_mode.code());
        writer.u16(self.warnings.bits());
    }

    fn write_trust_and_health(&self, writer: &mut Writer<'_>) {
        writer.u8(self.fault.map_or(0, FaultCode::code));
        writer.u8(self.failed_self_test);
        writer.u32(self.trust.light_age.to_wire());
        writer.u32(self.trust.longest_light_age.to_wire());
        writer.u16(self.trust.liveness_doubt);
        writer.u16(self.trust.audit_doubt);
        writer.u32(self.trust.audits_confirmed);
        writer.u32(self.trust.audits_contradicted);
        writer.i32(self.health.floor_offset.to_micrometres());
        writer.i32(self.health.floor_rise.to_micrometres());
        writer.i32(self.health.smallest_object.to_micrometres());
        writer.i32(self.health.smallest_object_place.to_micrometres());
        writer.u8(self.health.permitted_speed_percent);
        writer.skip(3);
    }

    /// Reads a status from the beginning of what a transaction brought.
    ///
    /// # Errors
    /// The first rule that is broken, in the order length, CRC, magic, version, fields.
    pub fn parse(bytes: &[u8]) -> Result<Self, StatusError> {
        let bytes = bytes.get(..STATUS_LENGTH).ok_or(StatusError::Length)?;
        if !wire::is_sealed(bytes) {
            return Err(StatusError::Corrupted);
        }
        let mut reader = Reader::new(bytes);
        if reader.u32() != Some(STATUS_MAGIC) {
            return Err(StatusError::Magic);
        }
        if reader.u16() != Some(STATUS_VERSION) {
            return Err(StatusError::Version);
        }
        Self::parse_fields(&mut reader).ok_or(StatusError::Field)
    }

    fn parse_fields(reader: &mut Reader<'_>) -> Option<Self> {
        let source = SourceId::new(reader.u16()?);
        let calibration = match reader.u32()? {
            0 => None,
            id => Some(CalibrationId::new(id)),
        };
        let (firmware, number) = (reader.u32()?, reader.u32()?);
        let echoed_sequence = SequenceNumber::new(reader.u32()?);
        let now = Micros::new(reader.u64()?);
        let state_code = reader.u8()?;
        let state = StateCode::ALL.into_iter().find(|state| state.code() == state_code)?;
        let relay_command = Channels::from_code(reader.u8()?)?;
        let relay_readback = Channels::from_code(reader.u8()?)?;
        let reset_code = reader.u8()?;
        let reset_cause = ResetCause::ALL.into_iter().find(|cause| cause.code() == reset_code)?;
        let live_causes = StopCauses::from_bits(reader.u32()?);
        let latched_causes = StopCauses::from_bits(reader.u32()?);
        let (gap_length, gap_start, gap_end) = (reader.i32()?, reader.i32()?, reader.i32()?);
        let longest_gap = (gap_length != WHOLE).then(|| Gap {
            start: Millimetres::from_micrometres(gap_start),
            end: Millimetres::from_micrometres(gap_end),
        });
        let (high, high_place) = (reader.i32()?, reader.i32()?);
        let highest = (high != NOTHING_RAISED).then(|| Extreme {
            height: Millimetres::from_micrometres(high),
            place: Millimetres::from_micrometres(high_place),
        });
        let low = reader.i32()?;
        let lowest = (low != NOTHING_BELOW).then(|| Millimetres::from_micrometres(low));
        let longest_unknown = Millimetres::from_micrometres(reader.i32()?);
        let size = match reader.u8()? {
            0 => None,
            1 => Some(SizeClass::Small),
            2 => Some(SizeClass::Large),
            3 => Some(SizeClass::Unknown),
            _ => return None,
        };
        let laser_mode = LaserMode::from_code(reader.u8()?)?;
        let warnings = Warnings::from_bits(reader.u16()?);
        let mut time = || reader.u32().map(|micros| Micros::new(u64::from(micros)));
        let (decision_age, longest_decision_age, response_bound) = (time()?, time()?, time()?);
        let accepted = reader.u32()?;
        let mut refused = [0; REFUSAL_KINDS];
        for count in &mut refused {
            *count = reader.u32()?;
        }
        let mut challenge = Challenge { count: reader.u16()?, ..Challenge::default() };
        for column in &mut challenge.columns {
            *column = reader.u16()?;
        }
        if usize::from(challenge.count) > LARGEST_AUDIT_COUNT {
            return None;
        }
        let fault = match reader.u8()? {
            0 => None,
            code => Some(FaultCode::from_code(code)?),
        };
        let failed_self_test = reader.u8()?;
        let (trust, health) = parse_trust_and_health(reader)?;
        let run_over = parse_permit(reader)?;
        Some(Self {
            source,
            calibration,
            firmware,
            number,
            echoed_sequence,
            now,
            state,
            relay_command,
            relay_readback,
            reset_cause,
            live_causes,
            latched_causes,
            longest_gap,
            highest,
            lowest,
            longest_unknown,
            size,
            laser_mode,
            warnings,
            decision_age,
            longest_decision_age,
            response_bound,
            accepted,
            refused,
            challenge,
            fault,
            failed_self_test,
            trust,
            health,
            run_over,
        })
    }
}

fn parse_permit(reader: &mut Reader<'_>) -> Option<Option<PermitInUse>> {
    let mut place = || reader.i32().map(Millimetres::from_micrometres);
    let (start, end) = (place()?, place()?);
    let time_left = Micros::new(u64::from(reader.u32()?));
    let permit = PermitInUse { stretch: Gap { start, end }, time_left };
    match (time_left == Micros::ZERO, start == Millimetres::ZERO && end == Millimetres::ZERO) {
        (true, true) => Some(None),
        (true, false) => None,
        (false, _) => (start <= end).then_some(Some(permit)),
    }
}

fn parse_trust_and_health(reader: &mut Reader<'_>) -> Option<(TrustFigures, HealthFigures)> {
    let mut time = || reader.u32().map(|micros| Micros::new(u64::from(micros)));
    let (light_age, longest_light_age) = (time()?, time()?);
    let trust = TrustFigures {
        light_age,
        longest_light_age,
        liveness_doubt: reader.u16()?,
        audit_doubt: reader.u16()?,
        audits_confirmed: reader.u32()?,
        audits_contradicted: reader.u32()?,
    };
    let mut length = || reader.i32().map(Millimetres::from_micrometres);
    let health = HealthFigures {
        floor_offset: length()?,
        floor_rise: length()?,
        smallest_object: length()?,
        smallest_object_place: length()?,
        permitted_speed_percent: reader.u8()?,
    };
    let zeros = [reader.u8()?, reader.u8()?, reader.u8()?];
    (zeros == [0; 3]).then_some((trust, health))
}

#[cfg(test)]
mod tests;
