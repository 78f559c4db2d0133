//! The safety controller with a recorder beside it: black box, fault log and service.
//!
//! [`RecordedController`] stands where a binary would otherwise hold a [`SafetyController`]. The controller decides as
//! if it were alone: outputs pass through unchanged, and nothing that is recorded or asked for leads back to it. A
//! message that is a whole service request is an exchange without a line-scan to the controller.
//!
//! ```text
//!  start:     store.load_log(recorded.fault_log()) -> recorded.start(...)
//!  tick:      recorded.tick(now, inputs)
//!  exchange:  status and recorded.page() go out -> recorded.on_exchange(now, message)
//!  later, below the safety task:
//!             recorded.take_job() -> store.run(&job) -> recorded.finish_job(&outcome)
//!             recorded.unsaved_fault() -> store.save_entry(&entry) -> recorded.fault_saved(&entry)
//! ```

use super::BlackBox;
use crate::fault_log::{FaultLog, Occurrence};
use crate::relay::MirrorContacts;
use crate::safety::{
    ConfigurationError, Findings, LineScanMonitor, Outputs, SafetyController, StartInputs, TickInputs,
    TickOutput,
};
use crate::service::{FlashJob, JobOutcome, Permissions, Records, Service};
use core::borrow::BorrowMut;
use nearfield_shared::causes::StopCauses;
use nearfield_shared::condition::{Channels, FaultCode, StateCode};
use nearfield_shared::limits::LINK_TIMEOUT;
use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::service::{ExchangeKind, FaultEntry, FaultEvent, PageBytes, Request, Summary};
use nearfield_shared::status::STATUS_LENGTH;
use nearfield_shared::units::{Micros, SourceId};

/// The recorder's memory, about 22 KB.
#[derive(Debug, Clone)]
pub struct RecorderMemory {
    black_box: BlackBox,
    fault_log: FaultLog,
    service: Service,
    job: Option<FlashJob>,
}

impl RecorderMemory {
    /// Empty, for the module of this source id.
    #[must_use]
    pub const fn new(source: SourceId) -> Self {
        Self {
            black_box: BlackBox::new(),
            fault_log: FaultLog::new(),
            service: Service::new(source),
            job: None,
        }
    }
}

/// See the module's documentation. `M` holds the monitor, `R` the recorder's memory.
#[derive(Debug)]
pub struct RecordedController<M, R> {
    controller: SafetyController<M>,
    recorder: R,
    service_key: bool,
    last_accepted: Option<Micros>,
    /// As of the last call.
    relays: Channels,
    state: StateCode,
    causes: StopCauses,
}

impl<M: BorrowMut<LineScanMonitor>, R: BorrowMut<RecorderMemory>> RecordedController<M, R> {
    /// Beside a controller that was not started yet.
    #[must_use]
    pub const fn new(controller: SafetyController<M>, recorder: R) -> Self {
        Self {
            controller,
            recorder,
            service_key: false,
            last_accepted: None,
            relays: Channels::OPEN,
            state: StateCode::SelfTest,
            causes: StopCauses::NONE,
        }
    }

    /// The controller.
    #[must_use]
    pub const fn controller(&self) -> &SafetyController<M> {
        &self.controller
    }

    /// The fault log, to restore what the flash holds before the start.
    pub fn fault_log(&mut self) -> &mut FaultLog {
        &mut self.recorder.borrow_mut().fault_log
    }

    /// See [`SafetyController::start`].
    ///
    /// # Errors
    /// Why there is no valid rig.
    pub fn start(&mut self, inputs: &StartInputs<'_>) -> Result<(), ConfigurationError> {
        let configured = self.controller.start(inputs);
        let Findings { state, causes, relays, .. } = self.controller.findings();
        (self.state, self.causes, self.relays) = (state, causes, relays);
        (self.service_key, self.last_accepted) = (false, None);
        self.recorder.borrow_mut().fault_log.started(inputs.reset_cause, causes);
        configured
    }

    /// See [`SafetyController::tick`].
    pub fn tick(&mut self, now: Micros, inputs: TickInputs) -> TickOutput {
        let output = self.controller.tick(now, inputs);
        self.service_key = inputs.pins.service_key;
        let findings = self.controller.findings();
        if (findings.state, findings.causes) != (self.state, self.causes) {
            let summary = self.summary_of(now, ExchangeKind::Tick, &findings);
            self.recorder.borrow_mut().black_box.record(&summary);
        }
        self.follow(now, &findings);
        output
    }

    /// See [`SafetyController::on_exchange`]; a service request is answered by a later [`Self::page`].
    pub fn on_exchange(&mut self, now: Micros, message: Option<&[u8]>) -> Outputs {
        if let Some(request) = message.and_then(Request::parse) {
            let outputs = self.controller.on_exchange(now, None);
            let findings = self.controller.findings();
            self.follow(now, &findings);
            self.answer(&request, &findings);
            return outputs;
        }
        let accepted_before = self.controller.findings().accepted;
        let outputs = self.controller.on_exchange(now, message);
        let findings = self.controller.findings();
        let kind = match message {
            None => ExchangeKind::Poll,
            Some(_) if findings.accepted == accepted_before => ExchangeKind::Refused,
            Some(_) => self.accepted_kind(now),
        };
        let mut summary = self.summary_of(now, kind, &findings);
        let recorder = self.recorder.borrow_mut();
        if let Some(message) = message {
            summary.capture_age = told_capture_age(message);
            let bytes = message.first_chunk::<LINE_SCAN_LENGTH>();
            if let (Some(bytes), true) = (bytes, kind.is_accepted()) {
                recorder.black_box.line_scan(bytes);
            }
        }
        recorder.black_box.record(&summary);
        self.follow(now, &findings);
        outputs
    }

