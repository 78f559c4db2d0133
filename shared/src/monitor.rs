//! Tiers 1 and 2 together over one rig: the stripe monitor that runs on the MCU for every line-scan, and on the host
//! at full resolution.

use crate::columns::{ColumnMap, Decimation, GeometryError, StripeGeometry};
use crate::cutoff::{Cutoff, CutoffDetector, Gap};
use crate::height::{self, Cluster, Heights, SizeClass};
use crate::limits::{IMMEDIATE_GAP, LARGE_HEIGHT, LONGEST_ALLOWED_GAP, VOTE_FRAMES, WEAKEST_SIGNAL};
use crate::rig::Rig;
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

    /// Heights of the last frame in the watched columns, millimetres, NaN where the stripe is missing.
    #[must_use]
    pub fn heights(&self) -> &[f32] {
        self.heights.get(..self.geometry.maps().len()).unwrap_or(&[])
    }

    /// Evaluates one frame. `readings` gives every column of the scan, watched or not, from column 0 on; columns that
    /// it does not give are missing.
    pub fn update(&mut self, readings: impl Iterator<Item = ColumnReading>) -> StripeReport {
        self.update_with(readings, |_| {}, |_| {})
    }

    /// As [`Self::update`], and tells every gap of the vote and every cluster of this frame.
    pub fn update_with(
        &mut self,
        readings: impl Iterator<Item = ColumnReading>,
        on_gap: impl FnMut(Gap),
        on_cluster: impl FnMut(Cluster),
    ) -> StripeReport {
        let maps = self.geometry.maps();
        let mut readings = readings.skip(self.geometry.watched().start);
        for (height, map) in self.heights.iter_mut().zip(maps) {
            *height = readings.next().map_or(f32::NAN, |reading| trusted_height(map, reading));
        }
        let heights = self.heights.get(..maps.len()).unwrap_or(&[]);
        let cutoff = self.detector.update(&self.geometry, heights, on_gap);
        let heights = height::evaluate(&self.geometry, heights, on_cluster);
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
        }
    }
}

impl<const N: usize> Default for StripeMonitor<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Height of a reading, NaN where its signal is too weak to be trusted.
#[inline]
fn trusted_height(map: &ColumnMap, reading: ColumnReading) -> f32 {
    if reading.quality >= WEAKEST_SIGNAL { map.height(reading.row) } else { f32::NAN }
}
