//! The ways in which a column in doubt is looked at: whatever sees the stripe at the floor's row, beside or under the edge of
//! a paint.

use super::beside_edges::{Doubt, LIKE_RANGE, LIKE_ROWS};
use super::elsewhere::strongest_beside;
use super::{FloorFinder, LEAST_NOISE, SURE_CONTRAST};
use super::{clipped, prominent, slanted, straight, unpainted};
use crate::vision::grid::Grid;
use crate::vision::measure;
use crate::vision::peak::Peak;
use crate::vision::signal::RowSearch;

/// The stripe beside an edge must have this share of the contrast of the weaker of its neighbours ...
const LIKE_SHARE: f32 = 0.3;
/// ... and this, where the edge itself is not explained: a gap's end is where the contrast has fallen to half ...
const ALIKE_SHARE: f32 = 0.5;
/// ... but for a ground so much darker, where the column must hold its own beside its neighbours.
const DARKER_SHARE: f32 = 0.1;
/// No less can be told from quantisation and compression, levels.
const LEAST_HEIGHT: f32 = SURE_CONTRAST * LEAST_NOISE;
/// A stripe is looked for so many rows farther than it may lie, so that one on a thing is seen where it is.
const BEYOND_ROWS: f32 = 1.0;
/// Another ridge beside, of more than this share of the one at the floor's row: it may be the stripe, on a thing.
const BESIDE_SHARE: f32 = 0.6;
/// The same for all readings, of the stronger neighbour's contrast.
const MOST_BESIDE: f32 = 1.3;
/// The ground goes on if it differs by less than this share of what the grounds above and below differ ...
const CONTINUES_SHARE: f32 = 0.25;
/// ... or by less than noise does; a column with more noise than this lies on an edge, levels.
const MOST_NOISE: f32 = 2.0;
/// Between two grounds nothing differs from either by more than so many times what they differ.
const MOST_OF_STEP: f32 = 1.3;
/// An even ground is looked for up to this far from a column, millimetres.
const EVEN_GROUND_MM: f32 = 100.0;

