//! A stripe that is seen just beside the floor's rows, on a thing.
//!
//! What the matched filter and the averages along the stripe find at the floor's rows may be no more than the foot of a much
//! stronger ridge close by: the stripe on a low thing. A column has one stripe there, and it is the strong one.

use crate::vision::grid::GridColumn;
use crate::vision::signal::Signal;

/// Rows aside in which it is looked for, in widths of the stripe.
const FARTHEST_WIDTHS: f32 = 4.0;
/// The ground beside it is the lowest level within so many widths on each side.
const GROUND_WIDTHS: f32 = 1.5;

/// Contrast of the strongest ridge of one column beside the rows that are the floor's, levels; zero where there is none.
pub fn strongest_beside<S: Signal>(signal: S, column: usize, place: &GridColumn) -> f32 {
    let far = place.tolerance + FARTHEST_WIDTHS * place.width;
    let first = (place.floor_row - far).max(0.0) as usize;
    let end = ((place.floor_row + far) as usize + 1).min(signal.rows());
    let ground = (GROUND_WIDTHS * place.width).ceil() as usize + 1;
    let value = |row: usize| signal.value(column, row);
    let mut strongest = 0;
    for row in first..end {
        // The rims of the stripe's own overexposed core lie half a width from its middle, and a little more.
        if (row as f32 - place.floor_row).abs() <= place.tolerance.max(place.width) {
            continue;
        }
        let crest = value(row);
        let is_crest = value(row.saturating_sub(1)) <= crest && value(row + 1) <= crest;
        if i32::from(crest) <= strongest || !is_crest {
            continue;
        }
        let above = (row.saturating_sub(ground)..row).map(value).min();
        let below = (row + 1..(row + ground + 1).min(signal.rows())).map(value).min();
        let (Some(above), Some(below)) = (above, below) else { continue };
        strongest = strongest.max(i32::from(crest) - i32::from(above.max(below)));
    }
    strongest as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Plane;
    use crate::vision::signal::Brightness;

    fn beside(level: impl Fn(usize) -> u8) -> f32 {
        let bytes: Vec<u8> = (0..60).map(level).collect();
        let place = GridColumn {
            floor_row: 30.0,
            nearest_row: 30,
            place: 0.0,
            tolerance: 2.0,
            width: 3.0,
            first_row: 0,
            end_row: 60,
        };
        strongest_beside(Brightness(Plane::new(&bytes, 1, 1, 60).unwrap()), 0, &place)
    }

    #[test]
    fn a_ridge_beside_the_floors_rows_is_found_and_an_edge_is_none() {
        assert_eq!(beside(|row| if (33..36).contains(&row) { 180 } else { 20 }), 160.0);
        assert_eq!(beside(|row| if row >= 33 { 180 } else { 20 }), 0.0, "the edge of a paint");
        assert_eq!(beside(|row| if (29..32).contains(&row) { 180 } else { 20 }), 0.0, "the floor's own");
        assert_eq!(beside(|_| 90), 0.0);
    }
}
