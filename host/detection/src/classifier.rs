//! A second look: what is it that the detector found there?
//!
//! Half of a detector's errors are names. Small things at the right place are called something else, for the detector sees them
//! shrunk into its input. A second network sees nothing but the place, in the picture's own resolution, and both opinions are
//! mixed. It finds nothing that was not found before, and it makes no person less sure than the detector was: whether it works,
//! is wrong or is fooled, it cannot hide anybody.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::backend::rten::RtenNetwork;
use crate::boxes::BoundingBox;
use crate::card::{ModelError, Step};
use crate::class::is_human;
use crate::detector::{Detection, Picture, Unknown};
use crate::letterbox::{Letterbox, Window};
use crate::network::Rows;

/// Format of the cards that this version reads.
pub const SCHEMA: &str = "nearfield-classifier-1";
/// Boxes that overlap more than this show the same thing, whatever their classes; as in training.
const SAME_PLACE: f32 = 0.7;
/// Largest input that is believed, pixels, and widest region, in sides of the box.
const LARGEST_INPUT: u32 = 512;
const LARGEST_CONTEXT: f32 = 4.0;
/// Rounding may push a share out of its range by so much.
const ROUNDING: f32 = 1e-3;

/// What a program must know about a classifier. JSON beside the network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClassifierCard {
    /// [`SCHEMA`].
    pub schema: String,
    /// The network's name.
    pub name: String,
    /// The input is a square with this side, pixels.
    pub input_side: u32,
    /// Side of the region around a box, in the box's longer sides.
    pub context: f32,
    /// Names of the classes in the order of the network's outputs, as the detector's; behind them comes the background.
    pub classes: Vec<String>,
    /// The classifier's part in the mixed score, 0 to 1.
    pub weight: f32,
    /// So many places are looked at in a picture, the surest first: what it may cost.
    pub most_places: usize,
    /// As [`crate::card::Card::steps`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<Step>,
    /// Data, seed, metrics: for the reader.
    #[serde(default)]
    pub about: serde_json::Value,
}

impl ClassifierCard {
    /// Reads and checks a card for a detector of these classes; `path` is only for the message.
    ///
    /// # Errors
    /// [`ModelError::BadCard`].
    pub fn parse(text: &str, classes: &[String], path: &Path) -> Result<Self, ModelError> {
        let bad = |what: String| ModelError::BadCard { path: path.to_owned(), what };
        let card: Self = serde_json::from_str(text).map_err(|error| bad(error.to_string()))?;
        if card.schema != SCHEMA {
            return Err(bad(format!("schema \"{}\", this version reads \"{SCHEMA}\"", card.schema)));
        }
        if card.input_side == 0 || card.input_side > LARGEST_INPUT || !card.input_side.is_multiple_of(32) {
            let side = card.input_side;
            return Err(bad(format!("input_side {side} is not a multiple of 32 up to {LARGEST_INPUT}")));
        }
        if !(1.0..=LARGEST_CONTEXT).contains(&card.context) {
            return Err(bad(format!("context {} is not between 1 and {LARGEST_CONTEXT}", card.context)));
        }
        if !(0.0..=1.0).contains(&card.weight) {
            return Err(bad(format!("weight {} is not between 0 and 1", card.weight)));
        }
        if card.classes != classes {
            return Err(bad("classes are not the detector's, in its order".to_owned()));
        }
        Ok(card)
    }

    /// The card beside a network: `classifier.onnx` has `classifier.json`.
    ///
    /// # Errors
    /// It cannot be read or used.
    pub fn beside(network: &Path, classes: &[String]) -> Result<Self, ModelError> {
        let path = network.with_extension("json");
        let text = std::fs::read_to_string(&path)
            .map_err(|source| ModelError::Unreadable { path: path.clone(), source })?;
        Self::parse(&text, classes, &path)
    }
}

/// A network that names places, and what it says about one of them.
pub struct Classifier {
    network: Box<dyn Rows>,
    card: ClassifierCard,
    is_human: Vec<bool>,
    letterbox: Letterbox,
    /// Regions, one after the other.
    inputs: Vec<f32>,
    /// What they show, one after the other.
    shares: Vec<f32>,
    /// For each detection its place, by number.
    place_of: Vec<Option<usize>>,
    /// The surest detection of each place, and where it is.
    leaders: Vec<usize>,
    places: Vec<BoundingBox>,
}

impl Classifier {
    /// Loads an ONNX file's bytes with its card and has it answer once; `path` is for the message only.
    ///
    /// # Errors
    /// [`ModelError::BadNetwork`].
    pub fn load(
        onnx: Vec<u8>,
        card: ClassifierCard,
        threads: usize,
        path: &Path,
    ) -> Result<Self, ModelError> {
        let network = RtenNetwork::new(onnx, card.input_side, &card.steps, threads, path)?;
        Self::new(Box::new(network), card, path)
    }

