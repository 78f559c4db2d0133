//! The one line through the candidates that a stripe can have made: by dynamic programming over the columns.
//!
//! In each column the line passes one candidate or none. Strong candidates earn, weak ones cost; going on smoothly is
//! free, jumping costs, so that only stretches over several columns pay for the jumps to and from them. Stretches that
//! are too short are dropped, and what is left must be long enough to be a stripe.

use super::candidates::{Candidate, Candidates};
use crate::vision::peak;
use crate::vision::signal::Signal;

/// Significance that earns nothing.
const NEUTRAL_SIGNIFICANCE: f32 = 5.0;
/// What a candidate can earn at most, and what a weak one costs at most.
const EARNINGS: std::ops::RangeInclusive<f32> = -1.0..=1.5;
/// Cost of a sample of movement from one column to the next, beyond the first: a stripe may run at 45 degrees.
const STEP_COST: f32 = 0.35;
const FREE_STEP: f32 = 1.0;
/// Cost of a jump, and of beginning or ending a stretch.
const JUMP_COST: f32 = 3.0;
/// Columns that a stretch may miss without ending.
const HOLE: usize = 4;
/// A stretch is at least this many columns ...
const SHORTEST_STRETCH: usize = 6;
/// ... and this share of the picture.
const SHORTEST_STRETCH_SHARE: f32 = 0.012;
/// The longest stretch is at least this share of the picture.
const LONGEST_STRETCH_SHARE: f32 = 0.06;
/// A sheet of light meets everything from one side of the picture to the other: the stretches together are most of it, ...
const MOST_COVER: f32 = 0.65;
/// ... or at least this share lies on one straight line, which a sheet of light draws on every floor and wall. A red cable
/// that hangs or lies about is thin, long and as bright in its middle, but short of the picture and bent.
const STRAIGHT_COVER: f32 = 0.3;
/// ... or nearly all of what is seen does, and that is not too little: a faint stripe is seen only in places.
const LEAST_COVER: f32 = 0.2;
const STRAIGHT_SHARE_OF_COVER: f32 = 0.85;
/// How far a straight line's points may lie from it: this share of the picture (lenses bend lines), but at least so many samples.
const STRAIGHT_SHARE: f32 = 0.004;
const STRAIGHT_SAMPLES: f32 = 2.0;
/// So many points, evenly spread, are tried in pairs for the straight line.
const STRAIGHT_TRIALS: usize = 24;
/// A stretch's points lie within this of a smooth line (root of the mean square, samples); texture does not.
const ROUGHEST: f32 = 1.5;
/// A line of light is peaked by at least this, in the median of a stretch. A bell of any width has 0.07 to 0.25, paint
/// and pipes less than 0.05.
const LEAST_PEAKEDNESS: f32 = 0.06;
/// ... or clipped in at least this share of its points.
const CLIPPED_SHARE: f32 = 0.25;
/// Neighbours on each side that tell where a point must be.
const NEIGHBOURS: usize = 4;
/// Of the points that lie on their neighbours' line, one in 450 is wrong (logarithm of the odds) ...
const STRAIGHT_LOG_ODDS: f32 = 6.1;
/// ... and more of those that lie off it: the loss per sample up to this bend ...
const SMALL_BEND: f32 = 0.2;
const SMALL_BEND_LOSS: f32 = 9.4;
/// ... and from there to the bend at which nothing gets worse.
const LARGE_BEND_LOSS: f32 = 5.0;
const LARGEST_BEND: f32 = 1.0;
/// How far the sub-pixel measurement may look from a crest, samples.
const MEASURE_REACH: usize = 2;

/// One column's point of the line.
#[derive(Debug, Clone, Copy)]
struct Point {
    column: usize,
    candidate: Candidate,
    row: f32,
}

/// The line: stretches of points.
#[derive(Debug, Clone)]
pub struct Path {
    stretches: Vec<Vec<Point>>,
}

