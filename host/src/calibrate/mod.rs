//! Calibration from pictures: lens, the camera's pose over the floor, and the laser's sheet, with how sure they are.
//!
//! | module | what it does |
//! |---|---|
//! | [`picture`], [`board`], [`stripe`] | what is seen: pictures, board corners, places that could be the stripe |
//! | [`pose`], [`sheet`] | first guesses: a board's pose; which candidates are the stripe on floor and blocks |
//! | [`model`], [`fit`] | one robust fit of everything to every pixel, with its covariance |
//! | [`lens`] | the lens from many views of a board |
//! | [`session`] | the whole rig from a board on the floor, the clean stripe and blocks of known height |
//! | [`shadow`], [`world`] | where the laser's fan starts; from the floor's frame to the robot's |
//! | [`uncertainty`], [`verdict`] | what the result is worth, in millimetres and in words |
//! | `refusal` | the words for calibrations that cannot go on |
//! | [`drift`] | is a calibrated rig still true? |
//! | [`output`], [`plot`] | files: rig with uncertainties, compact form, drawings |
//!
//! The model is OpenCV's (pinhole, `k1 k2 p1 p2 k3`) and a plane of light. One block of known height is enough to fix
//! the plane once the board has fixed the floor; a second one checks the first and the board's own size.

pub mod board;
pub mod drift;
pub mod fit;
pub mod lens;
pub mod model;
pub mod output;
pub mod picture;
pub mod plot;
pub mod pose;
mod refusal;
pub mod session;
pub mod shadow;
pub mod sheet;
pub mod stripe;
pub mod uncertainty;
pub mod verdict;
pub mod world;

use std::path::PathBuf;

use nearfield_shared::rig::RigError;

/// Why a calibration was refused. Every message says what to do.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// A picture cannot be used.
    #[error("{}: {problem}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// What is wrong with it and what to do.
        problem: String,
    },
    /// The pictures do not fix what is to be calibrated.
    #[error("{0}")]
    Degenerate(String),
    /// The pictures contradict what was said about them.
    #[error("{0}")]
    Contradiction(String),
    /// A file with a lens cannot be used.
    #[error("{}: {problem}", path.display())]
    LensFile {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        problem: String,
    },
    /// The result is no rig.
    #[error(
        "the calibrated parts do not make a rig: {0}; check the board, the blocks' heights and which picture is which"
    )]
    Rig(#[from] RigError),
}
