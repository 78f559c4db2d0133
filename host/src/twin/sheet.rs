//! The sheet of laser light: how strongly it lights a point of a surface.

use nearfield_shared::camera::Vector;
use nearfield_shared::laser::Laser;
use nearfield_shared::rig::{Rig, Stripe};

use super::shape::{length, normalised};

/// The sheet is focused here: distance from the laser, millimetres.
const FOCUS_MM: f64 = 540.0;
/// Full width at 1/e^2 in the focus, millimetres.
const FOCUS_WIDTH_MM: f64 = 1.30;
/// How the width grows away from the focus, millimetres per millimetre.
const DIVERGENCE: f64 = 0.0035;
/// The fan's ends fade over this length on the floor, millimetres.
const FADE_MM: f64 = 2.0;
/// Beyond this many standard deviations there is no light.
const FARTHEST_DEVIATIONS: f64 = 4.0;

/// The laser's sheet with the ends of its fan.
#[derive(Debug, Clone, Copy)]
pub struct Sheet {
    laser: Laser,
    stripe: Stripe,
    first_s: f64,
    last_s: f64,
}

impl Sheet {
    /// A rig's sheet; the fan reaches `overhang_mm` beyond both ends of the watched stripe.
    #[must_use]
    pub fn new(rig: &Rig, overhang_mm: f64) -> Self {
        let stripe = *rig.stripe();
        Self {
            laser: *rig.laser(),
            stripe,
            first_s: stripe.start - overhang_mm,
            last_s: stripe.end + overhang_mm,
        }
    }

    /// Full width of the sheet at 1/e^2 at a distance from the laser, millimetres.
    #[must_use]
    pub fn width(distance_mm: f64) -> f64 {
        FOCUS_WIDTH_MM.hypot(DIVERGENCE * (distance_mm - FOCUS_MM))
    }

    /// Where the light comes from.
    #[must_use]
    pub const fn origin(&self) -> Vector {
        self.laser.origin
    }

    /// True if a point may be lit, judged by its distance from the sheet's middle plane only.
    #[must_use]
    pub fn is_near(&self, point: Vector) -> bool {
        const NEAR_MM: f64 = 12.0;
        (self.laser.normal.dot(point) - self.laser.offset).abs() < NEAR_MM
    }

    /// Irradiance of a surface at `point`, averaged over one pixel, relative to a surface that faces the laser in the
    /// middle of the sheet in its focus. Shadows are the caller's business. `steps` are the surface's movements from
    /// one pixel to the next ([`super::view::View::steps`]): a stripe thinner than a pixel keeps its energy.
    #[must_use]
    pub fn irradiance(&self, point: Vector, normal: Vector, steps: [Vector; 2]) -> f64 {
        let towards = self.laser.origin.minus(point);
        let distance = length(towards);
        let facing = normal.dot(normalised(towards));
        let window = self.window(point);
        if facing <= 0.0 || window <= 0.0 {
            return 0.0;
        }
        let width = Self::width(distance);
        let deviation = width / 4.0;
        let spread = steps.map(|step| self.laser.normal.dot(step).powi(2) / 12.0).into_iter().sum::<f64>();
        let wide = (deviation * deviation + spread).sqrt();
        let offset = self.laser.normal.dot(point) - self.laser.offset;
        if offset.abs() > FARTHEST_DEVIATIONS * wide {
            return 0.0;
        }
        let profile = deviation / wide * (-0.5 * (offset / wide).powi(2)).exp();
        profile * facing * window * (FOCUS_MM / distance) * (FOCUS_WIDTH_MM / width)
    }

    /// The fan's brightness along the stripe: 1 inside, fading to 0 at its ends.
    fn window(&self, point: Vector) -> f64 {
        let Some(shadow) = self.laser.shadow_on_floor(point) else { return 0.0 };
        let s = self.stripe.coordinate_of(shadow);
        let inside = (s - self.first_s).min(self.last_s - s);
        (inside / FADE_MM + 0.5).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery;

    /// Light is not lost by thinness: over a line of pixels across the sheet the sum of irradiance times pixel size
    /// is the same for fine and coarse pixels.
    #[test]
    fn energy_does_not_depend_on_the_pixels_size() {
        let sheet = Sheet::new(&gallery::default_rig(), 5.0);
        let up = Vector::new(0.0, 0.0, 1.0);
        let total = |size: f64| -> f64 {
            let steps = [Vector::new(size, 0.0, 0.0), Vector::new(0.0, size, 0.0)];
            (-200..=200)
                .map(|i| 500.0 + 0.313 + f64::from(i) * size)
                .map(|y| sheet.irradiance(Vector::new(0.0, y, 0.0), up, steps) * size)
                .sum()
        };
        let fine = total(0.05);
        for size in [0.5, 1.0, 2.0] {
            assert!((total(size) / fine - 1.0).abs() < 0.02, "{size}: {} of {fine}", total(size));
        }
    }

    #[test]
    fn the_sheet_widens_away_from_its_focus_and_ends_with_its_fan() {
        assert!((Sheet::width(540.0) - 1.30).abs() < 1e-12);
        assert!(Sheet::width(1100.0) > 2.3 && Sheet::width(1100.0) < 2.4);
        let rig = gallery::default_rig();
        let sheet = Sheet::new(&rig, 5.0);
        let up = Vector::new(0.0, 0.0, 1.0);
        let at = |s: f64| sheet.irradiance(rig.stripe().at(s), up, [Vector::default(); 2]);
        assert!(at(rig.stripe().end) > 0.2);
        assert_eq!(at(rig.stripe().end + 7.0), 0.0);
        assert_eq!(at(rig.stripe().start - 7.0), 0.0);
    }

    #[test]
    fn a_surface_that_faces_away_stays_dark() {
        let rig = gallery::default_rig();
        let sheet = Sheet::new(&rig, 5.0);
        let away = normalised(rig.stripe().at(0.0).minus(rig.laser().origin));
        assert_eq!(sheet.irradiance(rig.stripe().at(0.0), away, [Vector::default(); 2]), 0.0);
    }
}
