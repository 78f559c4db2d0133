//! Which messages from the host are believed. The host and all between it and this controller is a black channel:
//! every way in which a message can go wrong is met by a measure of its own and counted apart.
//!
//! | error | measure | refusal |
//! |---|---|---|
//! | loss | time since the last accepted line-scan ([`LINK_TIMEOUT`]); sequence numbers | `Timeout`, `Sequence` |
//! | corruption | CRC-32 of Hamming distance 6 over the whole message | `Corruption` |
//! | insertion | fixed length, magic, version, every field's range, the rig's column count | `Format` |
//! | masquerade, addressing | source id | `Source` |
//! | configuration mix-up | calibration id | `Calibration` |
//! | unintended repetition | sequence number | `Repetition` |
//! | incorrect sequence | sequence number; at most [`LARGEST_SEQUENCE_STEP`] ahead | `Sequence` |
//! | unacceptable delay | the host's own word on the picture's age; and, on this controller's clock, the age of the status that the message answers | `Delay` |
//!
//! A line-scan names the last status that the host had received. It was therefore put together after that status went
//! out, so "now minus then" bounds its age by a clock that the host cannot touch. A replayed recording fails on it.
//!
//! **A refused message is never used; the second one within [`LINK_ERROR_INTERVAL`] stops, and the stop latches.** A
//! single one is discarded like a lost one: what was proven before ages, and stops at [`LINK_TIMEOUT`]. A later good
//! message does not excuse the second: a link that lets two wrong messages through in a minute is not understood, and
//! somebody must acknowledge that with the reset button.
//!
//! ```text
//!              first good line-scan            HEALTHY_STREAK good ones in a row
//!  Unhealthy ----------------------> Unhealthy ---------------------------------> Healthy
//!      ^                                                                             |
//!      +-----------------------------------------------------------------------------+
//!       a second refusal within LINK_ERROR_INTERVAL, or no good line-scan for LINK_TIMEOUT
//! ```

use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::limits::{
    HEALTHY_STREAK, LARGEST_SEQUENCE_STEP, LINK_ERROR_INTERVAL, LINK_TIMEOUT, LONGEST_CAPTURE_AGE,
    LONGEST_MESSAGE_AGE,
};
use nearfield_shared::linescan::{LineScan, LineScanError};
use nearfield_shared::status::REFUSAL_KINDS;
use nearfield_shared::units::{CalibrationId, Micros, SequenceNumber, SourceId};

/// Why a message is not believed, in the order of the status's counters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// No acceptable line-scan for too long.
    Timeout,
    /// The CRC is wrong.
    Corruption,
    /// Length, magic, version or a field that the format or the rig does not allow.
    Format,
    /// From or for another module.
    Source,
    /// Made with another calibration, or none is stored here.
    Calibration,
    /// The same sequence number again.
    Repetition,
    /// A sequence number that lies behind or too far ahead.
    Sequence,
    /// The picture or the message is too old.
    Delay,
}

impl Refusal {
    /// All kinds, in the order of the status's counters.
    pub const ALL: [Self; REFUSAL_KINDS] = [
        Self::Timeout,
        Self::Corruption,
        Self::Format,
        Self::Source,
        Self::Calibration,
        Self::Repetition,
        Self::Sequence,
        Self::Delay,
    ];

    /// The cause that it is shown as.
    #[must_use]
    pub const fn cause(self) -> StopCause {
        match self {
            Self::Timeout => StopCause::LinkTimeout,
            Self::Corruption => StopCause::LinkCorruption,
            Self::Format => StopCause::LinkFormat,
            Self::Source => StopCause::LinkSource,
            Self::Calibration => StopCause::LinkCalibration,
            Self::Repetition => StopCause::LinkRepetition,
            Self::Sequence => StopCause::LinkSequence,
            Self::Delay => StopCause::LinkDelay,
        }
    }
}

impl From<LineScanError> for Refusal {
    fn from(error: LineScanError) -> Self {
        match error {
            LineScanError::Corrupted => Self::Corruption,
            LineScanError::Length | LineScanError::Magic | LineScanError::Version | LineScanError::Field => {
                Self::Format
            }
        }
    }
}

