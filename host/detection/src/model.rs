//! Loading networks: the one that comes with this crate, or files.

use std::path::{Path, PathBuf};

use crate::backend::rten::RtenNetwork;
use crate::card::{Card, ModelError};
use crate::classifier::{Classifier, ClassifierCard};
use crate::network::{Decoded, Network, NetworkDetector, Settings};

/// The network that comes with this crate; its story is told in `model/MODEL.md`.
const SHIPPED_NETWORK: &[u8] = include_bytes!("../model/detector.onnx");
/// Its card.
const SHIPPED_CARD: &str = include_str!("../model/detector.json");
/// The network that names what that one found, and its card.
const SHIPPED_CLASSIFIER: &[u8] = include_bytes!("../model/classifier.onnx");
const SHIPPED_CLASSIFIER_CARD: &str = include_str!("../model/classifier.json");
/// How it is named in messages.
const SHIPPED_NAME: &str = "the built-in network";

/// What runs the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Backend {
    /// Pure Rust, on the processor.
    #[default]
    Rten,
    /// Microsoft's ONNX Runtime, on the processor; needs its shared library and a build with the feature `ort`.
    Ort,
    /// Hailo's accelerator; needs HailoRT, a HEF as the model, and a build with the feature `hailo`.
    Hailo,
}

/// Which network, and how to run it.
#[derive(Debug, Clone)]
pub struct Choice {
    /// A network's file, with its card beside it; none: the network that comes with this crate.
    pub model: Option<PathBuf>,
    /// What runs it.
    pub backend: Backend,
    /// How to look.
    pub settings: Settings,
    /// Name what was found once more, if the network's card names a classifier.
    pub second_look: bool,
    /// Threads on the processor.
    pub threads: usize,
}

impl Choice {
    /// Loads the network.
    ///
    /// # Errors
    /// [`ModelError`]: a file that cannot be used, a backend that is not there.
    pub fn load(&self) -> Result<NetworkDetector<Box<dyn Network>>, ModelError> {
        let (card, path) = match &self.model {
            Some(path) => (Card::beside(path)?, path.clone()),
            None => (Card::parse(SHIPPED_CARD, Path::new(SHIPPED_NAME))?, PathBuf::from(SHIPPED_NAME)),
        };
        let network: Box<dyn Network> = match self.backend {
            Backend::Rten => {
                let network =
                    RtenNetwork::new(self.onnx()?, card.input_side, &card.steps, self.threads, &path)?;
                Box::new(Decoded::new(network, &card))
            }
            Backend::Ort => onnxruntime(&self.onnx()?, &card, self.threads, &path)?,
            Backend::Hailo => hailo(self.model.as_deref(), &card)?,
        };
        let classifier = self.classifier(&card, &path)?;
        let detector = NetworkDetector::new(network, card, self.settings)?;
        Ok(match classifier {
            Some(classifier) => detector.with_classifier(classifier),
            None => detector,
        })
    }

    /// The classifier that the card of the network at `path` names. It runs on the processor, whatever runs the network.
    fn classifier(&self, card: &Card, path: &Path) -> Result<Option<Classifier>, ModelError> {
        let Some(file) = card.classifier.as_ref().filter(|_| self.second_look) else { return Ok(None) };
        if self.model.is_none() {
            let path = Path::new(SHIPPED_NAME);
            let own = ClassifierCard::parse(SHIPPED_CLASSIFIER_CARD, &card.classes, path)?;
            return Classifier::load(SHIPPED_CLASSIFIER.to_vec(), own, self.threads, path).map(Some);
        }
        let path = path.with_file_name(file);
        let own = ClassifierCard::beside(&path, &card.classes)?;
        let onnx =
            std::fs::read(&path).map_err(|source| ModelError::Unreadable { path: path.clone(), source })?;
        Classifier::load(onnx, own, self.threads, &path).map(Some)
    }

    fn onnx(&self) -> Result<Vec<u8>, ModelError> {
        let Some(path) = &self.model else { return Ok(SHIPPED_NETWORK.to_vec()) };
        std::fs::read(path).map_err(|source| ModelError::Unreadable { path: path.clone(), source })
    }
}

#[cfg(feature = "ort")]
fn onnxruntime(
    onnx: &[u8],
    card: &Card,
    threads: usize,
    path: &Path,
) -> Result<Box<dyn Network>, ModelError> {
    let network = crate::backend::onnxruntime::OrtNetwork::new(onnx, card.input_side, threads, path)?;
    Ok(Box::new(Decoded::new(network, card)))
}

#[cfg(not(feature = "ort"))]
fn onnxruntime(_: &[u8], _: &Card, _: usize, _: &Path) -> Result<Box<dyn Network>, ModelError> {
    Err(not_built_in("onnxruntime", "ort"))
}

#[cfg(feature = "hailo")]
fn hailo(model: Option<&Path>, card: &Card) -> Result<Box<dyn Network>, ModelError> {
    let Some(path) = model else {
        let what =
            "Hailo's accelerator needs a HEF of its own compiler: give it with --model, its card beside it";
        return Err(ModelError::NoBackend { what: what.to_owned() });
    };
    Ok(Box::new(crate::backend::hailo::HailoNetwork::open(path, card)?))
}

#[cfg(not(feature = "hailo"))]
fn hailo(_: Option<&Path>, _: &Card) -> Result<Box<dyn Network>, ModelError> {
    Err(not_built_in("Hailo", "hailo"))
}

/// What to do about a backend that this program was built without.
#[cfg(not(all(feature = "ort", feature = "hailo")))]
fn not_built_in(name: &str, feature: &str) -> ModelError {
    ModelError::NoBackend {
        what: format!("this program was built without {name}: build it with --features {feature}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::Detector as _;
    use crate::tiles::Tiling;

    fn choice() -> Choice {
        let settings = Settings { tiling: Tiling::Off, least_score: None };
        Choice { model: None, backend: Backend::Rten, settings, second_look: true, threads: 1 }
    }

    #[test]
    fn the_network_that_comes_along_fits_its_card_and_knows_people() {
        let detector = choice().load().unwrap();
        let people = detector.classes().iter().filter(|name| crate::class::is_human(name)).count();
        assert!(people >= 2, "{:?}", detector.classes());
        assert!(SHIPPED_NETWORK.len() < 10_000_000);
    }

    #[test]
    fn files_that_cannot_be_used_are_named() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("mine.onnx");
        let load = || Choice { model: Some(path.clone()), ..choice() }.load().err().unwrap().to_string();
        assert!(load().contains("mine.json"), "no card");
        std::fs::write(path.with_extension("json"), SHIPPED_CARD).unwrap();
        assert!(load().contains("mine.onnx"), "no network");
        std::fs::write(&path, [7; 100]).unwrap();
        assert!(load().contains("mine.onnx"), "no ONNX");
    }
}
