//! The safety controller: one tick and one exchange at a time, every decision in one place.
//!
//! [`SafetyController::tick`] runs every [`TICK_PERIOD`](nearfield_shared::limits::TICK_PERIOD) and is the only place
//! that can close the relays. [`SafetyController::on_exchange`] takes what an exchange with the host brought and can
//! only open them, at once. Each begins by comparing the memory that the decision rests on with what the one before
//! left (see [`crate::integrity`]).

mod findings;
mod io;
#[cfg(test)]
mod run_over_tests;
#[cfg(test)]
mod tests;

pub use findings::Findings;
pub use io::{ConfigurationError, Indicator, Outputs, PinInputs, StartInputs, TickInputs, TickOutput};

use crate::arming::DarkTest;
use crate::audit::{self, Auditor};
use crate::evidence::{Assent, Evidence, Judge};
use crate::flow::{Checkpoint, FlowMonitor};
use crate::health::{Health, HealthReport};
use crate::integrity::{Digest, Seal};
use crate::interlock::ResetButton;
use crate::laser_code::{LASER_OFF, LaserCode};
use crate::link::{Accepted, LinkCounts, Receiver};
use crate::liveness::{Exposed, Liveness};
use crate::map_check::MapCheck;
use crate::output_test::{Channel, OutputTest};
use crate::relay::{MirrorContacts, Relays};
use crate::run_over::RunOver;
use crate::secret::Secret;
use crate::selftest::{SelfTestKind, Verdict};
use crate::supervisor::{self, Inputs, State};
use core::borrow::BorrowMut;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::columns::Decimation;
use nearfield_shared::cutoff::Cutoff;
use nearfield_shared::height::Heights;
use nearfield_shared::limits::{
    LARGEST_COLUMN_COUNT, LONGEST_CAPTURE_AGE, LONGEST_MESSAGE_AGE, REDUCED_SPEED_PERCENT, WARNING_AMBIENT,
    WARNING_SATURATED,
};
use nearfield_shared::linescan::{HostVerdict, LineScanHeader};
use nearfield_shared::monitor::{StripeMonitor, StripeReport};
use nearfield_shared::rig::Rig;
use nearfield_shared::status::{
    HealthFigures, ResetCause, STATUS_LENGTH, StateCode, Status, TrustFigures, Warnings,
};
use nearfield_shared::units::{CalibrationId, Micros, Millimetres, SourceId};

/// Names this firmware in its status: major, minor (one byte each) and patch version (two bytes).
pub const FIRMWARE_ID: u32 = version_word([
    version_part(env!("CARGO_PKG_VERSION_MAJOR")),
    version_part(env!("CARGO_PKG_VERSION_MINOR")),
    version_part(env!("CARGO_PKG_VERSION_PATCH")),
]);

const fn version_word([major, minor, patch]: [u32; 3]) -> u32 {
    (major << 24) | (minor << 16) | patch
}

const fn version_part(digits: &str) -> u32 {
    match u32::from_str_radix(digits, 10) {
        Ok(part) => part,
        Err(_) => 0,
    }
}

/// The report before the first line-scan.
const UNSEEN: StripeReport = StripeReport {
    cutoff: Cutoff { voted: None, single: None, floor_columns: 0 },
    heights: Heights { highest: None, lowest: None, longest_unknown: Millimetres::ZERO },
    large: false,
    watched_columns: 0,
    passed: None,
};

/// The stripe monitor at the line-scan's size, about 37 KB.
pub type LineScanMonitor = StripeMonitor<LARGEST_COLUMN_COUNT>;

/// What the last accepted line-scan said besides the stripe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Surroundings {
    ambient: u8,
    saturated: u8,
    host_warns: bool,
}

impl Surroundings {
    const UNSEEN: Self = Self { ambient: 0, saturated: 0, host_warns: false };

    fn of(header: &LineScanHeader) -> Self {
        let host_warns = match header.verdict {
            HostVerdict::Warn => true,
            HostVerdict::Clear | HostVerdict::Stop => false,
        };
        Self { ambient: header.ambient, saturated: header.saturated, host_warns }
    }
}

