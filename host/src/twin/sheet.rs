//! The sheet of laser light: how strongly it lights a point of a surface.

use nearfield_shared::camera::Vector;
use nearfield_shared::laser::Laser;
use nearfield_shared::rig::{Rig, Stripe};

use super::scene::Look;
use super::shape::{length, normalised};

/// The sheet is focused here: distance from the laser, millimetres.
const FOCUS_MM: f64 = 540.0;
/// Full width at 1/e^2 in the focus, millimetres.
const FOCUS_WIDTH_MM: f64 = 1.30;
/// How the width grows away from the focus, millimetres per millimetre.
const DIVERGENCE: f64 = 0.0035;
/// The same for a red LED's band, whose source is no point.
const LED_DIVERGENCE: f64 = 0.02;
/// Area under a normal curve, by its full width at 1/e^2 and its height.
const NORMAL_AREA: f64 = 0.626_657;
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
    /// Full width at 1/e^2 in the focus, millimetres, and how it grows away from there.
    focus_width: f64,
    divergence: f64,
}

impl Sheet {
    /// A rig's sheet, of the laser or of the LED that the look names.
    #[must_use]
    pub fn new(rig: &Rig, look: &Look) -> Self {
        let (stripe, overhang_mm) = (*rig.stripe(), look.fan_overhang_mm);
        let (focus_width, divergence) =
            look.led_band_mm.map_or((FOCUS_WIDTH_MM, DIVERGENCE), |band| (band, LED_DIVERGENCE));
        Self {
            laser: *rig.laser(),
            stripe,
            first_s: stripe.start - overhang_mm,
            last_s: stripe.end + overhang_mm,
            focus_width,
            divergence,
        }
    }

    /// Full width of the sheet at 1/e^2 at a distance from the laser, millimetres.
    #[must_use]
    pub fn width(&self, distance_mm: f64) -> f64 {
        self.focus_width.hypot(self.divergence * (distance_mm - FOCUS_MM))
    }

    /// Light on a millimetre of a line across the fan at a distance from its source, in millimetres of the irradiance's
    /// unit.
    #[must_use]
    pub fn line_strength(&self, distance_mm: f64) -> f64 {
        NORMAL_AREA * FOCUS_WIDTH_MM * FOCUS_MM / distance_mm
    }

    /// Where the light comes from.
    #[must_use]
    pub const fn origin(&self) -> Vector {
        self.laser.origin
    }

    /// True if a point may be lit, judged by its distance from the sheet's middle plane only.
    #[must_use]
    pub fn is_near(&self, point: Vector) -> bool {
        (self.laser.normal.dot(point) - self.laser.offset).abs() < self.near_mm()
    }

    /// The sheet's middle plane, as normal and offset, and how far from it a point may be lit, millimetres.
    #[must_use]
    pub fn slab(&self) -> (Vector, f64, f64) {
        (self.laser.normal, self.laser.offset, self.near_mm())
    }

