//! One picture after the other through vision, line-scan and controller, with what tier 3 has last said.

use std::time::{Duration, Instant};

use nearfield_fields::speed::SpeedListener;
use nearfield_fields::{Evidence, Fields, Report, Stretch, more_careful};
use nearfield_fusion::{Advice, Answer, Motion, Obstruction, Tracker, claims, decide};
use nearfield_shared::action::{Action, Category, action_for};
use nearfield_shared::height::SizeClass;
use nearfield_shared::limits::IMMEDIATE_GAP;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::rig::Rig;
use nearfield_shared::run_over::{Claims, NO_CLAIMS};
use nearfield_shared::units::Micros;

use super::controller::{Controller, ControllerError};
use super::latency::Latency;
use super::semantics::Semantics;
use crate::capture::{Frame, FrameView};
use crate::line_scan::LineScanEncoder;
use crate::link::FrameFacts;
use crate::vision::{Analyser, ForeignFrame};

/// Why a picture could not be used. The controller then gets nothing, and stops by itself.
#[derive(Debug, thiserror::Error)]
pub enum StripeError {
    /// The picture is of another size than the rig's.
    #[error(transparent)]
    Foreign(#[from] ForeignFrame),
    /// The controller.
    #[error(transparent)]
    Controller(#[from] ControllerError),
}

/// What became of one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// What the host advises, with its reasons; `None` without tier 3.
    pub advice: Option<Advice>,
    /// What the robot's planner is advised to do; `None` = drive on. Without tier 3 all that cuts the stripe is unknown.
    pub action: Option<Action>,
    /// Zones and the case in force.
    pub fields: Report,
    /// What it told the controller.
    pub verdict: HostVerdict,
    /// May the robot move?
    pub relay_closed: bool,
}

/// Tier 3 has answered lately: an answer counts for this long after its picture.
const LONGEST_ANSWER_AGE: Micros = Micros::from_millis(500);

/// See the module's documentation.
pub struct StripePath<C> {
    rig: Rig,
    analyser: Analyser,
    encoder: LineScanEncoder,
    controller: C,
    semantics: Option<Semantics>,
    tracker: Tracker,
    fields: Fields,
    speed: Option<SpeedListener>,
    /// What is told of every picture, as far as it does not tell itself.
    usual: FrameFacts,
    /// What the last line-scan told the controller.
    facts: FrameFacts,
    /// From the picture in memory to the line-scan sent and the status received.
    latency: Latency,
}

impl<C: Controller> StripePath<C> {
    /// With a controller that is powered up, and with tier 3 or without.
    ///
    /// # Errors
    /// The rig's picture does not resolve the stripe.
    pub fn new(
        rig: &Rig,
        controller: C,
        semantics: Option<Semantics>,
    ) -> Result<Self, nearfield_shared::columns::GeometryError> {
        Ok(Self {
            rig: *rig,
            analyser: Analyser::new(rig)?,
            encoder: LineScanEncoder::new(rig)?,
            controller,
            semantics,
            tracker: Tracker::new(*rig),
            fields: Fields::default(),
            speed: None,
            usual: FrameFacts::default(),
            facts: FrameFacts::default(),
            latency: Latency::new(),
        })
    }

    /// With zones, and with the robot's speed to select their case.
    #[must_use]
    pub fn with_fields(self, fields: Fields, speed: Option<SpeedListener>) -> Self {
        Self { fields, speed, ..self }
    }

    /// With the ground subtracted that the laser's code tells: see [`Analyser::with_background_subtraction`].
    #[must_use]
    pub fn with_background_subtraction(self) -> Self {
        Self { analyser: self.analyser.with_background_subtraction(), ..self }
    }

    /// With another exposure than the usual one: the controller compares the light of it with the laser's code.
    #[must_use]
    pub fn with_exposure(self, exposure: Micros) -> Self {
        Self { usual: FrameFacts { exposure, ..self.usual }, ..self }
    }

    /// What is told of a picture that tells nothing itself: its age, and its exposure.
    #[must_use]
    pub const fn usual(&self) -> FrameFacts {
        self.usual
    }

    /// The controller.
    pub const fn controller(&mut self) -> &mut C {
        &mut self.controller
    }

    /// What the last line-scan claimed.
    #[must_use]
    pub const fn claims(&self) -> &Claims {
        &self.facts.claims
    }

    /// The verdict of the last line-scan.
    #[must_use]
    pub const fn last_verdict(&self) -> HostVerdict {
        self.facts.verdict
    }

    /// Has tier 3 seen everything that it follows often enough to be believed?
    #[must_use]
    pub fn are_tracks_confirmed(&self) -> bool {
        self.tracker.tracks().iter().all(nearfield_fusion::Track::is_confirmed)
    }

    /// How long pictures took.
    #[must_use]
    pub const fn latency(&self) -> &Latency {
        &self.latency
    }

