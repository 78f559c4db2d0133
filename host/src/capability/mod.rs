//! The smallest object that a rig detects, at each place along the stripe.
//!
//! Not a formula but a trial: the clean floor's readings, from a picture where there is one, are given to the same
//! monitor that decides on the safety controller, with an object of a trial width or height put into them, and the
//! smallest one that trips in every position relative to the columns is told. What goes in is physics: how many
//! millimetres a column covers, how far the lens blurs an object's edges over its neighbours, how noisy and how far
//! off the floor the stripe reads, and where it is not seen at all.
//!
//! Both limits are conservative. The width is that of something flat and dark; an upright object casts a shadow longer
//! than itself in the sheet of light. The height is that of something wide.

pub mod plot;

use nearfield_shared::columns::{Decimation, GeometryError};
use nearfield_shared::limits::{FLOOR_TOLERANCE, VOTE_FRAMES, WEAKEST_SIGNAL};
use nearfield_shared::monitor::{ColumnReading, StripeMonitor};
use nearfield_shared::rig::Rig;
use nearfield_shared::units::SignalQuality;
use serde::Serialize;

use crate::vision::grid::MOST_COLUMNS;

/// Places along the stripe at which the rig is tried.
const PLACES: usize = 41;
/// An object is tried in this many positions relative to the columns.
const POSITIONS: usize = 4;
/// Widths and heights are told to this, millimetres.
const STEP_MM: f64 = 0.25;
/// Nothing larger than this is tried, millimetres.
const LARGEST_MM: f64 = 60.0;
/// An edge is blurred over this many columns: the floor's stripe shows that far into a dark object. From pictures of
/// the twin, and the same for sharp lenses.
const EDGE_COLUMNS: f64 = 1.0;
/// Noise of a row where no picture tells it, pixels.
const NOMINAL_NOISE: f64 = 0.15;
/// Readings stray from their mean by no more than this many sigmas.
const SIGMAS: f64 = 3.0;
/// The floor around a place, for its noise, millimetres to either side.
const NEIGHBOURHOOD_MM: f32 = 15.0;
/// The trial object near the stripe's ends would be cut off by them.
const END_MARGIN_MM: f64 = 8.0;

/// What the rig can detect at one place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlaceCapability {
    /// Along the stripe, millimetres.
    pub place_mm: f64,
    /// Millimetres of stripe to an image column.
    pub millimetres_per_column: f64,
    /// Rows that the stripe moves for a millimetre of height.
    pub rows_per_millimetre: f64,
    /// Noise of the stripe's row, one sigma, pixels.
    pub row_noise: f64,
    /// How far off the floor the stripe reads here, millimetres.
    pub floor_offset_mm: f64,
    /// Share of the columns around in which the floor's stripe is seen.
    pub seen: f64,
    /// Smallest width along the stripe that trips, millimetres; `None` if the clean floor trips by itself, or nothing
    /// within 60 mm does.
    pub smallest_width_mm: Option<f64>,
    /// Smallest height that trips, millimetres.
    pub smallest_height_mm: Option<f64>,
}

impl PlaceCapability {
    /// Is an object of this width and height detected here?
    #[must_use]
    pub fn detects(&self, object_mm: f64) -> bool {
        let within = |limit: Option<f64>| limit.is_some_and(|limit| limit <= object_mm);
        within(self.smallest_width_mm) && within(self.smallest_height_mm)
    }
}

/// A rig's capability along the stripe.
#[derive(Debug, Clone, Serialize)]
pub struct Capability {
    /// Along the stripe.
    pub places: Vec<PlaceCapability>,
    /// Does the clean floor trip without any object?
    pub floor_trips: bool,
}

impl Capability {
    /// Is an object of this width and height detected everywhere, on a floor that does not trip by itself?
    #[must_use]
    pub fn detects_everywhere(&self, object_mm: f64) -> bool {
        !self.floor_trips && self.places.iter().all(|place| place.detects(object_mm))
    }
}

