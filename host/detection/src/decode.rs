//! The network's rows of numbers, read as boxes.
//!
//! One row is centre x, centre y, width, height (pixels of the input), objectness, then one number a class, all after
//! the sigmoid: the arithmetic that turns cells into boxes is part of the exported network.

use crate::boxes::BoundingBox;
use crate::detector::{Detection, Unknown};

/// Numbers of a row before the classes.
pub const BEFORE_CLASSES: usize = 5;
/// How far over 1 rounding may take a sigmoid.
const ROUNDING: f32 = 1e-3;

/// Reads rows into boxes of the input: one for every class whose score reaches `least_score`, since a shoe that is "foot,
/// perhaps leg" shall be found as both. `found` receives them; they are not yet suppressed. Every number is looked at: one
/// that is not finite anywhere makes the whole answer worthless.
///
/// # Errors
/// [`Unknown::Nonsense`]: not whole rows, numbers that are not numbers or not between 0 and 1 where they must be.
pub fn decode(
    rows: &[f32],
    classes: usize,
    least_score: f32,
    mut found: impl FnMut(Detection),
) -> Result<(), Unknown> {
    let nonsense = |what: String| Unknown::Nonsense { what };
    let length = BEFORE_CLASSES + classes;
    if rows.is_empty() || !rows.len().is_multiple_of(length) {
        return Err(nonsense(format!("{} numbers are not rows of {length}", rows.len())));
    }
    for (index, row) in rows.chunks_exact(length).enumerate() {
        let (geometry, scores) = row.split_at(BEFORE_CLASSES - 1);
        // A sum is not finite if one of its parts is not; no branch for each number.
        if !row.iter().sum::<f32>().is_finite() {
            return Err(nonsense(format!("row {index} has a number that is not finite")));
        }
        let range = scores.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), score| {
            (low.min(*score), high.max(*score))
        });
        if range.0 < -ROUNDING || range.1 > 1.0 + ROUNDING {
            return Err(nonsense(format!("row {index} has scores from {} to {}", range.0, range.1)));
        }
        let objectness = scores[0];
        if objectness < least_score {
            continue;
        }
        let [x, y, width, height] = [geometry[0], geometry[1], geometry[2], geometry[3]];
        let place = BoundingBox::around(x, y, width.max(0.0), height.max(0.0));
        for (class, class_score) in scores[1..].iter().enumerate() {
            let score = (objectness * class_score).clamp(0.0, 1.0);
            if score >= least_score {
                found(Detection { class, score, confidence: score, place });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROW: [f32; 7] = [100.0, 50.0, 20.0, 10.0, 0.5, 0.1, 0.8];

    fn decoded(rows: &[f32]) -> Result<Vec<Detection>, Unknown> {
        let mut found = Vec::new();
        decode(rows, 2, 0.1, |detection| found.push(detection)).map(|()| found)
    }

    #[test]
    fn a_row_is_a_box_with_every_class_that_reaches_the_score() {
        let found = decoded(&ROW).unwrap();
        let place = BoundingBox { left: 90.0, top: 45.0, right: 110.0, bottom: 55.0 };
        assert_eq!(found, vec![Detection { class: 1, score: 0.4, confidence: 0.4, place }]);
        let both = decoded(&[100.0, 50.0, 20.0, 10.0, 0.5, 0.4, 0.8]).unwrap();
        assert_eq!(
            both.iter().map(|found| (found.class, found.score)).collect::<Vec<_>>(),
            [(0, 0.2), (1, 0.4)]
        );
    }

    #[test]
    fn weak_boxes_are_left_out() {
        let weak = [100.0, 50.0, 20.0, 10.0, 0.3, 0.2, 0.3];
        assert_eq!(decoded(&weak).unwrap(), vec![]);
    }

    #[test]
    fn one_number_that_is_none_spoils_everything_also_in_a_weak_row() {
        for (place, value) in (0..7).flat_map(|place| [(place, f32::NAN), (place, f32::INFINITY)]) {
            let mut rows = [ROW, [0.0; 7]].concat();
            rows[7 + place] = value;
            assert!(matches!(decoded(&rows), Err(Unknown::Nonsense { .. })), "{place} {value}");
        }
    }

    #[test]
    fn scores_are_between_0_and_1() {
        for (place, value) in [(4, -0.1), (4, 1.1), (6, 7.0), (5, -3.0)] {
            let mut row = ROW;
            row[place] = value;
            assert!(matches!(decoded(&row), Err(Unknown::Nonsense { .. })), "{place} {value}");
        }
    }

    #[test]
    fn broken_rows_are_refused() {
        assert!(decoded(&ROW[..6]).is_err());
        assert!(decoded(&[]).is_err(), "no rows at all is not an empty floor");
    }
}
