//! The trials on the floor, step by step, for a person: told what is seen, it says what to do next. It asks nobody to confirm
//! anything and presses no button: a step ends when it is seen to be done, or when the patience for it has run out.
//!
//! ```text
//! keep clear, press -> closed for a while -> { lay -> open -> take away -> open for a while -> press -> closed } for each place
//! ```

use nearfield_shared::units::Micros;

use crate::trial::{FROM_END_MM, STILL, Trial};
use crate::{Check, Section};

/// What is seen at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// The moment, on one clock with `exposed`.
    pub now: Micros,
    /// Middle of the newest picture's exposure.
    pub exposed: Micros,
    /// Are the contacts closed?
    pub relay_closed: bool,
    /// Was there a picture?
    pub picture: bool,
    /// The longest gap of this picture alone that is too long: its middle and length, millimetres.
    pub gap: Option<(f64, f64)>,
}

/// What a person is to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ask {
    /// Take everything off the stripe, keep clear, press the reset button.
    ClearAndPress,
    /// Wait: nothing may happen for a while.
    Wait,
    /// Lay the test piece across the stripe there, millimetres along it.
    Lay(f64),
    /// Take it away; do not press the button yet.
    TakeAway,
    /// Press the reset button.
    Press,
    /// Nothing: all is done.
    Nothing,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    /// Until the relays are closed over a clean floor.
    Arm,
    /// They must stay closed.
    Armed,
    /// Until the piece has opened them.
    Lay,
    /// Until the floor is clean again.
    TakeAway,
    /// They must stay open.
    Still,
    /// Until the button has closed them.
    Press,
    Done,
}

/// Names of the three places.
const PLACES: [&str; 3] = ["near end", "middle", "far end"];

/// See the module's documentation.
#[derive(Debug, Clone)]
pub struct Walk {
    piece_mm: f64,
    worst_ms: f64,
    /// A person gets so long for each thing.
    patience: Micros,
    places: [f64; 3],
    step: Step,
    /// When the step began; `None` = with the next observation.
    since: Option<Micros>,
    armed: Option<bool>,
    trials: Vec<Trial>,
    /// The trial that goes on.
    current: Trial,
    /// Exposure of the first picture with a gap that is too long.
    first: Option<Micros>,
}

impl Walk {
    /// For a stripe from `stripe_mm[0]` to `stripe_mm[1]`, a rod of `piece_mm`, and relays that must open within `worst_ms`.
    #[must_use]
    pub fn new(stripe_mm: [f64; 2], piece_mm: f64, worst_ms: f64, patience: Micros) -> Self {
        let [start, end] = stripe_mm;
        let places = [start + FROM_END_MM, f64::midpoint(start, end), end - FROM_END_MM];
        Self {
            piece_mm,
            worst_ms,
            patience,
            places,
            step: Step::Arm,
            since: None,
            armed: None,
            trials: Vec::with_capacity(places.len()),
            current: untried(places[0]),
            first: None,
        }
    }

    /// What to do now.
    #[must_use]
    pub const fn asks(&self) -> Ask {
        match self.step {
            Step::Arm => Ask::ClearAndPress,
            Step::Armed | Step::Still => Ask::Wait,
            Step::Lay => Ask::Lay(self.current.wanted_mm),
            Step::TakeAway => Ask::TakeAway,
            Step::Press => Ask::Press,
            Step::Done => Ask::Nothing,
        }
    }

