//! Two oscillators against each other: the one that the program and its clock run on, and the low-speed one that
//! drives the independent watchdog.
//!
//! The binaries count the low-speed oscillator's cycles in a 16-bit counter. Over each [`WINDOW`] of the program's
//! clock its count must be that of [`LOW_SPEED_HZ`] within [`TOLERANCE_PERCENT`]. Either oscillator that drifts,
//! jumps to a harmonic or stands still shows as a ratio out of range. (If the program's own oscillator stops, the program
//! stops, and the independent watchdog on the other one resets the chip.)
//!
//! **Time:** about 60 instructions in every tick; found within two windows. **Failure:**
//! [`SelfTestKind::Clock`](super::SelfTestKind::Clock).

use super::Outcome;
use nearfield_shared::units::Micros;

/// The low-speed oscillator's nominal frequency. Source: STM32G474 data sheet, LSI.
pub const LOW_SPEED_HZ: u64 = 32_000;
/// The ratio may be off by this. Reason: the low-speed oscillator has 29.5 to 34 kHz over temperature and supply
/// (-8 %, +6 %), the high-speed one 2 %. All deadlines of the program are as inexact as this at most.
pub const TOLERANCE_PERCENT: u64 = 12;
/// A ratio is judged over this time. Reason: 8000 cycles, so that counting whole ones costs nothing; short against
/// the deadline of a round.
pub const WINDOW: Micros = Micros::from_millis(250);
/// A window that took longer than this by the program's clock is not judged but failed: the 16-bit counter may have
/// wrapped (it does every 2 s).
pub const LONGEST_WINDOW: Micros = Micros::from_millis(1_500);
/// A passed window counts for this long.
pub const VALIDITY: Micros = Micros::from_millis(1_000);

/// Judges window after window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClockCheck {
    window: Option<(Micros, u16)>,
    passed: Option<Micros>,
    failed: bool,
}

impl ClockCheck {
    /// Nothing was counted yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { window: None, passed: None, failed: false }
    }

    /// Takes the program's time and the counter, read together.
    pub fn step(&mut self, now: Micros, counter: u16) {
        let Some((start, from)) = self.window else {
            self.window = Some((now, counter));
            return;
        };
        let elapsed = now.since(start);
        if elapsed < WINDOW {
            return;
        }
        self.window = Some((now, counter));
        if elapsed <= LONGEST_WINDOW && is_in_ratio(elapsed, counter.wrapping_sub(from)) {
            self.passed = Some(now);
        } else {
            self.failed = true;
        }
    }

    /// Failed for good; passed while the last window is not too old; else pending.
    #[must_use]
    pub fn outcome(&self, now: Micros) -> Outcome {
        if self.failed {
            Outcome::Failed
        } else if self.passed.is_some_and(|passed| now.since(passed) <= VALIDITY) {
            Outcome::Passed
        } else {
            Outcome::Pending
        }
    }
}

impl Default for ClockCheck {
    fn default() -> Self {
        Self::new()
    }
}

/// Is this the count of the low-speed oscillator over this time?
fn is_in_ratio(elapsed: Micros, cycles: u16) -> bool {
    let nominal = elapsed.get().saturating_mul(LOW_SPEED_HZ);
    let counted = u64::from(cycles).saturating_mul(1_000_000).saturating_mul(100);
    let low = nominal.saturating_mul(100_u64.saturating_sub(TOLERANCE_PERCENT));
    let high = nominal.saturating_mul(100_u64.saturating_add(TOLERANCE_PERCENT));
    (low..=high).contains(&counted)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The outcome after a second in which the counter runs at this frequency, in steps of 5 ms.
    fn after_a_second_at(hertz: u64, from: u16) -> Outcome {
        let mut check = ClockCheck::new();
        let mut now = Micros::ZERO;
        for tick in 0..=200_u64 {
            now = Micros::from_millis(5 * tick);
            check.step(now, from.wrapping_add((now.get() * hertz / 1_000_000) as u16));
        }
        check.outcome(now)
    }

    #[test]
    fn the_whole_range_of_both_oscillators_passes_and_more_does_not() {
        for from in [0, 60_000] {
            for (hertz, expected) in [
                (0, Outcome::Failed),
                (16_000, Outcome::Failed),
                (28_100, Outcome::Failed),
                (28_900, Outcome::Passed),
                (32_000, Outcome::Passed),
                (34_680, Outcome::Passed),
                (35_900, Outcome::Failed),
                (64_000, Outcome::Failed),
            ] {
                assert_eq!(after_a_second_at(hertz, from), expected, "{hertz} Hz");
            }
        }
    }

    #[test]
    fn the_ratio_has_sharp_limits() {
        for (cycles, expected) in [(7_039, false), (7_040, true), (8_960, true), (8_961, false)] {
            assert_eq!(is_in_ratio(WINDOW, cycles), expected, "{cycles} instead of 8000");
        }
    }

    #[test]
    fn nothing_is_judged_before_a_window_is_over() {
        let mut check = ClockCheck::new();
        assert_eq!(check.outcome(Micros::ZERO), Outcome::Pending);
        check.step(Micros::ZERO, 0);
        check.step(Micros::new(WINDOW.get() - 1), 8_000);
        assert_eq!(check.outcome(WINDOW), Outcome::Pending);
        check.step(WINDOW, 8_000);
        assert_eq!(check.outcome(WINDOW), Outcome::Passed);
    }

    #[test]
    fn a_passed_window_counts_for_a_while_and_a_failed_one_for_good() {
        let mut check = ClockCheck::new();
        check.step(Micros::ZERO, 0);
        check.step(WINDOW, 8_000);
        assert_eq!(check.outcome(WINDOW.plus(VALIDITY)), Outcome::Passed);
        assert_eq!(check.outcome(WINDOW.plus(VALIDITY).plus(Micros::new(1))), Outcome::Pending);
        assert_eq!(check.outcome(Micros::ZERO), Outcome::Pending, "a clock that ran backwards");
        check.step(WINDOW.plus(WINDOW), 8_000);
        assert_eq!(check.outcome(WINDOW.plus(WINDOW)), Outcome::Failed, "the counter stands still");
        check.step(WINDOW.plus(WINDOW).plus(WINDOW), 16_000);
        assert_eq!(check.outcome(WINDOW.plus(WINDOW).plus(WINDOW)), Outcome::Failed, "for good");
    }

    #[test]
    fn a_window_that_took_too_long_fails_even_with_the_right_ratio() {
        for (change, expected) in [(0, Outcome::Passed), (1, Outcome::Failed)] {
            let now = LONGEST_WINDOW.plus(Micros::new(change));
            let mut check = ClockCheck::default();
            check.step(Micros::ZERO, 0);
            check.step(now, 48_000);
            assert_eq!(check.outcome(now), expected);
        }
        let mut check = ClockCheck::new();
        check.step(WINDOW, 0);
        check.step(Micros::ZERO, 8_000);
        assert_eq!(check.outcome(Micros::ZERO), Outcome::Failed, "a clock that ran backwards");
    }
}
