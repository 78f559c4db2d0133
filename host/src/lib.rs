//! The Pi host of nearfield.

pub mod capture;
pub mod rig_file;
pub mod twin;
