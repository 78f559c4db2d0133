//! The columns in which the edge of a paint may hide the stripe, explained by both together.
//!
//! The walk along the stripe, from both ends: which columns are in doubt, and what their neighbours make expected of them. How
//! a column in doubt is then looked at stands in [`super::readings`].

use super::{FloorColumn, FloorFinder, GLOW_WIDTH};
use crate::vision::grid::{Grid, GridColumn};
use crate::vision::peak::Peak;
use crate::vision::signal::RowSearch;

/// Sure columns within this distance tell what the stripe must look like beside the edge of a paint, millimetres.
const LIKE_NEIGHBOURS_MM: f32 = 250.0;
/// A ridge has the contrast of its neighbours if it is not so many times weaker than the weaker or stronger than the
/// stronger of them ...
pub(super) const LIKE_RANGE: f32 = 2.0;
/// ... and their row if it is within so many rows of it.
pub(super) const LIKE_ROWS: f32 = 1.5;
/// A stripe is at most so many times as wide as the rig tells.
const WIDER: f32 = 1.5;
/// What is said of a row that the floor's neighbours make expected lies within this share of the tolerance.
const WITHIN_TOLERANCE: f32 = 0.9;
/// Columns that are explained at length in one frame; a picture with more shows texture.
const MOST_EXPLAINED: usize = 480;

/// What the stripe looks like in the sure columns beside one.
pub(super) struct Neighbours {
    /// Rows below the floor's row.
    pub(super) offset: f32,
    pub(super) width: f32,
    /// Contrast of the weaker of them, and of the stronger.
    pub(super) contrast: f32,
    pub(super) most: f32,
}

impl Neighbours {
    fn of<'a>(columns: impl Iterator<Item = (&'a FloorColumn, &'a GridColumn)>) -> Option<Self> {
        let (mut count, mut sum) =
            (0.0, Self { offset: 0.0, width: 0.0, contrast: f32::INFINITY, most: 0.0 });
        for (column, place) in columns {
            let peak = column.peak?;
            sum.offset += peak.row - place.floor_row;
            sum.width += peak.width;
            sum.contrast = sum.contrast.min(peak.contrast);
            sum.most = sum.most.max(peak.contrast);
            count += 1.0;
        }
        (count > 0.0).then(|| Self { offset: sum.offset / count, width: sum.width / count, ..sum })
    }

    /// Is a ridge what they are, in place and strength? On a mixture of two grounds the stripe's strength lies between
    /// those on either.
    pub(super) fn is_like(&self, peak: &Peak, place: &GridColumn) -> bool {
        (peak.row - place.floor_row - self.offset).abs() <= place.tolerance.min(LIKE_ROWS)
            && (self.contrast / LIKE_RANGE..=self.most * LIKE_RANGE).contains(&peak.contrast)
    }

    /// How wide the stripe is in a column: beside an edge, and where it is clipped, the neighbours look wider than it is.
    pub(super) fn width_at(&self, place: &GridColumn) -> f32 {
        self.width.clamp(place.width, WIDER * place.width)
    }

    /// The ridge that they make expected in a column.
    pub(super) fn expected(&self, place: &GridColumn, contrast: f32, rise: f32) -> Peak {
        // They lie on the floor, as far as their own edges let them.
        let most = WITHIN_TOLERANCE * place.tolerance;
        Peak {
            row: place.floor_row + self.offset.clamp(-most, most),
            contrast,
            rise,
            width: self.width_at(place),
        }
    }
}

/// A column in doubt, and what is known of it.
pub(super) struct Doubt<'a> {
    pub(super) index: usize,
    pub(super) place: &'a GridColumn,
    /// The columns behind and ahead on the way in which the stripe is seen.
    pub(super) sides: [Option<usize>; 2],
    /// What they look like.
    pub(super) like: Neighbours,
}

impl Doubt<'_> {
    /// How wide the stripe is here, samples.
    pub(super) fn width(&self) -> f32 {
        self.like.width_at(self.place)
    }

    /// A ridge so high, so many rows below the floor's row as the tolerance lets it be said.
    pub(super) fn ridge(&self, height: f32, offset: f32) -> Peak {
        let most = WITHIN_TOLERANCE * self.place.tolerance;
        let row = self.place.floor_row + offset.clamp(-most, most);
        Peak { row, contrast: height, rise: height, width: self.width() }
    }
}

impl FloorFinder {
    /// Explains the columns in which the edge of a paint may hide the stripe: from both ends, because an edge may run along
    /// the stripe for long, and each column in which the stripe is seen tells the next one what to look for.
    pub(super) fn explain_edges<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        let widest = GLOW_WIDTH * self.usual.width;
        let in_question = self
            .columns
            .iter()
            .zip(grid.columns())
            .any(|(column, place)| column.has_something() && !column.is_surely_floor(place, widest));
        self.pool.seen.fill(false);
        if !in_question {
            return;
        }
        let mut left = MOST_EXPLAINED;
        for reversed in [false, true] {
            self.walk(grid, reversed, |finder, doubt| {
                let column = &mut finder.columns[doubt.index];
                if let Some(fringe) = column.fringe.filter(|fringe| doubt.like.is_like(fringe, doubt.place)) {
                    (column.peak, column.pooled) = (Some(fringe), None);
                    return false;
                }
                finder.see(signal, grid, doubt, &mut left)
            });
        }
    }

    /// One way along the stripe; `look` gets every column in doubt, and tells whether the stripe is there.
    pub(super) fn walk(
        &mut self,
        grid: &Grid,
        reversed: bool,
        mut look: impl FnMut(&mut Self, &Doubt<'_>) -> bool,
    ) {
        let widest = GLOW_WIDTH * self.usual.width;
        let count = self.columns.len();
        let column_at = |step: usize| if reversed { count - 1 - step } else { step };
        let is_sure = |columns: &[FloorColumn], index: usize| {
            columns[index].is_surely_floor(&grid.columns()[index], widest)
        };
        let mut behind: Option<usize> = None;
        // The first sure column ahead, as a step.
        let mut ahead = 0;
        for step in 0..count {
            let index = column_at(step);
            let place = &grid.columns()[index];
            if self.pool.seen[index] || is_sure(&self.columns, index) {
                behind = Some(index);
                continue;
            }
            let column = &self.columns[index];
            if !column.has_something() {
                continue;
            }
            ahead = ahead.max(step + 1);
            while ahead < count && !is_sure(&self.columns, column_at(ahead)) {
                ahead += 1;
            }
            let sides = [behind, (ahead < count).then(|| column_at(ahead))];
            let Some(like) = self.neighbours(grid, index, sides) else { continue };
            if look(self, &Doubt { index, place, sides, like }) {
                self.pool.seen[index] = true;
                behind = Some(index);
            }
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
}
