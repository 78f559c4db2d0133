//! The host's loop: a picture, a line-scan, a status, and everybody told.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nearfield_fields::Report;
use nearfield_firmware::link::is_poll;
use nearfield_fusion::Motion;
use nearfield_machine::service::ServiceManager;
use nearfield_recording::{Decision, Event};
use nearfield_shared::action::Action;
use nearfield_shared::causes::StopCauses;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::units::Micros;

use super::controller::ControllerError;
use super::outlets::Outlets;
use super::stripe_path::StripeError;
use super::supervised::{Got, Supervised};
use super::{Controller, StripePath};
use crate::link::board::BoardError;

/// A change of the relays or of their causes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Change {
    /// Pictures so far.
    pub picture: u64,
    /// May the robot move?
    pub relay_closed: bool,
    /// Causes that hold now.
    pub causes: StopCauses,
}

/// What the loop tells its caller.
#[derive(Debug)]
pub enum Said<'a> {
    /// The relays or their causes.
    Change(Change),
    /// Something is wrong; it goes on.
    Warning(&'a str),
}

/// How long it runs, and how fast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Frame periods until the end; `None` = until it is stopped.
    pub pictures: Option<u64>,
    /// From one frame period to the next; `None` = as the source gives them.
    pub period: Option<Duration>,
}

/// Without a picture: stop, whatever lies where.
const BLIND: (HostVerdict, Report, Option<Action>) =
    (HostVerdict::Stop, Report::NOTHING_SEEN, Some(Action::StopAndWarn));

/// See the module's documentation.
pub struct Runner<'a, C> {
    /// The stripe's path.
    pub path: StripePath<C>,
    /// Where pictures come from.
    pub source: Supervised,
    /// Who is told.
    pub outlets: &'a mut Outlets,
    /// How long and how fast.
    pub pace: Pace,
}

impl<C: Controller> Runner<'_, C> {
    /// Until the end or until `stop`. `drive` is asked for the laser's mean drive over an exposure, by its middle and length.
    ///
    /// # Errors
    /// Whoever is told has gone away.
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        mut drive: impl FnMut(&mut C, Micros, Micros) -> f32,
        mut say: impl FnMut(Said<'_>) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let facts = self.path.usual();
        let mut service = ServiceManager::new();
        let mut told: Option<(bool, StopCauses)> = None;
        self.path.wait_for_first_exposure()?;
        let mut due = Instant::now();
        let mut number = 0_u64;
        service.ready();
        while !stop.load(Ordering::Relaxed) && self.pace.pictures.is_none_or(|last| number < last) {
            number += 1;
            let exposed = self.path.controller().now().since(facts.capture_age);
            let level = drive(self.path.controller(), exposed, facts.exposure);
            if let Some(warning) = self.picture(number, exposed, level) {
                self.outlets.taps.tell(exposed, Event::Warning(warning.as_str().into()));
                say(Said::Warning(&warning))?;
            }
            let now = self.now_told();
            if told != Some(now) {
                told = Some(now);
                say(Said::Change(Change { picture: number, relay_closed: now.0, causes: now.1 }))?;
            }
            service.alive(|| format!("{number} pictures, relays {}", if now.0 { "closed" } else { "open" }));
            if let Some(period) = self.pace.period {
                due += period;
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
        }
        service.stopping();
        Ok(())
    }

    fn now_told(&mut self) -> (bool, StopCauses) {
        let controller = self.path.controller();
        let causes = controller.status().map_or(StopCauses::NONE, |status| status.live_causes);
        (controller.is_circuit_closed(), causes)
    }

    /// A frame period; what went wrong in it, if that was not told before.
    fn picture(&mut self, number: u64, exposed: Micros, level: f32) -> Option<String> {
        let tally = &self.outlets.tally;
        tally.pictures.add();
        let restarts = self.source.restarts();
        let got = self.source.next(level);
        let (frame, age, warning) = match got {
            Got::Picture(frame, age) => (Some(frame), age, None),
            Got::Nothing => (None, None, None),
            Got::Broken(error) => (None, None, Some(format!("the source of pictures: {error:#}"))),
        };
        // The camera's own word, where it has one.
        let exposed = age.map_or(exposed, |age| self.path.controller().now().since(age));
        let begun = Instant::now();
        let outcome = match frame {
            Some(frame) => self
                .path
                .step(frame, exposed, &Motion::default())
                .map(|step| (step.verdict, step.fields, step.action)),
            None => {
                tally.missing.add();
                self.path.skip().map(|()| BLIND)
            }
        };
        let latency = begun.elapsed();
        if let (Some(frame), Some(pictures)) = (frame, &mut self.outlets.pictures) {
            pictures.show(frame, exposed);
        }
        if self.source.restarts() > restarts {
            tally.restarts.add();
        }
        let at = self.path.controller().now();
        self.outlets.clock.set(at);
        if let Some((sent, came)) = self.path.controller().last_transaction()
            && let Some(status) = came.first_chunk()
        {
            let line_scan = (!is_poll(sent)).then_some(*sent);
            self.outlets.taps.tell(at, Event::Exchange { step: None, line_scan, status: *status });
        }
        let relay_closed = self.path.controller().is_circuit_closed();
        let (verdict, fields, advice) = outcome.as_ref().copied().unwrap_or(BLIND);
        let decision = Decision { picture: number, exposed, verdict, relay_closed, latency, fields, advice };
        self.outlets.taps.tell(at, Event::Decision(decision));
        match outcome {
            Ok(_) => warning,
            Err(error) => {
                self.outlets.tally.lost.add();
                let closed = matches!(
                    &error,
                    StripeError::Controller(ControllerError::Board(BoardError::Closed { .. }))
                );
                // What closed the bus was told when it did.
                warning.or_else(|| (!closed).then(|| error.to_string()))
            }
        }
    }
}
