//! Tier 1: where is the stripe cut, and how long is the longest gap.
//!
//! As in the paper (section 3.3): a running average of 5 mm along the stripe over "this column shows lit floor", the
//! mean over this frame and two earlier ones, and the longest run in which less than half is lit floor. A gap is
//! measured between the two floor columns that bound it: what lies between them is not proven to be floor, so a gap
//! is never under-reported: with columns p apart, every cut of 5 mm and more trips, and none of 5 mm - 2 p or less does.
//! Unknown is never floor.

use crate::columns::{ColumnMap, StripeGeometry};
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

    /// From the smaller of both starts to the larger of both ends.
    #[must_use]
    pub fn united_with(&self, other: &Self) -> Self {
        let start = if other.start < self.start { other.start } else { self.start };
        let end = if other.end > self.end { other.end } else { self.end };
        Self { start, end }
    }
}

/// Is a column of this height proven to show lit floor? NaN (no stripe) is not.
///
/// `|height| <= FLOOR_TOLERANCE`, on the bits without their sign: in that order floats compare like integers, NaN is
/// beyond them all, and the MCU needs a third of the instructions.
#[must_use]
#[inline]
pub const fn is_floor(height: f32) -> bool {
    (height.to_bits() & 0x7FFF_FFFF) <= FLOOR_TOLERANCE.get().to_bits()
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
    /// Floor columns within each column's window in the two frames before: the newer one in the low byte. Zero =
    /// nothing proven, also at start.
    lit: [u16; N],
}

const _: () = assert!(VOTE_FRAMES == 3, "the vote is over this frame and the two that `lit` keeps");

/// A column's two verdicts, as bits: this frame alone, and the vote.
const SINGLE: u8 = 1;
const VOTED: u8 = 2;

impl<const N: usize> CutoffDetector<N> {
    /// No frame seen yet: until the vote is full, nothing counts as floor.
    #[must_use]
    pub const fn new() -> Self {
        Self { lit: [0; N] }
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        self.lit.fill(0);
    }

    /// Evaluates one frame: `heights` holds the stripe's height in each watched column (NaN = no stripe), in the
    /// order of `geometry`'s maps. `on_gap` is called for every gap of the vote, in the order of columns.
    pub fn update(
        &mut self,
        geometry: &StripeGeometry<N>,
        heights: &[f32],
        on_gap: impl FnMut(Gap),
    ) -> Cutoff {
        let mut runs = Runs::new(geometry.maps(), on_gap);
        let reaches = geometry.reaches();
        let mut index = 0_usize;
        // Neighbours with windows of one size are counted in one go.
        while let Some((reach, others)) = reaches.get(index..).and_then(<[u8]>::split_first) {
            let equals = others.iter().position(|other| other != reach).unwrap_or(others.len());
            let end = index.saturating_add(equals).saturating_add(1);
            while let Some(lit) = self.lit.get_mut(index..end).filter(|lit| !lit.is_empty()) {
                let counted = count_windows(index, usize::from(*reach), heights, lit, &mut runs);
                index = index.saturating_add(counted);
            }
            index = end;
        }
        let floor_columns =
            heights.iter().fold(0_u16, |sum, height| sum.saturating_add(u16::from(is_floor(*height))));
        let (voted, single) = runs.finish();
        Cutoff { voted, single, floor_columns }
    }
}

