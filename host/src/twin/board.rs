//! Pictures of a calibration board through a rig's lens, for trying a calibration before there is a camera.
//!
//! The board is a plane with a chessboard, a white margin and grey beyond; every pixel is the mean of nine lines of sight
//! through the exact lens, with the camera's noise on top.

use nearfield_shared::camera::{Camera, Intrinsics, Pixel, Pose, Vector};
use nearfield_shared::rig::ImageSize;
use rayon::prelude::*;

use super::random::{lattice, unit};

/// Grey levels of black squares, of white ones and the margin, and of what lies beyond.
const LEVELS: [f64; 3] = [35.0, 205.0, 110.0];
/// Margin around the squares, in squares.
const MARGIN: f64 = 0.8;
/// Lines of sight across a pixel, in each direction.
const SAMPLES: u32 = 3;
/// Standard deviation of the noise, grey levels.
const NOISE: f64 = 2.5;

/// A chessboard: its inner corners and the side of a square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaintedBoard {
    /// Inner corners along x and y of the board.
    pub corners: [u32; 2],
    /// Side of a square, millimetres.
    pub square_mm: f64,
}

impl PaintedBoard {
    /// Grey level of a place on the board's plane, millimetres from its middle.
    #[must_use]
    pub fn level(&self, x: f64, y: f64) -> f64 {
        let [columns, rows] = self.corners.map(|corners| f64::from(corners) + 1.0);
        let (column, row) = (x / self.square_mm + columns / 2.0, y / self.square_mm + rows / 2.0);
        let inside = |margin: f64| {
            column > -margin && column < columns + margin && row > -margin && row < rows + margin
        };
        let [black, white, beyond] = LEVELS;
        if !inside(MARGIN) {
            beyond
        } else if inside(0.0) && (column.floor() + row.floor()).rem_euclid(2.0) < 0.5 {
            black
        } else {
            white
        }
    }

    /// Are all squares in the picture?
    fn is_whole_in(&self, camera: &Camera, size: ImageSize) -> bool {
        let [x, y] = self.corners.map(|corners| self.square_mm * f64::from(corners + 1) / 2.0);
        [(-x, -y), (x, -y), (x, y), (-x, y)].into_iter().all(|(x, y)| {
            camera.project(Vector::new(x, y, 0.0)).is_some_and(|seen| {
                (0.0..f64::from(size.width)).contains(&seen.u)
                    && (0.0..f64::from(size.height)).contains(&seen.v)
            })
        })
    }

    /// A picture, row by row, of the board lying in the plane z = 0 around the origin of the camera's world.
    #[must_use]
    pub fn render(&self, camera: &Camera, size: ImageSize, seed: u64) -> Vec<u8> {
        let centre = camera.pose.centre();
        let width = usize::from(size.width);
        let mut picture = vec![0_u8; width * usize::from(size.height)];
        picture.par_chunks_mut(width).enumerate().for_each(|(v, row)| {
            for (u, level) in row.iter_mut().enumerate() {
                let offset = |part: u32| (f64::from(part) + 0.5) / f64::from(SAMPLES) - 0.5;
                let mut sum = 0.0;
                for part in 0..SAMPLES * SAMPLES {
                    let pixel =
                        Pixel { u: u as f64 + offset(part % SAMPLES), v: v as f64 + offset(part / SAMPLES) };
                    sum += camera.line_of_sight(pixel).map_or(LEVELS[2], |sight| {
                        let reach = -centre.z / sight.z;
                        if reach > 0.0 {
                            self.level(centre.x + reach * sight.x, centre.y + reach * sight.y)
                        } else {
                            LEVELS[2]
                        }
                    });
                }
                // Three even draws make nearly a normal one; their sum has a variance of a quarter.
                let draws: f64 =
                    (0..3).map(|draw| unit(lattice(seed ^ draw, u as i64, v as i64)) - 0.5).sum();
                *level = (sum / f64::from(SAMPLES * SAMPLES) + 2.0 * NOISE * draws).round().clamp(0.0, 255.0)
                    as u8;
            }
        });
        picture
    }
}

