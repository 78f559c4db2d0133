//! From line-scans to what a robot's navigation takes: where something is, and how high.
//!
//! What counts as a cut is the controller's own tier 1, on the same bytes ([`nearfield_shared::cutoff`]): the vote over three
//! pictures, and at once what is longer than [`IMMEDIATE_GAP`]. A lost picture votes as one without any stripe.
//!
//! **Unknown is never free.** nav2's collision monitor and costmaps skip what is not a number, and what is out of range: NaN would
//! read as free floor. So a beam says "free" (infinite) only where the stripe on the floor was seen, and stands at the stripe, as
//! an obstacle, where it was not.

use nearfield_shared::cutoff::{CutoffDetector, Gap, is_floor};
use nearfield_shared::limits::{IMMEDIATE_GAP, LARGEST_COLUMN_COUNT};
use nearfield_shared::linescan::LineScan;
use nearfield_shared::rig::Rig;

use crate::floor::{Floor, FloorError, Point};
use crate::messages::{Header, LaserScan, PointCloud2, PointField};

/// Ranges start here, metres: what seems nearer is put here.
pub const RANGE_MIN: f64 = 0.01;
/// Bytes of a point of the cloud.
pub const POINT_STEP: u32 = 16;

/// See the module's documentation.
#[derive(Debug, Clone)]
pub struct Observer {
    floor: Floor,
    detector: Box<CutoffDetector<LARGEST_COLUMN_COUNT>>,
    /// Of each watched column: height, millimetres (NaN = no stripe); how well it is seen; is it within a cut?
    heights: Vec<f32>,
    qualities: Vec<u8>,
    cut: Vec<bool>,
    range_max: f64,
    scan_time: f32,
}

impl Observer {
    /// For a rig, with so many seconds from picture to picture. Before the first pictures everything is cut.
    ///
    /// # Errors
    /// The rig has no scan: see [`FloorError`].
    pub fn new(rig: &Rig, scan_time: f32) -> Result<Self, FloorError> {
        let floor = Floor::new(rig)?;
        let count = floor.geometry().maps().len();
        // A little farther than the stripe: what lies at it is within.
        let range_max = floor.farthest() * 1.05;
        Ok(Self {
            floor,
            detector: Box::new(CutoffDetector::new()),
            heights: vec![f32::NAN; count],
            qualities: vec![0; count],
            cut: vec![true; count],
            range_max,
            scan_time,
        })
    }

    /// A picture's line-scan.
    pub fn see(&mut self, scan: &LineScan<'_>) {
        let geometry = self.floor.geometry();
        for ((height, quality), (column, map)) in
            self.heights.iter_mut().zip(&mut self.qualities).zip(geometry.watched().zip(geometry.maps()))
        {
            let seen = scan.column(u16::try_from(column).unwrap_or(u16::MAX));
            *height = seen.row.to_pixels().map_or(f32::NAN, |row| map.height(row));
            *quality = seen.quality.get();
        }
        self.judge(true);
    }

    /// A frame period without a line-scan.
    pub fn miss(&mut self) {
        self.heights.fill(f32::NAN);
        self.qualities.fill(0);
        self.judge(false);
    }

    /// Nothing is known any more: everything is cut until pictures have come again.
    pub fn forget(&mut self) {
        self.detector.reset();
        self.heights.fill(f32::NAN);
        self.qualities.fill(0);
        self.cut.fill(true);
    }

    /// With or without what is too long to wait for the vote.
    fn judge(&mut self, at_once: bool) {
        self.cut.fill(false);
        let geometry = self.floor.geometry();
        let cut = &mut self.cut;
        let mut mark = |gap: Gap| {
            let within = gap.start.get()..=gap.end.get();
            for (cut, map) in cut.iter_mut().zip(geometry.maps()) {
                *cut |= within.contains(&map.floor_place);
            }
        };
        let found = self.detector.update(geometry, &self.heights, &mut mark);
        if let Some(gap) = found.single.filter(|gap| at_once && gap.length() > IMMEDIATE_GAP) {
            mark(gap);
        }
    }