    /// Puts network and card together.
    fn new(network: Box<dyn Rows>, card: ClassifierCard, path: &Path) -> Result<Self, ModelError> {
        let mut classifier = Self {
            network,
            is_human: card.classes.iter().map(|name| is_human(name)).collect(),
            letterbox: Letterbox::new(card.input_side),
            inputs: Vec::new(),
            shares: Vec::new(),
            place_of: Vec::new(),
            leaders: Vec::new(),
            places: Vec::new(),
            card,
        };
        let grey = [crate::letterbox::FILLING; 12];
        let first = Picture::new(2, 2, &grey).and_then(|picture| {
            classifier.look(picture, &[BoundingBox::around(1.0, 1.0, 2.0, 2.0); 2]).map(|_| ())
        });
        match first {
            Ok(()) => Ok(classifier),
            Err(unknown) => Err(ModelError::BadNetwork {
                path: path.to_owned(),
                what: format!("the network does not fit its card: {unknown}"),
            }),
        }
    }

    /// Mixes its opinion into detections, which come best first and leave in no order. Other names with at least
    /// `least_score` are added.
    ///
    /// # Errors
    /// [`Unknown`].
    pub fn name(
        &mut self,
        picture: Picture<'_>,
        detections: &mut Vec<Detection>,
        least_score: f32,
    ) -> Result<(), Unknown> {
        self.find_places(detections);
        let found = detections.len();
        let mut places = std::mem::take(&mut self.places);
        places.clear();
        places.extend(self.leaders.iter().map(|index| detections[*index].place));
        let outcome = self.look(picture, &places).map(|_| ());
        self.places = places;
        outcome?;
        for place in 0..self.leaders.len() {
            let leader = detections[self.leaders[place]];
            // How sure the detector is that anything is there.
            let mut something: f32 = 0.0;
            for index in self.members(place, found) {
                something += detections[index].score;
            }
            let part = self.card.weight * something.min(1.0);
            let shares = &self.shares[place * (self.card.classes.len() + 1)..][..self.card.classes.len()];
            for (class, share) in shares.iter().enumerate() {
                let mut is_new = true;
                for index in self.members(place, found) {
                    let detection = &mut detections[index];
                    if detection.class == class {
                        is_new = false;
                        let mixed = (1.0 - self.card.weight) * detection.score + part * share;
                        let least = if self.is_human[class] { detection.score } else { 0.0 };
                        detection.score = mixed.clamp(least, 1.0);
                    }
                }
                if is_new && part * share >= least_score {
                    detections.push(Detection { class, score: (part * share).min(1.0), ..leader });
                }
            }
        }
        Ok(())
    }

    /// The detections of a place.
    fn members(&self, place: usize, found: usize) -> impl Iterator<Item = usize> + '_ {
        (0..found).filter(move |index| self.place_of[*index] == Some(place))
    }

    /// Groups detections that show the same thing.
    fn find_places(&mut self, detections: &[Detection]) {
        self.leaders.clear();
        self.place_of.clear();
        self.place_of.resize(detections.len(), None);
        for (index, leader) in detections.iter().enumerate() {
            if self.leaders.len() == self.card.most_places {
                return;
            }
            if self.place_of[index].is_some() {
                continue;
            }
            let place = Some(self.leaders.len());
            self.leaders.push(index);
            self.place_of[index] = place;
            for (of, other) in self.place_of[index..].iter_mut().zip(&detections[index..]) {
                if of.is_none() && other.place.overlap(&leader.place) > SAME_PLACE {
                    *of = place;
                }
            }
        }
    }

    /// What the regions around places show: for each a share for every class, then the background's; 1 in sum.
    ///
    /// # Errors
    /// [`Unknown`].
    pub fn look(&mut self, picture: Picture<'_>, places: &[BoundingBox]) -> Result<&[f32], Unknown> {
        self.inputs.clear();
        self.shares.clear();
        if places.is_empty() {
            return Ok(&self.shares);
        }
        for place in places {
            let window = region(place, self.card.context, picture.width(), picture.height());
            let (input, _) = self.letterbox.fit(picture, window)?;
            self.inputs.extend_from_slice(input);
        }
        self.network.infer(&self.inputs, &mut self.shares)?;
        let of_one = self.card.classes.len() + 1;
        let nonsense = |what: String| Err(Unknown::Nonsense { what });
        if self.shares.len() != of_one * places.len() {
            let (found, places) = (self.shares.len(), places.len());
            return nonsense(format!(
                "{found} shares where {of_one} for each of {places} places are expected"
            ));
        }
        let usable = |share: &f32| (-ROUNDING..=1.0 + ROUNDING).contains(share);
        for shares in self.shares.chunks_exact(of_one) {
            let sum: f32 = shares.iter().sum();
            if !shares.iter().all(usable) || (sum - 1.0).abs() > ROUNDING * of_one as f32 {
                return nonsense(format!("shares of classes that make {sum} in sum"));
            }
        }
        Ok(&self.shares)
    }
}

/// Whole pixels around a box, as far as the picture goes; never empty.
fn region(place: &BoundingBox, context: f32, width: u32, height: u32) -> Window {
    let half = place.width().max(place.height()) * context / 2.0;
    let (across, down) = ((place.left + place.right) / 2.0, (place.top + place.bottom) / 2.0);
    let span = |centre: f32, length: u32| {
        let first = ((centre - half).floor().max(0.0) as u32).min(length - 1);
        let end = ((centre + half).ceil().max(0.0) as u32).min(length).max(first + 1);
        (first, end - first)
    };
    let ((left, width), (top, height)) = (span(across, width), span(down, height));
    Window { left, top, width, height }
}

#[cfg(test)]
mod tests;
