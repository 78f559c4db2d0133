//! Pulse tests: does each relay driver do what it is told, and only it?
//!
//! The board reads the drivers' outputs back. At every tick they must be what the relays' command says. Besides, one
//! channel's drive is inverted for [`PULSE_LENGTH`](nearfield_shared::limits::PULSE_LENGTH), too short for the relay
//! to move; meanwhile that channel must follow and the other must not. A driver that is stuck high is found while the
//! relays are closed (it does not fall) and while they are open (it is high), two channels that are shorted to each
//! other by the one that moves along.
//!
//! ```text
//!            first tick            reading good, other channel's turn           both proven
//!  Pending(A) ---------> pulse A -------------------------------> pulse B ------------------> Good
//!                           |                                        |                          |
//!                           +----------- any wrong reading, or none -+--------------------------+--> Failed (for good)
//! ```
//!
//! Then a pulse every [`PULSE_PERIOD`], the channels in turn.

use nearfield_shared::condition::Channels;
use nearfield_shared::limits::PULSE_PERIOD;
use nearfield_shared::units::Micros;

/// One of the two channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Channel A.
    A,
    /// Channel B.
    B,
}

impl Channel {
    const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }

    /// These channels with this one inverted.
    #[must_use]
    pub const fn inverted_in(self, channels: Channels) -> Channels {
        match self {
            Self::A => Channels { a: !channels.a, b: channels.b },
            Self::B => Channels { a: channels.a, b: !channels.b },
        }
    }
}

/// What the board read back during a pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PulseReadback {
    /// The channel whose drive was inverted.
    pub channel: Channel,
    /// The drivers' outputs at the end of the pulse; true = driven.
    pub coils: Channels,
}

/// What the tests say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputVerdict {
    /// Not both channels have been tested yet.
    Pending,
    /// Both follow.
    Good,
    /// One does not, or two move as one; for good.
    Failed,
}

/// Ticks in a row in which the steady read-back may be wrong. Reason: the command can change between two ticks.
const MOST_WRONG_TICKS: u8 = 1;

/// Tests the outputs; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputTest {
    verdict: OutputVerdict,
    turn: Channel,
    /// The pulse that was asked for in the last tick, and what the coils must read during it.
    awaited: Option<PulseReadback>,
    last_pulse: Option<Micros>,
    wrong_ticks: u8,
}

impl OutputTest {
    /// Nothing is tested yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            verdict: OutputVerdict::Pending,
            turn: Channel::A,
            awaited: None,
            last_pulse: None,
            wrong_ticks: 0,
        }
    }

    /// Judges what was read back since the last tick: the steady level of the coils against their command, and the
    /// pulse that was asked for.
    pub fn check(
        &mut self,
        command: Channels,
        coils: Channels,
        pulse: Option<PulseReadback>,
    ) -> OutputVerdict {
        self.wrong_ticks = if coils == command { 0 } else { self.wrong_ticks.saturating_add(1) };
        let awaited = self.awaited.take();
        if self.wrong_ticks > MOST_WRONG_TICKS || pulse != awaited {
            self.verdict = OutputVerdict::Failed;
        } else if let Some(pulse) = awaited {
            self.turn = pulse.channel.other();
            if pulse.channel == Channel::B && self.verdict == OutputVerdict::Pending {
                self.verdict = OutputVerdict::Good;
            }
        }
        self.verdict
    }

    /// The pulse to apply in this tick, while the coils are driven like this.
    pub fn next_pulse(&mut self, now: Micros, command: Channels) -> Option<Channel> {
        let due = match self.verdict {
            OutputVerdict::Pending => true,
            OutputVerdict::Good => self.last_pulse.is_none_or(|last| now.since(last) >= PULSE_PERIOD),
            OutputVerdict::Failed => false,
        };
        if !due {
            return None;
        }
        self.last_pulse = Some(now);
        self.awaited = Some(PulseReadback { channel: self.turn, coils: self.turn.inverted_in(command) });
        Some(self.turn)
    }

    /// What it rests on, for the check of the controller's memory.
    pub(crate) fn words(&self) -> [u64; 3] {
        let verdict = match self.verdict {
            OutputVerdict::Pending => 0x0F,
            OutputVerdict::Good => 0x33,
            OutputVerdict::Failed => 0x55,
        };
        let bits = |coils: Channels| u64::from(coils.a) | (u64::from(coils.b) << 1);
        let turn = |channel: Channel| u64::from(channel == Channel::A) << 2;
        let awaited = self.awaited.map_or(u64::MAX, |pulse| turn(pulse.channel) | bits(pulse.coils));
        let state = verdict | (u64::from(self.wrong_ticks) << 8) | (turn(self.turn) << 16);
        [state, awaited, self.last_pulse.map_or(u64::MAX, Micros::get)]
    }
}