impl<const N: usize> Default for CutoffDetector<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Judges the column at `index`, and with it as many more of those that `lit` begins with as have whole windows.
/// Returns how many.
fn count_windows(
    index: usize,
    reach: usize,
    heights: &[f32],
    lit: &mut [u16],
    runs: &mut Runs<'_, impl FnMut(Gap)>,
) -> usize {
    let from = index.saturating_sub(reach);
    let to = index.saturating_add(reach).saturating_add(1);
    let window = heights.get(from..to.min(heights.len())).unwrap_or(&[]);
    let mut inside =
        window.iter().fold(0_u32, |sum, height| sum.saturating_add(u32::from(is_floor(*height))));
    let vote = Vote::over(window.len());
    let Some((first, rest)) = lit.split_first_mut() else { return 1 };
    runs.column(index, vote.judge(inside, first));
    if index < reach {
        // The window is cut off by the stripe's first column: the next one is longer.
        return 1;
    }
    let entering = heights.get(to..).unwrap_or(&[]);
    let leaving = heights.get(from..).unwrap_or(&[]);
    let mut counted = 1_usize;
    for ((lit, enters), leaves) in rest.iter_mut().zip(entering).zip(leaving) {
        // At most 255 columns are inside, and what leaves has entered before.
        inside = inside.wrapping_add(u32::from(is_floor(*enters))).wrapping_sub(u32::from(is_floor(*leaves)));
        runs.column(index.wrapping_add(counted), vote.judge(inside, lit));
        counted = counted.wrapping_add(1);
    }
    counted
}

/// Majorities over windows of one size.
#[derive(Clone, Copy)]
struct Vote {
    /// More floor columns than this are the majority of one frame's window ...
    half: u32,
    /// ... and more than this of the windows of all frames in the vote.
    half_of_all: u32,
}

impl Vote {
    fn over(columns: usize) -> Self {
        let all = columns.saturating_mul(VOTE_FRAMES);
        Self {
            half: u32::try_from(columns / 2).unwrap_or(u32::MAX),
            half_of_all: u32::try_from(all / 2).unwrap_or(u32::MAX),
        }
    }

    /// A column's verdict; moves its history on.
    #[inline]
    fn judge(self, inside: u32, lit: &mut u16) -> u8 {
        let [before, oldest] = lit.to_le_bytes();
        // A window has at most 255 columns: the reach is at most 127.
        let [now, ..] = inside.to_le_bytes();
        *lit = u16::from_le_bytes([now, before]);
        let all = inside.wrapping_add(u32::from(before)).wrapping_add(u32::from(oldest));
        let single = if inside > self.half { SINGLE } else { 0 };
        let voted = if all > self.half_of_all { VOTED } else { 0 };
        single | voted
    }
}

/// Both kinds of gaps, from verdict to verdict.
struct Runs<'a, G> {
    single: LongestGap<'a>,
    voted: LongestGap<'a>,
    before: u8,
    on_gap: G,
}

impl<'a, G: FnMut(Gap)> Runs<'a, G> {
    const fn new(maps: &'a [ColumnMap], on_gap: G) -> Self {
        Self { single: LongestGap::new(maps), voted: LongestGap::new(maps), before: SINGLE | VOTED, on_gap }
    }

    /// Most columns are like the one before.
    #[inline]
    fn column(&mut self, index: usize, verdict: u8) {
        if verdict != self.before {
            self.change(index, verdict);
        }
    }

    #[inline(never)]
    fn change(&mut self, index: usize, verdict: u8) {
        let changed = self.before ^ verdict;
        self.before = verdict;
        if changed & SINGLE != 0 {
            self.single.turn(index, |_| {});
        }
        if changed & VOTED != 0 {
            self.voted.turn(index, &mut self.on_gap);
        }
    }

    /// The longest gap of the vote and of this frame alone.
    fn finish(self) -> (Option<Gap>, Option<Gap>) {
        (self.voted.finish(self.on_gap), self.single.finish(|_| {}))
    }
}

/// Measures runs of not-floor from the last floor column before to the first one after.
struct LongestGap<'a> {
    maps: &'a [ColumnMap],
    /// While within a gap: the floor column before it, or the stripe's first column where it begins with a gap.
    bound: Option<usize>,
    longest: Option<Gap>,
    /// Its length as the bits of the float: positive floats compare like them, and a length that is no number is longest.
    longest_bits: u32,
}

impl<'a> LongestGap<'a> {
    const fn new(maps: &'a [ColumnMap]) -> Self {
        Self { maps, bound: None, longest: None, longest_bits: 0 }
    }