impl Path {
    /// The best line, if there is one that a stripe can have made.
    pub fn through<S: Signal>(signal: S, candidates: &Candidates) -> Option<Self> {
        let chosen = best_line(candidates.columns());
        let mut stretches: Vec<Vec<Point>> = Vec::new();
        for (column, candidate) in chosen.into_iter().enumerate() {
            let Some(candidate) = candidate else { continue };
            let row = if candidate.is_bleached() {
                middle_of_bleached(signal, column, &candidate)
            } else {
                peak::find(signal, column, candidate.row, MEASURE_REACH, true).map(|peak| peak.row)
            };
            let row = row.unwrap_or(candidate.row as f32);
            let point = Point { column, candidate, row };
            match stretches.last_mut().filter(|stretch| continues(stretch, &point)) {
                Some(stretch) => stretch.push(point),
                None => stretches.push(vec![point]),
            }
        }
        let width = signal.columns() as f32;
        let shortest = SHORTEST_STRETCH.max((SHORTEST_STRETCH_SHARE * width) as usize);
        stretches.retain(|stretch| {
            stretch.len() >= shortest && roughness(stretch) <= ROUGHEST && is_light(stretch)
        });
        let cover: usize = stretches.iter().map(Vec::len).sum();
        let longest = stretches.iter().map(Vec::len).max().unwrap_or(0);
        let (cover, straight) = (cover as f32, on_one_line(&stretches, width) as f32);
        let crosses = cover >= MOST_COVER * width
            || straight >= STRAIGHT_COVER * width
            || (cover >= LEAST_COVER * width && straight >= STRAIGHT_SHARE_OF_COVER * cover);
        (crosses && longest as f32 >= LONGEST_STRETCH_SHARE * width).then_some(Self { stretches })
    }

    /// What speaks for this line: its significance, summed.
    pub fn weight(&self) -> f32 {
        self.stretches.iter().flatten().map(|point| point.candidate.significance.min(20.0)).sum()
    }

    /// Column, row and confidence of each point, samples.
    pub fn points(&self) -> impl Iterator<Item = (usize, f32, f32)> {
        self.stretches.iter().flat_map(|stretch| {
            stretch
                .iter()
                .enumerate()
                .map(|(index, point)| (point.column, point.row, confidence(bend(stretch, index))))
        })
    }
}

/// The probability that a point is right within one sample, from how far it lies from its neighbours' line.
///
/// Counted on 220,000 points of the twin's scenes, half of those that were looked at; on the other half it holds as well
/// (`FIGURES-VISION.md`). The contrast says nothing more: a weak point is on the line only because its neighbours are.
fn confidence(bend: f32) -> f32 {
    let small = bend.min(SMALL_BEND);
    let large = (bend.min(LARGEST_BEND) - SMALL_BEND).max(0.0);
    let log_odds = STRAIGHT_LOG_ODDS - SMALL_BEND_LOSS * small - LARGE_BEND_LOSS * large;
    1.0 / (1.0 + (-log_odds).exp())
}

/// How far a point lies from the straight line through its neighbours, samples; [`LARGEST_BEND`] where there are too few.
fn bend(stretch: &[Point], index: usize) -> f32 {
    let around = index.saturating_sub(NEIGHBOURS)..(index + NEIGHBOURS + 1).min(stretch.len());
    let here = stretch[index];
    let [mut count, mut x, mut y, mut xx, mut xy] = [0.0_f32; 5];
    for point in stretch[around.clone()].iter().zip(around).filter(|(_, other)| *other != index) {
        let (along, offset) = (point.0.column as f32 - here.column as f32, point.0.row - here.row);
        (count, x, y) = (count + 1.0, x + along, y + offset);
        (xx, xy) = (xx + along * along, xy + along * offset);
    }
    let spread = count * xx - x * x;
    if count < 3.0 || spread <= 0.0 {
        return LARGEST_BEND;
    }
    // The line's offset at the point itself.
    ((xx * y - x * xy) / spread).abs()
}

