use super::*;
use crate::capture::Plane;
use crate::twin::gallery::CENTRE;
use crate::vision::grid::{LASER_SHEET_MM, picture_geometry};
use crate::vision::signal::RedMinusGreen;

const WIDTH: f32 = 4.0;
const FARTHEST: f32 = 2.0;
const YELLOW: [f32; 3] = [205.0, 165.0, 45.0];
const RED: [f32; 3] = [200.0, 60.0, 50.0];
const GREY: [f32; 3] = [90.0, 90.0, 90.0];

/// A picture of two grounds with an edge `edge` rows below the floor's row, frayed as a lens does it (light mixes, the camera
/// then bends it), and a stripe of this height in red, `at` rows below the floor's row. What is read in its middle column.
fn seen(above: [f32; 3], below: [f32; 3], edge: f32, height: f32, at: f32) -> Option<UnpaintedRidge> {
    let rig = CENTRE.with_width(1152).rig().unwrap();
    let grid = Grid::new(&picture_geometry(&rig).unwrap(), &rig, LASER_SHEET_MM, 1);
    let index = grid.columns().len() / 2;
    let (columns, rows) = (usize::from(rig.image().width), usize::from(rig.image().height));
    let mut bytes = vec![0; 3 * columns * rows];
    for (place, pixel) in bytes.chunks_exact_mut(3).enumerate() {
        let (column, row) = (place % columns, place / columns);
        let Some(entry) = column.checked_sub(grid.first()).and_then(|index| grid.columns().get(index)) else {
            continue;
        };
        let from_floor = row as f32 - entry.floor_row;
        let share = 1.0 / (1.0 + (-1.8 * (from_floor - edge)).exp());
        let deviation = WIDTH / 2.355;
        let stripe = height * (-0.5 * ((from_floor - at) / deviation).powi(2)).exp();
        // A level or two of noise that follow from the place.
        let noise = ((column * 7919 + row * 104_729) % 5) as f32 / 2.0 - 1.0;
        for (part, byte) in pixel.iter_mut().enumerate() {
            let light = above[part].powf(2.2) * (1.0 - share) + below[part].powf(2.2) * share;
            let laser = [stripe, 0.05 * stripe, 0.2 * stripe][part];
            *byte = (light.powf(1.0 / 2.2) + laser + noise).round().clamp(0.0, 255.0) as u8;
        }
    }
    let signal = RedMinusGreen(Plane::new(&bytes, 3 * columns, 3 * columns, rows).unwrap());
    read(signal, &grid, index, WIDTH, FARTHEST + 1.0)
}

const EDGES: [f32; 9] = [-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0];

/// Wherever the edge lies, on the stripe's own middle too.
#[test]
fn a_stripe_on_the_edge_of_a_paint_is_seen() {
    for (above, below) in [(YELLOW, GREY), (GREY, YELLOW), (RED, GREY), (GREY, RED)] {
        for edge in EDGES {
            let ridge = seen(above, below, edge, 45.0, 0.0);
            let ridge = ridge.unwrap_or_else(|| panic!("{above:?} {below:?}, edge at {edge}: none"));
            assert!((ridge.height - 45.0).abs() < 25.0, "{above:?} {below:?}, edge at {edge}: {ridge:?}");
            assert!(ridge.offset.abs() <= 0.75, "{above:?} {below:?}, edge at {edge}: {ridge:?}");
        }
    }
}

/// The bend that the camera's curve gives an edge is no stripe, whichever ground is above.
#[test]
fn an_edge_without_a_stripe_has_none() {
    for (above, below) in [(YELLOW, GREY), (GREY, YELLOW), (RED, GREY), (GREY, RED), (YELLOW, RED)] {
        for edge in EDGES {
            let ridge = seen(above, below, edge, 0.0, 0.0);
            assert!(ridge.is_none_or(|ridge| ridge.height < 15.0), "{above:?}, edge at {edge}: {ridge:?}");
        }
    }
}

/// A stripe that lies on a thing is read where it is, so that nobody takes it for the floor's.
#[test]
fn a_stripe_farther_off_is_read_where_it_lies() {
    for at in [-2.5, 2.5] {
        let ridge = seen(YELLOW, GREY, 0.5, 60.0, at).expect("bright enough");
        assert!((ridge.offset - at).abs() <= 0.75, "{at}: {ridge:?}");
    }
}

#[test]
fn grounds_that_are_alike_or_differ_in_red_alone_have_no_mixture() {
    assert!(Mixture::of([10.0, 90.0], [10.0, 90.0 + LEAST_STEP - 1.0]).is_none(), "alike");
    assert!(Mixture::of([10.0, 90.0], [10.0, 90.0 + LEAST_STEP]).is_some(), "as unlike as is asked for");
    assert!(
        Mixture::of([0.0, 90.0], [100.0, 90.0]).is_none(),
        "red alone: it would leave nothing of a stripe"
    );
    assert!(Mixture::of([0.0, 90.0], [100.0, 60.0]).is_some());
}

#[test]
fn in_the_mixture_both_grounds_are_alike() {
    let (above, below) = ([40.0, 165.0], [0.0, 90.0]);
    let mixture = Mixture::of(above, below).unwrap();
    assert!(mixture.mixed(above).abs() < 1e-3 && mixture.mixed(below).abs() < 1e-3);
    assert!(mixture.bend(above) == 0.0 && mixture.bend(below).abs() < 1e-3);
    assert!((mixture.bend([20.0, 127.5]) - 1.0).abs() < 1e-3, "half way between");
    assert!(mixture.mixed([90.0, 165.0]) > 40.0, "a stripe on the paint");
}
