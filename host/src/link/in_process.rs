//! The firmware library in this process, with a model of the chip's watchdog around it.

use super::{LinkError, McuKind, McuLink, Outputs, Reply, SECRET_LENGTH, SimulatedTick, Watchdog};
use crate::black_box::simulated_flash::SimulatedFlash;
use embassy_futures::block_on;
use nearfield_firmware::black_box::recorded::{RecordedController, RecorderMemory};
use nearfield_firmware::safety::{LineScanMonitor, SafetyController, StartInputs};
use nearfield_firmware::store::Store;
use nearfield_shared::limits::LARGEST_TRANSFER;
use nearfield_shared::rig::Rig;
use nearfield_shared::service::{NO_PAGE, PageBytes};
use nearfield_shared::status::{ResetCause, STATUS_LENGTH};
use nearfield_shared::units::{Micros, SourceId};

/// The module that simulated controllers are; the emulator's binary is built with the same.
pub(super) const SIMULATED_SOURCE: SourceId = SourceId::new(1);

type Controller = RecordedController<Box<LineScanMonitor>, Box<RecorderMemory>>;

/// A controller in this process.
#[derive(Debug)]
pub struct InProcess {
    controller: Controller,
    secret: [u8; SECRET_LENGTH],
    /// What is found in place of a rig while the flash holds none.
    no_rig: Vec<u8>,
    flash: SimulatedFlash,
    store: Store<SimulatedFlash>,
    watchdog: Watchdog,
}

impl InProcess {
    /// The module that it is.
    pub const SOURCE: SourceId = SIMULATED_SOURCE;

    /// Without power; see [`McuLink::start`].
    #[must_use]
    pub fn new() -> Self {
        Self::with_flash(SimulatedFlash::new())
    }

    /// As [`Self::new`], with what an earlier controller has left in its flash: its fault log, and its rig if that is
    /// the one that [`McuLink::start`] is told.
    #[must_use]
    pub fn with_flash(flash: SimulatedFlash) -> Self {
        Self {
            controller: Self::fresh_controller(),
            secret: [0; SECRET_LENGTH],
            no_rig: Vec::new(),
            store: Store::new(flash.clone(), 0),
            flash,
            watchdog: Watchdog::new(),
        }
    }

    /// A reset clears all memory.
    fn fresh_controller() -> Controller {
        let controller = SafetyController::new(SIMULATED_SOURCE, Box::new(LineScanMonitor::new()));
        RecordedController::new(controller, Box::new(RecorderMemory::new(SIMULATED_SOURCE)))
    }

    fn restart(&mut self, now: Micros, cause: ResetCause) -> Reply {
        self.controller = Self::fresh_controller();
        block_on(self.store.load_log(self.controller.fault_log()));
        let active = block_on(self.store.active_rig());
        let stored_rig = active.as_ref().map_or(&self.no_rig[..], |rig| rig);
        // A rig that is refused is the controller's own cause to stop, and its status says so.
        let _ = self.controller.start(&StartInputs { reset_cause: cause, stored_rig, secret: self.secret });
        self.work_on_flash(now);
        let reply = Reply { outputs: Outputs::SAFE, fed: false, status: self.controller.status(now) };
        self.watchdog.started(now, &reply);
        reply
    }

    fn bite_if_due(&mut self, now: Micros) {
        if self.watchdog.bites(now) {
            self.restart(now, ResetCause::Watchdog);
        }
    }

    /// What runs below the safety task on the board.
    fn work_on_flash(&mut self, now: Micros) {
        if let Some(job) = self.controller.take_job() {
            let outcome = block_on(self.store.run(&job));
            self.controller.finish_job(now, &outcome);
        }
        while let Some(entry) = self.controller.unsaved_fault() {
            if block_on(self.store.save_entry(&entry)).is_err() {
                break;
            }
            self.controller.fault_saved(&entry);
        }
    }

    /// The flash holds this rig at power-up, or something that is none.
    fn put_into_flash(&mut self, stored_rig: &[u8]) {
        self.no_rig = stored_rig.to_vec();
        let Ok(rig) = Rig::from_bytes(stored_rig) else {
            self.flash.forget_rig();
            return;
        };
        let compact = rig.to_bytes();
        if block_on(self.store.active_rig()) != Some(compact) {
            // A simulated flash takes every valid rig; one that it did not take would show as the wrong calibration.
            let _ = block_on(self.store.stage_rig(&compact));
            let _ = block_on(self.store.acknowledge_rig(rig.calibration_id()));
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
        self.put_into_flash(stored_rig);
        Ok(self.restart(now, ResetCause::PowerOn))
    }

    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError> {
        self.bite_if_due(now);
        if let Some(frozen) = self.watchdog.frozen() {
            return Ok(frozen);
        }
        let output = self.controller.tick(now, inputs.inputs(now));
        self.work_on_flash(now);
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

    fn service_page(&mut self, _now: Micros) -> Result<PageBytes, LinkError> {
        Ok(if self.watchdog.hung { NO_PAGE } else { *self.controller.page() })
    }

    fn hang(&mut self, _now: Micros) -> Result<(), LinkError> {
        self.watchdog.hung = true;
        Ok(())
    }
}
