//! Is a ridge light of the laser, rather than pigment, glare or the rim of something overexposed?

use super::super::floor::is_fringe;
use super::super::peak::{Kernel, Peak};
use super::super::signal::Signal;
use super::WIDEST_SHARE;

/// A clipped stripe is at most so many times as wide as the floor's: a bell-shaped section that is clipped at one part in
/// five hundred of its height is three times as wide there as at half of it.
const WIDEST_CLIPPED: f32 = 3.0;
/// On a ground that daylight overexposes the laser still brightens the other colours by this much, levels: the ends of
/// sensor and colour matrix do not fall together. The red rim of an overexposed thing has a dark side.
const LEAST_BRIGHTENING: f32 = 6.0;
/// From here on the laser's colour is at the end of its scale.
const OVEREXPOSED: f32 = 244.0;
/// Samples on each side that it is compared with.
const GLOW_SAMPLES: usize = 3;
/// Light rises in its own colour by at least this share of its contrast; grey on green, or red pigment on a bright
/// ground, does not.
const GLOW_SHARE: f32 = 0.03;

/// A ridge, if light of the laser can have made it.
pub(super) fn believed<S: Signal>(signal: S, column: usize, peak: Option<Peak>, widest: f32) -> Option<Peak> {
    peak.filter(|peak| is_light(signal, column, peak, widest) && !is_fringe(signal, column, peak))
}

/// Is it as narrow as a stripe, and brighter in the laser's colour than both sides together? A stripe at the end of the
/// camera's scale may be wide: the brighter, the wider. Beside what daylight overexposes there are red rims; there only a
/// clipped core is believed that is the brightest in the other colours too.
fn is_light<S: Signal>(signal: S, column: usize, peak: &Peak, widest: f32) -> bool {
    let crest = peak.row.round().max(0.0) as usize;
    let beside = (peak.width / 2.0).ceil() as usize + Kernel::for_step(S::STEP).half;
    let mean_glow = |first: usize| {
        let sum: i16 = (first..first + GLOW_SAMPLES).map(|row| signal.glow(column, row)).sum();
        f32::from(sum) / GLOW_SAMPLES as f32
    };
    let above = mean_glow(crest.saturating_sub(beside + GLOW_SAMPLES - 1));
    let below = mean_glow(crest + beside);
    if signal.is_clipped(column, crest) {
        let fits = peak.width <= WIDEST_CLIPPED / WIDEST_SHARE * widest;
        return fits && (above.max(below) < OVEREXPOSED || is_brightened(signal, column, crest, beside));
    }
    if above.max(below) >= OVEREXPOSED {
        return false;
    }
    let rise = f32::from(signal.glow(column, crest)) - (above + below) / 2.0;
    peak.width <= widest && rise >= GLOW_SHARE * peak.contrast
}

/// Is the crest brighter than both sides in the colours that the laser hardly has?
fn is_brightened<S: Signal>(signal: S, column: usize, crest: usize, beside: usize) -> bool {
    let mean_tone = |first: usize| {
        let sum: i16 = (first..first + GLOW_SAMPLES).map(|row| signal.tone(column, row)).sum();
        f32::from(sum) / GLOW_SAMPLES as f32
    };
    let above = mean_tone(crest.saturating_sub(beside + GLOW_SAMPLES - 1));
    let below = mean_tone(crest + beside);
    let core = mean_tone(crest.saturating_sub(GLOW_SAMPLES / 2));
    core - above.max(below) >= LEAST_BRIGHTENING
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Plane;
    use crate::vision::peak;
    use crate::vision::signal::RedMinusGreen;

    /// One column of `ground` with a bell-shaped ridge that moves the colour by `change`.
    fn column(ground: [f32; 3], change: [f32; 3]) -> Vec<u8> {
        (0..80)
            .flat_map(|row| {
                let light = (-(row as f32 - 40.0).powi(2) / 12.0).exp();
                std::array::from_fn::<u8, 3, _>(|channel| (ground[channel] + light * change[channel]) as u8)
            })
            .collect()
    }

    fn is_believed(bytes: &[u8]) -> bool {
        let signal = RedMinusGreen(Plane::new(bytes, 3, 3, 80).unwrap());
        believed(signal, 0, peak::find_above(signal, 0, 40, 1, 4.0), 14.0).is_some()
    }

    #[test]
    fn the_laser_is_believed_on_every_ground_that_is_not_overexposed() {
        for ground in [[140.0, 140.0, 140.0], [60.0, 120.0, 80.0], [20.0, 20.0, 20.0], [190.0, 65.0, 60.0]] {
            assert!(is_believed(&column(ground, [50.0, -20.0, -10.0])), "{ground:?}");
        }
        assert!(!is_believed(&column([250.0, 230.0, 215.0], [5.0, -60.0, -60.0])), "overexposed");
    }

    /// A black cable on a green floor is redder than the floor, and no light.
    #[test]
    fn what_is_only_less_green_is_no_light() {
        assert!(!is_believed(&column([60.0, 120.0, 80.0], [-30.0, -95.0, -55.0])));
        assert!(
            !is_believed(&column([220.0, 215.0, 205.0], [-10.0, -140.0, -140.0])),
            "red pigment on white"
        );
    }

    /// Daylight has the ground's red at the end of its scale; the laser's core brightens green and leaves red rims.
    #[test]
    fn on_an_overexposed_ground_the_core_that_brightens_green_is_believed() {
        let on_white = |core: f32| {
            let bytes: Vec<u8> = (0..80)
                .flat_map(|row| {
                    let distance = (row as f32 - 40.0).abs();
                    let green = match distance {
                        near if near < 3.0 => core,
                        near if near < 5.0 => 205.0,
                        _ => 235.0,
                    };
                    [255, green as u8, green as u8]
                })
                .collect();
            is_believed(&bytes)
        };
        assert!(on_white(255.0), "the laser");
        assert!(!on_white(235.0), "two red lines with the ground between them");
    }

    #[test]
    fn a_clipped_band_much_wider_than_the_stripe_is_a_thing_in_the_sun() {
        let band = |half: f32| {
            let bytes: Vec<u8> = (0..80)
                .flat_map(|row| {
                    let inside = (row as f32 - 40.0).abs();
                    let rim = inside < half && inside > half - 2.0;
                    if rim {
                        [255, 120, 40]
                    } else if inside < half {
                        [255, 240, 80]
                    } else {
                        [90, 90, 90]
                    }
                })
                .collect();
            // Half of what is allowed for a stripe seven rows wide.
            let signal = RedMinusGreen(Plane::new(&bytes, 3, 3, 80).unwrap());
            believed(signal, 0, peak::find_above(signal, 0, 40, 1, 4.0), 7.0).is_some()
        };
        assert!(band(4.0));
        assert!(!band(9.0));
    }
}
