//! What a mount resolves.

use nearfield_shared::camera::{Camera, Pixel, Vector};
use serde::Serialize;

use crate::mount::Mount;

/// Noise of one column's row, one sigma, pixels: what the host's vision reaches on floors that are seen well.
pub const ROW_NOISE: f64 = 0.15;
/// A gap over this trips, millimetres.
const GAP_LIMIT_MM: f64 = 5.0;
/// The lens blurs an object's two edges over about one column each, as the capability map has it.
const EDGE_COLUMNS: f64 = 2.0;
/// Places along the stripe at which everything is measured.
const PLACES: u32 = 33;
/// Heights are tried in these steps, millimetres.
const HEIGHT_STEP_MM: f64 = 2.0;
/// Nothing higher is tried, millimetres.
const HIGHEST_MM: f64 = 300.0;
/// The stripe must keep this far from the picture's border, pixels.
const BORDER: f64 = 8.0;
/// Step of the numerical derivatives, millimetres.
const STEP_MM: f64 = 0.01;

/// What a mount resolves; along the stripe the worst place counts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measures {
    /// Is the whole zone in the picture?
    pub covers_zone: bool,
    /// Length of the stripe around its middle that is in the picture, millimetres; at most the zone.
    pub covered_mm: f64,
    /// Rows that the stripe moves within its column for a millimetre of height over the floor, in the stripe's middle.
    pub middle_rows_per_mm: f64,
    /// The same where it is least.
    pub least_rows_per_mm: f64,
    /// Standard deviation of one column's height where it is worst, millimetres.
    pub height_sigma_mm: f64,
    /// Millimetres of stripe to a column where it is worst.
    pub column_mm: f64,
    /// Narrowest flat, dark object that is sure to trip: the limit and two blurred edges, millimetres.
    pub narrowest_mm: f64,
    /// Heights up to this keep the stripe in the picture everywhere, millimetres; beyond it they count as "no stripe".
    pub tallest_mm: f64,
    /// Length of the shadow that an object 50 mm high casts on the floor along the light, millimetres: blind, and what makes thin things seen.
    pub shadow_mm: f64,
}

/// Measures a mount, whether its whole zone is in the picture or not.
#[must_use]
pub fn measure(mount: &Mount) -> Measures {
    let camera = &mount.camera();
    let half = mount.zone_mm / 2.0;
    let covered = covered_half(mount, camera, half);
    let places = (0..PLACES).map(|place| covered * (2.0 * f64::from(place) / f64::from(PLACES - 1) - 1.0));
    let mut found = Measures {
        covers_zone: covered >= half,
        covered_mm: 2.0 * covered,
        middle_rows_per_mm: resolution(mount, camera, 0.0).map_or(0.0, |place| place.rows_per_mm),
        least_rows_per_mm: f64::INFINITY,
        height_sigma_mm: 0.0,
        column_mm: 0.0,
        narrowest_mm: 0.0,
        tallest_mm: HIGHEST_MM.min(mount.laser_mm[2]),
        shadow_mm: 50.0 * (mount.distance_mm - mount.laser_mm[1]) / mount.laser_mm[2],
    };
    for offset in places {
        let Resolution { rows_per_mm, column_mm } =
            resolution(mount, camera, offset).unwrap_or(Resolution::NONE);
        found.least_rows_per_mm = found.least_rows_per_mm.min(rows_per_mm);
        found.column_mm = found.column_mm.max(column_mm);
        found.tallest_mm = found.tallest_mm.min(tallest(mount, camera, offset));
    }
    found.height_sigma_mm = ROW_NOISE / found.least_rows_per_mm;
    found.narrowest_mm = GAP_LIMIT_MM + EDGE_COLUMNS * found.column_mm;
    found
}

/// Around one place of the stripe.
struct Resolution {
    rows_per_mm: f64,
    column_mm: f64,
}

impl Resolution {
    const NONE: Self = Self { rows_per_mm: 0.0, column_mm: f64::INFINITY };
}

/// Where the light that meets the floor at `offset` from the stripe's middle meets something `height` millimetres high.
fn lit(mount: &Mount, offset: f64, height: f64) -> Vector {
    let [x, y, z] = mount.laser_mm;
    let origin = Vector::new(x, y, z);
    let floor = Vector::new(x + offset, mount.distance_mm, 0.0);
    origin.plus(floor.minus(origin).scaled(1.0 - height / z))
}

fn seen(mount: &Mount, camera: &Camera, offset: f64, height: f64) -> Option<Pixel> {
    camera.project(lit(mount, offset, height))
}

fn is_inside(mount: &Mount, pixel: Pixel) -> bool {
    let [width, height] = mount.image;
    let within = |value: f64, length: u16| (BORDER..=f64::from(length) - 1.0 - BORDER).contains(&value);
    within(pixel.u, width) && within(pixel.v, height)
}

