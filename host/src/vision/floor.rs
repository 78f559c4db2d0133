//! Is the stripe lit on the floor in this column, and at which row exactly?
//!
//! The rig says where the stripe on a free floor must appear, so a dim stripe is only asked for at one place, where
//! little contrast proves it. What counts as enough is measured in the picture itself: the contrast must exceed what
//! texture and noise reach just beside the stripe. Where the whole stripe is weak, neighbouring columns are averaged,
//! over a fraction of what a gap may be long; and an end of the stripe is where its contrast has fallen to half, so
//! that averaging moves none.

use super::grid::{Grid, GridColumn};
use super::peak::{self, Kernel, Peak};
use super::signal::Signal;

/// Contrast in standard deviations of the background's running mean from which on a column is lit. The smallest
/// quality that counts on the MCU stands for it.
pub const SURE_CONTRAST: f32 = 5.0;
/// The same for columns between two that are sure.
const BETWEEN_CONTRAST: f32 = 2.5;
/// Lens, sensor and image processor spread a bright column over its neighbours: where the stripe ends, its contrast
/// falls over several columns. The end is where it has fallen to half, so a column with less than this share of the
/// strongest contrast within [`SPREAD_COLUMNS`] is beyond the end.
const SPREAD_SHARE: f32 = 0.5;
/// Speckle, grout and dark spots dip below that share too, but not far: only where the contrast falls below this share
/// has the stripe ended. A gap of 7 mm still gets there with 2 mm to a column.
const GONE_SHARE: f32 = 0.15;
/// How far back to look for the strongest contrast, samples. Farther, and the bright side of a paint's edge would
/// darken the dark one.
const SPREAD_COLUMNS: usize = 3;
/// Where speckle leaves columns weak between two that are sure, they are believed up to this length, millimetres.
const BRIDGED_MM: f32 = 1.0;
/// A glow (light that a glossy thing throws on the floor) is wider than the stripe, more than this many times its
/// usual width ...
const GLOW_WIDTH: f32 = 2.0;
/// ... and dimmer than this share of its usual contrast.
const GLOW_SHARE: f32 = 0.5;
/// Columns are averaged where the stripe around is weaker than this, in standard deviations ...
const WEAK_CONTRAST: f32 = 2.0 * SURE_CONTRAST;
/// ... over so many millimetres on both sides.
const AVERAGED_MM: f32 = 1.0;
/// Averaged columns vary together, several at a time, so that chance makes a whole stretch: they must stand out more.
const AVERAGED_PENALTY: f32 = 1.3;
/// ... but never over more columns on each side.
const MOST_AVERAGED: usize = 4;
/// The background's variation is pooled over this many columns on both sides.
const POOLED_COLUMNS: usize = 16;
/// Variation below this is not believed (levels of the running mean): quantisation and compression hide it, and leave
/// ripples of a few levels themselves.
const LEAST_NOISE: f32 = 0.8;
/// The background's variation is measured in every so manieth column: it is pooled anyway.
const NOISE_STRIDE: usize = 8;

/// One column's finding. Rows are rows of samples.
#[derive(Debug, Clone, Copy)]
pub struct FloorColumn {
    /// The ridge at the floor's place, its row within the picture; `None` where nothing stands out.
    pub peak: Option<Peak>,
    /// Standard deviation of the background's running mean.
    pub noise: f32,
    /// Row averaged over neighbours where the signal is weak; NaN where the stripe is not lit.
    pub row: f32,
    /// The stripe is lit here, at the floor's row.
    pub lit: bool,
}

impl FloorColumn {
    const UNKNOWN: Self = Self { peak: None, noise: f32::NAN, row: f32::NAN, lit: false };

    /// Contrast in standard deviations; zero where there is none.
    #[must_use]
    pub fn significance(&self) -> f32 {
        self.peak.map_or(0.0, |peak| peak.contrast / self.noise)
    }

    fn contrast(&self) -> f32 {
        self.peak.map_or(0.0, |peak| peak.contrast)
    }
}

/// Colour that demosaicing, sharpening and the lens give to an edge between bright and dark, as a share of the step;
/// 10 % is the most that was seen.
const FRINGE_SHARE: f32 = 0.12;
/// The full step of brightness.
const WHOLE_STEP: f32 = 255.0;

