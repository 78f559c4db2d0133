//! Is the stripe lit on the floor in this column, and at which row exactly?
//!
//! The rig says where the stripe on a free floor must appear, so a dim stripe is only asked for at one place, where
//! little contrast proves it. What counts as enough is measured in the picture itself: the contrast must exceed what
//! texture and noise reach just beside the stripe. Where the whole stripe is weak, neighbouring columns are averaged,
//! over less than what a gap may be long (`pooled`); and an end of the stripe is where its contrast has fallen to
//! half, so that averaging moves none. Where the edge of a paint hides the stripe, the column is explained by both together
//! ([`super::edge`]).

mod beside_edges;
mod clipped;
mod elsewhere;
mod pooled;
mod prominent;
mod readings;
mod rim;
mod scraps;
mod slanted;
mod straight;
mod strip;
mod unlit;
mod unpainted;

use rim::is_rim;
use scraps::Halos;

use super::edge::EdgeModel;
use super::grid::{Grid, GridColumn};
use super::measure::Bench;
use super::peak::Peak;
use super::signal::{RowSearch, Signal};

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
/// The background's variation is pooled over this many columns on both sides.
const POOLED_COLUMNS: usize = 16;
/// ... and is not believed above so many times the median over the stripe.
const MOST_NOISE: f32 = 3.0;
/// Variation below this is not believed (levels of the running mean): quantisation and compression hide it, and leave
/// ripples of a few levels themselves.
const LEAST_NOISE: f32 = 0.8;
/// An edge pulls a ridge to the end of the tolerance; what is farther from the floor's row than this share of it tells nothing
/// of its neighbours.
const FREE_SHARE: f32 = 0.8;
/// Columns that an edge may hide between two sure ones, millimetres.
const HIDDEN_MM: f32 = 3.5;

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
    /// How far the rows in question stand out from the lower side.
    rise: f32,
    /// It needs a closer look.
    doubtful: bool,
    /// The ridge as it must be here, if the edge of a paint hides it.
    hidden: Option<Peak>,
    /// A ridge that may be the colour fringe of an edge.
    fringe: Option<Peak>,
    /// Lit or not, as the stretch around it tells; `None` where the column speaks for itself.
    pooled: Option<bool>,
}

/// Length of the stripe in one column, millimetres.
pub fn pitch(grid: &Grid, index: usize) -> f32 {
    let place = |index: usize| grid.columns().get(index).map_or(f32::NAN, |column| column.place);
    let (before, after) = (place(index.saturating_sub(1)), place(index + 1));
    let columns = if index == 0 { 1.0 } else { 2.0 };
    (after - before).abs() / columns
}

impl FloorColumn {
    /// Surely a ridge at the floor's row, and not beside an edge.
    fn is_like_floor(&self, place: &GridColumn) -> bool {
        self.significance() >= 2.0 * SURE_CONTRAST
            && self.peak.is_some_and(|peak| {
                (peak.row - place.floor_row).abs() <= place.tolerance && peak.contrast >= peak.rise / 2.0
            })
    }

    /// Surely lit at the floor's row, by itself or together with its neighbours, and no wider than `widest`: what is wider
    /// there is where a stripe on a thing climbs away.
    fn is_surely_floor(&self, place: &GridColumn, widest: f32) -> bool {
        let Some(peak) = self.peak else { return false };
        let is_free = (peak.row - place.floor_row).abs() < FREE_SHARE * place.tolerance;
        is_free && (self.pooled == Some(true) || (self.is_like_floor(place) && peak.width <= widest))
    }

    /// Does anything stand out? What an edge leaves of a faint stripe may be less than sure by itself.
    fn has_something(&self) -> bool {
        self.rise >= BETWEEN_CONTRAST * self.noise || self.fringe.is_some()
    }

    /// Is its ridge at the floor's row?
    fn is_at(&self, place: &GridColumn) -> bool {
        self.peak.is_some_and(|peak| (peak.row - place.floor_row).abs() <= place.tolerance)
    }

    const UNKNOWN: Self = Self {
        peak: None,
        noise: f32::NAN,
        row: f32::NAN,
        lit: false,
        rise: 0.0,
        doubtful: false,
        hidden: None,
        fringe: None,
        pooled: None,
    };

