//! What the detector does at the scores that are used: precision, recall, F1, confusion, people found.

use serde::Serialize;

use super::interval::Share;
use super::{Judged, Truth, overlap};
use crate::class::is_human;

/// From this overlap (intersection over union) a detection is at the right place.
pub const RIGHT_PLACE: f64 = 0.5;
/// For people recall weighs this many times as much as precision when the operating point is chosen.
const HUMAN_RECALL_WEIGHT: f64 = 4.0;

/// A detection and what became of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// The detection.
    pub detection: Judged,
    /// The object that it is; the index into the truths.
    pub truth: Option<usize>,
    /// It lies in a crowd and is not judged.
    pub ignored: bool,
}

/// Gives every object of a class to the best-scored detection of that class at its place.
#[must_use]
pub fn assign(truths: &[Truth], detections: &[Judged]) -> Vec<Verdict> {
    let mut order: Vec<&Judged> = detections.iter().collect();
    order.sort_by(|one, other| other.score.total_cmp(&one.score));
    let by_picture = truths_by_picture(truths);
    let mut taken = vec![false; truths.len()];
    let mut verdicts = Vec::with_capacity(order.len());
    for detection in order {
        let candidates = by_picture.get(detection.picture).map_or(&[][..], Vec::as_slice);
        let same = candidates.iter().filter(|index| truths[**index].class == detection.class);
        let at_place = same
            .map(|index| (*index, overlap(&detection.place, &truths[*index].place, truths[*index].crowd)))
            .filter(|(_, value)| *value >= RIGHT_PLACE);
        let free = at_place.clone().filter(|(index, _)| !taken[*index] && !truths[*index].crowd);
        let truth = free.max_by(|one, other| one.1.total_cmp(&other.1)).map(|(index, _)| index);
        if let Some(index) = truth {
            taken[index] = true;
        }
        let ignored = truth.is_none() && at_place.clone().any(|(index, _)| truths[index].crowd);
        verdicts.push(Verdict { detection: *detection, truth, ignored });
    }
    verdicts
}

fn truths_by_picture(truths: &[Truth]) -> Vec<Vec<usize>> {
    let pictures = truths.iter().map(|truth| truth.picture + 1).max().unwrap_or(0);
    let mut lists = vec![Vec::new(); pictures];
    for (index, truth) in truths.iter().enumerate() {
        lists[truth.picture].push(index);
    }
    lists
}

/// One class at its operating point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClassFigures {
    /// Canonical name.
    pub class: String,
    /// Is it a person or a part of one?
    pub human: bool,
    /// From this score a detection counts.
    pub operating_score: f64,
    /// Objects of this class.
    pub objects: usize,
    /// Right detections of all.
    pub precision: Share,
    /// Objects found of all.
    pub recall: Share,
    /// Harmonic mean of both; none where one is missing.
    pub f1: Option<f64>,
}

/// Figures for every class; `verdicts` may hold detections below the operating scores, they are left out here.
#[must_use]
pub fn by_class(
    names: &[String],
    scores: &[f64],
    truths: &[Truth],
    verdicts: &[Verdict],
) -> Vec<ClassFigures> {
    let figures = |(class, name): (usize, &String)| {
        let used = verdicts.iter().filter(|verdict| {
            verdict.detection.class == class && verdict.detection.score >= scores[class] && !verdict.ignored
        });
        let right = used.clone().filter(|verdict| verdict.truth.is_some()).count();
        let objects = truths.iter().filter(|truth| truth.class == class && !truth.crowd).count();
        let (precision, recall) = (Share::new(right, used.count()), Share::new(right, objects));
        let f1 =
            precision.share.zip(recall.share).map(|(precision, recall)| harmonic(precision, recall, 1.0));
        ClassFigures {
            class: name.clone(),
            human: is_human(name),
            operating_score: scores[class],
            objects,
            precision,
            recall,
            f1,
        }
    };
    names.iter().enumerate().map(figures).collect()
}

/// Precision and recall in one number, recall weighing `weight` times as much (van Rijsbergen's F).
fn harmonic(precision: f64, recall: f64, weight: f64) -> f64 {
    let square = weight * weight;
    let denominator = square * precision + recall;
    if denominator > 0.0 { (1.0 + square) * precision * recall / denominator } else { 0.0 }
}

/// The score for each class that makes most of it: F1, for people with recall weighing four times. `None` where there is
/// nothing to choose by.
#[must_use]
pub fn best_scores(names: &[String], truths: &[Truth], verdicts: &[Verdict]) -> Vec<Option<f64>> {
    let best = |(class, name): (usize, &String)| {
        let objects = truths.iter().filter(|truth| truth.class == class && !truth.crowd).count();
        let weight = if is_human(name) { HUMAN_RECALL_WEIGHT } else { 1.0 };
        let (mut right, mut all) = (0usize, 0usize);
        let mut best: Option<(f64, f64)> = None;
        // Verdicts come best score first: each step lowers the operating score to that of the next detection.
        for verdict in verdicts.iter().filter(|verdict| verdict.detection.class == class && !verdict.ignored)
        {
            all += 1;
            right += usize::from(verdict.truth.is_some());
            let value = harmonic(right as f64 / all as f64, right as f64 / objects.max(1) as f64, weight);
            if best.is_none_or(|(most, _)| value > most) {
                best = Some((value, verdict.detection.score));
            }
        }
        best.filter(|(value, _)| objects > 0 && *value > 0.0).map(|(_, score)| score)
    };
    names.iter().enumerate().map(best).collect()
}