    fn near_mm(&self) -> f64 {
        const NEAR_MM: f64 = 12.0;
        NEAR_MM.max(1.5 * self.focus_width)
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
        let width = self.width(distance);
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

    /// Light of the sheet at a point of a translucent surface that it has reached under the surface, and where it has entered:
    /// it falls off exponentially by `length_mm` to both sides of the lit line, and all of it together is what fell on that
    /// line. Whether the entry is lit is the caller's business.
    #[must_use]
    pub fn wandered(&self, point: Vector, normal: Vector, length_mm: f64) -> Option<(Vector, f64)> {
        /// Surfaces that are more nearly parallel to the sheet than this have no lit line.
        const LEAST_SLOPE: f64 = 0.05;
        /// Beyond so many lengths no light is left.
        const FARTHEST_LENGTHS: f64 = 8.0;
        // The way on the surface that leads away from the sheet fastest.
        let uphill = self.laser.normal.minus(normal.scaled(normal.dot(self.laser.normal)));
        let slope = length(uphill);
        let offset = self.laser.normal.dot(point) - self.laser.offset;
        if slope < LEAST_SLOPE || offset.abs() > FARTHEST_LENGTHS * length_mm * slope {
            return None;
        }
        let entry = point.minus(uphill.scaled(offset / (slope * slope)));
        let towards = self.laser.origin.minus(entry);
        let distance = length(towards);
        let (facing, window) = (normal.dot(normalised(towards)), self.window(entry));
        if facing <= 0.0 || window <= 0.0 {
            return None;
        }
        let line = self.line_strength(distance) * facing * window / slope;
        Some((entry, line * (-(offset / slope).abs() / length_mm).exp() / (2.0 * length_mm)))
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

    fn look() -> Look {
        Look { fan_overhang_mm: 5.0, ..Look::default() }
    }

    /// Light is not lost by thinness: over a line of pixels across the sheet the sum of irradiance times pixel size
    /// is the same for fine and coarse pixels.
    #[test]
    fn energy_does_not_depend_on_the_pixels_size() {
        let sheet = Sheet::new(&gallery::default_rig(), &look());
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
        let rig = gallery::default_rig();
        let sheet = Sheet::new(&rig, &look());
        assert!((sheet.width(540.0) - 1.30).abs() < 1e-12);
        assert!(sheet.width(1100.0) > 2.3 && sheet.width(1100.0) < 2.4);
        let up = Vector::new(0.0, 0.0, 1.0);
        let at = |s: f64| sheet.irradiance(rig.stripe().at(s), up, [Vector::default(); 2]);
        assert!(at(rig.stripe().end) > 0.2);
        assert_eq!(at(rig.stripe().end + 7.0), 0.0);
        assert_eq!(at(rig.stripe().start - 7.0), 0.0);
    }

    /// An LED has no more light than the laser, spread over its band.
    #[test]
    fn a_led_band_is_as_much_dimmer_as_it_is_wider() {
        let rig = gallery::default_rig();
        let up = Vector::new(0.0, 0.0, 1.0);
        let across = |led_band_mm: Option<f64>| -> Vec<f64> {
            let sheet = Sheet::new(&rig, &Look { led_band_mm, ..look() });
            let at = |i: i32| Vector::new(0.0, 500.0 + f64::from(i) * 0.1, 0.0);
            (-600..=600).map(|i| sheet.irradiance(at(i), up, [Vector::default(); 2])).collect()
        };
        let (laser, led) = (across(None), across(Some(12.0)));
        let sum = |profile: &[f64]| profile.iter().sum::<f64>();
        let most = |profile: &[f64]| profile.iter().copied().fold(0.0, f64::max);
        assert!((sum(&led) / sum(&laser) - 1.0).abs() < 0.03, "{} and {}", sum(&led), sum(&laser));
        assert!((most(&laser) / most(&led) - 12.0 / 1.3).abs() < 0.5, "{} and {}", most(&laser), most(&led));
    }

    /// What wanders under a surface is not lost: across the stripe its sum is that of the light that falls on the surface, and
    /// its brightness falls to 1/e over the length that the material says, on a level surface and on a slope.
    #[test]
    fn wandering_light_keeps_its_sum_and_falls_off_by_its_length() {
        let rig = gallery::default_rig();
        let sheet = Sheet::new(&rig, &look());
        for normal in [Vector::new(0.0, 0.0, 1.0), Vector::new(0.0, -0.6, 0.8)] {
            let step = Vector::new(0.0, normal.z, -normal.y).scaled(0.05);
            let middle = rig.stripe().at(0.0);
            let at = |i: i32| middle.plus(step.scaled(f64::from(i)));
            for length_mm in [2.0, 6.0] {
                let wandered =
                    |i: i32| sheet.wandered(at(i), normal, length_mm).map_or(0.0, |(_, light)| light);
                let fallen = |i: i32| sheet.irradiance(at(i), normal, [Vector::default(); 2]);
                let sum = |light: &dyn Fn(i32) -> f64| (-2000..=2000).map(light).sum::<f64>();
                let (one, other) = (sum(&wandered), sum(&fallen));
                assert!((one / other - 1.0).abs() < 0.02, "{normal:?} {length_mm}: {one} of {other}");
                let steps = (length_mm / 0.05) as i32;
                let fall = wandered(steps) / wandered(0);
                assert!((fall - (-1.0_f64).exp()).abs() < 0.01, "{fall}");
            }
        }
    }

    #[test]
    fn a_surface_that_faces_away_stays_dark() {
        let rig = gallery::default_rig();
        let sheet = Sheet::new(&rig, &look());
        let away = normalised(rig.stripe().at(0.0).minus(rig.laser().origin));
        assert_eq!(sheet.irradiance(rig.stripe().at(0.0), away, [Vector::default(); 2]), 0.0);
    }
}
