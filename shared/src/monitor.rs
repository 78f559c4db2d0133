//! Tiers 1 and 2 together over one rig: the stripe monitor that runs on the MCU for every line-scan, and on the host
//! at full resolution.

use crate::columns::{ColumnMap, Decimation, GeometryError, StripeGeometry};
use crate::cutoff::{Cutoff, CutoffDetector, Gap};
use crate::height::{self, Cluster, Heights, SizeClass};
use crate::limits::{
    FLOOR_TOLERANCE, IMMEDIATE_GAP, LARGE_HEIGHT, LONGEST_ALLOWED_GAP, RUN_OVER_HEIGHT, VOTE_FRAMES,
    WEAKEST_SIGNAL,
};
use crate::rig::Rig;
use crate::run_over::{RunOverPermit, Stretch};
use crate::units::SignalQuality;

/// What one column of a line-scan or of a picture says about the stripe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColumnReading {
    /// Row of the stripe in pixels; NaN where there is none.
    pub row: f32,
    /// How well it is seen.
    pub quality: SignalQuality,
}

impl ColumnReading {
    /// No stripe in this column.
    pub const MISSING: Self = Self { row: f32::NAN, quality: SignalQuality::NONE };
}

/// What the monitor finds in one frame, with the votes over the last frames.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StripeReport {
    /// Tier 1.
    pub cutoff: Cutoff,
    /// Tier 2.
    pub heights: Heights,
    /// Something at least 50 mm high in most of the last frames, however narrow.
    pub large: bool,
    /// Columns that watch the stripe.
    pub watched_columns: u16,
    /// From the first to the last place that passed under a run-over permit in this frame; `None` without any.
    pub passed: Option<Gap>,
}

impl StripeReport {
    /// Tier 1's verdict: is the stripe cut for longer than the limit (by vote), or for very long (at once)?
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.watched_columns == 0
            || self.cutoff.voted.is_some_and(|gap| gap.length() > LONGEST_ALLOWED_GAP)
            || self.cutoff.single.is_some_and(|gap| gap.length() > IMMEDIATE_GAP)
    }

    /// The longest gap to tell: the vote's, or this frame's alone while that one trips at once and is longer.
    #[must_use]
    pub fn longest_gap(&self) -> Option<Gap> {
        let at_once = self.cutoff.single.filter(|gap| gap.length() > IMMEDIATE_GAP);
        match (self.cutoff.voted, at_once) {
            (Some(voted), Some(single)) if voted.length() >= single.length() => Some(voted),
            (voted, at_once) => at_once.or(voted),
        }
    }

    /// Nothing of the stripe is seen on the floor, nor off it.
    #[must_use]
    pub const fn is_stripe_missing(&self) -> bool {
        self.cutoff.floor_columns == 0 && self.heights.highest.is_none() && self.heights.lowest.is_none()
    }

    /// Tier 2's class of what is on the stripe; `None` while the stripe is whole. A gap in which the stripe is
    /// missing for longer than the limit has an unknown height, whatever else is seen.
    #[must_use]
    pub fn size(&self) -> Option<SizeClass> {
        if self.heights.longest_unknown > LONGEST_ALLOWED_GAP {
            return Some(SizeClass::Unknown);
        }
        match self.heights.highest {
            Some(highest) => Some(SizeClass::of(highest.height)),
            None => self.is_cut().then_some(SizeClass::Unknown),
        }
    }
}

/// Geometry, working memory and votes of one rig. About 32 bytes a column: keep it in a static or a box.
#[derive(Debug, Clone)]
pub struct StripeMonitor<const N: usize> {
    geometry: StripeGeometry<N>,
    detector: CutoffDetector<N>,
    heights: [f32; N],
    large: [bool; VOTE_FRAMES],
}

