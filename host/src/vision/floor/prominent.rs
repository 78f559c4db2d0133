//! A stripe that stands out from what lies right beside it, with the edge of a paint a few rows farther on.
//!
//! Backgrounds are means over several rows, and the edge of a paint within them hides a stripe that the eye still sees: a
//! narrow crest with a valley on either side. An edge makes no valley, however it is blurred; only what the camera's
//! sharpening adds to it is one, a small share of its step. So the crest is measured from the higher of its two valleys,
//! on a profile that is averaged along the stripe over less than the shortest gap that must be seen.

use super::pitch;
use super::strip::Strip;
use crate::vision::grid::Grid;

/// Length of the stripe that is averaged, millimetres.
const POOLED_MM: f32 = 2.5;
/// Columns to both sides that it may need.
pub const COLUMNS_ASIDE: usize = 12;
/// A valley is looked for so far from the crest: in widths of the stripe, and rows more.
const VALLEY_WIDTHS: f32 = 1.5;
const VALLEY_ROWS: f32 = 1.0;
/// Most rows to each side.
const MOST_ROWS: usize = 16;
/// The crest is looked for so many rows from the floor's.
const CREST_ROWS: usize = 2;
/// What sharpening adds to an edge is less than this share of its step.
const OVERSHOOT_SHARE: f32 = 0.1;
/// Grounds that differ by less than so many levels hide nothing: then the usual measure tells.
const LEAST_STEP: f32 = 25.0;
/// A stripe is no wider than so many times what is expected, and rows more for the averaging.
const WIDEST: f32 = 1.5;
const WIDER_ROWS: f32 = 1.0;

/// A crest between two valleys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crest {
    /// Levels over the higher valley.
    pub height: f32,
    /// Rows below the floor's row.
    pub offset: f32,
}

/// The crest of one column near the floor's row, of a stripe of this width beside an edge; `None` if there is no narrow one.
pub fn read(strip: &Strip, grid: &Grid, index: usize, width: f32) -> Option<Crest> {
    let reach = ((VALLEY_WIDTHS * width + VALLEY_ROWS).ceil() as usize).min(MOST_ROWS - CREST_ROWS);
    let middle = reach + CREST_ROWS;
    let mut rows = [0.0_f32; 2 * MOST_ROWS + 1];
    let rows = &mut rows[..=2 * middle];
    average(strip, grid, index, rows);
    let near = middle - CREST_ROWS..=middle + CREST_ROWS;
    let crest = near.max_by(|one, other| rows[*one].total_cmp(&rows[*other]))?;
    let valley = |side: &[f32]| side.iter().copied().fold(f32::INFINITY, f32::min);
    let higher = valley(&rows[crest - reach..crest]).max(valley(&rows[crest + 1..=crest + reach]));
    let height = rows[crest] - higher;
    let half = rows[crest] - height / 2.0;
    let above = rows[..crest].iter().rev().take_while(|row| **row >= half).count();
    let below = rows[crest + 1..].iter().take_while(|row| **row >= half).count();
    let is_narrow = (above + 1 + below) as f32 <= WIDEST * width + WIDER_ROWS;
    let step = step_across(rows, crest, width);
    if !is_narrow || step < LEAST_STEP || height <= OVERSHOOT_SHARE * step {
        return None;
    }
    let [before, here, after] = [rows[crest - 1], rows[crest], rows[crest + 1]];
    let curve = before - 2.0 * here + after;
    let vertex = if curve < 0.0 { ((before - after) / (2.0 * curve)).clamp(-0.5, 0.5) } else { 0.0 };
    Some(Crest { height, offset: crest as f32 - middle as f32 + vertex })
}

/// How much the grounds on both sides of a crest differ.
fn step_across(rows: &[f32], crest: usize, width: f32) -> f32 {
    let near = width.ceil() as usize;
    let mean = |side: &[f32]| side.iter().sum::<f32>() / side.len().max(1) as f32;
    let (above, below) = (&rows[..crest.saturating_sub(near)], &rows[(crest + near + 1).min(rows.len())..]);
    (mean(above) - mean(below)).abs()
}

