//! One projective map per column: row of the stripe to height and place, with one division and no trigonometry.
//!
//! For one image column of an undistorted camera the line of sight sweeps a plane as the row changes; that plane
//! meets the sheet of light in a straight line, and row to position on that line is projective. Lens distortion bends
//! the column slightly, which one more term takes up. Measured from the row at which the column sees the lit floor,
//! `t = row - floor_row`:
//!
//! ```text
//! height = height_per_row * t * (1 + bend_per_row * t) / (1 + perspective_per_row * t)
//! along  = floor_place + place_per_height * height
//! ```
//!
//! so the floor's height is exactly zero. The coefficients are fitted to the exact model
//! ([`crate::laser::Laser::triangulate`]) from 30 mm below to 200 mm above the floor, as far as the picture shows them;
//! tests bound what is left: 0.1 mm of height; up to 100 mm of height 1.5 mm of a ray's place (66 degree lens; 5 mm at the
//! edge of a 102 degree one, whose bent columns lean differently at every height). The maps are filled
//! once, at start, in f64; using them is f32.

use crate::camera::{Pixel, Vector};
use crate::limits::{AVERAGING_WINDOW, DEEPEST_MAPPED, HIGHEST_MAPPED, LARGEST_COLUMN_COUNT};
use crate::rig::Rig;
use crate::units::{Millimetres, narrow};
use num_traits::ToPrimitive as _;

/// How image columns become line-scan columns: `image_columns` neighbours are one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Decimation {
    image_columns: u16,
    count: u16,
}

impl Decimation {
    /// The line-scan's decimation: as few image columns to one as fit [`LARGEST_COLUMN_COUNT`].
    #[must_use]
    pub fn for_line_scan(image_width: u16) -> Self {
        let most = u16::try_from(LARGEST_COLUMN_COUNT).unwrap_or(u16::MAX);
        let image_columns = image_width.div_ceil(most).max(1);
        Self { image_columns, count: image_width.checked_div(image_columns).unwrap_or(0) }
    }

    /// No decimation: every image column by itself (the host's full-frame analysis).
    #[must_use]
    pub const fn none(image_width: u16) -> Self {
        Self { image_columns: 1, count: image_width }
    }

    /// Image columns in one.
    #[must_use]
    pub const fn image_columns(self) -> u16 {
        self.image_columns
    }

    /// Columns that result.
    #[must_use]
    pub const fn count(self) -> u16 {
        self.count
    }

    /// The image coordinate u of a column's centre.
    #[must_use]
    pub fn centre(self, column: u16) -> f64 {
        f64::from(self.image_columns) * (f64::from(column) + 0.5) - 0.5
    }
}

/// The projective map of one column; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColumnMap {
    /// Row at which this column sees the stripe on the floor, pixels.
    pub floor_row: f32,
    /// Stripe coordinate s of that floor point, millimetres.
    pub floor_place: f32,
    /// Height per row at the floor, millimetres per pixel; its sign says whether raised points move up or down.
    pub height_per_row: f32,
    /// Perspective term, 1 per pixel.
    pub perspective_per_row: f32,
    /// Lens distortion's term, 1 per pixel.
    pub bend_per_row: f32,
    /// Sideways lean of the column in the sheet of light: millimetres along the stripe per millimetre of height.
    pub place_per_height: f32,
}

/// Beyond this the map has left the half-plane in front of camera and sheet.
const SMALLEST_DENOMINATOR: f32 = 0.05;
/// Newton's steps for the inverse; each squares what the bend leaves.
const INVERSE_STEPS: u32 = 3;

impl ColumnMap {
    /// Never reached by a reader. All zero bits, so that a static of maps takes no room in flash.
    const UNMAPPED: Self = Self {
        floor_row: 0.0,
        floor_place: 0.0,
        height_per_row: 0.0,
        perspective_per_row: 0.0,
        bend_per_row: 0.0,
        place_per_height: 0.0,
    };

