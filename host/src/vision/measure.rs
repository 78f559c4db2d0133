//! Measures the ridge at the floor's row in every column of a picture, many columns at a time.

use super::edge::EXPLAINED_ROWS;
use super::grid::{Grid, GridColumn};
use super::peak::{self, Peak};
use super::ridge::{Block, Kernel, MOST_REACH, MOST_ROWS_ASIDE, Ridge};
use super::signal::RowSearch;
use crate::simd;

/// Columns that are measured at a time.
const LANES: usize = 64;
/// The background's variation is measured in every so manieth column: it is pooled anyway.
const NOISE_STRIDE: usize = 8;
/// A ridge whose contrast is a smaller share of its rise may have a paint's edge close by.
const EVEN_SHARE: f32 = 0.5;
/// A ridge whose contrast is a smaller share of its rise may be one rim of a wide, hollow one.
const RIM_SHARE: f32 = 0.2;
/// A wider kernel must find so much more contrast to be believed.
const WIDE_GAIN: f32 = 1.2;
/// A core that lies so far below its rims may be clipped, levels ...
const LEAST_HOLLOW: f32 = 10.0;
/// ... and as a share of the contrast.
const HOLLOW_SHARE: f32 = 0.25;

/// What was found in one column.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// The ridge at the floor's row, its row within the picture.
    pub peak: Option<Peak>,
    /// How far it stands out from the lower side.
    pub rise: f32,
    /// The background's variation in one of every [`NOISE_STRIDE`] columns; NaN in the others.
    pub noise: f32,
    /// It needs a closer look: [`Bench::remeasure`].
    pub doubtful: bool,
}

/// Working memory.
#[derive(Debug, Clone, Default)]
pub struct Bench {
    many: Block<LANES>,
    one: Block<1>,
}

/// The lengths for the columns around one.
fn kernel_at(place: &GridColumn) -> (Kernel, usize) {
    let reach = (place.tolerance.ceil() as usize + 1).min(MOST_REACH);
    (Kernel::for_width(place.width), reach)
}

/// Has the column room for a background on both sides?
fn has_room(place: &GridColumn, rows: usize, kernel: Kernel, reach: usize) -> bool {
    let aside = (kernel.near + kernel.length() + reach) as f32;
    place.floor_row >= aside && place.floor_row + aside < rows as f32
}

fn peak_of(ridge: Ridge, place: &GridColumn) -> Peak {
    let row = place.nearest_row as f32 + ridge.offset;
    Peak { row, contrast: ridge.contrast, rise: ridge.rise, width: ridge.width }
}

impl Bench {
    /// Measures all columns; `take` gets each one's index and finding.
    pub fn measure<S: RowSearch>(&mut self, signal: S, grid: &Grid, mut take: impl FnMut(usize, Found)) {
        let mut first = 0;
        while let Some(places) = grid.columns().get(first..).filter(|places| !places.is_empty()) {
            let count = places.len().min(LANES);
            let places = &places[..count];
            let (kernel, reach) = kernel_at(&places[count / 2]);
            gather(&mut self.many, signal, grid, first, count, kernel.rows_aside(reach));
            self.many.search(kernel, reach);
            for (lane, place) in places.iter().enumerate() {
                take(first + lane, self.many.found(lane, place, signal.rows(), (kernel, reach)));
            }
            first += count;
        }
    }

    /// Measures one column again: a stripe may be too wide for the usual kernel (clipped, or out of focus), its core may
    /// be hollow, or the edge of a paint may run so close to it that only a finer kernel fits between. Another kernel is
    /// believed if it explains more.
    pub fn remeasure<S: RowSearch>(&mut self, signal: S, grid: &Grid, index: usize) -> Option<Peak> {
        let place = grid.columns().get(index)?;
        let (usual, reach) = kernel_at(place);
        let wide = usual.widened();
        let rows = wide.rows_aside(reach).min(MOST_ROWS_ASIDE);
        let wide = Kernel { far: rows - wide.half - reach, ..wide };
        gather(&mut self.one, signal, grid, index, 1, rows);
        fill_hollows(&mut self.one, signal, grid, index, wide.near);
        let one = &mut self.one;
        let mut find = |kernel: Kernel| {
            one.search(kernel, reach);
            let ridge = one.ridge(0, kernel, reach)?;
            (has_room(place, signal.rows(), kernel, reach) && !ridge.outside).then(|| peak_of(ridge, place))
        };
        let mut best = find(usual);
        let share = |peak: Option<Peak>| peak.map_or(0.0, |peak| peak.contrast / peak.rise);
        let fits = |peak: Option<Peak>| peak.is_some_and(|peak| peak.width <= usual.widest() as f32);
        if share(best) < EVEN_SHARE {
            // The finer kernel's sums vary more, for which its contrast pays.
            let fine = usual.refined();
            let gain = (fine.length() as f32 / usual.length() as f32).sqrt();
            best =
                stronger(best, find(fine).map(|peak| Peak { contrast: gain * peak.contrast, ..peak }), 1.0);
        }
        if !fits(best) || share(best) < RIM_SHARE {
            best = stronger(best, find(wide), WIDE_GAIN);
        }
        best
    }
}

