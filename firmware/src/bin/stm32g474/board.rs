//! Clocks and pins of the Nucleo-G474RE.

use crate::laser::Laser;
use crate::watchdogs::WatchdogParts;
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::peripherals::{DMA1_CH1, DMA1_CH2, FLASH, PB12, PB13, PB14, PB15, SPI2};
use embassy_stm32::{Config, Peri, pac, rcc};
use embassy_time::{Duration, block_for};
use nearfield_firmware::output_test::{Channel, PulseReadback};
use nearfield_firmware::relay::MirrorContacts;
use nearfield_firmware::safety::{Indicator, Outputs, PinInputs};
use nearfield_shared::limits::PULSE_LENGTH;
use nearfield_shared::status::Channels;

/// What the tasks get of the board.
pub(crate) struct Board {
    pub(crate) pins: Pins,
    pub(crate) link: LinkParts,
    pub(crate) flash: Peri<'static, FLASH>,
    pub(crate) watchdogs: WatchdogParts,
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
    coil_a: Input<'static>,
    coil_b: Input<'static>,
    reset_button: Input<'static>,
    service_key: Input<'static>,
    laser: Laser,
    warning: Output<'static>,
    permitted: Output<'static>,
    waiting: Output<'static>,
    service: Output<'static>,
}

impl Pins {
    /// `pulse`: what the pulse of the tick before has shown. While the service key is closed, the reset button counts
    /// for nothing: nobody starts the robot while somebody may change its rig.
    pub(crate) fn read(&self, pulse: Option<PulseReadback>) -> PinInputs {
        let service_key = self.service_key.is_high();
        PinInputs {
            mirror: MirrorContacts { a: self.mirror_a.is_high(), b: self.mirror_b.is_high() },
            reset_pressed: self.reset_button.is_high() && !service_key,
            service_key,
            coils: self.coils(),
            pulse,
        }
    }

    /// What the drivers give out.
    fn coils(&self) -> Channels {
        Channels { a: self.coil_a.is_high(), b: self.coil_b.is_high() }
    }

    /// The relays first.
    pub(crate) fn drive(&mut self, outputs: Outputs) {
        self.drive_relays(outputs.relays);
        self.laser.set_level(outputs.laser_level);
        self.warning.set_level(Level::from(outputs.warning));
        self.permitted.set_level(Level::from(outputs.indicator == Indicator::Permitted));
        self.waiting.set_level(Level::from(outputs.indicator == Indicator::WaitingForReset));
        self.service.set_level(Level::from(outputs.indicator == Indicator::Service));
    }

    fn drive_relays(&mut self, coils: Channels) {
        self.relay_a.set_level(Level::from(coils.a));
        self.relay_b.set_level(Level::from(coils.b));
    }

    /// Inverts one channel's drive for a time that is too short for its relay to move, reads both drivers back at the
    /// end of it, and restores the drive. Should the program stop in between, the other channel is as it was, and the
    /// watchdogs bite.
    pub(crate) fn pulse(&mut self, channel: Channel, relays: Channels) -> PulseReadback {
        self.drive_relays(channel.inverted_in(relays));
        block_for(Duration::from_micros(PULSE_LENGTH.get()));
        let coils = self.coils();
        self.drive_relays(relays);
        PulseReadback { channel, coils }
    }

    /// The laser's drive, for its check.
    pub(crate) const fn laser(&self) -> &Laser {
        &self.laser
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
    // For the random numbers, and for the check against the processor's clock and the independent watchdog.
    config.rcc.hsi48 = Some(rcc::Hsi48Config::default());
    config.rcc.mux.clk48sel = rcc::mux::Clk48sel::HSI48;
    config.rcc.ls = rcc::LsConfig::default_lsi();
    let parts = embassy_stm32::init(config);
    let pins = Pins {
        relay_a: Output::new(parts.PC0, Level::Low, Speed::Low),
        relay_b: Output::new(parts.PC1, Level::Low, Speed::Low),
        mirror_a: Input::new(parts.PC2, Pull::Down),
        mirror_b: Input::new(parts.PC3, Pull::Down),
        coil_a: Input::new(parts.PB0, Pull::Down),
        coil_b: Input::new(parts.PB1, Pull::Down),
        reset_button: Input::new(parts.PC13, Pull::Down),
        service_key: Input::new(parts.PC8, Pull::Down),
        laser: Laser::new(parts.TIM3, parts.PC9),
        warning: Output::new(parts.PC6, Level::Low, Speed::Low),
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
        flash: parts.FLASH,
        watchdogs: WatchdogParts { independent: parts.IWDG, window: parts.WWDG },
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
