//! The region of interest warped to a top-down view of the floor.

use std::ops::Range;

use image::{GrayImage, Luma};
use imageproc::geometric_transformations::{Border, Interpolation, Projection, warp_into};
use nearfield_shared::camera::Camera;
use nearfield_shared::limits::{DEEPEST_MAPPED, HIGHEST_MAPPED};
use nearfield_shared::rig::Rig;

use super::trajectory::Trajectory;

/// Pixels of the top-down view per millimetre.
pub const PIXELS_PER_MM: f64 = 2.0;
/// Half the view's depth across the stripe, millimetres.
const HALF_DEPTH_MM: f64 = 40.0;
/// A stripe farther than this from its trajectory, as seen from above, is off it, millimetres.
const ON_LINE_MM: f64 = 5.0;

/// The homography and the view's size.
#[derive(Debug, Clone)]
pub struct TopDown {
    /// Camera picture to top-down view.
    projection: Projection,
    start_mm: f64,
    width: u32,
    height: u32,
    rows: Range<u32>,
    baseline: Trajectory,
}

impl TopDown {
    /// The homography through four points of the floor around the watched stretch, as a flat target gives them.
    #[must_use]
    pub fn new(rig: &Rig) -> Option<Self> {
        let stripe = rig.stripe();
        let across = nearfield_shared::camera::Vector::new(-stripe.direction.y, stripe.direction.x, 0.0);
        let width = ((stripe.end - stripe.start) * PIXELS_PER_MM) as u32;
        let height = (2.0 * HALF_DEPTH_MM * PIXELS_PER_MM) as u32;
        let corner = |s: f64, side: f64| -> Option<((f32, f32), (f32, f32))> {
            let seen = rig.camera().project(stripe.at(s).plus(across.scaled(side * HALF_DEPTH_MM)))?;
            let x = (s - stripe.start) * PIXELS_PER_MM;
            let y = f64::from(height) / 2.0 - side * HALF_DEPTH_MM * PIXELS_PER_MM;
            Some(((seen.u as f32, seen.v as f32), (x as f32, y as f32)))
        };
        let corners = [
            corner(stripe.start, -1.0)?,
            corner(stripe.end, -1.0)?,
            corner(stripe.end, 1.0)?,
            corner(stripe.start, 1.0)?,
        ];
        let projection =
            Projection::from_control_points(corners.map(|pair| pair.0), corners.map(|pair| pair.1))?;
        let baseline = baseline(rig)?;
        Some(Self { projection, start_mm: stripe.start, width, height, rows: rows(rig), baseline })
    }

    /// Where the stripe runs on an empty floor: the paper's baseline floor reference.
    #[must_use]
    pub const fn baseline(&self) -> Trajectory {
        self.baseline
    }

    /// Stripe coordinate of the view's first column, millimetres.
    #[must_use]
    pub const fn start_mm(&self) -> f64 {
        self.start_mm
    }

    /// Columns of the view.
    #[must_use]
    pub const fn places(&self) -> usize {
        self.width as usize
    }

    /// Picture rows in which the stripe can be, on the floor or raised.
    #[must_use]
    pub fn rows(&self) -> Range<u32> {
        self.rows.clone()
    }

    /// Stripe coordinate of a picture's point that lies on the floor, millimetres.
    #[must_use]
    pub fn place(&self, column: f32, row: f32) -> f32 {
        let (x, _) = self.projection * (column, row);
        self.start_mm as f32 + x / PIXELS_PER_MM as f32
    }

    /// How much of the stripe is seen at each place: 1 where the warped mask is white within reach of the trajectory.
    #[must_use]
    pub fn signal(&self, mask: &GrayImage, trajectory: &Trajectory) -> Vec<f32> {
        let mut view = GrayImage::new(self.width, self.height);
        warp_into(mask, self.projection, Interpolation::Bilinear, Border::Constant(Luma([0])), &mut view);
        let (left, right) = (0.0, mask.width() as f32);
        let ends = [left, right].map(|column| self.projection * (column, trajectory.row(column)));
        let slope = (ends[1].1 - ends[0].1) / (ends[1].0 - ends[0].0);
        let reach = (ON_LINE_MM * PIXELS_PER_MM) as f32;
        (0..self.width)
            .map(|x| {
                let middle = ends[0].1 + slope * (x as f32 - ends[0].0);
                let first = (middle - reach).max(0.0) as u32;
                let last = ((middle + reach).max(0.0) as u32).min(self.height);
                let brightest = (first..last).map(|y| view.get_pixel(x, y).0[0]).max().unwrap_or(0);
                f32::from(brightest) / 255.0
            })
            .collect()
    }
}

/// The line through the places at a quarter and three quarters of the stripe, which a bent line misses least.
fn baseline(rig: &Rig) -> Option<Trajectory> {
    let stripe = rig.stripe();
    let seen =
        |share: f64| rig.camera().project(stripe.at(stripe.start * (1.0 - share) + stripe.end * share));
    let (one, other) = (seen(0.25)?, seen(0.75)?);
    let slope = (other.v - one.v) / (other.u - one.u);
    slope.is_finite().then_some(Trajectory { at_zero: (one.v - slope * one.u) as f32, slope: slope as f32 })
}

/// Rows between the deepest and the highest point that a stripe can be on.
fn rows(rig: &Rig) -> Range<u32> {
    let height = f64::from(rig.image().height);
    let (mut first, mut last) = (height, 0.0_f64);
    for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let foot = rig.stripe().at(rig.stripe().start * (1.0 - share) + rig.stripe().end * share);
        for z in [f64::from(DEEPEST_MAPPED.get()), 0.0, 60.0, 120.0, f64::from(HIGHEST_MAPPED.get())] {
            if let Some(row) = lit_row(rig.camera(), rig, foot, z) {
                (first, last) = (first.min(row), last.max(row));
            }
        }
    }
    let margin = height * 0.03;
    ((first - margin).clamp(0.0, height) as u32)..((last + margin).clamp(0.0, height) as u32)
}

/// Row of the point of a laser ray at height `z`.
fn lit_row(camera: &Camera, rig: &Rig, foot: nearfield_shared::camera::Vector, z: f64) -> Option<f64> {
    let origin = rig.laser().origin;
    camera.project(foot.plus(origin.minus(foot).scaled(z / origin.z))).map(|pixel| pixel.v)
}