/// The middle between the two places where a ridge with a bleached core rises through half of its flanks' height, samples:
/// its colour is weaker in the core than beside it, so that a peak would be one of the flanks.
fn middle_of_bleached<S: Signal>(signal: S, column: usize, candidate: &Candidate) -> Option<f32> {
    let reach = 2 * candidate.half + 2;
    let first = candidate.row.checked_sub(reach)?;
    let last = candidate.row + reach;
    if last >= signal.rows() {
        return None;
    }
    let value = |row: usize| f32::from(signal.value(column, row));
    let highest = (first..=last).map(value).fold(f32::MIN, f32::max);
    let half = (highest + value(first).max(value(last))) / 2.0;
    // From outside, because the core may be below half again.
    let crossing = |outer: usize, inner: usize| {
        let share = (half - value(outer)) / (value(inner) - value(outer));
        outer as f32 + share * (inner as f32 - outer as f32)
    };
    let above = (first..last).find(|row| value(row + 1) >= half).map(|row| crossing(row, row + 1))?;
    let below =
        (first + 1..=last).rev().find(|row| value(row - 1) >= half).map(|row| crossing(row, row - 1))?;
    Some((above + below) / 2.0)
}

fn continues(stretch: &[Point], point: &Point) -> bool {
    stretch.last().is_some_and(|last| {
        let columns = point.column - last.column;
        columns <= HOLE + 1 && (point.row - last.row).abs() <= 1.5 + 1.5 * columns as f32
    })
}

/// Is it brightest in its middle, as a line of light is and a painted one is not? The thinnest lines cannot tell.
fn is_light(stretch: &[Point]) -> bool {
    let thin = stretch.iter().filter(|point| point.candidate.half == 1).count();
    if 2 * thin >= stretch.len() {
        return true;
    }
    let clipped = stretch.iter().filter(|point| point.candidate.clipped).count();
    let mut peakedness: Vec<f32> = stretch.iter().map(|point| point.candidate.peakedness).collect();
    let middle = peakedness.len() / 2;
    let (_, median, _) = peakedness.select_nth_unstable_by(middle, f32::total_cmp);
    *median >= LEAST_PEAKEDNESS || clipped as f32 >= CLIPPED_SHARE * stretch.len() as f32
}

/// How many points lie on the straight line with the most of them, in a picture of so many columns.
fn on_one_line(stretches: &[Vec<Point>], columns: f32) -> usize {
    let points: Vec<(f32, f32)> =
        stretches.iter().flatten().map(|point| (point.column as f32, point.row)).collect();
    let near = STRAIGHT_SAMPLES.max(STRAIGHT_SHARE * columns);
    let pillars: Vec<(f32, f32)> =
        points.iter().step_by(points.len() / STRAIGHT_TRIALS + 1).copied().collect();
    let mut most = 0;
    for (index, (column, row)) in pillars.iter().enumerate() {
        for (other_column, other_row) in &pillars[index + 1..] {
            let slope = (other_row - row) / (other_column - column);
            let lies_on = |point: &&(f32, f32)| (point.1 - row - slope * (point.0 - column)).abs() <= near;
            most = most.max(points.iter().filter(lies_on).count());
        }
    }
    most
}

/// Root mean square of each point's distance from the middle of its neighbours.
fn roughness(stretch: &[Point]) -> f32 {
    let bends = stretch.windows(3).filter_map(|points| match points {
        [before, here, after] => Some(here.row - (before.row + after.row) / 2.0),
        _ => None,
    });
    let (sum, count) = bends.fold((0.0, 0.0), |(sum, count), bend| (sum + bend * bend, count + 1.0_f32));
    (sum / count.max(1.0)).sqrt()
}

/// A state's best score, and the state of the column before that it comes from.
#[derive(Clone, Copy)]
struct Best {
    score: f32,
    from: usize,
}

