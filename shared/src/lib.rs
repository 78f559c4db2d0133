//! Geometry, wire formats, limits and decisions shared by the safety microcontroller and the host.
//!
//! Nothing here allocates, does I/O, reads a clock or can panic: time and state come in as arguments, results go out
//! as values. The same code runs on the microcontroller, in the host and in the tests.
//!
//! A guided tour, in the order in which a line-scan is used:
//!
//! | module | what it answers |
//! |---|---|
//! | [`units`] | what is measured in which unit (millimetres, rows, microseconds ...) |
//! | [`camera`], [`laser`] | where does a pixel look, where is the sheet of laser light (exact, f64) |
//! | [`rig`] | the whole calibrated rig, its checks and its compact stored form |
//! | [`columns`] | one projective map per image column: row to height and place (f32, one division) |
//! | [`wire`], [`linescan`], [`status`], [`service`] | the wire formats: line-scan, status, service requests and pages |
//! | [`light`], [`audit`] | how bright is the stripe, and do raw pixels bear a reported row out |
//! | [`causes`], [`condition`] | every reason to stop, every state, fault and warning, by name |
//! | [`cutoff`] | tier 1: where is the stripe cut, how long is the longest gap |
//! | [`height`] | tier 2: how high is what lifts the stripe, and is there a drop |
//! | [`monitor`] | both tiers together over one rig, with their votes |
//! | [`action`] | what the robot should do about an object of a known category and size |
//! | [`limits`] | every limit with its unit, source and reason |
//!
//! # Frames of reference
//!
//! World: origin on the floor at the robot's edge, x along the edge (along the stripe), y outward, z up; millimetres.
//! Camera: `x_cam = R x_world + t`, OpenCV's pixel convention (u right, v down, an integer is a pixel's centre).
//! Stripe coordinate s: `X(s) = point + s * direction` on the floor. A laser ray is named by the s at which it would
//! meet the floor if nothing were in its way, so a raised point's s is that of its ray.
#![cfg_attr(not(test), no_std)]
// Tests may compare exact floats, cast and index; the build without tests keeps the strict set for all other code.
#![cfg_attr(
    test,
    allow(
        clippy::as_conversions,
        clippy::float_cmp,
        clippy::arithmetic_side_effects,
        clippy::indexing_slicing
    )
)]

pub mod action;
pub mod audit;
pub mod camera;
pub mod causes;
pub mod columns;
pub mod condition;
pub mod cutoff;
#[cfg(test)]
mod error_tests;
pub mod height;
pub mod laser;
pub mod light;
pub mod limits;
pub mod linescan;
pub mod monitor;
pub mod rig;
pub mod run_over;
pub mod service;
pub mod status;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tier_tests;
pub mod units;
pub mod wire;
