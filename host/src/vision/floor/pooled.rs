//! Weak stretches, measured together with their neighbours along the stripe.
//!
//! Where sunlight or distance leaves a column little contrast, the eye still sees the stripe, because it sees many
//! columns at once. So does this: each column is weighed with the profile that the rig predicts at the row where the
//! stripe must be (a matched filter, linear, so that noise of either sign cancels in sums), and the answers are
//! averaged along the stripe over less than the shortest gap that must be seen. How much such averages vary where
//! there is no stripe is measured in the picture itself, by the same filter at rows aside. An end of the stripe is
//! where the average has fallen to half of what it is beside, so that averaging moves none.

mod filter;
mod statistics;
#[cfg(test)]
mod tests;

use statistics::{deviation, vertex};

use super::elsewhere::strongest_beside;
use super::straight::LastEdge;
use super::strip::Strip;
use super::unpainted;
use super::{FRINGE_SHARE, FloorColumn, FloorFinder, GONE_SHARE, SURE_CONTRAST, pitch};
use crate::vision::grid::Grid;
use crate::vision::peak::Peak;
use crate::vision::signal::RowSearch;

/// Columns with less contrast than this are pooled, in standard deviations.
const WEAK_CONTRAST: f32 = 2.0 * SURE_CONTRAST;
/// Length of the stripe that is averaged, millimetres; the shortest gap that must be seen is 7.
const POOLED_MM: f32 = 4.0;
/// What an average must be to be sure, in standard deviations of such averages. Less than for single columns: there
/// are fewer of them, and chance must make several side by side to hide a gap.
const SURE_AVERAGE: f32 = 3.5;
/// An end of the stripe is where the average falls to this share of the level beside it.
const END_SHARE: f32 = 0.5;
/// Light that a thing throws on the floor reaches this share of the stripe around it ...
const GLOW_OF_SURE: f32 = 0.08;
/// ... which is what the surely lit columns within this distance have on average, millimetres.
const AROUND_MM: f32 = 120.0;
/// Grounds that differ by no more than so many levels, in the laser's colour and brightness together, are the same.
const SAME_GROUND: f32 = 25.0;
/// What is less than this share of a ridge just beside is the foot of that ridge: of the stripe on a thing.
const FOOT_SHARE: f32 = 0.2;
/// Allowance for chance where answers are compared, in standard deviations of averages.
const CHANCE: f32 = 1.5;
/// The level beside a column is the median of the averages at these distances, millimetres.
const LEVEL_MM: [f32; 5] = [3.0, 6.0, 9.0, 12.0, 15.0];
/// One bright column (on the paint beside) counts no more than so many times the level.
const MOST_OF_LEVEL: f32 = 1.5;
/// The variation of averages is taken over this length on both sides, millimetres.
const VARIATION_MM: f32 = 25.0;
/// ... at every so manieth column.
const VARIATION_STRIDE: usize = 8;
/// How far the stripe lies from the floor's row, calibration being what it is, is the same over this length on both
/// sides, millimetres.
const OFFSET_MM: f32 = 30.0;
/// Half of the places across the stripe at which it is looked for.
const PLACES_ASIDE: usize = 2;
const PLACES: usize = 2 * PLACES_ASIDE + 1;
/// Rows aside at which there is no stripe.
const VOIDS: usize = 4;
/// A quarter of the magnitudes of normal values are smaller, in standard deviations.
const QUARTER_MAGNITUDE: f32 = 0.3186;
/// Backgrounds of the two sides that differ by more than so many standard deviations are those of two surfaces.
const UNEVEN: f32 = 5.0;
/// The least variation that is believed, levels: see `LEAST_NOISE`; an average hides less of it.
const LEAST_VARIATION: f32 = 0.25;
/// Most rows to each side that a profile has.
const MOST_NEAR: usize = 12;