    fn summary_of(&self, now: Micros, kind: ExchangeKind, findings: &Findings) -> Summary {
        Summary {
            sequence: findings.sequence,
            live_causes: findings.causes,
            new_causes: self.causes.iter().fold(findings.causes, StopCauses::without),
            laser_level: findings.laser_level,
            decision_age: findings.decision_age,
            liveness_score: findings.liveness_doubt,
            audit_score: findings.audit_doubt,
            ..Summary::new(now, findings.state, kind).with_report(&findings.report)
        }
    }

    /// The controller's votes begin anew after a silence that has timed out.
    fn accepted_kind(&mut self, now: Micros) -> ExchangeKind {
        let before = self.last_accepted.replace(now);
        if before.is_some_and(|before| now.since(before) <= LINK_TIMEOUT) {
            ExchangeKind::Accepted
        } else {
            ExchangeKind::AcceptedAfterSilence
        }
    }

    /// Stops, lock-outs and arming, as the relays' command and the state tell them.
    fn follow(&mut self, now: Micros, findings: &Findings) {
        let recorder = self.recorder.borrow_mut();
        let (was_closed, is_closed) = (self.relays != Channels::OPEN, findings.relays != Channels::OPEN);
        if is_closed && !was_closed {
            recorder.black_box.armed();
        }
        if was_closed && !is_closed {
            recorder.black_box.stop(now, findings.causes, findings.calibration);
            recorder.fault_log.record(&occurrence(now, FaultEvent::Stopped, StateCode::Stopped, findings));
        }
        let locked_out = findings.state == StateCode::Lockout && self.state != StateCode::Lockout;
        if locked_out {
            recorder.fault_log.record(&occurrence(now, FaultEvent::LockedOut, StateCode::Lockout, findings));
        }
        (self.relays, self.state, self.causes) = (findings.relays, findings.state, findings.causes);
    }

    fn answer(&mut self, request: &Request<'_>, findings: &Findings) {
        let open = MirrorContacts::BOTH_OPEN.main_contacts();
        let permissions = Permissions {
            service_key: self.service_key,
            relays_proven_open: findings.contacts == open && findings.relays == Channels::OPEN,
            state: findings.state,
        };
        let RecorderMemory { black_box, fault_log, service, job } = self.recorder.borrow_mut();
        let records = Records { black_box, fault_log };
        if let Some(new_job) = service.answer(request, &permissions, &records) {
            *job = Some(new_job);
        }
    }

    /// See [`SafetyController::status`].
    #[must_use]
    pub fn status(&self, now: Micros) -> [u8; STATUS_LENGTH] {
        self.controller.status(now)
    }

    /// See [`SafetyController::outputs`].
    #[must_use]
    pub fn outputs(&self) -> Outputs {
        self.controller.outputs()
    }

    /// What the next transaction carries at [`PAGE_OFFSET`](nearfield_shared::service::PAGE_OFFSET).
    #[must_use]
    pub fn page(&self) -> &PageBytes {
        self.recorder.borrow().service.page()
    }

    /// What a request needs of the flash; each job is given once.
    #[must_use]
    pub fn take_job(&mut self) -> Option<FlashJob> {
        self.recorder.borrow_mut().job.take()
    }

    /// What came of the job.
    pub fn finish_job(&mut self, now: Micros, outcome: &JobOutcome) {
        let findings = self.controller.findings();
        let recorder = self.recorder.borrow_mut();
        if let Some(rig) = recorder.service.finish(outcome) {
            let changed = occurrence(now, FaultEvent::RigChanged, findings.state, &findings);
            recorder.fault_log.record(&Occurrence { detail: rig.get(), ..changed });
        }
    }

    /// The oldest entry of the fault log that is not in flash.
    #[must_use]
    pub fn unsaved_fault(&self) -> Option<FaultEntry> {
        self.recorder.borrow().fault_log.unsaved()
    }

    /// This entry is in flash now.
    pub fn fault_saved(&mut self, entry: &FaultEntry) {
        self.recorder.borrow_mut().fault_log.saved(entry);
    }
}

/// The host's word on its picture's age, also of a message that was refused; zero where there is none.
fn told_capture_age(message: &[u8]) -> Micros {
    let age = message.get(16..).and_then(<[u8]>::first_chunk::<4>);
    Micros::new(u64::from(age.map_or(0, |age| u32::from_le_bytes(*age))))
}

fn occurrence(now: Micros, event: FaultEvent, state: StateCode, findings: &Findings) -> Occurrence {
    Occurrence {
        event,
        time: now,
        status: findings.next_status,
        causes: findings.causes,
        state,
        reset_cause: findings.reset_cause,
        fault: findings.fault.map_or(0, FaultCode::code),
        detail: 0,
    }
}

#[cfg(test)]
mod tests;
