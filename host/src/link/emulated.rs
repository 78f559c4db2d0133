//! The firmware's own Arm binary in QEMU (`mps2-an386`, a Cortex-M4F), in lock-step: it takes its time from this
//! process record by record, over two FIFOs that the binary opens by semihosting.
//!
//! Its relays are LEDs of the emulated board; QEMU's trace of them is read and compared with what the controller
//! says. Its watchdog is the board's, running on emulated instructions; its bite is seen through QEMU's monitor
//! protocol (QMP). Everything lives in a temporary directory and goes away with this value.

use super::{LinkError, McuKind, McuLink, Outputs, Reply, SECRET_LENGTH, SimulatedTick, Watchdog};
use crate::link::emulator::{Emulator, Relays};
use nearfield_firmware::lockstep::{REPLY_LENGTH, Request, RequestHeader};
use nearfield_shared::limits::LARGEST_TRANSFER;
use nearfield_shared::service::{NO_PAGE, PageBytes};
use nearfield_shared::status::{Channels, STATUS_LENGTH};
use nearfield_shared::units::Micros;

/// A controller in QEMU.
pub struct Emulated {
    emulator: Emulator,
    /// The secret and the stored rig, as the start's payload.
    power_up: Vec<u8>,
    watchdog: Watchdog,
    watchdog_resets: u32,
}

impl Emulated {
    /// Starts QEMU with the emulator's firmware, found by [`emulator_firmware`](super::emulator_firmware).
    ///
    /// # Errors
    /// No QEMU, no firmware, or one of them does not start.
    pub fn new() -> Result<Self, LinkError> {
        Ok(Self {
            emulator: Emulator::launch("lockstep")?,
            power_up: Vec::new(),
            watchdog: Watchdog::new(),
            watchdog_resets: 0,
        })
    }

    /// Bites of the emulated board's watchdog so far, each seen as QEMU's `WATCHDOG` and `RESET` events.
    #[must_use]
    pub const fn watchdog_resets(&self) -> u32 {
        self.watchdog_resets
    }

    /// The relay coils as the emulated board's LEDs show them, whatever the controller says.
    ///
    /// # Errors
    /// QEMU's trace cannot be read.
    pub fn coils_seen(&mut self) -> Result<Channels, LinkError> {
        self.emulator.relays().map(|Relays { a, b }| Channels { a, b })
    }

    fn ask(&mut self, request: Request, now: Micros, payload: &[u8]) -> Result<Reply, LinkError> {
        let too_long = || LinkError::TooLong { length: payload.len() };
        if payload.len() > LARGEST_TRANSFER {
            return Err(too_long());
        }
        let payload_length = u16::try_from(payload.len()).map_err(|_| too_long())?;
        let header = RequestHeader { request, now, payload_length };
        self.emulator.send(&[&header.to_bytes(), payload].concat())?;
        let mut bytes = [0; REPLY_LENGTH];
        self.emulator.receive(&mut bytes, "a lock-step request")?;
        let reply = Reply::parse(&bytes, request)?;
        let seen = self.coils_seen()?;
        if seen != reply.outputs.relays {
            let bits = |channels: Channels| u8::from(channels.a) | (u8::from(channels.b) << 1);
            return Err(LinkError::RelaysDisagree { seen: bits(seen), said: bits(reply.outputs.relays) });
        }
        Ok(reply)
    }

    fn restart(&mut self, now: Micros) -> Result<Reply, LinkError> {
        let power_up = std::mem::take(&mut self.power_up);
        let reply = self.ask(Request::Start, now, &power_up);
        self.power_up = power_up;
        let reply = Reply { outputs: Outputs::SAFE, ..reply? };
        self.watchdog.started(now, &reply);
        Ok(reply)
    }

    fn bite_if_due(&mut self, now: Micros) -> Result<(), LinkError> {
        if self.watchdog.bites(now) {
            if !self.watchdog.hung {
                // On this time its program has not run for too long, though the emulated clock does not know it.
                self.hang(now)?;
            }
            self.restart(now)?;
        }
        Ok(())
    }
}

impl McuLink for Emulated {
    fn kind(&self) -> McuKind {
        McuKind::Emulated
    }

    fn start(
        &mut self,
        now: Micros,
        secret: [u8; SECRET_LENGTH],
        stored_rig: &[u8],
    ) -> Result<Reply, LinkError> {
        self.power_up = [&secret, stored_rig].concat();
        self.restart(now)
    }

    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError> {
        self.bite_if_due(now)?;
        if let Some(frozen) = self.watchdog.frozen() {
            return Ok(frozen);
        }
        let reply = self.ask(Request::Tick(inputs), now, &[])?;
        self.watchdog.ticked(now, &reply);
        Ok(reply)
    }

    fn exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Result<Reply, LinkError> {
        self.bite_if_due(now)?;
        if let Some(frozen) = self.watchdog.frozen() {
            return Ok(Reply { status: [0; STATUS_LENGTH], ..frozen });
        }
        let reply = self.ask(Request::Exchange, now, line_scan.unwrap_or(&[]))?;
        self.watchdog.ticked(now, &reply);
        Ok(reply)
    }

    fn service_page(&mut self, now: Micros) -> Result<PageBytes, LinkError> {
        if self.watchdog.hung {
            return Ok(NO_PAGE);
        }
        let header = RequestHeader { request: Request::Page, now, payload_length: 0 };
        self.emulator.send(&header.to_bytes())?;
        let mut page = NO_PAGE;
        self.emulator.receive(&mut page, "a request for the service page")?;
        Ok(page)
    }

    /// The emulated watchdog bites in emulated time, at once in the host's: by the return of this call the chip has
    /// been reset. What it shows until the host's time has come to the bite is what it showed when it hung.
    fn hang(&mut self, now: Micros) -> Result<(), LinkError> {
        if self.watchdog.hung {
            return Ok(());
        }
        let header = RequestHeader { request: Request::Hang, now, payload_length: 0 };
        self.emulator.send(&header.to_bytes())?;
        self.emulator.wait_for_event("WATCHDOG")?;
        self.emulator.wait_for_event("RESET")?;
        self.watchdog_resets = self.watchdog_resets.saturating_add(1);
        self.watchdog.hung = true;
        self.emulator.wait_until_open()
    }
}
