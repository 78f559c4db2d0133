//! The columns in which the edge of a paint may hide the stripe, explained by both together.

use super::elsewhere::strongest_beside;
use super::{BETWEEN_CONTRAST, FloorColumn, FloorFinder, GLOW_WIDTH, LEAST_NOISE, SURE_CONTRAST};
use super::{clipped, slanted, straight};
use crate::vision::grid::{Grid, GridColumn};
use crate::vision::measure;
use crate::vision::peak::Peak;
use crate::vision::signal::RowSearch;

/// Sure columns within this distance tell what the stripe must look like beside the edge of a paint, millimetres.
const LIKE_NEIGHBOURS_MM: f32 = 60.0;
/// The stripe beside an edge must have this share of the contrast of the weaker of its neighbours.
const LIKE_SHARE: f32 = 0.3;
/// A ridge has the contrast of its neighbours if it is not so many times weaker than the weaker or stronger than the
/// stronger of them ...
const LIKE_RANGE: f32 = 2.0;
/// Between two grounds nothing differs from either by more than so many times what they differ.
const MOST_OF_STEP: f32 = 1.3;
/// A stripe is at most so many times as wide as the rig tells.
const WIDER: f32 = 1.5;
/// ... and their row if it is within so many rows of it.
const LIKE_ROWS: f32 = 1.5;
/// What is said of a row that the floor's neighbours make expected lies within this share of the tolerance.
const WITHIN_TOLERANCE: f32 = 0.9;
/// What is seen beside the floor's rows is less than so many times the stronger neighbour's contrast.
const MOST_BESIDE: f32 = 1.3;
/// Columns that are explained in one frame; a picture with more shows texture.
const MOST_EXPLAINED: usize = 320;

/// What the stripe looks like in the sure columns beside one.
struct Neighbours {
    /// Rows below the floor's row.
    offset: f32,
    width: f32,
    /// Contrast of the weaker of them, and of the stronger.
    contrast: f32,
    most: f32,
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
    fn is_like(&self, peak: &Peak, place: &GridColumn) -> bool {
        (peak.row - place.floor_row - self.offset).abs() <= place.tolerance.min(LIKE_ROWS)
            && (self.contrast / LIKE_RANGE..=self.most * LIKE_RANGE).contains(&peak.contrast)
    }

    /// How wide the stripe is in a column: beside an edge, and where it is clipped, the neighbours look wider than it is.
    fn width_at(&self, place: &GridColumn) -> f32 {
        self.width.clamp(place.width, WIDER * place.width)
    }

