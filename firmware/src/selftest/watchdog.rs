//! The watchdogs' test: once after each power-up both are left to bite, one after the other.
//!
//! A [`Marker`] in memory that start-up does not clear says which bite is awaited; the chip's reset flags say which one
//! came. Memory after power-up holds anything, so the marker is kept with its complement, and a power-up by the flags
//! counts as one whatever the marker says.
//!
//! ```text
//!  power-up, or no marker         window watchdog bit          independent watchdog bit
//!  ----------------------> Window -------------------> Independent ----------------------> Passed: run
//!                            |                             |
//!                            +---- it did not bite, or another one did --> Failed: run, locked out
//! ```
//!
//! Any other reset in between begins again. Resets after the test are taken for what they are. The marker also keeps
//! the cause of the first reset, which is what the status tells after the provoked ones.
//!
//! **Time:** the two time-outs (190 ms on the board) and two starts. **Failure:**
//! [`SelfTestKind::Watchdog`](super::SelfTestKind::Watchdog).

use super::Outcome;
use nearfield_shared::status::ResetCause;

/// What the chip tells about its last reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ResetFlags {
    /// Power came on, or dipped.
    pub power: bool,
    /// The reset pin was pulled; most resets pull it themselves.
    pub pin: bool,
    /// The program asked for it.
    pub software: bool,
    /// The window watchdog bit.
    pub window_watchdog: bool,
    /// The independent watchdog bit.
    pub independent_watchdog: bool,
    /// Something else (low-power, option bytes).
    pub other: bool,
}

impl ResetFlags {
    /// Why the chip started. A watchdog outvotes everything, and the pin says something only by itself.
    #[must_use]
    pub const fn cause(&self) -> ResetCause {
        if self.window_watchdog || self.independent_watchdog {
            ResetCause::Watchdog
        } else if self.power {
            ResetCause::PowerOn
        } else if self.software {
            ResetCause::Software
        } else if self.other {
            ResetCause::Unknown
        } else if self.pin {
            ResetCause::Pin
        } else {
            ResetCause::Unknown
        }
    }
}

/// A watchdog.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watchdog {
    /// On the processor's clock; an early feed is a reset as well.
    Window,
    /// On an oscillator of its own.
    Independent,
}

/// How far the test is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Awaited(Watchdog),
    Passed,
    Failed,
}

impl Phase {
    const ALL: [Self; 4] =
        [Self::Awaited(Watchdog::Window), Self::Awaited(Watchdog::Independent), Self::Passed, Self::Failed];

    /// The upper three bytes of the marker.
    const fn code(self) -> u32 {
        match self {
            Self::Awaited(Watchdog::Window) => 0x57_D0_1A_00,
            Self::Awaited(Watchdog::Independent) => 0x1D_2B_E5_00,
            Self::Passed => 0xB2_6C_C3_00,
            Self::Failed => 0xE8_97_3C_00,
        }
    }
}

/// What memory that start-up does not clear holds between resets; two words, one the complement of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Marker {
    phase: Phase,
    first_cause: ResetCause,
}

const fn cause_code(cause: ResetCause) -> u32 {
    match cause {
        ResetCause::PowerOn => 1,
        ResetCause::Pin => 2,
        ResetCause::Watchdog => 3,
        ResetCause::Software => 4,
        ResetCause::Unknown => 5,
    }
}

const CAUSES: [ResetCause; 5] =
    [ResetCause::PowerOn, ResetCause::Pin, ResetCause::Watchdog, ResetCause::Software, ResetCause::Unknown];

impl Marker {
    /// What memory holds, if it is a marker.
    #[must_use]
    pub fn from_words(words: [u32; 2]) -> Option<Self> {
        let [word, complement] = words;
        if word != !complement {
            return None;
        }
        let [cause, ..] = word.to_le_bytes();
        let phase = Phase::ALL.into_iter().find(|phase| phase.code() == word & 0xFFFF_FF00)?;
        let first_cause = CAUSES.into_iter().find(|known| cause_code(*known) == u32::from(cause))?;
        Some(Self { phase, first_cause })
    }

    /// For the memory.
    #[must_use]
    pub const fn to_words(self) -> [u32; 2] {
        let word = self.phase.code() | cause_code(self.first_cause);
        [word, !word]
    }