/// What the filter answers in one column.
#[derive(Debug, Clone, Copy, Default)]
struct Answer {
    /// Around the floor's row.
    places: [f32; PLACES],
    /// Aside.
    voids: [f32; VOIDS],
    /// What the ground's own colour hides of the stripe: where the ground is darker (a joint, a stain), it is less red.
    hidden: f32,
    /// Background below minus above.
    uneven: f32,
    /// That is more than chance.
    is_uneven: bool,
    /// Rows from one place to the next.
    step: f32,
    /// It is filled in.
    known: bool,
}

/// Working memory.
#[derive(Debug, Clone)]
pub(super) struct Pool {
    pub(super) strip: Strip,
    /// The edge of a paint that was looked for last.
    pub(super) edges: LastEdge,
    /// Columns in which the stripe was seen beside an edge.
    pub(super) seen: Vec<bool>,
    answers: Vec<Answer>,
    /// Answers at the stripe's row.
    heights: Vec<f32>,
    /// Averages of them, and of the answers aside.
    averages: Vec<f32>,
    voids: Vec<[f32; VOIDS]>,
    offsets: Vec<f32>,
    some: Vec<f32>,
}

impl Pool {
    pub(super) fn new(columns: usize) -> Self {
        Self {
            strip: Strip::new(columns),
            edges: LastEdge::NONE,
            seen: vec![false; columns],
            answers: vec![Answer::default(); columns],
            heights: vec![0.0; columns],
            averages: vec![0.0; columns],
            voids: vec![[0.0; VOIDS]; columns],
            offsets: vec![0.0; columns],
            some: Vec::with_capacity(VOIDS * columns.max(1)),
        }
    }

    /// Forgets the last picture.
    pub(super) fn clear(&mut self) {
        self.strip.clear();
        self.edges = LastEdge::NONE;
    }
}

