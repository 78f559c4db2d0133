//! When the relays may be closed, written down a second time, in other words than the controller's own.

use super::inputs::{Host, Robot};
use nearfield_firmware::safety::{Outputs, PinInputs};
use nearfield_shared::limits::{
    FEEDBACK_DISCREPANCY, LINK_TIMEOUT, LONGEST_TICK_PERIOD, SHORTEST_RESET_PRESS,
};
use nearfield_shared::status::{Channels, StateCode};
use nearfield_shared::units::Micros;

/// After what the outputs are judged.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum After {
    Start,
    Exchange,
    Tick,
}

impl After {
    const fn name(self) -> &'static str {
        match self {
            Self::Start => "the start",
            Self::Exchange => "an exchange",
            Self::Tick => "a tick",
        }
    }
}

/// The rule's own memory: why the relays may be closed.
#[derive(Default)]
pub(super) struct Grounds {
    /// When the last line-scan came that a strict reader believes, and whether its floor was free.
    proof: Option<(Micros, bool)>,
    /// Since the relays were last commanded open: was the button pressed and let go in time? was the laser dark?
    pressed_since: Option<Micros>,
    released: bool,
    dark: bool,
    /// The button has been seen up since the start.
    seen_up: bool,
    was_closed: bool,
    last_tick: Option<Micros>,
    /// Since when a contact has differed from the command.
    contact_lies_since: Option<Micros>,
    self_test_failed: bool,
}

impl Grounds {
    /// Takes down what this host's message says of the floor.
    pub(super) fn note_message(&mut self, now: Micros, host: Host) {
        if host.may_prove_free_floor() {
            self.proof = Some((now, true));
        } else if matches!(host, Host::Objects | Host::ShowsCut) {
            // One such line-scan stops at once.
            self.proof = Some((now, false));
        }
    }

    /// Takes down what speaks for closed relays, from the inputs alone, before the controller sees them.
    pub(super) fn note_pins(&mut self, now: Micros, robot: Robot, pins: &PinInputs, commanded: Outputs) {
        match (pins.reset_pressed, self.pressed_since) {
            (true, None) if self.seen_up => self.pressed_since = Some(now),
            (false, Some(since)) => {
                self.released |= now.since(since) >= SHORTEST_RESET_PRESS;
                self.pressed_since = None;
            }
            _ => {}
        }
        self.seen_up |= !pins.reset_pressed;
        self.dark |= self.released && commanded.laser_level == 0;
        self.self_test_failed |= robot == Robot::SelfTestFailed;
        let lies = pins.mirror.main_contacts() != commanded.relays;
        self.contact_lies_since = if lies { self.contact_lies_since.or(Some(now)) } else { None };
    }

    /// Panics where the relays are closed without reason; tells whether they are closed.
    pub(super) fn judge(&mut self, now: Micros, after: After, outputs: Outputs, state: StateCode) -> bool {
        let closed = outputs.relays != Channels::OPEN;
        let late = self.last_tick.is_some_and(|before| {
            let period = now.since(before);
            period > LONGEST_TICK_PERIOD || period == Micros::ZERO
        });
        if after == After::Tick {
            self.last_tick = Some(now);
        }
        if closed {
            let why = |broken: &str| panic!("closed after {} at {now:?} {broken}", after.name());
            if after == After::Exchange {
                self.judge_exchange(&why);
            } else {
                self.judge_tick(now, late, &why);
            }
            assert_eq!(outputs.relays, Channels::CLOSED, "one channel alone");
            if after == After::Tick {
                assert_eq!(state, StateCode::Running, "in another state than running");
            }
        } else if self.was_closed {
            // Whatever stopped it, only a new press and a new dark test lead back.
            (self.released, self.dark) = (false, false);
        }
        self.was_closed = closed;
        closed
    }

    /// Between the ticks time is not looked at, but an exchange may only open, and must where one look is enough.
    fn judge_exchange(&self, why: &dyn Fn(&str)) {
        if !self.was_closed {
            why("which may only open");
        }
        if self.proof.is_some_and(|(_, free)| !free) {
            why("although the message itself demands a stop");
        }
    }

    fn judge_tick(&self, now: Micros, late: bool, why: &dyn Fn(&str)) {
        match self.proof {
            Some((at, true)) if now.since(at) <= LINK_TIMEOUT => {}
            found => why(&format!("without fresh proof of a free floor: {found:?}")),
        }
        if !(self.was_closed || self.released && self.dark) {
            why("without a press of the button and a dark test");
        }
        if late {
            why("that is late or too early");
        }
        if self.self_test_failed {
            why("after a failed self-test");
        }
        if self.contact_lies_since.is_some_and(|since| now.since(since) > FEEDBACK_DISCREPANCY) {
            why("while a contact lies");
        }
    }
}
