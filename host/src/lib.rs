//! The Pi host of the near-field safety sensor: pictures in, line-scans out, and everything around the safety
//! controller that is not safety itself. Whatever is wrong in here can stop the robot, but never keep it going.
//!
//! | module | what it does |
//! |---|---|
//! | [`capture`] | pictures from files, as planes: PNG, JPEG, raw YUV420 and NV12 |
//! | [`rig_file`] | the rig's TOML file, checked field by field |
//! | [`vision`] | the stripe in every column, sub-pixel; gaps, objects, heights at full resolution |
//! | [`line_scan`] | full-resolution readings to the 1152 columns of the line-scan, hiding nothing |
//! | [`light`] | how bright the stripe is, and the raw pixels that the safety controller asks for |
//! | [`link`] | the safety controller, in this process or emulated, with its relays, button and clock |
//! | [`twin`] | a renderer of camera pictures with exact truth |
//! | [`demo`] | the scripted minute: every promise stated, played, checked and reported |
//! | [`calibrate`] | lens, floor and laser from pictures, with how sure they are; has a rig drifted? |
//! | [`paper`] | the source paper's own pipeline and closed-form heights, to compare with |
//! | [`capability`] | the smallest object that a rig detects, along the stripe |
//! | [`scene_file`] | pictures with known truth, to measure with |
//! | [`annotate`] | what was found, drawn on the picture |
//! | [`black_box`] | the controller's record of a stop: fetched, kept, replayed; service requests |
//! | [`campaign`] | thousands of made-up scenes: how often is the vision wrong? |
//! | [`cli`] | the command `nearfield` |
//!
//! The way of a picture: [`capture::read_frame`] -> [`vision::Analyser`] -> [`line_scan::LineScanEncoder`] ->
//! [`link::McuSession`].

pub mod annotate;
pub mod black_box;
pub mod calibrate;
pub mod campaign;
pub mod capability;
pub mod capture;
pub mod cli;
pub mod demo;
pub mod light;
pub mod line_scan;
pub mod link;
pub mod paper;
pub mod rig_file;
pub mod run;
pub mod scene_file;
mod simd;
pub mod twin;
pub mod vision;
