//! How well can the stripe be seen at all? Photons only: what no extraction can do better than.

use super::Twin;
use crate::twin::sensor::Shot;
use crate::twin::truth::Truth;

/// Length of the stripe that is judged at a time, millimetres: the longest gap that is allowed.
const STRETCH_MM: usize = 5;
/// Rows to both sides of the stripe's middle that hold its light, pixels of the camera's own picture.
const ROWS_ASIDE: f64 = 12.0;

impl Twin {
    /// Signal-to-noise ratio of the faintest 5 mm of the stripe on the floor, where the camera sees it: the light that
    /// the laser adds to the sensor's raw red, against the noise of that red (photons, read-out), over all pixels of the
    /// stretch, each weighed as is best (a matched filter on a background that is known exactly). Light beyond the
    /// sensor's saturation does not count. Texture, colour processing and eight bits only make it worse.
    ///
    /// Infinite where no stretch of the floor's stripe is seen.
    #[must_use]
    pub fn faintest_stretch(&self, truth: &Truth, drive: f32) -> f64 {
        let profile = &truth.profile;
        let on_floor = |index: usize| {
            let seen = *profile.object.get(index)? < 0 && *profile.visible.get(index)?;
            seen.then_some(((*profile.column.get(index)?)?, (*profile.row.get(index)?)?))
        };
        let squares: Vec<Option<f64>> = (0..profile.visible.len())
            .map(|index| {
                let (column, row) = on_floor(index)?;
                // The profile has one entry for each millimetre.
                let (next, _) = on_floor(index + 1).or_else(|| on_floor(index.checked_sub(1)?))?;
                Some((next - column).abs() * self.ratio_squared(column, row, drive))
            })
            .collect();
        squares
            .windows(STRETCH_MM)
            .filter_map(|stretch| stretch.iter().copied().sum::<Option<f64>>())
            .fold(f64::INFINITY, f64::min)
            .sqrt()
    }

    /// Squared signal-to-noise ratio of one column of pixels around a row.
    fn ratio_squared(&self, column: f64, row: f64, drive: f32) -> f64 {
        let (width, height) = (self.view.width(), self.view.height());
        let (day, laser) = self.incident();
        let shot =
            Shot { look: &self.look, exposure: self.exposure, drive, frame: 0, scale: self.scale() as f32 };
        let aside = ROWS_ASIDE * self.scale();
        let first = (row - aside).max(0.0) as usize;
        let end = ((row + aside) as usize + 1).min(height);
        let column = (column.round().max(0.0) as usize).min(width.saturating_sub(1));
        (first..end)
            .map(|row| {
                let daylight = day.values[3 * width * row + column];
                let (signal, noise) = self.sensor.red_light(daylight, laser[width * row + column], &shot);
                f64::from(signal / noise).powi(2)
            })
            .sum()
    }
}