    /// Can heights and rows be told from each other with it?
    fn is_usable(&self) -> bool {
        let figures =
            [self.height_per_row, self.perspective_per_row, self.bend_per_row, self.place_per_height];
        self.height_per_row != 0.0 && figures.iter().all(|figure| figure.is_finite())
    }

    /// Height over the floor of a stripe seen at `row`, millimetres; NaN where there is none (no stripe, horizon).
    /// NaN fails every comparison, so "unknown" can never pass for floor.
    #[must_use]
    #[inline]
    pub fn height(&self, row: f32) -> f32 {
        let rows = row - self.floor_row;
        let denominator = 1.0 + self.perspective_per_row * rows;
        if denominator > SMALLEST_DENOMINATOR {
            self.height_per_row * rows * (1.0 + self.bend_per_row * rows) / denominator
        } else {
            f32::NAN
        }
    }

    /// The row at which a point of this height appears, pixels: the inverse of [`Self::height`]; NaN where none.
    #[must_use]
    pub fn row(&self, height: f32) -> f32 {
        let bend = self.height_per_row * self.bend_per_row;
        let slope = self.height_per_row - self.perspective_per_row * height;
        let mut rows = height / slope;
        // `bend rows^2 + slope rows = height` by Newton's steps from the solution without the (small) bend.
        for _ in 0..INVERSE_STEPS {
            rows -= (rows * (bend * rows + slope) - height) / (2.0 * bend * rows + slope);
        }
        if 1.0 + self.perspective_per_row * rows > SMALLEST_DENOMINATOR {
            self.floor_row + rows
        } else {
            f32::NAN
        }
    }
}

/// Why no column maps can be made from a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GeometryError {
    /// The stripe runs along the image columns (or folds back), so that columns do not resolve it.
    StripeAlongColumns,
    /// More columns than there is room for.
    TooManyColumns,
    /// Fewer than three columns see the stripe.
    TooFewColumns,
    /// In some column height and row do not go together: camera (almost) within the laser's sheet.
    NoParallax,
}

impl core::fmt::Display for GeometryError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::StripeAlongColumns => {
                "the stripe runs along the picture's columns; turn the camera so that it crosses them"
            }
            Self::TooManyColumns => "the picture has more columns than this analysis has room for",
            Self::TooFewColumns => "fewer than three columns see the stripe; check stripe.start_mm and stripe.end_mm",
            Self::NoParallax => {
                "heights cannot be told apart: the camera lies in, or looks along, the laser's sheet; separate camera and laser in height"
            }
        })
    }
}

impl core::error::Error for GeometryError {}

/// The maps of all columns that watch the stripe, and what the running average needs.
///
/// `N` is the room for columns: [`LARGEST_COLUMN_COUNT`] on the MCU, the image's width on the host. About 21 bytes a
/// column; keep it in a static or a box.
#[derive(Debug, Clone)]
pub struct StripeGeometry<const N: usize> {
    maps: [ColumnMap; N],
    reach: [u8; N],
    first: usize,
    last: usize,
    count: usize,
    laser_height: f32,
    laser_place: f32,
}

/// A range of heights over the floor to fit a map for, millimetres.
#[derive(Clone, Copy, PartialEq)]
struct HeightRange {
    low: f64,
    high: f64,
}

impl HeightRange {
    /// All that is ever mapped of a rig. No light comes down from the laser's own height: the sheet's plane goes on there,
    /// behind the laser and out of the camera's sight, and would spoil the fit of what is lit.
    fn full(rig: &Rig) -> Self {
        let high = f64::from(HIGHEST_MAPPED.get()).min(rig.laser().origin.z);
        Self { low: f64::from(DEEPEST_MAPPED.get()), high }
    }

    /// The part of it that a column with this (first) map shows in a picture of `rows` rows: where a lens is fitted
    /// beyond the picture's edge, its strongest distortion would spoil what the picture does show.
    fn within_picture(self, map: &ColumnMap, rows: u16) -> Self {
        let edges = (f64::from(map.height(-0.5)), f64::from(map.height(f32::from(rows) - 0.5)));
        let mut visible = self;
        for edge in [edges.0, edges.1] {
            if edge > 1.0 {
                visible.high = visible.high.min(edge);
            } else if edge < -1.0 {
                visible.low = visible.low.max(edge);
            }
        }
        visible
    }

