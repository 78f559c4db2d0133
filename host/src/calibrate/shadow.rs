//! Where the laser's fan starts, from the shadows of blocks.
//!
//! The laser ray over the end of a block's top goes on to the floor, where the stripe resumes. Two such rays cross in
//! the fan's apex. Heights do not depend on it; the place along the stripe that a raised point belongs to does.

use super::model::Sheet;
use super::sheet::Placed;
use super::stripe::Candidate;
use nalgebra::{Matrix2, Vector2};

/// The ray from a block's edge to the floor, as places along the stripe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadowRay {
    /// Where the stripe on the block's top ends, millimetres along the stripe.
    pub top: f64,
    /// Height of the top, millimetres.
    pub height: f64,
    /// Where the stripe on the floor resumes, millimetres along the stripe.
    pub floor: f64,
}

/// The fan's apex: place along the stripe and height over the floor, millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apex {
    /// Along the stripe.
    pub along: f64,
    /// Over the floor.
    pub height: f64,
    /// Shadows that tell it; with less than two it rests on the assumption of [`find_apex`].
    pub rays: usize,
}

/// An edge is seen to this, millimetres: light that bleeds over it, its bevel.
const EDGE_SIGMA_MM: f64 = 2.5;
/// The laser is mounted this near to the camera, measured outward from the robot: both sit at its edge.
const OUTWARD_SIGMA_MM: f64 = 25.0;
/// The laser is mounted this near to the camera, measured along the edge.
const ALONG_SIGMA_MM: f64 = 300.0;
/// The neighbourhood of an end of a top, as a share of its length in columns.
const NEIGHBOURHOOD: f64 = 0.05;
/// A stripe on a side face is at least this bright, as a share of that on the top.
const BRIGHT: f64 = 0.3;
/// A shadow that contradicts the others by more sigmas than this is something else's.
const LARGEST_CONTRADICTION: f64 = 4.0;

/// The shadows of a block: at each end of its top, where the stripe resumes on the floor. An end at which the stripe
/// runs on down a side face gives none. `others` are all candidates that are neither on the floor nor on the top.
#[must_use]
pub fn shadow_rays(
    sheet: &Sheet,
    height: f64,
    top: &[Placed],
    floor: &[Placed],
    others: &[Candidate],
) -> Vec<ShadowRay> {
    let along = |placed: &Placed| sheet.place(nalgebra::Point3::new(placed.point.x, placed.point.y, 0.0));
    let (Some(first), Some(last)) = (top.first(), top.last()) else { return Vec::new() };
    let middle = (along(first) + along(last)) / 2.0;
    let places = || floor.iter().map(along);
    // The floor on either side of the shadow; the shadow lies around the top as seen from the laser.
    let gap = largest_gap(&mut places(), middle, along(last) - along(first));
    let Some([before, after]) = gap else { return Vec::new() };
    let mut rays = Vec::new();
    for (end, floor) in [(first, before), (last, after)] {
        if let Some(floor) = floor
            && !runs_on(end, top, others)
        {
            rays.push(ShadowRay { top: along(end), height, floor });
        }
    }
    rays
}

/// The longest stretch without floor, at least half as long as the top; its ends where floor is seen beyond them.
fn largest_gap(places: &mut dyn Iterator<Item = f64>, middle: f64, length: f64) -> Option<[Option<f64>; 2]> {
    let mut sorted: Vec<f64> = places.collect();
    sorted.sort_by(f64::total_cmp);
    let inner = sorted.windows(2).map(|pair| (pair[0], pair[1]));
    let widest = inner.max_by(|one, other| (one.1 - one.0).total_cmp(&(other.1 - other.0)));
    let (before, after) = widest?;
    if after - before >= length / 2.0 {
        return Some([Some(before), Some(after)]);
    }
    // The shadow reaches an end of the stripe: only its other end is seen.
    let (first, last) = (*sorted.first()?, *sorted.last()?);
    if middle > last {
        Some([Some(last), None])
    } else if middle < first {
        Some([None, Some(first)])
    } else {
        None
    }
}