/// A message of zeros only: the host wants a status and has no line-scan to give (also what a dead line reads as).
#[must_use]
pub fn is_poll(message: &[u8]) -> bool {
    message.iter().all(|byte| *byte == 0)
}

/// Statuses whose time of sending is remembered. More than [`LONGEST_MESSAGE_AGE`] holds of frame periods at 120
/// frames per second.
const REMEMBERED_STATUSES: usize = 8;

/// When the last statuses were sent, newest first.
#[derive(Debug, Clone, Copy)]
struct SendTimes {
    sent: [Option<(u32, Micros)>; REMEMBERED_STATUSES],
}

impl SendTimes {
    const fn new() -> Self {
        Self { sent: [None; REMEMBERED_STATUSES] }
    }

    fn remember(&mut self, number: u32, now: Micros) {
        self.sent.rotate_right(1);
        if let Some(newest) = self.sent.first_mut() {
            *newest = Some((number, now));
        }
    }

    fn age_of(&self, number: u32, now: Micros) -> Option<Micros> {
        self.sent.iter().flatten().find(|(sent, _)| *sent == number).map(|(_, at)| now.since(*at))
    }
}

/// Line-scans that were accepted and refused since start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkCounts {
    /// Accepted.
    pub accepted: u32,
    /// Refused, in the order of [`Refusal::ALL`].
    pub refused: [u32; REFUSAL_KINDS],
}

/// A message that is not believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refused {
    /// Why.
    pub refusal: Refusal,
    /// Is it the first in a long time, and therefore only discarded?
    pub tolerated: bool,
}

/// An accepted line-scan.
#[derive(Debug, Clone, Copy)]
pub struct Accepted<'a> {
    /// The line-scan.
    pub scan: LineScan<'a>,
    /// From the picture's exposure to now, at most: the host's word on the picture plus this controller's bound on
    /// the message.
    pub age: Micros,
    /// The link had been silent for too long before: earlier line-scans no longer count.
    pub after_silence: bool,
}

/// The receiving end of the link; see the module's documentation.
#[derive(Debug, Clone, Copy)]
pub struct Receiver {
    source: SourceId,
    calibration: Option<CalibrationId>,
    columns: usize,
    sent: SendTimes,
    sequence: Option<SequenceNumber>,
    echoed: SequenceNumber,
    last_accepted: Option<Micros>,
    last_refused: Option<Micros>,
    streak: u32,
    faults: StopCauses,
    counts: LinkCounts,
}

impl Receiver {
    /// Believes nothing yet. `calibration` and `columns` describe the rig in use; without one nothing is accepted.
    #[must_use]
    pub const fn new(source: SourceId, calibration: Option<CalibrationId>, columns: usize) -> Self {
        Self {
            source,
            calibration,
            columns,
            sent: SendTimes::new(),
            sequence: None,
            echoed: SequenceNumber::new(0),
            last_accepted: None,
            last_refused: None,
            streak: 0,
            faults: StopCauses::NONE.with(StopCause::LinkTimeout),
            counts: LinkCounts { accepted: 0, refused: [0; REFUSAL_KINDS] },
        }
    }

    /// A status has gone out whole.
    pub fn status_sent(&mut self, number: u32, now: Micros) {
        self.sent.remember(number, now);
    }