impl<const N: usize> StripeMonitor<N> {
    /// Watches nothing yet; see [`Self::configure`]. All zero bits: a static of it takes no room in flash.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            geometry: StripeGeometry::empty(),
            detector: CutoffDetector::new(),
            heights: [0.0; N],
            large: [false; VOTE_FRAMES],
        }
    }

    /// Takes a rig and forgets all frames.
    ///
    /// # Errors
    /// See [`GeometryError`]; the monitor then watches nothing, and [`StripeReport::is_cut`] holds.
    pub fn configure(&mut self, rig: &Rig, decimation: Decimation) -> Result<(), GeometryError> {
        self.reset();
        self.geometry.fill(rig, decimation)
    }

    /// Forgets all frames: the vote starts anew, from "not floor".
    pub fn reset(&mut self) {
        self.detector.reset();
        self.heights.fill(f32::NAN);
        self.large = [false; VOTE_FRAMES];
    }

    /// The maps.
    #[must_use]
    pub const fn geometry(&self) -> &StripeGeometry<N> {
        &self.geometry
    }

    /// Heights of the last frame in the watched columns, millimetres, NaN where the stripe is missing, 0 where it passed
    /// under a run-over permit.
    #[must_use]
    pub fn heights(&self) -> &[f32] {
        self.heights.get(..self.geometry.maps().len()).unwrap_or(&[])
    }

    /// Evaluates one frame. `readings` gives every column of the scan, watched or not, from column 0 on; columns that
    /// it does not give are missing.
    pub fn update(&mut self, readings: impl Iterator<Item = ColumnReading>) -> StripeReport {
        self.update_with(readings, &RunOverPermit::NONE, |_| {}, |_| {})
    }

    /// As [`Self::update`], and tells every gap of the vote and every cluster of this frame. In the permit's stretches a
    /// column that shows the stripe raised by less than [`RUN_OVER_HEIGHT`] counts as floor for tier 1: not one without
    /// stripe, not one that is higher, not one below the floor. Tier 2 sees every height as it is.
    pub fn update_with(
        &mut self,
        readings: impl Iterator<Item = ColumnReading>,
        permit: &RunOverPermit,
        on_gap: impl FnMut(Gap),
        on_cluster: impl FnMut(Cluster),
    ) -> StripeReport {
        let maps = self.geometry.maps();
        let mut readings = readings.skip(self.geometry.watched().start);
        for (height, map) in self.heights.iter_mut().zip(maps) {
            *height = readings.next().map_or(f32::NAN, |reading| trusted_height(map, reading));
        }
        let measured = self.heights.get_mut(..maps.len()).unwrap_or(&mut []);
        let heights = height::evaluate(&self.geometry, measured, on_cluster);
        let mut passed: Option<Gap> = None;
        for stretch in permit.stretches.iter().flatten() {
            let here = let_pass(maps, measured, *stretch);
            passed = here.map(|here| passed.map_or(here, |before| before.united_with(&here))).or(passed);
        }
        let cutoff = self.detector.update(&self.geometry, measured, on_gap);
        self.large.rotate_right(1);
        if let Some(newest) = self.large.first_mut() {
            *newest = heights.highest.is_some_and(|highest| highest.height >= LARGE_HEIGHT);
        }
        let votes = self.large.iter().fold(0_usize, |votes, large| votes.saturating_add(usize::from(*large)));
        StripeReport {
            cutoff,
            heights,
            large: votes.saturating_mul(2) > VOTE_FRAMES,
            watched_columns: u16::try_from(maps.len()).unwrap_or(u16::MAX),
            passed,
        }
    }
}

impl<const N: usize> Default for StripeMonitor<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Makes floor of the low columns of a stretch; tells from where to where it has.
fn let_pass(maps: &[ColumnMap], heights: &mut [f32], stretch: Stretch) -> Option<Gap> {
    let (start, end) = (stretch.start().get(), stretch.end().get());
    // Places rise or fall with the column all along the stripe.
    let rising = maps.first()?.floor_place <= maps.last()?.floor_place;
    let [before, inside]: [fn(&ColumnMap, f32, f32) -> bool; 2] = if rising {
        [|map, start, _| map.floor_place < start, |map, _, end| map.floor_place <= end]
    } else {
        [|map, _, end| map.floor_place > end, |map, start, _| map.floor_place >= start]
    };
    let from = maps.partition_point(|map| before(map, start, end));
    let to = maps.partition_point(|map| inside(map, start, end));
    let (maps, heights) = (maps.get(from..to)?, heights.get_mut(from..to)?);
    let first = heights.iter().position(|height| is_low(*height))?;
    let last = heights.iter().rposition(|height| is_low(*height))?;
    let passed = Gap::between(maps.get(first)?.floor_place, maps.get(last)?.floor_place);
    for height in heights.get_mut(first..)?.iter_mut().filter(|height| is_low(**height)) {
        *height = 0.0;
    }
    Some(passed)
}

/// Raised, and low enough to be run over: as positive floats compare like their bits, in a third of the instructions.
const fn is_low(height: f32) -> bool {
    const FLOOR: u32 = FLOOR_TOLERANCE.get().to_bits();
    const LIMIT: u32 = RUN_OVER_HEIGHT.get().to_bits();
    height.to_bits() > FLOOR && height.to_bits() < LIMIT
}

