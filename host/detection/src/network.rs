//! Detectors made of a network: the backend multiplies, everything before and after it is here.

use crate::card::{Card, ModelError};
use crate::classifier::Classifier;
use crate::decode::{BEFORE_CLASSES, decode};
use crate::detector::{Detection, Detector, MOST_DETECTIONS, Picture, Unknown, plausible};
use crate::letterbox::{Letterbox, Placement};
use crate::suppress::suppress;
use crate::tiles::{Look, Tiling, plan};

/// A box this close to a side at which its tile was cut off is a piece of something, pixels of the input.
const CUT: f32 = 3.0;
/// Boxes before suppression, at most: an answer with more is noise.
const MOST_CANDIDATES: usize = 60_000;

/// A network that some backend has loaded, as far as boxes.
pub trait Network: Send {
    /// From planes of red, green and blue (0 to 1, the card's side squared) to boxes in pixels of that input with at
    /// least this score. `found` is emptied and filled; boxes need not be suppressed yet.
    ///
    /// # Errors
    /// [`Unknown`].
    fn infer(&mut self, input: &[f32], least_score: f32, found: &mut Vec<Detection>) -> Result<(), Unknown>;
}

impl<N: Network + ?Sized> Network for Box<N> {
    fn infer(&mut self, input: &[f32], least_score: f32, found: &mut Vec<Detection>) -> Result<(), Unknown> {
        (**self).infer(input, least_score, found)
    }
}

/// A network whose answer is still numbers, see [`crate::decode`].
pub trait Rows: Send {
    /// `input` is as of [`Network::infer`], or several such inputs where the network takes them; `rows` is emptied and filled, with
    /// one input's answer after the other's.
    ///
    /// # Errors
    /// [`Unknown`].
    fn infer(&mut self, input: &[f32], rows: &mut Vec<f32>) -> Result<(), Unknown>;
}

/// A network of [`Rows`] with the reading of its numbers.
pub struct Decoded<R> {
    network: R,
    classes: usize,
    /// Numbers of a whole answer.
    expected: usize,
    rows: Vec<f32>,
}

impl<R: Rows> Decoded<R> {
    /// For a card's input and classes.
    #[must_use]
    pub fn new(network: R, card: &Card) -> Self {
        // Three boxes a cell at strides of 8, 16 and 32 pixels.
        let cells: u32 = [8, 16, 32].iter().map(|stride| (card.input_side / stride).pow(2)).sum();
        let expected = 3 * cells as usize * (BEFORE_CLASSES + card.classes.len());
        Self { network, classes: card.classes.len(), expected, rows: Vec::with_capacity(expected) }
    }
}

impl<R: Rows> Network for Decoded<R> {
    fn infer(&mut self, input: &[f32], least_score: f32, found: &mut Vec<Detection>) -> Result<(), Unknown> {
        self.network.infer(input, &mut self.rows)?;
        if self.rows.len() != self.expected {
            let what = format!("{} numbers where {} are expected", self.rows.len(), self.expected);
            return Err(Unknown::Nonsense { what });
        }
        found.clear();
        decode(&self.rows, self.classes, least_score, |detection| {
            if found.len() < MOST_CANDIDATES {
                found.push(detection);
            }
        })
    }
}

/// How to look and what to report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// How finely to look.
    pub tiling: Tiling,
    /// Boxes with a smaller score are not reported; `None`: those below their class's operating point.
    pub least_score: Option<f32>,
}

/// A detector made of a network and its card.
pub struct NetworkDetector<N> {
    network: N,
    /// Names what was found once more, if there is one.
    classifier: Option<Classifier>,
    card: Card,
    settings: Settings,
    /// The smallest of the wanted scores.
    least_score: f32,
    letterbox: Letterbox,
    looks: Vec<Look>,
    of_one_look: Vec<Detection>,
    detections: Vec<Detection>,
}

impl<N: Network> NetworkDetector<N> {
    /// Puts network and card together and has the network answer once: it must speak of the card's classes.
    ///
    /// # Errors
    /// [`ModelError::BadNetwork`].
    pub fn new(network: N, card: Card, settings: Settings) -> Result<Self, ModelError> {
        let smallest = card.operating_scores.iter().copied().fold(1.0, f32::min);
        let mut detector = Self {
            network,
            classifier: None,
            settings,
            least_score: settings.least_score.unwrap_or(smallest),
            letterbox: Letterbox::new(card.input_side),
            looks: Vec::new(),
            of_one_look: Vec::new(),
            detections: Vec::new(),
            card,
        };
        detector.first_answer().map_err(|unknown| ModelError::BadNetwork {
            path: detector.card.name.clone().into(),
            what: format!("the network does not fit its card: {unknown}"),
        })?;
        Ok(detector)
    }