impl FloorFinder {
    /// Looks for the stripe in one column by all means, the costly ones as long as any are `left`; true if it is there.
    pub(super) fn see<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        doubt: &Doubt<'_>,
        left: &mut usize,
    ) -> bool {
        // A stripe on a thing just beside is no edge, and what is left at the floor's rows may be its foot.
        let beside = strongest_beside(signal, grid.first() + doubt.index, doubt.place);
        let is_thing = beside >= MOST_BESIDE * doubt.like.most;
        let continues = !is_thing && self.ground_continues(signal, grid, doubt);
        if continues
            && (self.read_prominent(signal, grid, doubt, beside)
                || self.read_unpainted(signal, grid, doubt, beside))
        {
            return true;
        }
        if *left == 0 {
            return false;
        }
        *left -= 1;
        let is_one_edge = !is_thing && self.is_one_edge(signal, grid, doubt);
        (is_one_edge && self.read_slanted(signal, grid, doubt))
            || ((is_one_edge || continues) && self.read_clipped(signal, grid, doubt))
            || ((is_one_edge || continues) && self.read_uncovered(signal, grid, doubt))
            || self.explain(signal, grid, doubt)
    }

    /// Are the grounds above and below the stripe those of a column on one side in which it is seen? A thing has others.
    fn ground_continues<S: RowSearch>(&self, signal: S, grid: &Grid, doubt: &Doubt<'_>) -> bool {
        let width = doubt.width();
        let here = unpainted::grounds(signal, grid, doubt.index, width);
        let [above, below] = here;
        let step = (above[0] - below[0]).hypot(above[1] - below[1]);
        let noise = self.columns[doubt.index].noise.min(MOST_NOISE);
        let most = (CONTINUES_SHARE * step).max(SURE_CONTRAST * noise);
        doubt.sides.into_iter().flatten().any(|other| {
            let there = unpainted::grounds(signal, grid, other, width);
            here.iter().flatten().zip(there.iter().flatten()).all(|(one, other)| (one - other).abs() <= most)
        })
    }

    /// Does one edge between two grounds cross here? Then the grounds on both sides along the stripe differ by as much as
    /// what is seen in between. A thing that lies on one ground has two edges, with the same ground on both sides.
    fn is_one_edge<S: RowSearch>(&mut self, signal: S, grid: &Grid, doubt: &Doubt<'_>) -> bool {
        let [Some(one), Some(other)] = doubt.sides else { return false };
        let index = doubt.index;
        let (before, after) = (one.min(other), one.max(other));
        let noise = SURE_CONTRAST * self.columns[index].noise;
        let towards_start = (0..=before).rev();
        let Some(one) = self.even_ground(signal, grid, towards_start, noise) else { return false };
        let Some(other) = self.even_ground(signal, grid, after..self.columns.len(), noise) else {
            return false;
        };
        self.pool.strip.fill(signal, grid, index..index + 1);
        let here = slanted::grounds(&self.pool.strip, index, doubt.place.width);
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
            if (place.place - *start.get_or_insert(place.place)).abs() > EVEN_GROUND_MM {
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

    /// Sees the column between the valleys beside it, if an edge is farther off; true if the stripe is there. `beside`: the
    /// strongest ridge beside the floor's rows.
    fn read_prominent<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        doubt: &Doubt<'_>,
        beside: f32,
    ) -> bool {
        let (index, like) = (doubt.index, &doubt.like);
        let aside = prominent::COLUMNS_ASIDE;
        self.pool.strip.fill(signal, grid, index.saturating_sub(aside)..index + aside + 1);
        let Some(crest) = prominent::read(&self.pool.strip, grid, index, doubt.width()) else { return false };
        let farthest = doubt.place.tolerance.min(LIKE_ROWS);
        let heights = (DARKER_SHARE * like.contrast).max(LEAST_HEIGHT)..=LIKE_RANGE * like.most;
        let is_one = heights.contains(&crest.height)
            && crest.offset.abs() <= farthest
            && beside <= BESIDE_SHARE * crest.height;
        if is_one {
            let column = &mut self.columns[index];
            column.peak = Some(doubt.ridge(crest.height, crest.offset));
            column.pooled = (crest.height >= ALIKE_SHARE * like.contrast).then_some(true);
        }
        is_one
    }

    /// Sees the column in the mixture of colour and brightness that hides the edge; true if the stripe is there.
    fn read_unpainted<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        doubt: &Doubt<'_>,
        beside: f32,
    ) -> bool {
        let like = &doubt.like;
        let farthest = doubt.place.tolerance.min(LIKE_ROWS);
        let read = unpainted::read(signal, grid, doubt.index, doubt.width(), farthest + BEYOND_ROWS);
        let Some(ridge) = read else { return false };
        let is_one = ridge.height >= (ALIKE_SHARE * like.contrast).max(LEAST_HEIGHT)
            && ridge.seen <= LIKE_RANGE * like.most
            && ridge.offset.abs() <= farthest
            && beside <= BESIDE_SHARE * ridge.seen;
        if is_one {
            let column = &mut self.columns[doubt.index];
            column.peak = Some(doubt.ridge(ridge.height.min(like.most), ridge.offset));
            column.pooled = Some(true);
        }
        is_one
    }

    /// Sees the column along the edge that crosses it; true if the stripe is there.
    fn read_slanted<S: RowSearch>(&mut self, signal: S, grid: &Grid, doubt: &Doubt<'_>) -> bool {
        let (index, place, like) = (doubt.index, doubt.place, &doubt.like);
        let aside = index.saturating_sub(slanted::COLUMNS_ASIDE)..index + slanted::COLUMNS_ASIDE + 1;
        self.pool.strip.fill(signal, grid, aside);
        let fraction = place.floor_row - place.floor_row.round();
        let expected = slanted::Expected {
            width: doubt.width(),
            offset: like.offset + fraction,
            tolerance: place.tolerance.min(LIKE_ROWS),
        };
        let Some(ridge) = slanted::read(&self.pool.strip, index, &expected) else { return false };
        // How sure it is, the reading itself has judged: the edge, which makes the column's own noise large, is not in it.
        if ridge.height < (LIKE_SHARE * like.contrast).max(LEAST_HEIGHT) {
            return false;
        }
        let column = &mut self.columns[index];
        // Half rows are as fine as it sees.
        column.peak = Some(doubt.ridge(ridge.height.min(like.most), like.offset + ridge.offset));
        column.pooled = Some(true);
        true
    }

    /// Sees the column with the edge taken away that crosses it; true if the stripe is there.
    fn read_uncovered<S: RowSearch>(&mut self, signal: S, grid: &Grid, doubt: &Doubt<'_>) -> bool {
        let (index, place, like) = (doubt.index, doubt.place, &doubt.like);
        let width = doubt.width();
        if !self.pool.edges.covers(index, place.floor_row) {
            let aside = straight::COLUMNS_ASIDE + 1;
            self.pool.strip.fill(signal, grid, index.saturating_sub(aside)..index + aside);
            self.pool.edges.look(&self.pool.strip, grid, index, width);
        }
        let Some(edge) = self.pool.edges.edge() else { return false };
        let Some(ridge) = edge.uncover(&self.pool.strip, grid, index, (like.offset, width)) else {
            return false;
        };
        let farthest = place.tolerance.clamp(straight::LEAST_FARTHEST, LIKE_ROWS);
        if ridge.height < LIKE_SHARE * like.contrast || ridge.offset.abs() > farthest {
            return false;
        }
        let column = &mut self.columns[index];
        column.peak = Some(like.expected(place, ridge.height, ridge.height));
        column.pooled = Some(true);
        true
    }

    /// Sees the column by its clipped core, if it has one; true if the stripe is there.
    fn read_clipped<S: RowSearch>(&mut self, signal: S, grid: &Grid, doubt: &Doubt<'_>) -> bool {
        let (place, like) = (doubt.place, &doubt.like);
        let row = place.floor_row + like.offset;
        let Some(core) = clipped::core(signal, grid.first() + doubt.index, row, like.width) else {
            return false;
        };
        if (core - place.floor_row).abs() > place.tolerance {
            return false;
        }
        let column = &mut self.columns[doubt.index];
        let (contrast, rise, width) = (like.contrast, like.contrast, doubt.width());
        column.peak = Some(Peak { row: core, contrast, rise, width });
        column.pooled = Some(true);
        true
    }

    /// Explains the column by a step and a ridge, each of its own strength; true if the ridge is there.
    fn explain<S: RowSearch>(&mut self, signal: S, grid: &Grid, doubt: &Doubt<'_>) -> bool {
        let (place, like) = (doubt.place, &doubt.like);
        let Some(samples) = measure::explained_rows(signal, grid, doubt.index) else { return false };
        let column = &mut self.columns[doubt.index];
        self.edges.set_width(doubt.width());
        let offset = like.offset + place.floor_row - place.floor_row.round();
        let explanation = self.edges.explain(&samples, offset);
        let least = (LIKE_SHARE * like.contrast).max(SURE_CONTRAST * column.noise);
        let is_ridge = explanation.is_ridge(least, like.contrast)
            && self.edges.is_nowhere_else(&samples, &explanation, offset, place.tolerance.max(1.0));
        if is_ridge {
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
        is_ridge
    }
}