impl Default for OutputTest {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is wrong with the output stage.
    #[derive(Clone, Copy, PartialEq)]
    enum Wrong {
        Nothing,
        StuckHigh(Channel),
        StuckLow(Channel),
        Shorted,
        NoReadback,
    }

    fn coils(wrong: Wrong, drive: Channels) -> Channels {
        match wrong {
            Wrong::Nothing | Wrong::NoReadback => drive,
            Wrong::StuckHigh(Channel::A) => Channels { a: true, ..drive },
            Wrong::StuckHigh(Channel::B) => Channels { b: true, ..drive },
            Wrong::StuckLow(Channel::A) => Channels { a: false, ..drive },
            Wrong::StuckLow(Channel::B) => Channels { b: false, ..drive },
            Wrong::Shorted => Channels { a: drive.a || drive.b, b: drive.a || drive.b },
        }
    }

    struct Bench {
        test: OutputTest,
        now: Micros,
        pulse: Option<PulseReadback>,
        pulses: Vec<(u64, Channel)>,
    }

    impl Bench {
        fn new() -> Self {
            Self { test: OutputTest::new(), now: Micros::ZERO, pulse: None, pulses: Vec::new() }
        }

        fn tick(&mut self, command: Channels, wrong: Wrong) -> OutputVerdict {
            let verdict = self.test.check(command, coils(wrong, command), self.pulse.take());
            if let Some(channel) = self.test.next_pulse(self.now, command) {
                self.pulses.push((self.now.get(), channel));
                if wrong != Wrong::NoReadback {
                    let coils = coils(wrong, channel.inverted_in(command));
                    self.pulse = Some(PulseReadback { channel, coils });
                }
            }
            self.now = self.now.plus(Micros::from_millis(5));
            verdict
        }

        fn proven() -> Self {
            let mut bench = Self::new();
            assert_eq!(
                [0; 3].map(|_| bench.tick(Channels::OPEN, Wrong::Nothing)),
                [OutputVerdict::Pending, OutputVerdict::Pending, OutputVerdict::Good]
            );
            bench
        }
    }

    #[test]
    fn both_channels_are_proven_at_start_and_then_in_turn_once_a_period() {
        let mut bench = Bench::proven();
        for _ in 0..1_000 {
            assert_eq!(bench.tick(Channels::CLOSED, Wrong::Nothing), OutputVerdict::Good);
        }
        assert_eq!(bench.pulses[..2], [(0, Channel::A), (5_000, Channel::B)]);
        let channels: Vec<_> = bench.pulses.iter().map(|(_, channel)| *channel).collect();
        assert!(channels.windows(2).all(|pair| pair[0] != pair[1]), "in turn");
        assert!(bench.pulses[1..].windows(2).all(|pair| pair[1].0 - pair[0].0 == PULSE_PERIOD.get()));
        assert_eq!(bench.pulses.len(), 12, "two at start, ten in five seconds");
    }

