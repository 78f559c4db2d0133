//! From full-resolution readings to the columns of the line-scan, hiding nothing.
//!
//! The line-scan has room for 1152 columns; a wider picture has several image columns to one of them. If any of those
//! is missing, the column is missing; if any is off the floor, the column says so, with the one farthest from the
//! floor. Only where all show lit floor is the column their mean.

use nearfield_shared::columns::{Decimation, GeometryError, StripeGeometry};
use nearfield_shared::cutoff::is_floor;
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, WEAKEST_SIGNAL};
use nearfield_shared::linescan::LineScanColumn;
use nearfield_shared::monitor::ColumnReading;
use nearfield_shared::rig::Rig;
use nearfield_shared::units::{SignalQuality, SubpixelRow};

use nearfield_shared::status::Challenge;

use crate::capture::FrameView;
use crate::light::LightReport;
use crate::vision::grid::PictureGeometry;

/// Makes line-scan columns for one rig; owns its memory.
#[derive(Debug, Clone)]
pub struct LineScanEncoder {
    decimation: Decimation,
    geometry: Box<StripeGeometry<LARGEST_COLUMN_COUNT>>,
    columns: Vec<LineScanColumn>,
    light: LightReport,
}

impl LineScanEncoder {
    /// Prepares for a rig.
    ///
    /// # Errors
    /// [`GeometryError`] if the rig's picture does not resolve the stripe.
    pub fn new(rig: &Rig) -> Result<Self, GeometryError> {
        let decimation = Decimation::for_line_scan(rig.image().width);
        let mut geometry = Box::new(StripeGeometry::empty());
        geometry.fill(rig, decimation)?;
        let columns = vec![LineScanColumn::MISSING; usize::from(decimation.count())];
        Ok(Self { decimation, geometry, columns, light: LightReport::new() })
    }

    /// The columns for one frame's readings (one per image column), which were measured with the maps of `picture`.
    pub fn encode(&mut self, readings: &[ColumnReading], picture: &PictureGeometry) -> &[LineScanColumn] {
        let width = usize::from(self.decimation.image_columns());
        self.columns.fill(LineScanColumn::MISSING);
        for (index, (column, group)) in self.columns.iter_mut().zip(readings.chunks_exact(width)).enumerate()
        {
            let Some(map) = self.geometry.map(index) else { continue };
            let first = index * width;
            let placed = group.iter().enumerate().map(|(offset, reading)| {
                // An image column beyond the watched stretch has no map of its own: the line-scan's is next to it.
                let own = picture.map(first + offset).unwrap_or(map);
                Placed {
                    rows: reading.row - own.floor_row,
                    height: own.height(reading.row),
                    quality: reading.quality,
                }
            });
            if let Some(merged) = merge(placed) {
                *column = SubpixelRow::from_pixels(map.floor_row + merged.rows)
                    .map_or(LineScanColumn::MISSING, |row| LineScanColumn { row, quality: merged.quality });
            }
        }
        &self.columns
    }

    /// The columns of the last [`Self::encode`].
    #[must_use]
    pub fn columns(&self) -> &[LineScanColumn] {
        &self.columns
    }

    /// Measures the light of the picture that the last [`Self::encode`] was about, and answers the controller's audit.
    pub fn measure_light(&mut self, view: &FrameView<'_>, challenge: &Challenge) -> &LightReport {
        let geometry = &self.geometry;
        let floor_row = |column| geometry.map(column).map(|map| map.floor_row);
        self.light.measure(view, &self.columns, self.decimation, challenge, floor_row);
        &self.light
    }

    /// The light of the last [`Self::measure_light`].
    #[must_use]
    pub const fn light(&self) -> &LightReport {
        &self.light
    }

    /// Image columns to one column.
    #[must_use]
    pub const fn decimation(&self) -> Decimation {
        self.decimation
    }
}

/// A reading relative to its own column's floor.
#[derive(Debug, Clone, Copy)]
struct Placed {
    /// Rows from the floor's.
    rows: f32,
    /// Height over the floor, millimetres.
    height: f32,
    quality: SignalQuality,
}

/// One for all; `None` as soon as one is missing or too weak to be trusted.
fn merge(readings: impl Iterator<Item = Placed>) -> Option<Placed> {
    let mut merged: Option<Placed> = None;
    let (mut sum, mut count) = (0.0, 0.0);
    for reading in readings {
        if reading.quality < WEAKEST_SIGNAL || reading.height.is_nan() {
            return None;
        }
        (sum, count) = (sum + reading.rows, count + 1.0);
        merged = Some(match merged {
            None => reading,
            Some(before) => {
                let farthest = if reading.height.abs() > before.height.abs() { reading } else { before };
                Placed { quality: before.quality.min(reading.quality), ..farthest }
            }
        });
    }
    // Farthest is floor: all are, and their mean is the better measurement.
    merged.map(|merged| if is_floor(merged.height) { Placed { rows: sum / count, ..merged } } else { merged })
}
