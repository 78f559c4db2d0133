//! The source paper's own Approaches 1 and 2, as it describes them: the reference that this project's vision must beat.
//!
//! Approach 1, in the paper's order: RGB to hue and saturation, both thresholded adaptively ([`mask`]); morphology
//! removes specks; a Hough transform finds the beam's trajectory ([`trajectory`]); a homography, calibrated on a flat
//! target, warps the region of interest to a top-down view ([`top_down`]); a running average over 5 mm and the mean of
//! three frames smooth it; a gap of more than 5 mm trips ([`continuity`]). Approach 2 is its closed form for heights
//! ([`heights`]). The image operations are those of the crate `imageproc`.
//!
//! Where the paper is silent: the hue window is the laser's red +- 15 degrees; the threshold block is a twentieth of
//! the picture's width; the top-down view has two pixels per millimetre; a stripe more than 5 mm off its trajectory in
//! that view is off it; the averaged signal is "line" above half. No lens distortion is corrected, as none is mentioned.

pub mod continuity;
pub mod heights;
pub mod mask;
pub mod table;
pub mod top_down;
pub mod trajectory;
pub mod trials;

use image::RgbImage;
use nearfield_shared::rig::{ImageSize, Rig};

use crate::capture::Frame;
use continuity::{Continuity, PaperGap};
use heights::{PaperHeights, PaperObject};
use top_down::TopDown;

/// What the paper's pipeline makes of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PaperFinding {
    /// Was any line found in the mask?
    pub stripe_found: bool,
    /// Is the longest gap longer than the limit?
    pub is_cut: bool,
    /// All gaps, along the stripe.
    pub gaps: Vec<PaperGap>,
    /// Objects with heights by the closed form.
    pub objects: Vec<PaperObject>,
}

impl PaperFinding {
    /// Length of the longest gap, millimetres; zero without one.
    #[must_use]
    pub fn longest_gap_mm(&self) -> f32 {
        self.gaps.iter().map(|gap| gap.end_mm - gap.start_mm).fold(0.0, f32::max)
    }
}

/// The paper's method cannot be used with this rig or frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PaperError {
    /// The homography does not exist: the rig does not see its stripe's surroundings.
    #[error("the rig's view of the floor around the stripe has no top-down homography")]
    NoHomography,
    /// A frame of another size.
    #[error("a frame of {} x {} does not belong to a rig of {} x {} pixels", frame.width, frame.height, rig.width, rig.height)]
    ForeignFrame {
        /// The frame's size.
        frame: ImageSize,
        /// The rig's size.
        rig: ImageSize,
    },
}

/// The paper's pipeline for one rig; keeps the two frames before.
#[derive(Debug, Clone)]
pub struct PaperMethod {
    size: ImageSize,
    top_down: TopDown,
    continuity: Continuity,
    heights: PaperHeights,
}

impl PaperMethod {
    /// Prepares for a rig; `heights` say which geometry the closed form assumes ([`PaperHeights::of`]).
    ///
    /// # Errors
    /// [`PaperError::NoHomography`].
    pub fn new(rig: &Rig, heights: PaperHeights) -> Result<Self, PaperError> {
        let top_down = TopDown::new(rig).ok_or(PaperError::NoHomography)?;
        let continuity = Continuity::new(top_down.start_mm(), top_down.places());
        Ok(Self { size: rig.image(), top_down, continuity, heights })
    }

    /// Takes the next frame of a sequence.
    ///
    /// # Errors
    /// [`PaperError::ForeignFrame`].
    pub fn update(&mut self, frame: &Frame) -> Result<PaperFinding, PaperError> {
        if frame.size() != self.size {
            return Err(PaperError::ForeignFrame { frame: frame.size(), rig: self.size });
        }
        let (width, height) = (u32::from(self.size.width), u32::from(self.size.height));
        let foreign = PaperError::ForeignFrame { frame: frame.size(), rig: self.size };
        let picture = RgbImage::from_raw(width, height, frame.to_rgb()).ok_or(foreign)?;
        let mask = mask::laser_mask(&picture, self.top_down.rows());
        let trajectory = trajectory::find(&mask);
        let signal = trajectory.map(|line| self.top_down.signal(&mask, &line)).unwrap_or_default();
        self.continuity.push(&signal);
        let gaps = self.continuity.gaps();
        let objects = self.heights.objects(&picture, &mask, &self.top_down);
        let is_cut = gaps.iter().any(PaperGap::is_cut);
        Ok(PaperFinding { stripe_found: trajectory.is_some(), is_cut, gaps, objects })
    }

    /// Judges a picture by itself: as if the scene had stood still for three frames.
    ///
    /// # Errors
    /// [`PaperError::ForeignFrame`].
    pub fn judge(&mut self, frame: &Frame) -> Result<PaperFinding, PaperError> {
        self.continuity.reset();
        // The mean of three equal frames is the frame.
        self.update(frame)
    }
}

/// One picture, by a rig, through the paper's pipeline with its closed form as the rig says.
///
/// # Errors
/// See [`PaperError`].
pub fn analyse(frame: &Frame, rig: &Rig) -> Result<PaperFinding, PaperError> {
    PaperMethod::new(rig, PaperHeights::of(rig, 0.0))?.judge(frame)
}
