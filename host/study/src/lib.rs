//! Where to put camera and laser.
//!
//! | module | what it does |
//! |---|---|
//! | [`mount`] | camera, laser, lens and stripe in the words of somebody who mounts them, as a rig |
//! | [`measure`] | what a mount resolves: rows per millimetre of height, millimetres per column, tallest height, shadows |
//! | [`sweep`] | one quantity of a mount varied, all else kept: the source paper's placement study |
//! | [`recommend`] | the mount that resolves heights best and meets what a robot demands |
//! | [`plot`] | sweeps as drawings |
//!
//! Everything follows from the geometry that the sensor itself uses (`nearfield-shared`), through exact projection; lenses are
//! free of distortion here, which a calibration then measures. World: origin on the floor at the robot's edge below the laser,
//! x along the edge, y outward, z up, millimetres.

pub mod measure;
pub mod mount;
pub mod plot;
pub mod recommend;
pub mod sweep;
