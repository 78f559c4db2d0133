//! Both watchdogs, their provoked test after power-up, and why the chip started.

use crate::bare_metal::start_up;
use embassy_stm32::Peri;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{IWDG, WWDG};
use embassy_stm32::wdg::{IndependentWatchdog, WindowWatchdog};
use nearfield_firmware::flow::FeedPermit;
use nearfield_firmware::selftest::Outcome;
use nearfield_firmware::selftest::watchdog::{self, ResetFlags, Start, Watchdog};
use nearfield_shared::limits::WATCHDOG_TIMEOUT;
use nearfield_shared::status::ResetCause;

/// The window watchdog bites a little before the independent one: both are seen to work by their own flags.
const WINDOW_WATCHDOG_MICROS: u32 = 90_000;
/// Feeding again within this time is a reset: the program runs wild. The tick period is 5 ms.
const CLOSED_WINDOW_MICROS: u32 = 3_100;
/// How long a provoked bite is awaited, in cycles of the processor: 200 ms, twice the longer time-out.
const BITE_CYCLES: u32 = 200 * 170_000;

/// The watchdogs before their start.
pub(crate) struct WatchdogParts {
    pub(crate) independent: Peri<'static, IWDG>,
    pub(crate) window: Peri<'static, WWDG>,
}

impl WatchdogParts {
    fn start_window(&mut self) {
        let _running =
            WindowWatchdog::new(self.window.reborrow(), WINDOW_WATCHDOG_MICROS, CLOSED_WINDOW_MICROS);
    }

    fn start_independent(&mut self) {
        IndependentWatchdog::new(self.independent.reborrow(), independent_micros()).unleash();
    }
}

fn independent_micros() -> u32 {
    u32::try_from(WATCHDOG_TIMEOUT.get()).unwrap_or(WINDOW_WATCHDOG_MICROS)
}

/// The chip's reset flags; clears them for the next time.
fn take_reset_flags() -> ResetFlags {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|register| register.set_rmvf(true));
    ResetFlags {
        power: flags.borrstf(),
        pin: flags.pinrstf(),
        software: flags.sftrstf(),
        window_watchdog: flags.wwdgrstf(),
        independent_watchdog: flags.iwdgrstf(),
        other: flags.lpwrrstf() || flags.oblrstf(),
    }
}

/// After power-up lets each watchdog bite once, which resets the chip; in the start after that tells why the chip
/// started first, and whether both have bitten. The relays are open all the while.
pub(crate) fn test(parts: &mut WatchdogParts) -> (ResetCause, Outcome) {
    let (marker, start) = watchdog::after_reset(start_up::marker(), take_reset_flags());
    start_up::leave(marker);
    match start {
        Start::Run { cause, watchdogs } => (cause, watchdogs),
        Start::Provoke(which) => {
            match which {
                Watchdog::Window => parts.start_window(),
                Watchdog::Independent => parts.start_independent(),
            }
            cortex_m::asm::delay(BITE_CYCLES);
            // Still here: it does not bite.
            start_up::leave(marker.failed());
            (ResetCause::Unknown, Outcome::Failed)
        }
    }
}

/// Both watchdogs; from their start on only permits keep the chip alive.
pub(crate) struct Watchdogs {
    independent: IndependentWatchdog<'static, IWDG>,
    window: WindowWatchdog<'static, WWDG>,
}

impl Watchdogs {
    pub(crate) fn start(parts: WatchdogParts) -> Self {
        let mut independent = IndependentWatchdog::new(parts.independent, independent_micros());
        independent.unleash();
        let window = WindowWatchdog::new(parts.window, WINDOW_WATCHDOG_MICROS, CLOSED_WINDOW_MICROS);
        Self { independent, window }
    }

    /// Only a whole tick on time may feed them.
    pub(crate) fn feed(&mut self, _permit: FeedPermit) {
        self.independent.pet();
        self.window.pet();
    }
}