/// Does the stripe go on beyond this end of the top, on a side face? It is as bright there, and seen in most of the
/// columns next to the end.
fn runs_on(end: &Placed, top: &[Placed], others: &[Candidate]) -> bool {
    let reach = (NEIGHBOURHOOD * top.len() as f64).max(8.0);
    let bright = BRIGHT * top.iter().map(|point| point.contrast).sum::<f64>() / top.len() as f64;
    let near = others.iter().filter(|other| {
        other.contrast >= bright
            && (other.pixel.u - end.pixel.u).abs() <= reach
            && (other.pixel.v - end.pixel.v).abs() <= 2.0 * reach
    });
    near.count() as f64 > reach / 2.0
}

/// The apex by least squares from shadows, and from what is assumed where they are too few: the laser stands as far
/// out from the robot as the camera. `camera_along`, `camera_across`: the camera's foot along and across the stripe.
#[must_use]
pub fn find_apex(sheet: &Sheet, rays: &[ShadowRay], camera_along: f64, camera_across: f64) -> Apex {
    let assumed = Vector2::new(camera_along, (sheet.distance - camera_across) / sheet.slant);
    let height_sigma = (OUTWARD_SIGMA_MM / sheet.slant).abs();
    let mut kept = rays.to_vec();
    loop {
        let mut normal =
            Matrix2::from_diagonal(&Vector2::new(ALONG_SIGMA_MM.powi(-2), height_sigma.powi(-2)));
        let mut right = normal * assumed;
        for ray in &kept {
            // along - floor - (top - floor) height / ray.height = 0, its error grows with the way to the apex.
            let lean = (ray.top - ray.floor) / ray.height;
            let sigma = EDGE_SIGMA_MM * (assumed.y / ray.height).abs().max(1.0);
            let row = Vector2::new(1.0, -lean) / sigma;
            normal += row * row.transpose();
            right += row * (ray.floor / sigma);
        }
        let solved = normal.try_inverse().map_or(assumed, |inverse| inverse * right);
        let contradiction = |ray: &ShadowRay| {
            let lean = (ray.top - ray.floor) / ray.height;
            let sigma = EDGE_SIGMA_MM * (assumed.y / ray.height).abs().max(1.0);
            (solved.x - ray.floor - lean * solved.y).abs() / sigma
        };
        let worst = kept
            .iter()
            .enumerate()
            .max_by(|one, other| contradiction(one.1).total_cmp(&contradiction(other.1)));
        match worst {
            Some((index, ray)) if contradiction(ray) > LARGEST_CONTRADICTION => {
                kept.remove(index);
            }
            _ => return Apex { along: solved.x, height: solved.y, rays: kept.len() },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHEET: Sheet = Sheet { heading: std::f64::consts::FRAC_PI_2, distance: 500.0, slant: 2.5 };

    /// A ray from the apex (along 40, 200 mm up) over a top of this height to the floor.
    fn ray(top: f64, height: f64) -> ShadowRay {
        ShadowRay { top, height, floor: 40.0 + (top - 40.0) * 200.0 / (200.0 - height) }
    }

    #[test]
    fn shadows_cross_in_the_apex() {
        let apex = find_apex(&SHEET, &[ray(-150.0, 60.0), ray(110.0, 60.0), ray(-90.0, 120.0)], 0.0, 0.0);
        assert!((apex.along - 40.0).abs() < 1.0 && (apex.height - 200.0).abs() < 1.0, "{apex:?}");
        assert_eq!(apex.rays, 3);
    }

    #[test]
    fn one_shadow_and_the_cameras_distance_suffice() {
        let apex = find_apex(&SHEET, &[ray(110.0, 60.0)], 0.0, 0.0);
        assert!((apex.along - 40.0).abs() < 2.0 && (apex.height - 200.0).abs() < 1.0, "{apex:?}");
    }

    #[test]
    fn without_shadows_the_laser_stands_beside_the_camera() {
        let apex = find_apex(&SHEET, &[], -30.0, 0.0);
        assert!((apex.along + 30.0).abs() < 1e-6 && (apex.height - 200.0).abs() < 1e-6, "{apex:?}");
        assert_eq!(apex.rays, 0);
    }

    #[test]
    fn a_shadow_of_something_else_is_left_out() {
        let wrong = ShadowRay { top: -200.0, height: 60.0, floor: -205.0 };
        let apex =
            find_apex(&SHEET, &[ray(-150.0, 60.0), ray(110.0, 60.0), ray(90.0, 120.0), wrong], 0.0, 0.0);
        assert_eq!(apex.rays, 3);
        assert!((apex.along - 40.0).abs() < 2.0, "{apex:?}");
    }
}
