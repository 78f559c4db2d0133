//! A stripe beside the edge of a paint: is there a ridge at a known row as well as a step?
//!
//! Where paint that is redder than the laser's light ends within the stripe's own width, the stripe is no more than a
//! shoulder of the paint's edge, and stands out from nothing. But its row and width are known from its neighbours, so
//! the column is explained twice: by a blurred step alone, and by a step with a ridge at that row, of one strength on
//! each side of the edge. The ridge is believed if it explains what the step alone leaves, and is no small thing.

mod fit;

use crate::simd;
use fit::{Elsewhere, Explain, Steps};

/// Rows to both sides of the middle that are explained.
pub const EXPLAINED_ROWS: usize = 12;
const ROWS: usize = 2 * EXPLAINED_ROWS + 1;
/// Steps are tried at every half row up to this distance from the middle.
const FARTHEST_STEP: usize = 9;
const STEPS: usize = 4 * FARTHEST_STEP + 1;
/// A ridge is looked for with steps up to so many half rows from the best step without one.
const STEPS_ASIDE: usize = 7;
/// Blurs of the step that are tried, in standard deviations of the ridge: lens and processor blur both.
const BLURS: [f32; 3] = [0.6, 1.0, 1.5];
/// A ridge must be at least this share of the step ...
const LEAST_OF_STEP: f32 = 0.15;
/// ... and the step alone must leave at least this share of itself (root mean square): a step that is not quite of the
/// assumed shape leaves less.
const LEAST_LEFT: f32 = 0.03;
/// A ridge must leave no more than this share of the squared error of the step alone ...
const LEFT_SHARE: f32 = 0.35;
/// ... or of this, where it is as high as those beside it ...
const LEFT_LIKE: f32 = 0.5;
/// (not more or less than so many times)
const LIKE_RANGE: f32 = 2.5;
/// ... and no more error (root mean square) than this share of its height.
const MISFIT_SHARE: f32 = 0.25;
/// A step smaller than this share of the ridge hides nothing: the usual measure finds the ridge.
const LEAST_STEP: f32 = 0.5;
/// A ridge elsewhere must leave so many times the squared error, or the stripe may be off the floor.
const ELSEWHERE_SHARE: f32 = 1.5;
/// Rows beyond the tolerance at which it is tried, with steps up to so many half rows from the best.
const ELSEWHERE_ROWS: usize = 6;
const ELSEWHERE_ASIDE: usize = 4;
/// An edge farther than so many rows from the ridge hides nothing.
const FARTHEST_HIDING: f32 = 4.0;
/// What is a clean edge leaves no more error (root mean square) than this share of its step.
const STEP_MISFIT: f32 = 0.1;

/// How a column with an edge is explained best.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Explanation {
    /// Height of the ridge.
    pub ridge: f32,
    /// Height of the step, of either sign.
    pub step: f32,
    /// Squared error of the best step without a ridge.
    pub without: f32,
    /// Squared error with the ridge.
    pub with: f32,
    /// The step: which blur, and which place.
    at: [usize; 2],
}

impl Explanation {
    /// Is there an edge at the ridge's own rows, and may it hide a ridge at least this high?
    #[must_use]
    pub fn may_hide(&self, least: f32, offset: f32) -> bool {
        let edge = self.at[1] as f32 / 2.0 - FARTHEST_STEP as f32;
        let misfit = (self.with / ROWS as f32).sqrt();
        self.step.abs() >= least
            && (edge - offset).abs() <= FARTHEST_HIDING
            && misfit <= STEP_MISFIT * self.step.abs()
    }

    /// Is there a ridge at least this high?
    #[must_use]
    pub fn is_ridge(&self, least: f32, like: f32) -> bool {
        let misfit = (self.with / ROWS as f32).sqrt();
        let left = if (like / LIKE_RANGE..=like * LIKE_RANGE).contains(&self.ridge) {
            LEFT_LIKE
        } else {
            LEFT_SHARE
        };
        self.ridge >= least.max(LEAST_OF_STEP * self.step.abs())
            && (self.without / ROWS as f32).sqrt() >= LEAST_LEFT * self.step.abs()
            && self.with <= left * self.without
            && misfit <= MISFIT_SHARE * self.ridge
            && self.step.abs() >= LEAST_STEP * self.ridge
    }
}

/// Explains columns; holds the shapes of steps for one width of the ridge.
#[derive(Debug, Clone)]
pub struct EdgeModel {
    deviation: f32,
    steps: Box<[Steps; BLURS.len()]>,
}

impl EdgeModel {
    /// For nothing yet: see [`Self::set_width`].
    #[must_use]
    pub fn new() -> Self {
        Self { deviation: 0.0, steps: Box::new([Steps::NONE; BLURS.len()]) }
    }