    /// Heights to fit at; the floor itself is exact by construction.
    fn samples(self) -> [f64; 4] {
        [self.low, 0.3 * self.high, 0.65 * self.high, self.high]
    }
}

/// Newton-like steps to find the point of a given height that a column sees.
const SOLVE_STEPS: u32 = 12;
/// Good enough, pixels: far below the line-scan's sixteenth.
const SOLVE_TOLERANCE: f64 = 1e-7;
/// A stripe that moves by less than this many image columns a millimetre is not resolved.
const LEAST_COLUMNS_PER_MM: f64 = 0.02;

/// Points of the laser's sheet by place along the stripe's direction and height.
struct Sheet<'a> {
    rig: &'a Rig,
    rise: Vector,
}

impl<'a> Sheet<'a> {
    fn new(rig: &'a Rig) -> Option<Self> {
        let across = rig.laser().normal.cross(rig.stripe().direction);
        let rise = across.scaled(1.0 / across.z);
        rise.is_finite().then_some(Self { rig, rise })
    }

    fn pixel(&self, place: f64, height: f64) -> Option<Pixel> {
        self.rig.camera().project(self.rig.stripe().at(place).plus(self.rise.scaled(height)))
    }

    /// Place and row of the point at `height` that appears in image column `u`; secant steps from `guess`.
    fn solve(&self, u: f64, height: f64, guess: f64) -> Option<(f64, f64)> {
        let mut place = guess;
        let mut pixel = self.pixel(place, height)?;
        let probe = self.pixel(place + 1.0, height)?;
        let mut slope = probe.u - pixel.u;
        for _ in 0..SOLVE_STEPS {
            if slope.abs() < LEAST_COLUMNS_PER_MM {
                return None;
            }
            let next = place + (u - pixel.u) / slope;
            let next_pixel = self.pixel(next, height)?;
            if (next_pixel.u - u).abs() <= SOLVE_TOLERANCE {
                return Some((next, next_pixel.v));
            }
            slope = (next_pixel.u - pixel.u) / (next - place);
            (place, pixel) = (next, next_pixel);
        }
        None
    }
}

/// So that a window of this reach to both sides has no more columns than a byte counts.
const LARGEST_REACH: u8 = 127;

impl<const N: usize> StripeGeometry<N> {
    /// Room without maps: no column watches anything. Call [`Self::fill`] before use.
    #[must_use]
    pub const fn empty() -> Self {
        Self {
            maps: [ColumnMap::UNMAPPED; N],
            reach: [0; N],
            first: 0,
            last: 0,
            count: 0,
            laser_height: 0.0,
            laser_place: 0.0,
        }
    }

    /// Computes the maps of every column whose floor point lies on the watched stretch of the stripe.
    ///
    /// # Errors
    /// See [`GeometryError`]; after an error no column watches anything.
    pub fn fill(&mut self, rig: &Rig, decimation: Decimation) -> Result<(), GeometryError> {
        self.clear();
        let count = usize::from(decimation.count());
        if count > N {
            return Err(GeometryError::TooManyColumns);
        }
        let sheet = Sheet::new(rig).ok_or(GeometryError::NoParallax)?;
        let stripe = rig.stripe();
        let from = sheet.pixel(stripe.start, 0.0).ok_or(GeometryError::StripeAlongColumns)?;
        let to = sheet.pixel(stripe.end, 0.0).ok_or(GeometryError::StripeAlongColumns)?;
        let slope = (to.u - from.u) / (stripe.end - stripe.start);
        if slope.abs() < LEAST_COLUMNS_PER_MM {
            return Err(GeometryError::StripeAlongColumns);
        }
        let result = self.fill_watched(&sheet, decimation, from.u.min(to.u), from.u.max(to.u), |u| {
            stripe.start + (u - from.u) / slope
        });
        match result {
            Ok((first, last)) if last.saturating_sub(first) >= 2 => {
                (self.first, self.last, self.count) = (first, last, count);
                self.laser_height = narrow(rig.laser().origin.z);
                self.laser_place = narrow(stripe.coordinate_of(rig.laser().origin));
                self.fill_reach();
                Ok(())
            }
            Ok(_) => {
                self.clear();
                Err(GeometryError::TooFewColumns)
            }
            Err(error) => {
                self.clear();
                Err(error)
            }
        }
    }

