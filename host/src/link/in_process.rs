//! The firmware library in this process, with a model of the chip's watchdog around it.

use super::{LinkError, McuKind, McuLink, Outputs, Reply, SECRET_LENGTH, SimulatedTick, Watchdog};
use nearfield_firmware::safety::{LineScanMonitor, SafetyController, StartInputs};
use nearfield_shared::limits::LARGEST_TRANSFER;
use nearfield_shared::status::{ResetCause, STATUS_LENGTH};
use nearfield_shared::units::{Micros, SourceId};

/// The module that simulated controllers are; the emulator's binary is built with the same.
pub(super) const SIMULATED_SOURCE: SourceId = SourceId::new(1);

/// A controller in this process.
#[derive(Debug)]
pub struct InProcess {
    controller: SafetyController<Box<LineScanMonitor>>,
    secret: [u8; SECRET_LENGTH],
    stored_rig: Vec<u8>,
    watchdog: Watchdog,
}

impl InProcess {
    /// Without power; see [`McuLink::start`].
    #[must_use]
    pub fn new() -> Self {
        Self {
            controller: SafetyController::new(SIMULATED_SOURCE, Box::new(LineScanMonitor::new())),
            secret: [0; SECRET_LENGTH],
            stored_rig: Vec::new(),
            watchdog: Watchdog::new(),
        }
    }

    fn restart(&mut self, now: Micros, cause: ResetCause) -> Reply {
        // A rig that is refused is the controller's own cause to stop, and its status says so.
        let start = StartInputs { reset_cause: cause, stored_rig: &self.stored_rig, secret: self.secret };
        let _ = self.controller.start(&start);
        let reply = Reply { outputs: Outputs::SAFE, fed: false, status: self.controller.status(now) };
        self.watchdog.started(now, &reply);
        reply
    }

    fn bite_if_due(&mut self, now: Micros) {
        if self.watchdog.bites(now) {
            self.restart(now, ResetCause::Watchdog);
        }
    }
}

impl Default for InProcess {
    fn default() -> Self {
        Self::new()
    }
}

impl McuLink for InProcess {
    fn kind(&self) -> McuKind {
        McuKind::InProcess
    }

    fn start(
        &mut self,
        now: Micros,
        secret: [u8; SECRET_LENGTH],
        stored_rig: &[u8],
    ) -> Result<Reply, LinkError> {
        self.secret = secret;
        self.stored_rig = stored_rig.to_vec();
        Ok(self.restart(now, ResetCause::PowerOn))
    }

    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError> {
        self.bite_if_due(now);
        if let Some(frozen) = self.watchdog.frozen() {
            return Ok(frozen);
        }
        let output = self.controller.tick(now, inputs.inputs(now));
        let reply = Reply {
            outputs: output.outputs,
            fed: output.permit.is_some(),
            status: self.controller.status(now),
        };
        self.watchdog.ticked(now, &reply);
        Ok(reply)
    }

    fn exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Result<Reply, LinkError> {
        if let Some(message) = line_scan.filter(|message| message.len() > LARGEST_TRANSFER) {
            return Err(LinkError::TooLong { length: message.len() });
        }
        self.bite_if_due(now);
        if let Some(frozen) = self.watchdog.frozen() {
            return Ok(Reply { status: [0; STATUS_LENGTH], ..frozen });
        }
        let status = self.controller.status(now);
        let outputs = self.controller.on_exchange(now, line_scan);
        let reply = Reply { outputs, fed: false, status };
        self.watchdog.ticked(now, &reply);
        Ok(reply)
    }

    fn hang(&mut self, _now: Micros) -> Result<(), LinkError> {
        self.watchdog.hung = true;
        Ok(())
    }
}
