//! A stripe on the edge of a paint, seen in the mixture of colour and brightness in which that edge does not show.
//!
//! Two grounds differ in the laser's colour and in brightness by other shares than the laser's light does. So there is a
//! mixture of the two in which both grounds are alike; what lies on their edge, however frayed, is then like them too, and
//! a stripe stands out by what the mixture leaves of it. Only the camera's tone curve does not mix as light does: it bends
//! the edge a little, by most where the grounds share a sample half and half.

use super::pitch;
use crate::vision::grid::Grid;
use crate::vision::ridge::Kernel;
use crate::vision::signal::Signal;

/// Length of the stripe that is averaged, millimetres.
const POOLED_MM: f32 = 2.5;
/// Columns to each side that are averaged at most.
const MOST_COLUMNS: usize = 12;
/// Most rows to each side that belong to the stripe, and of background.
const MOST_NEAR: usize = 8;
const MOST_LENGTH: usize = 5;
const MOST_ROWS: usize = 2 * (MOST_NEAR + MOST_LENGTH) + 1;
/// Grounds that differ by less than so many levels have no edge that hides anything.
const LEAST_STEP: f32 = 25.0;
/// A mixture that leaves less than this share of the stripe shows none.
const LEAST_LEFT: f32 = 0.2;
/// The tone curve bends an edge by no more than this share of the step: what is higher needs no other explanation ...
const BENT_SHARE: f32 = 0.08;
/// ... what is lower must be more than this share, beside a bend that explains the rest and is no more than this.
const LEAST_SHARE: f32 = 0.03;
const MOST_BENT_SHARE: f32 = 0.1;
/// A ridge that lies on the edge itself looks like its bend, and cannot be told from it: determinant of their fit.
const LEAST_UNLIKE: f32 = 0.2;
/// The ridge must be so many times as high as what it leaves unexplained (root mean square).
const LEAST_OF_REST: f32 = 4.0;
/// It is looked for at every quarter of a row.
const STEP_ROWS: f32 = 0.25;

/// Laser strength and brightness of a row.
type Colour = [f32; 2];

/// A stripe in the mixture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnpaintedRidge {
    /// Height that it has without the mixture, levels.
    pub height: f32,
    /// Height in the mixture, levels.
    pub seen: f32,
    /// Rows below the floor's row.
    pub offset: f32,
}

/// The mixture of two grounds.
#[derive(Debug, Clone, Copy)]
struct Mixture {
    above: Colour,
    step: Colour,
    /// Length of the step.
    whole: f32,
    /// Shares of laser strength and brightness.
    shares: Colour,
}

impl Mixture {
    /// In which two grounds are alike; `None` if they are alike anyway, or if it leaves nothing of a stripe.
    fn of(above: Colour, below: Colour) -> Option<Self> {
        let step = [below[0] - above[0], below[1] - above[1]];
        let whole = step[0].hypot(step[1]);
        // A stripe adds to the laser's colour and next to nothing to brightness in other light.
        let shares = [step[1].abs() / whole, -step[0] * step[1].signum() / whole];
        (whole >= LEAST_STEP && shares[0] >= LEAST_LEFT).then_some(Self { above, step, whole, shares })
    }

    /// What a row has more than the grounds.
    fn mixed(&self, row: Colour) -> f32 {
        self.shares[0] * (row[0] - self.above[0]) + self.shares[1] * (row[1] - self.above[1])
    }

    /// How much a bend shows in a row, 0 to 1: not on either ground, most half way between.
    fn bend(&self, row: Colour) -> f32 {
        let along = (row[0] - self.above[0]) * self.step[0] + (row[1] - self.above[1]) * self.step[1];
        let share = (along / (self.whole * self.whole)).clamp(0.0, 1.0);
        4.0 * share * (1.0 - share)
    }
}

/// A column's rows in the mixture, and how much a bend shows in each.
struct Rows {
    mixed: [f32; MOST_ROWS],
    bend: [f32; MOST_ROWS],
    count: usize,
}

/// How a bell, and a bend if there is one, explain the rows.
#[derive(Debug, Clone, Copy)]
struct Fit {
    /// The bell's place below the middle, rows.
    offset: f32,
    height: f32,
    bent: f32,
    /// What they leave (root mean square).
    rest: f32,
}

impl Fit {
    /// Is it a ridge of at least this height, on an edge whose bend is none that is too large?
    fn is_sure(&self, least: f32, most_bent: f32) -> bool {
        self.height >= (LEAST_OF_REST * self.rest).max(least) && self.bent.abs() <= most_bent
    }
}

impl Rows {
    /// The bell of this width that explains most, with a bend or without; `None` if none is higher than its background.
    fn best(&self, width: f32, farthest: f32, with_bend: bool) -> Option<Fit> {
        let steps = (farthest / STEP_ROWS) as i16;
        let offsets = (-steps..=steps).map(|step| f32::from(step) * STEP_ROWS);
        let fits = offsets.filter_map(|offset| self.fit(width, offset, with_bend));
        fits.filter(|fit| fit.height > 0.0).min_by(|one, other| one.rest.total_cmp(&other.rest))
    }