/// The rows about the floor's row, averaged along the stripe; the middle one is at the floor's row.
pub(super) fn average(strip: &Strip, grid: &Grid, index: usize, rows: &mut [f32]) {
    let far = (rows.len() / 2) as isize;
    let reach = POOLED_MM / 2.0 / pitch(grid, index).max(0.05);
    let columns = ((reach + 0.5) as usize).min(COLUMNS_ASIDE);
    let mut weights = 0.0;
    for other in index.saturating_sub(columns)..(index + columns + 1).min(strip.columns()) {
        let weight = (reach + 0.5 - other.abs_diff(index) as f32).clamp(0.0, 1.0);
        // A strip's rows are whole rows about the nearest one.
        let fraction = grid.columns()[other].floor_row - grid.columns()[other].floor_row.round();
        let (back, share) = if fraction < 0.0 { (1, 1.0 + fraction) } else { (0, fraction) };
        weights += weight;
        for (aside, row) in (-far..=far).zip(rows.iter_mut()) {
            let one = strip.value(other, aside - back);
            let next = strip.value(other, aside - back + 1);
            *row += weight * (one + share * (next - one));
        }
    }
    rows.iter_mut().for_each(|row| *row /= weights);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery::CENTRE;
    use crate::vision::grid::{LASER_SHEET_MM, picture_geometry};

    const MIDDLE: usize = 250;
    const WIDTH: f32 = 2.0;

    /// What is read of a strip in which each value follows from its rows below the floor's row.
    fn seen(value: impl Fn(f32) -> f32) -> Option<Crest> {
        let rig = CENTRE.rig().unwrap();
        let grid = Grid::new(&picture_geometry(&rig).unwrap(), &rig, LASER_SHEET_MM, 2);
        let strip = Strip::drawn(grid.columns().len(), |column, aside| {
            let floor_row = grid.columns()[column].floor_row;
            value(floor_row.round() + aside as f32 - floor_row).round() as i16
        });
        read(&strip, &grid, MIDDLE, WIDTH)
    }

    /// Paint of so many levels beyond an edge.
    fn paint(levels: f32, edge: f32, row: f32) -> f32 {
        levels / (1.0 + (-3.0 * (row - edge)).exp())
    }

    fn stripe(height: f32, width: f32, row: f32) -> f32 {
        height * (-0.5 * (row * 2.355 / width).powi(2)).exp()
    }

    #[test]
    fn a_stripe_with_a_paint_a_few_rows_farther_on_is_seen_at_its_own_row() {
        for edge in [3.5, 4.0, 4.5] {
            for height in [25.0, 60.0] {
                let crest = seen(|row| paint(130.0, edge, row) + stripe(height, WIDTH, row));
                let crest = crest.unwrap_or_else(|| panic!("edge at {edge}, height {height}: none"));
                assert!((0.5 * height..=height + 5.0).contains(&crest.height), "{edge}: {crest:?}");
                assert!(crest.offset.abs() <= 0.5, "{edge}: {crest:?}");
            }
        }
    }

    #[test]
    fn an_edge_is_no_crest_nor_is_what_sharpening_adds_to_it() {
        for edge in [-1.0, 0.0, 1.0, 2.0, 4.0] {
            assert_eq!(seen(|row| paint(130.0, edge, row)), None, "edge at {edge}");
            let sharpened = |row| paint(130.0, edge, row) + stripe(12.0, WIDTH, row - edge - 1.5);
            assert_eq!(seen(sharpened), None, "sharpened edge at {edge}");
        }
    }

    #[test]
    fn what_is_broad_is_no_stripe() {
        assert_eq!(seen(|row| paint(130.0, 5.0, row) + stripe(60.0, 4.0 * WIDTH, row)), None);
    }

    /// A thing has the same ground above and below.
    #[test]
    fn on_an_even_ground_the_usual_measure_tells() {
        assert_eq!(seen(|row| stripe(60.0, WIDTH, row)), None);
        assert_eq!(seen(|row| paint(LEAST_STEP - 2.0, 4.5, row) + stripe(60.0, WIDTH, row)), None);
        assert!(seen(|row| paint(LEAST_STEP + 20.0, 4.0, row) + stripe(60.0, WIDTH, row)).is_some());
    }
}
