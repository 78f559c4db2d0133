//! What the black box keeps of every exchange with the host, and what it keeps of a stop.

use crate::causes::StopCauses;
use crate::monitor::StripeReport;
use crate::status::StateCode;
use crate::units::{CalibrationId, Micros, Millimetres, SequenceNumber};
use crate::wire::{Reader, Writer};

/// Bytes of a summary.
pub const SUMMARY_LENGTH: usize = 64;
/// Bytes of a stop's index.
pub const STOP_INDEX_LENGTH: usize = 40;

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExchangeKind {
    /// A line-scan was accepted.
    Accepted,
    /// A line-scan was accepted after a silence: the votes started anew with it.
    AcceptedAfterSilence,
    /// A message was refused.
    Refused,
    /// An exchange without a line-scan.
    Poll,
    /// No exchange: a tick of the safety task, recorded because it changed the state or its causes.
    Tick,
}

impl ExchangeKind {
    /// All kinds.
    pub const ALL: [Self; 5] =
        [Self::Accepted, Self::AcceptedAfterSilence, Self::Refused, Self::Poll, Self::Tick];

    /// Was a line-scan accepted?
    #[must_use]
    pub const fn is_accepted(self) -> bool {
        match self {
            Self::Accepted | Self::AcceptedAfterSilence => true,
            Self::Refused | Self::Poll | Self::Tick => false,
        }
    }

    const fn code(self) -> u8 {
        match self {
            Self::Accepted => 1,
            Self::AcceptedAfterSilence => 2,
            Self::Refused => 3,
            Self::Poll => 4,
            Self::Tick => 5,
        }
    }

    /// The name that programs read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::AcceptedAfterSilence => "accepted_after_silence",
            Self::Refused => "refused",
            Self::Poll => "poll",
            Self::Tick => "tick",
        }
    }
}

/// One exchange in short. On the wire, little-endian, [`SUMMARY_LENGTH`] bytes; zeros = none:
///
/// | offset | field |
/// |---|---|
/// | 0 | MCU time, microseconds u64 |
/// | 8 | sequence number of the last accepted line-scan u32 |
/// | 12 | live causes u32 |
/// | 16 | causes that came up with it u32 |
/// | 20 | state u8, kind u8, laser level u8, zero u8 |
/// | 24 | longest gap of the vote, micrometres i32 (-1 = whole) |
/// | 28 | longest gap of this frame alone, micrometres i32 (-1 = whole) |
/// | 32 | start of the gap that the status tells, micrometres i32 |
/// | 36 | highest point, micrometres i32 (`i32::MIN` = nothing raised) |
/// | 40 | lowest point, micrometres i32 (`i32::MAX` = nothing below the floor) |
/// | 44 | longest stretch without stripe, micrometres i32 |
/// | 48 | the host's word on the picture's age u32, age at the decision u32: microseconds |
/// | 56 | liveness score u16, audit score u16 |
/// | 60 | columns that show lit floor u16, columns that watch the stripe u16 |
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// The MCU's clock.
    pub time: Micros,
    /// The last accepted line-scan.
    pub sequence: SequenceNumber,
    /// Causes that hold after the exchange.
    pub live_causes: StopCauses,
    /// Causes that came up with it: they did not hold after the summary before.
    pub new_causes: StopCauses,
    /// The supervisor's state.
    pub state: StateCode,
    /// What happened.
    pub kind: ExchangeKind,
    /// Brightness that the laser is driven with.
    pub laser_level: u8,
    /// Tier 1: longest gap of the vote.
    pub voted_gap: Option<Millimetres>,
    /// Tier 1: longest gap of this frame alone.
    pub single_gap: Option<Millimetres>,
    /// Where the longer one that counts begins.
    pub gap_start: Millimetres,
    /// Tier 2: highest point.
    pub highest: Option<Millimetres>,
    /// Tier 2: lowest point.
    pub lowest: Option<Millimetres>,
    /// Tier 2: longest stretch without stripe.
    pub longest_unknown: Millimetres,
    /// The host's word on the picture's age.
    pub capture_age: Micros,
    /// From exposure to decision, as the MCU bounds it.
    pub decision_age: Micros,
    /// The sequential test's score of the laser's code, in its own unit.
    pub liveness_score: u16,
    /// The audit's score, in its own unit.
    pub audit_score: u16,
    /// Columns that show lit floor in this frame.
    pub floor_columns: u16,
    /// Columns that watch the stripe.
    pub watched_columns: u16,
}

