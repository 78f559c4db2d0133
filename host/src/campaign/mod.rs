//! How often is the vision wrong? Thousands of made-up scenes, judged against the twin's truth.
//!
//! Scene number `n` always is the same scene, so a campaign can be stopped and taken up again, and a failure can be
//! looked at by its number. Rigs, themes and pixel layouts take turns; floors, lights, paint, objects and materials are
//! drawn from the number ([`crate::twin::gallery::random_scene`]).
//!
//! [`run`] judges single scenes, [`tables`] adds them up by family, [`statistics`] says how sure the shares are.

pub mod run;
pub mod statistics;
pub mod tables;

use serde::{Deserialize, Serialize};

use crate::scene_file::ExpectedCutoff;

/// One scene's outcome: a line of a campaign's file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Number of the scene.
    pub scene: u64,
    /// What it belongs to: `rig:side`, `floor:tiles`, ...
    pub families: Vec<String>,
    /// What a correct sensor must say.
    pub expected: ExpectedCutoff,
    /// Longest true gap, counting shifts of 5 mm and more seen from above, millimetres.
    pub true_gap_mm: f64,
    /// Signal-to-noise ratio of the faintest 5 mm of the stripe on the floor: [`crate::twin::Twin::faintest_stretch`].
    pub faintest: f64,
    /// Did the host's tier 1 stop?
    pub host_cut: bool,
    /// Did the controller's tier 1 stop on the line-scan?
    pub controller_cut: bool,
    /// Longest gap that the host found, millimetres.
    pub gap_mm: f32,
    /// Objects under the stripe.
    pub objects: Vec<ObjectOutcome>,
    /// For each eighth of the quality scale: readings, and how many of them were right.
    pub reliability: [[u32; 2]; RELIABILITY_BINS],
    /// Time for extraction, tiers and line-scan, microseconds.
    pub time_us: u64,
}

/// Steps of the quality scale in [`Outcome::reliability`].
pub const RELIABILITY_BINS: usize = 8;

/// One object's part in an outcome.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectOutcome {
    /// Material's name.
    pub material: String,
    /// Length of the stripe that it takes, millimetres.
    pub width_mm: f64,
    /// 95 % of the stripe on it is not higher, millimetres.
    pub expected_mm: f64,
    /// Found; `None` where no stripe is seen on it.
    pub measured_mm: Option<f32>,
}

/// A stretch of 5 mm with a smaller signal-to-noise ratio (raw red, photons and read-out only) is not measurable. To tell
/// 5 mm of stripe from 5 mm without, with one error in ten thousand of either kind, takes 7.4 standard deviations; the
/// camera's own colour processing costs a factor of 1.7 of them (its colour matrix, red minus green).
pub const LEAST_MEASURABLE: f64 = 12.0;

impl Outcome {
    /// Can the stripe be seen wherever it lies on the floor? Known from the scene, not from what was found in it.
    #[must_use]
    pub fn is_measurable(&self) -> bool {
        self.faintest >= LEAST_MEASURABLE
    }

    /// Stopped without a reason, by host or controller.
    #[must_use]
    pub fn is_false_stop(&self) -> bool {
        self.expected == ExpectedCutoff::NoTrip && (self.host_cut || self.controller_cut)
    }

    /// Did not stop although it must, by host or controller.
    #[must_use]
    pub fn is_miss(&self) -> bool {
        matches!(self.expected, ExpectedCutoff::Trip | ExpectedCutoff::StripeMissing)
            && !(self.host_cut && self.controller_cut)
    }
}

impl ObjectOutcome {
    /// Measured minus true height, millimetres.
    #[must_use]
    pub fn error_mm(&self) -> Option<f64> {
        self.measured_mm.map(|measured| f64::from(measured) - self.expected_mm)
    }

    /// Is the size class wrong where the true height is not within 3 mm of the border?
    #[must_use]
    pub fn is_class_wrong(&self) -> bool {
        const BORDER_MM: f64 = 50.0;
        const CLEAR_MM: f64 = 3.0;
        self.measured_mm.is_some_and(|measured| {
            let clear = (self.expected_mm - BORDER_MM).abs() > CLEAR_MM;
            clear && (f64::from(measured) >= BORDER_MM) != (self.expected_mm >= BORDER_MM)
        })
    }
}
