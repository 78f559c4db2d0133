//! The ground as it is without the laser, learnt from the laser's own dimming.
//!
//! The safety controller dims the laser by its secret code. Between a picture with the laser full and one with it dimmed
//! nothing changes on a floor that stands still but the laser's own light; so the two tell what the ground is without it, also
//! where the edge of a paint hides the stripe in either. From then on that ground is taken away from the column, for as long as
//! all that lies beside the stripe stays as it was, and every further change of the laser is held against it.
//!
//! The code itself is never told to the host: that the laser has changed is seen in the columns that are in no doubt.

use super::beside_edges::{Doubt, LIKE_RANGE, LIKE_ROWS};
use super::prominent::average;
use super::strip::{MOST_ASIDE, Strip};
use super::{FloorColumn, FloorFinder, SURE_CONTRAST, median};
use crate::vision::grid::Grid;
use crate::vision::peak::{Kernel, Peak, Ridge};
use crate::vision::signal::RowSearch;

/// Rows to each side of the floor's row that are kept.
const REACH: usize = 40;
const ROWS: usize = 2 * REACH + 1;
const _: () = assert!(REACH < MOST_ASIDE, "the strip holds what is kept");
/// The laser has changed if the stripe's contrast has fallen to this share, or risen by its inverse: dimming to 60 % leaves at
/// most 0.8 of it. A core that is clipped far looks no less red when dimmed: then no change is seen, and nothing learnt.
const CHANGED_SHARE: f32 = 0.9;
/// ... in the median of at least so many columns. Fewer may be a thing that moves.
const FEWEST_COLUMNS: usize = 64;
/// No change leaves less: what is darker than that is another light, or none.
const LEAST_SHARE: f32 = 0.4;
/// Rows that the stripe's light reaches beyond the tolerance, in widths of the stripe; farther rows must stay as they are.
const HALO_WIDTHS: f32 = 1.5;
/// Rows that stay differ by noise: no more than this in the median, levels ...
const STILL_USUALLY: f32 = 10.0;
/// ... and none by more than this, or so many times the median: four standard deviations of normal noise and a little more.
const STILL_LEVELS: f32 = 24.0;
const OUTLIER: f32 = 7.0;
/// What the change takes from the stripe may differ from what it takes from its neighbours by this factor.
const ALIKE_CHANGE: f32 = 2.2;
/// The stripe has at least this share of the weaker neighbour's contrast.
const LEAST_ALIKE: f32 = 0.3;
/// Both sides of it have been cleared of the ground: they are alike to this share of its rise.
const EVEN_SHARE: f32 = 0.6;
/// Without its ground a column shows the laser's light only. Farther from the ridge than its own width there is less than
/// this share of it, or the stripe lies there: on a thing.
const ELSEWHERE_SHARE: f32 = 0.3;
/// ... or than this, levels: noise. Both are means of three rows.
const LEAST_ELSEWHERE: f32 = 10.0;
/// So many changes of the laser must have told the same ground.
const SURE_CHANGES: u8 = 2;
/// ... of which so many are averaged.
const MOST_CHANGES: u8 = 8;
/// Two tellings of one ground differ by no more than so many levels on average.
const SAME_GROUND: f32 = 14.0;

/// Rows around the floor's, averaged along the stripe; the middle one is the floor's.
type Rows = [f32; ROWS];

fn rows_of(strip: &Strip, grid: &Grid, column: usize) -> Rows {
    let mut rows = [0.0; ROWS];
    average(strip, grid, column, &mut rows);
    rows
}

/// What is known of one column's ground.
#[derive(Debug, Clone)]
struct Ground {
    rows: Rows,
    /// Changes of the laser that told it.
    changes: u8,
}

/// Memory of the picture before, and of grounds.
#[derive(Debug, Clone)]
pub(super) struct Unlit {
    grounds: Vec<Ground>,
    before: Strip,
    /// Contrast of the columns in no doubt in the picture before; NaN in the others.
    contrasts: Vec<f32>,
    ratios: Vec<f32>,
}

/// The laser's light in two pictures, one of which has it dimmed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Change {
    /// What the darker picture has of the brighter one's.
    share: f32,
    /// It is this picture that is the brighter one.
    is_brighter: bool,
}

impl Change {
    /// From the ratio of contrasts now and before.
    fn of(ratio: f32) -> Option<Self> {
        let is_brighter = ratio > 1.0;
        let share = if is_brighter { 1.0 / ratio } else { ratio };
        (LEAST_SHARE..=CHANGED_SHARE).contains(&share).then_some(Self { share, is_brighter })
    }
}

/// What the doubt about a column leaves to be expected of it.
struct Expected {
    /// Rows from the middle within which the stripe's light may lie.
    halo: usize,
    farthest: f32,
    kernel: Kernel,
}