const WHOLE: i32 = -1;
const NOTHING_RAISED: i32 = i32::MIN;
const NOTHING_BELOW: i32 = i32::MAX;

impl Summary {
    /// Nothing measured.
    #[must_use]
    pub const fn new(time: Micros, state: StateCode, kind: ExchangeKind) -> Self {
        Self {
            time,
            sequence: SequenceNumber::new(0),
            live_causes: StopCauses::NONE,
            new_causes: StopCauses::NONE,
            state,
            kind,
            laser_level: 0,
            voted_gap: None,
            single_gap: None,
            gap_start: Millimetres::ZERO,
            highest: None,
            lowest: None,
            longest_unknown: Millimetres::ZERO,
            capture_age: Micros::ZERO,
            decision_age: Micros::ZERO,
            liveness_score: 0,
            audit_score: 0,
            floor_columns: 0,
            watched_columns: 0,
        }
    }

    /// With what the monitor found.
    #[must_use]
    pub fn with_report(self, report: &StripeReport) -> Self {
        Self {
            voted_gap: report.cutoff.voted.map(|gap| gap.length()),
            single_gap: report.cutoff.single.map(|gap| gap.length()),
            gap_start: report.longest_gap().map_or(Millimetres::ZERO, |gap| gap.start),
            highest: report.heights.highest.map(|highest| highest.height),
            lowest: report.heights.lowest.map(|lowest| lowest.height),
            longest_unknown: report.heights.longest_unknown,
            floor_columns: report.cutoff.floor_columns,
            watched_columns: report.watched_columns,
            ..self
        }
    }

    /// The bytes to keep.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; SUMMARY_LENGTH] {
        let mut bytes = [0; SUMMARY_LENGTH];
        let mut writer = Writer::new(&mut bytes);
        writer.u64(self.time.get());
        writer.u32(self.sequence.get());
        writer.u32(self.live_causes.bits());
        writer.u32(self.new_causes.bits());
        writer.u8(self.state.code());
        writer.u8(self.kind.code());
        writer.u8(self.laser_level);
        writer.u8(0);
        writer.i32(self.voted_gap.map_or(WHOLE, Millimetres::to_micrometres));
        writer.i32(self.single_gap.map_or(WHOLE, Millimetres::to_micrometres));
        writer.i32(self.gap_start.to_micrometres());
        writer.i32(self.highest.map_or(NOTHING_RAISED, Millimetres::to_micrometres));
        writer.i32(self.lowest.map_or(NOTHING_BELOW, Millimetres::to_micrometres));
        writer.i32(self.longest_unknown.to_micrometres());
        writer.u32(self.capture_age.to_wire());
        writer.u32(self.decision_age.to_wire());
        writer.u16(self.liveness_score);
        writer.u16(self.audit_score);
        writer.u16(self.floor_columns);
        writer.u16(self.watched_columns);
        bytes
    }

    /// Reads what was kept; `None` for zeros or a value that no summary has.
    #[must_use]
    pub fn parse(bytes: &[u8; SUMMARY_LENGTH]) -> Option<Self> {
        let mut reader = Reader::new(bytes);
        let time = Micros::new(reader.u64()?);
        let sequence = SequenceNumber::new(reader.u32()?);
        let live_causes = StopCauses::from_bits(reader.u32()?);
        let new_causes = StopCauses::from_bits(reader.u32()?);
        let (state_code, kind_code) = (reader.u8()?, reader.u8()?);
        let state = StateCode::ALL.into_iter().find(|state| state.code() == state_code)?;
        let kind = ExchangeKind::ALL.into_iter().find(|kind| kind.code() == kind_code)?;
        let (laser_level, zero) = (reader.u8()?, reader.u8()?);
        if zero != 0 {
            return None;
        }
        let length = |micrometres: i32, none: i32| {
            (micrometres != none).then(|| Millimetres::from_micrometres(micrometres))
        };
        let voted_gap = length(reader.i32()?, WHOLE);
        let single_gap = length(reader.i32()?, WHOLE);
        let gap_start = Millimetres::from_micrometres(reader.i32()?);
        let highest = length(reader.i32()?, NOTHING_RAISED);
        let lowest = length(reader.i32()?, NOTHING_BELOW);
        let longest_unknown = Millimetres::from_micrometres(reader.i32()?);
        let capture_age = Micros::new(u64::from(reader.u32()?));
        let decision_age = Micros::new(u64::from(reader.u32()?));
        let (liveness_score, audit_score) = (reader.u16()?, reader.u16()?);
        let (floor_columns, watched_columns) = (reader.u16()?, reader.u16()?);
        Some(Self {
            time,
            sequence,
            live_causes,
            new_causes,
            state,
            kind,
            laser_level,
            voted_gap,
            single_gap,
            gap_start,
            highest,
            lowest,
            longest_unknown,
            capture_age,
            decision_age,
            liveness_score,
            audit_score,
            floor_columns,
            watched_columns,
        })
    }
}

