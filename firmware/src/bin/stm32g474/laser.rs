//! The laser's brightness: PWM on PC9 (TIM3, channel 4), 20 kHz, far above the camera's exposure and the laser driver's
//! own low-pass. The compare value is buffered: a new one counts from the next period on, so that no period is cut.

use embassy_stm32::Peri;
use embassy_stm32::gpio::OutputType;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{PC9, TIM3};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::low_level::CountingMode;
use embassy_stm32::timer::simple_pwm::{PwmPin, SimplePwm};
use nearfield_firmware::selftest::Outcome;

/// Periods in a second.
const FREQUENCY: Hertz = Hertz(20_000);

/// The laser's drive.
pub(crate) struct Laser {
    pwm: SimplePwm<'static, TIM3>,
    compare: u32,
}

impl Laser {
    /// Off.
    pub(crate) fn new(timer: Peri<'static, TIM3>, pin: Peri<'static, PC9>) -> Self {
        let pin = PwmPin::new(pin, OutputType::PushPull);
        let mut pwm =
            SimplePwm::new(timer, None, None, None, Some(pin), FREQUENCY, CountingMode::EdgeAlignedUp);
        pwm.ch4().set_duty_cycle_fully_off();
        pwm.ch4().enable();
        Self { pwm, compare: 0 }
    }

    /// From the next period on; 0 = off, 255 = always on.
    pub(crate) fn set_level(&mut self, level: u8) {
        let mut channel = self.pwm.ch4();
        let full = channel.max_duty_cycle();
        self.compare = (full * u32::from(level)).div_ceil(u32::from(u8::MAX));
        channel.set_duty_cycle(self.compare);
    }

    /// Does the timer still hold what it was told, and does it run?
    pub(crate) fn check(&self) -> Outcome {
        let timer = pac::TIM3;
        let compare = timer.ccr(3).read().ccr();
        Outcome::passed_if(
            u32::from(compare) == self.compare && timer.cr1().read().cen() && timer.ccer().read().cce(3),
        )
    }
}