/// How many people were found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PeopleFound {
    /// By a detection of the very class ("foot" as "foot").
    pub as_that_class: Share,
    /// By a detection of any human class ("foot" as "leg" stops the robot as well).
    pub as_a_person: Share,
    /// Of all detections of human classes, those with a person of any human class at their place: a foot that is found as "foot" and
    /// as "leg" is two right ones here, where the classes' precision has one of them wrong.
    pub alarms_right: Share,
}

/// People found among the objects of human classes, at the operating scores.
#[must_use]
pub fn people(names: &[String], scores: &[f64], truths: &[Truth], verdicts: &[Verdict]) -> PeopleFound {
    let human: Vec<bool> = names.iter().map(|name| is_human(name)).collect();
    let is_used = |verdict: &&Verdict| verdict.detection.score >= scores[verdict.detection.class];
    let mut exactly = vec![false; truths.len()];
    for verdict in verdicts.iter().filter(is_used) {
        if let Some(index) = verdict.truth {
            exactly[index] = true;
        }
    }
    let (mut all, mut that_class, mut person) = (0, 0, 0);
    for (index, truth) in truths.iter().enumerate().filter(|(_, truth)| human[truth.class] && !truth.crowd) {
        all += 1;
        that_class += usize::from(exactly[index]);
        let found = verdicts.iter().filter(is_used).any(|verdict| {
            let detection = &verdict.detection;
            detection.picture == truth.picture
                && human[detection.class]
                && overlap(&detection.place, &truth.place, false) >= RIGHT_PLACE
        });
        person += usize::from(found || exactly[index]);
    }
    let by_picture = truths_by_picture(truths);
    let (mut alarms, mut right) = (0, 0);
    for Verdict { detection, .. } in
        verdicts.iter().filter(is_used).filter(|verdict| human[verdict.detection.class] && !verdict.ignored)
    {
        alarms += 1;
        let around = by_picture.get(detection.picture).map_or(&[][..], Vec::as_slice);
        right += usize::from(around.iter().map(|index| &truths[*index]).any(|truth| {
            human[truth.class] && overlap(&detection.place, &truth.place, truth.crowd) >= RIGHT_PLACE
        }));
    }
    PeopleFound {
        as_that_class: Share::new(that_class, all),
        as_a_person: Share::new(person, all),
        alarms_right: Share::new(right, alarms),
    }
}

