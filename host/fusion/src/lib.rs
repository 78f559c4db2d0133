//! Tier 3 meets tiers 1 and 2.
//!
//! ```text
//!  sightings (box, category, confidence) --footprint--> floor --track--> tracks --+--claims--> line-scan (the controller decides)
//!  robot's motion ----------------------------------------^                      |
//!  stripe of the same picture: gaps, heights -------------------------------------+--decide--> verdict and advice
//! ```
//!
//! * [`footprint`]: where on the floor is what a box of the picture shows, and how high can it be at most?
//! * [`track`]: the same thing from picture to picture, while the robot moves.
//! * [`mod@decide`]: the action table over what lies on the stripe and ahead of it. A total function: whatever is not known is
//!   the most restrictive.
//! * [`classes`]: which category of the action table is a detector's class?
//! * [`claims`]: what the controller is told. It permits nothing by itself, see [`nearfield_shared::run_over`].
//!
//! Nothing here can make the robot less careful than the controller is; everything here can make it more careful.
//! Floor coordinates are the world's (x along the robot's edge, y outward), millimetres; times are the host's clock.

pub mod claims;
pub mod classes;
pub mod decide;
pub mod footprint;
pub mod track;

pub use decide::{Advice, Obstruction, decide};
pub use footprint::{BoxPixels, FloorPoint, Footprint};
pub use track::{Answer, Motion, Sighting, Track, Tracker};
