//! Self-tests of the controller's own hardware: what is judged, and what the controller is told.
//!
//! Everything here is pure: memory, readings and time come in as arguments; the binaries bring the registers.
//!
//! The controller takes a [`SelfTestReport`] with every tick and may close the relays only while its
//! [verdict](SelfTestReport::verdict) is [`Verdict::Passed`]. What is not positively reported as passed is pending or
//! failed; a failed test locks the controller out.
//!
//! | module | tests |
//! |---|---|
//! | [`memory`] | RAM: destructive march at start, transparent blocks while running |
//! | [`program`] | flash against the image's seal |
//! | [`processor`] | registers and arithmetic of the processor and of the floating-point unit |
//! | [`stack`] | guard zone and high-water mark |
//! | [`clock`] | two oscillators against each other |
//! | [`supply`] | supply voltage |
//! | [`configuration`] | stored rig |
//! | [`watchdog`] | both watchdogs, by provoked resets after power-up |
//! | [`random`] | random number generator |
//! | [`schedule`] | which slice is next, what has passed, what the controller is told |

pub mod clock;
pub mod configuration;
pub mod memory;
pub mod processor;
pub mod program;
pub mod random;
pub mod schedule;
pub mod stack;
pub mod supply;
pub mod watchdog;

use nearfield_shared::units::Micros;

/// A complete round of the tests that run in slices takes no longer than this; one that is overdue counts as failed.
/// Reason: a fault of the controller must be found long before the next demand on it. A diagnostic that runs at least
/// 100 times as often as the safety function is demanded counts as if it ran continuously (IEC 61508-2, 7.4.4.1; ISO
/// 13849-1, 6.2.5): 10 s allow for one person or object on the stripe every 17 minutes, on average. What may not
/// wait that long (relay command, supervisor's state, program flow, contacts) is checked in every tick instead.
pub const ROUND_DEADLINE: Micros = Micros::from_millis(10_000);

/// A part of the controller's hardware that is tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SelfTestKind {
    /// The processor's registers, adder, shifter and multiplier.
    Processor,
    /// The floating-point registers and arithmetic.
    FloatingPoint,
    /// RAM.
    Memory,
    /// The program in flash.
    Program,
    /// The stack: its guard words and its depth.
    Stack,
    /// The clocks: two oscillators against each other.
    Clock,
    /// The supply voltage.
    Supply,
    /// The configuration that is in use: the stored rig.
    Configuration,
    /// The watchdogs.
    Watchdog,
    /// The random number generator.
    Random,
    /// The settings of pins, timers and watchdogs in their registers.
    Registers,
    /// The tests themselves: a round of them is overdue, or they ran out of order.
    Schedule,
}

impl SelfTestKind {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Processor,
        Self::FloatingPoint,
        Self::Memory,
        Self::Program,
        Self::Stack,
        Self::Clock,
        Self::Supply,
        Self::Configuration,
        Self::Watchdog,
        Self::Random,
        Self::Registers,
        Self::Schedule,
    ];

    /// Names it in memory, in logs and on the wire: words of the extended Hamming code (8, 4), which differ from each
    /// other, from 0x00 and from 0xFF in at least four bits.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Processor => 0x0F,
            Self::FloatingPoint => 0x33,
            Self::Memory => 0x3C,
            Self::Program => 0x55,
            Self::Stack => 0x5A,
            Self::Clock => 0x66,
            Self::Supply => 0x69,
            Self::Configuration => 0x96,
            Self::Watchdog => 0x99,
            Self::Random => 0xA5,
            Self::Registers => 0xAA,
            Self::Schedule => 0xC3,
        }
    }

    /// The inverse of [`Self::code`].
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code() == code)
    }

    /// The name that programs read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Processor => "processor",
            Self::FloatingPoint => "floating_point",
            Self::Memory => "memory",
            Self::Program => "program",
            Self::Stack => "stack",
            Self::Clock => "clock",
            Self::Supply => "supply",
            Self::Configuration => "configuration",
            Self::Watchdog => "watchdog",
            Self::Random => "random",
            Self::Registers => "registers",
            Self::Schedule => "schedule",
        }
    }

    /// What a person reads.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Processor => "the processor's registers or arithmetic are faulty",
            Self::FloatingPoint => "the floating-point unit is faulty",
            Self::Memory => "a memory cell is faulty",
            Self::Program => "the program in flash has changed, or was never sealed",
            Self::Stack => "the stack ran too deep",
            Self::Clock => "the clocks disagree or stand still",
            Self::Supply => "the supply voltage is out of its range",
            Self::Configuration => "the calibration in use is not the stored one",
            Self::Watchdog => "a watchdog does not bite",
            Self::Random => "the random number generator is faulty",
            Self::Registers => "a setting of the hardware has changed",
            Self::Schedule => "the self-tests are overdue",
        }
    }
}

