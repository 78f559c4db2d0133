//! Tier 3: what is it? Object detection on the floor in front of the robot, and how good it is.
//!
//! ```text
//!  picture -> tiles -> letterbox -> network (rten | onnxruntime | Hailo) -> decode -> suppress -> classifier -> detections
//!                                                                              \-> or "unknown", with the reason
//! ```
//!
//! | module | what it does |
//! |---|---|
//! | [`detector`] | the promise of every detector: all objects, or why they are not known; never a silent "clear" |
//! | [`watch`] | a deadline for any detector |
//! | [`network`] | detectors made of a network and its [`card`] |
//! | [`backend`] | rten (default), onnxruntime (feature `ort`), Hailo (feature `hailo`), recorded detections |
//! | [`letterbox`], [`tiles`], [`decode`], [`suppress`] | what stands before and after a network |
//! | [`classifier`] | a second look at each found place: what is it? |
//! | [`calibration`] | from scores to probabilities |
//! | [`model`] | the network that comes along, or one from a file |
//! | [`evaluate`] | how good a detector is, on any folder with COCO annotations |
//! | [`cli`] | the commands `nearfield detect` and `nearfield evaluate` |
//!
//! Nothing here opens or closes a relay: what is found can only make the robot more careful, save for run-over permits,
//! which the safety controller grants by itself.

pub mod backend;
pub mod boxes;
pub mod calibration;
pub mod card;
pub mod class;
pub mod classifier;
pub mod cli;
pub mod decode;
pub mod detector;
pub mod draw;
pub mod evaluate;
pub mod letterbox;
pub mod model;
pub mod network;
pub mod suppress;
pub mod tiles;
pub mod watch;
