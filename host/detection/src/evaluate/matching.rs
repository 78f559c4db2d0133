//! Which detection is which object: pycocotools' rules for one class in one picture.

use super::{Judged, Truth, overlap};

/// Most detections of one class in one picture that are judged.
pub const MOST_DETECTIONS: usize = 100;

/// The overlaps from which a detection counts: 0.5, 0.55, ... 0.95.
#[must_use]
pub fn thresholds() -> [f64; 10] {
    // Step by division, as numpy's linspace: 0.05 itself is another number in the last bit.
    let step = (0.95 - 0.5) / 9.0;
    let mut values = std::array::from_fn(|index| 0.5 + index as f64 * step);
    values[9] = 0.95;
    values
}

/// One detection's fate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fate {
    /// Its score.
    pub score: f64,
    /// For each threshold: is it an object's?
    pub matched: [bool; 10],
    /// For each threshold: does it count neither as right nor as wrong?
    pub ignored: [bool; 10],
}

/// The fates in one picture, best score first, and how many objects count.
#[derive(Debug, Clone, PartialEq)]
pub struct Matched {
    /// One for each detection.
    pub fates: Vec<Fate>,
    /// Objects that count.
    pub objects: usize,
}

/// All objects and detections of one class in one picture, with their overlaps.
pub struct Pair<'a> {
    truths: Vec<&'a Truth>,
    detections: Vec<&'a Judged>,
    /// Row for each detection, column for each truth.
    overlaps: Vec<Vec<f64>>,
}

impl<'a> Pair<'a> {
    /// Sorts the detections by score, best first, and keeps the best hundred.
    #[must_use]
    pub fn new(truths: Vec<&'a Truth>, mut detections: Vec<&'a Judged>) -> Self {
        detections.sort_by(|one, other| other.score.total_cmp(&one.score));
        detections.truncate(MOST_DETECTIONS);
        let row = |detection: &&Judged| {
            truths.iter().map(|truth| overlap(&detection.place, &truth.place, truth.crowd)).collect()
        };
        let overlaps = detections.iter().map(row).collect();
        Self { truths, detections, overlaps }
    }

    /// Matches with objects whose area lies between two bounds (square pixels); others do not count.
    #[must_use]
    pub fn matched(&self, area: (f64, f64)) -> Matched {
        let outside = |value: f64| value < area.0 || value > area.1;
        let is_ignored = |truth: &Truth| truth.crowd || outside(truth.area);
        // Objects that count come first; the order is otherwise kept.
        let mut order: Vec<usize> = (0..self.truths.len()).collect();
        order.sort_by_key(|index| is_ignored(self.truths[*index]));
        let ignored: Vec<bool> = order.iter().map(|index| is_ignored(self.truths[*index])).collect();
        let mut fates: Vec<Fate> =
            self.detections.iter().map(|detection| Fate::unmatched(detection.score)).collect();
        for (level, threshold) in thresholds().into_iter().enumerate() {
            let mut taken = vec![false; order.len()];
            for (index, fate) in fates.iter_mut().enumerate() {
                if let Some(best) = self.best(index, threshold, &order, &ignored, &taken) {
                    taken[best] = true;
                    fate.matched[level] = true;
                    fate.ignored[level] = ignored[best];
                } else {
                    let [_, _, width, height] = self.detections[index].place;
                    fate.ignored[level] = outside(width * height);
                }
            }
        }
        Matched { fates, objects: ignored.iter().filter(|ignored| !**ignored).count() }
    }

    /// The object that this detection takes: the best overlap; one that counts before any that does not.
    fn best(
        &self,
        detection: usize,
        threshold: f64,
        order: &[usize],
        ignored: &[bool],
        taken: &[bool],
    ) -> Option<usize> {
        let mut least = threshold.min(1.0 - 1e-10);
        let mut best: Option<usize> = None;
        for (place, index) in order.iter().enumerate() {
            if taken[place] && !self.truths[*index].crowd {
                continue;
            }
            if best.is_some_and(|best| !ignored[best]) && ignored[place] {
                break;
            }
            let value = self.overlaps[detection][*index];
            if value >= least {
                least = value;
                best = Some(place);
            }
        }
        best
    }
}

impl Fate {
    fn unmatched(score: f64) -> Self {
        Self { score, matched: [false; 10], ignored: [false; 10] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: (f64, f64) = (0.0, 1e10);

    fn truth(place: [f64; 4]) -> Truth {
        Truth { picture: 0, class: 0, place, area: place[2] * place[3], crowd: false }
    }

    fn detection(score: f64, place: [f64; 4]) -> Judged {
        Judged { picture: 0, class: 0, score, place }
    }

    fn at_half(truths: &[Truth], detections: &[Judged], area: (f64, f64)) -> (Vec<(bool, bool)>, usize) {
        let matched = Pair::new(truths.iter().collect(), detections.iter().collect()).matched(area);
        (matched.fates.iter().map(|fate| (fate.matched[0], fate.ignored[0])).collect(), matched.objects)
    }

    #[test]
    fn an_object_is_found_once_by_the_best_score() {
        let truths = [truth([0.0, 0.0, 10.0, 10.0])];
        let detections = [detection(0.5, [0.0, 0.0, 10.0, 10.0]), detection(0.9, [1.0, 0.0, 10.0, 10.0])];
        // The better score comes first although its box is worse.
        assert_eq!(at_half(&truths, &detections, ALL), (vec![(true, false), (false, false)], 1));
    }

    #[test]
    fn a_crowd_takes_any_number_and_none_counts() {
        let truths = [Truth { crowd: true, ..truth([0.0, 0.0, 100.0, 100.0]) }];
        let detections = [detection(0.9, [0.0, 0.0, 10.0, 10.0]), detection(0.8, [50.0, 50.0, 10.0, 10.0])];
        assert_eq!(at_half(&truths, &detections, ALL), (vec![(true, true), (true, true)], 0));
    }

    #[test]
    fn an_object_that_counts_is_preferred_to_a_better_overlap_that_does_not() {
        let truths = [Truth { crowd: true, ..truth([0.0, 0.0, 10.0, 10.0]) }, truth([2.0, 0.0, 10.0, 10.0])];
        let detections = [detection(0.9, [0.0, 0.0, 10.0, 10.0])];
        assert_eq!(at_half(&truths, &detections, ALL), (vec![(true, false)], 1));
    }

    #[test]
    fn outside_the_range_of_areas_nothing_counts() {
        let truths = [truth([0.0, 0.0, 40.0, 40.0])];
        let detections = [detection(0.9, [0.0, 0.0, 40.0, 40.0]), detection(0.8, [200.0, 0.0, 50.0, 50.0])];
        assert_eq!(at_half(&truths, &detections, (0.0, 1024.0)), (vec![(true, true), (false, true)], 0));
    }

    #[test]
    fn thresholds_are_numpys() {
        let expected = [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95];
        for (got, wanted) in thresholds().iter().zip(expected) {
            assert!((got - wanted).abs() < 1e-12);
        }
    }
}