/// The whole controller; see the module's documentation. `M` holds the monitor: a `&'static mut` of zeroed memory on
/// the microcontroller, a box elsewhere.
#[derive(Debug)]
pub struct SafetyController<M> {
    source: SourceId,
    monitor: M,
    calibration: Option<CalibrationId>,
    reset_cause: ResetCause,
    receiver: Receiver,
    judge: Judge,
    laser: LaserCode,
    liveness: Liveness,
    auditor: Auditor,
    health: Health,
    health_report: HealthReport,
    dark: DarkTest,
    run_over: RunOver,
    surroundings: Surroundings,
    report: StripeReport,
    evidence: Option<Evidence>,
    /// Causes since the last tick.
    events: StopCauses,
    live: StopCauses,
    state: State,
    relays: Relays,
    output_test: OutputTest,
    mirror: MirrorContacts,
    button: ResetButton,
    flow: FlowMonitor,
    map_check: MapCheck,
    failed_self_test: Option<SelfTestKind>,
    /// The pulse test of the last tick.
    pulse: Option<Channel>,
    /// A message was refused within the last interval.
    link_warning: bool,
    /// A call has found memory that the one before it did not leave so.
    damage_found: bool,
    seal: Seal,
    statuses_sent: u32,
    decision_age: Micros,
    longest_decision_age: Micros,
}

impl<M: BorrowMut<LineScanMonitor>> SafetyController<M> {
    /// Everything open, nothing known; see [`Self::start`].
    #[must_use]
    pub const fn new(source: SourceId, monitor: M) -> Self {
        Self {
            source,
            monitor,
            calibration: None,
            reset_cause: ResetCause::Unknown,
            receiver: Receiver::new(source, None, 0),
            judge: Judge::new(),
            laser: LaserCode::new(Secret::NONE),
            liveness: Liveness::new(),
            auditor: Auditor::new(),
            health: Health::new(),
            health_report: HealthReport::UNSEEN,
            dark: DarkTest::new(),
            run_over: RunOver::new(false),
            surroundings: Surroundings::UNSEEN,
            report: UNSEEN,
            evidence: None,
            events: StopCauses::NONE,
            live: StopCauses::NONE.with(StopCause::SelfTest),
            state: State::SelfTest { latched: StopCauses::NONE },
            relays: Relays::new(),
            output_test: OutputTest::new(),
            mirror: MirrorContacts { a: false, b: false },
            button: ResetButton::new(),
            flow: FlowMonitor::new(),
            map_check: MapCheck::empty(),
            failed_self_test: None,
            pulse: None,
            link_warning: false,
            damage_found: false,
            // No digest of this state: a controller that was never started locks itself out.
            seal: Digest::new().sealed(),
            statuses_sent: 0,
            decision_age: Micros::ZERO,
            longest_decision_age: Micros::ZERO,
        }
    }

    /// After every reset of the chip: forgets everything, takes the stored rig (its compact form), the reason of the
    /// reset and a fresh secret. Without a valid rig the relays never close. Filling the maps takes some 400 million
    /// instructions, so the watchdogs start afterwards.
    ///
    /// # Errors
    /// Why there is no valid rig (for a log; the controller has already taken it as a cause to stop).
    pub fn start(&mut self, inputs: &StartInputs<'_>) -> Result<(), ConfigurationError> {
        self.calibration = None;
        self.map_check = MapCheck::empty();
        self.run_over = RunOver::new(false);
        let configured = self.configure(inputs.stored_rig);
        let columns = self.monitor.borrow().geometry().column_count();
        self.receiver = Receiver::new(self.source, self.calibration, columns);
        self.reset_cause = inputs.reset_cause;
        self.judge = Judge::new();
        self.laser = LaserCode::new(Secret::new(inputs.secret));
        self.liveness = Liveness::new();
        self.auditor = Auditor::new();
        self.health = Health::new();
        self.health_report = HealthReport::UNSEEN;
        self.dark = DarkTest::new();
        self.surroundings = Surroundings::UNSEEN;
        self.report = UNSEEN;
        self.evidence = None;
        self.events = StopCauses::NONE;
        let watchdog = inputs.reset_cause == ResetCause::Watchdog;
        self.state =
            State::SelfTest { latched: StopCauses::NONE.with_if(StopCause::WatchdogReset, watchdog) };
        self.live = StopCauses::NONE.with(StopCause::SelfTest);
        self.relays = Relays::new();
        self.output_test = OutputTest::new();
        self.mirror = MirrorContacts { a: false, b: false };
        self.button = ResetButton::new();
        self.flow = FlowMonitor::new();
        self.failed_self_test = None;
        self.pulse = None;
        self.link_warning = false;
        self.damage_found = false;
        self.statuses_sent = 0;
        self.decision_age = Micros::ZERO;
        self.longest_decision_age = Micros::ZERO;
        self.seal = self.digest().sealed();
        configured
    }

