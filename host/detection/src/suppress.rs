//! Non-maximum suppression: of many boxes around one object, the best one stays.

use crate::detector::Detection;

/// A box that lies inside a better one of its class to this share belongs to the same object: a tile's edge cut it.
const CONTAINED: f32 = 0.85;

/// Sorts by score, best first, and drops every box that overlaps a better one of the same class by more than
/// `largest_overlap` (intersection over union, 0 to 1). At most `most` boxes stay. Allocates nothing.
///
/// With `drop_contained`, boxes that lie almost wholly inside a better one of their class go too: pieces of an object
/// that several tiles have seen.
pub fn suppress(detections: &mut Vec<Detection>, largest_overlap: f32, drop_contained: bool, most: usize) {
    // Among equal scores the place decides, so that the answer does not depend on the order in which tiles came.
    detections.sort_unstable_by(|one, other| {
        let key = |detection: &Detection| (detection.place.top, detection.place.left);
        other
            .score
            .total_cmp(&one.score)
            .then_with(|| one.class.cmp(&other.class))
            .then_with(|| key(one).partial_cmp(&key(other)).unwrap_or(std::cmp::Ordering::Equal))
    });
    let mut kept = 0;
    for candidate in 0..detections.len() {
        if kept == most {
            break;
        }
        let current = detections[candidate];
        let covered = detections[..kept].iter().any(|better| {
            better.class == current.class
                && (better.place.overlap(&current.place) > largest_overlap
                    || (drop_contained
                        && better.place.common_area(&current.place) > CONTAINED * current.place.area()))
        });
        if !covered {
            detections[kept] = current;
            kept += 1;
        }
    }
    detections.truncate(kept);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boxes::BoundingBox;

    fn at(class: usize, score: f32, x: f32, size: f32) -> Detection {
        Detection { class, score, confidence: score, place: BoundingBox::around(x, 50.0, size, size) }
    }

    #[test]
    fn the_best_of_overlapping_boxes_stays() {
        let mut boxes = vec![at(0, 0.5, 51.0, 20.0), at(0, 0.9, 50.0, 20.0), at(0, 0.3, 90.0, 20.0)];
        suppress(&mut boxes, 0.5, false, 10);
        assert_eq!(boxes, vec![at(0, 0.9, 50.0, 20.0), at(0, 0.3, 90.0, 20.0)]);
    }

    #[test]
    fn classes_do_not_suppress_each_other() {
        let mut boxes = vec![at(0, 0.9, 50.0, 20.0), at(1, 0.5, 50.0, 20.0)];
        suppress(&mut boxes, 0.5, true, 10);
        assert_eq!(boxes.len(), 2);
    }

    #[test]
    fn pieces_of_an_object_go_only_where_tiles_were_merged() {
        let whole_and_piece = [at(0, 0.9, 50.0, 40.0), at(0, 0.8, 50.0, 10.0)];
        for (drop_contained, expected) in [(false, 2), (true, 1)] {
            let mut boxes = whole_and_piece.to_vec();
            suppress(&mut boxes, 0.5, drop_contained, 10);
            assert_eq!(boxes.len(), expected);
        }
    }

    #[test]
    fn a_suppressed_box_suppresses_nothing() {
        // The second is dropped by the first; the third overlaps only the second and must stay.
        let mut boxes = vec![at(0, 0.9, 50.0, 20.0), at(0, 0.8, 56.0, 20.0), at(0, 0.7, 62.0, 20.0)];
        suppress(&mut boxes, 0.5, false, 10);
        assert_eq!(boxes, vec![at(0, 0.9, 50.0, 20.0), at(0, 0.7, 62.0, 20.0)]);
    }

    #[test]
    fn the_order_of_arrival_does_not_matter() {
        let mut forward = vec![at(0, 0.5, 50.0, 20.0), at(0, 0.5, 52.0, 20.0), at(1, 0.5, 50.0, 20.0)];
        let mut backward: Vec<Detection> = forward.iter().rev().copied().collect();
        suppress(&mut forward, 0.5, false, 10);
        suppress(&mut backward, 0.5, false, 10);
        assert_eq!(forward, backward);
    }

    #[test]
    fn no_more_than_asked_for_stay() {
        let mut boxes: Vec<Detection> =
            (0..20u8).map(|index| at(0, 0.5, f32::from(index) * 50.0, 10.0)).collect();
        suppress(&mut boxes, 0.5, false, 7);
        assert_eq!(boxes.len(), 7);
    }
}
