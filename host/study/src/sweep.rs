//! One quantity of a mount varied, all else kept.

use serde::Serialize;

use crate::measure::{Measures, measure};
use crate::mount::Mount;

/// What is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Height of the camera over the laser, the laser kept.
    VerticalOffset,
    /// Place of the camera outward from the laser, heights kept.
    OutwardOffset,
    /// Place of the camera along the robot's edge.
    SidewardOffset,
    /// Height of the laser, the camera kept.
    LaserHeight,
    /// Distance of the stripe.
    Distance,
    /// The lens's horizontal field of view.
    View,
    /// The camera's axis, raised from the stripe's middle.
    Tilt,
}

impl Quantity {
    /// All, in the order of the report.
    pub const ALL: [Self; 7] = [
        Self::VerticalOffset,
        Self::OutwardOffset,
        Self::SidewardOffset,
        Self::LaserHeight,
        Self::Distance,
        Self::View,
        Self::Tilt,
    ];

    /// For people, with the unit.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::VerticalOffset => "camera over laser, mm",
            Self::OutwardOffset => "camera outward of laser, mm",
            Self::SidewardOffset => "camera sideways of laser, mm",
            Self::LaserHeight => "height of laser, mm",
            Self::Distance => "distance of stripe, mm",
            Self::View => "horizontal view, degrees",
            Self::Tilt => "camera's axis raised, degrees",
        }
    }

    /// From, to and step of a sweep.
    const fn range(self) -> (f64, f64, f64) {
        match self {
            Self::VerticalOffset => (25.0, 500.0, 25.0),
            Self::OutwardOffset => (-300.0, 300.0, 25.0),
            Self::SidewardOffset => (-400.0, 400.0, 25.0),
            Self::LaserHeight => (50.0, 375.0, 25.0),
            Self::Distance => (250.0, 1000.0, 50.0),
            Self::View => (40.0, 120.0, 5.0),
            Self::Tilt => (-16.0, 16.0, 2.0),
        }
    }

    /// The mount with this quantity set.
    #[must_use]
    pub fn set(self, base: &Mount, value: f64) -> Mount {
        let mut mount = *base;
        match self {
            Self::VerticalOffset => mount.camera_mm[2] = base.laser_mm[2] + value,
            Self::OutwardOffset => mount.camera_mm[1] = base.laser_mm[1] + value,
            Self::SidewardOffset => mount.camera_mm[0] = base.laser_mm[0] + value,
            Self::LaserHeight => mount.laser_mm[2] = value,
            Self::Distance => mount.distance_mm = value,
            Self::View => mount.view_degrees = value,
            Self::Tilt => mount.tilt_degrees = value,
        }
        mount
    }
}

/// One mount of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Point {
    /// Of the quantity.
    pub value: f64,
    /// What the mount resolves.
    pub measures: Measures,
}

/// A sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sweep {
    /// What was varied.
    pub quantity: Quantity,
    /// In rising order.
    pub points: Vec<Point>,
}

impl Sweep {
    /// Greatest over least rows per millimetre in the stripe's middle: 1 = the quantity does not matter.
    #[must_use]
    pub fn influence(&self) -> f64 {
        let rows = self.points.iter().map(|point| point.measures.middle_rows_per_mm);
        let (least, greatest) =
            rows.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), rows| (low.min(rows), high.max(rows)));
        greatest / least
    }
}

/// Varies one quantity of a mount.
#[must_use]
pub fn sweep(base: &Mount, quantity: Quantity) -> Sweep {
    let (from, to, step) = quantity.range();
    let mut points = Vec::new();
    let mut value = from;
    while value <= to {
        let mount = quantity.set(base, value);
        points.push(Point { value, measures: measure(&mount) });
        value += step;
    }
    Sweep { quantity, points }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The source paper (camera placement): the vertical offset between camera and laser is what counts, a camera on the laser's
    /// own height resolves nothing.
    #[test]
    fn without_a_vertical_offset_nothing_is_resolved_and_more_of_it_resolves_more() {
        let found = sweep(&Mount::PAPER, Quantity::VerticalOffset);
        let rows: Vec<f64> = found.points.iter().map(|point| point.measures.middle_rows_per_mm).collect();
        assert!(rows[0] < 0.5 && rows.is_sorted(), "{rows:?}");
        assert!(found.influence() > 5.0, "{}", found.influence());
    }

    /// The paper finds no influence of moving the camera along y, with its direction kept. With the camera aimed at the stripe, as
    /// here, and exactly, there is one: nearer to the stripe it sees it from more above. Far less than the vertical's per millimetre
    /// at small offsets, and along the edge there is almost none.
    #[test]
    fn moving_the_camera_along_the_edge_hardly_matters() {
        let sideward = sweep(&Mount::PAPER, Quantity::SidewardOffset);
        let near = |limit: f64| {
            let mut part = sideward.clone();
            part.points.retain(|point| point.value.abs() <= limit);
            part.influence()
        };
        assert!(near(100.0) < 1.1, "{}", near(100.0));
    }

    #[test]
    fn every_sweep_rises_and_resolves_something() {
        for quantity in Quantity::ALL {
            let found = sweep(&Mount::PAPER, quantity);
            assert!(found.points.len() > 10, "{quantity:?}");
            assert!(found.points.is_sorted_by(|a, b| a.value < b.value));
            assert!(
                found.points.iter().all(|point| point.measures.middle_rows_per_mm > 0.05),
                "{quantity:?}"
            );
        }
    }
}
