//! Program-flow monitoring: the safety task must run whole, in order and on time, or no watchdog is fed.
//!
//! Every tick passes the [`Checkpoint`]s in their order. Only then does [`FlowMonitor::finish`] hand out a
//! [`FeedPermit`], and only a permit feeds a watchdog: there is no other way to make one, and it is used up.

use nearfield_shared::limits::{LONGEST_TICK_PERIOD, SHORTEST_TICK_PERIOD};
use nearfield_shared::units::Micros;

/// What every tick does, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Checkpoint {
    /// The memory that the decision rests on, and the self-tests' word, were judged.
    Memory,
    /// Contacts, drivers and button were read and judged.
    Inputs,
    /// The link's age was judged.
    Link,
    /// The supervisor has decided.
    Decision,
    /// The relays' command was set and read back from memory.
    Command,
}

/// Permission to feed the watchdogs once. Only a complete, in-order, on-time tick makes one.
///
/// ```compile_fail
/// let forged = nearfield_firmware::flow::FeedPermit(());
/// ```
/// ```compile_fail
/// fn feed_twice(permit: nearfield_firmware::flow::FeedPermit) -> [nearfield_firmware::flow::FeedPermit; 2] {
///     [permit.clone(), permit]
/// }
/// ```
#[derive(Debug, PartialEq, Eq)]
#[must_use = "a permit that feeds no watchdog lets it bite"]
pub struct FeedPermit(());

/// How far the tick has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    /// No tick is under way.
    Idle,
    /// Begun on time; no checkpoint passed yet.
    Begun,
    /// This one was passed last.
    Passed(Checkpoint),
    /// Late, or out of order: this tick yields no permit.
    Broken,
}

/// Watches one task; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FlowMonitor {
    progress: Progress,
    last_begin: Option<Micros>,
}

impl FlowMonitor {
    /// No tick yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { progress: Progress::Idle, last_begin: None }
    }

    /// A tick begins. It must do so neither too long after the one before (deadline) nor at once again (a clock that
    /// stands still would make everything look fresh for ever), and the one before must have finished.
    pub fn begin(&mut self, now: Micros) {
        let on_time = match self.last_begin {
            None => true,
            Some(before) => (SHORTEST_TICK_PERIOD..=LONGEST_TICK_PERIOD).contains(&now.since(before)),
        };
        self.progress =
            if on_time && self.progress == Progress::Idle { Progress::Begun } else { Progress::Broken };
        self.last_begin = Some(now);
    }

    /// The task passes a checkpoint.
    pub fn pass(&mut self, checkpoint: Checkpoint) {
        let in_order = match checkpoint {
            Checkpoint::Memory => self.progress == Progress::Begun,
            Checkpoint::Inputs => self.progress == Progress::Passed(Checkpoint::Memory),
            Checkpoint::Link => self.progress == Progress::Passed(Checkpoint::Inputs),
            Checkpoint::Decision => self.progress == Progress::Passed(Checkpoint::Link),
            Checkpoint::Command => self.progress == Progress::Passed(Checkpoint::Decision),
        };
        self.progress = if in_order { Progress::Passed(checkpoint) } else { Progress::Broken };
    }

    /// When the last tick began.
    #[must_use]
    pub const fn last_begin(&self) -> Option<Micros> {
        self.last_begin
    }

    /// Is this tick on time and in order so far?
    #[must_use]
    pub fn is_intact(&self) -> bool {
        self.progress != Progress::Broken
    }

    /// The tick ends.
    pub fn finish(&mut self) -> Option<FeedPermit> {
        let complete = self.progress == Progress::Passed(Checkpoint::Command);
        self.progress = Progress::Idle;
        complete.then_some(FeedPermit(()))
    }
}

impl Default for FlowMonitor {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORDER: [Checkpoint; 5] =
        [Checkpoint::Memory, Checkpoint::Inputs, Checkpoint::Link, Checkpoint::Decision, Checkpoint::Command];

    fn tick(monitor: &mut FlowMonitor, now: Micros, checkpoints: &[Checkpoint]) -> bool {
        monitor.begin(now);
        for checkpoint in checkpoints {
            monitor.pass(*checkpoint);
        }
        monitor.finish().is_some()
    }

    fn second_tick_after(period: Micros, change: i64) -> bool {
        let mut monitor = FlowMonitor::new();
        let start = Micros::new(123);
        assert!(tick(&mut monitor, start, &ORDER));
        tick(&mut monitor, Micros::new(start.plus(period).get().saturating_add_signed(change)), &ORDER)
    }

    #[test]
    fn a_tick_may_be_late_by_no_more_than_the_deadline() {
        assert!(second_tick_after(LONGEST_TICK_PERIOD, -1));
        assert!(second_tick_after(LONGEST_TICK_PERIOD, 0));
        assert!(!second_tick_after(LONGEST_TICK_PERIOD, 1));
    }

    #[test]
    fn a_clock_that_stands_still_or_runs_backwards_yields_no_permit() {
        assert!(!second_tick_after(SHORTEST_TICK_PERIOD, -1));
        assert!(second_tick_after(SHORTEST_TICK_PERIOD, 0));
        assert!(second_tick_after(SHORTEST_TICK_PERIOD, 1));
        assert!(!second_tick_after(Micros::ZERO, 0));
        assert!(!second_tick_after(Micros::ZERO, -1));
    }

    #[test]
    fn the_last_beginning_is_kept_for_the_memory_check() {
        let mut monitor = FlowMonitor::new();
        assert_eq!(monitor.last_begin(), None);
        monitor.begin(Micros::new(7));
        assert_eq!(monitor.last_begin(), Some(Micros::new(7)));
    }

    /// Of all sequences of up to six checkpoints exactly one yields a permit.
    #[test]
    fn only_the_complete_sequence_in_order_yields_a_permit() {
        let mut permitted = Vec::new();
        for length in 0..=6_u32 {
            for code in 0..5_usize.pow(length) {
                let sequence: Vec<_> =
                    (0..length).map(|place| ORDER[code / 5_usize.pow(place) % 5]).collect();
                if tick(&mut FlowMonitor::new(), Micros::ZERO, &sequence) {
                    permitted.push(sequence);
                }
            }
        }
        assert_eq!(permitted, [ORDER.to_vec()]);
    }

    #[test]
    fn a_tick_that_was_not_begun_or_not_finished_spoils_the_permit() {
        let mut monitor = FlowMonitor::new();
        for checkpoint in ORDER {
            monitor.pass(checkpoint);
        }
        assert!(monitor.finish().is_none(), "never begun");
        monitor.begin(Micros::ZERO);
        monitor.begin(Micros::from_millis(5));
        assert!(!monitor.is_intact(), "the tick before never finished");
        for checkpoint in ORDER {
            monitor.pass(checkpoint);
        }
        assert!(monitor.finish().is_none());
        assert!(tick(&mut monitor, Micros::from_millis(10), &ORDER), "the next whole tick is good again");
    }
}
