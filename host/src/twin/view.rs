//! Where every pixel of a rig's camera looks, computed once and shared by all scenes and frames.

use nearfield_shared::camera::{Pixel, Vector};
use nearfield_shared::rig::Rig;
use rayon::prelude::*;

use super::shape::{Bounds, Ray};

/// A rectangle of pixels: columns `left..right`, rows `top..bottom`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelRectangle {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// One past the last column.
    pub right: usize,
    /// One past the last row.
    pub bottom: usize,
}

impl PixelRectangle {
    /// True if it holds no pixel.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.left >= self.right || self.top >= self.bottom
    }

    /// True if both share a pixel.
    #[must_use]
    pub const fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    /// The smallest rectangle that holds both.
    #[must_use]
    pub fn hull(&self, other: &Self) -> Self {
        Self {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }

    /// Grown on all sides within a picture of this size.
    #[must_use]
    pub fn grown(&self, margin: usize, width: usize, height: usize) -> Self {
        Self {
            left: self.left.saturating_sub(margin),
            top: self.top.saturating_sub(margin),
            right: (self.right + margin).min(width),
            bottom: (self.bottom + margin).min(height),
        }
    }

    /// True if the pixel lies in it.
    #[must_use]
    pub const fn contains(&self, column: usize, row: usize) -> bool {
        self.left <= column && column < self.right && self.top <= row && row < self.bottom
    }
}

/// Joins overlapping rectangles until none overlap.
#[must_use]
pub fn disjoint(mut rectangles: Vec<PixelRectangle>) -> Vec<PixelRectangle> {
    rectangles.retain(|rectangle| !rectangle.is_empty());
    let mut index = 0;
    while index < rectangles.len() {
        let overlapping =
            (index + 1..rectangles.len()).find(|other| rectangles[index].overlaps(&rectangles[*other]));
        match overlapping {
            Some(other) => {
                let joined = rectangles.swap_remove(other);
                rectangles[index] = rectangles[index].hull(&joined);
                index = 0;
            }
            None => index += 1,
        }
    }
    rectangles
}

/// A rig's camera with the line of sight of every pixel.
#[derive(Debug)]
pub struct View {
    rig: Rig,
    /// Directions in the world, scaled to depth 1; NaN beyond the lens model. Row by row.
    sights: Vec<[f32; 3]>,
    centre: Vector,
}