    /// Has what is found named once more by a classifier.
    #[must_use]
    pub fn with_classifier(self, classifier: Classifier) -> Self {
        Self { classifier: Some(classifier), ..self }
    }

    /// The network's card.
    #[must_use]
    pub fn card(&self) -> &Card {
        &self.card
    }

    fn first_answer(&mut self) -> Result<(), Unknown> {
        let side = self.card.input_side;
        let grey = vec![crate::letterbox::FILLING; (side * side * 3) as usize];
        self.detect(Picture::new(side, side, &grey)?).map(|_| ())
    }

    /// One window of the picture: into the network, out as boxes of the picture.
    fn look(&mut self, picture: Picture<'_>, look: Look) -> Result<(), Unknown> {
        let (input, placement) = self.letterbox.fit(picture, look.window)?;
        let found = &mut self.of_one_look;
        self.network.infer(input, self.least_score, found)?;
        let (width, height) = (picture.width() as f32, picture.height() as f32);
        // Cut boxes go before suppression: a piece must not outdo the whole.
        found.retain_mut(|detection| {
            let is_whole = look.whole || !is_cut(detection, placement, picture);
            detection.place = placement.to_picture(&detection.place).clipped(width, height);
            is_whole && detection.place.area() > 0.0
        });
        suppress(found, self.card.largest_overlap, false, MOST_DETECTIONS);
        self.detections.extend_from_slice(found);
        Ok(())
    }

    /// Names and confidence for all, and away with what nobody asked for.
    fn finish(&mut self, picture: Picture<'_>) -> Result<(), Unknown> {
        let merged = self.looks.len() > 1;
        let (card, wanted) = (&self.card, self.settings.least_score);
        suppress(&mut self.detections, card.largest_overlap, merged, MOST_DETECTIONS);
        if let Some(classifier) = &mut self.classifier {
            classifier.name(picture, &mut self.detections, self.least_score)?;
            // What has a new name may lie beside another of that name.
            suppress(&mut self.detections, card.largest_overlap, false, MOST_DETECTIONS);
        }
        self.detections.retain_mut(|detection| {
            detection.confidence = card.calibration.confidence(detection.score);
            detection.score >= wanted.unwrap_or(card.operating_scores[detection.class])
        });
        Ok(())
    }
}

/// Does the box end where its tile was cut out of the picture? The tile beside it or a coarser look has it whole.
fn is_cut(detection: &Detection, placement: Placement, picture: Picture<'_>) -> bool {
    let window = placement.window;
    let (left, top) = (placement.margin.0 as f32, placement.margin.1 as f32);
    let (right, bottom) = (left + placement.fitted.0 as f32, top + placement.fitted.1 as f32);
    let place = &detection.place;
    (window.left > 0 && place.left < left + CUT)
        || (window.top > 0 && place.top < top + CUT)
        || (window.left + window.width < picture.width() && place.right > right - CUT)
        || (window.top + window.height < picture.height() && place.bottom > bottom - CUT)
}

impl<N: Network> Detector for NetworkDetector<N> {
    fn classes(&self) -> &[String] {
        &self.card.classes
    }