    /// No column watches anything: what the maps still hold cannot be reached any more.
    fn clear(&mut self) {
        (self.first, self.last, self.count) = (0, 0, 0);
    }

    fn fill_watched(
        &mut self,
        sheet: &Sheet<'_>,
        decimation: Decimation,
        lowest: f64,
        highest: f64,
        guess_at: impl Fn(f64) -> f64,
    ) -> Result<(usize, usize), GeometryError> {
        let mut watched: Option<(usize, usize)> = None;
        let mut guesses: Option<[f64; 5]> = None;
        let mut previous_place: Option<f64> = None;
        let mut rising: Option<bool> = None;
        for (map, column) in self.maps.iter_mut().zip(0..decimation.count()) {
            let index = usize::from(column);
            let u = decimation.centre(column);
            if u < lowest || u > highest {
                continue;
            }
            let starts = guesses.unwrap_or([guess_at(u); 5]);
            let full = HeightRange::full(sheet.rig);
            let (rough, rough_places) = fit(sheet, u, starts, full)?;
            let visible = full.within_picture(&rough, sheet.rig.image().height);
            let (fitted, places) =
                if visible == full { (rough, rough_places) } else { fit(sheet, u, rough_places, visible)? };
            // A stripe whose place does not keep its direction from column to column folds back in the picture.
            let [place, ..] = places;
            if let Some(before) = previous_place {
                let rises = place > before;
                if rising.is_some_and(|direction| direction != rises) {
                    return Err(GeometryError::StripeAlongColumns);
                }
                rising = Some(rises);
            }
            (*map, guesses, previous_place) = (fitted, Some(places), Some(place));
            watched = Some((watched.map_or(index, |(first, _)| first), index));
        }
        watched.ok_or(GeometryError::TooFewColumns)
    }

    /// Half the running average's window in columns, changing by at most one from column to column.
    fn fill_reach(&mut self) {
        let half = AVERAGING_WINDOW.get() / 2.0;
        let watched = self.watched();
        let (maps, reaches) = (self.maps.get(watched.clone()), self.reach.get_mut(watched));
        let (Some(maps), Some(reaches)) = (maps, reaches) else { return };
        let mut previous: Option<u8> = None;
        for (pair, reach) in maps.windows(2).zip(reaches.iter_mut()) {
            let [here, next] = pair else { continue };
            let pitch = (next.floor_place - here.floor_place).abs();
            let wanted = (half / pitch).to_u8().map_or(LARGEST_REACH, |reach| reach.min(LARGEST_REACH));
            let allowed = match previous {
                Some(before) => wanted.clamp(before.saturating_sub(1), before.saturating_add(1)),
                None => wanted,
            };
            *reach = allowed;
            previous = Some(allowed);
        }
        if let (Some(last), Some(before)) = (reaches.last_mut(), previous) {
            *last = before;
        }
    }

    /// Indices of the columns that watch the stripe.
    #[must_use]
    pub fn watched(&self) -> core::ops::Range<usize> {
        if self.count == 0 { 0..0 } else { self.first..self.last.saturating_add(1) }
    }

    /// Columns that the line-scan of this rig has in all, watched or not.
    #[must_use]
    pub const fn column_count(&self) -> usize {
        self.count
    }

    /// Maps of the watched columns, in the order of columns.
    #[must_use]
    pub fn maps(&self) -> &[ColumnMap] {
        self.maps.get(self.watched()).unwrap_or(&[])
    }

    /// Half the running average's window in columns, for each watched column.
    #[must_use]
    pub fn reaches(&self) -> &[u8] {
        self.reach.get(self.watched()).unwrap_or(&[])
    }

