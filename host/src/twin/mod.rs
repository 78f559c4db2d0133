//! The digital twin: camera pictures of a laser stripe on a floor, with the exact truth about them.
//!
//! An analytic renderer: every pixel's ray is followed to the nearest surface, lit by the hall and by the laser's
//! sheet with its true width, fall-off, shadows and speckle, and turned into bytes by a model of lens, sensor and
//! image processor. The same seed gives the same picture on any number of threads. The laser's brightness command is
//! an input of every frame, so the twin closes the loop with the microcontroller.
//!
//! ```
//! use std::sync::Arc;
//! use nearfield_host::twin::{ExpectedCutoff, Twin, View, gallery};
//!
//! let view = Arc::new(View::new(&gallery::CENTRE.rig()?));
//! let scene = gallery::scene("box_45").ok_or("no such scene")?;
//! let twin = Twin::new(view, &scene, 7)?;
//! let picture = twin.render(0, 1.0);
//! assert_eq!((picture.width, picture.height), (1152, 648));
//! assert_eq!(twin.truth(1.0).cutoff, ExpectedCutoff::Trip);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | what it does |
//! |---|---|
//! | [`scene`], [`material`], [`gallery`] | what is there: files, materials, ready-made and random scenes |
//! | [`view`] | a rig's lines of sight, computed once |
//! | [`shape`], [`body`] | solids and what a ray meets |
//! | [`floor`], [`texture`], [`relief`], [`light`], [`open_floor`], [`sheet`], [`bounce`] | colours of floors (procedural or from a picture) and their waves, daylight and its shadows, the laser's sheet, light thrown on by bodies |
//! | [`patch`], [`dirt`], [`sensor`], [`picture`] | lens blur, dirt on the lens, noise and colour, bytes |
//! | [`render`] | all of it together: [`Twin`] |
//! | [`sequence`] | a robot and objects that move, rolling shutter, blur by motion: [`Sequence`] |
//! | [`board`] | pictures of a calibration board |
//! | [`truth`] | what a correct sensor must say |
//! | [`compare`] | measured against another renderer's pictures |
//!
//! Not modelled: light that bounces more than once, mirror images in wet floors, light that leaves a translucent body on
//! another side than it has entered, speckle that changes with motion (it stays where it is in the picture).

pub mod board;
pub mod body;
pub mod bounce;
pub mod compare;
pub mod dirt;
pub mod floor;
pub mod gallery;
pub mod light;
pub mod material;
pub mod open_floor;
pub mod patch;
pub mod picture;
pub mod random;
pub mod relief;
pub mod render;
pub mod scene;
mod scene_check;
pub mod sensor;
pub mod sequence;
pub mod shape;
pub mod sheet;
pub mod texture;
pub mod truth;
pub mod view;

pub use picture::Picture;
pub use render::Twin;
pub use scene::{Scene, SceneError, SceneObject};
pub use sequence::{Sequence, SequenceError};
pub use truth::{ExpectedCutoff, Truth};
pub use view::View;