    /// The ridge that they make expected in a column.
    fn expected(&self, place: &GridColumn, contrast: f32, rise: f32) -> Peak {
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

impl FloorFinder {
    /// Explains the columns in which the edge of a paint may hide the stripe.
    pub(super) fn explain_edges<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        let mut left = MOST_EXPLAINED;
        let widest = GLOW_WIDTH * self.usual.width;
        let mut before: Option<usize> = None;
        let mut after = 0;
        for (index, place) in grid.columns().iter().enumerate() {
            let column = &self.columns[index];
            if column.is_surely_floor(place, widest) {
                before = Some(index);
                continue;
            }
            // What an edge leaves of a faint stripe may be less than sure by itself.
            let shows_something = column.rise >= BETWEEN_CONTRAST * column.noise || column.fringe.is_some();
            if left == 0 || !shows_something {
                continue;
            }
            after = after.max(index + 1);
            let is_doubtful = |after: usize| {
                self.columns
                    .get(after)
                    .is_some_and(|other| !other.is_surely_floor(&grid.columns()[after], widest))
            };
            while is_doubtful(after) {
                after += 1;
            }
            let sides = [before, Some(after)];
            let Some(like) = self.neighbours(grid, index, sides) else { continue };
            let column = &mut self.columns[index];
            if let Some(fringe) = column.fringe.filter(|fringe| like.is_like(fringe, place)) {
                column.peak = Some(fringe);
                continue;
            }
            left -= 1;
            // A stripe on a thing just beside is no edge, and what is left at the floor's rows may be its foot.
            let is_thing = strongest_beside(signal, grid.first() + index, place) >= MOST_BESIDE * like.most;
            let seen = !is_thing
                && ((self.is_one_edge(signal, grid, index, sides)
                    && (self.read_slanted(signal, grid, index, &like)
                        || self.read_clipped(signal, grid, index, &like)))
                    || self.read_uncovered(signal, grid, index, &like));
            if !seen {
                self.explain(signal, grid, index, &like);
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

    /// Does one edge between two grounds cross here? Then the grounds on both sides along the stripe differ by as much as
    /// what is seen in between. A thing that lies on one ground has two edges, with the same ground on both sides.
    fn is_one_edge<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        index: usize,
        sides: [Option<usize>; 2],
    ) -> bool {
        let [Some(before), Some(after)] = sides else { return false };
        let noise = SURE_CONTRAST * self.columns[index].noise;
        let towards_start = (0..=before).rev();
        let Some(one) = self.even_ground(signal, grid, towards_start, noise) else { return false };
        let Some(other) = self.even_ground(signal, grid, after..self.columns.len(), noise) else {
            return false;
        };
        self.pool.strip.fill(signal, grid, index..index + 1);
        let here = slanted::grounds(&self.pool.strip, index, grid.columns()[index].width);
        let step = (one - other).abs();
        let farthest = here.iter().map(|ground| (ground - one).abs().max((ground - other).abs()));
        step >= noise && farthest.fold(0.0, f32::max) <= MOST_OF_STEP * step
    }

    /// The first ground on the way that is the same above and below the stripe.
    fn even_ground<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        way: impl Iterator<Item = usize>,
        noise: f32,
    ) -> Option<f32> {
        let mut start = None;
        for column in way {
            let place = grid.columns().get(column)?;
            if (place.place - *start.get_or_insert(place.place)).abs() > LIKE_NEIGHBOURS_MM {
                return None;
            }
            self.pool.strip.fill(signal, grid, column..column + 1);
            let [above, below] = slanted::grounds(&self.pool.strip, column, place.width);
            if (above - below).abs() <= noise {
                return Some((above + below) / 2.0);
            }
        }
        None
    }

    /// Sees the column along the edge that crosses it; true if the stripe is there.
    fn read_slanted<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        index: usize,
        like: &Neighbours,
    ) -> bool {
        let place = &grid.columns()[index];
        let aside = index.saturating_sub(slanted::COLUMNS_ASIDE)..index + slanted::COLUMNS_ASIDE + 1;
        self.pool.strip.fill(signal, grid, aside);
        let fraction = place.floor_row - place.floor_row.round();
        let expected = slanted::Expected {
            width: like.width_at(place),
            offset: like.offset + fraction,
            tolerance: place.tolerance.min(LIKE_ROWS),
        };
        let Some(ridge) = slanted::read(&self.pool.strip, index, &expected) else { return false };
        let column = &mut self.columns[index];
        // How sure it is, the reading itself has judged: the edge, which makes the column's own noise large, is not in it.
        if ridge.height < (LIKE_SHARE * like.contrast).max(SURE_CONTRAST * LEAST_NOISE) {
            return false;
        }
        // Half rows are as fine as it sees.
        let most = WITHIN_TOLERANCE * place.tolerance;
        let row = place.floor_row + (like.offset + ridge.offset).clamp(-most, most);
        column.peak =
            Some(Peak { row, contrast: ridge.height, rise: ridge.height, width: like.width_at(place) });
        column.pooled = Some(true);
        true
    }

    /// Sees the column with the edge taken away that crosses it; true if the stripe is there.
    fn read_uncovered<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        index: usize,
        like: &Neighbours,
    ) -> bool {
        let place = &grid.columns()[index];
        let width = like.width_at(place);
        if !self.pool.edges.covers(index, place.floor_row) {
            let aside = straight::COLUMNS_ASIDE + 1;
            self.pool.strip.fill(signal, grid, index.saturating_sub(aside)..index + aside);
            self.pool.edges.look(&self.pool.strip, grid, index, width);
        }
        let Some(edge) = self.pool.edges.edge() else { return false };
        let Some(ridge) = edge.uncover(&self.pool.strip, grid, index, (like.offset, width)) else {
            return false;
        };
        let column = &mut self.columns[index];
        let farthest = place.tolerance.clamp(straight::LEAST_FARTHEST, LIKE_ROWS);
        if ridge.height < LIKE_SHARE * like.contrast || ridge.offset.abs() > farthest {
            return false;
        }
        column.peak = Some(like.expected(place, ridge.height, ridge.height));
        column.pooled = Some(true);
        true
    }

    /// Sees the column by its clipped core, if it has one; true if the stripe is there.
    fn read_clipped<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        index: usize,
        like: &Neighbours,
    ) -> bool {
        let (place, column) = (&grid.columns()[index], &mut self.columns[index]);
        let Some(core) =
            clipped::core(signal, grid.first() + index, place.floor_row + like.offset, like.width)
        else {
            return false;
        };
        if (core - place.floor_row).abs() > place.tolerance {
            return false;
        }
        column.peak = Some(Peak {
            row: core,
            contrast: like.contrast,
            rise: like.contrast,
            width: like.width_at(place),
        });
        column.pooled = Some(true);
        true
    }

    fn explain<S: RowSearch>(&mut self, signal: S, grid: &Grid, index: usize, like: &Neighbours) {
        let Some(samples) = measure::explained_rows(signal, grid, index) else { return };
        let (place, column) = (&grid.columns()[index], &mut self.columns[index]);
        self.edges.set_width(like.width_at(place));
        let offset = like.offset + place.floor_row - place.floor_row.round();
        let explanation = self.edges.explain(&samples, offset);
        let least = (LIKE_SHARE * like.contrast).max(SURE_CONTRAST * column.noise);
        if explanation.is_ridge(least, like.contrast)
            && self.edges.is_nowhere_else(&samples, &explanation, offset, place.tolerance.max(1.0))
        {
            column.peak = Some(like.expected(place, explanation.ridge, column.rise));
            column.pooled = None;
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
