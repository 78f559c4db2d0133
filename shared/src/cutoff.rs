//! Tier 1: where is the stripe cut, and how long is the longest gap.
//!
//! As in the paper (section 3.3): a running average of 5 mm along the stripe over "this column shows lit floor", the
//! mean over this frame and two earlier ones, and the longest run in which less than half is lit floor. A gap is
//! measured between the two floor columns that bound it: what lies between them is not proven to be floor, so a gap
//! is never under-reported: with columns p apart, every cut of 5 mm and more trips, and none of 5 mm - 2 p or less does.
//! Unknown is never floor.

use crate::columns::StripeGeometry;
use crate::limits::{FLOOR_TOLERANCE, VOTE_FRAMES};
use crate::units::Millimetres;

/// A stretch of the stripe, in stripe coordinates; start <= end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Smaller end.
    pub start: Millimetres,
    /// Larger end.
    pub end: Millimetres,
}

impl Gap {
    /// Between two places in any order.
    #[must_use]
    pub fn between(one: f32, other: f32) -> Self {
        let (start, end) = if one <= other { (one, other) } else { (other, one) };
        Self { start: Millimetres::new(start), end: Millimetres::new(end) }
    }

    /// Its length.
    #[must_use]
    pub fn length(&self) -> Millimetres {
        self.end.minus(self.start)
    }
}

/// Is a column of this height proven to show lit floor? NaN (no stripe) is not.
#[must_use]
#[inline]
pub fn is_floor(height: f32) -> bool {
    height.abs() <= FLOOR_TOLERANCE.get()
}

/// What tier 1 finds in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cutoff {
    /// Longest gap by the vote over the last frames; `None` if the stripe is whole.
    pub voted: Option<Gap>,
    /// Longest gap in this frame alone.
    pub single: Option<Gap>,
    /// Columns that show lit floor in this frame, before any averaging.
    pub floor_columns: u16,
}

/// Averages, votes and measures; keeps the averages of the last [`VOTE_FRAMES`] frames.
#[derive(Debug, Clone)]
pub struct CutoffDetector<const N: usize> {
    /// Floor columns within each column's window, newest frame first. Zero = nothing proven, also at start.
    lit: [[u8; N]; VOTE_FRAMES],
}

impl<const N: usize> CutoffDetector<N> {
    /// No frame seen yet: until the vote is full, nothing counts as floor.
    #[must_use]
    pub const fn new() -> Self {
        Self { lit: [[0; N]; VOTE_FRAMES] }
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        for frame in &mut self.lit {
            frame.fill(0);
        }
    }

    /// Evaluates one frame: `heights` holds the stripe's height in each watched column (NaN = no stripe), in the
    /// order of `geometry`'s maps. `on_gap` is called for every gap of the vote, in the order of columns.
    pub fn update(
        &mut self,
        geometry: &StripeGeometry<N>,
        heights: &[f32],
        mut on_gap: impl FnMut(Gap),
    ) -> Cutoff {
        self.lit.rotate_right(1);
        let [newest, before, oldest] = &mut self.lit;
        let mut leading = heights.iter();
        let mut trailing = heights.iter();
        let (mut lead, mut trail) = (0_usize, 0_usize);
        let mut inside = 0_u8;
        let mut voted = LongestGap::default();
        let mut single = LongestGap::default();
        let maps = geometry.maps();
        let columns = maps.iter().zip(geometry.reaches()).zip(newest).zip(before).zip(oldest);
        let mut next_index = 0_usize;
        for ((((map, reach), lit), lit_before), lit_oldest) in columns {
            let index = next_index;
            next_index = index.saturating_add(1);
            let reach = usize::from(*reach);
            let to = index.saturating_add(reach).saturating_add(1).min(maps.len());
            let from = index.saturating_sub(reach);
            while lead < to {
                lead = lead.saturating_add(1);
                inside =
                    inside.saturating_add(u8::from(leading.next().is_some_and(|height| is_floor(*height))));
            }
            while trail < from {
                trail = trail.saturating_add(1);
                inside =
                    inside.saturating_sub(u8::from(trailing.next().is_some_and(|height| is_floor(*height))));
            }
            *lit = inside;
            let window = to.saturating_sub(from);
            let now = usize::from(inside);
            let all = now.saturating_add(usize::from(*lit_before)).saturating_add(usize::from(*lit_oldest));
            single.column(map.floor_place, now.saturating_mul(2) > window, |_| {});
            voted.column(
                map.floor_place,
                all.saturating_mul(2) > window.saturating_mul(VOTE_FRAMES),
                &mut on_gap,
            );
        }
        let floor_columns =
            heights.iter().fold(0_u16, |sum, height| sum.saturating_add(u16::from(is_floor(*height))));
        Cutoff { voted: voted.finish(on_gap), single: single.finish(|_| {}), floor_columns }
    }
}

impl<const N: usize> Default for CutoffDetector<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Measures runs of not-floor from the last floor column before to the first one after.
#[derive(Default)]
struct LongestGap {
    /// The last floor column's place, or the stripe's first column where it begins with a gap.
    bound: Option<f32>,
    /// The newest column's place, while within a gap.
    open: Option<f32>,
    longest: Option<Gap>,
}

impl LongestGap {
    fn column(&mut self, place: f32, floor: bool, on_gap: impl FnMut(Gap)) {
        if floor {
            if self.open.is_some() {
                self.close(place, on_gap);
            }
            self.bound = Some(place);
        } else {
            self.bound = Some(self.bound.unwrap_or(place));
            self.open = Some(place);
        }
    }

    fn close(&mut self, place: f32, mut on_gap: impl FnMut(Gap)) {
        self.open = None;
        let gap = Gap::between(self.bound.unwrap_or(place), place);
        on_gap(gap);
        if self.longest.is_none_or(|longest| gap.length() > longest.length()) {
            self.longest = Some(gap);
        }
    }

    fn finish(mut self, on_gap: impl FnMut(Gap)) -> Option<Gap> {
        if let Some(place) = self.open {
            self.close(place, on_gap);
        }
        self.longest
    }
}
