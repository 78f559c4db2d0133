//! The sensor's own health: the floor stripe as a reference.
//!
//! The stripe is cut into [`SEGMENTS`]. In each, the columns that show floor tell where the floor lies (it should lie
//! at 0), and how much their heights scatter. Means over about 50 pictures (1 s at 50 a second) give
//!
//! * the floor's **offset**: beyond [`LARGEST_FLOOR_OFFSET`] somewhere the mount was knocked, bent or never calibrated;
//! * the **lowest object that is surely seen** in each segment: the floor's tolerance, the offset and three standard
//!   deviations together. Where that exceeds [`CONFIGURED_OBJECT_HEIGHT`], dirt, fading light or misfocus have taken
//!   too much of the sensor's capability.
//!
//! Both stop; from a smaller bound on they warn and reduce the permitted speed. Columns that see nothing are no matter
//! for this module: unknown is never floor, and a gap of them stops by itself.

use nearfield_shared::columns::ColumnMap;
use nearfield_shared::condition::HealthFigures;
use nearfield_shared::cutoff::is_floor;
use nearfield_shared::limits::{
    CONFIGURED_OBJECT_HEIGHT, FLOOR_TOLERANCE, LARGEST_FLOOR_OFFSET, REDUCED_SPEED_PERCENT,
    WARNING_FLOOR_OFFSET, WARNING_OBJECT_HEIGHT,
};
use nearfield_shared::units::Millimetres;

/// Parts of the stripe that are judged apart.
pub const SEGMENTS: usize = 16;
/// Segments that one line-scan updates: a quarter, so that the work is spread.
const SEGMENTS_AT_ONCE: usize = 4;
/// Weight of a new value in a segment's mean: every fourth picture, so about 12 x 4 = 50 pictures.
const WEIGHT: f32 = 1.0 / 12.0;
/// A segment whose columns show less floor than this (an object, a reflection) is left as it is.
const LEAST_FLOOR_SHARE: f32 = 0.5;
/// Values that a segment needs before it is judged: half a second.
const FEWEST_VALUES: u8 = 6;

/// One part of the stripe.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Segment {
    /// Mean height of its floor, millimetres.
    offset: f32,
    /// Mean square of the heights about their mean.
    variance: f32,
    /// Stripe coordinate of its first column.
    place: f32,
    /// Values so far, up to [`FEWEST_VALUES`].
    values: u8,
}

impl Segment {
    const UNSEEN: Self = Self { offset: 0.0, variance: 0.0, place: 0.0, values: 0 };

    fn update(&mut self, heights: &[f32]) {
        let (mut sum, mut squares, mut floor, mut all) = (0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
        for height in heights {
            all += 1.0;
            if is_floor(*height) {
                floor += 1.0;
                sum += *height;
                squares += *height * *height;
            }
        }
        if floor < LEAST_FLOOR_SHARE * all || floor == 0.0 {
            return;
        }
        let mean = sum / floor;
        let variance = (squares / floor - mean * mean).max(0.0);
        let weight = if self.values == 0 { 1.0 } else { WEIGHT };
        self.offset += weight * (mean - self.offset);
        self.variance += weight * (variance - self.variance);
        self.values = self.values.saturating_add(1).min(FEWEST_VALUES);
    }

    fn is_judged(&self) -> bool {
        self.values >= FEWEST_VALUES
    }

    /// The lowest object that is surely told from floor here, millimetres: three standard deviations by comparing
    /// squares would need no root, but people are to read it.
    fn smallest_object(&self) -> f32 {
        FLOOR_TOLERANCE.get() + self.offset.abs() + 3.0 * square_root(self.variance)
    }
}

/// Newton's square root, to one part in 100 for variances from 0.0001 to 4; no library call on the
/// controller.
fn square_root(value: f32) -> f32 {
    let mut root = 0.5 * (value + 1.0);
    for _ in 0..8 {
        root = 0.5 * (root + value / root);
    }
    root
}

/// Watches the floor; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    segments: [Segment; SEGMENTS],
    /// The quarter of the segments that is next.
    turn: u8,
}

