//! The self-injected demand at arming: before the relays close, the laser goes dark, and the line-scans must show it.
//!
//! A chain from camera to decision that shows a stripe where there is no light would never find a stripe that is cut.
//! So a press of the reset button does not close the relays; it turns the laser off. Pictures that were exposed
//! wholly in the dark must be judged as a cut stripe of full length; [`DARK_PROOFS`] of them prove it, one that still
//! shows floor denies it.

use nearfield_shared::limits::{DARK_FLOOR_DIVISOR, DARK_PROOFS, IMMEDIATE_GAP};
use nearfield_shared::monitor::StripeReport;

/// What the dark pictures say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DarkVerdict {
    /// Not enough of them yet.
    Waiting,
    /// The dark was seen as dark.
    Proven,
    /// A stripe was seen where there was no light.
    Denied,
}

/// Counts dark pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DarkTest {
    proofs: u8,
    denied: bool,
}

impl DarkTest {
    /// None yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { proofs: 0, denied: false }
    }

    /// A picture that was exposed while the laser was off.
    pub fn observe(&mut self, report: &StripeReport) {
        if is_dark(report) {
            self.proofs = self.proofs.saturating_add(1);
        } else {
            self.denied = true;
        }
    }

    /// What they come to.
    #[must_use]
    pub const fn verdict(&self) -> DarkVerdict {
        if self.denied {
            DarkVerdict::Denied
        } else if self.proofs >= DARK_PROOFS {
            DarkVerdict::Proven
        } else {
            DarkVerdict::Waiting
        }
    }

    /// What it rests on, for the check of the controller's memory.
    pub(crate) const fn word(&self) -> u64 {
        u64::from_le_bytes([self.proofs, if self.denied { 0xA5 } else { 0 }, 0, 0, 0, 0, 0, 0])
    }
}

impl Default for DarkTest {
    fn default() -> Self {
        Self::new()
    }
}

/// A cut that trips at once, over all but a chance few of the columns.
fn is_dark(report: &StripeReport) -> bool {
    let cut = report.cutoff.single.is_some_and(|gap| gap.length() > IMMEDIATE_GAP);
    cut && report.cutoff.floor_columns.saturating_mul(DARK_FLOOR_DIVISOR) <= report.watched_columns
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_shared::cutoff::{Cutoff, Gap};
    use nearfield_shared::height::Heights;

    fn report(floor_columns: u16, gap: Option<f32>) -> StripeReport {
        let single = gap.map(|length| Gap::between(0.0, length));
        StripeReport {
            cutoff: Cutoff { voted: None, single, floor_columns },
            heights: Heights::default(),
            large: false,
            watched_columns: 1000,
            passed: None,
        }
    }

    #[test]
    fn enough_dark_pictures_prove_it() {
        let mut test = DarkTest::new();
        for _ in 0..DARK_PROOFS {
            assert_eq!(test.verdict(), DarkVerdict::Waiting);
            test.observe(&report(0, Some(700.0)));
        }
        assert_eq!(test.verdict(), DarkVerdict::Proven);
    }

    #[test]
    fn one_stripe_in_the_dark_denies_it() {
        for proofs in 0..=DARK_PROOFS {
            let mut test = DarkTest::new();
            (0..proofs).for_each(|_| test.observe(&report(0, Some(700.0))));
            test.observe(&report(1000, None));
            test.observe(&report(0, Some(700.0)));
            assert_eq!(test.verdict(), DarkVerdict::Denied);
        }
    }

    #[test]
    fn chance_columns_are_allowed_up_to_their_share_and_the_gap_must_trip_at_once() {
        let verdict = |floor: u16, gap: f32| {
            let mut test = DarkTest::new();
            test.observe(&report(floor, Some(gap)));
            test.verdict()
        };
        assert_eq!(verdict(50, 700.0), DarkVerdict::Waiting);
        assert_eq!(verdict(51, 700.0), DarkVerdict::Denied);
        assert_eq!(verdict(u16::MAX, 700.0), DarkVerdict::Denied);
        let limit = IMMEDIATE_GAP.get();
        assert_eq!(verdict(0, limit), DarkVerdict::Denied);
        assert_eq!(verdict(0, limit.next_up()), DarkVerdict::Waiting);
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let all = [(0, false), (1, false), (DARK_PROOFS, false), (0, true), (1, true)];
        crate::testing::all_differ(all.map(|(proofs, denied)| DarkTest { proofs, denied }.word()));
    }
}
