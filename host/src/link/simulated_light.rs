//! The light of scenes that are given as columns instead of pictures: what an honest camera would report of them while
//! the laser is driven by the controller's code.

use nearfield_shared::audit::first_row_for;
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::WEAKEST_SIGNAL;
use nearfield_shared::linescan::{AUDIT_PIXELS, AuditWindow, LineScanColumn};
use nearfield_shared::status::Challenge;
use nearfield_shared::units::Micros;

use crate::light::LightReport;

/// Brightness of a simulated stripe per step of the laser's level: 60 steps of the light signal at full drive.
const BRIGHTNESS_PER_LEVEL: u16 = 60;
/// The light signal of a simulated floor.
const FLOOR_SIGNAL: u8 = 120;
/// Height of a simulated stripe over it.
const STRIPE_SIGNAL: f32 = 70.0;
/// Levels that are remembered: at 40 ms each these reach back more than a second.
const REMEMBERED: usize = 32;

/// Follows the laser and lights scenes with it.
#[derive(Debug, Clone, Default)]
pub struct SimulatedLight {
    /// When the level changed, and to what; newest last.
    changes: Vec<(Micros, u8)>,
}

impl SimulatedLight {
    /// The laser is driven at this level from `now` on.
    pub fn follow(&mut self, now: Micros, level: u8) {
        if self.changes.last().is_none_or(|(_, newest)| *newest != level) {
            if self.changes.len() == REMEMBERED {
                self.changes.remove(0);
            }
            self.changes.push((now, level));
        }
    }

    /// The level at a time; 0 before anything is known.
    pub fn level_at(&self, time: Micros) -> u8 {
        self.changes.iter().rev().find(|(since, _)| *since <= time).map_or(0, |(_, level)| *level)
    }

    /// The mean level over an exposure, 0 to 1: what a camera collects.
    pub fn mean_level(&self, middle: Micros, length: Micros) -> f32 {
        let start = Micros::new(middle.get().saturating_sub(length.get() / 2));
        let steps = 16;
        let sum: f32 = (0..steps)
            .map(|step| f32::from(self.level_at(start.plus(Micros::new(length.get() * step / steps)))))
            .sum();
        sum / (255.0 * steps as f32)
    }
}

/// What a host that claims `claimed` reports besides, while the camera shows `shown` in light of this level. An honest
/// host claims what the camera shows.
#[must_use]
pub fn report(
    claimed: &[LineScanColumn],
    shown: &[LineScanColumn],
    level: u8,
    challenge: &Challenge,
) -> LightReport {
    let mut light = LightReport { ambient: 80, ..LightReport::new() };
    for (index, column) in claimed.iter().enumerate() {
        if column.row.to_pixels().is_some() && column.quality >= WEAKEST_SIGNAL {
            let block = BrightnessProfile::block_of(index, claimed.len());
            light.brightness.blocks[block] = u16::from(level) * BRIGHTNESS_PER_LEVEL;
        }
    }
    let row = |columns: &[LineScanColumn], column: u16| {
        columns.get(usize::from(column)).and_then(|column| column.row.to_pixels())
    };
    let asked = challenge.columns.iter().take(usize::from(challenge.count));
    light.windows.extend(asked.map(|column| window(*column, row(claimed, *column), row(shown, *column))));
    light
}

/// The pixels around a claimed row, of a camera that sees the stripe at `shown`.
fn window(column: u16, claimed: Option<f32>, shown: Option<f32>) -> AuditWindow {
    let first_row = first_row_for(claimed.unwrap_or(0.0));
    let mut pixels = [FLOOR_SIGNAL; AUDIT_PIXELS];
    if let Some(row) = shown {
        for (offset, pixel) in pixels.iter_mut().enumerate() {
            let distance = f32::from(first_row) + offset as f32 - row;
            *pixel += (STRIPE_SIGNAL * (-distance * distance / 6.0).exp()) as u8;
        }
    }
    AuditWindow { column, first_row, pixels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_level_of_a_time_and_of_an_exposure() {
        let mut light = SimulatedLight::default();
        assert_eq!(light.level_at(Micros::from_millis(5)), 0);
        for (at, level) in [(10, 255), (20, 255), (50, 153)] {
            light.follow(Micros::from_millis(at), level);
        }
        assert_eq!(
            [9, 10, 49, 50, 99].map(|at| light.level_at(Micros::from_millis(at))),
            [0, 255, 255, 153, 153]
        );
        let mean = |at: u64| light.mean_level(Micros::from_millis(at), Micros::from_millis(4));
        assert!((mean(30) - 1.0).abs() < 1e-6 && (mean(80) - 0.6).abs() < 1e-6);
        assert!((mean(50) - 0.8).abs() < 0.02, "half and half");
    }

    #[test]
    fn only_the_newest_changes_are_kept() {
        let mut light = SimulatedLight::default();
        for change in 0..100_u64 {
            light.follow(Micros::new(change), if change % 2 == 0 { 255 } else { 153 });
        }
        assert_eq!((light.changes.len(), light.level_at(Micros::new(67))), (REMEMBERED, 0));
        assert_eq!(light.level_at(Micros::new(68)), 255);
    }
}
