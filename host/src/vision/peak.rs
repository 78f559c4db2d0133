//! Finding the stripe in a short run of samples down one column: a ridge that stands out on both sides.
//!
//! Only local contrast counts. The background is the lowest level that is reached on each side within a short way, and
//! the higher of the two sides is the one that the stripe must stand out from: neither the edge of a red line nor a
//! red floor is a stripe, but a stripe on either is.

mod column;
mod hollow;
mod search;

pub use column::Column;
pub use hollow::fill_hollows;
pub use search::{find, find_above};

/// Speckle makes a ridge uneven, and a clipped core makes it hollow; a rise by more than this share of its height belongs to the next one.
const VALLEY_SHARE: f32 = 0.5;

/// Most samples that a window may have.
pub const LONGEST_WINDOW: usize = 128;

/// Lengths that follow from how wide a stripe appears, in samples.
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    /// Half the length of the running sum that detects the stripe.
    pub half: usize,
    /// Nearest distance at which the background is looked for.
    pub near: usize,
    /// Farthest such distance.
    pub far: usize,
}

impl Kernel {
    /// For samples of single pixels: stripes are 4 to 12 pixels wide.
    pub const PIXELS: Self = Self { half: 2, near: 6, far: 18 };
    /// For samples of 2 x 2 pixels.
    pub const CHROMA: Self = Self { half: 1, near: 3, far: 9 };

    /// For stripes that are too wide for this one: near the camera, or clipped.
    #[must_use]
    pub const fn widened(&self) -> Self {
        Self { half: 2 * self.half, near: 2 * self.near + 2, far: 2 * self.far + 4 }
    }

    /// For stripes with something else close by.
    #[must_use]
    pub const fn refined(&self) -> Self {
        let half = if self.half > 1 { self.half - 1 } else { 1 };
        Self { half, near: self.near - self.near / 3, far: self.far / 2 }
    }

    /// The widest stripe that leaves the background free.
    #[must_use]
    pub const fn widest(&self) -> usize {
        self.near + self.near / 2
    }

    /// How far a window must reach to both sides of a crest.
    #[must_use]
    pub const fn reach(&self) -> usize {
        self.far + self.half + 1
    }

    /// The one for samples of `step` x `step` pixels.
    #[must_use]
    pub const fn for_step(step: usize) -> Self {
        if step == 1 { Self::PIXELS } else { Self::CHROMA }
    }

    /// Samples in the running sum.
    #[must_use]
    pub const fn length(&self) -> usize {
        2 * self.half + 1
    }
}

/// A ridge in a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Where, samples from the window's beginning (integer = sample's centre).
    pub row: f32,
    /// Mean height of the running sum over the higher background.
    pub contrast: f32,
    /// The same over the lower background.
    pub rise: f32,
    /// Width at half of its height, samples.
    pub width: f32,
}

/// Running sums, made for a window or borrowed from a whole column's.
#[allow(clippy::large_enum_variant, reason = "on the stack for one look; a frame allocates nothing")]
#[derive(Debug, Clone)]
enum Sums<'a> {
    Own([i32; LONGEST_WINDOW]),
    OfColumn(&'a [i32]),
}

/// Running means over the kernel's length, times that length; and the samples that they come from.
#[derive(Debug, Clone)]
pub struct Ridge<'a> {
    samples: &'a [i16],
    sums: Sums<'a>,
    kernel: Kernel,
}

/// A crest with the backgrounds on both sides, as running sums.
#[derive(Debug, Clone, Copy)]
struct Crest {
    at: usize,
    above: i32,
    below: i32,
}

impl<'a> Ridge<'a> {
    /// Sums up a window of at most [`LONGEST_WINDOW`] samples; what is longer is left out.
    #[must_use]
    pub fn new(samples: &'a [i16], kernel: Kernel) -> Self {
        let samples = &samples[..samples.len().min(LONGEST_WINDOW)];
        let mut sums = [0; LONGEST_WINDOW];
        let mut sum: i32 = 0;
        for (index, sample) in samples.iter().enumerate() {
            sum += i32::from(*sample);
            if index >= kernel.length() {
                sum -= i32::from(samples[index - kernel.length()]);
            }
            if index + 1 >= kernel.length() {
                sums[index - kernel.half] = sum;
            }
        }
        Self { samples, sums: Sums::Own(sums), kernel }
    }