    /// Lit, and if nothing is seen because of an edge, at the row at which the stripe must be.
    fn light(&mut self) {
        self.lit = true;
        self.peak = self.hidden.or(self.peak);
    }

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
    let near = (peak.width / 2.0).ceil() as usize + 1;
    let crest = peak.row.round().max(0.0) as usize;
    let tones = (crest.saturating_sub(near)..(crest + near + 1).min(signal.rows()))
        .map(|row| signal.tone(column, row));
    let (low, high) = tones.fold((i16::MAX, i16::MIN), |(low, high), tone| (low.min(tone), high.max(tone)));
    peak.contrast < FRINGE_SHARE * f32::from(high.saturating_sub(low))
}

/// The median of what is no NaN; infinite of nothing. Leaves the values in another order.
fn median(values: &mut [f32]) -> f32 {
    // NaN sorts behind everything.
    values.sort_unstable_by(f32::total_cmp);
    let count = values.partition_point(|value| !value.is_nan());
    values[..count].get(count / 2).copied().unwrap_or(f32::INFINITY)
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

/// The greatest of the values within [`SPREAD_COLUMNS`] on both sides, none of which is negative.
fn strongest_around(values: &[f32], strongest: &mut [f32]) {
    strongest.copy_from_slice(values);
    // Shifted copies, one after the other: loops that become vectors, unlike a fold over a window.
    for shift in 1..=SPREAD_COLUMNS.min(values.len()) {
        let behind = strongest[shift..].iter_mut().zip(values);
        behind.for_each(|(most, value)| *most = if *value > *most { *value } else { *most });
        let ahead = strongest.iter_mut().zip(&values[shift..]);
        ahead.for_each(|(most, value)| *most = if *value > *most { *value } else { *most });
    }
}

/// Finds the floor's stripe in all columns of a grid; owns its memory.
#[derive(Debug, Clone)]
pub struct FloorFinder {
    columns: Vec<FloorColumn>,
    scratch: Vec<f32>,
    pooled: Vec<f32>,
    strongest: Vec<f32>,
    usual: UsualStripe,
    bench: Bench,
    edges: EdgeModel,
    pool: pooled::Pool,
    /// Only where the ground is subtracted; on the heap, for it is taken out while in use.
    unlit: Option<Box<unlit::Unlit>>,
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
            strongest: vec![0.0; count],
            usual: UsualStripe::UNKNOWN,
            bench: Bench::default(),
            edges: EdgeModel::new(),
            pool: pooled::Pool::new(count),
            unlit: None,
        }
    }

    /// From now on frames follow one another: what the laser's dimming tells of the ground is subtracted (module `unlit`).
    pub fn subtract_backgrounds(&mut self) {
        self.unlit = Some(Box::new(unlit::Unlit::new(self.columns.len())));
    }

    /// Forgets what earlier frames told.
    pub fn forget(&mut self) {
        if let Some(unlit) = &mut self.unlit {
            unlit.forget();
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
    pub fn find<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        self.pool.clear();
        self.measure(signal, grid);
        self.strengthen(signal, grid);
        self.usual = self.usual_stripe();
        self.explain_edges(signal, grid);
        self.subtract_ground(signal, grid);
        self.decide(grid);
        self.settle_rows(grid);
        self.sink_islands(grid);
    }

    fn measure<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        let (columns, noise) = (&mut self.columns, &mut self.scratch);
        self.bench.measure(signal, grid, |index, found| {
            columns[index] = FloorColumn { peak: found.peak, rise: found.rise, ..FloorColumn::UNKNOWN };
            columns[index].doubtful = found.doubtful;
            noise[index] = found.noise;
        });
        pool(&self.scratch, &mut self.pooled);
        // Edges that run along the stripe for long look like texture; the rest of the floor tells.
        let usual = median(&mut self.scratch);
        let most = MOST_NOISE * usual.max(LEAST_NOISE);
        for (index, (found, noise)) in self.columns.iter_mut().zip(&self.pooled).enumerate() {
            found.noise = if noise.is_finite() { noise.clamp(LEAST_NOISE, most) } else { *noise };
            let doubtful = found.doubtful && found.rise >= SURE_CONTRAST * found.noise;
            if doubtful {
                found.peak = self.bench.remeasure(signal, grid, index);
            }
            if let Some(peak) = found.peak.filter(|peak| is_fringe(signal, grid.first() + index, peak)) {
                (found.peak, found.fringe) = (None, Some(peak));
            }
            let place = &grid.columns()[index];
            if found.peak.is_some_and(|peak| is_rim(signal, grid.first() + index, &peak, place)) {
                found.peak = None;
            }
        }
    }

    fn decide(&mut self, grid: &Grid) {
        let usual = self.usual;
        for (contrast, column) in self.scratch.iter_mut().zip(&self.columns) {
            *contrast = column.contrast();
        }
        let halos = Halos::of(&self.scratch);
        strongest_around(&self.scratch, &mut self.strongest);
        for (index, column) in self.columns.iter_mut().enumerate() {
            let strongest = self.strongest[index];
            let glow = column.peak.is_none_or(|peak| {
                peak.width > GLOW_WIDTH * usual.width && peak.contrast < GLOW_SHARE * usual.contrast
            });
            let sure = !glow && column.significance() >= SURE_CONTRAST && !halos.is_one(&self.scratch, index);
            // How much of the strongest contrast around is left; NaN where there is no stripe to judge.
            let share = match column.pooled {
                Some(true) => 1.0,
                None if sure => column.contrast() / strongest,
                Some(false) | None => f32::NAN,
            };
            self.pooled[index] = share;
            column.lit = share >= SPREAD_SHARE;
        }
        self.keep_transitions(grid);
        self.bridge(grid);
    }

    /// Where the contrast falls and rises again, not far, speckle or grout is the reason; where it falls and stays low,
    /// the floor is darker from there on. Neither is an end.
    fn keep_transitions(&mut self, grid: &Grid) {
        let mut start = 0;
        while let Some(length) =
            self.columns.get(start..).and_then(|rest| rest.iter().position(|column| !column.lit))
        {
            let first = start + length;
            let rest = &self.columns[first..];
            let end = first + rest.iter().position(|column| column.lit).unwrap_or(rest.len());
            let level = |index: Option<usize>| {
                index.and_then(|index| self.columns.get(index)).map_or(f32::INFINITY, FloorColumn::contrast)
            };
            let around = level(first.checked_sub(1)).min(level(Some(end)));
            // NaN, where there is no stripe to judge, is neither.
            let dips = self.pooled[first..end].iter().all(|share| *share >= GONE_SHARE);
            let is_dim = |index: usize| {
                !self.pooled[index].is_nan() && self.columns[index].contrast() >= SPREAD_SHARE * around
            };
            let hidden = (first..end).filter(|index| !is_dim(*index));
            let is_bound = around.is_finite();
            let changes = is_bound
                && hidden.clone().all(|index| self.columns[index].hidden.is_some())
                && hidden.count() as f32 * pitch(grid, first) <= HIDDEN_MM;
            if dips || changes {
                self.columns[first..end].iter_mut().for_each(FloorColumn::light);
            }
            start = end;
        }
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
                    let is_hidden = |column: &FloorColumn| {
                        column.hidden.is_some() || column.significance() >= SURE_CONTRAST
                    };
                    if length <= BRIDGED_MM || between.len() == 1 {
                        let seen = |column: &&mut FloorColumn| {
                            column.hidden.is_some() || column.significance() >= BETWEEN_CONTRAST
                        };
                        between.iter_mut().filter(seen).for_each(FloorColumn::light);
                    } else if length <= HIDDEN_MM && between.iter().all(is_hidden) {
                        between.iter_mut().for_each(FloorColumn::light);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_strongest_around_is_that_of_the_window() {
        for count in 0..12_usize {
            let values: Vec<f32> = (0..count).map(|index| (index * 7 % 11) as f32).collect();
            let mut strongest = vec![0.0; count];
            strongest_around(&values, &mut strongest);
            for (index, most) in strongest.iter().enumerate() {
                let window =
                    &values[index.saturating_sub(SPREAD_COLUMNS)..(index + SPREAD_COLUMNS + 1).min(count)];
                let expected = window.iter().copied().fold(0.0, f32::max);
                assert!((most - expected).abs() < f32::EPSILON, "{index} of {count}");
            }
        }
    }
}
