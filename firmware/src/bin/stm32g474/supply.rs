//! The supply: ADC1 reads the chip's internal reference, and the programmable voltage detector watches for a dip; what
//! the reading means is judged in `nearfield_firmware::selftest::supply`.

use core::ptr::read_volatile;
use embassy_stm32::pac;
use embassy_stm32::pac::adc::vals::SampleTime;
use embassy_stm32::pac::adccommon::vals::Ckmode;
use nearfield_firmware::selftest::{Outcome, supply};

/// The reference's reading at 3.0 V, stored in the factory. Source: STM32G474 data sheet.
const CALIBRATION: *const u16 = 0x1FFF_75AA as *const u16;
/// The reference's channel.
const CHANNEL: u8 = 18;
/// The voltage detector's threshold: 2.9 V. Source: reference manual, PWR_CR2.
const DETECTOR_LEVEL: u8 = 6;
/// Polls for what takes a few microseconds.
const MOST_POLLS: u32 = 100_000;
/// The converter's regulator starts in 20 microseconds; at 170 MHz.
const REGULATOR_CYCLES: u32 = 20 * 170;

/// One conversion at a time, in the background.
pub(crate) struct Supply {
    ready: bool,
    converting: bool,
}

impl Supply {
    /// Switches detector, reference and converter on. A converter that does not start fails every later check.
    pub(crate) fn start() -> Self {
        pac::PWR.cr2().modify(|register| {
            register.set_pls(DETECTOR_LEVEL);
            register.set_pvde(true);
        });
        pac::RCC.ahb2enr().modify(|register| register.set_adc12en(true));
        let _ = pac::RCC.ahb2enr().read();
        pac::ADC12_COMMON.ccr().modify(|register| {
            // A quarter of the processor's clock, 42.5 MHz; 60 are allowed.
            register.set_ckmode(Ckmode::SYNC_DIV4);
            register.set_vrefen(true);
        });
        pac::ADC1.cr().modify(|register| register.set_deeppwd(false));
        pac::ADC1.cr().modify(|register| register.set_advregen(true));
        cortex_m::asm::delay(REGULATOR_CYCLES);
        pac::ADC1.cr().modify(|register| register.set_adcal(true));
        let calibrated = poll(|| !pac::ADC1.cr().read().adcal());
        // The converter must not be switched on in the four cycles after its calibration.
        cortex_m::asm::delay(64);
        pac::ADC1.isr().write(|register| register.set_adrdy(true));
        pac::ADC1.cr().modify(|register| register.set_aden(true));
        let ready = calibrated && poll(|| pac::ADC1.isr().read().adrdy());
        pac::ADC1.smpr2().modify(|register| register.set_smp(8, SampleTime::CYCLES640_5));
        pac::ADC1.sqr1().write(|register| {
            register.set_l(0);
            register.set_sq(0, CHANNEL);
        });
        Self { ready, converting: false }
    }

    /// No dip at this moment?
    pub(crate) fn is_above_detector(&self) -> bool {
        !pac::PWR.sr2().read().pvdo()
    }

    /// Starts a conversion, or judges the one that has ended.
    pub(crate) fn step(&mut self) -> Outcome {
        if !self.ready || !self.is_above_detector() {
            return Outcome::Failed;
        }
        if !self.converting {
            pac::ADC1.isr().write(|register| {
                register.set_eoc(true);
                register.set_eos(true);
            });
            pac::ADC1.cr().modify(|register| register.set_adstart(true));
            self.converting = true;
            return Outcome::Pending;
        }
        if !pac::ADC1.isr().read().eoc() {
            return Outcome::Pending;
        }
        self.converting = false;
        let reading = pac::ADC1.dr().read().rdata();
        // SAFETY: a half-word of the chip's system memory that is always readable.
        let calibration = unsafe { read_volatile(CALIBRATION) };
        supply::check(calibration, reading)
    }

    /// A whole conversion, waited for.
    pub(crate) fn check_now(&mut self) -> Outcome {
        for _ in 0..MOST_POLLS {
            match self.step() {
                Outcome::Pending => {}
                outcome => return outcome,
            }
        }
        Outcome::Failed
    }
}

fn poll(mut done: impl FnMut() -> bool) -> bool {
    (0..MOST_POLLS).any(|_| done())
}
