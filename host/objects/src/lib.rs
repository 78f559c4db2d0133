//! Procedural objects, floors and scenes: seeded pictures with exact boxes to train and judge the detector.
//!
//! From the thing to the dataset, each module on top of those before it:
//!
//! | module | what it knows |
//! |---|---|
//! | [`shape`], [`material`], [`model`] | signed distances of shapes, surfaces with wear, parts joined to a model |
//! | [`items`] | the catalogue: every class and what draws its items from a seed |
//! | [`floor`], [`light`], [`laser`], [`camera`] | where the things lie and how they are seen |
//! | [`placed`], [`render`], [`visible`], [`sensor`] | sphere tracing to linear light, what can be seen of each thing, and the camera that makes a picture of it |
//! | [`compose`] | which things lie where: scenes |
//! | [`dataset`] | splits, COCO and YOLO files, the card |
//! | [`sheet`], [`sprite`] | items to look at, cut-outs |
//!
//! Lengths are millimetres, the floor is z = 0, z is up. Colours are linear RGB until [`sensor`] encodes them.
//! Everything is drawn from [`random`]: the same seed gives the same bytes, for any number of threads.

pub mod camera;
pub mod cli;
pub mod compose;
pub mod dataset;
pub mod floor;
pub mod items;
pub mod laser;
pub mod light;
pub mod material;
pub mod model;
pub mod noise;
pub mod placed;
pub mod random;
pub mod render;
pub mod sensor;
pub mod shape;
pub mod sheet;
pub mod sprite;
#[cfg(test)]
mod tests;
pub mod visible;
