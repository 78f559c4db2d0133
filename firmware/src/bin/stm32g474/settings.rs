//! Do the registers that safety rests on still hold what they were set to? Read back in every round of the self-tests: a
//! flipped bit could turn a relay's output into an input, or a watchdog's 100 ms into half a minute.

use embassy_stm32::pac;
use nearfield_firmware::selftest::Outcome;

/// Some bits of a register, and what they must be.
struct Setting {
    read: fn() -> u32,
    mask: u32,
    expected: u32,
}

/// The two bits of a pin in a mode or pull register.
const fn pair(pin: u32, bits: u32) -> u32 {
    bits << (2 * pin)
}

const INPUT: u32 = 0b00;
const OUTPUT: u32 = 0b01;
const ALTERNATE: u32 = 0b10;
const PULL_DOWN: u32 = 0b10;
const BOTH: u32 = 0b11;

/// Relay coils, warning: outputs; mirror contacts, service key, reset button: inputs; laser: the timer's.
const PORT_C_MASK: u32 = pair(0, BOTH)
    | pair(1, BOTH)
    | pair(2, BOTH)
    | pair(3, BOTH)
    | pair(6, BOTH)
    | pair(8, BOTH)
    | pair(9, BOTH)
    | pair(13, BOTH);
const PORT_C_MODES: u32 = pair(0, OUTPUT)
    | pair(1, OUTPUT)
    | pair(2, INPUT)
    | pair(3, INPUT)
    | pair(6, OUTPUT)
    | pair(8, INPUT)
    | pair(9, ALTERNATE)
    | pair(13, INPUT);
const PORT_C_PULLS_MASK: u32 = pair(2, BOTH) | pair(3, BOTH) | pair(8, BOTH) | pair(13, BOTH);
const PORT_C_PULLS: u32 = pair(2, PULL_DOWN) | pair(3, PULL_DOWN) | pair(8, PULL_DOWN) | pair(13, PULL_DOWN);
/// The coils' read-backs.
const PORT_B_MASK: u32 = pair(0, BOTH) | pair(1, BOTH);

const SETTINGS: [Setting; 14] = [
    Setting { read: || pac::GPIOC.moder().read().0, mask: PORT_C_MASK, expected: PORT_C_MODES },
    Setting { read: || pac::GPIOC.pupdr().read().0, mask: PORT_C_PULLS_MASK, expected: PORT_C_PULLS },
    // Push-pull.
    Setting { read: || pac::GPIOC.otyper().read().0, mask: 0b11, expected: 0 },
    Setting { read: || pac::GPIOB.moder().read().0, mask: PORT_B_MASK, expected: 0 },
    // TIM3 on PC9.
    Setting { read: || pac::GPIOC.afr(1).read().0, mask: 0xF0, expected: 0x20 },
    // The processor's clock is the PLL's, and settled on it.
    Setting { read: || pac::RCC.cfgr().read().0, mask: 0xF, expected: 0xF },
    // No division between it and the buses.
    Setting { read: || pac::RCC.cfgr().read().0, mask: 0x3FF0, expected: 0 },
    // HSI / 4 * 85 / 2, output R on.
    Setting { read: || pac::RCC.pllcfgr().read().0, mask: 0x0700_7FF3, expected: 0x0100_5532 },
    // Both oscillators are on and ready.
    Setting { read: || pac::RCC.cr().read().0, mask: 0x0300_0500, expected: 0x0300_0500 },
    Setting { read: || pac::RCC.csr().read().0, mask: 0b11, expected: 0b11 },
    // 100 ms at 32 kHz: a quarter of the clock, 800 counts.
    Setting { read: || pac::IWDG.pr().read().0, mask: 0b111, expected: 0 },
    Setting { read: || pac::IWDG.rlr().read().0, mask: 0xFFF, expected: 799 },
    // The window watchdog is running.
    Setting { read: || pac::WWDG.cr().read().0, mask: 0x80, expected: 0x80 },
    // The laser's period, 20 kHz.
    Setting { read: || pac::TIM3.arr().read().0, mask: 0xFFFF, expected: 8_499 },
];

/// Settings that hold only once the watchdogs run; they stand next to each other in the list.
const WATCHDOGS: core::ops::Range<usize> = 10..13;

/// All of them; those of the watchdogs only once they run.
pub(crate) fn check(watchdogs_run: bool) -> Outcome {
    let holds = |(place, setting): (usize, &Setting)| {
        (WATCHDOGS.contains(&place) && !watchdogs_run) || (setting.read)() & setting.mask == setting.expected
    };
    Outcome::passed_if(SETTINGS.iter().enumerate().all(holds))
}
