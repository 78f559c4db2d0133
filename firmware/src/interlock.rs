//! The reset button: a person presses and lets go, within a time window, while a restart is on offer.
//!
//! ```text
//!              pressed while armed                   released within the window
//!  Released ------------------------> Pressed ------------------------------------> Released + reset
//!     ^  |                              |  |
//!     |  | pressed while not armed      |  | no longer armed, or held too long
//!     |  +-----------------> Void <-----+--+
//!     |                        |
//!     +------------------------+  released (no reset)
//! ```
//!
//! It starts in `Void`: a button that is held at power-up, taped down or short-circuited is no press. A press counts
//! only if all of it happens while the restart interlock waits for it, so nobody can press in advance.

use nearfield_shared::limits::{LONGEST_RESET_PRESS, SHORTEST_RESET_PRESS};
use nearfield_shared::units::Micros;

/// What the button has done so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Press {
    /// Not pressed.
    Released,
    /// Pressed while armed, since then.
    Pressed { since: Micros },
    /// Pressed, but this press does not count; since then (`None`: held since before the first step).
    Void { since: Option<Micros> },
}

/// What one step of the button means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ButtonReport {
    /// A whole, valid press has just ended.
    pub reset: bool,
    /// The button is held for longer than any press lasts.
    pub stuck: bool,
}

/// Watches the reset button; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ResetButton {
    press: Press,
}

impl ResetButton {
    /// Nothing is known about the button yet: what it does first is no press.
    #[must_use]
    pub const fn new() -> Self {
        Self { press: Press::Void { since: None } }
    }

    /// Takes the button's level; `armed` says that the restart interlock waits for a reset now.
    pub fn step(&mut self, now: Micros, pressed: bool, armed: bool) -> ButtonReport {
        let mut reset = false;
        self.press = match (self.press, pressed) {
            (Press::Released, false) => Press::Released,
            (Press::Released, true) if armed => Press::Pressed { since: now },
            (Press::Released, true) => Press::Void { since: Some(now) },
            (Press::Pressed { since }, true) if armed && now.since(since) <= LONGEST_RESET_PRESS => {
                Press::Pressed { since }
            }
            (Press::Pressed { since }, true) => Press::Void { since: Some(since) },
            (Press::Pressed { since }, false) => {
                let length = now.since(since);
                reset = armed && (SHORTEST_RESET_PRESS..=LONGEST_RESET_PRESS).contains(&length);
                Press::Released
            }
            (Press::Void { since }, true) => Press::Void { since: Some(since.unwrap_or(now)) },
            (Press::Void { .. }, false) => Press::Released,
        };
        ButtonReport { reset, stuck: self.is_stuck(now) }
    }

    /// With its times changed, for the model check.
    #[cfg(test)]
    pub(crate) fn aged(self, older: impl Fn(Micros) -> Micros) -> Self {
        let press = match self.press {
            Press::Released => Press::Released,
            Press::Pressed { since } => Press::Pressed { since: older(since) },
            Press::Void { since } => Press::Void { since: since.map(older) },
        };
        Self { press }
    }

    /// All of it, for the check of the controller's memory.
    pub(crate) fn words(&self) -> [u64; 2] {
        match self.press {
            Press::Released => [0x0F, 0],
            Press::Pressed { since } => [0x33, since.get()],
            Press::Void { since: Some(since) } => [0x55, since.get()],
            Press::Void { since: None } => [0x69, 0],
        }
    }

    fn is_stuck(&self, now: Micros) -> bool {
        match self.press {
            Press::Released | Press::Void { since: None } => false,
            Press::Pressed { since } | Press::Void { since: Some(since) } => {
                now.since(since) > LONGEST_RESET_PRESS
            }
        }
    }
}

impl Default for ResetButton {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(start: Micros, span: Micros, change: i64) -> Micros {
        Micros::new(start.plus(span).get().saturating_add_signed(change))
    }

