//! What the truth tells of a picture's circumstances: when it was taken, what moved meanwhile, what lay on the lens.

use serde::Serialize;

use super::Truth;
use crate::twin::dirt::DirtyGlass;
use crate::twin::scene::DirtKind;

/// A moment of a sequence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Moment {
    /// Since the sequence's start.
    pub seconds: f64,
    /// The robot's way along the stripe.
    pub robot_along_mm: f64,
    /// The robot's way outward across the stripe.
    pub robot_across_mm: f64,
    /// How much higher than at rest camera and laser are.
    pub robot_up_mm: f64,
}

/// What moves while a row is exposed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Blur {
    /// How long a row is exposed.
    pub exposure_ms: f64,
    /// How far the floor moves in that time, seen from the robot: along and across the stripe.
    pub floor_mm: [f64; 2],
    /// The same for each object.
    pub objects_mm: Vec<[f64; 2]>,
    /// The farthest way of anything in the picture, pixels.
    pub pixels: f64,
}

/// A spot of dirt on the lens, in pixels of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpotTruth {
    /// What it does with light.
    pub kind: DirtKind,
    /// Column of its middle.
    pub column: f64,
    /// Row of its middle.
    pub row: f64,
    /// Where it has faded to nothing.
    pub radius_pixels: f64,
    /// The share of the light that meets it in its middle.
    pub strength: f64,
}

impl Truth {
    /// The same through a dirty lens.
    pub(crate) fn through(mut self, glass: Option<&DirtyGlass>) -> Self {
        let Some(glass) = glass else { return self };
        self.dirt = glass.truth();
        let pixels = self.profile.column.iter().zip(&self.profile.row);
        let clear = pixels.map(|(column, row)| Some(glass.straight_at((*column)?, (*row)?)));
        self.profile.clear = clear.map(|share| share.unwrap_or(0.0)).collect();
        self
    }
}
