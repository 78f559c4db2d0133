//! A model's card: what a program must know to use the network, and a reader to judge it. JSON beside the network.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::calibration::Calibration;

/// Format of the cards that this version reads.
pub const SCHEMA: &str = "nearfield-detector-1";
/// Largest input that is believed, pixels.
const LARGEST_INPUT: u32 = 2048;

/// Why a card or a network cannot be used.
#[derive(Debug, Error)]
pub enum ModelError {
    /// A file cannot be read.
    #[error("{path}: {source}")]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The card is not what it should be.
    #[error(
        "{path}: {what}; a card is the JSON that `python -m nearfield_training export` writes beside the network"
    )]
    BadCard {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The backend does not take the network.
    #[error("{path}: {what}")]
    BadNetwork {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The backend's library is not there or not usable.
    #[error("{what}")]
    NoBackend {
        /// What is missing, and what to do.
        what: String,
    },
}

/// What a program must know about a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Card {
    /// [`SCHEMA`].
    pub schema: String,
    /// The network's name.
    pub name: String,
    /// The input is a square with this side, pixels.
    pub input_side: u32,
    /// Names of the classes in the order of the network's outputs.
    pub classes: Vec<String>,
    /// Boxes of one class that overlap more than this (intersection over union) are one object.
    pub largest_overlap: f32,
    /// A score from which an object counts as found, a class each: the operating point.
    pub operating_scores: Vec<f32>,
    /// From score to confidence.
    pub calibration: Calibration,
    /// The network cut at its convolutions of single channels, in the order of computation; empty: not cut. For backends that are
    /// slow at these; others ignore it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<Step>,
    /// File of the network that names the found places once more, beside this card; none: no second look.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classifier: Option<String>,
    /// Data, seed, epochs, metrics: for the reader.
    #[serde(default)]
    pub about: serde_json::Value,
}

/// A piece of a network, by its tensors' names, and the convolution behind it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Tensors that must be known before.
    pub takes: Vec<String>,
    /// Tensors that are known after it, and used later.
    pub gives: Vec<String>,
    /// What comes next; nothing behind the last piece.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depthwise: Option<DepthwiseLayer>,
}

/// A convolution that filters every channel by itself, alone or with the convolutions of single pixels around it; names are those
/// of the network's tensors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DepthwiseLayer {
    /// What is read: (1, channels, rows, columns).
    pub input: String,
    /// What is written: behind the limits, or behind the narrowing.
    pub output: String,
    /// (channels, 1, size, size).
    pub kernel: String,
    /// (channels).
    pub bias: String,
    /// Rows and columns from one output to the next, 1 or 2.
    pub stride: usize,
    /// Outputs are not below this ...
    pub low: f32,
    /// ... nor above this.
    pub high: f32,
    /// Widening of the input before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expand: Option<Expansion>,
    /// Narrowing of the output behind.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub project: Option<Projection>,
    /// Is `input` added to the result? Only with a narrowing.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub shortcut: bool,
}

/// A convolution of single pixels that makes features wide.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Expansion {
    /// (outputs, inputs, 1, 1).
    pub kernel: String,
    /// (outputs).
    pub bias: String,
    /// Outputs are not below this ...
    pub low: f32,
    /// ... nor above this.
    pub high: f32,
}

/// A convolution of single pixels that makes features narrow.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Projection {
    /// (outputs, inputs, 1, 1).
    pub kernel: String,
    /// (outputs).
    pub bias: String,
}

impl Card {
    /// Reads and checks a card; `path` is only for the message.
    ///
    /// # Errors
    /// [`ModelError::BadCard`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, ModelError> {
        let bad = |what: String| ModelError::BadCard { path: path.to_owned(), what };
        let card: Self = serde_json::from_str(text).map_err(|error| bad(error.to_string()))?;
        if card.schema != SCHEMA {
            return Err(bad(format!("schema \"{}\", this version reads \"{SCHEMA}\"", card.schema)));
        }
        if card.input_side == 0 || card.input_side > LARGEST_INPUT || !card.input_side.is_multiple_of(32) {
            return Err(bad(format!(
                "input_side {} is not a multiple of 32 up to {LARGEST_INPUT}",
                card.input_side
            )));
        }
        if card.classes.is_empty() || card.operating_scores.len() != card.classes.len() {
            let (classes, scores) = (card.classes.len(), card.operating_scores.len());
            return Err(bad(format!(
                "{classes} classes with {scores} operating_scores; there must be one for each"
            )));
        }
        let share = |value: &f32| (0.0..=1.0).contains(value);
        if !card.operating_scores.iter().all(share) || !share(&card.largest_overlap) {
            return Err(bad("operating_scores and largest_overlap are between 0 and 1".to_owned()));
        }
        if card.classifier.as_ref().is_some_and(|file| Path::new(file).file_name() != Some(file.as_ref())) {
            return Err(
                bad("classifier is the name of a file beside this card, without a folder".to_owned()),
            );
        }
        if !card.calibration.is_usable() {
            return Err(bad("calibration: slope must be positive, both numbers finite".to_owned()));
        }
        Ok(card)
    }

    /// The card beside a network: `model.onnx` has `model.json`.
    ///
    /// # Errors
    /// It cannot be read or used.
    pub fn beside(network: &Path) -> Result<Self, ModelError> {
        let path = network.with_extension("json");
        let text = std::fs::read_to_string(&path)
            .map_err(|source| ModelError::Unreadable { path: path.clone(), source })?;
        Self::parse(&text, &path)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn sample() -> Card {
        Card {
            schema: SCHEMA.to_owned(),
            name: "sample".to_owned(),
            input_side: 64,
            classes: vec!["bolt".to_owned(), "hand".to_owned()],
            largest_overlap: 0.5,
            operating_scores: vec![0.4, 0.1],
            calibration: Calibration::default(),
            steps: Vec::new(),
            classifier: None,
            about: serde_json::Value::Null,
        }
    }

    #[test]
    fn a_card_survives_writing_and_reading() {
        let text = serde_json::to_string(&sample()).unwrap();
        assert_eq!(Card::parse(&text, Path::new("x")).unwrap(), sample());
    }

    #[test]
    fn contradictions_are_refused_by_name() {
        let cases: [(Card, &str); 8] = [
            (Card { schema: "other".to_owned(), ..sample() }, "schema"),
            (Card { input_side: 100, ..sample() }, "input_side"),
            (Card { operating_scores: vec![0.4], ..sample() }, "operating_scores"),
            (Card { operating_scores: vec![0.4, 1.5], ..sample() }, "operating_scores"),
            (Card { classifier: Some("../other.onnx".to_owned()), ..sample() }, "classifier"),
            (Card { classifier: Some(String::new()), ..sample() }, "classifier"),
            (Card { largest_overlap: -1.0, ..sample() }, "largest_overlap"),
            (Card { calibration: Calibration { slope: 0.0, intercept: 0.0 }, ..sample() }, "calibration"),
        ];
        for (card, field) in cases {
            let error = Card::parse(&serde_json::to_string(&card).unwrap(), Path::new("x.json")).unwrap_err();
            assert!(error.to_string().contains(field), "{error}");
            assert!(error.to_string().contains("x.json"), "{error}");
        }
    }
}
