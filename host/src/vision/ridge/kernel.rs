//! The lengths that a search for a ridge works with.

use super::{MOST_REACH, MOST_ROWS_ASIDE};

/// Farthest background that is near, see [`Kernel::near`].
pub(super) const MOST_NEAR: usize = 24;

/// Lengths that follow from how wide a stripe appears, in samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kernel {
    /// Half the length of the running sum that detects the stripe.
    pub half: usize,
    /// Nearest distance at which the background is looked for.
    pub near: usize,
    /// Farthest such distance.
    pub far: usize,
}

impl Kernel {
    /// For a stripe of this width at half of its height, samples.
    #[must_use]
    pub fn for_width(width: f32) -> Self {
        let width = if width.is_finite() { width.clamp(1.5, 18.0) } else { 1.5 };
        let half = ((width - 1.0) / 2.0).round().max(1.0) as usize;
        let near = (half + (width * 0.8).ceil() as usize + 1).min(MOST_NEAR);
        let far = near + 3 * (2 * half + 1);
        Self { half, near, far: far.min(MOST_ROWS_ASIDE - MOST_REACH - half) }
    }

    /// For stripes that are too wide for this one: clipped, or out of focus.
    #[must_use]
    pub fn widened(&self) -> Self {
        let half = (2 * self.half).min(10);
        let near = (2 * self.near).min(MOST_NEAR);
        Self { half, near, far: near + 3 * (2 * half + 1).min(7) }
    }

    /// For stripes with something else close by.
    #[must_use]
    pub fn refined(&self) -> Self {
        let half = if self.half > 1 { self.half - 1 } else { 1 };
        let near = if self.near > 3 { self.near - (self.near + 2) / 4 } else { self.near };
        Self { half, near, far: (near + 2 * (2 * half + 1)).min(self.far) }
    }

    /// The widest stripe that leaves the background free.
    #[must_use]
    pub const fn widest(&self) -> usize {
        2 * (self.near - self.half) + 1
    }

    /// Samples in the running sum.
    #[must_use]
    pub const fn length(&self) -> usize {
        2 * self.half + 1
    }

    /// Rows to both sides of the middle that a search for crests up to `reach` needs.
    #[must_use]
    pub const fn rows_aside(&self, reach: usize) -> usize {
        self.far + self.half + reach
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_of_all_widths_fit_into_a_block() {
        for width in [f32::NAN, 0.0, 1.0, 2.5, 5.0, 9.0, 18.0, 500.0, f32::INFINITY] {
            let kernel = Kernel::for_width(width);
            assert!(kernel.near > kernel.half && kernel.near <= MOST_NEAR, "{width}: {kernel:?}");
            for kernel in [kernel, kernel.refined()] {
                assert!(kernel.far > kernel.near, "{width}: {kernel:?}");
                assert!(kernel.rows_aside(MOST_REACH) <= MOST_ROWS_ASIDE, "{width}: {kernel:?}");
            }
            let wide = kernel.widened();
            assert!(MOST_ROWS_ASIDE - MOST_REACH - wide.half > wide.near, "{width}: {wide:?}");
        }
    }
}
