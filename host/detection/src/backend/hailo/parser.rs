//! HailoRT's answer in its order "NMS by class": for each class a count, then so many boxes of five numbers.
//!
//! All are 32-bit floats, one after the other without gaps: count, then y_min, x_min, y_max, x_max (0 to 1, shares of the
//! input) and score for each box. The buffer is as long as for full classes; what follows the last class means nothing.

use crate::boxes::BoundingBox;
use crate::detector::{Detection, Unknown};

/// Numbers of a box.
const OF_A_BOX: usize = 5;
/// How far boxes may reach over the input's rim, as a share of it.
const OVER_THE_RIM: f32 = 0.5;

/// Reads boxes in pixels of an input with this side.
///
/// # Errors
/// [`Unknown::Nonsense`]: counts that cannot be, numbers that are none, an answer that ends too early.
pub fn boxes_by_class(
    numbers: &[f32],
    classes: usize,
    most_a_class: usize,
    side: f32,
    mut found: impl FnMut(Detection),
) -> Result<(), Unknown> {
    let nonsense = |what: String| Unknown::Nonsense { what };
    let mut rest = numbers;
    for class in 0..classes {
        let (count, after) =
            rest.split_first().ok_or_else(|| nonsense(format!("the answer ends before class {class}")))?;
        let sound = *count >= 0.0 && *count <= most_a_class as f32 && count.fract() == 0.0;
        if !sound {
            return Err(nonsense(format!(
                "{count} boxes of class {class}, at most {most_a_class} are possible"
            )));
        }
        let length = *count as usize * OF_A_BOX;
        let boxes =
            after.get(..length).ok_or_else(|| nonsense(format!("the answer ends within class {class}")))?;
        rest = &after[length..];
        for numbers in boxes.chunks_exact(OF_A_BOX) {
            let [top, left, bottom, right, score] =
                [numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]];
            let inside = |value: f32| (-OVER_THE_RIM..=1.0 + OVER_THE_RIM).contains(&value);
            let placed = [top, left, bottom, right].into_iter().all(inside) && top <= bottom && left <= right;
            if !placed || !(0.0..=1.0).contains(&score) {
                return Err(nonsense(format!("a box of class {class} with the numbers {numbers:?}")));
            }
            let place = BoundingBox {
                left: left * side,
                top: top * side,
                right: right * side,
                bottom: bottom * side,
            };
            found(Detection { class, score, confidence: score, place });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: [f32; 13] = [1.0, 0.1, 0.2, 0.3, 0.4, 0.9, 0.0, 1.0, 0.5, 0.5, 0.75, 1.0, 0.6];

    fn parsed(numbers: &[f32]) -> Result<Vec<Detection>, Unknown> {
        let mut found = Vec::new();
        boxes_by_class(numbers, 3, 2, 100.0, |detection| found.push(detection)).map(|()| found)
    }

    #[test]
    fn boxes_follow_their_counts_class_by_class() {
        let found = parsed(&[&GOOD[..], &[f32::NAN; 7]].concat()).unwrap();
        assert_eq!(found.iter().map(|one| (one.class, one.score)).collect::<Vec<_>>(), [(0, 0.9), (2, 0.6)]);
        let place = BoundingBox { left: 50.0, top: 50.0, right: 100.0, bottom: 75.0 };
        assert_eq!(found[1].place, place);
    }

    #[test]
    fn every_shortened_answer_is_nonsense() {
        for length in 0..GOOD.len() {
            assert!(parsed(&GOOD[..length]).is_err(), "{length} numbers");
        }
    }

    #[test]
    fn counts_and_numbers_that_cannot_be_are_nonsense() {
        for (place, value) in [
            (0, -1.0),
            (0, 0.5),
            (0, 3.0),
            (0, f32::NAN),
            (0, f32::INFINITY),
            (1, f32::NAN),
            (2, 7.0),
            (3, 0.05),
            (5, 1.5),
            (5, f32::NAN),
            (6, 1e30),
        ] {
            let mut numbers = GOOD;
            numbers[place] = value;
            assert!(matches!(parsed(&numbers), Err(Unknown::Nonsense { .. })), "{place} {value}");
        }
    }
}
