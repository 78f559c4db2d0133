//! Detections that were recorded before: for replays, and for comparing detectors that run elsewhere.
//!
//! The file is JSON: `{"classes": ["bolt", ...], "frames": [[{"class": 0, "score": 0.9, "confidence": 0.8, "place":
//! {"left": 1, "top": 2, "right": 3, "bottom": 4}}, ...], {"unknown": {"stalled": {"deadline_ms": 100}}}, ...]}`; a
//! frame that was not known is replayed as such.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::card::ModelError;
use crate::detector::{Detection, Detector, Picture, Unknown, plausible};

/// What was seen in one picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RecordedFrame {
    /// These objects.
    Seen(Vec<Detection>),
    /// Nothing can be said.
    Unknown {
        /// Why.
        unknown: Unknown,
    },
}

/// Plays recorded detections, one frame for every picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedDetector {
    classes: Vec<String>,
    frames: Vec<RecordedFrame>,
    #[serde(skip)]
    next: usize,
}

impl RecordedDetector {
    /// A recording; nothing is checked before it is played.
    #[must_use]
    pub fn new(classes: Vec<String>, frames: Vec<RecordedFrame>) -> Self {
        Self { classes, frames, next: 0 }
    }

    /// Reads a recording.
    ///
    /// # Errors
    /// The file cannot be read, or is no recording.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ModelError::Unreadable { path: path.to_owned(), source })?;
        serde_json::from_str(&text).map_err(|error| ModelError::BadNetwork {
            path: path.to_owned(),
            what: format!("no recording: {error}"),
        })
    }
}

impl Detector for RecordedDetector {
    fn classes(&self) -> &[String] {
        &self.classes
    }

    fn detect(&mut self, _picture: Picture<'_>) -> Result<&[Detection], Unknown> {
        let index = self.next;
        self.next += 1;
        match self.frames.get(index) {
            None => Err(Unknown::Failed {
                what: format!("the recording ends after {} frames", self.frames.len()),
            }),
            Some(RecordedFrame::Unknown { unknown }) => Err(unknown.clone()),
            Some(RecordedFrame::Seen(detections)) => {
                plausible(detections, self.classes.len())?;
                Ok(detections)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boxes::BoundingBox;

    #[test]
    fn frames_come_in_order_unknown_ones_stay_unknown_and_the_end_is_no_empty_floor() {
        let seen = Detection {
            class: 0,
            score: 0.9,
            confidence: 0.8,
            place: BoundingBox::around(5.0, 5.0, 2.0, 2.0),
        };
        let broken = Detection { class: 7, ..seen };
        let stalled = Unknown::Stalled { deadline_ms: 100 };
        let frames = vec![
            RecordedFrame::Seen(vec![seen]),
            RecordedFrame::Unknown { unknown: stalled.clone() },
            RecordedFrame::Seen(vec![]),
            RecordedFrame::Seen(vec![broken]),
        ];
        let recording = RecordedDetector::new(vec!["bolt".to_owned()], frames);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("recording.json");
        std::fs::write(&path, serde_json::to_string(&recording).unwrap()).unwrap();
        let mut detector = RecordedDetector::read(&path).unwrap();
        let rgb = [0; 3];
        let picture = Picture::new(1, 1, &rgb).unwrap();
        assert_eq!(detector.detect(picture), Ok(&[seen][..]));
        assert_eq!(detector.detect(picture), Err(stalled));
        assert_eq!(detector.detect(picture), Ok(&[][..]));
        assert!(matches!(detector.detect(picture), Err(Unknown::Nonsense { .. })));
        assert!(matches!(detector.detect(picture), Err(Unknown::Failed { .. })));
    }

    #[test]
    fn what_is_no_recording_is_refused_with_its_name() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("recording.json");
        assert!(RecordedDetector::read(&path).unwrap_err().to_string().contains("recording.json"));
        std::fs::write(&path, "{}").unwrap();
        assert!(RecordedDetector::read(&path).unwrap_err().to_string().contains("classes"));
    }
}
