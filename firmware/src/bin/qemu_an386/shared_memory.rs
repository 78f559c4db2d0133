//! The controller as tasks on the board's own clock: a safety task every 5 ms, and a host that shares the memory at
//! [`SHARED`] and rings a doorbell on the serial line.
//!
//! | offset | written by | content |
//! |---|---|---|
//! | 0x0000 | host | line-scan |
//! | 0x1000 | board | status, every tick; after a doorbell the one that this exchange carries |
//! | 0x2000 | host, before start | the stored rig; from 0x20F0 on the secret (16 bytes) |
//! | 0x2100 | host | inputs u32: bit 0 reset button, bit 1 channel A welded, bit 2 channel B welded |
//!
//! The host rings with `D` (line-scan ready) or `P` (status only); the board answers `R` when the exchange is over.
//! Its relays are ideal: the mirror contacts follow the LEDs at once, but for the injected welds.

use crate::board::{self, Register, Watchdog};
use crate::self_tests::SelfTests;
use crate::target::Controller;
use core::ptr::{read_volatile, write_volatile};
use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use nearfield_firmware::output_test::PulseReadback;
use nearfield_firmware::relay::MirrorContacts;
use nearfield_firmware::safety::{Outputs, PinInputs, StartInputs, TickInputs};
use nearfield_firmware::secret::SECRET_LENGTH;
use nearfield_shared::limits::TICK_PERIOD;
use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::rig::COMPACT_LENGTH;
use nearfield_shared::status::{ResetCause, STATUS_LENGTH};
use nearfield_shared::units::Micros;
use static_cell::ConstStaticCell;

/// The board's PSRAM; QEMU can back it with a file that the host maps or reads.
const SHARED: usize = 0x2100_0000;
const LINE_SCAN: usize = SHARED;
const STATUS: usize = SHARED + 0x1000;
const STORED_RIG: usize = SHARED + 0x2000;
const SECRET: usize = SHARED + 0x20F0;
const INPUTS: Register = Register::new(SHARED + 0x2100);

const SERIAL_DATA: Register = Register::new(0x4000_4000);
const SERIAL_STATE: Register = Register::new(0x4000_4004);
const SERIAL_CONTROL: Register = Register::new(0x4000_4008);
const SERIAL_INTERRUPT: Register = Register::new(0x4000_400C);
const SERIAL_DIVIDER: Register = Register::new(0x4000_4010);

static DOORBELL: Signal<CriticalSectionRawMutex, u8> = Signal::new();
static RECEIVED: ConstStaticCell<[u8; LINE_SCAN_LENGTH]> = ConstStaticCell::new([0; LINE_SCAN_LENGTH]);

/// The host rings.
pub(crate) unsafe extern "C" fn on_serial_receive() {
    // Acknowledge before draining: a byte that lands in between would otherwise never interrupt.
    SERIAL_INTERRUPT.write(2);
    while SERIAL_STATE.read() & 2 != 0 {
        let [byte, ..] = SERIAL_DATA.read().to_le_bytes();
        DOORBELL.signal(byte);
    }
}

fn start_serial() {
    SERIAL_DIVIDER.write(16);
    // Transmitter, receiver and the receiver's interrupt.
    SERIAL_CONTROL.write(0b1011);
}

fn answer() {
    while SERIAL_STATE.read() & 1 != 0 {}
    SERIAL_DATA.write(u32::from(b'R'));
}

fn copy_in(address: usize, bytes: &mut [u8]) {
    for (offset, byte) in bytes.iter_mut().enumerate() {
        // SAFETY: within the shared PSRAM; volatile, since the host writes it.
        *byte = unsafe { read_volatile((address + offset) as *const u8) };
    }
}

fn copy_out(bytes: &[u8; STATUS_LENGTH]) {
    for (offset, byte) in bytes.iter().enumerate() {
        // SAFETY: within the shared PSRAM; volatile, since the host reads it.
        unsafe { write_volatile((STATUS + offset) as *mut u8, *byte) };
    }
}

fn now() -> Micros {
    Micros::new(Instant::now().as_micros())
}

/// Runs until the emulator ends.
pub(crate) async fn run(controller: &mut Controller, reset_cause: ResetCause) {
    let received = RECEIVED.take();
    let mut rig = [0; COMPACT_LENGTH];
    copy_in(STORED_RIG, &mut rig);
    // A rig that is refused is a cause to stop, and the status says so.
    let mut secret = [0; SECRET_LENGTH];
    copy_in(SECRET, &mut secret);
    let _ = controller.start(&StartInputs { reset_cause, stored_rig: &rig, secret });
    let mut self_tests = SelfTests::start(now(), &rig, controller.controller().calibration());
    let mut outputs = Outputs::SAFE;
    start_serial();
    let mut watchdog = Watchdog::start();
    let mut next_tick = Instant::now();
    loop {
        match select(DOORBELL.wait(), Timer::at(next_tick)).await {
            Either::First(ring) => {
                copy_out(&controller.status(now()));
                copy_in(LINE_SCAN, received);
                outputs = controller.on_exchange(now(), (ring == b'D').then_some(received.as_slice()));
                board::drive_relays(outputs.relays);
                answer();
            }
            Either::Second(()) => {
                // Measured from now: ticks that were missed are not made up for.
                next_tick = Instant::now() + Duration::from_micros(TICK_PERIOD.get());
                let self_test = self_tests.step(now(), controller.controller().calibration());
                let tick = controller.tick(now(), TickInputs { pins: read_inputs(outputs), self_test });
                outputs = tick.outputs;
                board::drive_relays(outputs.relays);
                if let Some(permit) = tick.permit {
                    watchdog.feed(permit);
                }
                copy_out(&controller.status(now()));
            }
        }
    }
}

fn read_inputs(outputs: Outputs) -> PinInputs {
    let inputs = INPUTS.read();
    let mirror =
        MirrorContacts { a: !outputs.relays.a && inputs & 2 == 0, b: !outputs.relays.b && inputs & 4 == 0 };
    // The LEDs cannot be read back: the drivers are ideal.
    let pulse =
        outputs.pulse.map(|channel| PulseReadback { channel, coils: channel.inverted_in(outputs.relays) });
    PinInputs { mirror, reset_pressed: inputs & 1 != 0, service_key: false, coils: outputs.relays, pulse }
}