/// Tries a rig. `clean` are the readings of a clean floor, one per image column ([`crate::vision::Extractor`]); without
/// them a floor that is seen well everywhere is assumed.
///
/// # Errors
/// [`GeometryError`] if the rig's picture does not resolve the stripe.
pub fn measure(rig: &Rig, clean: Option<&[ColumnReading]>) -> Result<Capability, GeometryError> {
    let mut trial = Trial::new(rig, clean)?;
    let stripe = rig.stripe();
    let (start, end) = (stripe.start + END_MARGIN_MM, stripe.end - END_MARGIN_MM);
    let floor_trips = trial.trips(|_, reading| reading);
    let places = (0..PLACES).map(|index| {
        let share = index as f64 / (PLACES - 1) as f64;
        trial.place(start * (1.0 - share) + end * share, floor_trips)
    });
    Ok(Capability { places: places.collect(), floor_trips })
}

/// The monitor, and the floor that it is tried on.
struct Trial {
    monitor: Box<StripeMonitor<MOST_COLUMNS>>,
    floor: Vec<ColumnReading>,
    is_measured: bool,
}

/// The floor around a place.
struct Surroundings {
    pitch: f64,
    rows_per_millimetre: f64,
    noise: f64,
    offset_mm: f64,
    seen: f64,
}

impl Trial {
    fn new(rig: &Rig, clean: Option<&[ColumnReading]>) -> Result<Self, GeometryError> {
        let mut monitor = Box::new(StripeMonitor::new());
        monitor.configure(rig, Decimation::none(rig.image().width))?;
        let mut floor = vec![ColumnReading::MISSING; usize::from(rig.image().width)];
        match clean {
            Some(readings) => {
                for (to, from) in floor.iter_mut().zip(readings) {
                    *to = *from;
                }
            }
            None => {
                let geometry = monitor.geometry();
                for (column, map) in geometry.watched().zip(geometry.maps()) {
                    floor[column] = ColumnReading { row: map.floor_row, quality: SignalQuality::new(200) };
                }
            }
        }
        Ok(Self { monitor, floor, is_measured: clean.is_some() })
    }

    /// Does the floor trip with its readings changed by `change`, which is given each watched column's index?
    fn trips(&mut self, change: impl Fn(usize, ColumnReading) -> ColumnReading) -> bool {
        self.monitor.reset();
        let first = self.monitor.geometry().watched().start;
        let mut is_cut = false;
        for _ in 0..VOTE_FRAMES {
            let readings = self.floor.iter().enumerate().map(|(column, reading)| {
                column.checked_sub(first).map_or(*reading, |index| change(index, *reading))
            });
            is_cut = self.monitor.update(readings).is_cut();
        }
        is_cut
    }

    fn place(&mut self, place: f64, floor_trips: bool) -> PlaceCapability {
        let around = self.surroundings(place);
        let blur = EDGE_COLUMNS * around.pitch;
        let smallest_width_mm = smallest(floor_trips, |width| {
            (0..POSITIONS).all(|position| {
                let middle = place + around.pitch * position as f64 / POSITIONS as f64;
                self.trips_with(middle, width - 2.0 * blur, |_, _| ColumnReading::MISSING)
            })
        });
        let stray = SIGMAS * around.noise / around.rows_per_millimetre + around.offset_mm.abs();
        let smallest_height_mm = smallest(floor_trips, |height| {
            // All readings stray towards the floor: the worst that noise and an uneven floor do.
            let least = (height - stray) as f32;
            self.trips_with(place, LARGEST_MM / 2.0, |map_row, reading| ColumnReading {
                row: map_row(least),
                quality: reading.quality.max(WEAKEST_SIGNAL),
            })
        });
        PlaceCapability {
            place_mm: place,
            millimetres_per_column: around.pitch,
            rows_per_millimetre: around.rows_per_millimetre,
            row_noise: around.noise,
            floor_offset_mm: around.offset_mm,
            seen: around.seen,
            smallest_width_mm,
            smallest_height_mm,
        }
    }

    /// Does an object trip whose readings over `width` millimetres around `middle` are made by `object` (from the row
    /// of a height in that column, and the floor's reading)?
    fn trips_with(
        &mut self,
        middle: f64,
        width: f64,
        object: impl Fn(&dyn Fn(f32) -> f32, ColumnReading) -> ColumnReading,
    ) -> bool {
        if width <= 0.0 {
            return false;
        }
        let maps = self.monitor.geometry().maps().to_vec();
        self.trips(|index, reading| match maps.get(index) {
            Some(map) if (f64::from(map.floor_place) - middle).abs() <= width / 2.0 => {
                object(&|height| map.row(height), reading)
            }
            _ => reading,
        })
    }

