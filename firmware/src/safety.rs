//! The safety controller: one tick and one exchange at a time, every decision in one place.
//!
//! [`SafetyController::tick`] runs every [`TICK_PERIOD`](nearfield_shared::limits::TICK_PERIOD) and is the only place
//! that can close the relays. [`SafetyController::on_exchange`] takes what an exchange with the host brought and can
//! only open them, at once.

use crate::evidence::{Evidence, Judge};
use crate::flow::{Checkpoint, FeedPermit, FlowMonitor};
use crate::interlock::ResetButton;
use crate::link::{Accepted, LinkCounts, Receiver};
use crate::relay::{MirrorContacts, Relays};
use crate::supervisor::{self, Inputs, State};
use core::borrow::BorrowMut;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::columns::{Decimation, GeometryError};
use nearfield_shared::cutoff::Cutoff;
use nearfield_shared::height::Heights;
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, LONGEST_CAPTURE_AGE, LONGEST_MESSAGE_AGE};
use nearfield_shared::monitor::{StripeMonitor, StripeReport};
use nearfield_shared::rig::{CompactRigError, Rig};
use nearfield_shared::status::{Challenge, Channels, ResetCause, STATUS_LENGTH, StateCode, Status};
use nearfield_shared::units::{CalibrationId, Micros, Millimetres, SourceId};

/// Names this firmware in its status: major, minor (one byte each) and patch version (two bytes).
pub const FIRMWARE_ID: u32 = {
    let [major, minor, patch] = [
        version_part(env!("CARGO_PKG_VERSION_MAJOR")),
        version_part(env!("CARGO_PKG_VERSION_MINOR")),
        version_part(env!("CARGO_PKG_VERSION_PATCH")),
    ];
    (major << 24) | (minor << 16) | patch
};

const fn version_part(digits: &str) -> u32 {
    match u32::from_str_radix(digits, 10) {
        Ok(part) => part,
        Err(_) => 0,
    }
}

/// The laser's drive at full brightness.
pub const LASER_FULL: u8 = u8::MAX;
/// The laser off.
pub const LASER_OFF: u8 = 0;

/// What the input pins say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PinInputs {
    /// The relays' mirror contacts.
    pub mirror: MirrorContacts,
    /// The reset button is pressed.
    pub reset_pressed: bool,
}

/// The lamp that tells people what the controller waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Indicator {
    /// Testing itself.
    Testing,
    /// Waiting for the reset button.
    WaitingForReset,
    /// The relays may close.
    Permitted,
    /// Stopped by a cause.
    Stopped,
    /// Locked out: call service.
    Service,
}

/// What the output pins are to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs {
    /// The relays' coils.
    pub relays: Channels,
    /// The laser's brightness, 0 = off, 255 = full.
    pub laser_level: u8,
    /// The lamp.
    pub indicator: Indicator,
}

impl Outputs {
    /// What pins are before the controller has said anything, and after any reset: everything off.
    pub const SAFE: Self =
        Self { relays: Channels::OPEN, laser_level: LASER_OFF, indicator: Indicator::Testing };
}

/// What a tick yields.
#[derive(Debug)]
pub struct TickOutput {
    /// For the pins.
    pub outputs: Outputs,
    /// For the watchdogs, after the pins were set; `None` = do not feed them.
    pub permit: Option<FeedPermit>,
}

/// Why the stored rig cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConfigurationError {
    /// The stored bytes are no valid rig.
    Rig(CompactRigError),
    /// A valid rig that yields no column maps.
    Geometry(GeometryError),
}

/// The report before the first line-scan.
const UNSEEN: StripeReport = StripeReport {
    cutoff: Cutoff { voted: None, single: None, floor_columns: 0 },
    heights: Heights { highest: None, lowest: None, longest_unknown: Millimetres::ZERO },
    large: false,
    watched_columns: 0,
};