/// For each column the candidate on the best line, `None` where it passes none. State 0 is "none", remembering nothing of
/// where the line was: a new stretch may begin anywhere.
fn best_line(columns: &[Vec<Candidate>]) -> Vec<Option<Candidate>> {
    let mut history: Vec<Vec<Best>> = Vec::with_capacity(columns.len());
    let mut scores = vec![0.0_f32];
    let mut before: &[Candidate] = &[];
    for candidates in columns {
        let best_of = |cost: &dyn Fn(usize) -> f32| {
            let mut best = Best { score: f32::MIN, from: 0 };
            for (state, score) in scores.iter().enumerate() {
                let total = score - cost(state);
                if total > best.score {
                    best = Best { score: total, from: state };
                }
            }
            best
        };
        let mut states = vec![best_of(&|state| if state == 0 { 0.0 } else { JUMP_COST / 2.0 })];
        for candidate in candidates {
            let best = best_of(&|state| match state.checked_sub(1).and_then(|index| before.get(index)) {
                None => JUMP_COST / 2.0,
                Some(other) => {
                    let step = candidate.row.abs_diff(other.row) as f32;
                    (STEP_COST * (step - FREE_STEP).max(0.0)).min(JUMP_COST)
                }
            });
            let earned = ((candidate.significance - NEUTRAL_SIGNIFICANCE) / NEUTRAL_SIGNIFICANCE)
                .clamp(*EARNINGS.start(), *EARNINGS.end());
            states.push(Best { score: best.score + earned, from: best.from });
        }
        scores = states.iter().map(|best| best.score).collect();
        history.push(states);
        before = candidates;
    }
    let mut state =
        (0..scores.len()).max_by(|one, other| scores[*one].total_cmp(&scores[*other])).unwrap_or(0);
    let mut line = vec![None; columns.len()];
    for (index, states) in history.iter().enumerate().rev() {
        line[index] = state.checked_sub(1).and_then(|candidate| columns[index].get(candidate)).copied();
        state = states[state].from;
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stretch(rows: &[f32]) -> Vec<Point> {
        let candidate = Candidate { row: 0, half: 2, significance: 20.0, peakedness: 0.1, clipped: false };
        rows.iter().enumerate().map(|(column, row)| Point { column, candidate, row: *row }).collect()
    }

    #[test]
    fn a_point_is_believed_as_far_as_it_lies_on_its_neighbours_line() {
        let mut rows: Vec<f32> = (0..20).map(|column| 40.0 + 0.3 * column as f32).collect();
        let sure = confidence(bend(&stretch(&rows), 10));
        assert!(sure > 0.995, "a straight slope: {sure}");
        rows[10] += 0.5;
        let doubtful = confidence(bend(&stretch(&rows), 10));
        assert!((0.85..0.98).contains(&doubtful), "half a sample aside: {doubtful}");
        rows[10] += 1.0;
        let unsure = confidence(bend(&stretch(&rows), 10));
        assert!((0.4..0.65).contains(&unsure), "one and a half: {unsure}");
    }

    #[test]
    fn points_on_one_line_are_counted_over_jumps_and_not_along_a_bend() {
        let straight: Vec<f32> = (0..300).map(|column| 40.0 + 0.2 * column as f32).collect();
        let mut raised = straight.clone();
        raised[100..150].iter_mut().for_each(|row| *row += 30.0);
        assert_eq!(on_one_line(&[stretch(&straight)], 300.0), 300);
        assert_eq!(on_one_line(&[stretch(&raised)], 300.0), 250);
        let hanging: Vec<f32> = (0..300).map(|column| 0.004 * (column as f32 - 150.0).powi(2)).collect();
        let most = on_one_line(&[stretch(&hanging)], 300.0);
        assert!(most < 90, "{most} of 300 points of a bend lie on one line");
        assert_eq!(on_one_line(&[], 300.0), 0);
    }

    #[test]
    fn a_point_without_neighbours_is_an_even_bet() {
        assert_eq!(bend(&stretch(&[3.0, 3.0, 3.0]), 1), LARGEST_BEND);
    }
}
