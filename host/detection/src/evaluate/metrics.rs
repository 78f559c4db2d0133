//! COCO's twelve numbers, defined as in pycocotools (`COCOeval.summarize`, boxes); -1 where there is nothing to judge.

use serde::Serialize;

use super::matching::{Fate, MOST_DETECTIONS, Matched, Pair};
use super::{Judged, Truth};

/// Areas in square pixels: all, small, medium, large.
const AREAS: [(f64, f64); 4] = [(0.0, 1e10), (0.0, 1024.0), (1024.0, 9216.0), (9216.0, 1e10)];
/// Recalls at which precision is read.
const RECALLS: usize = 101;
/// numpy.spacing(1): keeps 0 / 0 out of the precision.
const SPACING: f64 = f64::EPSILON;

/// COCO's twelve numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Mean average precision at overlaps of 0.5 to 0.95.
    pub ap: f64,
    /// At an overlap of 0.5.
    pub ap50: f64,
    /// At an overlap of 0.75.
    pub ap75: f64,
    /// Of objects below 32 x 32 pixels.
    pub ap_small: f64,
    /// Of objects up to 96 x 96 pixels.
    pub ap_medium: f64,
    /// Of larger objects.
    pub ap_large: f64,
    /// Mean recall with one detection a class and picture.
    pub ar1: f64,
    /// With ten.
    pub ar10: f64,
    /// With a hundred.
    pub ar100: f64,
    /// Of objects below 32 x 32 pixels.
    pub ar_small: f64,
    /// Of objects up to 96 x 96 pixels.
    pub ar_medium: f64,
    /// Of larger objects.
    pub ar_large: f64,
}

impl Summary {
    /// In pycocotools' order.
    #[must_use]
    pub fn as_array(&self) -> [f64; 12] {
        let Self { ap, ap50, ap75, ap_small, ap_medium, ap_large, .. } = *self;
        let Self { ar1, ar10, ar100, ar_small, ar_medium, ar_large, .. } = *self;
        [ap, ap50, ap75, ap_small, ap_medium, ap_large, ar1, ar10, ar100, ar_small, ar_medium, ar_large]
    }
}

/// Average precision and last recall of one class at each overlap.
#[derive(Debug, Clone, Copy)]
struct Curve {
    /// Mean precision over [`RECALLS`].
    precision: [f64; 10],
    recall: [f64; 10],
}

/// All numbers: the summary, and average precision at 0.5 and 0.5:0.95 for each class (`None`: it does not occur).
#[must_use]
pub fn judge(
    pictures: usize,
    classes: usize,
    truths: &[Truth],
    detections: &[Judged],
) -> (Summary, Vec<Option<(f64, f64)>>) {
    // Curves by class for the six combinations that the summary reads.
    let mut by_class = Vec::with_capacity(classes);
    for class in 0..classes {
        let pairs = pairs_of(class, pictures, truths, detections);
        let matched = AREAS.map(|area| pairs.iter().map(|pair| pair.matched(area)).collect::<Vec<Matched>>());
        let full = [0, 1, 2, 3].map(|area| curve(&matched[area], MOST_DETECTIONS));
        by_class.push((full, curve(&matched[0], 1), curve(&matched[0], 10)));
    }
    let precision = |area: usize, level: Option<usize>| {
        let curves = by_class.iter().filter_map(|(full, ..)| full[area].as_ref());
        mean(curves.flat_map(|curve| pick(&curve.precision, level)))
    };
    let recall = |area: usize| {
        mean(by_class.iter().filter_map(|(full, ..)| full[area]).flat_map(|curve| curve.recall))
    };
    let summary = Summary {
        ap: precision(0, None),
        ap50: precision(0, Some(0)),
        ap75: precision(0, Some(5)),
        ap_small: precision(1, None),
        ap_medium: precision(2, None),
        ap_large: precision(3, None),
        ar1: mean(by_class.iter().filter_map(|(_, one, _)| *one).flat_map(|curve| curve.recall)),
        ar10: mean(by_class.iter().filter_map(|(.., ten)| *ten).flat_map(|curve| curve.recall)),
        ar100: recall(0),
        ar_small: recall(1),
        ar_medium: recall(2),
        ar_large: recall(3),
    };
    let each =
        by_class.iter().map(|(full, ..)| full[0].map(|curve| (curve.precision[0], mean(curve.precision))));
    (summary, each.collect())
}

fn pick(values: &[f64; 10], level: Option<usize>) -> Vec<f64> {
    level.map_or_else(|| values.to_vec(), |level| vec![values[level]])
}

/// -1 for none, as pycocotools.
fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0usize), |(sum, count), value| (sum + value, count + 1));
    if count == 0 { -1.0 } else { sum / count as f64 }
}