/// The stripe monitor at the line-scan's size, about 37 KB.
pub type LineScanMonitor = StripeMonitor<LARGEST_COLUMN_COUNT>;

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
    report: StripeReport,
    evidence: Option<Evidence>,
    /// Causes since the last tick.
    events: StopCauses,
    live: StopCauses,
    state: State,
    relays: Relays,
    mirror: MirrorContacts,
    button: ResetButton,
    flow: FlowMonitor,
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
            report: UNSEEN,
            evidence: None,
            events: StopCauses::NONE,
            live: StopCauses::NONE.with(StopCause::SelfTest),
            state: State::SelfTest { latched: StopCauses::NONE },
            relays: Relays::new(),
            mirror: MirrorContacts { a: false, b: false },
            button: ResetButton::new(),
            flow: FlowMonitor::new(),
            statuses_sent: 0,
            decision_age: Micros::ZERO,
            longest_decision_age: Micros::ZERO,
        }
    }

    /// After every reset of the chip: forgets everything, takes the stored rig (its compact form) and the reason of
    /// the reset. Without a valid rig the relays never close. Filling the maps takes some 400 million instructions, so
    /// the watchdogs start afterwards.
    ///
    /// # Errors
    /// Why there is no valid rig (for a log; the controller has already taken it as a cause to stop).
    pub fn start(&mut self, reset_cause: ResetCause, stored_rig: &[u8]) -> Result<(), ConfigurationError> {
        self.calibration = None;
        let configured = self.configure(stored_rig);
        let columns = self.monitor.borrow().geometry().column_count();
        self.receiver = Receiver::new(self.source, self.calibration, columns);
        self.reset_cause = reset_cause;
        self.judge = Judge::new();
        self.report = UNSEEN;
        self.evidence = None;
        self.events = StopCauses::NONE;
        let watchdog = reset_cause == ResetCause::Watchdog;
        self.state =
            State::SelfTest { latched: StopCauses::NONE.with_if(StopCause::WatchdogReset, watchdog) };
        self.live = StopCauses::NONE.with(StopCause::SelfTest);
        self.relays = Relays::new();
        self.mirror = MirrorContacts { a: false, b: false };
        self.button = ResetButton::new();
        self.flow = FlowMonitor::new();
        self.statuses_sent = 0;
        self.decision_age = Micros::ZERO;
        self.longest_decision_age = Micros::ZERO;
        configured
    }

    fn configure(&mut self, stored_rig: &[u8]) -> Result<(), ConfigurationError> {
        let rig = Rig::from_bytes(stored_rig).map_err(ConfigurationError::Rig)?;
        let decimation = Decimation::for_line_scan(rig.image().width);
        self.monitor.borrow_mut().configure(&rig, decimation).map_err(ConfigurationError::Geometry)?;
        self.calibration = Some(rig.calibration_id());
        Ok(())
    }

    /// One tick of the safety task.
    pub fn tick(&mut self, now: Micros, pins: PinInputs) -> TickOutput {
        self.flow.begin(now);
        self.mirror = pins.mirror;
        let feedback = self.relays.check(now, pins.mirror);
        let armed = self.state.code() == StateCode::Interlocked;
        let button = self.button.step(now, pins.reset_pressed, armed);
        self.flow.pass(Checkpoint::Inputs);
        self.receiver.expire(now);
        self.flow.pass(Checkpoint::Link);
        let inputs = Inputs {
            evidence: self.evidence,
            link: self.receiver.faults(),
            events: self.events,
            feedback,
            command_intact: self.relays.is_memory_intact(),
            flow_intact: self.flow.is_intact(),
            configured: self.calibration.is_some(),
            button_stuck: button.stuck,
            reset: button.reset,
        };
        let (state, decision) = supervisor::step(self.state, now, &inputs);
        (self.state, self.live, self.events) = (state, decision.live, StopCauses::NONE);
        self.flow.pass(Checkpoint::Decision);
        if decision.close_relays {
            self.relays.close();
        } else {
            self.relays.open();
        }
        self.flow.pass(Checkpoint::Command);
        TickOutput { outputs: self.outputs(), permit: self.flow.finish() }
    }

    /// An exchange with the host has taken place: the last [`Self::status`] went out, and a line-scan came in, or
    /// none. Opens the relays at once if it gives a reason to; closing is the tick's.
    pub fn on_exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Outputs {
        self.statuses_sent = self.statuses_sent.saturating_add(1);
        self.receiver.status_sent(self.statuses_sent, now);
        if let Some(message) = line_scan {
            let causes = match self.receiver.receive(now, message) {
                Ok(accepted) => self.evaluate(now, &accepted),
                Err(refusal) => StopCauses::NONE.with(refusal.cause()),
            };
            self.raise(causes);
        }
        self.outputs()
    }

    /// Takes the evidence of an accepted line-scan; returns the causes that it leaves standing.
    fn evaluate(&mut self, now: Micros, accepted: &Accepted<'_>) -> StopCauses {
        if accepted.after_silence {
            self.monitor.borrow_mut().reset();
            self.judge.reset();
        }
        self.report = self.monitor.borrow_mut().update(accepted.scan.readings());
        let evidence = self.judge.judge(now, &self.report, accepted.scan.header().verdict);
        self.evidence = Some(evidence);
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

    /// What the pins are to be.
    #[must_use]
    pub fn outputs(&self) -> Outputs {
        let code = self.state.code();
        Outputs {
            relays: self.relays.command(),
            laser_level: if code == StateCode::Lockout { LASER_OFF } else { LASER_FULL },
            indicator: match code {
                StateCode::SelfTest => Indicator::Testing,
                StateCode::Interlocked => Indicator::WaitingForReset,
                StateCode::Running => Indicator::Permitted,
                StateCode::Stopped => Indicator::Stopped,
                StateCode::Lockout => Indicator::Service,
            },
        }
    }

    /// The status to send in the next exchange. Its number moves on with [`Self::on_exchange`].
    #[must_use]
    pub fn status(&self, now: Micros) -> [u8; STATUS_LENGTH] {
        let LinkCounts { accepted, refused } = self.receiver.counts();
        Status {
            source: self.source,
            calibration: self.calibration,
            firmware: FIRMWARE_ID,
            number: self.statuses_sent.saturating_add(1),
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
            laser_level: self.outputs().laser_level,
            decision_age: self.decision_age,
            longest_decision_age: self.longest_decision_age,
            response_bound: LONGEST_CAPTURE_AGE.plus(LONGEST_MESSAGE_AGE),
            accepted,
            refused,
            challenge: Challenge::default(),
        }
        .to_bytes()
    }

    /// The rig in use.
    #[must_use]
    pub const fn calibration(&self) -> Option<CalibrationId> {
        self.calibration
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, SOURCE};
    use nearfield_shared::limits::LONGEST_TICK_PERIOD;
    use nearfield_shared::linescan::HostVerdict;

    fn status(bench: &Bench) -> Status {
        Status::parse(&bench.controller.status(bench.now)).unwrap()
    }

    #[test]
    fn an_armed_controller_closes_feeds_and_tells() {
        let mut bench = Bench::after(ResetCause::PowerOn);
        bench.arm();
        let output = bench.clean_frame();
        assert_eq!(
            output.outputs,
            Outputs { relays: Channels::CLOSED, laser_level: LASER_FULL, indicator: Indicator::Permitted }
        );
        assert!(output.permit.is_some());
        let status = status(&bench);
        assert_eq!((status.state, status.reset_cause), (StateCode::Running, ResetCause::PowerOn));
        assert_eq!((status.relay_command, status.relay_readback), (Channels::CLOSED, Channels::CLOSED));
        assert!(status.live_causes.is_empty() && status.latched_causes.is_empty());
        assert_eq!(status.accepted, 17);
        assert_eq!(status.refused, [0; 8]);
        assert_eq!(status.echoed_sequence.get(), bench.sequence);
        assert_eq!(
            status.decision_age,
            Micros::from_millis(40),
            "20 ms by the host's word, 20 ms since the status"
        );
        assert!(status.decision_age <= status.response_bound);
    }

    #[test]
    fn an_exchange_can_open_the_relays_at_once_and_never_close_them() {
        let mut bench = Bench::after(ResetCause::PowerOn);
        bench.arm();
        let scan = bench.scan(None, HostVerdict::Clear);
        bench.exchange(Some(&scan));
        assert_eq!(bench.controller.outputs().relays, Channels::OPEN, "before the next tick");
        // Good again within the same tick period: the event is not forgotten.
        for _ in 0..3 {
            let scan = bench.scan(Some(0.0), HostVerdict::Clear);
            bench.exchange(Some(&scan));
            assert_eq!(bench.controller.outputs().relays, Channels::OPEN);
        }
        assert_eq!(bench.tick().outputs.relays, Channels::OPEN);
        assert_eq!(status(&bench).state, StateCode::Stopped);
        assert!(status(&bench).latched_causes.contains(StopCause::StripeMissing));
    }

    #[test]
    fn a_late_tick_stops_and_yields_no_permit() {
        for (late, stops) in [(0, false), (1, true)] {
            let mut bench = Bench::after(ResetCause::PowerOn);
            bench.arm();
            bench.clean_frame();
            let last = Micros::new(bench.now.get() - 5_000);
            bench.now = Micros::new(last.plus(LONGEST_TICK_PERIOD).get() + late);
            let output = bench.tick();
            assert_eq!(output.permit.is_none(), stops);
            assert_eq!(output.outputs.relays == Channels::OPEN, stops);
            assert_eq!(status(&bench).live_causes.contains(StopCause::ProgramFlow), stops);
        }
    }

    #[test]
    fn a_stop_is_no_reason_to_starve_the_watchdog() {
        let mut bench = Bench::after(ResetCause::PowerOn);
        for _ in 0..20 {
            assert!(bench.tick().permit.is_some());
        }
        assert!(status(&bench).live_causes.contains(StopCause::LinkTimeout));
    }

    #[test]
    fn a_watchdogs_reset_is_told_until_the_reset_button_is_pressed() {
        let mut bench = Bench::after(ResetCause::Watchdog);
        bench.exchange(None);
        for _ in 0..6 {
            bench.clean_frame();
        }
        assert_eq!(status(&bench).state, StateCode::Interlocked);
        assert!(status(&bench).latched_causes.contains(StopCause::WatchdogReset));
        assert_eq!(status(&bench).reset_cause, ResetCause::Watchdog);
        bench.arm();
        assert!(status(&bench).latched_causes.is_empty());
    }

    #[test]
    fn a_start_forgets_everything_that_was() {
        let mut bench = Bench::after(ResetCause::PowerOn);
        bench.arm();
        let rig = crate::testing::rig().to_bytes();
        bench.controller.start(ResetCause::Pin, &rig).unwrap();
        let mut fresh = SafetyController::new(SOURCE, Box::new(LineScanMonitor::new()));
        fresh.start(ResetCause::Pin, &rig).unwrap();
        assert_eq!(bench.controller.status(bench.now), fresh.status(bench.now));
        assert_eq!(bench.controller.outputs().relays, Channels::OPEN);
    }

    #[test]
    fn a_rig_that_is_refused_is_told_and_stops() {
        let mut bench = Bench::after(ResetCause::PowerOn);
        let refused = bench.controller.start(ResetCause::PowerOn, &[]);
        assert_eq!(refused, Err(ConfigurationError::Rig(CompactRigError::NotARig)));
        bench.tick();
        assert!(status(&bench).live_causes.contains(StopCause::Configuration));
        assert_eq!(bench.controller.calibration(), None);
    }

    #[test]
    fn the_firmware_names_its_version() {
        let [major, minor, patch] =
            env!("CARGO_PKG_VERSION").split('.').map(|part| part.parse::<u32>().unwrap()).collect::<Vec<_>>()
                [..]
        else {
            panic!("a version has three parts")
        };
        assert_eq!(FIRMWARE_ID, major * 0x100_0000 + minor * 0x1_0000 + patch);
    }
}
