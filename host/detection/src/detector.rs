//! What every detector promises: a picture in; out come all objects that it saw, or that it does not know.
//!
//! There is no third answer. A detector that is late, failed or talked nonsense has not seen an empty floor: it has
//! seen nothing, and [`Unknown`] says why. Whoever fuses tiers treats that as a reason for care, never as "clear".

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::boxes::BoundingBox;

/// More objects than this in one picture are not a floor but nonsense.
pub const MOST_DETECTIONS: usize = 300;
/// Widest and highest picture that is taken, pixels: beyond, a size field is broken rather than a camera good.
pub const LARGEST_SIDE: u32 = 16_384;

/// A picture, borrowed: rows of red, green, blue bytes without gaps.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    width: u32,
    height: u32,
    rgb: &'a [u8],
}

impl<'a> Picture<'a> {
    /// Checks that the bytes are those of a picture of this size.
    ///
    /// # Errors
    /// [`Unknown::UnusablePicture`]: no pixels, too many, or not three bytes for each.
    pub fn new(width: u32, height: u32, rgb: &'a [u8]) -> Result<Self, Unknown> {
        let unusable = |what: String| Unknown::UnusablePicture { what };
        if width == 0 || height == 0 || width > LARGEST_SIDE || height > LARGEST_SIDE {
            return Err(unusable(format!("{width} x {height} pixels; 1 to {LARGEST_SIDE} a side are taken")));
        }
        let expected = width as usize * height as usize * 3;
        if rgb.len() != expected {
            return Err(unusable(format!(
                "{} bytes for {width} x {height} pixels, not {expected}",
                rgb.len()
            )));
        }
        Ok(Self { width, height, rgb })
    }

    /// Columns, pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows, pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Red, green, blue, row by row.
    #[must_use]
    pub fn rgb(&self) -> &'a [u8] {
        self.rgb
    }
}

impl<'a> TryFrom<&'a image::RgbImage> for Picture<'a> {
    type Error = Unknown;

    fn try_from(picture: &'a image::RgbImage) -> Result<Self, Unknown> {
        Self::new(picture.width(), picture.height(), picture.as_raw())
    }
}

/// One object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Detection {
    /// Index into [`Detector::classes`].
    pub class: usize,
    /// The network's own number, 0 to 1, for ranking; not a probability.
    pub score: f32,
    /// Calibrated: of many detections with 0.8, about 80 % are right (on pictures like those it was fitted on).
    pub confidence: f32,
    /// Where, in pixels of the picture as given.
    pub place: BoundingBox,
}

/// Why a detector does not know.
#[derive(Debug, Clone, PartialEq, Eq, Error, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unknown {
    /// No answer in time; the picture is lost, and so are those that come until the detector is back.
    #[error("no answer within {deadline_ms} ms")]
    Stalled {
        /// The time it had, milliseconds.
        deadline_ms: u64,
    },
    /// The backend reported an error.
    #[error("the backend failed: {what}")]
    Failed {
        /// In the backend's words.
        what: String,
    },
    /// The backend answered with something that cannot be true.
    #[error("the backend's answer makes no sense: {what}")]
    Nonsense {
        /// What is wrong with it.
        what: String,
    },
    /// This picture cannot be looked at.
    #[error("the picture cannot be used: {what}")]
    UnusablePicture {
        /// What is wrong with it.
        what: String,
    },
}

/// Something that finds objects in pictures.
pub trait Detector: Send {
    /// Names of the classes; [`Detection::class`] counts in this order.
    fn classes(&self) -> &[String];

    /// All objects in the picture, best score first, or why they are not known.
    ///
    /// # Errors
    /// [`Unknown`]: nothing may be concluded from this picture, least of all that the floor is clear.
    fn detect(&mut self, picture: Picture<'_>) -> Result<&[Detection], Unknown>;
}

/// Does this make sense as an answer about a picture of this size? Everything that any backend says passes here.
///
/// # Errors
/// [`Unknown::Nonsense`]: too many objects, a class that does not exist, a number that is not one.
pub fn plausible(detections: &[Detection], classes: usize) -> Result<(), Unknown> {
    let nonsense = |what: String| Err(Unknown::Nonsense { what });
    if detections.len() > MOST_DETECTIONS {
        return nonsense(format!("{} objects in one picture", detections.len()));
    }
    for detection in detections {
        let Detection { class, score, confidence, place } = detection;
        if *class >= classes {
            return nonsense(format!("class {class} of {classes}"));
        }
        if !(0.0..=1.0).contains(score) || !(0.0..=1.0).contains(confidence) {
            return nonsense(format!("a score of {score} with confidence {confidence}"));
        }
        if !place.is_finite() || place.right < place.left || place.bottom < place.top {
            return nonsense(format!(
                "a box from {}, {} to {}, {}",
                place.left, place.top, place.right, place.bottom
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> Detection {
        Detection { class: 1, score: 0.5, confidence: 0.4, place: BoundingBox::around(5.0, 5.0, 2.0, 2.0) }
    }

    #[test]
    fn what_makes_sense_passes_and_nothing_else() {
        assert_eq!(plausible(&[good()], 2), Ok(()));
        assert_eq!(plausible(&[], 0), Ok(()));
        let bad = [
            Detection { class: 2, ..good() },
            Detection { score: f32::NAN, ..good() },
            Detection { score: 1.01, ..good() },
            Detection { confidence: -0.1, ..good() },
            Detection { place: BoundingBox { left: f32::INFINITY, ..good().place }, ..good() },
            Detection { place: BoundingBox { left: 9.0, ..good().place }, ..good() },
        ];
        for detection in bad {
            assert!(matches!(plausible(&[detection], 2), Err(Unknown::Nonsense { .. })), "{detection:?}");
        }
        assert!(plausible(&vec![good(); MOST_DETECTIONS], 2).is_ok());
        assert!(plausible(&vec![good(); MOST_DETECTIONS + 1], 2).is_err());
    }

    #[test]
    fn a_picture_has_three_bytes_for_every_pixel() {
        assert!(Picture::new(2, 2, &[0; 12]).is_ok());
        for (width, height, bytes) in [(2, 2, 11), (2, 2, 13), (0, 2, 0), (LARGEST_SIDE + 1, 1, 3)] {
            assert!(
                Picture::new(width, height, &vec![0; bytes]).is_err(),
                "{width} x {height}, {bytes} bytes"
            );
        }
    }
}