    #[inline]
    fn sums(&self) -> &[i32] {
        match &self.sums {
            Sums::Own(sums) => sums,
            Sums::OfColumn(sums) => sums,
        }
    }

    /// Window positions at which the running sum is complete.
    fn inner(&self) -> std::ops::Range<usize> {
        self.kernel.half..self.samples.len().saturating_sub(self.kernel.half)
    }

    /// The strongest ridge with its crest in `search`, or else the one whose flank reaches into it. `None` where
    /// nothing stands out, or the window leaves no room for a background on both sides.
    #[must_use]
    pub fn peak(&self, search: std::ops::Range<usize>) -> Option<Peak> {
        let Crest { at, above, below } = self.crest(search)?;
        let (background, contrast) = (above.max(below), self.over(at, above.max(below)));
        (contrast > 0.0).then(|| {
            let (row, width) = self.measure(at, background as f32 / self.kernel.length() as f32, contrast);
            Peak { row, contrast, rise: self.over(at, above.min(below)), width }
        })
    }

    /// Mean height of the running sum at a crest over a background.
    fn over(&self, crest: usize, background: i32) -> f32 {
        (self.sums()[crest] - background) as f32 / self.kernel.length() as f32
    }

    fn crest(&self, search: std::ops::Range<usize>) -> Option<Crest> {
        let sums = self.sums();
        let inner = self.inner();
        let search = search.start.max(inner.start)..search.end.min(inner.end);
        let mut crest = self.highest_crest(search.clone(), &inner).or_else(|| self.highest(search))?;
        while crest > inner.start && sums[crest - 1] > sums[crest] {
            crest -= 1;
        }
        while crest + 1 < inner.end && sums[crest + 1] > sums[crest] {
            crest += 1;
        }
        let Kernel { near, far, .. } = self.kernel;
        let above = crest.saturating_sub(far).max(inner.start)..crest.saturating_sub(near);
        let below = crest + near + 1..(crest + far + 1).min(inner.end);
        let lowest = |range: std::ops::Range<usize>| sums.get(range)?.iter().min().copied();
        Some(Crest { at: crest, above: lowest(above)?, below: lowest(below)? })
    }

    /// The highest local maximum in `search`; of equal ones the last.
    #[inline]
    fn highest_crest(&self, search: std::ops::Range<usize>, inner: &std::ops::Range<usize>) -> Option<usize> {
        let interior = search.start.max(inner.start + 1)..search.end.min(inner.end.saturating_sub(1));
        let first = interior.start;
        let around = self.sums().get(first.checked_sub(1)?..interior.end + 1)?;
        let mut best: Option<(i32, usize)> = None;
        for (offset, sums) in around.windows(3).enumerate() {
            let [before, here, after] = [sums[0], sums[1], sums[2]];
            if here >= before && here >= after && best.is_none_or(|(most, _)| here >= most) {
                best = Some((here, first + offset));
            }
        }
        best.map(|(_, position)| position)
    }

    /// The highest position in `search`; of equal ones the last.
    fn highest(&self, search: std::ops::Range<usize>) -> Option<usize> {
        let first = search.start;
        let sums = self.sums().get(search)?;
        let highest = sums.iter().enumerate().max_by_key(|(_, sum)| **sum)?;
        Some(first + highest.0)
    }