fn pairs_of<'a>(
    class: usize,
    pictures: usize,
    truths: &'a [Truth],
    detections: &'a [Judged],
) -> Vec<Pair<'a>> {
    let mut by_picture: Vec<(Vec<&Truth>, Vec<&Judged>)> = vec![(Vec::new(), Vec::new()); pictures];
    for truth in truths.iter().filter(|truth| truth.class == class) {
        by_picture[truth.picture].0.push(truth);
    }
    for detection in detections.iter().filter(|detection| detection.class == class) {
        by_picture[detection.picture].1.push(detection);
    }
    by_picture.retain(|(truths, detections)| !truths.is_empty() || !detections.is_empty());
    by_picture.into_iter().map(|(truths, detections)| Pair::new(truths, detections)).collect()
}

/// Precision over recall with at most `most` detections a picture; `None` if no object counts.
fn curve(matched: &[Matched], most: usize) -> Option<Curve> {
    let objects: usize = matched.iter().map(|matched| matched.objects).sum();
    if objects == 0 {
        return None;
    }
    let mut fates: Vec<&Fate> = matched.iter().flat_map(|matched| matched.fates.iter().take(most)).collect();
    fates.sort_by(|one, other| other.score.total_cmp(&one.score));
    let mut result = Curve { precision: [0.0; 10], recall: [0.0; 10] };
    for level in 0..10 {
        let (mut right, mut wrong) = (0.0, 0.0);
        let (mut recalls, mut precisions) =
            (Vec::with_capacity(fates.len()), Vec::with_capacity(fates.len()));
        for fate in &fates {
            if !fate.ignored[level] {
                if fate.matched[level] { right += 1.0 } else { wrong += 1.0 }
            }
            recalls.push(right / objects as f64);
            precisions.push(right / (wrong + right + SPACING));
        }
        result.recall[level] = recalls.last().copied().unwrap_or(0.0);
        result.precision[level] = area_under(&recalls, &mut precisions);
    }
    Some(result)
}

/// Mean of the best precision still to come, read at recalls of 0, 0.01, ... 1.
fn area_under(recalls: &[f64], precisions: &mut [f64]) -> f64 {
    for index in (1..precisions.len()).rev() {
        precisions[index - 1] = precisions[index - 1].max(precisions[index]);
    }
    let at = |step: usize| {
        let wanted = if step + 1 == RECALLS { 1.0 } else { step as f64 * 0.01 };
        let index = recalls.partition_point(|recall| *recall < wanted);
        precisions.get(index).copied().unwrap_or(0.0)
    };
    (0..RECALLS).map(at).sum::<f64>() / RECALLS as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth(picture: usize, class: usize, place: [f64; 4]) -> Truth {
        Truth { picture, class, place, area: place[2] * place[3], crowd: false }
    }

    const PLACE: [f64; 4] = [10.0, 10.0, 20.0, 20.0];

    #[test]
    fn perfect_detections_are_perfect_and_none_are_nothing() {
        let truths = [truth(0, 0, PLACE), truth(1, 1, PLACE)];
        let right: Vec<Judged> = truths
            .iter()
            .map(|truth| Judged {
                picture: truth.picture,
                class: truth.class,
                score: 0.9,
                place: truth.place,
            })
            .collect();
        let (summary, classes) = judge(2, 3, &truths, &right);
        assert!((summary.ap - 1.0).abs() < 1e-12 && (summary.ar1 - 1.0).abs() < 1e-12, "{summary:?}");
        assert_eq!((summary.ap_medium, summary.ap_large), (-1.0, -1.0), "no such objects");
        assert!(classes[0].is_some() && classes[2].is_none());
        let (summary, _) = judge(2, 3, &truths, &[]);
        assert_eq!((summary.ap, summary.ar100), (0.0, 0.0));
    }

    #[test]
    fn a_wrong_one_before_the_right_one_halves_precision() {
        let truths = [truth(0, 0, PLACE)];
        let detections = [
            Judged { picture: 0, class: 0, score: 0.9, place: [100.0, 100.0, 20.0, 20.0] },
            Judged { picture: 0, class: 0, score: 0.8, place: PLACE },
        ];
        let (summary, _) = judge(1, 1, &truths, &detections);
        assert!((summary.ap50 - 0.5).abs() < 1e-12);
        assert!(
            (summary.ar1 - 0.0).abs() < 1e-12 && (summary.ar10 - 1.0).abs() < 1e-12,
            "one detection is not enough"
        );
    }

    #[test]
    fn half_of_the_objects_give_half_of_the_recalls() {
        let truths = [truth(0, 0, PLACE), truth(1, 0, PLACE)];
        let detections = [Judged { picture: 0, class: 0, score: 0.9, place: PLACE }];
        let (summary, _) = judge(2, 1, &truths, &detections);
        // Recalls 0 to 0.5 are 51 of the 101.
        assert!((summary.ap50 - 51.0 / 101.0).abs() < 1e-12);
    }
}
