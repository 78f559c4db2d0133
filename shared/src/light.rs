//! How bright the stripe is, in a measure that follows the laser and little else.
//!
//! The **light signal** of a pixel is its red colour difference V of BT.601 (full range, neutral = 128), which a
//! YUV420 picture carries as it is; for RGB it is `128 + 0.5 R - 0.4187 G - 0.0813 B`, rounded; for a monochrome
//! picture it is the pixel's own brightness. White light, shadows and grey texture cancel in it. Measured on rendered
//! pictures: a laser dimmed to 60 % changes it by a factor of 0.65 to 0.80 (the latter where the stripe's core is
//! clipped), equally along the stripe to within a few per cent, while brightness itself scatters by a third.
//!
//! The host pools the signal of the stripe over its background in [`LIGHT_BLOCKS`] parts of the picture's width. Two
//! such profiles are compared block by block, and the majority says whether the light has changed: objects, paint and
//! dirt change some blocks, the laser changes all.

/// Parts of the width that are pooled apart.
pub const LIGHT_BLOCKS: usize = 64;
/// Steps of the wire's brightness to one step of the light signal.
pub const BRIGHTNESS_SCALE: u16 = 256;
/// A block that is darker than this tells nothing: three steps of the light signal.
const LEAST_BRIGHTNESS: u16 = 3 * BRIGHTNESS_SCALE;
/// Blocks that must tell something. Reason: a majority of fewer is chance.
pub const FEWEST_LIGHT_BLOCKS: u16 = 8;
/// A block counts as changed beyond a ratio of 9/10 or 10/9. Reason: the least that dimming to 60 % leaves of it is
/// 0.80 (clipped core), and a moving robot's floor changes most blocks by less.
const CHANGED_NUMERATOR: u32 = 9;
const CHANGED_DENOMINATOR: u32 = 10;

/// Brightness of the stripe over its background along the picture's width.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrightnessProfile {
    /// 1/256 of a step of the light signal, mean over the columns of the block that show a stripe; 0 = none does.
    pub blocks: [u16; LIGHT_BLOCKS],
}

/// What has happened to the light between two pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightChange {
    /// Most blocks are darker.
    Dimmer,
    /// Most blocks are as before.
    Same,
    /// Most blocks are brighter.
    Brighter,
    /// Too few blocks, or no majority.
    Unclear,
}

impl BrightnessProfile {
    /// No stripe anywhere.
    pub const DARK: Self = Self { blocks: [0; LIGHT_BLOCKS] };

    /// The block that a column of a line-scan of `count` columns belongs to.
    #[must_use]
    pub fn block_of(column: usize, count: usize) -> usize {
        column.saturating_mul(LIGHT_BLOCKS).checked_div(count).map_or(0, |block| block.min(LIGHT_BLOCKS - 1))
    }

