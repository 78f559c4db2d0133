//! What the rig itself makes unsure about a height: the same in every picture, however well the stripe is seen.
//!
//! Calibration tells it at some places along the stripe and at some heights; between them it is interpolated.

/// One standard deviation of the rig's systematic error of heights.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RigDeviation {
    /// Places along the stripe, rising, millimetres; each with heights, rising, and deviations, all millimetres.
    places: Vec<(f32, Vec<[f32; 2]>)>,
}

impl RigDeviation {
    /// From triples of place, height and deviation, millimetres, in any order; what is not finite or negative is left
    /// out.
    #[must_use]
    pub fn of(triples: &[[f64; 3]]) -> Self {
        let mut sorted: Vec<[f32; 3]> = triples
            .iter()
            .filter(|triple| triple.iter().all(|value| value.is_finite()) && triple[2] >= 0.0)
            .map(|triple| triple.map(|value| value as f32))
            .collect();
        sorted.sort_by(|one, other| one[0].total_cmp(&other[0]).then(one[1].total_cmp(&other[1])));
        let places = sorted.chunk_by(|one, other| one[0] == other[0]).map(|triples| {
            (triples[0][0], triples.iter().map(|[_, height, deviation]| [*height, *deviation]).collect())
        });
        Self { places: places.collect() }
    }

    /// One standard deviation at a place and height, millimetres; zero where nothing is known of the rig. Beyond the
    /// outermost places and heights it is that of the outermost, and above the highest height it grows with height as it
    /// did last.
    #[must_use]
    pub fn at(&self, place: f32, height: f32) -> f32 {
        let after = self.places.partition_point(|(known, _)| *known < place);
        let of =
            |index: usize| self.places.get(index).map(|(known, rows)| (*known, of_heights(rows, height)));
        match (after.checked_sub(1).and_then(of), of(after)) {
            (Some((start, low)), Some((end, high))) => {
                let share = (place - start) / (end - start);
                low + share * (high - low)
            }
            (Some((_, deviation)), None) | (None, Some((_, deviation))) => deviation,
            (None, None) => 0.0,
        }
    }
}

/// The deviation at a height, from pairs of height and deviation.
fn of_heights(rows: &[[f32; 2]], height: f32) -> f32 {
    let line =
        |[low, from]: [f32; 2], [high, to]: [f32; 2]| from + (height - low) / (high - low) * (to - from);
    let after = rows.partition_point(|[known, _]| *known < height);
    match (rows.get(after.wrapping_sub(1)), rows.get(after), rows) {
        (Some(low), Some(high), _) => line(*low, *high),
        (None, Some([_, deviation]), _) => *deviation,
        (Some(_), None, [.., before, last]) => line(*before, *last).max(last[1]),
        (Some([_, deviation]), None, _) => *deviation,
        (None, None, _) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: [[f64; 3]; 6] = [
        [100.0, 0.0, 2.0],
        [100.0, 50.0, 3.0],
        [100.0, 100.0, 5.0],
        [-100.0, 0.0, 1.0],
        [-100.0, 50.0, 1.0],
        [-100.0, 100.0, 1.0],
    ];

    #[test]
    fn between_known_places_and_heights_it_lies_between() {
        let deviation = RigDeviation::of(&TABLE);
        for (place, height, expected) in
            [(100.0, 50.0, 3.0), (100.0, 25.0, 2.5), (0.0, 0.0, 1.5), (0.0, 75.0, 2.5), (-100.0, 60.0, 1.0)]
        {
            let found = deviation.at(place, height);
            assert!((found - expected).abs() < 1e-5, "{found} at {place}, {height}: expected {expected}");
        }
    }

    /// A height is never said to be surer for lying where the calibration did not look.
    #[test]
    fn beyond_what_is_known_it_does_not_shrink() {
        let deviation = RigDeviation::of(&TABLE);
        assert!((deviation.at(500.0, -40.0) - 2.0).abs() < 1e-5, "below and beside");
        assert!((deviation.at(500.0, 150.0) - 7.0).abs() < 1e-5, "above");
        assert!((RigDeviation::of(&[[0.0, 0.0, 4.0], [0.0, 50.0, 3.0]]).at(0.0, 100.0) - 3.0).abs() < 1e-5);
    }

    #[test]
    fn of_an_unknown_rig_and_of_nonsense_it_is_zero() {
        assert_eq!(RigDeviation::default().at(0.0, 10.0), 0.0);
        assert_eq!(RigDeviation::of(&[[f64::NAN, 0.0, 1.0], [0.0, 0.0, -1.0]]), RigDeviation::default());
    }
}
