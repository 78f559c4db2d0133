//! A commissioning's trials on the floor: a test piece is laid, the relays must open in time; it is taken away, and they must
//! stay open until the button is pressed.
//!
//! The trial watches pictures and controller by itself and asks nobody to confirm anything: [`Hands`] are told what to do next,
//! a person by words, the twin by another scene, and the next step begins when it is seen to be done.

use std::time::Duration;

use nearfield_commissioning::Trial;
use nearfield_fusion::Motion;
use nearfield_shared::limits::LONGEST_ALLOWED_GAP;
use nearfield_shared::units::Micros;

use super::supervised::{Got, Supervised};
use super::{Controller, StripePath};

/// Who lays and takes things, and presses the button.
pub trait Hands<C> {
    /// Lay the test piece across the stripe at this place (millimetres along it), or (`None`) take everything away. A source that
    /// shows it from now on, if pictures come from elsewhere then.
    ///
    /// # Errors
    /// It cannot be done.
    fn lay(&mut self, place_mm: Option<f64>) -> anyhow::Result<Option<Supervised>>;

    /// Press and release the reset button; asked for in every frame period until the relays are closed.
    fn press(&mut self, controller: &mut C);

    /// The laser's mean drive over an exposure, by its middle and length.
    fn drive(&mut self, controller: &mut C, exposed: Micros, exposure: Micros) -> f32;
}

/// How long people get for one thing to do, and how long nothing may happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience {
    /// For a person.
    pub hand: Micros,
    /// The relays must stay as they are for so long.
    pub still: Micros,
}

/// What one picture has shown.
#[derive(Debug, Clone, Copy)]
struct Seen {
    exposed: Micros,
    now: Micros,
    relay_closed: bool,
    /// The longest gap of this picture alone: middle and length, millimetres; none up to the allowed length.
    gap: Option<(f64, f64)>,
    /// Was there a picture?
    picture: bool,
}

/// See the module's documentation.
pub struct Site<C> {
    /// The stripe's path.
    pub path: StripePath<C>,
    /// Where pictures come from.
    pub source: Supervised,
    /// Frame periods are kept in real time if this is set; simulated controllers need no time.
    pub period: Option<Duration>,
}

impl<C: Controller> Site<C> {
    /// A clean floor: the relays close after the button, and stay closed.
    ///
    /// # Errors
    /// The hands cannot do it.
    pub fn arm(&mut self, hands: &mut impl Hands<C>, patience: Patience) -> anyhow::Result<bool> {
        self.take(hands, None)?;
        self.path.wait_for_first_exposure()?;
        let closed = self.watch(hands, patience.hand, true, |seen| seen.relay_closed);
        Ok(closed.is_some() && self.watch(hands, patience.still, false, |seen| !seen.relay_closed).is_none())
    }

    /// The test piece at one place, from closed relays to closed relays.
    ///
    /// # Errors
    /// The hands cannot do it.
    pub fn trial(
        &mut self,
        hands: &mut impl Hands<C>,
        wanted_mm: f64,
        patience: Patience,
    ) -> anyhow::Result<Trial> {
        self.take(hands, Some(wanted_mm))?;
        let mut first: Option<(Micros, f64, f64)> = None;
        let opened = self.watch(hands, patience.hand, false, |seen| {
            if let Some((middle, length)) = seen.gap {
                let begun = first.map_or(seen.exposed, |(begun, ..)| begun);
                first = Some((begun, middle, length));
            }
            !seen.relay_closed
        });
        // Not opened by the piece: something else did, or nothing.
        let opened_after = opened.zip(first).map(|(seen, (begun, ..))| seen.now.since(begun));
        self.take(hands, None)?;
        // Until the floor is clean again, then for a while: a hand that lets go takes its time.
        self.watch(hands, patience.hand, false, |seen| seen.picture && seen.gap.is_none());
        let stayed_open = self.watch(hands, patience.still, false, |seen| seen.relay_closed).is_none();
        let closed_again = self.watch(hands, patience.hand, true, |seen| seen.relay_closed).is_some();
        Ok(Trial {
            wanted_mm,
            seen_mm: first.map(|(_, middle, _)| middle),
            gap_mm: first.map_or(0.0, |(.., length)| length),
            opened_after,
            stayed_open,
            closed_again,
        })
    }

    fn take(&mut self, hands: &mut impl Hands<C>, place_mm: Option<f64>) -> anyhow::Result<()> {
        if let Some(source) = hands.lay(place_mm)? {
            self.source = source;
        }
        Ok(())
    }

    /// Until `done`, or for so long; `None` = it was not done.
    fn watch(
        &mut self,
        hands: &mut impl Hands<C>,
        longest: Micros,
        press: bool,
        mut done: impl FnMut(&Seen) -> bool,
    ) -> Option<Seen> {
        let end = self.path.controller().now().plus(longest);
        while self.path.controller().now() < end {
            let begun = std::time::Instant::now();
            if press {
                hands.press(self.path.controller());
            }
            let seen = self.picture(hands);
            if done(&seen) {
                return Some(seen);
            }
            if let Some(period) = self.period {
                std::thread::sleep(period.saturating_sub(begun.elapsed()));
            }
        }
        None
    }

    fn picture(&mut self, hands: &mut impl Hands<C>) -> Seen {
        let facts = self.path.usual();
        let mut exposed = self.path.controller().now().since(facts.capture_age);
        let drive = hands.drive(self.path.controller(), exposed, facts.exposure);
        // What fails here is a picture that was not seen: the controller stops by itself, and the trial is not passed.
        let picture = match self.source.next(drive) {
            Got::Picture(frame, age) => {
                exposed = age.map_or(exposed, |age| self.path.controller().now().since(age));
                self.path.step(frame, exposed, &Motion::default()).is_ok()
            }
            Got::Nothing | Got::Broken(_) => {
                let _ = self.path.skip();
                false
            }
        };
        let gap =
            self.path.analyser().report().cutoff.single.filter(|gap| gap.length() > LONGEST_ALLOWED_GAP);
        let controller = self.path.controller();
        Seen {
            exposed,
            now: controller.now(),
            relay_closed: controller.is_circuit_closed(),
            gap: gap.filter(|_| picture).map(|gap| {
                let middle = f64::midpoint(gap.start.get().into(), gap.end.get().into());
                (middle, f64::from(gap.length().get()))
            }),
            picture,
        }
    }
}