/// What was taken for what: row = what it is, column = what it was called; the last row is "nothing there", the last
/// column "not found".
#[must_use]
pub fn confusion(classes: usize, scores: &[f64], truths: &[Truth], detections: &[Judged]) -> Vec<Vec<usize>> {
    let used: Vec<&Judged> = detections.iter().filter(|one| one.score >= scores[one.class]).collect();
    let by_picture = truths_by_picture(truths);
    let mut pairs: Vec<(f64, bool, usize, usize)> = Vec::new();
    for (index, detection) in used.iter().enumerate() {
        for truth in by_picture.get(detection.picture).map_or(&[][..], Vec::as_slice) {
            let value = overlap(&detection.place, &truths[*truth].place, truths[*truth].crowd);
            if value >= RIGHT_PLACE {
                pairs.push((value, truths[*truth].class == detection.class, index, *truth));
            }
        }
    }
    // The right class before a wrong one at the same object, then the better place.
    pairs.sort_by(|one, other| other.1.cmp(&one.1).then(other.0.total_cmp(&one.0)));
    let mut table = vec![vec![0; classes + 1]; classes + 1];
    let (mut detection_taken, mut truth_taken) = (vec![false; used.len()], vec![false; truths.len()]);
    for (_, _, detection, truth) in pairs {
        if detection_taken[detection] || truth_taken[truth] {
            continue;
        }
        detection_taken[detection] = true;
        if truths[truth].crowd {
            continue;
        }
        truth_taken[truth] = true;
        table[truths[truth].class][used[detection].class] += 1;
    }
    for (detection, _) in used.iter().zip(detection_taken).filter(|(_, taken)| !taken) {
        table[classes][detection.class] += 1;
    }
    for (truth, _) in truths.iter().zip(truth_taken).filter(|(truth, taken)| !taken && !truth.crowd) {
        table[truth.class][classes] += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: [f64; 4] = [0.0, 0.0, 10.0, 10.0];
    const THERE: [f64; 4] = [50.0, 0.0, 10.0, 10.0];

    fn truth(class: usize, place: [f64; 4]) -> Truth {
        Truth { picture: 0, class, place, area: 100.0, crowd: false }
    }

    fn seen(class: usize, score: f64, place: [f64; 4]) -> Judged {
        Judged { picture: 0, class, score, place }
    }

    fn names() -> Vec<String> {
        ["bolt", "foot", "leg"].map(str::to_owned).to_vec()
    }

    #[test]
    fn precision_and_recall_count_at_the_operating_score_only() {
        let truths = [truth(0, HERE), truth(0, THERE)];
        let detections = [seen(0, 0.9, HERE), seen(0, 0.8, HERE), seen(0, 0.3, THERE)];
        let verdicts = assign(&truths, &detections);
        let figures = &by_class(&names(), &[0.5; 3], &truths, &verdicts)[0];
        assert_eq!(
            (figures.precision.hits, figures.precision.of),
            (1, 2),
            "the second find of one object is wrong"
        );
        assert_eq!((figures.recall.hits, figures.recall.of), (1, 2));
        assert!((figures.f1.unwrap() - 0.5).abs() < 1e-12);
        let figures = &by_class(&names(), &[0.2; 3], &truths, &verdicts)[0];
        assert_eq!((figures.precision.hits, figures.recall.hits), (2, 2));
    }

    #[test]
    fn a_leg_that_is_called_foot_is_a_person_found_but_not_a_leg() {
        let truths = [truth(2, HERE), truth(1, THERE), truth(0, [90.0, 0.0, 10.0, 10.0])];
        let detections = [seen(1, 0.9, HERE), seen(0, 0.9, THERE)];
        let found = people(&names(), &[0.5; 3], &truths, &assign(&truths, &detections));
        assert_eq!((found.as_that_class.hits, found.as_that_class.of), (0, 2));
        assert_eq!(
            (found.as_a_person.hits, found.as_a_person.of),
            (1, 2),
            "a foot taken for a bolt is not found"
        );
    }

    #[test]
    fn an_alarm_is_right_where_a_person_is_whatever_it_is_called() {
        let truths = [truth(2, HERE), truth(0, THERE)];
        let nowhere = [0.0, 90.0, 9.0, 9.0];
        // A leg as leg and as foot, a bolt as foot, nothing as leg; too weak, and no alarm at all.
        let detections = [
            seen(2, 0.9, HERE),
            seen(1, 0.8, HERE),
            seen(1, 0.9, THERE),
            seen(2, 0.7, nowhere),
            seen(1, 0.4, HERE),
            seen(0, 0.9, nowhere),
        ];
        let found = people(&names(), &[0.5; 3], &truths, &assign(&truths, &detections));
        assert_eq!((found.alarms_right.hits, found.alarms_right.of), (2, 4));
    }

    #[test]
    fn confusion_has_every_object_in_its_row_and_every_invention_in_the_last() {
        let truths = [truth(0, HERE), truth(1, THERE), truth(2, [90.0, 0.0, 10.0, 10.0])];
        let detections = [seen(0, 0.9, HERE), seen(2, 0.9, THERE), seen(1, 0.9, [0.0, 90.0, 9.0, 9.0])];
        let table = confusion(3, &[0.5; 3], &truths, &detections);
        assert_eq!(table, [[1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 1, 0, 0]]);
    }

    #[test]
    fn a_detection_in_a_crowd_is_neither_right_nor_wrong() {
        let truths = [Truth { crowd: true, ..truth(0, [0.0, 0.0, 100.0, 100.0]) }];
        let detections = [seen(0, 0.9, HERE)];
        let verdicts = assign(&truths, &detections);
        let figures = &by_class(&names(), &[0.5; 3], &truths, &verdicts)[0];
        assert_eq!((figures.precision.of, figures.recall.of), (0, 0));
        assert_eq!(confusion(3, &[0.5; 3], &truths, &detections).concat().iter().sum::<usize>(), 0);
    }

    #[test]
    fn people_get_a_lower_operating_score_than_things_with_the_same_evidence() {
        let places: Vec<[f64; 4]> =
            (0..10u8).map(|index| [f64::from(index) * 50.0, 0.0, 10.0, 10.0]).collect();
        let wrong =
            |class: usize| move |index: u8| seen(class, 0.4, [f64::from(index) * 50.0, 90.0, 10.0, 10.0]);
        let (mut truths, mut detections) = (Vec::new(), Vec::new());
        for class in [0, 1] {
            truths.extend(places.iter().map(|place| truth(class, *place)));
            detections.extend(places[..7].iter().map(|place| seen(class, 0.9, *place)));
            detections.extend((0..9).map(wrong(class)));
            detections.extend(places[7..].iter().map(|place| seen(class, 0.3, *place)));
        }
        let scores = best_scores(&names(), &truths, &assign(&truths, &detections));
        assert_eq!(scores, [Some(0.9), Some(0.3), None]);
    }
}
