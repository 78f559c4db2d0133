//! Boards with a known pattern, found in pictures: chessboards and ChArUco boards.
//!
//! Corners are found by the crate `calib-targets`; this module checks that what it found is the board that was meant,
//! and gives the corners a frame of their own: origin in the pattern's middle, millimetres, right-handed with z out
//! of the printed side, so that a board on the floor has z up.

use std::str::FromStr;

use calib_targets::aruco::builtins::builtin_dictionary;
use calib_targets::charuco::{CharucoBoardSpec, CharucoParams};
use calib_targets::chessboard::ChessboardParams;
use calib_targets::detect;
use nalgebra::{Point2, Vector2};
use nearfield_shared::camera::Pixel;

use super::CalibrationError;
use super::picture::CalibrationPicture;

/// Fewest corners that fix a pose and still leave enough to judge the fit.
const FEWEST_CORNERS: usize = 12;
/// A view that shows less than this share of the board's corners is not trusted to be that board.
const SMALLEST_SHARE: f64 = 0.6;

/// What is printed on the board.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// Plain squares, counted by inner corners.
    Chessboard {
        /// Inner corners along one side.
        columns: u32,
        /// Inner corners along the other side.
        rows: u32,
    },
    /// Squares with ArUco markers in the white ones, counted by squares.
    Charuco {
        /// Squares along one side.
        columns: u32,
        /// Squares along the other side.
        rows: u32,
        /// A marker's side over a square's side.
        marker_share: f32,
        /// The markers' dictionary by its OpenCV name, for instance `DICT_4X4_50`.
        dictionary: String,
    },
}

impl FromStr for Pattern {
    type Err = String;

    /// `11x7` is a chessboard of 11 x 7 inner corners; `charuco:8x6:0.75:DICT_4X4_50` a ChArUco board of 8 x 6
    /// squares with markers of 0.75 of a square.
    fn from_str(text: &str) -> Result<Self, String> {
        let help = || {
            format!(
                "`{text}` is no board: give inner corners as 11x7, or charuco:COLUMNSxROWS:MARKER_SHARE:DICTIONARY \
                 (squares, 0 to 1, as DICT_4X4_50)"
            )
        };
        let sizes = |text: &str| {
            let (columns, rows) = text.split_once('x')?;
            let (columns, rows) = (columns.parse::<u32>().ok()?, rows.parse::<u32>().ok()?);
            ((2..=100).contains(&columns) && (2..=100).contains(&rows)).then_some((columns, rows))
        };
        let Some(charuco) = text.strip_prefix("charuco:") else {
            let (columns, rows) = sizes(text).ok_or_else(help)?;
            return Ok(Self::Chessboard { columns, rows });
        };
        let parts: Vec<&str> = charuco.split(':').collect();
        let [size, share, dictionary] = parts.as_slice() else { return Err(help()) };
        let (columns, rows) = sizes(size).ok_or_else(help)?;
        let marker_share =
            share.parse().ok().filter(|share| *share > 0.0 && *share < 1.0).ok_or_else(help)?;
        if builtin_dictionary(dictionary).is_none() {
            return Err(format!(
                "`{dictionary}` is no ArUco dictionary; give its OpenCV name, as DICT_4X4_50"
            ));
        }
        Ok(Self::Charuco { columns, rows, marker_share, dictionary: (*dictionary).to_owned() })
    }
}

/// A board: its pattern and the printed squares' side.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// What is printed.
    pub pattern: Pattern,
    /// Side of a square, millimetres, measured on the print.
    pub square_mm: f64,
}

/// A corner of the board in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardCorner {
    /// Where it is seen.
    pub pixel: Pixel,
    /// Where it is on the board, millimetres from the pattern's middle.
    pub place: Point2<f64>,
}

/// One picture of the board.
#[derive(Debug, Clone)]
pub struct BoardView {
    /// Its file, for messages.
    pub name: String,
    /// The corners that were found.
    pub corners: Vec<BoardCorner>,
    /// Corners that the whole board has.
    pub expected: usize,
}

impl BoardView {
    /// The same view of a board whose squares are `factor` times as large.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let corners =
            self.corners.iter().map(|corner| BoardCorner { place: corner.place * factor, ..*corner });
        Self { corners: corners.collect(), ..self.clone() }
    }
}

/// A lattice point and where it is seen.
type Labelled = (Vector2<i32>, Pixel);

impl Board {
    /// Inner corners along the longer and the shorter side.
    #[must_use]
    pub fn corner_counts(&self) -> (u32, u32) {
        let (columns, rows) = match &self.pattern {
            Pattern::Chessboard { columns, rows } => (*columns, *rows),
            Pattern::Charuco { columns, rows, .. } => (columns - 1, rows - 1),
        };
        (columns.max(rows), columns.min(rows))
    }