impl FloorFinder {
    /// Measures the columns of weak stretches again, each together with its neighbours along the stripe.
    pub(super) fn strengthen<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        let is_weak = |column: &FloorColumn| column.significance() < WEAK_CONTRAST;
        let Some(first) = self.columns.iter().position(is_weak) else { return };
        self.pool.answers.fill(Answer::default());
        let aside_mm = LEVEL_MM[LEVEL_MM.len() - 1] + POOLED_MM;
        let mut start = first;
        while let Some(offset) = self.columns.get(start..).and_then(|rest| rest.iter().position(is_weak)) {
            let from = start + offset;
            let to = self.columns[from..].iter().position(|column| !is_weak(column));
            let to = to.map_or(self.columns.len(), |length| from + length);
            let aside = |index: usize| (aside_mm / pitch(grid, index).max(0.05)).ceil() as usize;
            let range = from.saturating_sub(aside(from))..(to + aside(to - 1)).min(self.columns.len());
            self.pool.strip.fill(signal, grid, range.clone());
            self.pool.weigh(signal, grid, range);
            start = to;
        }
        self.pool.find_offsets(grid);
        self.pool.average(grid);
        self.judge_weak(signal, grid);
    }

    /// Running sums of the contrast and the number of the surely lit columns.
    fn sum_up_sure(&mut self) {
        let (mut contrast, mut count) = (0.0, 0.0);
        let sums = self.scratch.iter_mut().zip(&mut self.pooled);
        for ((contrasts, counts), column) in sums.zip(&self.columns) {
            if column.significance() >= WEAK_CONTRAST {
                (contrast, count) = (contrast + column.contrast(), count + 1.0);
            }
            (*contrasts, *counts) = (contrast, count);
        }
    }

    /// Mean contrast of the surely lit columns around one; zero where there are none.
    fn sure_around(&self, grid: &Grid, index: usize) -> f32 {
        let columns = (AROUND_MM / pitch(grid, index).max(0.05)) as usize;
        let (first, last) = (index.saturating_sub(columns), (index + columns).min(self.columns.len() - 1));
        let count = self.pooled[last] - self.pooled[first];
        if count > 0.0 { (self.scratch[last] - self.scratch[first]) / count } else { 0.0 }
    }

    /// The same of those around that lie on the ground of this column; zero where there are none.
    fn sure_on_this_ground<S: RowSearch>(&self, signal: S, grid: &Grid, index: usize) -> f32 {
        let columns = (AROUND_MM / pitch(grid, index).max(0.05)) as usize;
        let ground = |index: usize| {
            let [above, below] = unpainted::grounds(signal, grid, index, grid.columns()[index].width);
            [f32::midpoint(above[0], below[0]), f32::midpoint(above[1], below[1])]
        };
        let here = ground(index);
        let (mut contrast, mut count) = (0.0, 0.0);
        for other in index.saturating_sub(columns)..(index + columns + 1).min(self.columns.len()) {
            // Running sums grow by one at every sure column.
            let before = other.checked_sub(1).map_or(0.0, |before| self.pooled[before]);
            if self.pooled[other] > before {
                let there = ground(other);
                if (there[0] - here[0]).hypot(there[1] - here[1]) <= SAME_GROUND {
                    let first = other.checked_sub(1).map_or(0.0, |before| self.scratch[before]);
                    (contrast, count) = (contrast + self.scratch[other] - first, count + 1.0);
                }
            }
        }
        if count > 0.0 { contrast / count } else { 0.0 }
    }

    fn judge_weak<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        self.sum_up_sure();
        let mut of_averages = f32::INFINITY;
        let mut measured_at = usize::MAX;
        for index in 0..self.columns.len() {
            let column = &self.columns[index];
            if column.significance() >= WEAK_CONTRAST
                || !self.pool.answers[index].known
                || column.noise.is_infinite()
            {
                continue;
            }
            if index / VARIATION_STRIDE != measured_at {
                measured_at = index / VARIATION_STRIDE;
                of_averages = self.pool.variation(grid, index);
            }
            let place = &grid.columns()[index];
            let sure = SURE_AVERAGE * of_averages;
            let [level, highest] = self.pool.level(grid, index);
            let average = self.pool.capped_average(grid, index, MOST_OF_LEVEL * level.max(sure));
            let uneven = self.pool.answers[index].is_uneven;
            let beside = (END_SHARE * level).max(GONE_SHARE * highest);
            let mut glow = GLOW_OF_SURE * self.sure_around(grid, index);
            if (sure.max(beside)..glow).contains(&average) {
                // It hangs on what the stripe around is: on another ground it may be that much brighter.
                glow = GLOW_OF_SURE * self.sure_on_this_ground(signal, grid, index);
            }
            let least = sure.max(beside).max(glow);
            let lit = average >= least
                && self.pool.is_narrow(grid, index, average, of_averages)
                && average >= FOOT_SHARE * strongest_beside(signal, grid.first() + index, place);
            let peak = Peak {
                row: place.floor_row + self.pool.offsets[index],
                contrast: average,
                rise: average,
                width: place.width,
            };
            if lit && self.pool.is_fringe(signal, grid, index, &peak) {
                continue;
            }
            let noise = of_averages * SURE_AVERAGE / SURE_CONTRAST;
            // Where the rows aside vary more than what is right beside the stripe (something lies there), the average's
            // own variation is not known: then the column speaks for itself.
            let is_unsure = average < sure && average >= beside.max(glow) && noise > column.noise;
            if is_unsure && column.significance() >= SURE_CONTRAST {
                continue;
            }
            let column = &mut self.columns[index];
            if lit && (average / noise > column.significance() || !column.is_at(place)) {
                (column.peak, column.noise) = (Some(peak), noise);
            }
            if lit || !uneven {
                column.pooled = Some(lit);
            }
        }
    }
}

impl Pool {
    /// Columns within so many millimetres on both sides that are filled in.
    fn around(&self, grid: &Grid, index: usize, mm: f32) -> std::ops::Range<usize> {
        let columns = (mm / pitch(grid, index).max(0.05)) as usize;
        let known = |answer: &&Answer| answer.known;
        let before =
            self.answers[index.saturating_sub(columns)..index].iter().rev().take_while(known).count();
        let end = (index + columns + 1).min(self.answers.len());
        let after = self.answers[index..end].iter().take_while(known).count();
        index - before..index + after
    }

