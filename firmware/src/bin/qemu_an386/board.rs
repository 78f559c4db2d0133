//! The emulated board's registers: LEDs as relays, the watchdog, the reset's reason.

use crate::bare_metal::start_up;
use core::ptr::{read_volatile, write_volatile};
use nearfield_firmware::flow::FeedPermit;
use nearfield_shared::limits::WATCHDOG_TIMEOUT;
use nearfield_shared::status::{Channels, ResetCause};

/// The clock of processor and peripherals, Hz.
pub(crate) const CLOCK_HZ: u32 = 25_000_000;

/// A register of the board's peripherals.
#[derive(Clone, Copy)]
pub(crate) struct Register(usize);

impl Register {
    /// `address` must be a peripheral register of the mps2-an386 that may be read and written at any time.
    pub(crate) const fn new(address: usize) -> Self {
        Self(address)
    }

    pub(crate) fn read(self) -> u32 {
        // SAFETY: a register by the constructor's contract; reading it has no effect on memory.
        unsafe { read_volatile(self.0 as *const u32) }
    }

    pub(crate) fn write(self, value: u32) {
        // SAFETY: a register by the constructor's contract; none of them makes the hardware touch memory.
        unsafe { write_volatile(self.0 as *mut u32, value) }
    }
}

/// FPGAIO's LEDs: bit 0 channel A, bit 1 channel B.
const LEDS: Register = Register::new(0x4002_8000);

pub(crate) fn drive_relays(coils: Channels) {
    LEDS.write(u32::from(coils.a) | (u32::from(coils.b) << 1));
}

pub(crate) fn open_relays() {
    drive_relays(Channels::OPEN);
}

const WATCHDOG_LOAD: Register = Register::new(0x4000_8000);
const WATCHDOG_CONTROL: Register = Register::new(0x4000_8008);
const WATCHDOG_CLEAR: Register = Register::new(0x4000_800C);
const WATCHDOG_LOCK: Register = Register::new(0x4000_8C00);
const WATCHDOG_KEY: u32 = 0x1ACC_E551;

/// The board's watchdog (CMSDK): after half its time it interrupts, after the other half it resets.
pub(crate) struct Watchdog(());

impl Watchdog {
    pub(crate) fn start() -> Self {
        let half_micros = u32::try_from(WATCHDOG_TIMEOUT.get() / 2).unwrap_or(1);
        WATCHDOG_LOCK.write(WATCHDOG_KEY);
        WATCHDOG_LOAD.write(half_micros.saturating_mul(CLOCK_HZ / 1_000_000));
        // Interrupt and reset enabled.
        WATCHDOG_CONTROL.write(0b11);
        WATCHDOG_LOCK.write(1);
        Self(())
    }

    /// Only a whole tick on time may feed it.
    pub(crate) fn feed(&mut self, _permit: FeedPermit) {
        WATCHDOG_LOCK.write(WATCHDOG_KEY);
        WATCHDOG_CLEAR.write(1);
        WATCHDOG_LOCK.write(1);
    }
}

/// Left while the firmware runs: only the watchdog resets a board that carries it.
const RUNNING: u32 = 0x5257_4E47;
/// Left before a reset that the firmware asked for.
const RESTARTING: u32 = 0x5253_5452;

/// Why the board started; call once. This board has no register that tells: a word in memory that start-up keeps does.
pub(crate) fn reset_cause() -> ResetCause {
    let left = start_up::reset_reason();
    start_up::leave_reset_reason(RUNNING);
    match left {
        Some(RUNNING) => ResetCause::Watchdog,
        Some(RESTARTING) => ResetCause::Software,
        _ => ResetCause::PowerOn,
    }
}

/// Opens the relays, says why, and resets the board.
pub(crate) fn restart(why: &str) -> ! {
    open_relays();
    crate::semihosting::print(why);
    crate::semihosting::print("\n");
    start_up::leave_reset_reason(RESTARTING);
    cortex_m::peripheral::SCB::sys_reset()
}
