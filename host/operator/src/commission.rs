//! The commissioning on the page: calibration, size and fields, a test piece at three places, a protocol to print and sign.
//!
//! It watches what everybody else watches, and tells a person what to do next. It has no way to the controller: relays are closed by
//! the reset button at the robot, which the person presses, and nothing here can.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use nearfield_commissioning::{Ask, Check, Observation, Protocol, Section, Walk};
use nearfield_recording::Decision;
use nearfield_shared::columns::{ColumnMap, StripeGeometry};
use nearfield_shared::cutoff::CutoffDetector;
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, LONGEST_ALLOWED_GAP};
use nearfield_shared::units::{CalibrationId, Micros};
use serde::Serialize;

/// What is known before anybody goes to the robot.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Everything but the trials: its sections are "Rig" and "Size and fields".
    pub protocol: Protocol,
    /// Ends of the watched stripe, millimetres.
    pub stripe_mm: [f64; 2],
    /// Diameter of the test piece, a straight rod.
    pub piece_mm: f64,
    /// Relays must be open by then, milliseconds after the light.
    pub worst_ms: f64,
    /// The rig's identity, which the controller must have stored.
    pub calibration: CalibrationId,
    /// Now, for people.
    pub now: fn() -> String,
    /// Simulated hands are asked through this; `None` = a person is.
    pub hands: Option<Hands>,
}

/// What simulated hands are to do, between the page's thread and theirs; never more than the newest.
#[derive(Debug, Clone, Default)]
pub struct Hands(Arc<AtomicU64>);

/// No trial goes on: the hands do as ever.
const IDLE: u64 = 0;
const WAIT: u64 = 1;
const PRESS: u64 = 2;
const TAKE_AWAY: u64 = 3;
/// From here on: lay, with the place in micrometres from this.
const LAY: u64 = 1 << 40;

/// What simulated hands are asked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HandsAsked {
    /// Nothing in particular.
    Nothing,
    /// Hands off.
    Wait,
    /// The reset button.
    Press,
    /// Take the piece away.
    TakeAway,
    /// Lay it there, millimetres along the stripe.
    Lay(f64),
}

impl Hands {
    fn ask(&self, ask: Option<Ask>) {
        let code = match ask {
            None | Some(Ask::Nothing) => IDLE,
            Some(Ask::Wait) => WAIT,
            Some(Ask::ClearAndPress | Ask::Press) => PRESS,
            Some(Ask::TakeAway) => TAKE_AWAY,
            Some(Ask::Lay(place)) => LAY.saturating_add_signed((place * 1000.0) as i64),
        };
        self.0.store(code, Ordering::Relaxed);
    }

    /// The newest.
    #[must_use]
    pub fn asked(&self) -> HandsAsked {
        match self.0.load(Ordering::Relaxed) {
            IDLE => HandsAsked::Nothing,
            WAIT => HandsAsked::Wait,
            PRESS => HandsAsked::Press,
            TAKE_AWAY => HandsAsked::TakeAway,
            lay => HandsAsked::Lay(lay.wrapping_sub(LAY).cast_signed() as f64 / 1000.0),
        }
    }
}

/// What who knows the token may order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Order {
    /// Begin, or begin anew, as this person.
    Begin(String),
    /// End; the protocol so far stays.
    End,
}

/// How a step stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// Not reached yet.
    Next,
    /// Going on.
    Now,
    /// As demanded.
    Passed,
    /// Not so.
    Failed,
}

/// A step, as the page shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepView {
    title: &'static str,
    standing: Standing,
    checks: Vec<CheckView>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct CheckView {
    name: String,
    demanded: String,
    found: String,
    passed: bool,
}

/// `/api/commission`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct View {
    /// Somebody is at it.
    running: bool,
    /// Who; empty = nobody yet.
    person: String,
    /// What to do now.
    instruction: String,
    /// Where the piece is to be laid, millimetres.
    place_mm: Option<f64>,
    /// All of them.
    steps: Vec<StepView>,
    /// There is a protocol to print.
    has_protocol: bool,
    /// Was all as demanded? None = not finished.
    passed: Option<bool>,
}

/// A person gets so long for each thing.
const PATIENCE: Micros = Micros::from_millis(120_000);

/// See the module's documentation.
pub struct Desk {
    plan: Plan,
    person: String,
    begun: String,
    walk: Option<Walk>,
    running: bool,
    stored: Option<CalibrationId>,
    detector: Box<CutoffDetector<LARGEST_COLUMN_COUNT>>,
    heights: Vec<f32>,
}

impl Desk {
    /// Nobody has begun.
    #[must_use]
    pub fn new(plan: Plan) -> Self {
        Self {
            plan,
            person: String::new(),
            begun: String::new(),
            walk: None,
            running: false,
            stored: None,
            detector: Box::new(CutoffDetector::new()),
            heights: Vec::new(),
        }
    }

    /// Obeys; `stored` is the calibration that the controller tells now.
    pub fn order(&mut self, order: Order, stored: Option<CalibrationId>) {
        match order {
            Order::Begin(person) => {
                let Plan { stripe_mm, piece_mm, worst_ms, .. } = self.plan;
                self.walk = Some(Walk::new(stripe_mm, piece_mm, worst_ms, PATIENCE));
                (self.person, self.begun) = (person, (self.plan.now)());
                (self.stored, self.running) = (stored, true);
            }
            Order::End => self.running = false,
        }
        self.ask_hands();
    }

    fn ask_hands(&self) {
        if let Some(hands) = &self.plan.hands {
            hands.ask(self.walk.as_ref().filter(|_| self.running).map(Walk::asks));
        }
    }