/// What the health allows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HealthReport {
    /// The figures for the status.
    pub figures: HealthFigures,
    /// The floor lies where it should, everywhere.
    pub aligned: bool,
    /// Small objects are seen everywhere.
    pub capable: bool,
    /// The floor's offset is worth a warning.
    pub offset_warning: bool,
    /// The sight of small objects is worth a warning.
    pub visibility_warning: bool,
}

impl HealthReport {
    /// Before the first picture: nothing speaks against the sensor yet.
    pub const UNSEEN: Self = Self {
        figures: HealthFigures {
            floor_offset: Millimetres::ZERO,
            floor_rise: Millimetres::ZERO,
            smallest_object: FLOOR_TOLERANCE,
            smallest_object_place: Millimetres::ZERO,
            permitted_speed_percent: 100,
        },
        aligned: true,
        capable: true,
        offset_warning: false,
        visibility_warning: false,
    };
}

impl Health {
    /// Nothing seen yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { segments: [Segment::UNSEEN; SEGMENTS], turn: 0 }
    }

    /// What it rests on, for the check of the controller's memory.
    pub(crate) fn words(&self) -> impl Iterator<Item = u64> + '_ {
        self.segments.iter().map(|segment| {
            let figures = u64::from(segment.offset.to_bits()) << 32 | u64::from(segment.variance.to_bits());
            figures ^ u64::from(segment.values)
        })
    }

    /// A line-scan's heights in the watched columns, and these columns' maps.
    pub fn observe(&mut self, heights: &[f32], maps: &[ColumnMap]) {
        let length = heights.len() / SEGMENTS;
        if length == 0 {
            return;
        }
        let turn = usize::from(self.turn);
        self.turn = if turn >= SEGMENTS / SEGMENTS_AT_ONCE - 1 { 0 } else { self.turn.saturating_add(1) };
        let skipped = turn.saturating_mul(SEGMENTS_AT_ONCE);
        let parts = heights.chunks_exact(length).skip(skipped);
        let places = maps.chunks_exact(length).skip(skipped);
        let segments = self.segments.iter_mut().skip(skipped).take(SEGMENTS_AT_ONCE);
        for ((segment, part), maps) in segments.zip(parts).zip(places) {
            segment.update(part);
            segment.place = maps.first().map_or(0.0, |map| map.floor_place);
        }
    }

    /// What it comes to.
    #[must_use]
    pub fn report(&self) -> HealthReport {
        let (mut sum, mut count) = (0.0_f32, 0.0_f32);
        let (mut largest_offset, mut worst, mut place) = (0.0_f32, FLOOR_TOLERANCE.get(), 0.0_f32);
        let (mut first, mut last) = (None, 0.0_f32);
        for segment in self.segments.iter().filter(|segment| segment.is_judged()) {
            sum += segment.offset;
            count += 1.0;
            largest_offset = largest_offset.max(segment.offset.abs());
            let smallest = segment.smallest_object();
            if smallest > worst {
                (worst, place) = (smallest, segment.place);
            }
            first = first.or(Some(segment.offset));
            last = segment.offset;
        }
        let mean = if count > 0.0 { sum / count } else { 0.0 };
        let offset_warning = largest_offset > WARNING_FLOOR_OFFSET.get();
        let visibility_warning = worst > WARNING_OBJECT_HEIGHT.get();
        let permitted_speed_percent =
            if offset_warning || visibility_warning { REDUCED_SPEED_PERCENT } else { 100 };
        HealthReport {
            figures: HealthFigures {
                floor_offset: Millimetres::new(mean),
                floor_rise: Millimetres::new(first.map_or(0.0, |first| last - first)),
                smallest_object: Millimetres::new(worst),
                smallest_object_place: Millimetres::new(place),
                permitted_speed_percent,
            },
            aligned: largest_offset <= LARGEST_FLOOR_OFFSET.get(),
            capable: worst <= CONFIGURED_OBJECT_HEIGHT.get(),
            offset_warning,
            visibility_warning,
        }
    }
}

impl Default for Health {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
