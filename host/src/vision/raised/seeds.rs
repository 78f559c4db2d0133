//! Where candidates are looked for: the strongest samples of those columns that can see a dark ray end.

use crate::simd;
use crate::vision::grid::{Grid, PictureGeometry};
use crate::vision::signal::{RowSearch, SEGMENT_ROWS};

/// Columns that see rays end this near to a dark one are searched too, millimetres: a line may go on beside the dark
/// stretch, and what a column can see is rounded.
const SIGHT_MARGIN_MM: f32 = 16.0;

/// The search of [`super::RaisedFinder`] as vector instructions.
pub(super) struct Collect<'a, S> {
    pub(super) signal: S,
    pub(super) grid: &'a Grid,
    pub(super) watching: &'a [std::ops::Range<usize>],
    pub(super) keys: &'a mut [u16],
}

impl<S: RowSearch> simd::Kernel for Collect<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { signal, grid, watching, keys } = self;
        let width = grid.columns().len().max(1);
        for (segment, (range, keys)) in grid.segments().iter().zip(keys.chunks_exact_mut(width)).enumerate() {
            let first_row = segment * SEGMENT_ROWS;
            for row in first_row..(first_row + SEGMENT_ROWS).min(signal.rows()) {
                let tag = (row - first_row) as u16;
                for run in watching {
                    let (start, end) = (run.start.max(range.start), run.end.min(range.end));
                    if start < end {
                        signal.raise(row, grid.first() + start, tag, &mut keys[start..end]);
                    }
                }
            }
        }
    }
}

/// Places of the rays that a column can see end, from the lowest to the highest, millimetres.
pub(super) fn sight(grid: &Grid, geometry: &PictureGeometry, index: usize) -> [f32; 2] {
    const EVERYWHERE: [f32; 2] = [f32::NEG_INFINITY, f32::INFINITY];
    let Some((place, map)) = grid.columns().get(index).zip(geometry.map(grid.image_column(index))) else {
        return EVERYWHERE;
    };
    let first = usize::from(place.first_row) / SEGMENT_ROWS * SEGMENT_ROWS;
    let last = usize::from(place.end_row).next_multiple_of(SEGMENT_ROWS);
    let at = |row: usize| geometry.ray_place(map, grid.to_pixels(row as f32));
    let (one, middle, other) = (at(first), at(first.midpoint(last)), at(last));
    let (low, high) = (one.min(other), one.max(other));
    // The place is a ratio of two linear functions of the row: it only rises or only falls, or passes through infinity,
    // and then the middle is not between.
    let [low, high] = [low - SIGHT_MARGIN_MM, high + SIGHT_MARGIN_MM];
    if one.is_nan() || other.is_nan() || !(low..=high).contains(&middle) {
        return EVERYWHERE;
    }
    [low, high]
}