    /// Finds the board in a picture.
    ///
    /// # Errors
    /// [`CalibrationError::Picture`] where there is no board, another one, or too little of it; the message says what
    /// was found instead.
    pub fn find(&self, picture: &CalibrationPicture) -> Result<BoardView, CalibrationError> {
        let refused = |problem: String| CalibrationError::Picture { path: picture.path.clone(), problem };
        let labelled = match &self.pattern {
            Pattern::Chessboard { .. } => chessboard_corners(picture),
            Pattern::Charuco { columns, rows, marker_share, dictionary } => {
                charuco_corners(picture, [*columns, *rows], *marker_share, dictionary)
            }
        }
        .map_err(refused)?;
        self.check_counts(&labelled).map_err(refused)?;
        let corners = self.places(&labelled);
        let (long, short) = self.corner_counts();
        Ok(BoardView { name: picture.path.display().to_string(), corners, expected: (long * short) as usize })
    }

    /// Is that lattice (a part of) this board?
    fn check_counts(&self, labelled: &[Labelled]) -> Result<(), String> {
        let (long, short) = self.corner_counts();
        let [across, down] = [0, 1].map(|axis| {
            let values = labelled.iter().map(|(label, _)| label[axis]);
            let (low, high) =
                values.fold((i32::MAX, i32::MIN), |(low, high), value| (low.min(value), high.max(value)));
            high.saturating_sub(low).unsigned_abs() + 1
        });
        let (seen_long, seen_short) = (across.max(down), across.min(down));
        let expected = f64::from(long * short);
        if seen_long > long || seen_short > short {
            return Err(format!(
                "the board in it has at least {seen_long} x {seen_short} inner corners, not {long} x {short}; \
                 give the board that was used (--board), or remove the other one from the picture"
            ));
        }
        if labelled.len() < FEWEST_CORNERS || (labelled.len() as f64) < SMALLEST_SHARE * expected {
            return Err(format!(
                "only {} of {expected} inner corners are found ({seen_long} x {seen_short}): another board than \
                 {long} x {short} (--board), or partly hidden, blurred or out of the picture",
                labelled.len()
            ));
        }
        Ok(())
    }

    /// Millimetres for lattice labels: centred, and turned over where the labels run clockwise in the picture, which
    /// would put z into the board.
    fn places(&self, labelled: &[Labelled]) -> Vec<BoardCorner> {
        let turn = if runs_clockwise(labelled) { -1.0 } else { 1.0 };
        let bounds = |axis: usize| {
            let values = || labelled.iter().map(|(label, _)| label[axis]);
            (f64::from(values().min().unwrap_or(0)) + f64::from(values().max().unwrap_or(0))) / 2.0
        };
        let middle = [bounds(0), bounds(1)];
        labelled
            .iter()
            .map(|(label, pixel)| BoardCorner {
                pixel: *pixel,
                place: Point2::new(
                    (f64::from(label[0]) - middle[0]) * self.square_mm,
                    (f64::from(label[1]) - middle[1]) * self.square_mm * turn,
                ),
            })
            .collect()
    }
}

/// Does the second label axis lie clockwise of the first in the picture (v grows downwards)? From the area that unit
/// steps span on the whole.
fn runs_clockwise(labelled: &[Labelled]) -> bool {
    let at =
        |label: Vector2<i32>| labelled.iter().find(|(other, _)| *other == label).map(|(_, pixel)| *pixel);
    let spanned: f64 = labelled
        .iter()
        .filter_map(|(label, here)| {
            let (right, down) = (at(label + Vector2::new(1, 0))?, at(label + Vector2::new(0, 1))?);
            Some((right.u - here.u) * (down.v - here.v) - (right.v - here.v) * (down.u - here.u))
        })
        .sum();
    spanned > 0.0
}

fn chessboard_corners(picture: &CalibrationPicture) -> Result<Vec<Labelled>, String> {
    let found = detect::detect_chessboard_best(
        &picture.brightness,
        &detect::default_chess_config(),
        &ChessboardParams::sweep_default(),
    )
    .map_err(|_| "no chessboard is found in it; is the board in the picture, lit and sharp?".to_owned())?;
    Ok(found
        .corners
        .iter()
        .map(|corner| {
            let pixel = Pixel { u: f64::from(corner.position.x), v: f64::from(corner.position.y) };
            (Vector2::new(corner.grid.u, corner.grid.v), pixel)
        })
        .collect())
}

fn charuco_corners(
    picture: &CalibrationPicture,
    [columns, rows]: [u32; 2],
    marker_share: f32,
    dictionary: &str,
) -> Result<Vec<Labelled>, String> {
    let dictionary = builtin_dictionary(dictionary).ok_or("unknown ArUco dictionary")?;
    // Places come from the logical corner numbers, so the size of a cell does not matter here.
    let board = CharucoBoardSpec::new(rows, columns, 1.0, marker_share, dictionary);
    let found = detect::detect_charuco_best(&picture.brightness, &CharucoParams::sweep_for_board(&board))
        .map_err(|error| {
            format!("no ChArUco board of {columns} x {rows} squares is found in it ({error}); check --board")
        })?;
    let inner = columns - 1;
    Ok(found
        .corners
        .iter()
        .filter_map(|corner| {
            let (column, row) =
                (i32::try_from(corner.id % inner).ok()?, i32::try_from(corner.id / inner).ok()?);
            let pixel = Pixel { u: f64::from(corner.position.x), v: f64::from(corner.position.y) };
            Some((Vector2::new(column, row), pixel))
        })
        .collect())
}

#[cfg(test)]
mod tests;
