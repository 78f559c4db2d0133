//! Which test runs next, what has been found, and what the controller is told.
//!
//! At start every test of [`START`] must be recorded as passed, in any order. Then [`ROUND`] is run through in order,
//! again and again; a test that needs several slices stays next until it has passed. A test out of turn is a failure of
//! the schedule itself, and the first failure stays.

use super::{Outcome, SelfTestKind, SelfTestReport, StartProgress};
use nearfield_shared::units::Micros;

/// What must have passed before the relays may close for the first time.
pub const START: [SelfTestKind; 11] = [
    SelfTestKind::Processor,
    SelfTestKind::FloatingPoint,
    SelfTestKind::Memory,
    SelfTestKind::Program,
    SelfTestKind::Stack,
    SelfTestKind::Clock,
    SelfTestKind::Supply,
    SelfTestKind::Configuration,
    SelfTestKind::Watchdog,
    SelfTestKind::Random,
    SelfTestKind::Registers,
];

/// What a round consists of, in its order. The watchdogs and the random number generator are tested at start only.
pub const ROUND: [SelfTestKind; 9] = [
    SelfTestKind::Processor,
    SelfTestKind::FloatingPoint,
    SelfTestKind::Registers,
    SelfTestKind::Supply,
    SelfTestKind::Clock,
    SelfTestKind::Configuration,
    SelfTestKind::Stack,
    SelfTestKind::Program,
    SelfTestKind::Memory,
];

/// Tests that have passed at start: a bit for each, kept with its complement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Passed {
    bits: u16,
    complement: u16,
}

impl Passed {
    const NONE: Self = Self { bits: 0, complement: u16::MAX };

    fn with(self, kind: SelfTestKind) -> Self {
        let bits = self.bits | bit_of(kind);
        Self { bits, complement: !bits }
    }

    const fn is_intact(self) -> bool {
        self.bits == !self.complement
    }

    fn is_complete(self) -> bool {
        let all = START.into_iter().fold(0, |bits, kind| bits | bit_of(kind));
        self.bits == all && self.is_intact()
    }
}

const fn bit_of(kind: SelfTestKind) -> u16 {
    match kind {
        SelfTestKind::Processor => 1,
        SelfTestKind::FloatingPoint => 1 << 1,
        SelfTestKind::Memory => 1 << 2,
        SelfTestKind::Program => 1 << 3,
        SelfTestKind::Stack => 1 << 4,
        SelfTestKind::Clock => 1 << 5,
        SelfTestKind::Supply => 1 << 6,
        SelfTestKind::Configuration => 1 << 7,
        SelfTestKind::Watchdog => 1 << 8,
        SelfTestKind::Random => 1 << 9,
        SelfTestKind::Registers => 1 << 10,
        SelfTestKind::Schedule => 1 << 11,
    }
}

/// See the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schedule {
    passed: Passed,
    failed: Option<SelfTestKind>,
    place: usize,
    round_completed: Micros,
}

impl Schedule {
    /// Nothing was tested yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { passed: Passed::NONE, failed: None, place: 0, round_completed: Micros::ZERO }
    }

    /// A test at start has ended. When all have passed, the first round begins.
    pub fn record_start(&mut self, kind: SelfTestKind, outcome: Outcome, now: Micros) {
        match outcome {
            Outcome::Passed => {
                self.passed = self.passed.with(kind);
                self.round_completed = now;
            }
            Outcome::Pending => {}
            Outcome::Failed => self.fail(kind),
        }
    }

    /// The test whose slice is next.
    #[must_use]
    pub fn next(&self) -> SelfTestKind {
        ROUND.get(self.place).copied().unwrap_or(SelfTestKind::Schedule)
    }

    /// A slice of a running test has ended.
    pub fn record(&mut self, kind: SelfTestKind, outcome: Outcome, now: Micros) {
        if kind != self.next() || !self.passed.is_complete() {
            return self.fail(SelfTestKind::Schedule);
        }
        match outcome {
            Outcome::Pending => {}
            Outcome::Failed => self.fail(kind),
            Outcome::Passed => {
                self.place = self.place.saturating_add(1);
                if self.place == ROUND.len() {
                    self.place = 0;
                    self.round_completed = now;
                }
            }
        }
    }

    /// Something was found outside of the schedule, by a check that runs all the time.
    pub fn fail(&mut self, kind: SelfTestKind) {
        self.failed = self.failed.or(Some(kind));
    }

    /// For the controller.
    #[must_use]
    pub fn report(&self) -> SelfTestReport {
        let damaged = (!self.passed.is_intact()).then_some(SelfTestKind::Memory);
        SelfTestReport {
            start: if self.passed.is_complete() { StartProgress::Complete } else { StartProgress::Pending },
            failed: self.failed.or(damaged),
            round_completed: self.round_completed,
        }
    }
}

impl Default for Schedule {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::selftest::Verdict;

    const NOW: Micros = Micros::from_millis(1_000);

    fn started() -> Schedule {
        let mut schedule = Schedule::new();
        for kind in START {
            schedule.record_start(kind, Outcome::Passed, NOW);
        }
        schedule
    }