/// Is a ridge no more than the colour fringe of an edge between bright and dark (grout, a board's squares)?
pub fn is_fringe<S: Signal>(signal: S, column: usize, peak: &Peak) -> bool {
    if peak.contrast >= FRINGE_SHARE * WHOLE_STEP {
        return false;
    }
    let near = Kernel::for_step(S::STEP).near;
    let crest = peak.row.round().max(0.0) as usize;
    let tones = (crest.saturating_sub(near)..(crest + near + 1).min(signal.rows()))
        .map(|row| signal.tone(column, row));
    let (low, high) = tones.fold((i16::MAX, i16::MIN), |(low, high), tone| (low.min(tone), high.max(tone)));
    peak.contrast < FRINGE_SHARE * f32::from(high.saturating_sub(low))
}

/// The ridge at the floor's row of one column of `signal`, unless it is a colour fringe of the `picture`.
fn find<S: Signal, P: Signal>(signal: S, picture: P, column: usize, place: &GridColumn) -> Option<Peak> {
    let centre = row_within(signal.rows(), place)?;
    let reach = place.tolerance.ceil() as usize + 1;
    peak::find(signal, column, centre, reach, true).filter(|peak| !is_fringe(picture, column, peak))
}

/// The background's variation in one of every [`NOISE_STRIDE`] columns; NaN in the others.
fn noise_of<S: Signal>(signal: S, column: usize, place: &GridColumn, index: usize) -> f32 {
    match row_within(signal.rows(), place) {
        Some(centre) if index.is_multiple_of(NOISE_STRIDE) => peak::roughness(signal, column, centre),
        _ => f32::NAN,
    }
}

fn row_within(rows: usize, place: &GridColumn) -> Option<usize> {
    let row = place.floor_row.round();
    (row >= 0.0 && row < rows as f32).then_some(row as usize)
}

/// Mean of the values within [`POOLED_COLUMNS`] on both sides that are not NaN; infinite where there are none, so
/// that nothing is significant against it.
fn pool(values: &[f32], pooled: &mut [f32]) {
    let (mut sum, mut count, mut first, mut end) = (0.0_f64, 0_u32, 0, 0);
    for (index, mean) in pooled.iter_mut().enumerate() {
        while end < values.len().min(index + POOLED_COLUMNS + 1) {
            if !values[end].is_nan() {
                (sum, count) = (sum + f64::from(values[end]), count + 1);
            }
            end += 1;
        }
        while first + POOLED_COLUMNS < index {
            if !values[first].is_nan() {
                (sum, count) = (sum - f64::from(values[first]), count - 1);
            }
            first += 1;
        }
        *mean = if count == 0 { f32::INFINITY } else { (sum / f64::from(count)) as f32 };
    }
}

/// A picture averaged along the floor's stripe: each sample with those that lie [`AVERAGED_MM`] before and after it at
/// the same distance from the stripe.
#[derive(Clone, Copy)]
struct Averaged<'a, S> {
    signal: S,
    grid: &'a Grid,
    /// The grid's column that is looked at.
    index: usize,
}

impl<S: Signal> Signal for Averaged<'_, S> {
    const STEP: usize = S::STEP;

    fn columns(&self) -> usize {
        self.signal.columns()
    }

    fn rows(&self) -> usize {
        self.signal.rows()
    }

    fn value(&self, _column: usize, row: usize) -> i16 {
        let columns = self.grid.columns();
        let Some(here) = columns.get(self.index) else { return 0 };
        let (mut sum, mut count) = (0_i32, 0_i32);
        for other in self.index.saturating_sub(MOST_AVERAGED)..=self.index + MOST_AVERAGED {
            let Some(place) = columns.get(other) else { break };
            if (place.place - here.place).abs() <= AVERAGED_MM {
                let shifted = row as f32 + place.floor_row.round() - here.floor_row.round();
                sum += i32::from(self.signal.value(self.grid.first() + other, shifted.max(0.0) as usize));
                count += 1;
            }
        }
        // Rounded to the nearest, also below zero.
        ((2 * sum + count).div_euclid(2 * count.max(1))) as i16
    }

    fn tone(&self, column: usize, row: usize) -> i16 {
        self.signal.tone(column, row)
    }

    fn is_clipped(&self, column: usize, row: usize) -> bool {
        self.signal.is_clipped(column, row)
    }

    fn glow(&self, column: usize, row: usize) -> i16 {
        self.signal.glow(column, row)
    }
}