    fn surroundings(&self, place: f64) -> Surroundings {
        let geometry = self.monitor.geometry();
        let near = |map_place: f32| (map_place - place as f32).abs() <= NEIGHBOURHOOD_MM;
        let (mut residuals, mut count, mut slopes, mut ends) =
            (Vec::new(), 0_usize, 0.0_f64, [f64::INFINITY, f64::NEG_INFINITY]);
        for (map, reading) in geometry.maps().iter().zip(self.floor.get(geometry.watched()).unwrap_or(&[])) {
            if !near(map.floor_place) {
                continue;
            }
            count += 1;
            slopes += 1.0 / f64::from(map.height_per_row.abs());
            ends = [ends[0].min(f64::from(map.floor_place)), ends[1].max(f64::from(map.floor_place))];
            let is_floor = map.height(reading.row).abs() <= FLOOR_TOLERANCE.get();
            if reading.quality >= WEAKEST_SIGNAL && is_floor {
                residuals.push((f64::from(reading.row - map.floor_row), f64::from(map.height_per_row)));
            }
        }
        let columns = count.max(1) as f64;
        let rows_per_millimetre = slopes / columns;
        let seen = residuals.len() as f64 / columns;
        let median = |values: &mut Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied()
        };
        let middle = median(&mut residuals.iter().map(|residual| residual.0).collect()).unwrap_or(0.0);
        let spread = median(&mut residuals.iter().map(|residual| (residual.0 - middle).abs()).collect());
        let noise = if self.is_measured { spread.unwrap_or(0.0) / 0.6745 } else { NOMINAL_NOISE };
        let per_row = residuals.first().map_or(0.0, |residual| residual.1);
        Surroundings {
            pitch: (ends[1] - ends[0]).max(0.0) / (columns - 1.0).max(1.0),
            rows_per_millimetre,
            noise,
            offset_mm: middle * per_row,
            seen,
        }
    }
}

/// The smallest size for which `trips` holds, by halving; `None` if the largest does not trip, or the floor does.
fn smallest(floor_trips: bool, mut trips: impl FnMut(f64) -> bool) -> Option<f64> {
    let largest = (LARGEST_MM / STEP_MM) as u32;
    if floor_trips || !trips(LARGEST_MM) {
        return None;
    }
    let (mut no, mut yes) = (0_u32, largest);
    while yes - no > 1 {
        let middle = u32::midpoint(no, yes);
        if trips(f64::from(middle) * STEP_MM) {
            yes = middle;
        } else {
            no = middle;
        }
    }
    Some(f64::from(yes) * STEP_MM)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery::{CENTRE, SIDE};

    /// The rule: coarser columns need larger objects; the limit of 5 mm and both blurred edges bound it.
    #[test]
    fn the_smallest_width_follows_from_the_columns() {
        for mounting in [CENTRE, CENTRE.with_width(2304), SIDE] {
            let capability = measure(&mounting.rig().unwrap(), None).unwrap();
            assert!(!capability.floor_trips);
            for place in &capability.places {
                let width = place.smallest_width_mm.unwrap();
                let pitch = place.millimetres_per_column;
                assert!(width > 5.0 - 2.0 * pitch && width < 5.0 + 4.0 * pitch, "{place:?}");
                assert!(place.smallest_height_mm.unwrap() > 1.8, "{place:?}");
            }
        }
    }

    /// The rule: where the stripe is not seen, nothing can be promised.
    #[test]
    fn a_floor_that_trips_by_itself_detects_nothing() {
        let rig = CENTRE.rig().unwrap();
        let dark = vec![ColumnReading::MISSING; 1152];
        let capability = measure(&rig, Some(&dark)).unwrap();
        assert!(capability.floor_trips && !capability.detects_everywhere(60.0));
        assert!(capability.places.iter().all(|place| place.seen == 0.0 && place.smallest_width_mm.is_none()));
    }
}
