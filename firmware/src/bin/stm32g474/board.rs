//! Clocks, pins, watchdogs and the reset's reason of the Nucleo-G474RE.

use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::peripherals::{DMA1_CH1, DMA1_CH2, FLASH, IWDG, PB12, PB13, PB14, PB15, SPI2, WWDG};
use embassy_stm32::wdg::{IndependentWatchdog, WindowWatchdog};
use embassy_stm32::{Config, Peri, pac, rcc};
use nearfield_firmware::flow::FeedPermit;
use nearfield_firmware::laser_code::LASER_OFF;
use nearfield_firmware::output_test::PulseReadback;
use nearfield_firmware::relay::MirrorContacts;
use nearfield_firmware::safety::{Indicator, Outputs, PinInputs};
use nearfield_shared::limits::WATCHDOG_TIMEOUT;
use nearfield_shared::status::ResetCause;

/// What the tasks get of the board.
pub(crate) struct Board {
    pub(crate) pins: Pins,
    pub(crate) link: LinkParts,
    pub(crate) service_key: Input<'static>,
    pub(crate) flash: Peri<'static, FLASH>,
    pub(crate) independent_watchdog: Peri<'static, IWDG>,
    pub(crate) window_watchdog: Peri<'static, WWDG>,
}

/// SPI2 as a slave, its DMA channels and the READY line.
pub(crate) struct LinkParts {
    pub(crate) spi: Peri<'static, SPI2>,
    pub(crate) select: Peri<'static, PB12>,
    pub(crate) clock: Peri<'static, PB13>,
    pub(crate) to_host: Peri<'static, PB14>,
    pub(crate) from_host: Peri<'static, PB15>,
    pub(crate) transmit: Peri<'static, DMA1_CH1>,
    pub(crate) receive: Peri<'static, DMA1_CH2>,
    pub(crate) ready: Output<'static>,
}

/// The pins that the safety task reads and drives.
pub(crate) struct Pins {
    relay_a: Output<'static>,
    relay_b: Output<'static>,
    mirror_a: Input<'static>,
    mirror_b: Input<'static>,
    reset_button: Input<'static>,
    laser: Output<'static>,
    permitted: Output<'static>,
    waiting: Output<'static>,
    service: Output<'static>,
}

impl Pins {
    /// The drivers' outputs are not wired back yet: they count as ideal.
    pub(crate) fn read(&self, outputs: Outputs) -> PinInputs {
        let pulse = outputs
            .pulse
            .map(|channel| PulseReadback { channel, coils: channel.inverted_in(outputs.relays) });
        PinInputs {
            mirror: MirrorContacts { a: self.mirror_a.is_high(), b: self.mirror_b.is_high() },
            reset_pressed: self.reset_button.is_high(),
            service_key: false,
            coils: outputs.relays,
            pulse,
        }
    }

    /// The relays first.
    pub(crate) fn drive(&mut self, outputs: Outputs) {
        self.relay_a.set_level(Level::from(outputs.relays.a));
        self.relay_b.set_level(Level::from(outputs.relays.b));
        self.laser.set_level(Level::from(outputs.laser_level != LASER_OFF));
        self.permitted.set_level(Level::from(outputs.indicator == Indicator::Permitted));
        self.waiting.set_level(Level::from(outputs.indicator == Indicator::WaitingForReset));
        self.service.set_level(Level::from(outputs.indicator == Indicator::Service));
    }
}

/// 170 MHz from the internal oscillator, every output low.
pub(crate) fn start() -> Board {
    let mut config = Config::default();
    config.rcc.hsi = true;
    // 16 MHz / 4 * 85 / 2; the core's voltage range 1 boost mode allows it.
    config.rcc.pll = Some(rcc::Pll {
        source: rcc::PllSource::HSI,
        prediv: rcc::PllPreDiv::DIV4,
        mul: rcc::PllMul::MUL85,
        divp: None,
        divq: None,
        divr: Some(rcc::PllRDiv::DIV2),
    });
    config.rcc.sys = rcc::Sysclk::PLL1_R;
    config.rcc.boost = true;
    let parts = embassy_stm32::init(config);
    let pins = Pins {
        relay_a: Output::new(parts.PC0, Level::Low, Speed::Low),
        relay_b: Output::new(parts.PC1, Level::Low, Speed::Low),
        mirror_a: Input::new(parts.PC2, Pull::Down),
        mirror_b: Input::new(parts.PC3, Pull::Down),
        reset_button: Input::new(parts.PC13, Pull::Down),
        laser: Output::new(parts.PC9, Level::Low, Speed::Low),
        permitted: Output::new(parts.PA5, Level::Low, Speed::Low),
        waiting: Output::new(parts.PC4, Level::Low, Speed::Low),
        service: Output::new(parts.PC5, Level::Low, Speed::Low),
    };
    let link = LinkParts {
        spi: parts.SPI2,
        select: parts.PB12,
        clock: parts.PB13,
        to_host: parts.PB14,
        from_host: parts.PB15,
        transmit: parts.DMA1_CH1,
        receive: parts.DMA1_CH2,
        ready: Output::new(parts.PA8, Level::Low, Speed::Low),
    };
    Board {
        pins,
        link,
        service_key: Input::new(parts.PC8, Pull::Down),
        flash: parts.FLASH,
        independent_watchdog: parts.IWDG,
        window_watchdog: parts.WWDG,
    }
}

/// Why the chip started; clears the flags for the next time.
pub(crate) fn take_reset_cause() -> ResetCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|register| register.set_rmvf(true));
    // Every reset also pulls the reset pin, so the pin's flag says something only by itself.
    if flags.iwdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.borrstf() {
        ResetCause::PowerOn
    } else if flags.sftrstf() {
        ResetCause::Software
    } else if flags.lpwrrstf() || flags.oblrstf() {
        ResetCause::Unknown
    } else if flags.pinrstf() {
        ResetCause::Pin
    } else {
        ResetCause::Unknown
    }
}

/// The window watchdog bites a little before the independent one: both are seen to work by their own flags.
const WINDOW_WATCHDOG_MICROS: u32 = 90_000;
/// Feeding again within this time is a reset: the program runs wild. The tick period is 5 ms.
const CLOSED_WINDOW_MICROS: u32 = 3_100;

/// Both watchdogs; from their start on only permits keep the chip alive.
pub(crate) struct Watchdogs {
    independent: IndependentWatchdog<'static, IWDG>,
    window: WindowWatchdog<'static, WWDG>,
}

impl Watchdogs {
    pub(crate) fn start(independent: Peri<'static, IWDG>, window: Peri<'static, WWDG>) -> Self {
        let timeout = u32::try_from(WATCHDOG_TIMEOUT.get()).unwrap_or(WINDOW_WATCHDOG_MICROS);
        let mut independent = IndependentWatchdog::new(independent, timeout);
        independent.unleash();
        let window = WindowWatchdog::new(window, WINDOW_WATCHDOG_MICROS, CLOSED_WINDOW_MICROS);
        Self { independent, window }
    }

    /// Only a whole tick on time may feed them.
    pub(crate) fn feed(&mut self, _permit: FeedPermit) {
        self.independent.pet();
        self.window.pet();
    }
}

/// Opens both relays and resets the chip; the controller then starts in its self-test.
pub(crate) fn restart() -> ! {
    pac::GPIOC.bsrr().write(|register| {
        register.set_br(0, true);
        register.set_br(1, true);
    });
    cortex_m::peripheral::SCB::sys_reset()
}
