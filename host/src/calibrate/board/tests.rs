//! ChArUco boards, drawn here square by square and bit by bit through a known lens, so that every corner's truth is exact.

use std::path::Path;

use calib_targets::aruco::Dictionary;
use image::DynamicImage;
use nearfield_shared::camera::{Camera, Vector};
use nearfield_shared::rig::ImageSize;

use super::*;
use crate::calibrate::lens::{LensKnowledge, calibrate_lens};
use crate::twin::board::{PaintedBoard, lens_views};
use crate::twin::gallery::CENTRE;
use crate::twin::random::Dice;

/// Squares along the long and the short side.
const SQUARES: [u32; 2] = [10, 7];
const SQUARE_MM: f64 = 30.0;
const MARKER_SHARE: f64 = 0.75;
const SEED: u64 = 20_261_122;
const BLACK: f64 = 35.0;
const WHITE: f64 = 205.0;

fn board(pattern: &str) -> Board {
    Board { pattern: pattern.parse().unwrap(), square_mm: SQUARE_MM }
}

/// Is the marker black at this place of its square (shares of the square, y down)? A frame of one bit, then the code,
/// row by row, its lowest bit first.
fn is_marker_black(dictionary: &Dictionary, marker: usize, [x, y]: [f64; 2]) -> bool {
    let bits = dictionary.marker_size();
    let margin = (1.0 - MARKER_SHARE) / 2.0;
    let cell = |at: f64| ((at - margin) / MARKER_SHARE * (bits + 2) as f64).floor();
    let (column, row) = (cell(x), cell(y));
    let end = (bits + 2) as f64;
    if column < 0.0 || row < 0.0 || column >= end || row >= end {
        return false;
    }
    let (column, row) = (column as usize, row as usize);
    let is_frame = [column, row].iter().any(|cell| *cell == 0 || *cell == bits + 1);
    is_frame || (dictionary.codes()[marker] >> ((row - 1) * bits + column - 1)) & 1 == 1
}

/// Grey level of a place on the board, millimetres from its middle, y up: black where column and row are both even or
/// both odd, markers counted along the rows in the white squares.
fn level(dictionary: &Dictionary, x: f64, y: f64) -> f64 {
    let [columns, rows] = SQUARES.map(f64::from);
    let (column, row) = (x / SQUARE_MM + columns / 2.0, rows / 2.0 - y / SQUARE_MM);
    if column < 0.0 || row < 0.0 || column >= columns || row >= rows {
        return WHITE;
    }
    let square = [column.floor(), row.floor()];
    if (square[0] + square[1]).rem_euclid(2.0) < 0.5 {
        return BLACK;
    }
    let number = (square[1] * columns + square[0]) as usize;
    // Every second square of an even number of columns is white.
    let marker = number / 2;
    if is_marker_black(dictionary, marker, [column - square[0], row - square[1]]) { BLACK } else { WHITE }
}

fn picture(dictionary: &Dictionary, camera: &Camera, size: ImageSize, seed: u64) -> CalibrationPicture {
    let mut dice = Dice::new(seed);
    let centre = camera.pose.centre();
    let grey = image::GrayImage::from_fn(u32::from(size.width), u32::from(size.height), |u, v| {
        let mut sum = 0.0;
        for part in 0..9 {
            let offset = |part: u32| f64::from(part) / 3.0 - 1.0 / 3.0;
            let pixel = Pixel { u: f64::from(u) + offset(part % 3), v: f64::from(v) + offset(part / 3) };
            let sight = camera.line_of_sight(pixel).unwrap();
            let reach = -centre.z / sight.z;
            sum += if reach > 0.0 {
                level(dictionary, centre.x + reach * sight.x, centre.y + reach * sight.y)
            } else {
                WHITE
            };
        }
        image::Luma([(sum / 9.0 + 2.0 * dice.normal()).round().clamp(0.0, 255.0) as u8])
    });
    CalibrationPicture::new(Path::new("drawn.png"), &DynamicImage::ImageLuma8(grey))
}

/// The cameras of a lens calibration, and their pictures of the board.
fn views(count: usize) -> Vec<(Camera, CalibrationPicture)> {
    println!("seed {SEED}");
    let rig = CENTRE.rig().unwrap();
    let dictionary = builtin_dictionary("DICT_4X4_50").unwrap();
    let geometry = PaintedBoard { corners: SQUARES.map(|squares| squares - 1), square_mm: SQUARE_MM };
    let cameras = lens_views(&rig.camera().intrinsics, rig.image(), &geometry);
    let numbered = (SEED..).zip(cameras).take(count);
    numbered.map(|(seed, camera)| (camera, picture(&dictionary, &camera, rig.image(), seed))).collect()
}

/// The rule: each corner is the one that its marker numbers name, with x along the rows, z out of the printed side, and
/// lies where the lens shows it to a pixel, to a third of one in the mean; and the lens that follows has its focal length
/// to 0.3 %.
#[test]
fn a_charuco_boards_corners_are_where_its_markers_say_and_give_the_lens() {
    let board = board("charuco:10x7:0.75:DICT_4X4_50");
    let rig = CENTRE.rig().unwrap();
    let mut seen = Vec::new();
    for (index, (camera, picture)) in views(8).iter().enumerate() {
        let view = board.find(picture).unwrap_or_else(|error| panic!("view {index}: {error}"));
        assert!(view.corners.len() * 10 >= 9 * view.expected, "view {index}: {} corners", view.corners.len());
        let mut sum = 0.0;
        for corner in &view.corners {
            let place = Vector::new(corner.place.x, corner.place.y, 0.0);
            let truth = camera.project(place).unwrap();
            let error = (truth.u - corner.pixel.u).hypot(truth.v - corner.pixel.v);
            assert!(error < 1.0, "view {index}, {place:?}: {error} px from {truth:?}");
            sum += error;
        }
        let mean = sum / view.corners.len() as f64;
        println!("view {index}: {} corners, {mean:.3} px in the mean", view.corners.len());
        assert!(mean < 1.0 / 3.0, "view {index}: {mean} px");
        seen.push(view);
    }
    let truth = rig.camera().intrinsics;
    let found = calibrate_lens(rig.image(), &seen, &LensKnowledge::nominal(rig.image(), 66.0)).unwrap();
    let error = found.fit.model.lens.fx / truth.fx - 1.0;
    assert!(error.abs() < 0.003, "focal length {error} off, {} px", found.reprojection_error());
}

/// A board that is not the one that was named is refused, and the message says what to check.
#[test]
fn another_charuco_board_than_the_one_named_is_refused() {
    let (_, picture) = views(1).remove(0);
    for wrong in ["charuco:10x7:0.75:DICT_6X6_50", "charuco:14x12:0.75:DICT_4X4_1000"] {
        let message = board(wrong).find(&picture).unwrap_err().to_string();
        assert!(message.contains("drawn.png") && message.contains("--board"), "{wrong}: {message}");
    }
}