    fn verdict(schedule: &Schedule) -> Verdict {
        schedule.report().verdict(NOW)
    }

    #[test]
    fn the_start_is_complete_when_every_test_has_passed_and_not_before() {
        assert_eq!(Schedule::default().report(), SelfTestReport::PENDING);
        for left_out in START {
            let mut schedule = Schedule::new();
            for kind in START.into_iter().filter(|kind| *kind != left_out) {
                assert_eq!(verdict(&schedule), Verdict::Pending);
                schedule.record_start(kind, Outcome::Passed, NOW);
            }
            schedule.record_start(left_out, Outcome::Pending, NOW);
            assert_eq!(verdict(&schedule), Verdict::Pending, "without {left_out:?}");
            schedule.record_start(left_out, Outcome::Passed, NOW);
            assert_eq!(schedule.report(), SelfTestReport::passed(NOW));
        }
    }

    #[test]
    fn each_failure_at_start_is_named_and_stays() {
        for kind in START {
            let mut schedule = Schedule::new();
            schedule.record_start(kind, Outcome::Failed, NOW);
            for kind in START {
                schedule.record_start(kind, Outcome::Passed, NOW);
            }
            assert_eq!(verdict(&schedule), Verdict::Failed(kind));
        }
    }

    #[test]
    fn a_round_is_run_in_order_and_its_end_is_kept() {
        let mut schedule = started();
        for round in 1..=3_u64 {
            let end = NOW.plus(Micros::from_millis(round));
            let before = schedule.report().round_completed;
            for kind in ROUND {
                assert_eq!(schedule.report().round_completed, before, "the round is not over");
                assert_eq!(schedule.next(), kind);
                schedule.record(kind, Outcome::Pending, end);
                assert_eq!(schedule.next(), kind, "several slices");
                schedule.record(kind, Outcome::Passed, end);
            }
            assert_eq!(schedule.report(), SelfTestReport::passed(end));
        }
    }

    #[test]
    fn a_test_out_of_turn_is_a_failure_of_the_schedule() {
        for (place, due) in ROUND.into_iter().enumerate() {
            for kind in SelfTestKind::ALL.into_iter().filter(|kind| *kind != due) {
                let mut schedule = started();
                for kind in ROUND.into_iter().take(place) {
                    schedule.record(kind, Outcome::Passed, NOW);
                }
                schedule.record(kind, Outcome::Passed, NOW);
                assert_eq!(verdict(&schedule), Verdict::Failed(SelfTestKind::Schedule), "{place} {kind:?}");
            }
        }
    }

    #[test]
    fn a_round_before_the_start_is_complete_is_a_failure_of_the_schedule() {
        let mut schedule = Schedule::new();
        schedule.record(ROUND[0], Outcome::Passed, NOW);
        assert_eq!(verdict(&schedule), Verdict::Failed(SelfTestKind::Schedule));
    }

    #[test]
    fn the_first_failure_stays() {
        for (place, kind) in ROUND.into_iter().enumerate() {
            let mut schedule = started();
            for kind in ROUND.into_iter().take(place) {
                schedule.record(kind, Outcome::Passed, NOW);
            }
            schedule.record(kind, Outcome::Failed, NOW);
            assert_eq!(verdict(&schedule), Verdict::Failed(kind));
            schedule.record(SelfTestKind::Schedule, Outcome::Failed, NOW);
            schedule.record(kind, Outcome::Passed, NOW);
            assert_eq!(verdict(&schedule), Verdict::Failed(kind));
        }
    }

    #[test]
    fn a_damaged_memory_of_what_has_passed_is_noticed() {
        for bit in 0..16 {
            for in_complement in [false, true] {
                let mut schedule = started();
                let word =
                    if in_complement { &mut schedule.passed.complement } else { &mut schedule.passed.bits };
                *word ^= 1 << bit;
                assert_eq!(verdict(&schedule), Verdict::Failed(SelfTestKind::Memory), "bit {bit}");
            }
        }
        let mut schedule = started();
        schedule.place = 99;
        schedule.record(schedule.next(), Outcome::Passed, NOW);
        assert_eq!(schedule.next(), SelfTestKind::Schedule);
        assert_eq!(schedule.report().round_completed, NOW, "no round ends any more: it becomes overdue");
    }

    #[test]
    fn every_test_of_a_round_was_made_at_start_and_every_kind_has_its_bit() {
        assert!(ROUND.iter().all(|kind| START.contains(kind)));
        let bits = SelfTestKind::ALL.into_iter().fold(0_u16, |bits, kind| bits | bit_of(kind));
        assert_eq!(bits.count_ones() as usize, SelfTestKind::ALL.len());
        assert!(!START.contains(&SelfTestKind::Schedule));
    }

    #[test]
    fn a_test_that_passes_twice_has_passed() {
        let once = Passed::NONE.with(SelfTestKind::Memory);
        assert_eq!(once.with(SelfTestKind::Memory), once);
    }
}
