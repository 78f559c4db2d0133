//! Why the MCU stops: every cause by name, with its bit on the wire and plain words for people.

/// One reason to stop. The discriminant is the bit on the wire; never renumber.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum StopCause {
    /// Tier 1: the stripe is cut for longer than the limit.
    StripeCut = 0,
    /// No stripe anywhere: laser off, lens covered, wrong picture.
    StripeMissing = 1,
    /// Tier 2: something at least 50 mm high lifts the stripe.
    LargeObject = 2,
    /// Tier 2: the stripe lies well below the floor (a hole, a ramp, an edge).
    Drop = 3,
    /// The host asks for a stop.
    HostRequest = 4,
    /// No acceptable line-scan for too long (loss).
    LinkTimeout = 5,
    /// CRC wrong (corruption).
    LinkCorruption = 6,
    /// Length, magic, version or a field that the format does not allow (insertion).
    LinkFormat = 7,
    /// Meant for or sent by another module (masquerade, addressing).
    LinkSource = 8,
    /// Host and MCU use different calibrations.
    LinkCalibration = 9,
    /// The same sequence number again (unintended repetition).
    LinkRepetition = 10,
    /// A sequence number that lies behind or too far ahead (incorrect sequence, loss).
    LinkSequence = 11,
    /// The picture is too old (unacceptable delay).
    LinkDelay = 12,
    /// A relay contact does not follow its channel (EDM).
    Feedback = 13,
    /// The last reset was the watchdog's.
    WatchdogReset = 14,
    /// The safety task missed its deadline or its sequence of checkpoints.
    ProgramFlow = 15,
    /// A self-test failed.
    SelfTest = 16,
    /// No valid rig is stored, or it cannot be used.
    Configuration = 17,
    /// The reset button is held for too long.
    ResetButton = 18,
    /// Waiting for a reset after power-up or after a stop (restart interlock).
    Interlock = 19,
    /// The light that the host reports does not follow the laser's secret code, or has not for too long.
    Liveness = 20,
    /// At arming, a laser switched off was still seen as a stripe (or never seen dark).
    DarkTest = 21,
    /// Raw pixels do not bear out the rows that the host reports.
    Audit = 22,
    /// The floor is not where the calibration says: the mount was knocked or bent.
    Misaligned = 23,
    /// Somewhere the sensor cannot see objects of the configured size any more.
    Capability = 24,
    /// A relay driver does not follow a test pulse: stuck, or shorted to the other channel.
    OutputStage = 25,
    /// Memory that the decision rests on was damaged.
    CriticalData = 26,
}

impl StopCause {
    /// All causes, in the order of their bits.
    pub const ALL: [Self; 27] = [
        Self::StripeCut,
        Self::StripeMissing,
        Self::LargeObject,
        Self::Drop,
        Self::HostRequest,
        Self::LinkTimeout,
        Self::LinkCorruption,
        Self::LinkFormat,
        Self::LinkSource,
        Self::LinkCalibration,
        Self::LinkRepetition,
        Self::LinkSequence,
        Self::LinkDelay,
        Self::Feedback,
        Self::WatchdogReset,
        Self::ProgramFlow,
        Self::SelfTest,
        Self::Configuration,
        Self::ResetButton,
        Self::Interlock,
        Self::Liveness,
        Self::DarkTest,
        Self::Audit,
        Self::Misaligned,
        Self::Capability,
        Self::OutputStage,
        Self::CriticalData,
    ];

    /// This cause's bit.
    #[must_use]
    pub const fn bit(self) -> u32 {
        match self {
            Self::StripeCut => 1,
            Self::StripeMissing => 1 << 1,
            Self::LargeObject => 1 << 2,
            Self::Drop => 1 << 3,
            Self::HostRequest => 1 << 4,
            Self::LinkTimeout => 1 << 5,
            Self::LinkCorruption => 1 << 6,
            Self::LinkFormat => 1 << 7,
            Self::LinkSource => 1 << 8,
            Self::LinkCalibration => 1 << 9,
            Self::LinkRepetition => 1 << 10,
            Self::LinkSequence => 1 << 11,
            Self::LinkDelay => 1 << 12,
            Self::Feedback => 1 << 13,
            Self::WatchdogReset => 1 << 14,
            Self::ProgramFlow => 1 << 15,
            Self::SelfTest => 1 << 16,
            Self::Configuration => 1 << 17,
            Self::ResetButton => 1 << 18,
            Self::Interlock => 1 << 19,
            Self::Liveness => 1 << 20,
            Self::DarkTest => 1 << 21,
            Self::Audit => 1 << 22,
            Self::Misaligned => 1 << 23,
            Self::Capability => 1 << 24,
            Self::OutputStage => 1 << 25,
            Self::CriticalData => 1 << 26,
        }
    }

