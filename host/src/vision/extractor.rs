//! One frame in, one reading per image column out.

use nearfield_shared::columns::GeometryError;
use nearfield_shared::limits::WEAKEST_SIGNAL;
use nearfield_shared::monitor::ColumnReading;
use nearfield_shared::rig::{ImageSize, Rig};
use nearfield_shared::units::SignalQuality;

use super::floor::{FloorFinder, SURE_CONTRAST};
use super::grid::{Grid, LASER_SHEET_MM, PictureGeometry, picture_geometry};
use super::raised::RaisedFinder;
use super::signal::{Brightness, RedChroma, RedMinusGreen, RowSearch};
use crate::capture::FrameView;

/// A point of the stripe off the floor, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffFloorPoint {
    /// Image column of its first sample.
    pub column: usize,
    /// Row, pixels.
    pub row: f32,
    /// Height over the floor, millimetres (negative: below it).
    pub height: f32,
    /// Place of its laser ray on the floor, millimetres.
    pub place: f32,
    /// How well it is seen.
    pub quality: SignalQuality,
    /// Points with the same number form one line.
    pub line: u32,
}

/// Points off the floor in one frame, at most, for each image column.
const MOST_POINTS: usize = 4;

/// Working memory for samples of one size.
#[derive(Debug, Clone)]
struct Workshop {
    grid: Grid,
    floor: FloorFinder,
    raised: RaisedFinder,
}

impl Workshop {
    fn new(geometry: &PictureGeometry, rig: &Rig, sheet_mm: f64, step: usize) -> Self {
        let grid = Grid::new(geometry, rig, sheet_mm, step);
        Self { floor: FloorFinder::new(&grid), raised: RaisedFinder::new(&grid, geometry), grid }
    }
}

/// Finds the laser's stripe in frames of one rig. Made once; a frame costs no allocation.
#[derive(Debug, Clone)]
pub struct Extractor {
    size: ImageSize,
    geometry: Box<PictureGeometry>,
    pixels: Workshop,
    chroma: Workshop,
    readings: Vec<ColumnReading>,
    points: Vec<OffFloorPoint>,
}

/// The frame is not of the rig's size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a frame of {columns} x {rows} samples does not belong to a rig of {} x {} pixels", rig.width, rig.height)]
pub struct ForeignFrame {
    columns: usize,
    rows: usize,
    rig: ImageSize,
}

impl Extractor {
    /// Prepares for a rig.
    ///
    /// # Errors
    /// [`GeometryError`] if the rig's picture does not resolve the stripe.
    pub fn new(rig: &Rig) -> Result<Self, GeometryError> {
        Self::with_sheet(rig, LASER_SHEET_MM)
    }