    fn configure(&mut self, stored_rig: &[u8]) -> Result<(), ConfigurationError> {
        let rig = Rig::from_bytes(stored_rig).map_err(ConfigurationError::Rig)?;
        let decimation = Decimation::for_line_scan(rig.image().width);
        self.monitor.borrow_mut().configure(&rig, decimation).map_err(ConfigurationError::Geometry)?;
        self.calibration = Some(rig.calibration_id());
        self.run_over = RunOver::new(rig.allows_run_over());
        self.map_check = MapCheck::of(self.monitor.borrow().geometry());
        Ok(())
    }

    /// One tick of the safety task.
    pub fn tick(&mut self, now: Micros, inputs: TickInputs) -> TickOutput {
        self.check_memory();
        self.flow.begin(now);
        let maps_intact = self.map_check.step(self.monitor.borrow().geometry());
        let self_test = inputs.self_test.verdict(now);
        if let Verdict::Failed(kind) = self_test {
            self.failed_self_test = self.failed_self_test.or(Some(kind));
        }
        self.flow.pass(Checkpoint::Memory);
        let pins = inputs.pins;
        self.mirror = pins.mirror;
        let feedback = self.relays.check(now, pins.mirror);
        let outputs = self.output_test.check(self.relays.command(), pins.coils, pins.pulse);
        let armed = self.state.code() == StateCode::Interlocked;
        // While the service key is turned nobody starts the robot.
        let pressed = pins.reset_pressed && !pins.service_key;
        let button = self.button.step(now, pressed, armed);
        self.flow.pass(Checkpoint::Inputs);
        self.receiver.expire(now);
        self.link_warning = self.receiver.has_refused_lately(now);
        self.flow.pass(Checkpoint::Link);
        let inputs = Inputs {
            evidence: self.evidence,
            link: self.receiver.faults(),
            events: self.events,
            feedback,
            outputs,
            command_intact: self.relays.is_memory_intact(),
            data_intact: maps_intact && !self.damage_found,
            self_test,
            dark: self.dark.verdict(),
            flow_intact: self.flow.is_intact(),
            configured: self.calibration.is_some(),
            button_stuck: button.stuck,
            reset: button.reset,
        };
        self.decide(now, &inputs);
        self.flow.pass(Checkpoint::Command);
        self.seal = self.digest().sealed();
        TickOutput { outputs: self.outputs(), permit: self.flow.finish() }
    }

    /// The supervisor's step and its consequences.
    fn decide(&mut self, now: Micros, inputs: &Inputs) {
        let (state, decision) = supervisor::step(self.state, now, inputs);
        if is_waiting(self.state) {
            self.dark = DarkTest::new();
        }
        (self.state, self.live, self.events) = (state, decision.live, StopCauses::NONE);
        self.flow.pass(Checkpoint::Decision);
        self.relays.follow(decision.permission);
        self.laser.step(now, self.state.laser());
        self.pulse = self.output_test.next_pulse(now, self.relays.command());
    }