    /// Least squares for a bell at one place.
    fn fit(&self, width: f32, offset: f32, with_bend: bool) -> Option<Fit> {
        let middle = (self.count / 2) as f32;
        let deviation = width.max(1.5) / 2.355;
        let [mut total, mut bells, mut bends, mut both, mut by_bell, mut by_bend] = [0.0_f32; 6];
        let samples = self.mixed.iter().zip(&self.bend).take(self.count);
        for (row, (value, bend)) in samples.enumerate() {
            let distance = (row as f32 - middle - offset) / deviation;
            let bell = (-0.5 * distance * distance).exp();
            total += value * value;
            bells += bell * bell;
            by_bell += bell * value;
            if with_bend {
                bends += bend * bend;
                both += bell * bend;
                by_bend += bend * value;
            }
        }
        let determinant = bells * bends - both * both;
        let (height, bent) = if bends == 0.0 {
            (by_bell / bells, 0.0)
        } else if determinant >= LEAST_UNLIKE * bells * bends {
            (
                (by_bell * bends - by_bend * both) / determinant,
                (by_bend * bells - by_bell * both) / determinant,
            )
        } else {
            return None;
        };
        let rest = (total - height * by_bell - bent * by_bend).max(0.0) / self.count as f32;
        Some(Fit { offset, height, bent, rest: rest.sqrt() })
    }
}

/// Rows to each side that belong to a stripe of this width, and rows of background beyond.
fn extent(width: f32) -> (usize, usize) {
    let kernel = Kernel::for_width(width);
    (kernel.near.min(MOST_NEAR), kernel.length().clamp(2, MOST_LENGTH))
}

/// The stripe of one column, this wide and at most `farthest` rows from the floor's row, if it is sure.
pub fn read<S: Signal>(
    signal: S,
    grid: &Grid,
    index: usize,
    width: f32,
    farthest: f32,
) -> Option<UnpaintedRidge> {
    let (near, length) = extent(width);
    let far = near + length;
    let mut rows = [[0.0_f32; 2]; MOST_ROWS];
    let rows = &mut rows[..=2 * far];
    average(signal, grid, index, rows);
    let (above, below) = (mean(&rows[..length]), mean(&rows[rows.len() - length..]));
    let mixture = Mixture::of(above, below)?;
    let mut column = Rows { mixed: [0.0; MOST_ROWS], bend: [0.0; MOST_ROWS], count: rows.len() };
    for ((mixed, bend), row) in column.mixed.iter_mut().zip(&mut column.bend).zip(rows.iter()) {
        (*mixed, *bend) = (mixture.mixed(*row), mixture.bend(*row));
    }
    let whole = mixture.whole;
    let sure = |with_bend, least, most_bent: f32| {
        let fit = column.best(width, farthest, with_bend);
        fit.filter(|fit| fit.is_sure(least * whole, most_bent * whole))
    };
    let fit = sure(false, BENT_SHARE, 0.0).or_else(|| sure(true, LEAST_SHARE, MOST_BENT_SHARE))?;
    Some(UnpaintedRidge { height: fit.height / mixture.shares[0], seen: fit.height, offset: fit.offset })
}

fn mean(rows: &[Colour]) -> Colour {
    [0, 1].map(|part| rows.iter().map(|row| row[part]).sum::<f32>() / rows.len().max(1) as f32)
}

/// Laser strength and brightness of the grounds above and below a stripe of this width in one column, levels.
pub fn grounds<S: Signal>(signal: S, grid: &Grid, index: usize, width: f32) -> [Colour; 2] {
    let (near, length) = extent(width);
    let (column, middle) = (grid.first() + index, grid.columns()[index].nearest_row);
    [-1, 1].map(|sign| {
        let mut rows = [[0.0_f32; 2]; MOST_LENGTH];
        for (aside, row) in rows.iter_mut().take(length).enumerate() {
            *row = sample(signal, column, middle + sign * (near + aside) as isize);
        }
        mean(&rows[..length])
    })
}

/// Laser strength and brightness; the picture's outermost rows stand for those beyond it.
fn sample<S: Signal>(signal: S, column: usize, row: isize) -> Colour {
    let row = row.clamp(0, signal.rows().saturating_sub(1) as isize) as usize;
    [f32::from(signal.value(column, row)), f32::from(signal.tone(column, row))]
}

/// The rows about the floor's row, averaged along the stripe; the middle one is at the floor's row.
fn average<S: Signal>(signal: S, grid: &Grid, index: usize, rows: &mut [Colour]) {
    let far = (rows.len() / 2) as isize;
    let reach = POOLED_MM / 2.0 / pitch(grid, index).max(0.05);
    let columns = ((reach + 0.5) as usize).min(MOST_COLUMNS);
    let mut weights = 0.0;
    for other in index.saturating_sub(columns)..(index + columns + 1).min(grid.columns().len()) {
        let weight = (reach + 0.5 - other.abs_diff(index) as f32).clamp(0.0, 1.0);
        let floor_row = grid.columns()[other].floor_row;
        let (lowest, share) = (floor_row.floor() as isize, floor_row - floor_row.floor());
        let column = grid.first() + other;
        weights += weight;
        let mut before = sample(signal, column, lowest - far);
        for (aside, row) in (-far..=far).zip(rows.iter_mut()) {
            let after = sample(signal, column, lowest + aside + 1);
            for part in 0..2 {
                row[part] += weight * (before[part] + share * (after[part] - before[part]));
            }
            before = after;
        }
    }
    rows.iter_mut().for_each(|row| *row = row.map(|value| value / weights));
}

#[cfg(test)]
mod tests;