    /// Prepares for a rig whose light is not a laser's: a red LED behind a slit gives a wide, dim band. `sheet_mm` is the
    /// thickness of its sheet at half of its brightness, millimetres.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_sheet(rig: &Rig, sheet_mm: f64) -> Result<Self, GeometryError> {
        let geometry = picture_geometry(rig)?;
        let (pixels, chroma) =
            (Workshop::new(&geometry, rig, sheet_mm, 1), Workshop::new(&geometry, rig, sheet_mm, 2));
        let width = usize::from(rig.image().width);
        let readings = vec![ColumnReading::MISSING; width];
        Ok(Self {
            size: rig.image(),
            geometry,
            pixels,
            chroma,
            readings,
            points: Vec::with_capacity(MOST_POINTS * width),
        })
    }

    /// For frames that follow one another, with the laser dimmed by the safety controller's code in between: what that tells
    /// of the ground is subtracted where the edge of a paint hides the stripe. It helps on a floor that stands still.
    #[must_use]
    pub fn with_background_subtraction(mut self) -> Self {
        self.pixels.floor.subtract_backgrounds();
        self.chroma.floor.subtract_backgrounds();
        self
    }

    /// Forgets all frames before the next one.
    pub fn forget(&mut self) {
        self.clear();
        self.pixels.floor.forget();
        self.chroma.floor.forget();
    }

    /// The maps of all image columns.
    #[must_use]
    pub fn geometry(&self) -> &PictureGeometry {
        &self.geometry
    }

    /// Forgets the last frame: nothing is seen.
    pub fn clear(&mut self) {
        self.readings.fill(ColumnReading::MISSING);
        self.points.clear();
    }

    /// Looks at one frame; [`Self::readings`] and [`Self::points`] then tell what was found.
    ///
    /// # Errors
    /// [`ForeignFrame`] if the frame is not of the rig's size; all readings are then missing.
    pub fn extract(&mut self, frame: &FrameView<'_>) -> Result<(), ForeignFrame> {
        self.clear();
        match frame {
            FrameView::Rgb(plane) => self.extract_from(RedMinusGreen(*plane)),
            FrameView::Grey(plane) => self.extract_from(Brightness(*plane)),
            FrameView::Yuv420 { luma, red, .. } => {
                self.extract_from(RedChroma::<1, 0> { red: *red, luma: *luma })
            }
            FrameView::Nv12 { luma, chroma } => {
                self.extract_from(RedChroma::<2, 1> { red: *chroma, luma: *luma })
            }
        }
    }

    fn extract_from<S: RowSearch>(&mut self, signal: S) -> Result<(), ForeignFrame> {
        let (width, height) = (usize::from(self.size.width), usize::from(self.size.height));
        if (signal.columns(), signal.rows()) != (width / S::STEP, height / S::STEP) {
            return Err(ForeignFrame { columns: signal.columns(), rows: signal.rows(), rig: self.size });
        }
        let Workshop { grid, floor, raised } = if S::STEP == 1 { &mut self.pixels } else { &mut self.chroma };
        floor.find(signal, grid);
        raised.find(signal, grid, &self.geometry, floor);
        for (index, (column, place)) in floor.columns().iter().zip(grid.columns()).enumerate() {
            if column.lit && !raised.is_claimed(place.place) {
                // Within a sample the stripe runs parallel to the floor's.
                let offset = (column.row - place.floor_row) * S::STEP as f32;
                let quality = quality_of(column.significance());
                for image_column in grid.image_column(index)..grid.image_column(index) + S::STEP {
                    if let Some(map) = self.geometry.map(image_column) {
                        self.readings[image_column] = ColumnReading { row: map.floor_row + offset, quality };
                    }
                }
            }
        }
        for point in raised.points() {
            let (column, row) = (grid.image_column(point.column), grid.to_pixels(point.row));
            let quality = quality_of(point.significance);
            // Room for so many; a clone's vector has none of its own at first.
            if self.points.len() < MOST_POINTS * width {
                let (height, place) = (point.height, point.place);
                self.points.push(OffFloorPoint { column, row, height, place, quality, line: point.line });
            }
            let lit = floor.columns()[point.column].lit;
            if !lit || raised.is_claimed(grid.columns()[point.column].place) {
                for image_column in column..column + S::STEP {
                    raise_reading(&self.geometry, &mut self.readings, image_column, row, quality);
                }
            }
        }
        Ok(())
    }

    /// One reading per image column: the floor's stripe where it is lit, else the stripe off the floor, else missing.
    #[must_use]
    pub fn readings(&self) -> &[ColumnReading] {
        &self.readings
    }

    /// The stripe off the floor, also in columns in which the floor is lit elsewhere.
    #[must_use]
    pub fn points(&self) -> &[OffFloorPoint] {
        &self.points
    }
}

/// Of several points in one column the one farthest from the floor is told.
fn raise_reading(
    geometry: &PictureGeometry,
    readings: &mut [ColumnReading],
    column: usize,
    row: f32,
    quality: SignalQuality,
) {
    let (Some(map), Some(reading)) = (geometry.map(column), readings.get_mut(column)) else { return };
    let farther = reading.row.is_nan() || (row - map.floor_row).abs() > (reading.row - map.floor_row).abs();
    if farther {
        *reading = ColumnReading { row, quality };
    }
}

/// The quality scale: [`WEAKEST_SIGNAL`] is the least contrast that is sure, and 255 is ten times that.
fn quality_of(significance: f32) -> SignalQuality {
    let weakest = f32::from(WEAKEST_SIGNAL.get());
    SignalQuality::new((weakest * significance / SURE_CONTRAST).max(weakest) as u8)
}