/// Height of a reading, NaN where its signal is too weak to be trusted.
#[inline]
fn trusted_height(map: &ColumnMap, reading: ColumnReading) -> f32 {
    if reading.quality >= WEAKEST_SIGNAL { map.height(reading.row) } else { f32::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Millimetres;
    use proptest::prelude::*;

    #[test]
    fn low_is_between_the_floors_tolerance_and_the_limit() {
        let (floor, limit) = (FLOOR_TOLERANCE.get(), RUN_OVER_HEIGHT.get());
        for (height, low) in [
            (floor, false),
            (floor.next_up(), true),
            (limit.next_down(), true),
            (limit, false),
            (0.0, false),
            (-3.0, false),
            (f32::NAN, false),
            (-f32::NAN, false),
            (f32::INFINITY, false),
        ] {
            assert_eq!(is_low(height), low, "{height}");
        }
    }

    proptest! {
        #[test]
        fn low_by_bits_is_low_by_value(bits in any::<u32>()) {
            let height = f32::from_bits(bits);
            let low = height > FLOOR_TOLERANCE.get() && height < RUN_OVER_HEIGHT.get();
            prop_assert_eq!(is_low(height), low);
        }
    }

    /// A report of these gaps: the vote's, and this frame's alone.
    fn report(voted: Option<f32>, single: Option<f32>) -> StripeReport {
        let gap = |length: f32| Gap::between(0.0, length);
        let cutoff = Cutoff { voted: voted.map(gap), single: single.map(gap), floor_columns: 9 };
        StripeReport { cutoff, watched_columns: 10, ..StripeReport::default() }
    }

    #[test]
    fn a_gap_of_the_limit_is_allowed_and_a_longer_one_is_not() {
        let (allowed, at_once) = (LONGEST_ALLOWED_GAP.get(), IMMEDIATE_GAP.get());
        assert!(!report(Some(allowed), None).is_cut());
        assert!(report(Some(allowed.next_up()), None).is_cut());
        assert!(!report(None, Some(at_once)).is_cut());
        assert!(report(None, Some(at_once.next_up())).is_cut());
        assert!(StripeReport { watched_columns: 0, ..report(None, None) }.is_cut());
    }

    #[test]
    fn the_longer_gap_is_told_and_this_frame_s_only_if_it_trips() {
        let told = |voted, single| report(voted, single).longest_gap().map(|gap| gap.length().get());
        let at_once = IMMEDIATE_GAP.get();
        assert_eq!(told(None, Some(at_once)), None);
        assert_eq!(told(None, Some(30.0)), Some(30.0));
        assert_eq!(told(Some(3.0), Some(at_once)), Some(3.0));
        assert_eq!(told(Some(3.0), Some(30.0)), Some(30.0));
        assert_eq!(told(Some(40.0), Some(30.0)), Some(40.0));
    }

    #[test]
    fn only_a_stripe_without_any_trace_is_missing() {
        let trace = Some(crate::height::Extreme { height: Millimetres::new(9.0), place: Millimetres::ZERO });
        let none = StripeReport { watched_columns: 10, ..StripeReport::default() };
        assert!(none.is_stripe_missing());
        assert!(!report(None, None).is_stripe_missing());
        let raised = Heights { highest: trace, ..Heights::default() };
        let below = Heights { lowest: trace, ..Heights::default() };
        for heights in [raised, below] {
            assert!(!StripeReport { heights, ..none }.is_stripe_missing());
        }
    }

    #[test]
    fn more_than_the_allowed_gap_without_stripe_has_no_known_size() {
        let size = |unknown: f32| {
            let heights = Heights { longest_unknown: Millimetres::new(unknown), ..Heights::default() };
            StripeReport { heights, ..report(None, None) }.size()
        };
        assert_eq!(size(LONGEST_ALLOWED_GAP.get()), None);
        assert_eq!(size(LONGEST_ALLOWED_GAP.get().next_up()), Some(SizeClass::Unknown));
    }

    /// Columns exactly at the ends of a permit's stretch belong to it, whichever way the places run.
    #[test]
    fn a_stretch_has_both_its_ends() {
        for rising in [true, false] {
            let place = |column: i8| f32::from(if rising { column } else { 30 - column });
            let maps: Vec<_> = (0..=30_i8)
                .map(|column| ColumnMap {
                    floor_row: 100.0,
                    floor_place: place(column),
                    height_per_row: 1.0,
                    perspective_per_row: 0.0,
                    bend_per_row: 0.0,
                    place_per_height: 0.0,
                })
                .collect();
            let mut heights = [10.0; 31];
            let passed = let_pass(&maps, &mut heights, Stretch::new(10, 20).unwrap());
            assert_eq!(passed, Some(Gap::between(10.0, 20.0)));
            assert_eq!(heights.iter().filter(|height| **height == 0.0).count(), 11);
        }
    }
}