    /// Call for every column whose verdict is not that of the one before; the one before the first is floor. So a gap
    /// begins or ends here.
    fn turn(&mut self, index: usize, on_gap: impl FnMut(Gap)) {
        match self.bound {
            None => self.bound = Some(index.saturating_sub(1)),
            Some(bound) => self.close(bound, index, on_gap),
        }
    }

    fn close(&mut self, from: usize, to: usize, mut on_gap: impl FnMut(Gap)) {
        self.bound = None;
        let (one, other) = (self.place(from), self.place(to));
        on_gap(Gap::between(one, other));
        let bits = (one - other).abs().to_bits();
        if bits > self.longest_bits || self.longest.is_none() {
            self.longest = Some(Gap::between(one, other));
            self.longest_bits = bits;
        }
    }

    /// Only columns of the stripe are asked for.
    fn place(&self, index: usize) -> f32 {
        self.maps.get(index).map_or(f32::NAN, |map| map.floor_place)
    }

    /// A gap that is open at the stripe's end reaches to its last column.
    fn finish(mut self, on_gap: impl FnMut(Gap)) -> Option<Gap> {
        if let Some(bound) = self.bound {
            self.close(bound, self.maps.len().saturating_sub(1), on_gap);
        }
        self.longest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn united_gaps_reach_from_end_to_end() {
        let (one, other) = (Gap::between(-3.0, 4.0), Gap::between(6.0, 9.0));
        for gap in [one.united_with(&other), other.united_with(&one)] {
            assert_eq!(gap, Gap::between(-3.0, 9.0));
        }
        assert_eq!(one.united_with(&Gap::between(0.0, 1.0)), one);
        assert_eq!(Gap::between(0.0, 1.0).united_with(&one), one);
    }

    #[test]
    fn floor_is_the_tolerance_and_no_more_on_both_sides() {
        let limit = FLOOR_TOLERANCE.get();
        for (height, floor) in [
            (limit.next_down(), true),
            (limit, true),
            (limit.next_up(), false),
            (-limit, true),
            (-limit.next_up(), false),
            (0.0, true),
            (-0.0, true),
            (f32::NAN, false),
            (-f32::NAN, false),
            (f32::INFINITY, false),
            (f32::NEG_INFINITY, false),
        ] {
            assert_eq!(is_floor(height), floor, "{height}");
        }
    }

    proptest! {
        #[test]
        fn floor_by_bits_is_floor_by_value(bits in any::<u32>()) {
            let height = f32::from_bits(bits);
            prop_assert_eq!(is_floor(height), height.abs() <= FLOOR_TOLERANCE.get());
        }
    }

    /// More than half of a window, and more than half of the windows of all frames in the vote.
    #[test]
    fn half_is_no_majority() {
        let vote = Vote::over(6);
        let judged = |inside, before, oldest| vote.judge(inside, &mut u16::from_le_bytes([before, oldest]));
        assert_eq!(judged(3, 6, 0), 0, "3 of 6, 9 of 18");
        assert_eq!(judged(4, 5, 0), SINGLE, "4 of 6, 9 of 18");
        assert_eq!(judged(3, 6, 1), VOTED, "3 of 6, 10 of 18");
        assert_eq!(judged(4, 6, 0), SINGLE | VOTED, "4 of 6, 10 of 18");
    }

    #[test]
    fn of_equally_long_gaps_the_first_is_told() {
        let map = |place: f32| ColumnMap {
            floor_row: 100.0,
            floor_place: place,
            height_per_row: 1.0,
            perspective_per_row: 0.0,
            bend_per_row: 0.0,
            place_per_height: 0.0,
        };
        let maps: Vec<_> = (0_u8..30).map(|place| map(f32::from(place))).collect();
        let mut gaps = LongestGap::new(&maps);
        for turn in [3, 8, 13, 18, 22, 25] {
            gaps.turn(turn, |_| {});
        }
        assert_eq!(gaps.finish(|_| {}), Some(Gap::between(2.0, 8.0)));
    }
}
