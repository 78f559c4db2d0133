//! Finding the stripe in a short run of samples down one column: a ridge that stands out on both sides.
//!
//! Only local contrast counts. The background is the lowest level that is reached on each side within a short way, and
//! the higher of the two sides is the one that the stripe must stand out from: neither the edge of a red line nor a
//! red floor is a stripe, but a stripe on either is.

/// Most samples that a window may have.
pub const LONGEST_WINDOW: usize = 64;

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
    /// Width at half of its height, samples.
    pub width: f32,
}

/// Running means over the kernel's length, times that length; and the samples that they come from.
#[derive(Debug, Clone)]
pub struct Ridge<'a> {
    samples: &'a [i16],
    sums: [i32; LONGEST_WINDOW],
    kernel: Kernel,
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
        Self { samples, sums, kernel }
    }

    /// Window positions at which the running sum is complete.
    fn inner(&self) -> std::ops::Range<usize> {
        self.kernel.half..self.samples.len().saturating_sub(self.kernel.half)
    }

    /// The strongest ridge with its crest in `search`, or else the one whose flank reaches into it. `None` where
    /// nothing stands out, or the window leaves no room for a background on both sides.
    #[must_use]
    pub fn peak(&self, search: std::ops::Range<usize>) -> Option<Peak> {
        let inner = self.inner();
        let search = search.start.max(inner.start)..search.end.min(inner.end);
        let is_crest = |position: &usize| {
            let [before, here, after] = [position - 1, *position, position + 1].map(|at| self.sums[at]);
            here >= before && here >= after
        };
        let strength = |position: &usize| self.sums[*position];
        let interior = search.start.max(inner.start + 1)..search.end.min(inner.end.saturating_sub(1));
        let mut crest =
            interior.filter(is_crest).max_by_key(strength).or_else(|| search.max_by_key(strength))?;
        while crest > inner.start && self.sums[crest - 1] > self.sums[crest] {
            crest -= 1;
        }
        while crest + 1 < inner.end && self.sums[crest + 1] > self.sums[crest] {
            crest += 1;
        }
        let Kernel { near, far, .. } = self.kernel;
        let above = crest.saturating_sub(far).max(inner.start)..crest.saturating_sub(near);
        let below = crest + near + 1..(crest + far + 1).min(inner.end);
        let lowest = |range: std::ops::Range<usize>| self.sums.get(range)?.iter().min().copied();
        let background = lowest(above)?.max(lowest(below)?);
        let length = self.kernel.length() as f32;
        let contrast = (self.sums[crest] - background) as f32 / length;
        (contrast > 0.0).then(|| self.measure(crest, background as f32 / length, contrast))
    }

    /// Sub-pixel row and width. The row is the centre of gravity of what rises above a quarter of the height, within
    /// the ridge; it is not moved by clipped cores, and little by what lies beside the stripe.
    fn measure(&self, crest: usize, background: f32, contrast: f32) -> Peak {
        let level = |share: f32| background + share * contrast;
        let (half, quarter) = (level(0.5), level(0.25));
        let value = |position: usize| f32::from(self.samples[position]);
        let extent = |level: f32| {
            let (mut from, mut to) = (crest, crest);
            while from > 0 && crest - from < self.kernel.far && value(from - 1) > level {
                from -= 1;
            }
            while to + 1 < self.samples.len() && to - crest < self.kernel.far && value(to + 1) > level {
                to += 1;
            }
            from..to + 1
        };
        let (mut weight, mut moment) = (0.0, 0.0);
        for position in extent(quarter) {
            let excess = (value(position) - quarter).max(0.0);
            weight += excess;
            moment += excess * (position as f32 - crest as f32);
        }
        let offset = if weight > 0.0 { moment / weight } else { 0.0 };
        Peak { row: crest as f32 + offset, contrast, width: extent(half).len() as f32 }
    }

    /// How much the running mean varies where there is no stripe, as the standard deviation that normal noise would
    /// have: from the steps between neighbouring, not overlapping sums at least `distance` from `centre`. It is a
    /// quantile, so that an edge of paint that crosses one side counts for nothing. NaN without room.
    #[must_use]
    pub fn roughness(&self, centre: usize, distance: usize) -> f32 {
        let inner = self.inner();
        let length = self.kernel.length();
        let above = inner.start..centre.saturating_sub(distance).min(inner.end);
        let below = (centre + distance + 1).max(inner.start)..inner.end;
        let mut steps = [0_i32; LONGEST_WINDOW];
        let mut count = 0;
        for range in [above, below] {
            for first in range.start..range.end.saturating_sub(length) {
                steps[count] = (self.sums[first] - self.sums[first + length]).abs();
                count += 1;
            }
        }
        if count == 0 {
            return f32::NAN;
        }
        let (_, step, _) = steps[..count].select_nth_unstable(count * 2 / 5);
        *step as f32 / length as f32 / FORTY_PERCENT_STEP
    }
}

/// The 40 % quantile of the magnitude of the difference of two normal values, in their standard deviations:
/// sqrt(2) times 0.5244.
const FORTY_PERCENT_STEP: f32 = 0.741_6;

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
            samples.iter().zip(stripe(19.0, 30.0, |_| 0.0)).map(|(one, other)| one + other).collect();
        let peak = Ridge::new(&both, Kernel::PIXELS).peak(16..25).unwrap();
        assert!((peak.row - 19.0).abs() < 0.3, "{peak:?}");
    }

    #[test]
    fn roughness_is_blind_to_the_stripe_and_sees_texture() {
        let flat = stripe(24.0, 200.0, |_| 7.0);
        assert_eq!(Ridge::new(&flat, Kernel::PIXELS).roughness(24, 8), 0.0);
        let rough = stripe(24.0, 200.0, |position| if position / 5 % 2 == 0 { 0.0 } else { 10.0 });
        assert!(Ridge::new(&rough, Kernel::PIXELS).roughness(24, 8) > 4.0);
        let edge = stripe(24.0, 200.0, |position| if position < 10 { 150.0 } else { 7.0 });
        assert_eq!(
            Ridge::new(&edge, Kernel::PIXELS).roughness(24, 8),
            0.0,
            "one edge of paint is no texture"
        );
    }

    #[test]
    fn windows_without_room_give_nothing() {
        for length in 0..12 {
            let samples = vec![9; length];
            assert_eq!(Ridge::new(&samples, Kernel::PIXELS).peak(0..length), None);
        }
    }
}