/// What a test, or a slice of one, has found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing wrong so far, and not through yet.
    Pending,
    /// Through, and nothing wrong.
    Passed,
    /// A fault.
    Failed,
}

impl Outcome {
    /// Passed or failed.
    #[must_use]
    pub const fn passed_if(passed: bool) -> Self {
        if passed { Self::Passed } else { Self::Failed }
    }
}

/// How far the tests at start have come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartProgress {
    /// Not all of them have run.
    Pending,
    /// All of them have passed.
    Complete,
}

/// What the self-tests have found so far; the controller takes it with every tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SelfTestReport {
    /// The tests at start.
    pub start: StartProgress,
    /// The first test that has failed since start; it stays.
    pub failed: Option<SelfTestKind>,
    /// When the last complete round of the running tests ended, by the MCU's clock; a complete start counts as one.
    pub round_completed: Micros,
}

/// What a report means now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Not everything has been tested: the relays stay open.
    Pending,
    /// Everything has been tested within its deadline.
    Passed,
    /// Lock out.
    Failed(SelfTestKind),
}

impl SelfTestReport {
    /// Nothing has been tested yet.
    pub const PENDING: Self =
        Self { start: StartProgress::Pending, failed: None, round_completed: Micros::ZERO };

    /// Everything has just passed: for simulations, whose hardware has no faults but those that they inject.
    #[must_use]
    pub const fn passed(now: Micros) -> Self {
        Self { start: StartProgress::Complete, failed: None, round_completed: now }
    }

    /// What it means at `now`. A round that ended in the future is overdue as well: the clock is not to be trusted.
    #[must_use]
    pub fn verdict(&self, now: Micros) -> Verdict {
        if let Some(kind) = self.failed {
            return Verdict::Failed(kind);
        }
        match self.start {
            StartProgress::Pending => Verdict::Pending,
            StartProgress::Complete if now.since(self.round_completed) <= ROUND_DEADLINE => Verdict::Passed,
            StartProgress::Complete => Verdict::Failed(SelfTestKind::Schedule),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_a_far_code_a_name_and_words_of_its_own() {
        let codes: Vec<u8> =
            SelfTestKind::ALL.map(SelfTestKind::code).into_iter().chain([0x00, 0xFF]).collect();
        for (place, one) in codes.iter().enumerate() {
            for other in &codes[place + 1..] {
                assert!((one ^ other).count_ones() >= 4, "{one:#04x} and {other:#04x}");
            }
        }
        let names: std::collections::BTreeSet<_> = SelfTestKind::ALL.map(SelfTestKind::name).into();
        let words: std::collections::BTreeSet<_> = SelfTestKind::ALL.map(SelfTestKind::words).into();
        assert_eq!((names.len(), words.len()), (SelfTestKind::ALL.len(), SelfTestKind::ALL.len()));
    }

    #[test]
    fn codes_lead_back_to_their_kinds_and_no_other_code_does() {
        for kind in SelfTestKind::ALL {
            assert_eq!(SelfTestKind::from_code(kind.code()), Some(kind));
        }
        let known = (0..=u8::MAX).filter(|code| SelfTestKind::from_code(*code).is_some()).count();
        assert_eq!(known, SelfTestKind::ALL.len());
    }

    #[test]
    fn nothing_passes_before_the_tests_at_start_are_complete() {
        for now in [Micros::ZERO, ROUND_DEADLINE, Micros::from_millis(1_000_000)] {
            assert_eq!(SelfTestReport::PENDING.verdict(now), Verdict::Pending);
        }
    }

    #[test]
    fn a_failed_test_outvotes_everything() {
        for kind in SelfTestKind::ALL {
            for start in [StartProgress::Pending, StartProgress::Complete] {
                let report = SelfTestReport { start, failed: Some(kind), round_completed: Micros::ZERO };
                assert_eq!(report.verdict(Micros::ZERO), Verdict::Failed(kind));
                assert_eq!(report.verdict(Micros::from_millis(90_000)), Verdict::Failed(kind));
            }
        }
    }

    #[test]
    fn a_round_counts_until_its_deadline() {
        let completed = Micros::from_millis(77);
        let report = SelfTestReport::passed(completed);
        assert_eq!(report.verdict(completed), Verdict::Passed);
        for (change, expected) in
            [(-1, Verdict::Passed), (0, Verdict::Passed), (1, Verdict::Failed(SelfTestKind::Schedule))]
        {
            let now = Micros::new(completed.plus(ROUND_DEADLINE).get().saturating_add_signed(change));
            assert_eq!(report.verdict(now), expected, "{change}");
        }
        let before = Micros::from_millis(76);
        assert_eq!(
            report.verdict(before),
            Verdict::Failed(SelfTestKind::Schedule),
            "a round from the future"
        );
    }
}