    #[test]
    fn every_fault_is_found_at_start() {
        let faults = [
            Wrong::StuckHigh(Channel::A),
            Wrong::StuckHigh(Channel::B),
            Wrong::StuckLow(Channel::A),
            Wrong::StuckLow(Channel::B),
            Wrong::Shorted,
            Wrong::NoReadback,
        ];
        for wrong in faults {
            let mut bench = Bench::new();
            let verdicts = [0; 4].map(|_| bench.tick(Channels::OPEN, wrong));
            assert_eq!(verdicts[3], OutputVerdict::Failed);
            assert!(!verdicts.contains(&OutputVerdict::Good));
        }
    }

    #[test]
    fn every_fault_is_found_while_running_within_two_periods() {
        let faults = [
            Wrong::StuckHigh(Channel::A),
            Wrong::StuckHigh(Channel::B),
            Wrong::StuckLow(Channel::A),
            Wrong::StuckLow(Channel::B),
            Wrong::Shorted,
            Wrong::NoReadback,
        ];
        for wrong in faults {
            for lead in 0..200 {
                let mut bench = Bench::proven();
                for _ in 0..lead {
                    bench.tick(Channels::CLOSED, Wrong::Nothing);
                }
                let start = bench.now;
                while bench.tick(Channels::CLOSED, wrong) != OutputVerdict::Failed {
                    assert!(bench.now.since(start).get() <= 2 * PULSE_PERIOD.get() + 10_000);
                }
                for _ in 0..300 {
                    assert_eq!(bench.tick(Channels::OPEN, Wrong::Nothing), OutputVerdict::Failed, "for good");
                }
            }
        }
    }

    #[test]
    fn a_wrong_level_may_last_one_tick_and_no_more() {
        let mut test = OutputTest::new();
        test.verdict = OutputVerdict::Good;
        assert_eq!(test.check(Channels::OPEN, Channels::CLOSED, None), OutputVerdict::Good);
        assert_eq!(test.check(Channels::OPEN, Channels::OPEN, None), OutputVerdict::Good);
        assert_eq!(test.check(Channels::OPEN, Channels::CLOSED, None), OutputVerdict::Good);
        assert_eq!(test.check(Channels::OPEN, Channels::CLOSED, None), OutputVerdict::Failed);
    }

    #[test]
    fn a_reading_that_nobody_asked_for_fails() {
        let mut test = OutputTest::new();
        let pulse = PulseReadback { channel: Channel::A, coils: Channels { a: true, b: false } };
        assert_eq!(test.check(Channels::OPEN, Channels::OPEN, Some(pulse)), OutputVerdict::Failed);
    }

    #[test]
    fn a_pulse_is_due_at_its_period_and_not_before() {
        let mut test = OutputTest { verdict: OutputVerdict::Good, ..OutputTest::new() };
        let start = Micros::from_millis(7);
        assert_eq!(test.next_pulse(start, Channels::OPEN), Some(Channel::A));
        for (change, due) in [(-1, None), (0, Some(Channel::A)), (1, Some(Channel::A))] {
            let now = Micros::new(start.plus(PULSE_PERIOD).get().saturating_add_signed(change));
            assert_eq!(test.clone().next_pulse(now, Channels::OPEN), due, "{change}");
        }
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let new = OutputTest::new;
        let pulse = |channel, a, b| Some(PulseReadback { channel, coils: Channels { a, b } });
        let mut all = vec![
            new(),
            OutputTest { verdict: OutputVerdict::Good, ..new() },
            OutputTest { verdict: OutputVerdict::Failed, ..new() },
            OutputTest { turn: Channel::B, ..new() },
            OutputTest { wrong_ticks: 1, ..new() },
            OutputTest { last_pulse: Some(Micros::ZERO), ..new() },
            OutputTest { last_pulse: Some(Micros::new(1)), ..new() },
        ];
        for channel in [Channel::A, Channel::B] {
            for (a, b) in [(false, false), (false, true), (true, false), (true, true)] {
                all.push(OutputTest { awaited: pulse(channel, a, b), ..new() });
            }
        }
        crate::testing::all_differ(all.iter().map(OutputTest::words));
    }
}