    /// Is everything free?
    #[must_use]
    pub fn is_free(&self) -> bool {
        !self.cut.contains(&true)
    }

    /// The raised or lowered point that a cut column shows, if any.
    fn point(&self, index: usize) -> Option<Point> {
        let height = self.heights.get(index).copied().filter(|height| !is_floor(*height))?;
        self.floor.at_height(self.floor.geometry().maps().get(index)?, height)
    }

    /// The stripe as a scanner on the floor would see it.
    #[must_use]
    pub fn laser_scan(&self, header: Header) -> LaserScan {
        let (angle_min, increment) = self.floor.angles();
        let mut ranges = vec![f64::INFINITY; self.floor.count()];
        let maps = self.floor.geometry().maps();
        for (index, map) in maps.iter().enumerate().filter(|(index, _)| self.cut[*index]) {
            // The floor is not proven free here ...
            let on_floor = self.floor.on_floor(map).range();
            for beam in self.floor.beams(index) {
                ranges[beam] = ranges[beam].min(on_floor);
            }
            // ... and there is the body itself, nearer, if it is lit.
            if let Some(point) = self.point(index)
                && let Some(beam) = self.floor.beam_of(point)
            {
                ranges[beam] = ranges[beam].min(point.range());
            }
        }
        let bounded = |range: f64| {
            if range.is_infinite() { f32::INFINITY } else { range.clamp(RANGE_MIN, self.range_max) as f32 }
        };
        LaserScan {
            header,
            angle_min: angle_min as f32,
            angle_max: (angle_min + increment * (self.floor.count() - 1) as f64) as f32,
            angle_increment: increment as f32,
            time_increment: 0.0,
            scan_time: self.scan_time,
            range_min: RANGE_MIN as f32,
            // Rounding to f32 must not put an obstacle out of range.
            range_max: (self.range_max * 1.001) as f32,
            ranges: ranges.into_iter().map(bounded).collect(),
            intensities: Vec::new(),
        }
    }

    /// Heights: a point for every column whose stripe is seen, and for every column of a cut that shows none: there the height is
    /// not known, which counts as large, and the point stands over the stripe at the laser's height, with quality 0.
    #[must_use]
    pub fn point_cloud(&self, header: Header) -> PointCloud2 {
        let geometry = self.floor.geometry();
        let laser_height = f64::from(geometry.laser_height().get()) / 1000.0;
        let mut data = Vec::with_capacity(geometry.maps().len() * POINT_STEP as usize);
        for (index, map) in geometry.maps().iter().enumerate() {
            let height = self.heights[index];
            let measured = if height.is_nan() { None } else { self.floor.at_height(map, height) };
            let (point, quality) = match measured {
                Some(point) => (point, self.qualities[index]),
                None if self.cut[index] => (Point { z: laser_height, ..self.floor.on_floor(map) }, 0),
                None => continue,
            };
            for value in [point.x, point.y, point.z] {
                data.extend_from_slice(&(value as f32).to_le_bytes());
            }
            data.extend_from_slice(&[quality, 0, 0, 0]);
        }
        let field = |(name, offset, datatype): (&str, u32, u8)| PointField {
            name: name.to_owned(),
            offset,
            datatype,
            count: 1,
        };
        let row_step = u32::try_from(data.len()).unwrap_or(u32::MAX);
        PointCloud2 {
            header,
            height: 1,
            width: row_step / POINT_STEP,
            fields: [
                ("x", 0, PointField::FLOAT32),
                ("y", 4, PointField::FLOAT32),
                ("z", 8, PointField::FLOAT32),
                ("quality", 12, PointField::UINT8),
            ]
            .map(field)
            .into(),
            is_bigendian: false,
            point_step: POINT_STEP,
            row_step,
            data,
            is_dense: true,
        }
    }
}
