//! The host's one configuration file, checked whole, and what follows from it.
//!
//! * [`read`](Configuration::read) takes the TOML text and names **every** error at once, each with its full name, its line's
//!   value and what to do. Everything has a default that runs: an empty file is a valid one, but for the rig.
//! * [`Configuration::COMMENTED`] is the commented file with all defaults; a test holds it to the code.
//! * [`budget`]: response time as a sum of named parts, stopping distance, permitted speed.

pub mod budget;
mod file;
mod interfaces;
mod reader;
mod sections;

pub use file::{Configuration, ConfigurationError};
pub use interfaces::{Fleet, FleetCarrier, Ros2, Ros2Stamp};
pub use reader::Problem;
pub use sections::{
    Camera, Detector, Field, LinkKind, Module, Page, Profile, RealTime, Recording, Robot, Source, SpeedCase,
    SpeedInput, SpeedSource, Spi, Zone,
};
