//! Are confidences probabilities? Of all detections with 0.8, 80 % should be right.

use serde::Serialize;

use crate::calibration::Calibration;

/// Bins from 0 to 1.
const BINS: usize = 10;

/// Detections whose confidence falls into one tenth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bin {
    /// Detections.
    pub detections: usize,
    /// Their mean confidence.
    pub confidence: f64,
    /// The part of them that is right.
    pub right: f64,
}

/// The diagram and its one number.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reliability {
    /// Ten bins, 0 to 1; an empty one has no detections.
    pub bins: Vec<Bin>,
    /// Mean distance between confidence and truth, weighed by detections (expected calibration error).
    pub error: f64,
}

impl Reliability {
    /// Of detections with their score and whether they are right, with confidences by this calibration.
    #[must_use]
    pub fn new(judged: &[(f32, bool)], calibration: Calibration) -> Self {
        let mut sums = [(0usize, 0.0f64, 0usize); BINS];
        for (score, right) in judged {
            let confidence = f64::from(calibration.confidence(*score));
            let bin = &mut sums[((confidence * BINS as f64) as usize).min(BINS - 1)];
            *bin = (bin.0 + 1, bin.1 + confidence, bin.2 + usize::from(*right));
        }
        let bins: Vec<Bin> = sums
            .iter()
            .map(|(count, confidence, right)| {
                let divisor = (*count).max(1) as f64;
                Bin { detections: *count, confidence: confidence / divisor, right: *right as f64 / divisor }
            })
            .collect();
        let distance = |bin: &Bin| bin.detections as f64 * (bin.confidence - bin.right).abs();
        let error = bins.iter().map(distance).sum::<f64>() / judged.len().max(1) as f64;
        Self { bins, error }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn honest_confidences_have_no_error_and_bragging_ones_have() {
        let judged: Vec<(f32, bool)> = (0..1000u16).map(|index| (0.75, index % 4 != 0)).collect();
        let honest = Reliability::new(&judged, Calibration::default());
        assert!(honest.error < 1e-4, "{honest:?}");
        assert_eq!(honest.bins[7].detections, 1000);
        let bragging: Vec<(f32, bool)> = judged.iter().map(|(_, right)| (0.95, *right)).collect();
        let error = Reliability::new(&bragging, Calibration::default()).error;
        assert!((error - 0.2).abs() < 1e-4, "{error}");
    }

    #[test]
    fn a_fitted_calibration_lowers_the_error() {
        // Right a quarter less often than the score says.
        let one = |index: u16| {
            let score = 0.5 + f32::from(index % 50) / 100.0;
            (score, f32::from(index / 50) / 40.0 < score - 0.25)
        };
        let judged: Vec<(f32, bool)> = (0..2000).map(one).collect();
        let before = Reliability::new(&judged, Calibration::default()).error;
        let after = Reliability::new(&judged, Calibration::fit(&judged).unwrap()).error;
        assert!(after < before / 3.0, "{after} after {before}");
    }

    #[test]
    fn no_detections_have_no_error() {
        assert_eq!(Reliability::new(&[], Calibration::default()).error, 0.0);
    }
}