    /// Watches, while somebody is at it: `rows` are the newest picture's, `None` = there was none.
    pub fn watch(
        &mut self,
        decision: &Decision,
        now: Micros,
        geometry: &StripeGeometry<LARGEST_COLUMN_COUNT>,
        rows: Option<&[Option<f32>]>,
    ) {
        if !self.running {
            return;
        }
        let gap = rows.and_then(|rows| self.gap(geometry, rows));
        let seen = Observation {
            now,
            exposed: decision.exposed,
            relay_closed: decision.relay_closed,
            picture: rows.is_some(),
            gap,
        };
        if let Some(walk) = &mut self.walk {
            walk.observe(&seen);
            self.running = !walk.is_done();
        }
        self.ask_hands();
    }

    /// The longest gap of this picture alone, if it is too long: middle and length.
    fn gap(
        &mut self,
        geometry: &StripeGeometry<LARGEST_COLUMN_COUNT>,
        rows: &[Option<f32>],
    ) -> Option<(f64, f64)> {
        self.heights.clear();
        let height = |(column, map): (usize, &ColumnMap)| {
            rows.get(column).copied().flatten().map_or(f32::NAN, |row| map.height(row))
        };
        self.heights.extend(geometry.watched().zip(geometry.maps()).map(height));
        self.detector.reset();
        let single = self.detector.update(geometry, &self.heights, |_| {}).single?;
        let middle = f64::midpoint(single.start.get().into(), single.end.get().into());
        (single.length() > LONGEST_ALLOWED_GAP).then(|| (middle, f64::from(single.length().get())))
    }

    fn sections(&self) -> Vec<Section> {
        let mut sections = self.plan.protocol.sections.clone();
        if let Some(walk) = &self.walk {
            let words = |id: Option<CalibrationId>| {
                id.map_or("none, or the controller was not heard".to_owned(), |id| {
                    format!("{:08x}", id.get())
                })
            };
            let wanted = Some(self.plan.calibration);
            let stored = Check::new(
                "Calibration that the controller has stored",
                words(wanted),
                words(self.stored),
                self.stored == wanted,
            );
            if let Some(rig) = sections.first_mut() {
                rig.checks.insert(0, stored);
            }
            sections.push(walk.section());
        }
        sections
    }

    /// To print; `None` = nobody has begun.
    #[must_use]
    pub fn protocol(&self) -> Option<Protocol> {
        self.walk.as_ref()?;
        Some(Protocol {
            made: self.begun.clone(),
            person: self.person.clone(),
            sections: self.sections(),
            ..self.plan.protocol.clone()
        })
    }

    /// For the page.
    #[must_use]
    pub fn view(&self) -> View {
        let is_done = self.walk.as_ref().is_some_and(|_| !self.running);
        let protocol = self.protocol();
        let titles = ["Calibrate", "Size and fields", "Test piece"];
        let mut steps: Vec<StepView> = titles
            .into_iter()
            .zip(self.sections().into_iter().map(Some).chain([None, None, None]))
            .map(|(title, section)| {
                let checks: Vec<CheckView> =
                    section.into_iter().flat_map(|section| section.checks).map(CheckView::of).collect();
                let standing = match (checks.is_empty(), title == titles[2] && self.running) {
                    (true, _) => Standing::Next,
                    (false, true) => Standing::Now,
                    (false, false) if checks.iter().all(|check| check.passed) => Standing::Passed,
                    (false, false) => Standing::Failed,
                };
                StepView { title, standing, checks }
            })
            .collect();
        let standing = if is_done { Standing::Now } else { Standing::Next };
        steps.push(StepView { title: "Sign off", standing, checks: Vec::new() });
        let ask = self.walk.as_ref().filter(|_| self.running).map(Walk::asks);
        View {
            running: self.running,
            person: self.person.clone(),
            instruction: self.instruction(ask, is_done),
            place_mm: match ask {
                Some(Ask::Lay(place)) => Some(place),
                _ => None,
            },
            steps,
            has_protocol: protocol.is_some(),
            passed: protocol.filter(|_| is_done).map(|protocol| protocol.is_passed()),
        }
    }

    fn instruction(&self, ask: Option<Ask>, is_done: bool) -> String {
        let words = self.words(ask, is_done);
        match (self.plan.hands.is_some(), ask.is_some(), is_done) {
            (true, true, _) => format!("Simulated hands do this: {words}"),
            (true, false, true) => "This was a simulation: its protocol releases no robot.".to_owned(),
            _ => words,
        }
    }

    fn words(&self, ask: Option<Ask>, is_done: bool) -> String {
        let piece = self.plan.piece_mm;
        match ask {
            Some(Ask::ClearAndPress) => {
                "Take everything off the stripe, keep clear of it, and press the reset button at the robot for half a second.".to_owned()
            }
            Some(Ask::Wait) => "Wait. Touch nothing for two seconds.".to_owned(),
            Some(Ask::Lay(place)) => {
                format!("Lay the rod of {piece} mm across the stripe, {place:.0} mm along it: where the profile is marked.")
            }
            Some(Ask::TakeAway) => "Take the rod away. Do not press the button yet.".to_owned(),
            Some(Ask::Press) => "Press the reset button at the robot for half a second.".to_owned(),
            Some(Ask::Nothing) | None if is_done => "Print the protocol, read it, and sign it.".to_owned(),
            Some(Ask::Nothing) | None => format!(
                "Have the configuration and a straight rod of {piece} mm at hand. It takes about three minutes; the robot must not move."
            ),
        }
    }
}

impl CheckView {
    fn of(check: Check) -> Self {
        let Check { name, demanded, found, passed } = check;
        Self { name, demanded, found, passed }
    }
}

#[cfg(test)]
pub(crate) mod tests;