    /// Is all done?
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.step == Step::Done
    }

    /// Places tried so far, of how many.
    #[must_use]
    pub fn progress(&self) -> (usize, usize) {
        (self.trials.len(), self.places.len())
    }

    /// Takes what is seen.
    pub fn observe(&mut self, seen: &Observation) {
        let since = *self.since.get_or_insert(seen.now);
        let waited = seen.now.since(since);
        let (out_of_patience, still) = (waited >= self.patience, waited >= STILL);
        match self.step {
            Step::Arm if seen.relay_closed => self.go(Step::Armed),
            Step::Arm if out_of_patience => self.armed(false),
            // What opens them over a clean floor is a failure, not a trial.
            Step::Armed if !seen.relay_closed => self.armed(false),
            Step::Armed if still => self.armed(true),
            Step::Lay => self.lay(seen, out_of_patience),
            Step::TakeAway if (seen.picture && seen.gap.is_none()) || out_of_patience => self.go(Step::Still),
            Step::Still if seen.relay_closed => self.went_on(false),
            Step::Still if still => self.went_on(true),
            Step::Press if seen.relay_closed => self.tried(true),
            Step::Press if out_of_patience => self.tried(false),
            _ => {}
        }
    }

    fn go(&mut self, step: Step) {
        (self.step, self.since) = (step, None);
    }

    /// Without relays that close and stay closed there is nothing to try.
    fn armed(&mut self, armed: bool) {
        self.armed = Some(armed);
        self.go(if armed { Step::Lay } else { Step::Done });
    }

    fn lay(&mut self, seen: &Observation, out_of_patience: bool) {
        if let Some((middle, length)) = seen.gap {
            self.first.get_or_insert(seen.exposed);
            (self.current.seen_mm, self.current.gap_mm) = (Some(middle), length);
        }
        if !seen.relay_closed {
            // Not opened by the piece: something else did.
            self.current.opened_after = self.first.map(|first| seen.now.since(first));
        } else if !out_of_patience {
            return;
        }
        self.go(Step::TakeAway);
    }

    fn went_on(&mut self, stayed_open: bool) {
        self.current.stayed_open = stayed_open;
        self.go(Step::Press);
    }

    fn tried(&mut self, closed_again: bool) {
        self.trials.push(Trial { closed_again, ..self.current });
        self.first = None;
        match self.places.get(self.trials.len()) {
            // Who does not close again cannot be opened.
            Some(place) if closed_again => {
                self.current = untried(*place);
                self.go(Step::Lay);
            }
            _ => self.go(Step::Done),
        }
    }

    /// What was found so far. A walk that was not finished is not passed.
    #[must_use]
    pub fn section(&self) -> Section {
        let found = match self.armed {
            Some(true) => "closed, and stayed closed",
            Some(false) => "not so",
            None => "not tried",
        };
        let armed = self.armed == Some(true);
        let mut checks =
            vec![Check::new("Clean floor", "relays close after the button, and stay closed", found, armed)];
        for (index, (name, place)) in PLACES.iter().zip(self.places).enumerate() {
            match self.trials.get(index) {
                Some(trial) => checks.extend(trial.checks(name, self.piece_mm, self.worst_ms)),
                None => checks.push(Check::new(
                    format!("Rod of {} mm, {name}", self.piece_mm),
                    format!("tried at {place:.0} mm"),
                    "not tried",
                    false,
                )),
            }
        }
        Section { title: "On the floor".to_owned(), checks }
    }
}