    /// From an earlier picture to this one.
    #[must_use]
    pub fn change_since(&self, earlier: &Self) -> LightChange {
        let (mut dimmer, mut same, mut brighter) = (0_u16, 0_u16, 0_u16);
        for (now, before) in self.blocks.iter().zip(&earlier.blocks) {
            if *now < LEAST_BRIGHTNESS || *before < LEAST_BRIGHTNESS {
                continue;
            }
            let (now, before) = (u32::from(*now), u32::from(*before));
            let darker_than = |one: u32, other: u32| {
                one.saturating_mul(CHANGED_DENOMINATOR) < other.saturating_mul(CHANGED_NUMERATOR)
            };
            let count = if darker_than(now, before) {
                &mut dimmer
            } else if darker_than(before, now) {
                &mut brighter
            } else {
                &mut same
            };
            *count = count.saturating_add(1);
        }
        let told = dimmer.saturating_add(same).saturating_add(brighter);
        let majority = |count: u16| count.saturating_mul(2) > told;
        if told < FEWEST_LIGHT_BLOCKS {
            LightChange::Unclear
        } else if majority(dimmer) {
            LightChange::Dimmer
        } else if majority(same) {
            LightChange::Same
        } else if majority(brighter) {
            LightChange::Brighter
        } else {
            LightChange::Unclear
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lit(blocks: usize, level: u16) -> BrightnessProfile {
        let mut profile = BrightnessProfile::DARK;
        profile.blocks[..blocks].fill(level);
        profile
    }

    #[test]
    fn columns_share_the_blocks_evenly() {
        assert_eq!(BrightnessProfile::block_of(0, 1152), 0);
        assert_eq!(BrightnessProfile::block_of(17, 1152), 0);
        assert_eq!(BrightnessProfile::block_of(18, 1152), 1);
        assert_eq!(BrightnessProfile::block_of(1151, 1152), 63);
        assert_eq!(BrightnessProfile::block_of(5000, 1152), 63, "beyond the last column");
        assert_eq!(BrightnessProfile::block_of(3, 0), 0);
    }

    #[test]
    fn a_change_needs_more_than_a_tenth() {
        for (before, now, change) in [
            (10_000, 9_000, LightChange::Same),
            (10_000, 8_999, LightChange::Dimmer),
            (9_000, 10_000, LightChange::Same),
            (8_999, 10_000, LightChange::Brighter),
            (10_000, 10_000, LightChange::Same),
            (u16::MAX, 1_000, LightChange::Dimmer),
            (1_000, u16::MAX, LightChange::Brighter),
        ] {
            assert_eq!(lit(64, now).change_since(&lit(64, before)), change, "{before} to {now}");
        }
    }

    #[test]
    fn blocks_that_are_too_dark_or_too_few_tell_nothing() {
        assert_eq!(LEAST_BRIGHTNESS, 768, "three steps of the light signal");
        let (bright, dim) = (lit(64, LEAST_BRIGHTNESS), lit(64, LEAST_BRIGHTNESS - 1));
        assert_eq!(bright.change_since(&bright), LightChange::Same);
        assert_eq!(dim.change_since(&bright), LightChange::Unclear);
        assert_eq!(bright.change_since(&dim), LightChange::Unclear);
        let fewest = usize::from(FEWEST_LIGHT_BLOCKS);
        assert_eq!(lit(fewest, 5_000).change_since(&lit(64, 9_000)), LightChange::Dimmer);
        assert_eq!(lit(fewest - 1, 5_000).change_since(&lit(64, 9_000)), LightChange::Unclear);
    }

    #[test]
    fn the_majority_decides_and_half_is_none() {
        let mixed = |dimmer: usize, brighter: usize| {
            let mut profile = lit(64, 5_000);
            profile.blocks[..dimmer].fill(4_000);
            profile.blocks[64 - brighter..].fill(6_000);
            profile.change_since(&lit(64, 5_000))
        };
        assert_eq!(mixed(33, 0), LightChange::Dimmer);
        assert_eq!(mixed(32, 0), LightChange::Unclear);
        assert_eq!(mixed(31, 0), LightChange::Same);
        assert_eq!(mixed(0, 33), LightChange::Brighter);
        assert_eq!(mixed(0, 32), LightChange::Unclear);
        assert_eq!(mixed(0, 31), LightChange::Same);
        assert_eq!(mixed(22, 21), LightChange::Unclear);
    }

    proptest! {
        #[test]
        fn looking_back_turns_the_change_around(
            one in proptest::collection::vec(any::<u16>(), LIGHT_BLOCKS),
            other in proptest::collection::vec(any::<u16>(), LIGHT_BLOCKS),
        ) {
            let profile = |values: &[u16]| BrightnessProfile { blocks: values.try_into().unwrap() };
            let (one, other) = (profile(&one), profile(&other));
            let reversed = match one.change_since(&other) {
                LightChange::Dimmer => LightChange::Brighter,
                LightChange::Brighter => LightChange::Dimmer,
                LightChange::Same => LightChange::Same,
                LightChange::Unclear => LightChange::Unclear,
            };
            prop_assert_eq!(other.change_since(&one), reversed);
        }
    }
}