    /// For a ridge of this width at half of its height, samples.
    pub fn set_width(&mut self, width: f32) {
        // Full width at half of a normal curve's height, in standard deviations.
        let deviation = (width / 2.355).clamp(0.7, 4.0);
        if (deviation - self.deviation).abs() < 0.05 {
            return;
        }
        self.deviation = deviation;
        for (steps, blur) in self.steps.iter_mut().zip(BLURS) {
            steps.fill(blur * deviation);
        }
    }

    /// Explains the samples of a column, the ridge `offset` rows below the middle.
    #[must_use]
    pub fn explain(&self, samples: &[f32; ROWS], offset: f32) -> Explanation {
        simd::run(Explain { steps: &self.steps, samples, ridge: &self.ridge(offset) })
    }

    /// Does a ridge farther than `tolerance` from `offset` explain the column clearly worse?
    #[must_use]
    pub fn is_nowhere_else(
        &self,
        samples: &[f32; ROWS],
        explanation: &Explanation,
        offset: f32,
        tolerance: f32,
    ) -> bool {
        let [blur, nearest] = explanation.at;
        let near = nearest.saturating_sub(ELSEWHERE_ASIDE)..(nearest + ELSEWHERE_ASIDE + 1).min(STEPS);
        (0..ELSEWHERE_ROWS).flat_map(|distance| [-1.0, 1.0].map(|sign| (distance, sign))).all(
            |(distance, sign)| {
                let ridge = &self.ridge(offset + sign * (tolerance + distance as f32));
                let near = near.clone();
                let least = simd::run(Elsewhere { steps: &self.steps[blur], samples, ridge, near });
                least >= ELSEWHERE_SHARE * explanation.with
            },
        )
    }

    fn ridge(&self, offset: f32) -> [f32; ROWS] {
        std::array::from_fn(|row| {
            let distance = (row as f32 - EXPLAINED_ROWS as f32 - offset) / self.deviation;
            (-0.5 * distance * distance).exp()
        })
    }
}

impl Default for EdgeModel {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: f32 = 3.0;

    /// A ridge of this height at row 0 and an edge, both blurred as a lens does, with some noise.
    fn column(ridge: f32, step: f32, edge: f32, at: f32) -> [f32; ROWS] {
        let mut noise = 7_u32;
        std::array::from_fn(|index| {
            let row = index as f32 - EXPLAINED_ROWS as f32;
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = (noise >> 16) as f32 / 65_536.0 * 4.0 - 2.0;
            let deviation = WIDTH / 2.355;
            let bell = (-0.5 * ((row - at) / deviation).powi(2)).exp();
            5.0 + step / (1.0 + (-(row - edge) * 1.4).exp()) + ridge * bell + noise
        })
    }

    fn explain(samples: &[f32; ROWS]) -> (Explanation, EdgeModel) {
        let mut model = EdgeModel::new();
        model.set_width(WIDTH);
        (model.explain(samples, 0.0), model)
    }

    #[test]
    fn a_stripe_is_found_as_a_shoulder_of_a_much_stronger_edge() {
        for edge in [3.0, 3.5, 4.0, 5.0] {
            let samples = column(60.0, 120.0, edge, 0.0);
            let (explanation, model) = explain(&samples);
            assert!(explanation.is_ridge(20.0, 60.0), "edge at {edge}: {explanation:?}");
            assert!(model.is_nowhere_else(&samples, &explanation, 0.0, 2.0), "edge at {edge}");
            assert!((explanation.ridge - 60.0).abs() < 20.0, "edge at {edge}: {explanation:?}");
        }
    }

    #[test]
    fn an_edge_without_a_stripe_is_none_wherever_it_is() {
        for place in -16..=16 {
            for step in [-140.0, 40.0, 140.0] {
                let (explanation, _) = explain(&column(0.0, step, place as f32 / 2.0, 0.0));
                assert!(!explanation.is_ridge(12.0, 40.0), "{step} at {place}: {explanation:?}");
            }
        }
    }

    /// A thin cable lifts the stripe by a few rows; what is left at the floor's row is its flank.
    #[test]
    fn a_stripe_off_the_floor_is_no_stripe_on_it() {
        for at in [3.0, 4.0, -3.0] {
            let samples = column(80.0, 45.0, 1.0, at);
            let (explanation, model) = explain(&samples);
            let believed =
                explanation.is_ridge(20.0, 80.0) && model.is_nowhere_else(&samples, &explanation, 0.0, 1.5);
            assert!(!believed, "at {at}: {explanation:?}");
        }
    }

    #[test]
    fn an_edge_hides_a_stripe_only_near_it_and_only_if_it_is_a_clean_one() {
        assert!(explain(&column(0.0, 120.0, 0.0, 0.0)).0.may_hide(30.0, 0.0));
        assert!(!explain(&column(0.0, 120.0, 7.0, 0.0)).0.may_hide(30.0, 0.0), "far from it");
        assert!(!explain(&column(0.0, 10.0, 0.0, 0.0)).0.may_hide(30.0, 0.0), "a small step");
    }
}