fn resolution(mount: &Mount, camera: &Camera, offset: f64) -> Option<Resolution> {
    let here = seen(mount, camera, offset, 0.0)?;
    let beside = seen(mount, camera, offset + STEP_MM, 0.0)?;
    let above = seen(mount, camera, offset, STEP_MM)?;
    let (along_u, along_v) = ((beside.u - here.u) / STEP_MM, (beside.v - here.v) / STEP_MM);
    let (up_u, up_v) = ((above.u - here.u) / STEP_MM, (above.v - here.v) / STEP_MM);
    // A raised stripe is compared with the floor's stripe in the same column, not at the same place.
    let rows_per_mm = (up_v - along_v * up_u / along_u).abs();
    (along_u.abs() > 1e-6 && rows_per_mm.is_finite())
        .then(|| Resolution { rows_per_mm, column_mm: 1.0 / along_u.abs() })
}

/// Half the length of the floor's stripe, around its middle, that is in the picture.
fn covered_half(mount: &Mount, camera: &Camera, half: f64) -> f64 {
    let inside = |offset: f64| seen(mount, camera, offset, 0.0).is_some_and(|pixel| is_inside(mount, pixel));
    let both = |offset: f64| inside(offset) && inside(-offset);
    if both(half) {
        return half;
    }
    let (mut low, mut high) = (0.0, half);
    if !both(low) {
        return 0.0;
    }
    for _ in 0..30 {
        let middle = (low + high) / 2.0;
        if both(middle) { low = middle } else { high = middle }
    }
    low
}

/// Up to which height the stripe stays in the picture.
fn tallest(mount: &Mount, camera: &Camera, offset: f64) -> f64 {
    let limit = HIGHEST_MM.min(mount.laser_mm[2]);
    let mut height = 0.0;
    while height + HEIGHT_STEP_MM < limit
        && seen(mount, camera, offset, height + HEIGHT_STEP_MM).is_some_and(|pixel| is_inside(mount, pixel))
    {
        height += HEIGHT_STEP_MM;
    }
    height
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use nearfield_shared::columns::{Decimation, StripeGeometry};

    /// The controller's own column maps are the reference: rows for a millimetre of height, millimetres to a column.
    #[test]
    fn measures_are_those_of_the_column_maps() {
        let mounts = [
            Mount::PAPER,
            Mount {
                camera_mm: [0.0, 0.0, 300.0],
                laser_mm: [0.0, 0.0, 120.0],
                view_degrees: 97.0,
                ..Mount::PAPER
            },
            Mount { camera_mm: [-150.0, 40.0, 520.0], ..Mount::PAPER },
        ];
        for mount in mounts {
            let rig = mount.rig().unwrap();
            let mut geometry = Box::new(StripeGeometry::<2304>::empty());
            geometry.fill(&rig, Decimation::none(2304)).unwrap();
            let least = geometry
                .maps()
                .iter()
                .map(|map| f64::from((map.row(1.0) - map.row(0.0)).abs()))
                .fold(f64::MAX, f64::min);
            let found = measure(&mount);
            assert!((found.least_rows_per_mm / least - 1.0).abs() < 0.01, "{found:?} against {least}");
            let places: Vec<f64> = geometry.maps().iter().map(|map| f64::from(map.floor_place)).collect();
            let widest = places.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
            assert!((found.column_mm / widest - 1.0).abs() < 0.01, "{found:?} against {widest}");
        }
    }

    /// The source paper's finding about the placement: the offset in height is what counts.
    #[test]
    fn displacement_grows_with_the_offset_in_height() {
        let at = |z: f64| measure(&Mount { camera_mm: [0.0, 0.0, z], ..Mount::PAPER }).middle_rows_per_mm;
        assert!(at(250.0) < at(300.0) && at(300.0) < at(400.0) && at(400.0) < at(500.0));
    }

    #[test]
    fn a_zone_wider_than_the_view_is_told_with_what_is_left() {
        let found = measure(&Mount { zone_mm: 2000.0, ..Mount::PAPER });
        assert!(!found.covers_zone && found.covered_mm < 2000.0 && found.covered_mm > 700.0, "{found:?}");
        assert!(measure(&Mount { zone_mm: 600.0, ..Mount::PAPER }).covers_zone);
    }

    #[test]
    fn nothing_higher_than_the_laser_is_measured_and_raising_the_axis_changes_what_is_in_the_picture() {
        assert!(measure(&Mount { laser_mm: [0.0, 0.0, 60.0], ..Mount::PAPER }).tallest_mm < 60.0);
        let low = measure(&Mount { tilt_degrees: -12.0, ..Mount::PAPER }).tallest_mm;
        let high = measure(&Mount { tilt_degrees: 12.0, ..Mount::PAPER }).tallest_mm;
        assert!((low - high).abs() > 10.0, "{low} {high}");
    }

    #[test]
    fn shadows_are_longer_behind_a_low_laser() {
        let shadow = |z: f64| measure(&Mount { laser_mm: [0.0, 0.0, z], ..Mount::PAPER }).shadow_mm;
        assert!((shadow(200.0) - 125.0).abs() < 1e-9 && (shadow(100.0) - 250.0).abs() < 1e-9);
    }
}
