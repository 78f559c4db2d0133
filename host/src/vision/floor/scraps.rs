//! Light in the floor's rows that is no floor: what the lens spreads over a narrow gap, and scraps between two gaps.

use super::{FloorColumn, FloorFinder};
use crate::vision::grid::Grid;

/// Between two bright columns this near on both sides, samples, what has less than this share of the weaker one's contrast is
/// what lens and sensor spread of them: some twentieth was seen beside a black cable.
const HALO_COLUMNS: usize = 8;
const HALO_SHARE: f32 = 0.08;
/// Floor that is lit over no more than this ...
const ISLAND_MM: f32 = 2.5;
/// ... between two stretches that are dark for longer than this is none, millimetres.
const LONGEST_HOLE_MM: f32 = 5.0;

/// What is dim enough in a picture to be the halo of something.
#[derive(Debug, Clone, Copy)]
pub struct Halos {
    /// Most columns are not so dim, and need no look at their neighbours, levels.
    most: f32,
}

impl Halos {
    /// For all columns' contrasts.
    pub fn of(contrasts: &[f32]) -> Self {
        Self { most: HALO_SHARE * contrasts.iter().copied().fold(0.0, f32::max) }
    }

    /// Is a column's contrast no more than what the lens spreads of bright columns near it on both sides?
    pub fn is_one(self, contrasts: &[f32], index: usize) -> bool {
        let Some(contrast) = contrasts.get(index).copied().filter(|contrast| *contrast < self.most) else {
            return false;
        };
        let strongest = |columns: &[f32]| columns.iter().copied().fold(0.0, f32::max);
        let before = strongest(&contrasts[index.saturating_sub(HALO_COLUMNS)..index]);
        let after = strongest(&contrasts[index + 1..(index + 1 + HALO_COLUMNS).min(contrasts.len())]);
        contrast < HALO_SHARE * before.min(after)
    }
}

impl FloorFinder {
    /// A scrap of floor between two stretches that are dark for longer than any gap may be is no floor: something crosses
    /// the floor's rows there. It would make two things of one.
    pub(super) fn sink_islands(&mut self, grid: &Grid) {
        let place = |index: usize| grid.columns()[index].place;
        let count = self.columns.len();
        let next = |columns: &[FloorColumn], from: usize, lit: bool| {
            columns[from..].iter().position(|column| column.lit == lit).map_or(count, |offset| from + offset)
        };
        // The last lit column before the stretch in question, if there is one.
        let mut before: Option<usize> = None;
        let mut start = next(&self.columns, 0, true);
        while start < count {
            let end = next(&self.columns, start, false);
            let after = next(&self.columns, end, true);
            let dark = |one: usize, other: usize| (place(other) - place(one)).abs() > LONGEST_HOLE_MM;
            let is_scrap = (place(end - 1) - place(start)).abs() <= ISLAND_MM;
            let alone = dark(before.unwrap_or(0), start) && dark(end - 1, after.min(count - 1));
            if is_scrap && alone {
                for column in &mut self.columns[start..end] {
                    (column.lit, column.row) = (false, f32::NAN);
                }
            } else {
                before = Some(end - 1);
            }
            start = after;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dim_column_is_a_halo_only_between_two_bright_ones() {
        let mut contrasts = [100.0_f32; 20];
        contrasts[8..12].fill(7.9);
        let is_one = |contrasts: &[f32], index| Halos::of(contrasts).is_one(contrasts, index);
        assert!((8..12).all(|index| is_one(&contrasts, index)));
        assert!(!is_one(&contrasts, 7) && !is_one(&contrasts, 20));
        contrasts[12..].fill(7.9);
        assert!(!is_one(&contrasts, 9), "dim to the end: a darker floor");
        contrasts[8..].fill(8.1);
        contrasts[12..].fill(100.0);
        assert!(!is_one(&contrasts, 9), "a share of 0.081 is not so dim");
        assert!(!is_one(&[7.9], 0), "and at the edge of the picture nothing is beside");
    }
}