impl Expected {
    fn of(doubt: &Doubt<'_>, step: usize) -> Self {
        let place = doubt.place;
        let halo = (place.tolerance + HALO_WIDTHS * doubt.width()).ceil() as usize + 1;
        Self {
            halo: halo.min(REACH / 2),
            farthest: place.tolerance.min(LIKE_ROWS),
            kernel: Kernel::for_step(step),
        }
    }

    fn is_aside(&self, row: usize) -> bool {
        row.abs_diff(REACH) > self.halo
    }

    /// Do all rows beside the stripe differ by no more than noise?
    fn is_still(&self, differences: &Rows) -> bool {
        let mut aside = [f32::NAN; ROWS];
        let rows = differences.iter().enumerate().filter(|(row, _)| self.is_aside(*row));
        for (aside, (_, value)) in aside.iter_mut().zip(rows) {
            *aside = value.abs();
        }
        let most = aside.iter().copied().fold(0.0, f32::max);
        let usual = median(&mut aside);
        usual <= STILL_USUALLY && most <= (OUTLIER * usual).max(STILL_LEVELS)
    }

    /// The one ridge at the floor's row, its row counted from that; `None` if it is not even, or lies elsewhere.
    fn ridge(&self, values: &Rows) -> Option<Peak> {
        let samples: [i16; ROWS] = std::array::from_fn(|row| values[row].round() as i16);
        let reach = self.farthest.ceil() as usize + 1;
        let peak = Ridge::new(&samples, self.kernel).peak(REACH - reach..REACH + reach + 1)?;
        let offset = peak.row - REACH as f32;
        let is_one = offset.abs() <= self.farthest && peak.contrast >= EVEN_SHARE * peak.rise;
        is_one.then_some(Peak { row: offset, ..peak })
    }
}

/// Is there no other light than a ridge's?
fn is_alone(values: &Rows, peak: &Peak) -> bool {
    let most = (ELSEWHERE_SHARE * peak.contrast).max(LEAST_ELSEWHERE);
    let apart = peak.width.max(2.0) + 1.0;
    values.windows(3).enumerate().all(|(first, rows)| {
        let is_beside = (first as f32 + 1.0 - peak.row).abs() > apart;
        !is_beside || rows.iter().sum::<f32>() <= 3.0 * most
    })
}

impl Unlit {
    pub(super) fn new(columns: usize) -> Self {
        Self {
            grounds: vec![Ground { rows: [0.0; ROWS], changes: 0 }; columns],
            before: Strip::new(columns),
            contrasts: vec![f32::NAN; columns],
            ratios: Vec::with_capacity(columns),
        }
    }

    /// Forgets everything.
    pub(super) fn forget(&mut self) {
        self.before.clear();
        self.contrasts.fill(f32::NAN);
        self.grounds.iter_mut().for_each(|ground| ground.changes = 0);
    }

    /// How the laser has changed since the picture before, if it has.
    fn change(&mut self, columns: &[FloorColumn], grid: &Grid) -> Option<Change> {
        self.ratios.clear();
        for ((column, place), before) in columns.iter().zip(grid.columns()).zip(&self.contrasts) {
            if column.is_like_floor(place) && before.is_finite() {
                self.ratios.push(column.contrast() / before);
            }
        }
        let middle = self.ratios.len() / 2;
        if self.ratios.len() < FEWEST_COLUMNS {
            return None;
        }
        Change::of(*self.ratios.select_nth_unstable_by(middle, f32::total_cmp).1)
    }

    /// Keeps what the next picture is held against; `strip` becomes the memory of the one before that.
    fn keep(&mut self, columns: &[FloorColumn], grid: &Grid, strip: &mut Strip) {
        for ((kept, column), place) in self.contrasts.iter_mut().zip(columns).zip(grid.columns()) {
            *kept = if column.is_like_floor(place) { column.contrast() } else { f32::NAN };
        }
        std::mem::swap(&mut self.before, strip);
    }

    /// What a change of the laser tells of one column's ground, or that it does not fit what was told before.
    fn learn(&mut self, grid: &Grid, now: &Rows, change: Change, doubt: &Doubt<'_>, expected: &Expected) {
        let Some(ground) = self.grounds.get_mut(doubt.index) else { return };
        if !self.before.is_filled(doubt.index) {
            return;
        }
        let before = rows_of(&self.before, grid, doubt.index);
        let (bright, dim) = if change.is_brighter { (now, &before) } else { (&before, now) };
        let differences: Rows = std::array::from_fn(|row| bright[row] - dim[row]);
        let lost = 1.0 - change.share;
        let alike = lost * doubt.like.contrast / ALIKE_CHANGE..=lost * doubt.like.most * ALIKE_CHANGE;
        let is_stripe = expected.is_still(&differences)
            && expected.ridge(&differences).is_some_and(|ridge| alike.contains(&ridge.contrast));
        if !is_stripe {
            ground.changes = 0;
            return;
        }
        let told: Rows = std::array::from_fn(|row| {
            if expected.is_aside(row) {
                f32::midpoint(bright[row], dim[row])
            } else {
                dim[row] - differences[row] * change.share / lost
            }
        });
        let apart = told.iter().zip(&ground.rows).map(|(one, other)| (one - other).abs()).sum::<f32>();
        if ground.changes == 0 || apart > SAME_GROUND * ROWS as f32 {
            (ground.rows, ground.changes) = (told, 1);
            return;
        }
        ground.changes = (ground.changes + 1).min(MOST_CHANGES);
        let weight = 1.0 / f32::from(ground.changes);
        for (kept, told) in ground.rows.iter_mut().zip(told) {
            *kept += weight * (told - *kept);
        }
    }