    /// Vision's view of the last picture.
    #[must_use]
    pub const fn analyser(&self) -> &Analyser {
        &self.analyser
    }

    /// Takes a picture: `exposed` is the middle of its exposure on the session's clock, `motion` the robot's since the
    /// picture before.
    ///
    /// # Errors
    /// The picture is foreign, or the controller cannot be reached; nothing was sent then.
    pub fn step(&mut self, frame: &Frame, exposed: Micros, motion: &Motion) -> Result<Step, StripeError> {
        let begun = Instant::now();
        let view = frame.view();
        self.analyser.update(&view)?;
        let age = self.controller.now().since(exposed);
        let mut facts = FrameFacts { capture_age: age, ..self.usual };
        self.tracker.move_on(motion);
        let advice = self.fuse();
        facts.verdict = match &advice {
            Some(advice) => advice.verdict,
            None if self.analyser.report().is_cut() => HostVerdict::Stop,
            None => HostVerdict::Clear,
        };
        facts.claims = match &advice {
            Some(_) => claims::claims(self.rig.stripe(), self.tracker.tracks(), self.controller.now()),
            None => NO_CLAIMS,
        };
        let fields = self.judge_fields();
        facts.verdict = more_careful(facts.verdict, fields.verdict());
        self.send(&view, facts)?;
        self.facts = facts;
        self.latency.add(begun.elapsed());
        // After the line-scan has gone: tier 3 gets what is left.
        if let Some(semantics) = &mut self.semantics {
            semantics.show(|picture| {
                picture.frame.copy_from(frame);
                picture.exposed = exposed;
            });
        }
        let relay_closed = self.controller.is_circuit_closed();
        let cut = self.analyser.report().is_cut();
        let action = match &advice {
            Some(advice) => advice.action,
            None => cut.then(|| action_for(Category::Unknown, SizeClass::Unknown)),
        };
        Ok(Step { advice, action, fields, verdict: facts.verdict, relay_closed })
    }

    /// Lets the first moments pass, without pictures, until one can have been exposed wholly since the clock began: of an earlier
    /// one no age can be told, and the controller would refuse it.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn wait_for_first_exposure(&mut self) -> Result<(), StripeError> {
        let facts = self.usual;
        let earliest = facts.capture_age.plus(facts.exposure);
        while self.controller.now() < earliest {
            // Simulated time goes on by this, a real clock by itself.
            self.skip()?;
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    /// A frame period without a picture: the controller gets nothing, and the votes know it.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn skip(&mut self) -> Result<(), StripeError> {
        self.analyser.lose_frame();
        Ok(self.controller.skip()?)
    }

    /// Zones by the gaps of the vote, by a gap that is too long to wait for one, and by what tier 3 sees ahead.
    fn judge_fields(&self) -> Report {
        let speed = self.speed.as_ref().and_then(SpeedListener::speed_mm_s);
        let at_once = self.analyser.report().cutoff.single.filter(|gap| gap.length() > IMMEDIATE_GAP);
        let gaps = self.analyser.gaps().iter().copied().chain(at_once).map(|gap| Stretch {
            start_mm: f64::from(gap.start.get()),
            end_mm: f64::from(gap.end.get()),
            evidence: Evidence::Gap,
        });
        let stripe = self.rig.stripe();
        let tracks = self.tracker.tracks().iter().map(|track| {
            let (start_mm, end_mm) = track.footprint.along(stripe);
            let behind = track.footprint.behind(stripe).0.floor();
            Stretch { start_mm, end_mm, evidence: Evidence::Ahead(behind as i32) }
        });
        self.fields.judge(speed, gaps.chain(tracks))
    }

    fn send(&mut self, view: &FrameView<'_>, facts: FrameFacts) -> Result<(), ControllerError> {
        let extractor = self.analyser.extractor();
        self.encoder.encode(extractor.readings(), extractor.geometry());
        let challenge = self.controller.challenge();
        self.encoder.measure_light(view, &challenge);
        let (columns, light) = (self.encoder.columns(), self.encoder.light());
        self.controller.send(columns, light, facts)
    }

    /// The advice with what tier 3 has last said; `None` without tier 3.
    fn fuse(&mut self) -> Option<Advice> {
        let semantics = self.semantics.as_mut()?;
        if let Some(answer) = semantics.newest() {
            let known = answer.sightings.as_deref().map_or(Answer::Unknown, Answer::Seen);
            self.tracker.observe(answer.exposed, &known);
        }
        let now = self.controller.now();
        let answered =
            self.tracker.last_answer().is_some_and(|exposed| now.since(exposed) <= LONGEST_ANSWER_AGE);
        let obstructions: Vec<Obstruction> = self
            .analyser
            .objects()
            .iter()
            .map(|object| Obstruction {
                start: f64::from(object.start.get()),
                end: f64::from(object.end.get()),
                size: object.size,
            })
            .collect();
        Some(decide(self.rig.stripe(), &obstructions, self.tracker.tracks(), answered))
    }
}
