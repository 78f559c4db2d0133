//! What the controller has come to, for the record: nothing here decides.

use super::{LineScanMonitor, SafetyController};
use core::borrow::BorrowMut;
use nearfield_shared::causes::StopCauses;
use nearfield_shared::condition::{Channels, FaultCode, ResetCause, StateCode};
use nearfield_shared::monitor::StripeReport;
use nearfield_shared::units::{CalibrationId, Micros, SequenceNumber};

/// A look at the controller after a tick or an exchange.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Findings {
    /// The supervisor's state.
    pub state: StateCode,
    /// The fault that it is locked out by.
    pub fault: Option<FaultCode>,
    /// Causes that hold now, those since the last tick included.
    pub causes: StopCauses,
    /// The last accepted line-scan's report.
    pub report: StripeReport,
    /// The last accepted line-scan's number.
    pub sequence: SequenceNumber,
    /// Line-scans accepted since start.
    pub accepted: u32,
    /// From the last accepted line-scan's exposure to its decision.
    pub decision_age: Micros,
    /// The laser's doubt.
    pub liveness_doubt: u16,
    /// The audit's doubt.
    pub audit_doubt: u16,
    /// Brightness that the laser is driven with.
    pub laser_level: u8,
    /// What the relays are told.
    pub relays: Channels,
    /// What their mirror contacts said at the last tick; both open = proven open.
    pub contacts: Channels,
    /// The rig in use.
    pub calibration: Option<CalibrationId>,
    /// Why the chip was reset.
    pub reset_cause: ResetCause,
    /// Number of the next status.
    pub next_status: u32,
}

impl<M: BorrowMut<LineScanMonitor>> SafetyController<M> {
    /// A look at what it has come to.
    #[must_use]
    pub fn findings(&self) -> Findings {
        Findings {
            state: self.state.code(),
            fault: self.state.fault(),
            causes: self.live.union(self.events),
            report: self.report,
            sequence: self.receiver.echoed_sequence(),
            accepted: self.receiver.counts().accepted,
            decision_age: self.decision_age,
            liveness_doubt: self.liveness.doubt(),
            audit_doubt: self.auditor.doubt(),
            laser_level: self.laser.level(),
            relays: self.relays.command(),
            contacts: self.mirror.main_contacts(),
            calibration: self.calibration,
            reset_cause: self.reset_cause,
            next_status: self.statuses_sent.saturating_add(1),
        }
    }
}