    /// The name that programs read (`causes` in JSON).
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::StripeCut => "stripe_cut",
            Self::StripeMissing => "stripe_missing",
            Self::LargeObject => "large_object",
            Self::Drop => "drop",
            Self::HostRequest => "host_request",
            Self::LinkTimeout => "link_timeout",
            Self::LinkCorruption => "link_corruption",
            Self::LinkFormat => "link_format",
            Self::LinkSource => "link_source",
            Self::LinkCalibration => "link_calibration",
            Self::LinkRepetition => "link_repetition",
            Self::LinkSequence => "link_sequence",
            Self::LinkDelay => "link_delay",
            Self::Feedback => "feedback",
            Self::WatchdogReset => "watchdog_reset",
            Self::ProgramFlow => "program_flow",
            Self::SelfTest => "self_test",
            Self::Configuration => "configuration",
            Self::ResetButton => "reset_button",
            Self::Interlock => "interlock",
            Self::Liveness => "liveness",
            Self::DarkTest => "dark_test",
            Self::Audit => "audit",
            Self::Misaligned => "misaligned",
            Self::Capability => "capability",
            Self::OutputStage => "output_stage",
            Self::CriticalData => "critical_data",
        }
    }

    /// What a person at the robot reads.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::StripeCut => "something cuts the laser stripe",
            Self::StripeMissing => "no laser stripe is seen",
            Self::LargeObject => "something 50 mm or higher is on the stripe",
            Self::Drop => "the floor drops away",
            Self::HostRequest => "the host computer asks for a stop",
            Self::LinkTimeout => "the host computer is silent",
            Self::LinkCorruption => "a message from the host computer is damaged",
            Self::LinkFormat => "a message from the host computer is malformed",
            Self::LinkSource => "a message comes from the wrong module",
            Self::LinkCalibration => "host computer and safety controller use different calibrations",
            Self::LinkRepetition => "the host computer repeats an old message",
            Self::LinkSequence => "messages from the host computer are lost or out of order",
            Self::LinkDelay => "the host computer's picture is too old",
            Self::Feedback => "a relay contact does not follow its command",
            Self::WatchdogReset => "the safety controller was restarted by its watchdog",
            Self::ProgramFlow => "the safety controller's program ran late or out of order",
            Self::SelfTest => "a self-test failed",
            Self::Configuration => "no valid calibration is stored",
            Self::ResetButton => "the reset button is stuck",
            Self::Interlock => "waiting for the reset button",
            Self::Liveness => "the pictures do not show the laser's own flicker: frozen, replayed or covered",
            Self::DarkTest => "the stripe was still reported while the laser was off",
            Self::Audit => "the host's stripe is not where its own pixels show it",
            Self::Misaligned => "the sensor has moved in its mount; check it and calibrate again",
            Self::Capability => "part of the stripe is seen too badly; clean the lens and the laser's window",
            Self::OutputStage => "a relay driver failed its test pulse",
            Self::CriticalData => "memory of the safety controller was damaged",
        }
    }
}

/// A set of causes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StopCauses(u32);

impl StopCauses {
    /// No reason to stop.
    pub const NONE: Self = Self(0);

    /// From the wire's bits; bits that no cause has are kept (a newer MCU may know more) and count as causes.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// For the wire.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// With one more.
    #[must_use]
    pub const fn with(self, cause: StopCause) -> Self {
        Self(self.0 | cause.bit())
    }

    /// With one more, if `holds`.
    #[must_use]
    pub const fn with_if(self, cause: StopCause, holds: bool) -> Self {
        if holds { self.with(cause) } else { self }
    }

    /// Of both sets.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Without one of them.
    #[must_use]
    pub const fn without(self, cause: StopCause) -> Self {
        Self(self.0 & !cause.bit())
    }

    /// Is this cause among them?
    #[must_use]
    pub const fn contains(self, cause: StopCause) -> bool {
        self.0 & cause.bit() != 0
    }

    /// No reason to stop.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The known causes among them, in the order of their bits.
    pub fn iter(self) -> impl Iterator<Item = StopCause> {
        StopCause::ALL.into_iter().filter(move |cause| self.contains(*cause))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cause_has_a_bit_a_name_and_words_of_its_own() {
        let mut seen = StopCauses::NONE;
        for (index, cause) in StopCause::ALL.into_iter().enumerate() {
            assert_eq!(cause.bit(), 1 << index, "{}", cause.name());
            assert_eq!(cause as usize, index);
            assert!(!seen.contains(cause));
            seen = seen.with(cause);
        }
        let names: std::collections::BTreeSet<_> = StopCause::ALL.map(StopCause::name).into();
        let words: std::collections::BTreeSet<_> = StopCause::ALL.map(StopCause::words).into();
        assert_eq!((names.len(), words.len()), (27, 27));
        assert_eq!(seen.iter().count(), 27);
    }

    #[test]
    fn sets_add_remove_and_keep_unknown_bits() {
        let set = StopCauses::from_bits(1 << 31).with(StopCause::Drop).with_if(StopCause::Feedback, false);
        assert_eq!(set.bits(), (1 << 31) | 8);
        assert_eq!(set.without(StopCause::Drop).bits(), 1 << 31);
        assert!(!set.without(StopCause::Drop).is_empty());
        assert_eq!(set.union(StopCauses::NONE.with(StopCause::StripeCut)).bits(), (1 << 31) | 9);
    }

    /// A set: what is in it twice is in it.
    #[test]
    fn a_cause_that_is_added_twice_is_there() {
        for cause in StopCause::ALL {
            let once = StopCauses::NONE.with(cause);
            assert!(!once.is_empty() && StopCauses::NONE.is_empty());
            assert_eq!(once.with(cause), once);
            assert_eq!(once.union(once), once);
        }
    }
}