    /// Where the stripe lies relative to the floor's row, and its height there.
    fn find_offsets(&mut self, grid: &Grid) {
        let mut sums = [0.0; PLACES];
        let mut summed: std::ops::Range<usize> = 0..0;
        let mut of_sides = 0.0;
        for index in 0..self.answers.len() {
            if !self.answers[index].known {
                continue;
            }
            if index % VARIATION_STRIDE == 0 || summed.is_empty() || !self.answers[index - 1].known {
                summed = self.around(grid, index, OFFSET_MM);
                of_sides = self.variation_of_sides(summed.clone());
                sums = [0.0; PLACES];
                let limit = UNEVEN * of_sides;
                for answer in
                    self.answers[summed.clone()].iter().filter(|answer| answer.uneven.abs() <= limit)
                {
                    // One bright paint must not outvote the rest.
                    let most = answer.places.iter().fold(1.0_f32, |most, height| most.max(*height));
                    for (sum, height) in sums.iter_mut().zip(answer.places) {
                        *sum += height / most.sqrt();
                    }
                }
            }
            let (place, answer) = (&grid.columns()[index], &self.answers[index]);
            let offset = (vertex(&sums) * answer.step).clamp(-place.tolerance, place.tolerance);
            self.offsets[index] = offset;
            let at = offset / answer.step + PLACES_ASIDE as f32;
            let lower = (at.floor().max(0.0) as usize).min(PLACES - 2);
            let share = at - lower as f32;
            let [one, other] = [answer.places[lower], answer.places[lower + 1]];
            self.heights[index] = one + share * (other - one) + answer.hidden;
            let is_uneven = answer.uneven.abs() > UNEVEN * of_sides;
            if is_uneven {
                // It must stand out from the higher of two unlike backgrounds, as everywhere.
                self.heights[index] = (self.heights[index] - answer.uneven.abs() / 2.0).max(0.0);
            }
            self.answers[index].is_uneven = is_uneven;
        }
    }

    fn average(&mut self, grid: &Grid) {
        for index in 0..self.answers.len() {
            if !self.answers[index].known {
                continue;
            }
            let (mut weights, mut height, mut voids) = (0.0, 0.0, [0.0; VOIDS]);
            self.for_pooled(grid, index, |other, weight| {
                weights += weight;
                height += weight * self.heights[other];
                for (sum, value) in voids.iter_mut().zip(self.answers[other].voids) {
                    *sum += weight * value;
                }
            });
            self.averages[index] = height / weights;
            self.voids[index] = voids.map(|sum| sum / weights);
        }
    }

    /// The columns that are averaged for one, each with its share of [`POOLED_MM`].
    fn for_pooled(&self, grid: &Grid, index: usize, mut take: impl FnMut(usize, f32)) {
        let pitch = pitch(grid, index).max(0.05);
        let reach = POOLED_MM / 2.0 / pitch;
        let columns = (reach + 0.5) as usize;
        let first = index.saturating_sub(columns);
        let end = (index + columns + 1).min(self.answers.len());
        for other in first..end {
            let weight = (reach + 0.5 - other.abs_diff(index) as f32).clamp(0.0, 1.0);
            if self.answers[other].known && weight > 0.0 {
                take(other, weight);
            }
        }
    }

    fn capped_average(&self, grid: &Grid, index: usize, most: f32) -> f32 {
        let (mut weights, mut sum) = (0.0, 0.0);
        self.for_pooled(grid, index, |other, weight| {
            weights += weight;
            sum += weight * self.heights[other].min(most);
        });
        sum / weights
    }