/// The runs of columns that are not lit, each with its part of `values`.
fn runs<'a>(
    columns: &'a mut [FloorColumn],
    values: &'a [f32],
) -> impl Iterator<Item = (&'a mut [FloorColumn], &'a [f32])> {
    let mut rest = values;
    columns.chunk_by_mut(|one, other| one.lit == other.lit).filter_map(move |run| {
        let (shares, after) = rest.split_at(run.len());
        rest = after;
        run.first().is_some_and(|column| !column.lit).then_some((run, shares))
    })
}

/// Finds the floor's stripe in all columns of a grid; owns its memory.
#[derive(Debug, Clone)]
pub struct FloorFinder {
    columns: Vec<FloorColumn>,
    scratch: Vec<f32>,
    pooled: Vec<f32>,
    usual: UsualStripe,
}

/// What the stripe looks like in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UsualStripe {
    /// Mean width, samples; infinite if no stripe is surely seen.
    pub width: f32,
    /// Mean contrast; zero if no stripe is surely seen.
    pub contrast: f32,
}

impl UsualStripe {
    const UNKNOWN: Self = Self { width: f32::INFINITY, contrast: 0.0 };
}

impl FloorFinder {
    /// Room for a grid.
    #[must_use]
    pub fn new(grid: &Grid) -> Self {
        let count = grid.columns().len();
        Self {
            columns: vec![FloorColumn::UNKNOWN; count],
            scratch: vec![0.0; count],
            pooled: vec![0.0; count],
            usual: UsualStripe::UNKNOWN,
        }
    }

    /// The findings of the last frame, one for each of the grid's columns.
    #[must_use]
    pub fn columns(&self) -> &[FloorColumn] {
        &self.columns
    }

    /// What the stripe looked like in the last frame.
    #[must_use]
    pub const fn usual(&self) -> UsualStripe {
        self.usual
    }

    /// Looks at one frame.
    pub fn find<S: Signal>(&mut self, signal: S, grid: &Grid) {
        self.measure(signal, grid);
        self.strengthen(signal, grid);
        self.decide(grid);
        self.settle_rows(grid);
    }

    fn measure<S: Signal>(&mut self, signal: S, grid: &Grid) {
        for (index, (found, place)) in self.columns.iter_mut().zip(grid.columns()).enumerate() {
            let column = grid.first() + index;
            *found = FloorColumn::UNKNOWN;
            found.peak = find(signal, signal, column, place);
            self.scratch[index] = noise_of(signal, column, place, index);
        }
        pool(&self.scratch, &mut self.pooled);
        for (found, noise) in self.columns.iter_mut().zip(&self.pooled) {
            found.noise = noise.max(LEAST_NOISE);
        }
    }

    /// Measures the columns of weak stretches again, each averaged with its neighbours along the stripe.
    fn strengthen<S: Signal>(&mut self, signal: S, grid: &Grid) {
        for (significance, column) in self.scratch.iter_mut().zip(&self.columns) {
            *significance = column.significance();
        }
        pool(&self.scratch, &mut self.pooled);
        if self.pooled.iter().all(|significance| *significance >= WEAK_CONTRAST) {
            return;
        }
        for (index, (noise, place)) in self.scratch.iter_mut().zip(grid.columns()).enumerate() {
            let averaged = Averaged { signal, grid, index };
            *noise = noise_of(averaged, grid.first() + index, place, index);
        }
        // `pooled` tells where the stripe is weak until the averaged noise takes its place.
        for (significance, column) in self.pooled.iter().zip(&mut self.columns) {
            column.lit = *significance < WEAK_CONTRAST;
        }
        pool(&self.scratch, &mut self.pooled);
        for (index, (found, place)) in self.columns.iter_mut().zip(grid.columns()).enumerate() {
            if std::mem::take(&mut found.lit) {
                let averaged = Averaged { signal, grid, index };
                let noise = AVERAGED_PENALTY * self.pooled[index].max(LEAST_NOISE);
                if let Some(peak) = find(averaged, signal, grid.first() + index, place)
                    && peak.contrast / noise > found.significance()
                {
                    (found.peak, found.noise) = (Some(peak), noise);
                }
            }
        }
    }

