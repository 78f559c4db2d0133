//! Boxes around objects, in pixels.
//!
//! Frame of reference: u to the right, v down, (0, 0) is the *corner* of the top left pixel, as in COCO; a pixel's
//! centre lies at half numbers. (Cameras elsewhere in this project put (0, 0) at that pixel's centre: subtract 0.5.)

use serde::{Deserialize, Serialize};

/// An upright rectangle, pixels; `left <= right` and `top <= bottom` where it comes out of this crate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BoundingBox {
    /// Leftmost column, pixels.
    pub left: f32,
    /// Uppermost row, pixels.
    pub top: f32,
    /// Rightmost column, pixels.
    pub right: f32,
    /// Lowest row, pixels.
    pub bottom: f32,
}

impl BoundingBox {
    /// A box around a centre, all in pixels.
    #[must_use]
    pub fn around(centre_x: f32, centre_y: f32, width: f32, height: f32) -> Self {
        Self {
            left: centre_x - width / 2.0,
            top: centre_y - height / 2.0,
            right: centre_x + width / 2.0,
            bottom: centre_y + height / 2.0,
        }
    }

    /// Pixels from left to right, never negative.
    #[must_use]
    pub fn width(&self) -> f32 {
        (self.right - self.left).max(0.0)
    }

    /// Pixels from top to bottom, never negative.
    #[must_use]
    pub fn height(&self) -> f32 {
        (self.bottom - self.top).max(0.0)
    }

    /// Square pixels.
    #[must_use]
    pub fn area(&self) -> f32 {
        self.width() * self.height()
    }

    /// The square pixels that both boxes cover.
    #[must_use]
    pub fn common_area(&self, other: &Self) -> f32 {
        let width = self.right.min(other.right) - self.left.max(other.left);
        let height = self.bottom.min(other.bottom) - self.top.max(other.top);
        width.max(0.0) * height.max(0.0)
    }

    /// Intersection over union, 0 to 1; 0 for boxes without area.
    #[must_use]
    pub fn overlap(&self, other: &Self) -> f32 {
        let common = self.common_area(other);
        let union = self.area() + other.area() - common;
        if union > 0.0 { common / union } else { 0.0 }
    }

    /// The part of the box inside a picture of this size.
    #[must_use]
    pub fn clipped(&self, width: f32, height: f32) -> Self {
        Self {
            left: self.left.clamp(0.0, width),
            top: self.top.clamp(0.0, height),
            right: self.right.clamp(0.0, width),
            bottom: self.bottom.clamp(0.0, height),
        }
    }

    /// Are all four numbers finite?
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.left.is_finite() && self.top.is_finite() && self.right.is_finite() && self.bottom.is_finite()
    }

    /// As COCO writes it: left, top, width, height.
    #[must_use]
    pub fn as_coco(&self) -> [f32; 4] {
        [self.left, self.top, self.width(), self.height()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlap_is_common_area_over_union() {
        let first = BoundingBox { left: 0.0, top: 0.0, right: 10.0, bottom: 10.0 };
        let half = BoundingBox { left: 5.0, top: 0.0, right: 15.0, bottom: 10.0 };
        assert!((first.overlap(&half) - 50.0 / 150.0).abs() < 1e-6);
        assert!((first.overlap(&first) - 1.0).abs() < 1e-6);
        let apart = BoundingBox { left: 20.0, top: 0.0, right: 30.0, bottom: 10.0 };
        assert_eq!(first.overlap(&apart), 0.0);
    }

    #[test]
    fn boxes_without_area_overlap_nothing_and_divide_by_nothing() {
        let point = BoundingBox { left: 3.0, top: 3.0, right: 3.0, bottom: 3.0 };
        assert_eq!(point.overlap(&point), 0.0);
        let inside_out = BoundingBox { left: 9.0, top: 9.0, right: 1.0, bottom: 1.0 };
        assert_eq!(inside_out.area(), 0.0);
    }
}