    /// Is another start to follow before the controller runs, whatever the last reset was? Then tests that take long
    /// may be left to that one. (After the second bite it may run.)
    #[must_use]
    pub const fn is_far_from_running(&self) -> bool {
        match self.phase {
            Phase::Awaited(Watchdog::Window) => true,
            Phase::Awaited(Watchdog::Independent) | Phase::Passed | Phase::Failed => false,
        }
    }

    /// The awaited bite did not come.
    #[must_use]
    pub const fn failed(self) -> Self {
        Self { phase: Phase::Failed, ..self }
    }
}

/// What to do after a reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// Start this watchdog, do not feed it, and wait. If it has not bitten in time: [`Marker::failed`].
    Provoke(Watchdog),
    /// Go on. The cause is that of the first reset, the provoked ones left out.
    Run {
        /// Why the chip started.
        cause: ResetCause,
        /// Have both bitten?
        watchdogs: Outcome,
    },
}

/// Decides after a reset; the marker is for the memory, before anything else happens.
#[must_use]
pub fn after_reset(marker: Option<Marker>, flags: ResetFlags) -> (Marker, Start) {
    let begin = Marker { phase: Phase::Awaited(Watchdog::Window), first_cause: flags.cause() };
    let Some(marker) = marker.filter(|_| !flags.power) else {
        return (begin, Start::Provoke(Watchdog::Window));
    };
    let run = |phase, cause, watchdogs| (Marker { phase, ..marker }, Start::Run { cause, watchdogs });
    match (marker.phase, flags.window_watchdog, flags.independent_watchdog) {
        (Phase::Awaited(Watchdog::Window), true, false) => (
            Marker { phase: Phase::Awaited(Watchdog::Independent), ..marker },
            Start::Provoke(Watchdog::Independent),
        ),
        (Phase::Awaited(Watchdog::Independent), false, true) => {
            run(Phase::Passed, marker.first_cause, Outcome::Passed)
        }
        (Phase::Awaited(_), false, false) => (begin, Start::Provoke(Watchdog::Window)),
        (Phase::Awaited(_), _, _) => run(Phase::Failed, marker.first_cause, Outcome::Failed),
        (Phase::Passed, _, _) => run(Phase::Passed, flags.cause(), Outcome::Passed),
        (Phase::Failed, _, _) => run(Phase::Failed, flags.cause(), Outcome::Failed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: ResetFlags = ResetFlags {
        power: false,
        pin: true,
        software: false,
        window_watchdog: false,
        independent_watchdog: false,
        other: false,
    };
    const POWER: ResetFlags = ResetFlags { power: true, ..NONE };
    const WINDOW: ResetFlags = ResetFlags { window_watchdog: true, ..NONE };
    const INDEPENDENT: ResetFlags = ResetFlags { independent_watchdog: true, ..NONE };

    /// Through the memory, as between resets.
    fn step(marker: Marker, flags: ResetFlags) -> (Marker, Start) {
        after_reset(Marker::from_words(marker.to_words()), flags)
    }

    fn run(cause: ResetCause, watchdogs: Outcome) -> Start {
        Start::Run { cause, watchdogs }
    }

    #[test]
    fn both_watchdogs_bite_once_after_power_up() {
        let (marker, start) = after_reset(None, POWER);
        assert_eq!(start, Start::Provoke(Watchdog::Window));
        let (marker, start) = step(marker, WINDOW);
        assert_eq!(start, Start::Provoke(Watchdog::Independent));
        let (marker, start) = step(marker, INDEPENDENT);
        assert_eq!(start, run(ResetCause::PowerOn, Outcome::Passed), "not the provoked resets");
        assert!(!marker.is_far_from_running());
    }

    /// A test that is left out while the marker says so has always been made when the controller runs.
    #[test]
    fn what_is_left_out_is_made_up_for_before_the_controller_runs() {
        let (window, _) = after_reset(None, POWER);
        let (independent, _) = step(window, WINDOW);
        assert!(window.is_far_from_running());
        for flags in [NONE, POWER, WINDOW] {
            assert!(matches!(step(window, flags).1, Start::Provoke(_)), "{flags:?}");
        }
        for marker in [independent, passed(), passed().failed()] {
            assert!(!marker.is_far_from_running(), "{marker:?}");
        }
    }

    /// The marker of a test that has passed.
    fn passed() -> Marker {
        let (marker, _) = after_reset(None, POWER);
        let (marker, _) = step(marker, WINDOW);
        step(marker, INDEPENDENT).0
    }

    #[test]
    fn later_resets_are_taken_for_what_they_are() {
        for (flags, cause) in [
            (NONE, ResetCause::Pin),
            (ResetFlags { software: true, ..NONE }, ResetCause::Software),
            (ResetFlags { other: true, ..NONE }, ResetCause::Unknown),
            (ResetFlags { pin: false, ..NONE }, ResetCause::Unknown),
            (WINDOW, ResetCause::Watchdog),
            (INDEPENDENT, ResetCause::Watchdog),
            (ResetFlags { software: true, ..WINDOW }, ResetCause::Watchdog),
        ] {
            assert_eq!(step(passed(), flags), (passed(), run(cause, Outcome::Passed)), "{flags:?}");
        }
    }

    #[test]
    fn every_power_up_tests_again_whatever_the_memory_says() {
        let (begin, _) = after_reset(None, POWER);
        for marker in [passed(), passed().failed(), begin] {
            assert_eq!(step(marker, POWER), (begin, Start::Provoke(Watchdog::Window)));
        }
        let and_watchdog = ResetFlags { window_watchdog: true, ..POWER };
        assert_eq!(step(begin, and_watchdog).1, Start::Provoke(Watchdog::Window));
    }

    #[test]
    fn without_a_marker_every_reset_is_tested() {
        for flags in [NONE, WINDOW, INDEPENDENT] {
            let (marker, start) = after_reset(None, flags);
            assert_eq!(start, Start::Provoke(Watchdog::Window));
            let (marker, _) = step(marker, WINDOW);
            assert_eq!(step(marker, INDEPENDENT).1, run(flags.cause(), Outcome::Passed), "{flags:?}");
        }
    }

    #[test]
    fn the_wrong_bite_fails() {
        let (window, _) = after_reset(None, POWER);
        let (independent, _) = step(window, WINDOW);
        let both = ResetFlags { independent_watchdog: true, ..WINDOW };
        for (marker, flags) in
            [(window, INDEPENDENT), (window, both), (independent, WINDOW), (independent, both)]
        {
            let (marker, start) = step(marker, flags);
            assert_eq!(start, run(ResetCause::PowerOn, Outcome::Failed), "{flags:?}");
            assert_eq!(step(marker, NONE).1, run(ResetCause::Pin, Outcome::Failed), "until power-up");
        }
    }

    #[test]
    fn a_bite_that_does_not_come_fails_until_power_up() {
        let (marker, _) = after_reset(None, POWER);
        let failed = marker.failed();
        for flags in [NONE, WINDOW, INDEPENDENT] {
            assert_eq!(step(failed, flags), (failed, run(flags.cause(), Outcome::Failed)));
        }
    }

    #[test]
    fn another_reset_in_between_begins_again() {
        let (window, _) = after_reset(None, POWER);
        let (independent, _) = step(window, WINDOW);
        for marker in [window, independent] {
            assert_eq!(step(marker, NONE).1, Start::Provoke(Watchdog::Window));
        }
    }

    #[test]
    fn every_marker_survives_the_memory_and_nothing_else_is_one() {
        for phase in Phase::ALL {
            for first_cause in CAUSES {
                let marker = Marker { phase, first_cause };
                assert_eq!(Marker::from_words(marker.to_words()), Some(marker));
                let [word, complement] = marker.to_words();
                for bit in 0..32 {
                    assert_eq!(Marker::from_words([word ^ (1 << bit), complement]), None);
                    assert_eq!(Marker::from_words([word, complement ^ (1 << bit)]), None);
                }
            }
        }
        for words in [[0, 0], [u32::MAX, u32::MAX], [0, u32::MAX], [u32::MAX, 0], [0x57D0_1A00, !0x57D0_1A00]]
        {
            assert_eq!(Marker::from_words(words), None, "{words:x?}");
        }
    }

    #[test]
    fn phases_are_far_apart() {
        for (place, one) in Phase::ALL.into_iter().enumerate() {
            for other in Phase::ALL.into_iter().skip(place + 1) {
                assert!((one.code() ^ other.code()).count_ones() >= 8, "{one:?} {other:?}");
            }
        }
    }
}