impl View {
    /// Computes all lines of sight (exactly, with the lens distortion).
    #[must_use]
    pub fn new(rig: &Rig) -> Self {
        let size = rig.image();
        let width = usize::from(size.width);
        let mut sights = vec![[f32::NAN; 3]; width * usize::from(size.height)];
        sights.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
            for (column, sight) in line.iter_mut().enumerate() {
                let pixel = Pixel { u: column as f64, v: row as f64 };
                if let Some(direction) = rig.camera().line_of_sight(pixel) {
                    *sight = [direction.x as f32, direction.y as f32, direction.z as f32];
                }
            }
        });
        Self { rig: *rig, sights, centre: rig.camera().pose.centre() }
    }

    /// The rig.
    #[must_use]
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        usize::from(self.rig.image().width)
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        usize::from(self.rig.image().height)
    }

    /// The line of sight of a pixel; its coordinates are NaN beyond the lens model.
    #[must_use]
    pub fn ray(&self, column: usize, row: usize) -> Ray {
        let [x, y, z] = self.sights[row * self.width() + column];
        Ray { start: self.centre, direction: Vector::new(f64::from(x), f64::from(y), f64::from(z)) }
    }

    /// The lines of sight of a row's pixels, as they are kept: directions scaled to depth 1, NaN beyond the lens model.
    #[must_use]
    pub fn sights(&self, row: usize) -> &[[f32; 3]] {
        &self.sights[row * self.width()..(row + 1) * self.width()]
    }

    /// Where the camera is.
    #[must_use]
    pub const fn centre(&self) -> Vector {
        self.centre
    }

    /// How far the point on a surface moves from one pixel to the next, to the right and down, millimetres: the
    /// surface is taken as its tangent plane.
    #[must_use]
    pub fn steps(&self, column: usize, row: usize, point: Vector, normal: Vector) -> [Vector; 2] {
        let across = if column + 1 < self.width() { (column + 1, row, 1.0) } else { (column - 1, row, -1.0) };
        let down = if row + 1 < self.height() { (column, row + 1, 1.0) } else { (column, row - 1, -1.0) };
        [across, down].map(|(other_column, other_row, sign)| {
            let direction = self.ray(other_column, other_row).direction;
            let along = normal.dot(point.minus(self.centre)) / normal.dot(direction);
            let step = self.centre.plus(direction.scaled(along)).minus(point).scaled(sign);
            if step.is_finite() { step } else { Vector::default() }
        })
    }

    /// The rectangle of pixels that may show anything within the bounds; the whole picture if part of them lies behind the
    /// camera.
    #[must_use]
    pub fn outline_of(&self, bounds: &Bounds) -> PixelRectangle {
        /// Edges are followed in steps of this length, millimetres ...
        const STEP_MM: f64 = 40.0;
        /// ... between which lens distortion bends them by less than this, pixels.
        const BEND: f64 = 8.0;
        self.rectangle_around(bounds.edge_points(STEP_MM), BEND)
    }

    /// The rectangle of pixels that may show anything within the bounds, grown sideways by `margin_mm`; the whole
    /// picture if part of it lies behind the camera.
    #[must_use]
    pub fn rectangle_of(&self, bounds: &Bounds, margin_mm: f64) -> PixelRectangle {
        /// Lens distortion bends edges between corners by less than this.
        const BEND: f64 = 8.0;
        self.rectangle_around(bounds.corners(margin_mm).into_iter(), BEND)
    }

    fn rectangle_around(&self, points: impl Iterator<Item = Vector>, bend: f64) -> PixelRectangle {
        let (width, height) = (self.width() as f64, self.height() as f64);
        let mut low = (f64::INFINITY, f64::INFINITY);
        let mut high = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        for point in points {
            let Some(pixel) = self.rig.camera().project(point) else {
                return PixelRectangle { left: 0, top: 0, right: self.width(), bottom: self.height() };
            };
            low = (low.0.min(pixel.u), low.1.min(pixel.v));
            high = (high.0.max(pixel.u), high.1.max(pixel.v));
        }
        PixelRectangle {
            left: (low.0 - bend).clamp(0.0, width) as usize,
            top: (low.1 - bend).clamp(0.0, height) as usize,
            right: (high.0 + bend).clamp(0.0, width) as usize,
            bottom: (high.1 + bend).clamp(0.0, height) as usize,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery;

    #[test]
    fn every_ray_leads_back_to_its_pixel() {
        let rig = gallery::default_rig();
        let view = View::new(&rig);
        for (column, row) in [(0, 0), (575, 323), (1151, 647), (1151, 0), (300, 640)] {
            let pixel = rig.camera().project(view.ray(column, row).at(700.0)).unwrap();
            assert!(
                (pixel.u - column as f64).abs() < 1e-3 && (pixel.v - row as f64).abs() < 1e-3,
                "{pixel:?}"
            );
        }
    }

    #[test]
    fn steps_lead_to_the_neighbouring_pixels() {
        let rig = gallery::default_rig();
        let view = View::new(&rig);
        let floor = |column, row| {
            let ray = view.ray(column, row);
            ray.at(-ray.start.z / ray.direction.z)
        };
        let up = Vector::new(0.0, 0.0, 1.0);
        for (column, row) in [(100, 100), (1151, 647)] {
            let [right, down] = view.steps(column, row, floor(column, row), up);
            let pixel = |step: Vector| rig.camera().project(floor(column, row).plus(step)).unwrap();
            assert!((pixel(right).u - column as f64 - 1.0).abs() < 0.02, "{:?}", pixel(right));
            assert!((pixel(down).v - row as f64 - 1.0).abs() < 0.02, "{:?}", pixel(down));
        }
    }

    #[test]
    fn joined_rectangles_cover_the_same_pixels_and_do_not_overlap() {
        let make = |left, top, right, bottom| PixelRectangle { left, top, right, bottom };
        let given = vec![
            make(0, 0, 10, 10),
            make(20, 0, 30, 10),
            make(8, 5, 22, 9),
            make(40, 40, 50, 50),
            make(5, 5, 5, 9),
        ];
        let joined = disjoint(given.clone());
        assert_eq!(joined.len(), 2);
        for row in 0..60 {
            for column in 0..60 {
                if given.iter().any(|r| r.contains(column, row)) {
                    assert_eq!(joined.iter().filter(|r| r.contains(column, row)).count(), 1);
                }
            }
        }
    }
}
