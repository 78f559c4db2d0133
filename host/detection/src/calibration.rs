//! From scores to probabilities: Platt's logistic fit on the logit of the score.
//!
//! Source: Platt, "Probabilistic outputs for support vector machines", 1999, with his smoothed targets.

use serde::{Deserialize, Serialize};

/// Scores this close to 0 or 1 are moved inwards: their logit would be infinite.
const EDGE: f32 = 1e-4;
/// Steps of Newton's method; it converges in fewer than ten.
const STEPS: usize = 50;

/// `confidence = sigmoid(slope * logit(score) + intercept)`; slope 1 and intercept 0 change nothing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Below 1: the network is too sure of itself, both ways.
    pub slope: f32,
    /// Below 0: it is too sure in general.
    pub intercept: f32,
}

impl Default for Calibration {
    fn default() -> Self {
        Self { slope: 1.0, intercept: 0.0 }
    }
}

fn logit(score: f32) -> f64 {
    let score = f64::from(score.clamp(EDGE, 1.0 - EDGE));
    (score / (1.0 - score)).ln()
}

fn sigmoid(value: f64) -> f64 {
    1.0 / (1.0 + (-value).exp())
}

impl Calibration {
    /// Does it keep the order of scores, and are its numbers numbers?
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.slope.is_finite() && self.intercept.is_finite() && self.slope > 0.0
    }

    /// The probability that a detection with this score is right.
    #[must_use]
    pub fn confidence(&self, score: f32) -> f32 {
        let value = f64::from(self.slope) * logit(score) + f64::from(self.intercept);
        (sigmoid(value) as f32).clamp(0.0, 1.0)
    }

    /// Fits to detections with their score and whether they were right. `None` where there is nothing to learn: fewer
    /// than ten of either kind, or scores that say less than nothing.
    #[must_use]
    pub fn fit(judged: &[(f32, bool)]) -> Option<Self> {
        const LEAST: usize = 10;
        let right = judged.iter().filter(|(_, right)| *right).count();
        let wrong = judged.len() - right;
        if right < LEAST || wrong < LEAST {
            return None;
        }
        // Platt's targets: as if one more of either kind had been seen.
        let targets = (1.0 / (wrong as f64 + 2.0), (right as f64 + 1.0) / (right as f64 + 2.0));
        let (mut slope, mut intercept) = (1.0_f64, 0.0_f64);
        for _ in 0..STEPS {
            let mut gradient = (1e-9 * slope, 0.0);
            let (mut aa, mut ab, mut bb) = (1e-9, 0.0, 1e-9);
            for (score, right) in judged {
                let x = logit(*score);
                let probability = sigmoid(slope * x + intercept);
                let error = probability - if *right { targets.1 } else { targets.0 };
                let weight = probability * (1.0 - probability);
                gradient = (gradient.0 + error * x, gradient.1 + error);
                (aa, ab, bb) = (aa + weight * x * x, ab + weight * x, bb + weight);
            }
            let determinant = aa * bb - ab * ab;
            let step = (
                (bb * gradient.0 - ab * gradient.1) / determinant,
                (aa * gradient.1 - ab * gradient.0) / determinant,
            );
            // A step longer than this overshoots on separable data.
            let length = step.0.hypot(step.1);
            let damping = if length > 2.0 { 2.0 / length } else { 1.0 };
            (slope, intercept) = (slope - damping * step.0, intercept - damping * step.1);
            if length < 1e-10 {
                break;
            }
        }
        let fitted = Self { slope: slope as f32, intercept: intercept as f32 };
        fitted.is_usable().then_some(fitted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Detections with evenly spread scores; of those with a score, the share `truth(score)` is right.
    fn judged(truth: impl Fn(f32) -> f32) -> Vec<(f32, bool)> {
        let mut list = Vec::new();
        for step in 1..100u8 {
            let score = f32::from(step) / 100.0;
            for sample in 0..200u8 {
                list.push((score, (f32::from(sample) + 0.5) / 200.0 < truth(score)));
            }
        }
        list
    }

    #[test]
    fn honest_scores_stay_as_they_are() {
        let fitted = Calibration::fit(&judged(|score| score)).unwrap();
        assert!((fitted.slope - 1.0).abs() < 0.02 && fitted.intercept.abs() < 0.02, "{fitted:?}");
    }

    #[test]
    fn the_distortion_that_was_put_in_is_found() {
        let wanted = Calibration { slope: 0.6, intercept: -0.8 };
        let fitted = Calibration::fit(&judged(|score| wanted.confidence(score))).unwrap();
        assert!((fitted.slope - wanted.slope).abs() < 0.02, "{fitted:?}");
        assert!((fitted.intercept - wanted.intercept).abs() < 0.03, "{fitted:?}");
    }

    #[test]
    fn too_little_or_misleading_evidence_gives_no_calibration() {
        assert_eq!(Calibration::fit(&[]), None);
        assert_eq!(Calibration::fit(&[(0.9, true); 500]), None);
        assert_eq!(Calibration::fit(&judged(|score| 1.0 - score)), None, "worse than chance");
    }

    #[test]
    fn separable_evidence_does_not_run_away() {
        let mut list = vec![(0.9, true); 50];
        list.extend([(0.1, false); 50]);
        let fitted = Calibration::fit(&list).unwrap();
        assert!(fitted.confidence(0.9) > 0.9 && fitted.confidence(0.1) < 0.1, "{fitted:?}");
    }
}