    /// The stripe of one column over its ground, if the ground is known and still there.
    fn read(&self, now: &Rows, doubt: &Doubt<'_>, expected: &Expected) -> Option<Peak> {
        let ground = self.grounds.get(doubt.index).filter(|ground| ground.changes >= SURE_CHANGES)?;
        let light: Rows = std::array::from_fn(|row| now[row] - ground.rows[row]);
        let ridge = expected.ridge(&light).filter(|_| expected.is_still(&light))?;
        let crest = Peak { row: ridge.row + REACH as f32, ..ridge };
        if !is_alone(&light, &crest) {
            return None;
        }
        let least = (LEAST_ALIKE * doubt.like.contrast).max(SURE_CONTRAST);
        (least..=LIKE_RANGE * doubt.like.most).contains(&ridge.contrast).then_some(ridge)
    }
}

impl FloorFinder {
    /// Looks at the columns that are still in doubt with their ground taken away, where it is known; learns it.
    pub(super) fn subtract_ground<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        let Some(mut unlit) = self.unlit.take() else { return };
        let change = unlit.change(&self.columns, grid);
        self.pool.strip.fill(signal, grid, 0..self.columns.len());
        self.walk(grid, false, |finder, doubt| {
            let index = doubt.index;
            let now = rows_of(&finder.pool.strip, grid, index);
            let expected = Expected::of(doubt, S::STEP);
            if let Some(change) = change {
                unlit.learn(grid, &now, change, doubt, &expected);
            }
            let Some(ridge) = unlit.read(&now, doubt, &expected) else { return false };
            let column = &mut finder.columns[index];
            column.peak = Some(doubt.ridge(ridge.contrast.min(doubt.like.most), ridge.row));
            column.pooled = Some(true);
            true
        });
        unlit.keep(&self.columns, grid, &mut self.pool.strip);
        self.unlit = Some(unlit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_neither_flicker_nor_another_light() {
        let of = |ratio| Change::of(ratio).map(|change| (change.share, change.is_brighter));
        assert_eq!(of(0.6), Some((0.6, false)));
        assert_eq!(of(2.0), Some((0.5, true)));
        assert_eq!(of(0.9), Some((0.9, false)));
        for none in [0.91, 1.0, 1.1, 0.39, 2.6, 0.0, f32::INFINITY, f32::NAN] {
            assert_eq!(of(none), None, "{none}");
        }
    }

    #[test]
    fn a_ridge_with_another_one_beside_it_is_not_alone() {
        let peak = Peak { row: REACH as f32, contrast: 100.0, rise: 100.0, width: 4.0 };
        let with = |row: usize, value: f32| {
            let mut rows = [0.0; ROWS];
            rows[REACH - 1..=REACH + 1].fill(150.0);
            rows[row - 1..=row + 1].fill(value);
            is_alone(&rows, &peak)
        };
        assert!(with(REACH + 3, 90.0), "its own flank");
        assert!(with(REACH + 7, 30.0) && !with(REACH + 7, 31.0) && !with(REACH - 7, 31.0));
        let faint = Peak { contrast: 20.0, ..peak };
        assert!(is_alone(&[10.0; ROWS], &faint) && !is_alone(&[10.1; ROWS], &faint), "noise");
    }

    #[test]
    fn what_lies_beside_the_stripe_must_stay_and_the_stripe_need_not() {
        let expected = Expected { halo: 6, farthest: 1.5, kernel: Kernel::PIXELS };
        let with = |row: usize, value: f32| {
            let mut rows = [3.0; ROWS];
            rows[row] = value;
            expected.is_still(&rows)
        };
        assert!(with(REACH, 200.0) && with(REACH + 6, 200.0));
        assert!(!with(REACH + 7, 25.0) && with(REACH + 7, -24.0), "one row tells of an edge that has moved");
        assert!(!expected.is_still(&[10.1; ROWS]) && expected.is_still(&[10.0; ROWS]));
        let noisy = |most: f32| {
            let mut rows = [5.0; ROWS];
            rows[0] = most;
            expected.is_still(&rows)
        };
        assert!(noisy(35.0) && !noisy(35.5), "in noise, what stands out of it");
    }
}
