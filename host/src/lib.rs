//! The Pi host of nearfield.

pub mod capture;
pub mod link;
pub mod rig_file;
pub mod twin;