    fn decide(&mut self, grid: &Grid) {
        self.usual = self.usual_stripe();
        let usual = self.usual;
        for (contrast, column) in self.scratch.iter_mut().zip(&self.columns) {
            *contrast = column.contrast();
        }
        for (index, column) in self.columns.iter_mut().enumerate() {
            let end = (index + SPREAD_COLUMNS + 1).min(self.scratch.len());
            let around = &self.scratch[index.saturating_sub(SPREAD_COLUMNS)..end];
            let strongest = around.iter().copied().fold(0.0, f32::max);
            let glow = column.peak.is_none_or(|peak| {
                peak.width > GLOW_WIDTH * usual.width && peak.contrast < GLOW_SHARE * usual.contrast
            });
            let sure = !glow && column.significance() >= SURE_CONTRAST;
            // How much of the strongest contrast around is left; NaN where there is no stripe to judge.
            let share = if sure { column.contrast() / strongest } else { f32::NAN };
            self.pooled[index] = share;
            column.lit = share >= SPREAD_SHARE;
        }
        for (columns, shares) in runs(&mut self.columns, &self.pooled) {
            if shares.iter().all(|share| *share >= GONE_SHARE) {
                columns.iter_mut().for_each(|column| column.lit = true);
            }
        }
        self.bridge(grid);
    }

    /// The mean of what is surely no noise.
    fn usual_stripe(&self) -> UsualStripe {
        let strong = self.columns.iter().filter(|column| column.significance() >= 2.0 * SURE_CONTRAST);
        let (mut width, mut contrast, mut count) = (0.0, 0.0, 0.0);
        for peak in strong.filter_map(|column| column.peak) {
            (width, contrast, count) = (width + peak.width, contrast + peak.contrast, count + 1.0);
        }
        if count > 0.0 {
            UsualStripe { width: width / count, contrast: contrast / count }
        } else {
            UsualStripe::UNKNOWN
        }
    }

    /// Believes short runs of weaker columns between two sure ones.
    fn bridge(&mut self, grid: &Grid) {
        let mut sure: Option<usize> = None;
        for index in 0..self.columns.len() {
            if self.columns[index].lit {
                if let Some(before) = sure {
                    let length = (grid.columns()[index].place - grid.columns()[before].place).abs();
                    let between = &mut self.columns[before + 1..index];
                    if length <= BRIDGED_MM || between.len() == 1 {
                        for column in between {
                            column.lit = column.significance() >= BETWEEN_CONTRAST;
                        }
                    }
                }
                sure = Some(index);
            }
        }
    }

    /// The row of each lit column relative to the floor's, averaged over up to two lit neighbours on both sides where
    /// noise would move it, then the last condition: the row is the floor's.
    fn settle_rows(&mut self, grid: &Grid) {
        for ((offset, column), place) in self.scratch.iter_mut().zip(&self.columns).zip(grid.columns()) {
            *offset = column.peak.filter(|_| column.lit).map_or(f32::NAN, |peak| peak.row - place.floor_row);
        }
        for (index, place) in grid.columns().iter().enumerate() {
            let column = &self.columns[index];
            let reach = match column.significance() {
                weak if weak < 2.0 * SURE_CONTRAST => 2,
                fair if fair < 4.0 * SURE_CONTRAST => 1,
                _ => 0,
            };
            let (mut weight, mut moment) = (0.0, 0.0);
            for other in index.saturating_sub(reach)..(index + reach + 1).min(self.columns.len()) {
                let offset = self.scratch[other];
                // A neighbour on another surface says nothing about this one.
                if (offset - self.scratch[index]).abs() <= 2.0 {
                    let contrast = self.columns[other].contrast();
                    weight += contrast;
                    moment += contrast * offset;
                }
            }
            let column = &mut self.columns[index];
            let offset = moment / weight;
            column.lit &= weight > 0.0 && offset.abs() <= place.tolerance;
            column.row = if column.lit { place.floor_row + offset } else { f32::NAN };
        }
    }
}