/// Fourteen views as a calibration of the lens asks for them: tilted to all sides, near and far, in the middle and in the corners.
///
/// `square_count` squares across fill a good part of the picture; `lens` tells how far to the side the picture reaches.
#[must_use]
pub fn lens_views(lens: &Intrinsics, size: ImageSize, board: &PaintedBoard) -> Vec<Camera> {
    const PLACES: [(f64, f64); 14] = [
        (0.0, 0.0),
        (-1.0, -1.0),
        (1.0, -1.0),
        (-1.0, 1.0),
        (1.0, 1.0),
        (0.0, 0.0),
        (-1.0, 0.0),
        (1.0, 0.0),
        (0.3, -0.8),
        (-0.3, 0.8),
        (0.0, -1.0),
        (0.0, 1.0),
        (0.7, 0.7),
        (-0.7, -0.7),
    ];
    /// Tilt about x and turn about y, radians.
    const TURNS: [(f64, f64); 7] =
        [(0.6, 0.0), (0.0, 0.6), (-0.55, 0.1), (0.1, -0.55), (0.4, 0.4), (-0.6, 0.0), (-0.4, -0.4)];
    /// The board's width over the picture's, near and far.
    const SHARES: [f64; 2] = [0.48, 0.38];
    let board_width = board.square_mm * f64::from(board.corners[0] + 1);
    let half_view = f64::from(size.width) / 2.0 / lens.fx;
    PLACES
        .iter()
        .enumerate()
        .map(|(index, (across, down))| {
            let share = SHARES[index % 2];
            let far = board_width / (2.0 * half_view * share);
            // The middle of the board may move until it would leave the picture.
            let room = (1.0 - share * 1.25).max(0.0) * half_view * far;
            let rows = f64::from(size.height) / f64::from(size.width);
            let room_down = (rows - share * 0.95).max(0.0) * half_view * far;
            let (tilt, turn) = TURNS[index % TURNS.len()];
            let turns = [tilt, turn, 0.12 * index as f64];
            let mut place = Vector::new(across * room, down * room_down, far);
            let mut camera = facing(*lens, turns, place);
            // Nearer to the middle and farther away until the whole board is in the picture.
            for _ in 0..MOST_RETREATS {
                if board.is_whole_in(&camera, size) {
                    break;
                }
                place = Vector::new(place.x * 0.97, place.y * 0.97, place.z * 1.01);
                camera = facing(*lens, turns, place);
            }
            camera
        })
        .collect()
}

/// A view is moved so often at the most; by then the board is a point in the middle.
const MOST_RETREATS: u32 = 200;

/// A camera that sees the board's printed side at `place` of its own frame, turned by angles about x, y and z (radians).
fn facing(lens: Intrinsics, [tilt, turn, roll]: [f64; 3], place: Vector) -> Camera {
    let about = |axis: usize, angle: f64, vector: Vector| {
        let (sine, cosine) = angle.sin_cos();
        let Vector { x, y, z } = vector;
        match axis {
            0 => Vector::new(x, cosine * y - sine * z, sine * y + cosine * z),
            1 => Vector::new(cosine * x + sine * z, y, cosine * z - sine * x),
            _ => Vector::new(cosine * x - sine * y, sine * x + cosine * y, z),
        }
    };
    // Half a turn about x first: the printed side faces the camera.
    let turned =
        |axis: Vector| about(2, roll, about(1, turn, about(0, tilt, Vector::new(axis.x, -axis.y, -axis.z))));
    let columns =
        [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, 1.0, 0.0), Vector::new(0.0, 0.0, 1.0)].map(turned);
    let row = |part: fn(Vector) -> f64| Vector::new(part(columns[0]), part(columns[1]), part(columns[2]));
    let rotation = [row(|vector| vector.x), row(|vector| vector.y), row(|vector| vector.z)];
    Camera { intrinsics: lens, pose: Pose { rotation, translation: place } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery::CENTRE;

    const BOARD: PaintedBoard = PaintedBoard { corners: [11, 7], square_mm: 25.0 };

    #[test]
    fn squares_alternate_within_a_white_margin_on_grey() {
        let [black, white, beyond] = LEVELS;
        assert!((BOARD.level(12.0, 12.0) - BOARD.level(-12.0, -12.0)).abs() < 1e-9);
        let (one, other) = (BOARD.level(12.0, 12.0), BOARD.level(-12.0, 12.0));
        assert!((one - other).abs() > 100.0 && one.min(other) <= black && one.max(other) >= white);
        assert!((BOARD.level(6.2 * 25.0, 0.1) - white).abs() < 1e-9, "margin");
        assert!((BOARD.level(7.0 * 25.0, 0.1) - beyond).abs() < 1e-9, "beyond");
    }

    #[test]
    fn every_view_shows_the_whole_board() {
        let rig = CENTRE.rig().unwrap();
        for (index, camera) in lens_views(&rig.camera().intrinsics, rig.image(), &BOARD).iter().enumerate() {
            for (x, y) in [(-6.0, -4.0), (6.0, -4.0), (6.0, 4.0), (-6.0, 4.0)] {
                let seen = camera.project(Vector::new(25.0 * x, 25.0 * y, 0.0)).unwrap();
                let inside = (0.0..1152.0).contains(&seen.u) && (0.0..648.0).contains(&seen.v);
                assert!(inside, "view {index}: {seen:?}");
            }
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_picture() {
        let rig = CENTRE.with_width(256).rig().unwrap();
        let camera = lens_views(&rig.camera().intrinsics, rig.image(), &BOARD)[0];
        assert_eq!(BOARD.render(&camera, rig.image(), 4), BOARD.render(&camera, rig.image(), 4));
        assert_ne!(BOARD.render(&camera, rig.image(), 4), BOARD.render(&camera, rig.image(), 5));
    }
}
