//! A whole evaluation: every part of a dataset through the detector, and all figures of it.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::coco::{Dataset, DatasetError};
use super::metrics::{Summary, judge};
use super::operating::{
    ClassFigures, PeopleFound, RIGHT_PLACE, Verdict, assign, best_scores, by_class, confusion, people,
};
use super::reliability::Reliability;
use super::{Judged, overlap};
use crate::calibration::Calibration;
use crate::card::Card;
use crate::detector::{Detection, Detector, Picture, Unknown};

/// Scores below this are not drawn into the reliability diagram: there are any number of them, and nobody uses them.
const LEAST_RELIABLE: f64 = 0.05;

/// A picture that gave no answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unanswered {
    /// Which.
    pub picture: PathBuf,
    /// Why.
    pub unknown: Unknown,
}

/// Reads a picture as red, green, blue.
///
/// # Errors
/// [`Unknown::UnusablePicture`].
pub fn read_picture(path: &Path) -> Result<image::RgbImage, Unknown> {
    let unusable = |what: String| Unknown::UnusablePicture { what: format!("{}: {what}", path.display()) };
    let reader = image::ImageReader::open(path).map_err(|error| unusable(error.to_string()))?;
    let reader = reader.with_guessed_format().map_err(|error| unusable(error.to_string()))?;
    reader.decode().map(|picture| picture.to_rgb8()).map_err(|error| unusable(error.to_string()))
}

/// All detections of a dataset's classes in all of its pictures. `tick` is called after each picture.
pub fn detect_all(
    dataset: &Dataset,
    detector: &mut dyn Detector,
    mut tick: impl FnMut(),
) -> (Vec<Judged>, Vec<Unanswered>) {
    let index_of = dataset.index_of(detector.classes());
    let (mut judged, mut unanswered) = (Vec::new(), Vec::new());
    for (picture, (_, path)) in dataset.pictures.iter().enumerate() {
        let outcome = read_picture(path).and_then(|pixels| {
            let found = detector.detect(Picture::try_from(&pixels)?)?;
            let known = found.iter().filter_map(|one| Some((index_of[one.class]?, one)));
            judged.extend(known.map(|(class, one)| as_judged(picture, class, one)));
            Ok(())
        });
        if let Err(unknown) = outcome {
            unanswered.push(Unanswered { picture: path.clone(), unknown });
        }
        tick();
    }
    (judged, unanswered)
}

fn as_judged(picture: usize, class: usize, detection: &Detection) -> Judged {
    let Detection { score, place, .. } = detection;
    let (left, top) = (f64::from(place.left), f64::from(place.top));
    let size = (f64::from(place.right) - left, f64::from(place.bottom) - top);
    Judged { picture, class, score: f64::from(*score), place: [left, top, size.0, size.1] }
}

/// One detection in the form that COCO's tools exchange.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CocoDetection {
    /// Number of the picture in the annotations.
    pub image_id: i64,
    /// Number of the category in the annotations.
    pub category_id: i64,
    /// Left, top, width, height, pixels.
    pub bbox: [f64; 4],
    /// Score, 0 to 1.
    pub score: f64,
}

/// Detections by the dataset's numbers; where several categories mean one class, by the first of them.
#[must_use]
pub fn to_coco(dataset: &Dataset, judged: &[Judged]) -> Vec<CocoDetection> {
    let one = |judged: &Judged| CocoDetection {
        image_id: dataset.pictures[judged.picture].0,
        category_id: dataset.classes[judged.class].1[0],
        bbox: judged.place,
        score: judged.score,
    };
    judged.iter().map(one).collect()
}