fn stronger(one: Option<Peak>, other: Option<Peak>, gain: f32) -> Option<Peak> {
    match (one, other) {
        (Some(one), Some(other)) if other.contrast <= gain * one.contrast => Some(one),
        (one, other) => other.or(one),
    }
}

impl<const LANES: usize> Block<LANES> {
    fn found(&self, lane: usize, place: &GridColumn, rows: usize, (kernel, reach): (Kernel, usize)) -> Found {
        if !has_room(place, rows, kernel, reach) {
            return Found { peak: None, rise: 0.0, noise: f32::NAN, doubtful: false };
        }
        let noise =
            if lane.is_multiple_of(NOISE_STRIDE) { self.roughness(lane, kernel, reach) } else { f32::NAN };
        let ridge = self.ridge(lane, kernel, reach);
        let doubtful = ridge.is_none_or(|ridge| {
            ridge.outside
                || ridge.width > kernel.widest() as f32
                || ridge.contrast < EVEN_SHARE * ridge.rise
                || ridge.hollow >= LEAST_HOLLOW.max(HOLLOW_SHARE * ridge.contrast)
        });
        let peak = ridge.filter(|ridge| !ridge.outside).map(|ridge| peak_of(ridge, place));
        Found { peak, rise: self.rise(lane, kernel), noise, doubtful }
    }
}

/// Fills a block with `count` columns from the grid's entry `first` on, up to `rows` rows from the floor's. The picture's
/// outermost rows stand for those beyond it.
fn gather<S: RowSearch, const LANES: usize>(
    block: &mut Block<LANES>,
    signal: S,
    grid: &Grid,
    first: usize,
    count: usize,
    rows: usize,
) {
    simd::run(Gather { block, signal, grid, first, count, rows });
}

/// [`gather`] as vector instructions.
struct Gather<'a, S, const LANES: usize> {
    block: &'a mut Block<LANES>,
    signal: S,
    grid: &'a Grid,
    first: usize,
    count: usize,
    rows: usize,
}

impl<S: RowSearch, const LANES: usize> simd::Kernel for Gather<'_, S, LANES> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { block, signal, grid, first, count, rows } = self;
        let last = signal.rows().saturating_sub(1) as isize;
        let rows = rows.min(MOST_ROWS_ASIDE) as isize;
        let places = &grid.columns()[first..first + count];
        let same_row = |one: &GridColumn, other: &GridColumn| one.nearest_row == other.nearest_row;
        let mut lane = 0;
        for run in places.chunk_by(same_row) {
            let middle = run[0].nearest_row;
            for row in -rows..=rows {
                let values = &mut block.row_mut(row)[lane..lane + run.len()];
                signal.copy((middle + row).clamp(0, last) as usize, grid.first() + first + lane, values);
            }
            lane += run.len();
        }
    }
}

/// Gives the clipped core of a stripe the strength of its rims.
fn fill_hollows<S: RowSearch>(block: &mut Block<1>, signal: S, grid: &Grid, index: usize, near: usize) {
    let Some(place) = grid.columns().get(index) else { return };
    let middle = place.nearest_row;
    let near = near as isize;
    let mut samples = [0_i16; 2 * MOST_ROWS_ASIDE + 1];
    let samples = &mut samples[..2 * near as usize + 1];
    for (sample, row) in samples.iter_mut().zip(-near..=near) {
        *sample = block.row(row)[0];
    }
    peak::fill_hollows(samples, |position| {
        let row = middle + position as isize - near;
        row >= 0 && signal.is_clipped(grid.first() + index, row as usize)
    });
    for (sample, row) in samples.iter().zip(-near..=near) {
        block.row_mut(row)[0] = *sample;
    }
}

/// The samples around the floor's row in one column; `None` where the picture ends before.
pub fn explained_rows<S: RowSearch>(
    signal: S,
    grid: &Grid,
    index: usize,
) -> Option<[f32; 2 * EXPLAINED_ROWS + 1]> {
    let place = grid.columns().get(index)?;
    let first = usize::try_from(place.nearest_row).unwrap_or(0).checked_sub(EXPLAINED_ROWS)?;
    if first + 2 * EXPLAINED_ROWS >= signal.rows() {
        return None;
    }
    Some(std::array::from_fn(|row| f32::from(signal.value(grid.first() + index, first + row))))
}