    fn detect(&mut self, picture: Picture<'_>) -> Result<&[Detection], Unknown> {
        self.detections.clear();
        plan(picture.width(), picture.height(), self.card.input_side, self.settings.tiling, &mut self.looks);
        for index in 0..self.looks.len() {
            self.look(picture, self.looks[index])?;
        }
        self.finish(picture)?;
        plausible(&self.detections, self.card.classes.len())?;
        Ok(&self.detections)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::tests::sample;

    /// Finds the bright rectangle in its input, if there is one.
    struct BrightThing {
        classes: usize,
    }

    impl Rows for BrightThing {
        fn infer(&mut self, input: &[f32], rows: &mut Vec<f32>) -> Result<(), Unknown> {
            const SIDE: usize = 64;
            rows.clear();
            rows.resize(3 * (64 + 16 + 4) * (BEFORE_CLASSES + self.classes), 0.0);
            let bright = (0..SIDE * SIDE).filter(|place| input[*place] > 0.9);
            let (mut low, mut high) = ((f32::MAX, f32::MAX), (0.0f32, 0.0f32));
            for place in bright {
                let (x, y) = ((place % SIDE) as f32, (place / SIDE) as f32);
                low = (low.0.min(x), low.1.min(y));
                high = (high.0.max(x + 1.0), high.1.max(y + 1.0));
            }
            if high.0 > 0.0 {
                let (width, height) = (high.0 - low.0, high.1 - low.1);
                rows[..4].copy_from_slice(&[low.0 + width / 2.0, low.1 + height / 2.0, width, height]);
                rows[4] = 0.9;
                rows[6] = 0.9;
            }
            Ok(())
        }
    }

    fn bright(classes: usize) -> Decoded<BrightThing> {
        Decoded::new(BrightThing { classes }, &sample())
    }

    fn detector(tiling: Tiling, least_score: Option<f32>) -> NetworkDetector<Decoded<BrightThing>> {
        NetworkDetector::new(bright(2), sample(), Settings { tiling, least_score }).unwrap()
    }

    fn picture_with(place: BoundingBoxOfPixels) -> image::RgbImage {
        let (left, top, right, bottom) = place;
        image::RgbImage::from_fn(256, 192, |x, y| {
            let inside = (left..right).contains(&x) && (top..bottom).contains(&y);
            image::Rgb([if inside { 255 } else { 50 }; 3])
        })
    }

    type BoundingBoxOfPixels = (u32, u32, u32, u32);

    #[test]
    fn small_things_are_found_once_and_where_they_are() {
        for place in [(100, 80, 112, 92), (0, 0, 20, 10), (236, 180, 256, 192), (60, 60, 70, 76)] {
            let picture = picture_with(place);
            let mut detector = detector(Tiling::Windows(100), Some(0.01));
            let found = detector.detect((&picture).try_into().unwrap()).unwrap();
            assert_eq!(found.len(), 1, "{place:?}: {found:?}");
            let wanted = [place.0, place.1, place.2, place.3].map(|value| value as f32);
            let got = [found[0].place.left, found[0].place.top, found[0].place.right, found[0].place.bottom];
            for (got, wanted) in got.iter().zip(wanted) {
                assert!((got - wanted).abs() <= 4.0, "{place:?}: {got:?}");
            }
        }
    }

    #[test]
    fn a_large_thing_is_not_reported_in_pieces() {
        let picture = picture_with((20, 20, 230, 170));
        let mut detector = detector(Tiling::Windows(100), Some(0.01));
        let found = detector.detect((&picture).try_into().unwrap()).unwrap();
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].place.width() > 200.0);
    }

    #[test]
    fn below_the_operating_point_of_its_class_nothing_is_reported() {
        // Score 0.81 for class 1, whose operating point the sample card puts at 0.1.
        let picture = picture_with((100, 80, 112, 92));
        let count = |operating: f32| {
            let card = Card { operating_scores: vec![0.0, operating], ..sample() };
            let settings = Settings { tiling: Tiling::Off, least_score: None };
            let mut detector = NetworkDetector::new(bright(2), card, settings).unwrap();
            let found = detector.detect((&picture).try_into().unwrap()).unwrap();
            found.iter().filter(|detection| detection.class == 1).count()
        };
        assert_eq!(count(0.80), 1);
        assert_eq!(count(0.82), 0);
    }

    #[test]
    fn a_network_that_does_not_fit_its_card_is_refused() {
        let settings = Settings { tiling: Tiling::Off, least_score: None };
        let error = NetworkDetector::new(bright(3), sample(), settings).err().unwrap();
        assert!(error.to_string().contains("does not fit its card"), "{error}");
    }

    /// Says whatever it is told to.
    struct Parrot(Result<Vec<f32>, Unknown>);

    impl Rows for Parrot {
        fn infer(&mut self, _: &[f32], rows: &mut Vec<f32>) -> Result<(), Unknown> {
            rows.clear();
            rows.extend_from_slice(self.0.as_ref().map_err(Clone::clone)?);
            Ok(())
        }
    }

    #[test]
    fn failures_and_nonsense_are_unknown_and_never_an_empty_floor() {
        let good = vec![0.0; 3 * 84 * 7];
        let mut with_nan = good.clone();
        with_nan[6 * 84] = f32::NAN;
        let answers = [
            Err(Unknown::Failed { what: "device lost".to_owned() }),
            Ok(with_nan),
            Ok(Vec::new()),
            Ok(vec![0.0; 10]),
            Ok(vec![9.0; 3 * 84 * 7]),
        ];
        let rgb = vec![0; 64 * 64 * 3];
        let picture = Picture::new(64, 64, &rgb).unwrap();
        let settings = Settings { tiling: Tiling::Off, least_score: None };
        let mut detector =
            NetworkDetector::new(Decoded::new(Parrot(Ok(good.clone())), &sample()), sample(), settings)
                .unwrap();
        for answer in answers {
            detector.network.network = Parrot(answer.clone());
            assert!(detector.detect(picture).is_err(), "{answer:?}");
            detector.network.network = Parrot(Ok(good.clone()));
            assert_eq!(detector.detect(picture), Ok(&[][..]), "it recovers");
        }
    }
}
