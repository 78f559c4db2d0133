//! What the fit's covariance means in millimetres.

use nearfield_shared::camera::{Pixel, Vector};
use serde::Serialize;

use super::fit::Fit;
use super::model::{Model, Sheet};

/// Heights at which the uncertainty is told, millimetres.
pub const HEIGHTS_MM: [f64; 3] = [0.0, 50.0, 100.0];
/// Places along the stripe at which it is told, as shares of the watched stretch.
const PLACES: [f64; 5] = [0.02, 0.25, 0.5, 0.75, 0.98];

/// How sure a height is that the rig measures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HeightSigma {
    /// Place along the stripe, millimetres, in the rig's own coordinate.
    pub place_mm: f64,
    /// The height, millimetres.
    pub height_mm: f64,
    /// One sigma of its systematic error, millimetres: it is the same in every picture. NaN where the camera does not
    /// see that point.
    pub sigma_mm: f64,
}

/// One sigma of measured heights along the stripe. `extent`: the watched stretch as places of the sheet; `shift`: what
/// to add to those for the rig's own coordinate.
#[must_use]
pub fn height_sigmas(fit: &Fit, extent: [f64; 2], shift: f64) -> Vec<HeightSigma> {
    let mut sigmas = Vec::new();
    for share in PLACES {
        let along = extent[0] + share * (extent[1] - extent[0]);
        for height_mm in HEIGHTS_MM {
            let sigma_mm = height_sigma(fit, along, height_mm).unwrap_or(f64::NAN);
            sigmas.push(HeightSigma { place_mm: along + shift, height_mm, sigma_mm });
        }
    }
    sigmas
}

fn height_sigma(fit: &Fit, along: f64, height: f64) -> Option<f64> {
    let (camera, sheet) = (fit.model.camera()?, fit.model.sheet?);
    let point = sheet.point(along, height);
    let pixel = camera.project(Vector::new(point.x, point.y, point.z))?;
    fit.sigma_of(|model| measured_height(model, pixel))
}

/// The height that a model makes of a stripe pixel.
#[must_use]
pub fn measured_height(model: &Model, pixel: Pixel) -> Option<f64> {
    let (camera, sheet) = (model.camera()?, model.sheet?);
    let (sight, centre) = (camera.line_of_sight(pixel)?, camera.pose.centre());
    let (normal, offset) = sheet.plane();
    let along = |vector: Vector| normal.x * vector.x + normal.y * vector.y + normal.z * vector.z;
    let reach = (offset - along(centre)) / along(sight);
    (reach > 0.0).then_some(centre.z + reach * sight.z).filter(|height| height.is_finite())
}

/// One sigma of the sheet's direction, degrees: of its tilt and of its heading together.
#[must_use]
pub fn plane_sigma_degrees(fit: &Fit) -> Option<f64> {
    let tilt = fit.sigma_of(|model| model.sheet.map(|sheet| sheet.slant.atan()))?;
    let slant = fit.model.sheet.map(|Sheet { slant, .. }| slant)?;
    let heading = fit.sigma_of(|model| model.sheet.map(|sheet| sheet.heading))?;
    // The heading moves the normal by its horizontal part only.
    Some(tilt.hypot(heading / slant.hypot(1.0)).to_degrees())
}