    /// Judges a message. Nothing of a refused one may be used.
    ///
    /// # Errors
    /// The first measure that it fails, in the order of the module's table.
    pub fn receive<'a>(&mut self, now: Micros, message: &'a [u8]) -> Result<Accepted<'a>, Refused> {
        self.expire(now);
        match self.check(now, message) {
            Ok((scan, age)) => {
                let after_silence = self.last_accepted.is_none();
                self.accept(now, scan.header().sequence);
                Ok(Accepted { scan, age, after_silence })
            }
            Err(refusal) => Err(Refused { refusal, tolerated: self.refuse(now, refusal) }),
        }
    }

    /// Time passes: has the link been silent for too long?
    pub fn expire(&mut self, now: Micros) {
        if self.last_accepted.is_some_and(|at| now.since(at) > LINK_TIMEOUT) {
            self.last_accepted = None;
            self.hold(Refusal::Timeout);
        }
    }

    /// What the link holds against itself; none = healthy.
    #[must_use]
    pub const fn faults(&self) -> StopCauses {
        self.faults
    }

    /// What was accepted and refused so far.
    #[must_use]
    pub const fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// What it rests on, for the check of the controller's memory.
    pub(crate) fn words(&self) -> impl Iterator<Item = u64> + '_ {
        let time = |at: Option<Micros>| at.map_or(u64::MAX, Micros::get);
        let sent = self.sent.sent.iter().flatten().flat_map(|(number, at)| [u64::from(*number), at.get()]);
        let identity =
            u64::from(self.source.get()) << 32 | u64::from(self.calibration.map_or(0, CalibrationId::get));
        let sequence = self.sequence.map_or(u64::MAX, |number| u64::from(number.get()));
        let trust = u64::from(self.streak) << 32 | u64::from(self.faults.bits());
        let columns = u64::try_from(self.columns).unwrap_or(u64::MAX);
        [identity, columns, sequence, trust, time(self.last_accepted), time(self.last_refused)]
            .into_iter()
            .chain(sent)
    }

    /// The last accepted line-scan's number.
    #[must_use]
    pub const fn echoed_sequence(&self) -> SequenceNumber {
        self.echoed
    }

    fn check<'a>(&mut self, now: Micros, message: &'a [u8]) -> Result<(LineScan<'a>, Micros), Refusal> {
        let scan = LineScan::parse(message)?;
        let header = scan.header();
        if header.source != self.source {
            return Err(Refusal::Source);
        }
        if Some(header.calibration) != self.calibration {
            return Err(Refusal::Calibration);
        }
        if scan.column_count() != self.columns {
            return Err(Refusal::Format);
        }
        self.check_sequence(header.sequence)?;
        let message_age = self.sent.age_of(header.last_status, now).ok_or(Refusal::Delay)?;
        if message_age > LONGEST_MESSAGE_AGE || header.capture_age > LONGEST_CAPTURE_AGE {
            return Err(Refusal::Delay);
        }
        Ok((scan, header.capture_age.plus(message_age)))
    }

    /// A number that is out of order is refused, but the next ones are measured from it: a restarted host finds back
    /// (to a stop that has latched, and a streak that begins anew).
    fn check_sequence(&mut self, number: SequenceNumber) -> Result<(), Refusal> {
        let before = self.sequence.replace(number);
        match before.map(|before| number.steps_after(before)) {
            Some(0) => Err(Refusal::Repetition),
            Some(steps) if steps > LARGEST_SEQUENCE_STEP => Err(Refusal::Sequence),
            Some(_) | None => Ok(()),
        }
    }

    fn accept(&mut self, now: Micros, sequence: SequenceNumber) {
        self.echoed = sequence;
        self.last_accepted = Some(now);
        self.counts.accepted = self.counts.accepted.saturating_add(1);
        self.streak = self.streak.saturating_add(1);
        if self.streak >= HEALTHY_STREAK {
            self.faults = StopCauses::NONE;
        }
    }

    /// Counts a refused message; `true` if it is the first one in a long time.
    fn refuse(&mut self, now: Micros, refusal: Refusal) -> bool {
        let tolerated = !self.has_refused_lately(now);
        self.last_refused = Some(now);
        if tolerated {
            self.count(refusal);
        } else {
            self.hold(refusal);
        }
        tolerated
    }

    /// Was a message refused within the last interval? The next one stops.
    #[must_use]
    pub fn has_refused_lately(&self, now: Micros) -> bool {
        self.last_refused.is_some_and(|at| now.since(at) <= LINK_ERROR_INTERVAL)
    }

    fn hold(&mut self, refusal: Refusal) {
        self.streak = 0;
        self.faults = self.faults.with(refusal.cause());
        self.count(refusal);
    }

    fn count(&mut self, refusal: Refusal) {
        for (count, kind) in self.counts.refused.iter_mut().zip(Refusal::ALL) {
            if kind == refusal {
                *count = count.saturating_add(1);
            }
        }
    }
}

#[cfg(test)]
mod tests;
