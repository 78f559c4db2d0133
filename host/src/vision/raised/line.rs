//! Lines of candidates, and when one is believed.

use super::{LINE_HOLES, LINE_STEP, RaisedPoint};

/// Fewest columns of a line.
const FEWEST_COLUMNS: u32 = 3;
/// Mean contrast that a line needs, in standard deviations of the background.
const LINE_CONTRAST: f32 = 6.0;
/// A line goes on beside the dark stretch if it is seen in this much of that at least, millimetres.
const GOES_ON_MM: f32 = 3.0;
/// Samples in which the next candidate of a line may lie: up and down by a step a column, in each column that a hole leaves.
const CONTINUING_SAMPLES: f32 = LINE_STEP * ((LINE_HOLES + 1) * (LINE_HOLES + 2)) as f32;
/// Lines that chance may make of other candidates in a whole picture.
const CHANCE_LINES: f32 = 0.05;

/// A ridge that may be the stripe.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) column: usize,
    pub(super) row: f32,
    pub(super) contrast: f32,
    pub(super) significance: f32,
}

/// A line of candidates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) number: u32,
    pub(super) columns: u32,
    pub(super) contrast: f32,
    pub(super) significance: f32,
    pub(super) last_column: usize,
    pub(super) last_row: f32,
    /// Length on rays that reach the floor, before the line's first dark ray and after it, millimetres.
    pub(super) beside: [f32; 2],
    /// First and last column of what is believed of it.
    pub(super) ends: [usize; 2],
}

impl Line {
    pub(super) const fn starting_at(number: u32, seen: &Candidate) -> Self {
        Self {
            number,
            columns: 0,
            contrast: 0.0,
            significance: 0.0,
            last_column: seen.column,
            last_row: seen.row,
            beside: [0.0; 2],
            ends: [0; 2],
        }
    }

    /// Long enough and strong enough, and it ends where the laser's light on the floor begins: what goes on at both ends
    /// is a thing that is red itself.
    pub(super) fn is_believable(&self) -> bool {
        self.columns >= FEWEST_COLUMNS
            && self.significance >= LINE_CONTRAST * self.columns as f32
            && self.beside.iter().any(|length| *length < GOES_ON_MM)
    }
}

/// Would candidates that lie about by chance, as many as there are of this strength, make such a line somewhere? Noise and
/// texture make many candidates, and where there are many some stand in a row; the stripe on a thing stands out from them.
pub(super) fn is_by_chance(columns: u32, as_strong: usize, searched: f32) -> bool {
    // Half of a line's own points are as strong as their mean.
    let others = as_strong as f32 - columns as f32 / 2.0;
    if others <= 0.0 {
        return false;
    }
    // Each of them begins a line that has so many points if each point has the next one within reach.
    let next = CONTINUING_SAMPLES * others / searched.max(1.0);
    others * next.powi(columns.saturating_sub(1) as i32) > CHANCE_LINES
}

/// A line's points from the first dark ray to the last.
pub(super) fn without_ends(points: &[RaisedPoint]) -> &[RaisedPoint] {
    let first = points.iter().position(|point| !point.beside);
    let last = points.iter().rposition(|point| !point.beside);
    first.zip(last).and_then(|(first, last)| points.get(first..=last)).unwrap_or(&[])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_believed_as_long_as_others_of_its_strength_would_not_make_it_by_chance() {
        let searched = 20_000.0;
        assert!(!is_by_chance(3, 3, searched), "alone");
        assert!(!is_by_chance(3, 9, searched), "a few others");
        assert!(is_by_chance(3, 60, searched), "three in a row among many");
        assert!(!is_by_chance(12, 60, searched), "twelve in a row");
        assert!(is_by_chance(12, 400, searched), "noise everywhere");
        assert!(!is_by_chance(3, 0, 0.0), "nothing searched");
    }
}