    /// The map of one column of the line-scan, if it watches the stripe.
    #[must_use]
    pub fn map(&self, column: usize) -> Option<&ColumnMap> {
        if self.watched().contains(&column) { self.maps.get(column) } else { None }
    }

    /// The stripe coordinate s of the laser ray that lights the point which `map`'s column sees at `row`. NaN where
    /// there is none, or at or above the laser's own height (no ray comes down from there).
    #[must_use]
    pub fn ray_place(&self, map: &ColumnMap, row: f32) -> f32 {
        let height = map.height(row);
        let drop = self.laser_height - height;
        if drop > 0.0 {
            let along = map.floor_place + map.place_per_height * height;
            self.laser_place + (along - self.laser_place) * self.laser_height / drop
        } else {
            f32::NAN
        }
    }

    /// The laser's height over the floor.
    #[must_use]
    pub const fn laser_height(&self) -> Millimetres {
        Millimetres::new(self.laser_height)
    }
}

/// Fits one column's map; also returns the places found, as guesses for the next column (floor first).
fn fit(
    sheet: &Sheet<'_>,
    u: f64,
    guesses: [f64; 5],
    range: HeightRange,
) -> Result<(ColumnMap, [f64; 5]), GeometryError> {
    let [floor_guess, raised_guesses @ ..] = guesses;
    let (floor_place, floor_row) =
        sheet.solve(u, 0.0, floor_guess).ok_or(GeometryError::StripeAlongColumns)?;
    // With h, d, q for height, perspective and bend: `h t + q t^2 - d (z t) = z`, least squares over the samples.
    let mut heights = LeastSquares::default();
    let (mut leant, mut square) = (0.0, 0.0);
    let mut places = [floor_place; 4];
    for ((place, height), guess) in places.iter_mut().zip(range.samples()).zip(raised_guesses) {
        // Where the lens model ends (far outside the picture) there is nothing to fit.
        let Some((found, row)) = sheet.solve(u, height, guess) else { continue };
        let rows = (row - floor_row) * ROW_SCALE;
        heights.add([rows, rows * rows, -height * rows], height);
        leant += height * (found - floor_place);
        square += height * height;
        *place = found;
    }
    let [height_per_row, bend, perspective_per_row] = heights.solve().ok_or(GeometryError::NoParallax)?;
    let map = ColumnMap {
        floor_row: narrow(floor_row),
        floor_place: narrow(floor_place),
        height_per_row: narrow(height_per_row * ROW_SCALE),
        perspective_per_row: narrow(perspective_per_row * ROW_SCALE),
        bend_per_row: narrow(bend / height_per_row * ROW_SCALE),
        place_per_height: narrow(leant / square),
    };
    let [first, second, third, fourth] = places;
    if map.is_usable() {
        Ok((map, [floor_place, first, second, third, fourth]))
    } else {
        Err(GeometryError::NoParallax)
    }
}

/// Rows are scaled to about one for the normal equations.
const ROW_SCALE: f64 = 1.0 / 256.0;

/// Linear least squares with three unknowns by normal equations and Cramer's rule.
#[derive(Default)]
struct LeastSquares {
    rows: [Vector; 3],
    right: Vector,
}

impl LeastSquares {
    fn add(&mut self, coefficients: [f64; 3], value: f64) {
        let [a, b, c] = coefficients;
        let equation = Vector::new(a, b, c);
        for (row, coefficient) in self.rows.iter_mut().zip(coefficients) {
            *row = row.plus(equation.scaled(coefficient));
        }
        self.right = self.right.plus(equation.scaled(value));
    }

    fn solve(&self) -> Option<[f64; 3]> {
        let [a, b, c] = self.rows;
        let determinant = a.dot(b.cross(c));
        let right = self.right;
        // The matrix is symmetric, so its rows are its columns.
        let unknowns = [right.dot(b.cross(c)), a.dot(right.cross(c)), a.dot(b.cross(right))]
            .map(|numerator| numerator / determinant);
        unknowns.iter().all(|unknown| unknown.is_finite()).then_some(unknowns)
    }
}

#[cfg(test)]
pub(crate) mod tests;
