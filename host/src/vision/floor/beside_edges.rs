//! The columns in which the edge of a paint may hide the stripe, explained by both together.

use super::{FloorColumn, FloorFinder, SURE_CONTRAST};
use crate::vision::grid::{Grid, GridColumn};
use crate::vision::measure;
use crate::vision::peak::Peak;
use crate::vision::signal::RowSearch;

/// Sure columns within this distance tell what the stripe must look like beside the edge of a paint, millimetres.
const LIKE_NEIGHBOURS_MM: f32 = 60.0;
/// The stripe beside an edge must have this share of the contrast of the weaker of its neighbours.
const LIKE_SHARE: f32 = 0.3;
/// A ridge has the contrast of its neighbours if neither is so many times the other's ...
const LIKE_RANGE: f32 = 2.0;
/// ... and their row if it is within so many rows of it.
const LIKE_ROWS: f32 = 1.5;
/// Columns that are explained in one frame; a picture with more shows texture.
const MOST_EXPLAINED: usize = 320;

/// What the stripe looks like in the sure columns beside one.
struct Neighbours {
    /// Rows below the floor's row.
    offset: f32,
    width: f32,
    contrast: f32,
}

impl Neighbours {
    fn of<'a>(columns: impl Iterator<Item = (&'a FloorColumn, &'a GridColumn)>) -> Option<Self> {
        let (mut count, mut sum) = (0.0, Self { offset: 0.0, width: 0.0, contrast: f32::INFINITY });
        for (column, place) in columns {
            let peak = column.peak?;
            sum.offset += peak.row - place.floor_row;
            sum.width += peak.width;
            sum.contrast = sum.contrast.min(peak.contrast);
            count += 1.0;
        }
        (count > 0.0).then(|| Self { offset: sum.offset / count, width: sum.width / count, ..sum })
    }

    /// Is a ridge what they are, in place and strength?
    fn is_like(&self, peak: &Peak, place: &GridColumn) -> bool {
        (peak.row - place.floor_row - self.offset).abs() <= place.tolerance.min(LIKE_ROWS)
            && (self.contrast / LIKE_RANGE..=self.contrast * LIKE_RANGE).contains(&peak.contrast)
    }

    /// The ridge that they make expected in a column.
    fn expected(&self, place: &GridColumn, contrast: f32, rise: f32) -> Peak {
        Peak { row: place.floor_row + self.offset, contrast, rise, width: self.width }
    }
}

impl FloorFinder {
    /// Explains the columns in which the edge of a paint may hide the stripe.
    pub(super) fn explain_edges<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        let mut left = MOST_EXPLAINED;
        let mut before: Option<usize> = None;
        let mut after = 0;
        for (index, place) in grid.columns().iter().enumerate() {
            let column = &self.columns[index];
            if column.is_like_floor(place) {
                before = Some(index);
                continue;
            }
            if left == 0 || column.rise < SURE_CONTRAST * column.noise {
                continue;
            }
            after = after.max(index + 1);
            while self.columns.get(after).is_some_and(|other| !other.is_like_floor(&grid.columns()[after])) {
                after += 1;
            }
            let Some(like) = self.neighbours(grid, index, [before, Some(after)]) else { continue };
            let column = &mut self.columns[index];
            if let Some(fringe) = column.fringe.filter(|fringe| like.is_like(fringe, place)) {
                column.peak = Some(fringe);
                continue;
            }
            left -= 1;
            self.explain(signal, grid, index, &like);
        }
    }

    /// What the columns on both `sides` of one say about it, as far as they are near enough.
    fn neighbours(&self, grid: &Grid, index: usize, sides: [Option<usize>; 2]) -> Option<Neighbours> {
        let place = grid.columns().get(index)?.place;
        let pairs = sides.into_iter().flatten().filter_map(|other| {
            let other_place = grid.columns().get(other)?;
            let near = (other_place.place - place).abs() <= LIKE_NEIGHBOURS_MM;
            near.then_some((self.columns.get(other)?, other_place))
        });
        Neighbours::of(pairs)
    }

    fn explain<S: RowSearch>(&mut self, signal: S, grid: &Grid, index: usize, like: &Neighbours) {
        let Some(samples) = measure::explained_rows(signal, grid, index) else { return };
        let (place, column) = (&grid.columns()[index], &mut self.columns[index]);
        self.edges.set_width(like.width);
        let offset = like.offset + place.floor_row - place.floor_row.round();
        let explanation = self.edges.explain(&samples, offset);
        let least = (LIKE_SHARE * like.contrast).max(SURE_CONTRAST * column.noise);
        if explanation.is_ridge(least, like.contrast)
            && self.edges.is_nowhere_else(&samples, &explanation, offset, place.tolerance.max(1.0))
        {
            column.peak = Some(like.expected(place, explanation.ridge, column.rise));
        }
        if explanation.may_hide(least, offset) {
            column.hidden = Some(
                column
                    .peak
                    .filter(|peak| like.is_like(peak, place))
                    .unwrap_or_else(|| like.expected(place, least, column.rise)),
            );
        }
    }
}
