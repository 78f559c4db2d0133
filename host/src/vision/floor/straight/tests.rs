use super::*;
use crate::twin::gallery::CENTRE;
use crate::vision::grid::{LASER_SHEET_MM, picture_geometry};

const MIDDLE: usize = 250;
const EXPECTED: (f32, f32) = (0.0, 2.0);

fn grid() -> Grid {
    let rig = CENTRE.rig().unwrap();
    Grid::new(&picture_geometry(&rig).unwrap(), &rig, LASER_SHEET_MM, 2)
}

/// Paint of 130 levels beyond an edge that rises by one row in `columns_to_row` columns and meets the stripe in the
/// middle column; a stripe of this height; and whatever else lies there.
fn strip(grid: &Grid, columns_to_row: f32, height: f32, other: impl Fn(f32, f32) -> f32) -> Strip {
    let middle = grid.columns()[MIDDLE].floor_row;
    Strip::drawn(grid.columns().len(), |column, aside| {
        let floor_row = grid.columns()[column].floor_row;
        let row = floor_row.round() + aside as f32;
        let along = column as f32 - MIDDLE as f32;
        let edge = (row - middle - along / columns_to_row) / (1.0 / columns_to_row).hypot(1.0);
        let paint = 130.0 / (1.0 + (-3.0 * edge).exp());
        let from_floor = row - floor_row;
        let stripe = height * (-0.5 * (from_floor / (EXPECTED.1 / 2.355)).powi(2)).exp();
        // A few levels of noise that follow from the place.
        let noise = ((column * 7919 + (aside + 64) as usize * 104_729) % 5) as f32 / 2.0 - 1.0;
        (paint + stripe + noise + other(along, from_floor)).round() as i16
    })
}

/// Columns around the middle, with what is found in them.
fn found(grid: &Grid, strip: &Strip) -> Vec<(usize, Option<UncoveredRidge>)> {
    let edge = StraightEdge::at(strip, grid, MIDDLE, EXPECTED.1);
    let read = |column| edge.as_ref().and_then(|edge| edge.uncover(strip, grid, column, EXPECTED));
    (MIDDLE - 6..=MIDDLE + 6).map(|column| (column, read(column))).collect()
}

/// A stripe a tenth as strong as the paint is, which no single column could tell from the paint's edge. Only where the edge
/// passes through the stripe's own middle may it stay hidden.
#[test]
fn a_faint_stripe_is_seen_once_the_edge_is_taken_away() {
    let grid = grid();
    for columns_to_row in [1.0, -1.5, 3.0, -5.0] {
        let strip = strip(&grid, columns_to_row, 14.0, |_, _| 0.0);
        for (column, ridge) in found(&grid, &strip) {
            let rows = (column as f32 - MIDDLE as f32) / columns_to_row;
            let from_edge = rows.abs() / (1.0 / columns_to_row).hypot(1.0);
            let Some(ridge) = ridge else {
                assert!(from_edge < 1.2, "{columns_to_row} columns to a row, {column}: hidden");
                continue;
            };
            assert!((ridge.height - 14.0).abs() < 8.0, "{columns_to_row}, {column}: {ridge:?}");
            assert!(ridge.offset.abs() <= 1.0, "{columns_to_row}, {column}: {ridge:?}");
        }
    }
}

#[test]
fn an_edge_without_a_stripe_leaves_nothing() {
    let grid = grid();
    for columns_to_row in [1.0, -1.5, 3.0, -5.0] {
        let strip = strip(&grid, columns_to_row, 0.0, |_, _| 0.0);
        assert_eq!(StraightEdge::at(&strip, &grid, MIDDLE, EXPECTED.1).map(|_| ()), Some(()));
        for (column, ridge) in found(&grid, &strip) {
            assert!(ridge.is_none_or(|ridge| ridge.height < 8.0), "{columns_to_row}, {column}: {ridge:?}");
        }
    }
}

/// A thing on the stripe has a body above and below it too.
#[test]
fn where_anything_else_than_the_edge_is_seen_nothing_is_said() {
    let grid = grid();
    let thing = |along: f32, _: f32| if along.abs() < 3.0 { -60.0 } else { 0.0 };
    let strip = strip(&grid, 3.0, 14.0, thing);
    assert!(StraightEdge::at(&strip, &grid, MIDDLE, EXPECTED.1).is_none());
}

#[test]
fn without_an_edge_there_is_none() {
    let grid = grid();
    let plain = Strip::drawn(grid.columns().len(), |_, aside| if aside == 0 { 90 } else { 4 });
    assert!(StraightEdge::at(&plain, &grid, MIDDLE, EXPECTED.1).is_none());
}