    /// Presses for `span + change` microseconds while armed; is it a reset?
    fn press_of(span: Micros, change: i64) -> bool {
        let mut button = ResetButton::new();
        let start = Micros::new(1_000);
        assert_eq!(button.step(Micros::ZERO, false, true), ButtonReport::default());
        assert!(!button.step(start, true, true).reset);
        button.step(after(start, span, change), false, true).reset
    }

    #[test]
    fn a_press_must_last_at_least_the_shortest_time() {
        assert!(!press_of(SHORTEST_RESET_PRESS, -1));
        assert!(press_of(SHORTEST_RESET_PRESS, 0));
        assert!(press_of(SHORTEST_RESET_PRESS, 1));
    }

    #[test]
    fn a_press_must_last_no_longer_than_the_longest_time() {
        assert!(press_of(LONGEST_RESET_PRESS, -1));
        assert!(press_of(LONGEST_RESET_PRESS, 0));
        assert!(!press_of(LONGEST_RESET_PRESS, 1));
    }

    #[test]
    fn a_button_held_for_too_long_is_stuck_until_it_is_let_go() {
        let start = Micros::new(5_000);
        for armed in [true, false] {
            let mut button = ResetButton::new();
            button.step(Micros::ZERO, false, armed);
            button.step(start, true, armed);
            assert!(!button.step(after(start, LONGEST_RESET_PRESS, -1), true, armed).stuck);
            assert!(!button.step(after(start, LONGEST_RESET_PRESS, 0), true, armed).stuck);
            assert!(button.step(after(start, LONGEST_RESET_PRESS, 1), true, armed).stuck);
            let end = button.step(after(start, LONGEST_RESET_PRESS, 2), false, armed);
            assert_eq!(end, ButtonReport { reset: false, stuck: false });
        }
    }

    #[test]
    fn a_button_held_at_power_up_is_no_press_but_may_be_stuck() {
        let mut button = ResetButton::new();
        assert!(!button.step(Micros::ZERO, true, true).stuck);
        assert!(button.step(after(Micros::ZERO, LONGEST_RESET_PRESS, 1), true, true).stuck);
        let mut button = ResetButton::new();
        button.step(Micros::ZERO, true, true);
        assert!(!button.step(Micros::from_millis(200), false, true).reset);
        button.step(Micros::from_millis(300), true, true);
        assert!(button.step(Micros::from_millis(500), false, true).reset, "the next whole press counts");
    }

    #[test]
    fn a_press_that_began_before_the_interlock_waited_is_void() {
        let mut button = ResetButton::new();
        button.step(Micros::ZERO, false, false);
        button.step(Micros::from_millis(10), true, false);
        button.step(Micros::from_millis(20), true, true);
        assert!(!button.step(Micros::from_millis(300), false, true).reset);
    }

    #[test]
    fn a_press_during_which_the_interlock_stops_waiting_is_void() {
        let mut button = ResetButton::new();
        button.step(Micros::ZERO, false, true);
        button.step(Micros::from_millis(10), true, true);
        button.step(Micros::from_millis(20), true, false);
        button.step(Micros::from_millis(30), true, true);
        assert!(!button.step(Micros::from_millis(300), false, true).reset);
        let mut button = ResetButton::new();
        button.step(Micros::ZERO, false, true);
        button.step(Micros::from_millis(10), true, true);
        assert!(!button.step(Micros::from_millis(300), false, false).reset, "released when nothing waits");
    }

    #[test]
    fn a_clock_that_runs_backwards_gives_no_reset() {
        let mut button = ResetButton::new();
        button.step(Micros::from_millis(1000), false, true);
        button.step(Micros::from_millis(1000), true, true);
        assert!(!button.step(Micros::from_millis(500), false, true).reset);
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let (early, late) = (Micros::new(5), Micros::new(6));
        let all = [
            Press::Released,
            Press::Pressed { since: early },
            Press::Pressed { since: late },
            Press::Void { since: Some(early) },
            Press::Void { since: Some(late) },
            Press::Void { since: None },
        ];
        crate::testing::all_differ(all.map(|press| ResetButton { press }.words()));
    }
}