/// What the black box says about the stop that it keeps. On the wire, little-endian, [`STOP_INDEX_LENGTH`] bytes:
///
/// | offset | field |
/// |---|---|
/// | 0 | number of the stop since the MCU's start u32, from 1 |
/// | 4 | MCU time of the stop, microseconds u64 |
/// | 12 | causes u32 |
/// | 16 | firmware id u32, calibration id u32 (0 = none) |
/// | 24 | summaries u16, of these up to the stop u16 |
/// | 28 | line-scans u16, of these up to the stop u16 |
/// | 32 | everything has been recorded u8 (1; 0 = the time after the stop is still being recorded), zeros |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StopIndex {
    /// Number of the stop since the MCU's start, from 1.
    pub stop: u32,
    /// When, by the MCU's clock.
    pub time: Micros,
    /// Why.
    pub causes: StopCauses,
    /// The firmware's build.
    pub firmware: u32,
    /// The rig in use.
    pub calibration: Option<CalibrationId>,
    /// Summaries that are kept.
    pub summaries: u16,
    /// Of these, up to the stop (the deciding one included).
    pub summaries_before: u16,
    /// Line-scans that are kept.
    pub scans: u16,
    /// Of these, up to the stop (the deciding one included).
    pub scans_before: u16,
    /// Has the time after the stop been recorded whole?
    pub complete: bool,
}

impl StopIndex {
    /// The bytes to send.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; STOP_INDEX_LENGTH] {
        let mut bytes = [0; STOP_INDEX_LENGTH];
        let mut writer = Writer::new(&mut bytes);
        writer.u32(self.stop);
        writer.u64(self.time.get());
        writer.u32(self.causes.bits());
        writer.u32(self.firmware);
        writer.u32(self.calibration.map_or(0, CalibrationId::get));
        writer.u16(self.summaries);
        writer.u16(self.summaries_before);
        writer.u16(self.scans);
        writer.u16(self.scans_before);
        writer.u8(u8::from(self.complete));
        bytes
    }

    /// Reads an index; `None` for anything that is none.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let bytes = <&[u8; STOP_INDEX_LENGTH]>::try_from(bytes).ok()?;
        let mut reader = Reader::new(bytes);
        let (stop, time) = (reader.u32()?, Micros::new(reader.u64()?));
        let (causes, firmware) = (StopCauses::from_bits(reader.u32()?), reader.u32()?);
        let calibration = match reader.u32()? {
            0 => None,
            id => Some(CalibrationId::new(id)),
        };
        let (summaries, summaries_before) = (reader.u16()?, reader.u16()?);
        let (scans, scans_before) = (reader.u16()?, reader.u16()?);
        let complete = match reader.u8()? {
            0 => false,
            1 => true,
            _ => return None,
        };
        let zeros = reader.slice(7)?.iter().all(|byte| *byte == 0);
        let counts_fit = usize::from(summaries) <= super::SUMMARY_COUNT
            && summaries_before <= summaries
            && scans_before <= scans;
        (stop != 0 && zeros && counts_fit).then_some(Self {
            stop,
            time,
            causes,
            firmware,
            calibration,
            summaries,
            summaries_before,
            scans,
            scans_before,
            complete,
        })
    }
}
