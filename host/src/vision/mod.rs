//! From a camera frame to where the laser's stripe is, and what it says about the floor.
//!
//! [`signal`] (how red is a pixel) -> [`floor`] (is the stripe lit on the floor, where exactly) -> [`raised`] (where
//! did it go if not) -> [`extractor`] (one reading per image column) -> [`analysis`] (tiers 1 and 2 over the whole
//! picture). [`grid`] knows where to look, [`peak`] how to measure.

pub mod analysis;
pub mod edge;
pub mod extractor;
pub mod floor;
pub mod grid;
mod measure;
pub mod peak;
pub mod profile;
pub mod raised;
pub mod ridge;
pub mod rig_deviation;
pub mod signal;
pub mod unrigged;

pub use analysis::{Analyser, StripeObject};
pub use extractor::{Extractor, ForeignFrame, OffFloorPoint};
pub use rig_deviation::RigDeviation;

#[cfg(test)]
mod tests;