const fn untried(wanted_mm: f64) -> Trial {
    Trial {
        wanted_mm,
        seen_mm: None,
        gap_mm: 0.0,
        opened_after: None,
        stayed_open: false,
        closed_again: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Micros = Micros::from_millis(20);
    const AGE: Micros = Micros::from_millis(25);

    /// A floor, a controller and a person who does what is asked, after a while; each of them may be told to fail.
    #[derive(Default)]
    struct World {
        now: u64,
        closed: bool,
        piece: Option<f64>,
        asked: Option<(Ask, u64)>,
        /// Relays close by themselves when the piece is gone.
        restarts: bool,
        /// Relays do not open.
        stuck: bool,
        /// From the gap to open contacts, milliseconds.
        delay: u64,
        gap_since: Option<u64>,
        never_presses: bool,
        lays_beside: bool,
    }

    impl World {
        fn step(&mut self, ask: Ask) -> Observation {
            self.now += PERIOD.get() / 1000;
            if self.asked.is_none_or(|(known, _)| known != ask) {
                self.asked = Some((ask, self.now));
            }
            let ready = self.asked.is_some_and(|(_, since)| self.now - since >= 1500);
            match ask {
                Ask::Lay(place) if ready => {
                    self.piece = Some(if self.lays_beside { place + 200.0 } else { place })
                }
                Ask::TakeAway if ready => self.piece = None,
                Ask::ClearAndPress | Ask::Press if ready && !self.never_presses && self.piece.is_none() => {
                    self.closed = true;
                }
                _ => {}
            }
            self.gap_since = self.piece.map(|_| self.gap_since.unwrap_or(self.now));
            match self.gap_since {
                Some(since) if self.now - since >= self.delay && !self.stuck => self.closed = false,
                None if self.restarts && ask == Ask::Wait => self.closed = true,
                _ => {}
            }
            let now = Micros::from_millis(self.now);
            Observation {
                now,
                exposed: now.since(AGE),
                relay_closed: self.closed,
                picture: true,
                gap: self.piece.map(|piece| (piece, 30.0)),
            }
        }
    }

    fn walked(mut world: World) -> (Walk, Vec<Ask>) {
        let mut walk = Walk::new([-400.0, 400.0], 12.0, 100.0, Micros::from_millis(10_000));
        let mut asked = Vec::new();
        for _ in 0..20_000 {
            if asked.last() != Some(&walk.asks()) {
                asked.push(walk.asks());
            }
            if walk.is_done() {
                break;
            }
            let seen = world.step(walk.asks());
            walk.observe(&seen);
        }
        assert!(walk.is_done(), "{walk:?}");
        (walk, asked)
    }

    fn failed(world: World) -> Vec<String> {
        let checks = walked(world).0.section().checks;
        checks.into_iter().filter(|check| !check.passed).map(|check| check.found).collect()
    }

    #[test]
    fn a_person_is_led_from_place_to_place_and_a_sound_sensor_passes() {
        let (walk, asked) = walked(World { delay: 60, ..World::default() });
        let place = |place| [Ask::Lay(place), Ask::TakeAway, Ask::Wait, Ask::Press];
        let expected: Vec<Ask> = [Ask::ClearAndPress, Ask::Wait]
            .into_iter()
            .chain([-340.0, 0.0, 340.0].into_iter().flat_map(place))
            .chain([Ask::Nothing])
            .collect();
        assert_eq!(asked, expected);
        let checks = walk.section().checks;
        assert_eq!(checks.len(), 10);
        assert!(checks.iter().all(|check| check.passed), "{checks:?}");
        // From the light, not from when it was told.
        assert_eq!(checks[2].found, "85 ms");
    }

    #[test]
    fn each_failure_is_found() {
        let slow = failed(World { delay: 80, ..World::default() });
        assert_eq!(slow, ["105 ms", "105 ms", "105 ms"]);
        let restarting = failed(World { restarts: true, ..World::default() });
        assert!(restarting.iter().all(|found| found.starts_with("closed by themselves")), "{restarting:?}");
        assert_eq!(restarting.len(), 3);
        let beside = failed(World { lays_beside: true, ..World::default() });
        assert_eq!(beside[0], "a gap of 30.0 mm at -140 mm");
        let stuck = failed(World { stuck: true, ..World::default() });
        assert!(stuck.iter().any(|found| found == "they did not open for it"), "{stuck:?}");
    }

    #[test]
    fn what_was_not_tried_is_not_passed() {
        let never = failed(World { never_presses: true, ..World::default() });
        assert_eq!(never, ["not so", "not tried", "not tried", "not tried"]);
        let unfinished = Walk::new([-400.0, 400.0], 12.0, 100.0, Micros::from_millis(10_000)).section();
        assert!(unfinished.checks.iter().all(|check| !check.passed));
    }
}