    /// An exchange with the host has taken place: the last [`Self::status`] went out, and a line-scan came in, or
    /// none. Opens the relays at once if it gives a reason to; closing is the tick's.
    pub fn on_exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Outputs {
        self.check_memory();
        self.statuses_sent = self.statuses_sent.saturating_add(1);
        self.receiver.status_sent(self.statuses_sent, now);
        if let Some(message) = line_scan {
            let causes = match self.receiver.receive(now, message) {
                Ok(accepted) => self.evaluate(now, &accepted),
                Err(refused) => StopCauses::NONE.with_if(refused.refusal.cause(), !refused.tolerated),
            };
            self.raise(causes);
        }
        self.raise(StopCauses::NONE.with_if(StopCause::CriticalData, self.damage_found));
        self.pulse = None;
        self.seal = self.digest().sealed();
        self.outputs()
    }

    /// Takes the evidence of an accepted line-scan; returns the causes that it leaves standing.
    fn evaluate(&mut self, now: Micros, accepted: &Accepted<'_>) -> StopCauses {
        let (scan, header) = (&accepted.scan, accepted.scan.header());
        if accepted.after_silence {
            self.monitor.borrow_mut().reset();
            self.judge.reset();
            self.liveness.forget();
            self.auditor.forget();
            self.run_over.forget();
        }
        let permit = self.run_over.permit(now, self.state == State::Running, &header.claims);
        self.report = self.monitor.borrow_mut().update_with(scan.readings(), &permit, |_| {}, |_| {});
        self.run_over.observe(now, &self.report);
        // When the picture was taken, by the host's word: the light itself shows whether that is true.
        let exposed = Exposed { middle: now.since(header.capture_age), length: header.exposure };
        self.liveness.observe(now, exposed, &scan.brightness(), self.laser.history());
        let dark = exposed.drive(self.laser.history()).is_some_and(|drive| drive.level == LASER_OFF);
        if dark {
            self.dark.observe(&self.report);
        }
        let monitor = self.monitor.borrow();
        let challenge =
            audit::challenge(self.laser.secret(), header.last_status, &monitor.geometry().watched());
        self.auditor.judge(scan, &challenge);
        // A column that has passed shows no floor.
        if !dark && self.report.passed.is_none() {
            self.health.observe(monitor.heights(), monitor.geometry().maps());
        }
        self.health_report = self.health.report();
        let assent = Assent {
            live: self.liveness.is_live(now),
            believed: self.auditor.is_believed(),
            aligned: self.health_report.aligned,
            capable: self.health_report.capable,
        };
        let evidence = self.judge.judge(now, &self.report, header.verdict, assent);
        self.evidence = Some(evidence);
        self.surroundings = Surroundings::of(header);
        self.decision_age = accepted.age;
        self.longest_decision_age = self.longest_decision_age.max(accepted.age);
        evidence.standing()
    }

    fn raise(&mut self, causes: StopCauses) {
        self.events = self.events.union(causes);
        if !causes.is_empty() {
            self.relays.open();
        }
    }

    /// Is the memory what the call before left?
    fn check_memory(&mut self) {
        self.damage_found = self.damage_found || !self.seal.holds(self.digest());
    }

    /// A digest of all that permission rests on.
    fn digest(&self) -> Digest {
        let time = |at: Option<Micros>| at.map_or(u64::MAX, Micros::get);
        let evidence = self.evidence.map_or([0; 2], |evidence| evidence.words());
        let identity = u64::from(self.calibration.map_or(0, CalibrationId::get));
        Digest::new()
            .with_all(self.state.words())
            .with_all(evidence)
            .with_all(self.receiver.words())
            .with_all(self.liveness.words())
            .with_all(self.auditor.words())
            .with_all(self.laser.words())
            .with_all(self.output_test.words())
            .with_all(self.relays.words())
            .with_all(self.button.words())
            .with_all(self.health.words())
            .with_all(self.map_check.words())
            .with_all(self.run_over.words())
            .with(self.judge.word())
            .with(self.dark.word())
            .with(time(self.flow.last_begin()))
            .with(identity << 32 | u64::from(self.events.bits()))
            .with(u64::from(self.statuses_sent))
    }