/// Detections from a file of COCO's tools; those of other pictures and categories are left out.
///
/// # Errors
/// [`DatasetError`]: the file cannot be read, or is none.
pub fn from_coco(dataset: &Dataset, path: &Path) -> Result<Vec<Judged>, DatasetError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| DatasetError::Unreadable { path: path.to_owned(), source })?;
    let bad = |what: String| DatasetError::BadAnnotations { path: path.to_owned(), what };
    let list: Vec<CocoDetection> = serde_json::from_str(&text).map_err(|error| bad(error.to_string()))?;
    let mut judged = Vec::with_capacity(list.len());
    for one in list {
        let [left, top, width, height] = one.bbox;
        if ![left, top, width, height, one.score].iter().all(|value| value.is_finite()) {
            return Err(bad(format!(
                "a detection in image {} has a number that is not finite",
                one.image_id
            )));
        }
        let picture = dataset.pictures.binary_search_by_key(&one.image_id, |(id, _)| *id);
        let class = dataset.classes.iter().position(|(_, numbers)| numbers.contains(&one.category_id));
        if let (Ok(picture), Some(class)) = (picture, class) {
            judged.push(Judged { picture, class, score: one.score, place: one.bbox });
        }
    }
    Ok(judged)
}

/// Average precision of one class.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClassPrecision {
    /// Canonical name.
    pub class: String,
    /// At an overlap of 0.5; none if it does not occur.
    pub ap50: Option<f64>,
    /// At overlaps of 0.5 to 0.95.
    pub ap: Option<f64>,
}

/// All figures of one part of a dataset.
#[derive(Debug, Clone, Serialize)]
pub struct PartReport {
    /// The folder's name.
    pub part: String,
    /// Pictures.
    pub pictures: usize,
    /// Objects of known classes.
    pub objects: usize,
    /// Names in the folder that the detector does not know, with their objects; these are not judged.
    pub left_out: Vec<(String, usize)>,
    /// The detector's classes that the folder does not know; their detections are not judged.
    pub not_in_folder: Vec<String>,
    /// Pictures without an answer; their objects count as not found.
    pub unanswered: Vec<Unanswered>,
    /// COCO's twelve numbers.
    pub coco: Summary,
    /// Average precision by class.
    pub average_precision: Vec<ClassPrecision>,
    /// At the operating point, by class.
    pub classes: Vec<ClassFigures>,
    /// People found at the operating point.
    pub people: PeopleFound,
    /// Row = what it is, column = what it was called; in the order of `classes`, last "nothing there" and "not found".
    pub confusion: Vec<Vec<usize>>,
    /// With the scores as they are.
    pub reliability_of_scores: Reliability,
    /// With calibrated confidences.
    pub reliability: Reliability,
}

/// A part with everything that was found in it.
pub struct Part {
    /// What is there.
    pub dataset: Dataset,
    /// What was found.
    pub detections: Vec<Judged>,
    /// Which of it is what.
    pub verdicts: Vec<Verdict>,
    /// The operating score of each of the dataset's classes.
    pub scores: Vec<f64>,
}

impl Part {
    /// Puts objects and detections together.
    #[must_use]
    pub fn new(dataset: Dataset, detections: Vec<Judged>, card: &Card) -> Self {
        let verdicts = assign(&dataset.truths, &detections);
        let mut scores = vec![1.0; dataset.classes.len()];
        for (class, index) in dataset.index_of(&card.classes).into_iter().enumerate() {
            if let Some(index) = index {
                scores[index] = f64::from(card.operating_scores[class]);
            }
        }
        Self { dataset, detections, verdicts, scores }
    }

    /// All figures.
    #[must_use]
    pub fn report(&self, card: &Card, unanswered: Vec<Unanswered>) -> PartReport {
        let Self { dataset, detections, verdicts, scores } = self;
        let names: Vec<String> = dataset.classes.iter().map(|(name, _)| name.clone()).collect();
        let truths = &dataset.truths;
        let (coco, each) = judge(dataset.pictures.len(), names.len(), truths, detections);
        let average_precision = names
            .iter()
            .zip(each)
            .map(|(class, value)| {
                let (ap50, ap) = value.unzip();
                ClassPrecision { class: class.clone(), ap50, ap }
            })
            .collect();
        let reliable = reliable(verdicts);
        let missing = card.classes.iter().zip(dataset.index_of(&card.classes));
        PartReport {
            part: dataset.name.clone(),
            pictures: dataset.pictures.len(),
            objects: truths.len(),
            left_out: dataset.left_out.clone(),
            not_in_folder: missing
                .filter(|(_, index)| index.is_none())
                .map(|(name, _)| name.clone())
                .collect(),
            unanswered,
            coco,
            average_precision,
            classes: by_class(&names, scores, truths, verdicts),
            people: people(&names, scores, truths, verdicts),
            confusion: confusion(names.len(), scores, truths, detections),
            reliability_of_scores: Reliability::new(&reliable, Calibration::default()),
            reliability: Reliability::new(&reliable, card.calibration),
        }
    }