    /// As [`super::is_fringe`], of averages.
    fn is_fringe<S: RowSearch>(&self, signal: S, grid: &Grid, index: usize, peak: &Peak) -> bool {
        let near = ((peak.width / 2.0).ceil() as usize + 1).min(MOST_NEAR);
        let mut tones = [0.0_f32; 2 * MOST_NEAR + 1];
        let tones = &mut tones[..=2 * near];
        let mut weights = 0.0;
        self.for_pooled(grid, index, |other, weight| {
            let crest = (grid.columns()[other].floor_row + self.offsets[other]).round().max(0.0) as usize;
            for (row, tone) in tones.iter_mut().enumerate() {
                *tone +=
                    weight * f32::from(signal.tone(grid.first() + other, (crest + row).saturating_sub(near)));
            }
            weights += weight;
        });
        let (low, high) =
            tones.iter().fold((f32::MAX, f32::MIN), |(low, high), tone| (low.min(*tone), high.max(*tone)));
        peak.contrast < FRINGE_SHARE * (high - low) / weights
    }

    /// Does the filter answer less above and below, as for a stripe, rather than the same, as for a glow? What chance adds
    /// is allowed for.
    fn is_narrow(&self, grid: &Grid, index: usize, average: f32, of_averages: f32) -> bool {
        let (mut weights, mut sum) = (0.0, 0.0);
        self.for_pooled(grid, index, |other, weight| {
            let [first, .., last] = self.answers[other].places;
            weights += weight;
            sum += weight * (first + last) / 2.0;
        });
        let deviation = grid.columns()[index].width.clamp(1.5, 18.0) / 2.355;
        let distance = PLACES_ASIDE as f32 * self.answers[index].step / deviation;
        let of_stripe = (-0.25 * distance * distance).exp();
        sum / weights <= f32::midpoint(1.0, of_stripe) * average + CHANCE * of_averages
    }

    /// The level of the stripe beside a column: that of the weaker side, and of the stronger.
    fn level(&self, grid: &Grid, index: usize) -> [f32; 2] {
        let pitch = pitch(grid, index).max(0.05);
        let mut levels = [f32::INFINITY; 2];
        for (level, right) in levels.iter_mut().zip([false, true]) {
            let mut values = [f32::INFINITY; LEVEL_MM.len()];
            let mut count = 0;
            for distance in LEVEL_MM {
                let columns = (distance / pitch).round().max(1.0) as usize;
                let other = if right { Some(index + columns) } else { index.checked_sub(columns) };
                if let Some(other) =
                    other.filter(|other| self.answers.get(*other).is_some_and(|answer| answer.known))
                {
                    values[count] = self.averages[other];
                    count += 1;
                }
            }
            // A side with next to nothing of it in the picture tells nothing.
            if count > LEVEL_MM.len() / 2 {
                let (_, median, _) = values[..count].select_nth_unstable_by(count / 2, f32::total_cmp);
                *level = *median;
            }
        }
        let known = levels.into_iter().filter(|level| level.is_finite());
        let (low, high) =
            known.fold((f32::INFINITY, 0.0), |(low, high), level| (level.min(low), level.max(high)));
        [if low.is_finite() { low.max(0.0) } else { 0.0 }, high]
    }

    /// Standard deviation of averages where there is no stripe, on the quieter side: the edge of a paint that runs along the
    /// stripe lies on one.
    fn variation(&mut self, grid: &Grid, index: usize) -> f32 {
        let range = self.around(grid, index, VARIATION_MM);
        let mut quieter = f32::INFINITY;
        for side in [0..VOIDS / 2, VOIDS / 2..VOIDS] {
            self.some.clear();
            let voids = self.voids[range.clone()].iter().flat_map(|voids| &voids[side.clone()]);
            self.some.extend(voids.map(|value| value.abs()));
            quieter = quieter.min(deviation(&mut self.some));
        }
        quieter.max(LEAST_VARIATION)
    }

    /// Standard deviation of the difference of the two sides' backgrounds on one surface.
    fn variation_of_sides(&mut self, range: std::ops::Range<usize>) -> f32 {
        self.some.clear();
        self.some.extend(self.answers[range].iter().map(|answer| answer.uneven.abs()));
        let quiet = self.some.len() / 4;
        if quiet == 0 {
            return f32::INFINITY;
        }
        // Edges may cross most of the columns.
        let (_, quarter, _) = self.some.select_nth_unstable_by(quiet, f32::total_cmp);
        (*quarter / QUARTER_MAGNITUDE).max(LEAST_VARIATION)
    }
}