    /// What the pins are to be.
    #[must_use]
    pub fn outputs(&self) -> Outputs {
        Outputs {
            relays: self.relays.command(),
            laser_level: self.laser.level(),
            indicator: match self.state.code() {
                StateCode::SelfTest => Indicator::Testing,
                StateCode::Interlocked => Indicator::WaitingForReset,
                StateCode::Arming | StateCode::Running => Indicator::Permitted,
                StateCode::Stopped => Indicator::Stopped,
                StateCode::Lockout => Indicator::Service,
            },
            warning: self.warnings() != Warnings::NONE,
            pulse: self.pulse,
        }
    }

    fn warnings(&self) -> Warnings {
        let seen = self.surroundings;
        let cut = self.report.is_cut();
        Warnings::NONE
            .with_if(Warnings::FLOOR_OFFSET, self.health_report.offset_warning)
            .with_if(Warnings::VISIBILITY, self.health_report.visibility_warning)
            .with_if(Warnings::AMBIENT, seen.ambient >= WARNING_AMBIENT)
            .with_if(Warnings::SATURATED, seen.saturated >= WARNING_SATURATED)
            .with_if(Warnings::HOST, seen.host_warns)
            .with_if(Warnings::STRIPE, !cut && self.report.cutoff.voted.is_some())
            .with_if(Warnings::LINK, self.link_warning)
            .with_if(Warnings::RUN_OVER, self.report.passed.is_some())
    }

    /// The sensor's health; what passes under a run-over permit is passed slowly.
    fn health_figures(&self) -> HealthFigures {
        let figures = self.health_report.figures;
        let permitted = match self.report.passed {
            Some(_) => figures.permitted_speed_percent.min(REDUCED_SPEED_PERCENT),
            None => figures.permitted_speed_percent,
        };
        HealthFigures { permitted_speed_percent: permitted, ..figures }
    }

    /// The status to send in the next exchange. Its number moves on with [`Self::on_exchange`].
    #[must_use]
    pub fn status(&self, now: Micros) -> [u8; STATUS_LENGTH] {
        let LinkCounts { accepted, refused } = self.receiver.counts();
        let number = self.statuses_sent.saturating_add(1);
        let [light_age, longest_light_age] = self.liveness.light_ages();
        let [audits_confirmed, audits_contradicted] = self.auditor.counts();
        Status {
            source: self.source,
            calibration: self.calibration,
            firmware: FIRMWARE_ID,
            number,
            echoed_sequence: self.receiver.echoed_sequence(),
            now,
            state: self.state.code(),
            relay_command: self.relays.command(),
            relay_readback: self.mirror.main_contacts(),
            reset_cause: self.reset_cause,
            live_causes: self.live.union(self.events),
            latched_causes: self.state.latched(),
            longest_gap: self.report.longest_gap(),
            highest: self.report.heights.highest,
            lowest: self.report.heights.lowest.map(|lowest| lowest.height),
            longest_unknown: self.report.heights.longest_unknown,
            size: self.report.size(),
            laser_mode: self.state.laser(),
            warnings: self.warnings(),
            decision_age: self.decision_age,
            longest_decision_age: self.longest_decision_age,
            response_bound: LONGEST_CAPTURE_AGE.plus(LONGEST_MESSAGE_AGE),
            accepted,
            refused,
            challenge: audit::challenge(
                self.laser.secret(),
                number,
                &self.monitor.borrow().geometry().watched(),
            ),
            fault: self.state.fault(),
            failed_self_test: self.failed_self_test.map_or(0, SelfTestKind::code),
            trust: TrustFigures {
                light_age,
                longest_light_age,
                liveness_doubt: self.liveness.doubt(),
                audit_doubt: self.auditor.doubt(),
                audits_confirmed,
                audits_contradicted,
            },
            health: self.health_figures(),
            run_over: self.run_over.in_use(now, self.report.passed),
        }
        .to_bytes()
    }

    /// The rig in use.
    #[must_use]
    pub const fn calibration(&self) -> Option<CalibrationId> {
        self.calibration
    }
}

/// Before the reset button was pressed: what dark pictures said is forgotten.
const fn is_waiting(state: State) -> bool {
    match state {
        State::Darkness { .. } => false,
        State::SelfTest { .. }
        | State::Interlocked { .. }
        | State::Relighting { .. }
        | State::Running
        | State::Stopped { .. }
        | State::Lockout { .. } => true,
    }
}
