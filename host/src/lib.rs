//! The Pi host of nearfield.

pub mod annotate;
pub mod capture;
pub mod cli;
pub mod demo;
pub mod line_scan;
pub mod link;
pub mod rig_file;
pub mod scene_file;
pub mod twin;
pub mod vision;
