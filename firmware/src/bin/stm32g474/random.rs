//! The chip's random number generator, asked for the secret of this start. No loop without an end: a generator that
//! does not answer is a failed self-test, not a hang.

use embassy_stm32::pac;
use nearfield_firmware::selftest::random::{DRAWN_WORDS, secret_of};

/// Polls for one word. A word takes 213 cycles of the generator's 48 MHz, under 5 microseconds.
const MOST_POLLS: u32 = 10_000;

/// The secret; `None` if the generator reports an error, does not answer, or repeats itself. Its clock (HSI48) is on
/// already, see the board's clock configuration.
pub(crate) fn draw_secret() -> Option<[u8; 16]> {
    pac::RCC.ahb2enr().modify(|register| register.set_rngen(true));
    let _ = pac::RCC.ahb2enr().read();
    pac::RNG.cr().write(|register| register.set_rngen(true));
    // The first word after switching on is not to be used (reference manual).
    let drawn = draw_word().and_then(|_| {
        let mut words = [0; DRAWN_WORDS];
        for word in &mut words {
            *word = draw_word()?;
        }
        secret_of(&words)
    });
    pac::RNG.cr().write(|register| register.set_rngen(false));
    drawn
}

fn draw_word() -> Option<u32> {
    for _ in 0..MOST_POLLS {
        let state = pac::RNG.sr().read();
        if state.secs() || state.cecs() || state.seis() || state.ceis() {
            return None;
        }
        if state.drdy() {
            return Some(pac::RNG.dr().read());
        }
    }
    None
}
