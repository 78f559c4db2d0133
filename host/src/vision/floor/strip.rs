//! The picture straightened along the stripe: rows are counted from the floor's row of each column.

use crate::vision::grid::Grid;
use crate::vision::signal::RowSearch;

/// Farthest row from the floor's that a strip holds.
pub const MOST_ASIDE: usize = 48;
const ROWS: usize = 2 * MOST_ASIDE + 1;
/// Columns that are filled at a time.
const BLOCK: usize = 32;

/// Samples around the floor's row, for the columns that were asked for.
#[derive(Debug, Clone)]
pub struct Strip {
    columns: usize,
    values: Vec<i16>,
    filled: Vec<bool>,
}

impl Strip {
    /// Room for so many columns.
    pub fn new(columns: usize) -> Self {
        Self { columns, values: vec![0; ROWS * columns], filled: vec![false; columns.div_ceil(BLOCK)] }
    }

    /// A strip of given values, for tests: of column and row from the floor's.
    #[cfg(test)]
    pub fn drawn(columns: usize, value: impl Fn(usize, isize) -> i16) -> Self {
        let mut strip = Self::new(columns);
        for (index, sample) in strip.values.iter_mut().enumerate() {
            *sample = value(index % columns, (index / columns) as isize - MOST_ASIDE as isize);
        }
        strip
    }

    /// Columns that there are.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Forgets the last picture.
    pub fn clear(&mut self) {
        self.filled.fill(false);
    }

    /// Was this column filled in?
    pub fn is_filled(&self, column: usize) -> bool {
        self.filled.get(column / BLOCK).copied().unwrap_or(false)
    }

    /// Fills in the columns of a range, and some beside them.
    pub fn fill<S: RowSearch>(&mut self, signal: S, grid: &Grid, range: std::ops::Range<usize>) {
        let blocks = range.start / BLOCK..range.end.min(self.columns).div_ceil(BLOCK);
        for block in blocks {
            let Some(filled) = self.filled.get_mut(block) else { return };
            if !std::mem::replace(filled, true) {
                self.fill_block(signal, grid, block * BLOCK);
            }
        }
    }

    fn fill_block<S: RowSearch>(&mut self, signal: S, grid: &Grid, first: usize) {
        let end = (first + BLOCK).min(self.columns);
        let last = signal.rows().saturating_sub(1) as isize;
        let mut start = first;
        for run in grid.columns()[first..end].chunk_by(|one, other| one.nearest_row == other.nearest_row) {
            let middle = run[0].nearest_row;
            for row in 0..ROWS {
                // The picture's outermost rows stand for those beyond it.
                let picture_row = (middle + row as isize - MOST_ASIDE as isize).clamp(0, last) as usize;
                let values = &mut self.values[row * self.columns + start..][..run.len()];
                signal.copy(picture_row, grid.first() + start, values);
            }
            start += run.len();
        }
    }

    /// The samples of a row, counted from the floor's; zero where nothing was filled in.
    pub fn row(&self, row: isize) -> &[i16] {
        let row = (row + MOST_ASIDE as isize) as usize;
        &self.values[row * self.columns..(row + 1) * self.columns]
    }

    /// One sample.
    pub fn value(&self, column: usize, row: isize) -> f32 {
        f32::from(self.row(row)[column])
    }
}
