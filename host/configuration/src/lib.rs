//! The host's one configuration file, checked whole, and what follows from it.
//!
//! * [`read`](Configuration::read) takes the TOML text and names **every** error at once, each with its full name, its line's
//!   value and what to do. Everything has a default that runs: an empty file is a valid one.
//! * [`Configuration::COMMENTED`] is the commented file with all defaults; a test holds it to the code.
//! * [`budget`]: response time as a sum of named parts, stopping distance, permitted speed.
//!
//! In which order to read: `nearfield.toml` (the file as users see it), `sections` (what each part becomes), `reader` (how errors are
//! gathered), `file` (rules across sections), `budget`. The rule that holds: nothing in this file can make the controller less
//! strict; its limits are its own, and what does not fit to them is refused here, before anything runs.

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
