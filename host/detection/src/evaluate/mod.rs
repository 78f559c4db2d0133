//! How good is a detector? Judged on any folder of pictures with COCO annotations.
//!
//! | module | what it does |
//! |---|---|
//! | [`coco`] | reads folders; matches names of classes |
//! | [`matching`] | which detection is which object |
//! | [`metrics`] | COCO's twelve numbers, as pycocotools defines them |
//! | [`operating`] | precision, recall, confusion and people found, at the scores that are used |
//! | [`reliability`] | are confidences probabilities? |
//! | [`interval`] | how sure a share is |
//! | [`run`] | all of it, for all parts of a dataset |
//! | [`page`] | as a page with pictures of the worst cases |
//! | [`paper`] | the source paper's figures |

pub mod coco;
pub mod interval;
pub mod matching;
pub mod metrics;
pub mod operating;
pub mod page;
pub mod paper;
pub mod reliability;
pub mod run;

use serde::{Deserialize, Serialize};

/// One detection as it is judged: in double precision, so that figures can be compared with other programs'.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Index of the picture in the dataset.
    pub picture: usize,
    /// Index of the class in the dataset.
    pub class: usize,
    /// Score, 0 to 1.
    pub score: f64,
    /// Left, top, width, height, pixels.
    pub place: [f64; 4],
}

/// One object that is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Index of the picture in the dataset.
    pub picture: usize,
    /// Index of the class in the dataset.
    pub class: usize,
    /// Left, top, width, height, pixels.
    pub place: [f64; 4],
    /// Square pixels of the object itself, not of its box.
    pub area: f64,
    /// A crowd: not judged, and any number of detections may lie in it.
    pub crowd: bool,
}

/// Intersection over union; for a crowd the part of the detection that lies in it.
#[must_use]
pub fn overlap(detection: &[f64; 4], truth: &[f64; 4], crowd: bool) -> f64 {
    let width = (detection[0] + detection[2]).min(truth[0] + truth[2]) - detection[0].max(truth[0]);
    let height = (detection[1] + detection[3]).min(truth[1] + truth[3]) - detection[1].max(truth[1]);
    if width <= 0.0 || height <= 0.0 {
        return 0.0;
    }
    let common = width * height;
    let own = detection[2] * detection[3];
    let union = if crowd { own } else { own + truth[2] * truth[3] - common };
    common / union
}
