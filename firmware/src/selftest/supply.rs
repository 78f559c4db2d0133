//! The supply voltage, measured against the chip's internal reference.
//!
//! The reference's reading was stored in the factory at 3.0 V; a higher supply makes it smaller. Below the range the
//! chip's own brown-out and voltage detectors act as well; above it nothing else would tell.
//!
//! **Time:** about 20 instructions and one conversion (some 16 microseconds, in the background). **Failure:**
//! [`SelfTestKind::Supply`](super::SelfTestKind::Supply).

use super::Outcome;

/// The supply at which the factory read the reference. Source: STM32G474 data sheet, VREFINT calibration.
pub const CALIBRATION_MILLIVOLTS: u32 = 3_000;
/// Lowest good supply. Reason: 3.3 V less 10 %; contacts and drivers are specified down to it.
pub const LOWEST_MILLIVOLTS: u32 = 2_970;
/// Highest good supply. Source: STM32G474 data sheet, operating conditions.
pub const HIGHEST_MILLIVOLTS: u32 = 3_600;

/// The supply in millivolts; `None` for readings that no working converter gives.
#[must_use]
pub fn millivolts(calibration: u16, reading: u16) -> Option<u32> {
    if calibration == 0 || calibration == u16::MAX {
        return None;
    }
    CALIBRATION_MILLIVOLTS.checked_mul(u32::from(calibration))?.checked_div(u32::from(reading))
}

/// Judges one reading of the reference.
#[must_use]
pub fn check(calibration: u16, reading: u16) -> Outcome {
    Outcome::passed_if(
        millivolts(calibration, reading)
            .is_some_and(|supply| (LOWEST_MILLIVOLTS..=HIGHEST_MILLIVOLTS).contains(&supply)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A typical chip: 1.212 V of 3.0 V in 12 bits.
    const CALIBRATION: u16 = 1_655;

    #[test]
    fn the_supply_follows_from_the_reference() {
        assert_eq!(millivolts(CALIBRATION, CALIBRATION), Some(3_000));
        assert_eq!(millivolts(CALIBRATION, 1_504), Some(3_301));
    }

    #[test]
    fn the_range_has_sharp_limits() {
        for (calibration, reading, expected) in [
            (2_969, 3_000, Outcome::Failed),
            (2_970, 3_000, Outcome::Passed),
            (3_600, 3_000, Outcome::Passed),
            (3_601, 3_000, Outcome::Failed),
        ] {
            assert_eq!(check(calibration, reading), expected, "{calibration} mV");
        }
    }

    #[test]
    fn readings_of_a_dead_converter_fail() {
        for (calibration, reading) in
            [(CALIBRATION, 0), (CALIBRATION, u16::MAX), (0, 1_504), (u16::MAX, 1_504), (u16::MAX, u16::MAX)]
        {
            assert_eq!(check(calibration, reading), Outcome::Failed, "{calibration} {reading}");
        }
        assert_eq!(millivolts(u16::MAX, 3_000), None, "an erased calibration");
    }
}