    /// The card with operating scores and calibration fitted on this part. Classes that do not occur keep theirs.
    #[must_use]
    pub fn fitted(&self, card: &Card) -> Card {
        let names: Vec<String> = self.dataset.classes.iter().map(|(name, _)| name.clone()).collect();
        let best = best_scores(&names, &self.dataset.truths, &self.verdicts);
        let mut card = card.clone();
        for (class, index) in self.dataset.index_of(&card.classes).into_iter().enumerate() {
            if let Some(score) = index.and_then(|index| best[index]) {
                // Rounded down, so that the detection that the score was read from still counts.
                card.operating_scores[class] = ((score * 1000.0).floor() / 1000.0) as f32;
            }
        }
        if let Some(calibration) = Calibration::fit(&reliable(&self.verdicts)) {
            card.calibration = calibration;
        }
        card
    }

    /// Pictures by how badly the detector did in them, worst first: missed people weigh most, then missed and invented
    /// objects. Pictures without mistakes are left out.
    #[must_use]
    pub fn worst(&self) -> Vec<(usize, f64)> {
        const MISSED_PERSON: f64 = 5.0;
        let mut badness = vec![0.0; self.dataset.pictures.len()];
        let used: Vec<&Verdict> = self.used().collect();
        for (index, truth) in self.dataset.truths.iter().enumerate().filter(|(_, truth)| !truth.crowd) {
            if used.iter().any(|verdict| verdict.truth == Some(index)) {
                continue;
            }
            let human = crate::class::is_human(&self.dataset.classes[truth.class].0);
            badness[truth.picture] += if human { MISSED_PERSON } else { 1.0 };
        }
        for verdict in used.iter().filter(|verdict| verdict.truth.is_none() && !verdict.ignored) {
            badness[verdict.detection.picture] += verdict.detection.score;
        }
        let mut order: Vec<(usize, f64)> =
            badness.into_iter().enumerate().filter(|(_, value)| *value > 0.0).collect();
        order.sort_by(|one, other| other.1.total_cmp(&one.1));
        order
    }

    /// Verdicts on detections at or above the operating scores.
    pub fn used(&self) -> impl Iterator<Item = &Verdict> {
        self.verdicts.iter().filter(|verdict| verdict.detection.score >= self.scores[verdict.detection.class])
    }

    /// Objects of one picture, each with whether it was found.
    #[must_use]
    pub fn objects_of(&self, picture: usize) -> Vec<(usize, [f64; 4], bool)> {
        let truths = self.dataset.truths.iter().filter(|truth| truth.picture == picture && !truth.crowd);
        truths
            .map(|truth| {
                let found = self.used().any(|verdict| {
                    let detection = &verdict.detection;
                    detection.picture == picture
                        && detection.class == truth.class
                        && overlap(&detection.place, &truth.place, false) >= RIGHT_PLACE
                });
                (truth.class, truth.place, found)
            })
            .collect()
    }
}

fn reliable(verdicts: &[Verdict]) -> Vec<(f32, bool)> {
    verdicts
        .iter()
        .filter(|verdict| verdict.detection.score >= LEAST_RELIABLE && !verdict.ignored)
        .map(|verdict| (verdict.detection.score as f32, verdict.truth.is_some()))
        .collect()
}

#[cfg(test)]
mod tests;
