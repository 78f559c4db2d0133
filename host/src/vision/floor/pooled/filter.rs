//! The matched filter: what each column answers at the stripe's rows, and at rows aside.

use super::super::strip::MOST_ASIDE;
use super::{Answer, MOST_NEAR, PLACES, PLACES_ASIDE, Pool, VOIDS};
use crate::vision::grid::{Grid, GridColumn};
use crate::vision::ridge::Kernel;
use crate::vision::signal::RowSearch;

/// Columns that are weighed at a time.
const LANES: usize = 32;
/// Steps of the row's fraction for which there is a profile.
const PHASES: usize = 4;
/// A ground more red than this, as a share of its brightness, is not corrected for more.
const MOST_RED: f32 = 0.5;

/// The filter for some columns: a stripe's profile, and where the background beside it is.
#[derive(Debug, Clone, Copy)]
struct Filter {
    near: usize,
    far: usize,
    /// Rows from one place to the next.
    step: isize,
    profiles: [[f32; 2 * MOST_NEAR + 1]; PHASES],
    /// From the sum to the height of the mean over the usual kernel.
    scale: f32,
}

impl Filter {
    fn new(place: &GridColumn) -> Self {
        let kernel = Kernel::for_width(place.width);
        let near = kernel.near.min(MOST_NEAR);
        // Full width at half of a normal curve's height, in standard deviations.
        let deviation = place.width.clamp(1.5, 18.0) / 2.355;
        let bell = |distance: f32| (-0.5 * (distance / deviation).powi(2)).exp();
        let mut profiles = [[0.0; 2 * MOST_NEAR + 1]; PHASES];
        for (phase, profile) in profiles.iter_mut().enumerate() {
            let middle = MOST_NEAR as f32 + (phase as f32 + 0.5) / PHASES as f32 - 0.5;
            for (row, value) in profile.iter_mut().enumerate() {
                let aside = row.abs_diff(MOST_NEAR);
                *value = if aside < near { bell(row as f32 - middle) } else { 0.0 };
            }
        }
        let square: f32 = profiles[PHASES / 2].iter().map(|value| value * value).sum();
        let half = kernel.half as isize;
        let mean = (-half..=half).map(|row| bell(row as f32)).sum::<f32>() / kernel.length() as f32;
        let far = near + kernel.length().clamp(3, 8);
        let most_step = (MOST_ASIDE - far - 1) / PLACES_ASIDE;
        Self {
            near,
            far,
            step: (place.tolerance.ceil() as usize / PLACES_ASIDE).clamp(1, most_step) as isize,
            profiles,
            scale: mean / square,
        }
    }

    /// Rows aside at which the filter does not see the stripe.
    fn voids(&self) -> [isize; VOIDS] {
        let most = MOST_ASIDE - self.far - 1;
        let (first, second) =
            ((self.near + self.far).min(most), (self.near + self.far + self.near).min(most));
        let (first, second) = (first as isize, second as isize);
        [first, second, -first, -second]
    }
}

impl Pool {
    /// Weighs the columns of a range.
    pub(super) fn weigh<S: RowSearch>(&mut self, signal: S, grid: &Grid, range: std::ops::Range<usize>) {
        let mut first = range.start;
        while first < range.end {
            let count = (range.end - first).min(LANES);
            let places = &grid.columns()[first..first + count];
            let filter = Filter::new(&places[count / 2]);
            for number in 0..PLACES {
                let row = (number as isize - PLACES_ASIDE as isize) * filter.step;
                self.answer(places, first, &filter, row, |answer, height, uneven| {
                    answer.places[number] = height;
                    if row == 0 {
                        answer.uneven = uneven;
                    }
                });
            }
            for (number, row) in filter.voids().into_iter().enumerate() {
                self.answer(places, first, &filter, row, |answer, height, _| answer.voids[number] = height);
            }
            for index in first..first + count {
                self.answers[index].hidden = self.hidden(signal, grid, index, &filter);
            }
            for answer in &mut self.answers[first..first + count] {
                (answer.step, answer.known) = (filter.step as f32, true);
            }
            first += count;
        }
    }

    /// The filter's answer at one row of some columns.
    fn answer(
        &mut self,
        places: &[GridColumn],
        first: usize,
        filter: &Filter,
        row: isize,
        take: impl Fn(&mut Answer, f32, f32),
    ) {
        let count = places.len();
        let (near, far) = (filter.near as isize, filter.far as isize);
        let mut sums = [[0.0_f32; LANES]; 4];
        let [core, weight, above, below] = &mut sums;
        let mut phases = [0_usize; LANES];
        for (phase, place) in phases.iter_mut().zip(places) {
            let fraction = place.floor_row - place.floor_row.round() + 0.5;
            *phase = ((fraction * PHASES as f32) as usize).min(PHASES - 1);
        }
        for aside in 1 - near..near {
            let samples = &self.strip.row(row + aside)[first..first + count];
            let at = (aside + MOST_NEAR as isize) as usize;
            for (lane, sample) in samples.iter().enumerate() {
                let factor = filter.profiles[phases[lane]][at];
                core[lane] += factor * f32::from(*sample);
                weight[lane] += factor;
            }
        }
        for aside in near..far {
            for (sum, sign) in [(&mut *above, -1), (&mut *below, 1)] {
                let samples = &self.strip.row(row + sign * aside)[first..first + count];
                for (sum, sample) in sum.iter_mut().zip(samples) {
                    *sum += f32::from(*sample);
                }
            }
        }
        let length = (far - near) as f32;
        for (lane, answer) in self.answers[first..first + count].iter_mut().enumerate() {
            let (above, below) = (above[lane] / length, below[lane] / length);
            let height = (core[lane] - weight[lane] * (above + below) / 2.0) * filter.scale;
            take(answer, height, (below - above) * weight[lane] * filter.scale);
        }
    }

    /// How much less red than beside it the ground under the stripe is for being darker, if it is of one colour. The laser
    /// darkens green a little itself, which then counts for it.
    fn hidden<S: RowSearch>(&self, signal: S, grid: &Grid, index: usize, filter: &Filter) -> f32 {
        let (near, far) = (filter.near as isize, filter.far as isize);
        let middle = grid.columns()[index].nearest_row;
        let tone = |aside: isize| {
            f32::from(signal.tone(grid.first() + index, middle.saturating_add(aside).max(0) as usize))
        };
        let value = |aside: isize| f32::from(self.strip.row(aside)[index]);
        let beside = |of: &dyn Fn(isize) -> f32| {
            (near..far).map(|aside| of(aside) + of(-aside)).sum::<f32>() / (2 * (far - near)) as f32
        };
        let (red, bright) = (beside(&value), beside(&tone));
        if red <= 0.0 || bright <= 0.0 {
            return 0.0;
        }
        let profile = &filter.profiles[PHASES / 2];
        let dip: f32 = (1 - near..near)
            .map(|aside| profile[(aside + MOST_NEAR as isize) as usize] * (bright - tone(aside)))
            .sum();
        (red / bright).min(MOST_RED) * (dip * filter.scale).max(0.0)
    }
}
