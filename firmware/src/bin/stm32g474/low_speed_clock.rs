//! Cycles of the low-speed oscillator, counted by LPTIM1; what they must be is judged in
//! `nearfield_firmware::selftest::clock`.

use embassy_stm32::pac;
use embassy_stm32::pac::rcc::vals::Lptimsel;

/// Counts from its making on, in 16 bits.
pub(crate) struct LowSpeedClock(());

impl LowSpeedClock {
    /// Starts the counter. The oscillator itself is on already (see the board's clock configuration).
    pub(crate) fn start() -> Self {
        pac::RCC.ccipr().modify(|register| register.set_lptim1sel(Lptimsel::LSI));
        pac::RCC.apb1enr1().modify(|register| register.set_lptim1en(true));
        // Read back: the peripheral's clock runs two cycles after it was enabled.
        let _ = pac::RCC.apb1enr1().read();
        pac::LPTIM1.cr().modify(|register| register.set_enable(true));
        pac::LPTIM1.arr().write(|register| register.set_arr(u16::MAX));
        pac::LPTIM1.cr().modify(|register| register.set_cntstrt(true));
        Self(())
    }

    /// The counter. It runs on another clock than the processor: only two equal readings in a row are one.
    pub(crate) fn count(&self) -> u16 {
        let mut before = pac::LPTIM1.cnt().read().cnt();
        // Six cycles of the processor between two readings, 5000 between two counts: three are always enough.
        for _ in 0..3 {
            let now = pac::LPTIM1.cnt().read().cnt();
            if now == before {
                break;
            }
            before = now;
        }
        before
    }
}
