//! Runs the minute: every frame is rendered, looked at, encoded, sent and judged, with nothing in between left out.
//!
//! The twin gives the camera's planes; the vision reads them; the line-scan goes through the link as bytes; the
//! firmware's own code decides; its outputs drive the modelled relays, and its laser command lights the next picture.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use nearfield_shared::columns::GeometryError;
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH};
use nearfield_shared::rig::Rig;
use nearfield_shared::units::Micros;

use super::check::{Evidence, millis};
use super::health::HealthCount;
use super::overlay;
use super::record::{ActRecord, DemoRecord, FrameRecord, MessageFate};
use super::script::{self, Act};
use super::timeline::{CameraFault, Disturbance, Timeline};
use super::watch::{Traces, WatchedLink};
use crate::capture::SizeMismatch;
use crate::line_scan::LineScanEncoder;
use crate::link::{FRAME_PERIOD, FrameFacts, LinkError, McuKind, McuLink, McuSession};
use crate::twin::random::Dice;
use crate::twin::{Picture, SceneError, SceneObject, Twin, View};
use crate::vision::{Analyser, ForeignFrame};

/// Why the demo could not go on. That an expectation is not met is no such reason.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// The controller.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The script's scene.
    #[error("the demo's scene: {0}")]
    Scene(#[from] SceneError),
    /// The rig resolves no stripe.
    #[error("the demo's rig: {0}")]
    Geometry(#[from] GeometryError),
    /// The picture's size.
    #[error("the demo's picture: {0}")]
    Picture(#[from] SizeMismatch),
    /// The picture's size does not fit the rig.
    #[error("the demo's picture: {0}")]
    Foreign(#[from] ForeignFrame),
    /// A picture for the report.
    #[error("a picture for the report: {0}")]
    Encode(#[from] image::ImageError),
    /// The audience's terminal.
    #[error("the terminal: {0}")]
    Terminal(#[from] std::io::Error),
    /// Somebody pressed q.
    #[error("stopped from the keyboard")]
    Interrupted,
}

/// Half a second of pictures.
const RECORDED_PICTURES: usize = 25;

/// What the audience sees of a frame.
#[derive(Debug, Clone, Copy)]
pub struct Moment<'a> {
    /// The frame.
    pub record: &'a FrameRecord,
    /// All acts.
    pub timeline: &'a Timeline,
    /// The acts that are over.
    pub acts: &'a [ActRecord],
    /// Height along the stripe as the host sees it: place and height, millimetres; NaN = no stripe.
    pub profile: &'a [(f32, f32)],
    /// Which controller.
    pub mcu: McuKind,
}

/// Somebody who watches the demo.
pub trait Audience {
    /// A frame is over.
    ///
    /// # Errors
    /// The terminal does not work, or the audience wants to leave.
    fn frame(&mut self, moment: &Moment<'_>) -> Result<(), DemoError>;

    /// An act is over.
    ///
    /// # Errors
    /// The terminal does not work.
    fn act_over(&mut self, record: &ActRecord) -> Result<(), DemoError>;
}

/// A picture for the report.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// Index of the act.
    pub act: usize,
    /// When its line-scan was sent, milliseconds since power-on.
    pub t_ms: f64,
    /// The camera's picture with what the host saw.
    pub jpeg: Vec<u8>,
    /// Height along the stripe as the host sees it.
    pub profile: Vec<(f32, f32)>,
    /// What is really there: place, height of the lit point, and whether the camera sees it.
    pub true_profile: Vec<(f64, f64, bool)>,
}

/// A finished demo.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Everything that programs read.
    pub record: DemoRecord,
    /// Pictures for the report.
    pub snapshots: Vec<Snapshot>,
}

/// The demo on its way.
pub struct Engine {
    rig: Rig,
    timeline: Timeline,
    seed: u64,
    twin: Twin,
    placed: Vec<SceneObject>,
    picture: Picture,
    analyser: Analyser,
    encoder: LineScanEncoder,
    session: McuSession,
    traces: Rc<RefCell<Traces>>,
    last_message: Option<Box<[u8; LINE_SCAN_LENGTH]>>,
    /// The last pictures, oldest first: what a host that replays would have.
    recorded: std::collections::VecDeque<Picture>,
    dice: Dice,
    interrupted_ms: Option<f64>,
    frames: Vec<FrameRecord>,
    acts: Vec<ActRecord>,
    snapshots: Vec<Snapshot>,
    profile: Vec<(f32, f32)>,
    health: HealthCount,
}

impl Engine {
    /// Sets the stage: the twin is warmed up, the controller gets power.
    ///
    /// # Errors
    /// See [`DemoError`].
    pub fn new(rig: &Rig, link: Box<dyn McuLink>, seed: u64) -> Result<Self, DemoError> {
        Self::with_script(rig, link, seed, script::minute())
    }

    /// As [`Self::new`], with other acts than the minute's.
    ///
    /// # Errors
    /// See [`DemoError`].
    pub fn with_script(
        rig: &Rig,
        link: Box<dyn McuLink>,
        seed: u64,
        acts: Vec<Act>,
    ) -> Result<Self, DemoError> {
        let (watched, traces) = WatchedLink::new(link);
        let twin = Twin::new(Arc::new(View::new(rig)), &script::stage(), seed)?;
        Ok(Self {
            rig: *rig,
            timeline: Timeline::new(acts),
            seed,
            twin,
            placed: Vec::new(),
            picture: Picture::black(0, 0),
            analyser: Analyser::new(rig)?,
            encoder: LineScanEncoder::new(rig)?,
            session: McuSession::start(Box::new(watched), rig)?,
            traces,
            last_message: None,
            recorded: std::collections::VecDeque::new(),
            dice: Dice::new(seed),
            interrupted_ms: None,
            frames: Vec::new(),
            acts: Vec::new(),
            snapshots: Vec::new(),
            profile: Vec::new(),
            health: HealthCount::default(),
        })
    }

    /// Plays the whole minute.
    ///
    /// # Errors
    /// See [`DemoError`]; expectations that are not met are in the outcome.
    pub fn play(mut self, audience: &mut dyn Audience) -> Result<Outcome, DemoError> {
        let begun = Instant::now();
        let count = (self.timeline.end_ms() / millis(FRAME_PERIOD)).round() as u32;
        for frame in 0..count {
            self.step(frame)?;
            if let Some(record) = self.frames.last() {
                let (timeline, acts, profile) = (&self.timeline, &self.acts[..], &self.profile[..]);
                audience.frame(&Moment { record, timeline, acts, profile, mcu: self.session.kind() })?;
            }
            let act = self.acts.len();
            if millis(self.session.now()) >= self.timeline.span(act).1 {
                self.close_act(act);
                if let Some(record) = self.acts.last() {
                    audience.act_over(record)?;
                }
            }
        }
        Ok(self.finish(begun.elapsed().as_secs_f64()))
    }

    /// One camera frame, from light to the relays.
    fn step(&mut self, frame: u32) -> Result<(), DemoError> {
        let now = millis(self.session.now());
        let facts = FrameFacts::default();
        let exposed = now - millis(facts.capture_age);
        let objects = self.timeline.objects_at(exposed);
        self.find_first_interruption(exposed, &objects)?;
        if objects != self.placed {
            self.twin.place(&objects)?;
            self.placed = objects;
        }
        let level = self.take_picture(frame, exposed);
        let camera = self.picture.to_yuv420_frame()?;
        self.analyser.update(&camera.view())?;
        self.profile.clear();
        self.profile.extend(self.analyser.profile().values());
        let extractor = self.analyser.extractor();
        self.encoder.encode(extractor.readings(), extractor.geometry());
        self.encoder.measure_light(&camera.view(), self.session.challenge());
        let fate = self.send(now, facts)?;
        self.write_down(frame, now, level, fate)?;
        Ok(())
    }

    /// The camera's picture, or what a fault makes of it; returns the laser's level during the exposure.
    fn take_picture(&mut self, frame: u32, exposed_ms: f64) -> u8 {
        let middle = Micros::new((exposed_ms.max(0.0) * 1000.0) as u64);
        let drive = if self.timeline.laser_dead(exposed_ms) {
            0.0
        } else {
            self.session.mean_laser_drive(middle, FrameFacts::default().exposure)
        };
        match self.timeline.camera_fault_at(exposed_ms) {
            None => self.twin.render_into(u64::from(frame), drive, &mut self.picture),
            Some(CameraFault::Covered) => self.picture.rgb.fill(0),
            Some(CameraFault::Frozen) => {}
            Some(CameraFault::Replayed) => {
                if let Some(oldest) = self.recorded.pop_front() {
                    self.picture = oldest;
                }
            }
        }
        self.recorded.push_back(self.picture.clone());
        if self.recorded.len() > RECORDED_PICTURES {
            self.recorded.pop_front();
        }
        (255.0 * drive).round() as u8
    }

    /// The host's message and everything else that happens in this frame's period.
    fn send(&mut self, now: f64, facts: FrameFacts) -> Result<MessageFate, DemoError> {
        let (mut press, mut hang) = (false, false);
        for action in self.timeline.moments(now, now + millis(FRAME_PERIOD)) {
            press |= matches!(action, script::Action::PressReset);
            hang |= matches!(action, script::Action::HangController);
        }
        if press {
            self.session.press_reset();
        }
        if hang {
            self.session.hang()?;
        }
        let disturbance = self.timeline.disturbance_at(now);
        let honest = if self.analyser.report().is_cut() { HostVerdict::Stop } else { HostVerdict::Clear };
        let verdict = match disturbance {
            Some(Disturbance::ClaimClear) => HostVerdict::Clear,
            Some(Disturbance::RequestStop) => HostVerdict::Stop,
            Some(Disturbance::Drop | Disturbance::Damage | Disturbance::Repeat) | None => honest,
        };
        if let (Some(Disturbance::Repeat), Some(old)) = (disturbance, &self.last_message) {
            self.session.run_frame(Some(&old[..]))?;
            return Ok(MessageFate::Repeated);
        }
        let facts = FrameFacts { verdict, ..facts };
        let (columns, light) = (self.encoder.columns(), self.encoder.light());
        let mut message = self.session.next_lit_line_scan(columns, light, facts)?;
        let fate = match disturbance {
            Some(Disturbance::Drop) => {
                self.session.run_frame(None)?;
                return Ok(MessageFate::Dropped);
            }
            Some(Disturbance::Damage) => {
                self.damage(&mut message);
                MessageFate::Damaged
            }
            Some(Disturbance::ClaimClear) => MessageFate::FalseClear,
            Some(Disturbance::RequestStop) => MessageFate::StopRequest,
            Some(Disturbance::Repeat) | None => MessageFate::Sent,
        };
        self.session.run_frame(Some(&message[..]))?;
        self.last_message = Some(message);
        Ok(fate)
    }

    /// Flips a few bits anywhere.
    fn damage(&mut self, message: &mut [u8; LINE_SCAN_LENGTH]) {
        for _ in 0..3 {
            let word = self.dice.word();
            let index = (word >> 8) as usize % LINE_SCAN_LENGTH;
            message[index] ^= 1 << (word & 7);
        }
    }

    /// Notes the first moment of the act at which a laser ray does not reach the floor in the camera's sight.
    fn find_first_interruption(&mut self, exposed: f64, objects: &[SceneObject]) -> Result<(), DemoError> {
        if self.interrupted_ms.is_some() || objects.is_empty() || objects == self.placed {
            return Ok(());
        }
        if self.twin.truth_of(objects, 1.0)?.longest_gap_mm.any == 0.0 {
            return Ok(());
        }
        let (mut whole, mut cut) = (exposed - millis(FRAME_PERIOD), exposed);
        while cut - whole > 0.1 {
            let middle = f64::midpoint(whole, cut);
            let truth = self.twin.truth_of(&self.timeline.objects_at(middle), 1.0)?;
            if truth.longest_gap_mm.any == 0.0 { whole = middle } else { cut = middle }
        }
        self.interrupted_ms = Some(cut);
        Ok(())
    }

    fn write_down(&mut self, frame: u32, now: f64, level: u8, message: MessageFate) -> Result<(), DemoError> {
        let status = *self.session.status();
        self.health.note(&status);
        let truth = self.twin.truth(f32::from(level));
        let true_highest_mm = truth.objects.iter().filter_map(|object| object.heights).map(|lit| lit.max_mm);
        let act = self.timeline.act_at(now);
        self.frames.push(FrameRecord {
            frame,
            t_ms: now,
            act,
            state: status.state.name(),
            commanded_closed: self.session.relay_commanded_closed(),
            contacts_closed: self.session.relay_closed(),
            longest_gap_mm: status.longest_gap.map(|gap| gap.length().get()),
            true_gap_mm: if truth.laser_on {
                truth.longest_gap_mm.any
            } else {
                truth.stripe_mm[1] - truth.stripe_mm[0]
            },
            highest_mm: status.highest.map(|highest| highest.height.get()),
            true_highest_mm: true_highest_mm.max_by(f64::total_cmp),
            live_causes: status.live_causes.iter().map(|cause| cause.name()).collect(),
            latched_causes: status.latched_causes.iter().map(|cause| cause.name()).collect(),
            decision_age_ms: millis(status.decision_age),
            message,
            host_cut: self.analyser.report().is_cut(),
            laser_level: level,
        });
        let (start, _) = self.timeline.span(act);
        let wanted = self.timeline.acts().get(act).and_then(|act| act.snapshot_ms).map(|at| start + at);
        if wanted.is_some_and(|at| (now..now + millis(FRAME_PERIOD)).contains(&at)) {
            let annotated = overlay::annotate(&self.picture, self.analyser.extractor());
            let profile = truth.profile;
            let places = profile.s_mm.into_iter().zip(profile.height_mm).zip(profile.visible);
            self.snapshots.push(Snapshot {
                act,
                t_ms: now,
                jpeg: overlay::to_jpeg(&annotated)?,
                profile: self.profile.clone(),
                true_profile: places
                    .map(|((s, height), visible)| (s, height, visible && truth.laser_on))
                    .collect(),
            });
        }
        Ok(())
    }

    fn close_act(&mut self, act: usize) {
        let (start_ms, end_ms) = self.timeline.span(act);
        let first = self.frames.partition_point(|frame| frame.t_ms < start_ms);
        let frames = &self.frames[first..];
        let Some(script) = self.timeline.acts().get(act) else { return };
        let traces = self.traces.borrow();
        let evidence =
            Evidence { start_ms, traces: &traces, frames, interrupted_ms: self.interrupted_ms.take() };
        let old = frames.first().map_or(&[][..], |frame| &frame.latched_causes[..]);
        let mut causes = Vec::new();
        for frame in frames {
            let latched = frame.latched_causes.iter().filter(|cause| !old.contains(*cause));
            for cause in frame.live_causes.iter().chain(latched) {
                if !causes.contains(cause) {
                    causes.push(*cause);
                }
            }
        }
        let largest =
            |value: fn(&FrameRecord) -> Option<f32>| frames.iter().filter_map(value).max_by(f32::total_cmp);
        let record = ActRecord {
            name: script.name,
            title: script.title,
            promise: script.promise,
            start_ms,
            end_ms,
            checks: script.checks.iter().map(|check| evidence.judge(*check)).collect(),
            causes,
            largest_gap_mm: largest(|frame| frame.longest_gap_mm),
            highest_mm: largest(|frame| frame.highest_mm),
        };
        drop(traces);
        self.acts.push(record);
    }

    fn finish(self, wall_seconds: f64) -> Outcome {
        let status = self.session.status();
        let size = self.rig.image();
        let changes = self.traces.borrow().commanded_closed.changes().to_vec();
        let record = DemoRecord {
            schema: "nearfield-demo-1",
            mcu: self.session.kind().name(),
            seed: self.seed,
            calibration_id: format!("{:08x}", self.rig.calibration_id().get()),
            firmware_id: format!("{:08x}", status.firmware),
            picture: [size.width, size.height],
            stripe_mm: [self.rig.stripe().start, self.rig.stripe().end],
            met: self.acts.iter().all(ActRecord::met) && self.acts.len() == self.timeline.acts().len(),
            wall_seconds,
            acts: self.acts,
            link: self.health.finish(),
            relay_changes: changes.into_iter().map(|(when, closed)| (millis(when), closed)).collect(),
            frames: self.frames,
        };
        Outcome { record, snapshots: self.snapshots }
    }
}
