//! Where in the picture the laser's sheet can be seen: the extraction's map, one entry per column of samples.

use nearfield_shared::camera::Vector;
use nearfield_shared::columns::{ColumnMap, Decimation, GeometryError, StripeGeometry};
use nearfield_shared::limits::{DEEPEST_MAPPED, FLOOR_TOLERANCE, HIGHEST_MAPPED, LARGEST_IMAGE_WIDTH};
use nearfield_shared::rig::Rig;

use super::signal::SEGMENT_ROWS;

/// Room for the image's columns.
pub const MOST_COLUMNS: usize = LARGEST_IMAGE_WIDTH as usize;

/// The column maps of a whole picture, not decimated.
pub type PictureGeometry = StripeGeometry<MOST_COLUMNS>;

/// What one column of samples can see of the sheet. Rows are rows of samples.
#[derive(Debug, Clone, Copy)]
pub struct GridColumn {
    /// Row of the stripe on the floor.
    pub floor_row: f32,
    /// The whole row nearest to it.
    pub nearest_row: isize,
    /// Place of that point along the stripe, millimetres.
    pub place: f32,
    /// Rows that the stripe may be off and still be floor.
    pub tolerance: f32,
    /// Rows that the stripe on the floor takes at half of its height, as far as the rig tells.
    pub width: f32,
    /// First row that shows heights within the mapped range.
    pub first_row: u16,
    /// One past the last such row.
    pub end_row: u16,
}

/// The columns of samples that watch the stripe, for samples of `step` x `step` pixels.
#[derive(Debug, Clone)]
pub struct Grid {
    step: usize,
    first: usize,
    columns: Vec<GridColumn>,
    /// For every segment of rows, the watched columns (indices into `columns`) that it concerns.
    segments: Vec<std::ops::Range<usize>>,
}

impl Grid {
    /// Computes the grid; once per rig, sheet of light (its thickness at half of its brightness, millimetres) and sample
    /// size.
    #[must_use]
    pub fn new(geometry: &PictureGeometry, rig: &Rig, sheet_mm: f64, step: usize) -> Self {
        let watched = geometry.watched();
        let rows = usize::from(rig.image().height) / step;
        // A sample of which only a part watches the stripe sees it all the same.
        let end = watched.end.div_ceil(step).min(usize::from(rig.image().width) / step);
        let first = watched.start / step;
        let columns: Vec<GridColumn> = (first..end.max(first))
            .filter_map(|column| {
                let inside = [column * step, column * step + step - 1]
                    .map(|column| column.clamp(watched.start, watched.end.saturating_sub(1)));
                let maps = [geometry.map(inside[0])?, geometry.map(inside[1])?];
                let width = stripe_width(rig, sheet_mm, f64::from(maps[0].floor_place), step);
                Some(GridColumn::new(maps, width, step, rows))
            })
            .collect();
        let mut segments = vec![0..0; rows.div_ceil(SEGMENT_ROWS)];
        for (index, column) in columns.iter().enumerate() {
            let (from, to) = (usize::from(column.first_row), usize::from(column.end_row));
            for range in segments.iter_mut().take(to.div_ceil(SEGMENT_ROWS)).skip(from / SEGMENT_ROWS) {
                *range = if range.end == 0 { index..index + 1 } else { range.start..index + 1 };
            }
        }
        Self { step, first, columns, segments }
    }

    /// Column of samples of the first entry.
    #[must_use]
    pub const fn first(&self) -> usize {
        self.first
    }

    /// The entries.
    #[must_use]
    pub fn columns(&self) -> &[GridColumn] {
        &self.columns
    }

    /// For every [`SEGMENT_ROWS`] rows of samples, the entries that they concern.
    #[must_use]
    pub fn segments(&self) -> &[std::ops::Range<usize>] {
        &self.segments
    }

    /// Image columns per entry.
    #[must_use]
    pub const fn step(&self) -> usize {
        self.step
    }

    /// The first image column of an entry.
    #[must_use]
    pub const fn image_column(&self, index: usize) -> usize {
        (self.first + index) * self.step
    }

    /// A row of samples in pixels.
    #[must_use]
    pub fn to_pixels(&self, row: f32) -> f32 {
        let step = self.step as f32;
        row * step + (step - 1.0) / 2.0
    }
}

impl GridColumn {
    /// From the maps of the entry's outer image columns (the same one for a step of 1).
    fn new(maps: [&ColumnMap; 2], width: f32, step: usize, rows: usize) -> Self {
        let scale = step as f32;
        let to_samples = |row: f32| (row - (scale - 1.0) / 2.0) / scale;
        let mean = |value: fn(&ColumnMap) -> f32| (value(maps[0]) + value(maps[1])) / 2.0;
        let floor_row = to_samples(mean(|map| map.floor_row));
        let per_row = mean(|map| map.height_per_row).abs();
        // A height that no row shows (beyond the horizon) leaves the picture's edge on that side.
        let up = maps[0].height_per_row < 0.0;
        let edge = |height: f32| {
            let row = to_samples(maps[0].row(height));
            match (row.is_nan(), (height > 0.0) == up) {
                (false, _) => row.clamp(0.0, rows as f32),
                (true, true) => 0.0,
                (true, false) => rows as f32,
            }
        };
        let edges = [edge(DEEPEST_MAPPED.get()), edge(HIGHEST_MAPPED.get())];
        Self {
            floor_row,
            nearest_row: floor_row.round() as isize,
            place: mean(|map| map.floor_place),
            tolerance: FLOOR_TOLERANCE.get() / per_row / scale,
            width,
            first_row: edges[0].min(edges[1]).floor() as u16,
            end_row: edges[0].max(edges[1]).ceil() as u16,
        }
    }
}

/// Thickness of the laser's sheet at half of its brightness, millimetres: line lasers of a few milliwatts in focus.
pub const LASER_SHEET_MM: f64 = 1.0;
/// What lens, sensor and processor add, pixels.
const BLUR_PIXELS: f64 = 2.5;

/// Rows of samples that the stripe takes at the floor's place `s`, at half of its height.
fn stripe_width(rig: &Rig, sheet_mm: f64, s: f64, step: usize) -> f32 {
    let (stripe, sheet) = (rig.stripe(), rig.laser().normal);
    let along = stripe.direction;
    let across = Vector::new(-along.y, along.x, 0.0);
    let [here, beside, ahead] = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
        .map(|(out, on)| rig.camera().project(stripe.at(s + on).plus(across.scaled(out))));
    let rows_per_mm = match (here, beside, ahead) {
        (Some(here), Some(beside), Some(ahead)) => {
            // Rows between the stripe's middle and a line beside it, in one column.
            let slope = (ahead.v - here.v) / (ahead.u - here.u);
            (beside.v - here.v - slope * (beside.u - here.u)).abs()
        }
        _ => 0.0,
    };
    let on_floor = sheet_mm / sheet.dot(across).abs().max(0.05);
    let pixels = (on_floor * rows_per_mm).hypot(BLUR_PIXELS);
    (pixels / step as f64) as f32
}

/// The maps of a rig's whole picture, on the heap.
///
/// # Errors
/// See [`GeometryError`].
pub fn picture_geometry(rig: &Rig) -> Result<Box<PictureGeometry>, GeometryError> {
    let mut geometry = Box::new(PictureGeometry::empty());
    geometry.fill(rig, Decimation::none(rig.image().width))?;
    Ok(geometry)
}