    /// Sub-pixel row and width. The row is the centre of gravity of what rises above a quarter of the height, within
    /// the ridge; it is not moved by clipped cores, and little by what lies beside the stripe.
    fn measure(&self, crest: usize, background: f32, contrast: f32) -> (f32, f32) {
        let level = |share: f32| background + share * contrast;
        let (half, quarter) = (level(0.5), level(0.25));
        let extent = |level: f32| {
            self.reach(crest, level, VALLEY_SHARE * contrast, true)
                ..self.reach(crest, level, VALLEY_SHARE * contrast, false) + 1
        };
        let (mut weight, mut moment) = (0.0, 0.0);
        for position in extent(quarter) {
            let excess = (f32::from(self.samples[position]) - quarter).max(0.0);
            weight += excess;
            moment += excess * (position as f32 - crest as f32);
        }
        let offset = if weight > 0.0 { moment / weight } else { 0.0 };
        (crest as f32 + offset, extent(half).len() as f32)
    }

    /// The last position up (or down) the column that still belongs to the ridge: above `level`, and before the samples
    /// rise again by `valley` towards another ridge.
    fn reach(&self, crest: usize, level: f32, valley: f32, up: bool) -> usize {
        let mut position = crest;
        let mut lowest = f32::INFINITY;
        for _ in 0..self.kernel.far {
            let next = if up { position.checked_sub(1) } else { Some(position + 1) };
            let Some((next, sample)) =
                next.and_then(|next| Some((next, f32::from(*self.samples.get(next)?))))
            else {
                break;
            };
            if sample <= level || sample > lowest + valley {
                break;
            }
            lowest = lowest.min(sample);
            position = next;
        }
        position
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stripe of Gaussian section at `row`, clipped like an 8-bit camera clips.
    fn stripe(row: f32, height: f32, ground: impl Fn(usize) -> f32) -> Vec<i16> {
        (0..49)
            .map(|position| {
                let distance = position as f32 - row;
                let light = height * (-distance * distance / (2.0 * 3.0 * 3.0)).exp();
                (ground(position) + light).min(255.0).round() as i16
            })
            .collect()
    }

    #[test]
    fn the_row_is_right_to_a_tenth_of_a_pixel_clipped_or_not() {
        for step in 0..20 {
            let row = 23.0 + step as f32 / 10.0;
            for height in [30.0, 180.0, 500.0] {
                let samples = stripe(row, height, |_| 4.0);
                let peak = Ridge::new(&samples, Kernel::PIXELS).peak(20..28).unwrap();
                assert!((peak.row - row).abs() < 0.1, "{row} at {height}: {peak:?}");
            }
        }
    }

    #[test]
    fn a_stripe_on_red_paint_is_seen_but_the_edge_of_the_paint_is_none() {
        let edge = |position: usize| if position < 22 { 150.0 } else { 5.0 };
        let bare = stripe(24.0, 0.0, edge);
        let contrast = Ridge::new(&bare, Kernel::PIXELS).peak(20..29).map_or(0.0, |peak| peak.contrast);
        assert!(contrast <= 0.0, "an edge stands out on one side only: {contrast}");
        let lit = stripe(30.0, 90.0, |_| 150.0);
        assert!(Ridge::new(&lit, Kernel::PIXELS).peak(26..34).unwrap().contrast > 60.0);
    }

    #[test]
    fn a_crest_outside_the_search_is_followed_uphill_unless_there_is_one_inside() {
        let samples = stripe(29.0, 100.0, |_| 0.0);
        let peak = Ridge::new(&samples, Kernel::PIXELS).peak(22..27).unwrap();
        assert!((peak.row - 29.0).abs() < 0.1, "{peak:?}");
        let both: Vec<i16> =
            samples.iter().zip(stripe(15.0, 30.0, |_| 0.0)).map(|(one, other)| one + other).collect();
        let peak = Ridge::new(&both, Kernel::PIXELS).peak(12..20).unwrap();
        assert!((peak.row - 15.0).abs() < 0.5, "{peak:?}");
    }

    #[test]
    fn windows_without_room_give_nothing() {
        for length in 0..12 {
            let samples = vec![9; length];
            assert_eq!(Ridge::new(&samples, Kernel::PIXELS).peak(0..length), None);
        }
    }
}
