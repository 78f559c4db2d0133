//! The run-over permit: which stretches of the stripe may small debris pass, and for how long.
//!
//! Off unless the stored rig allows it. The host can only *claim* (see [`nearfield_shared::run_over`]); a permit needs,
//! all at once:
//!
//! 1. the rig allows run-over, and the robot is running: nothing is permitted while arming or stopped;
//! 2. claims that speak for it (category, confidence, age, length of each and of all together) for the same stretch and category in
//!    [`RUN_OVER_AGREEMENT`] consecutive line-scans, and not one objection in the newest: no person anywhere, nothing else
//!    beside it;
//! 3. the controller's own height of every column, which the stripe monitor asks for column by column: below
//!    [`RUN_OVER_HEIGHT`](nearfield_shared::limits::RUN_OVER_HEIGHT), and seen. What is missing, higher or below the floor
//!    stays cut, whatever is claimed;
//! 4. time: [`LONGEST_RUN_OVER`] from its first use, and then only anew once the stripe has been whole without any permit.
//!
//! Everything else that stops goes on stopping: large objects, drops, the host's own stop, the light, the audit.

use nearfield_shared::cutoff::Gap;
use nearfield_shared::limits::{LONGEST_RUN_OVER, LONGEST_RUN_OVER_STRETCH, RUN_OVER_AGREEMENT, VOTE_FRAMES};
use nearfield_shared::monitor::StripeReport;
use nearfield_shared::run_over::{Claim, Claims, LARGEST_CLAIM_COUNT, NO_CLAIMS, RunOverPermit, Stretch};
use nearfield_shared::status::PermitInUse;
use nearfield_shared::units::{Micros, Millimetres};

/// Line-scans before the newest one whose claims must agree with it.
const EARLIER: usize = RUN_OVER_AGREEMENT - 1;

/// Permits of one controller, line-scan by line-scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunOver {
    allowed: bool,
    /// Claims of the line-scans before, newest first.
    earlier: [Claims; EARLIER],
    used_since: Option<Micros>,
    /// Line-scans without a cut and without anything that passed, in a row, up to [`VOTE_FRAMES`].
    whole: usize,
}

impl RunOver {
    /// No claim yet; `allowed` by the rig.
    #[must_use]
    pub const fn new(allowed: bool) -> Self {
        Self { allowed, earlier: [NO_CLAIMS; EARLIER], used_since: None, whole: 0 }
    }

    /// Forgets all claims (after a silence of the link): agreement begins anew. A permit's time goes on.
    pub const fn forget(&mut self) {
        self.earlier = [NO_CLAIMS; EARLIER];
    }

    /// What may pass in the line-scan that is about to be judged, and which carries these claims.
    pub fn permit(&mut self, now: Micros, running: bool, claims: &Claims) -> RunOverPermit {
        let mut permit = RunOverPermit::NONE;
        let in_time = self.used_since.is_none_or(|since| now.since(since) <= LONGEST_RUN_OVER);
        if self.allowed && running && in_time {
            for (slot, claim) in permit.stretches.iter_mut().zip(claims) {
                *slot = claim.and_then(|claim| self.agreed(&claim, claims));
            }
        }
        // Pieces side by side are no debris either.
        let lengths = permit.stretches.iter().flatten().map(|stretch| stretch.length());
        if lengths.fold(Millimetres::ZERO, Millimetres::plus) > LONGEST_RUN_OVER_STRETCH {
            permit = RunOverPermit::NONE;
        }
        self.earlier.rotate_right(1);
        if let Some(newest) = self.earlier.first_mut() {
            *newest = *claims;
        }
        permit
    }

    /// The part of a claim's stretch that every earlier line-scan claims as the same and nothing objects to.
    fn agreed(&self, claim: &Claim, claims: &Claims) -> Option<Stretch> {
        if !claim.speaks_for_run_over() {
            return None;
        }
        let mut stretch = claim.stretch;
        for before in &self.earlier {
            let same = |earlier: &Claim| {
                let speaks = earlier.category == claim.category && earlier.speaks_for_run_over();
                stretch.shared_with(earlier.stretch).filter(|_| speaks)
            };
            stretch = before.iter().flatten().find_map(same)?;
        }
        let objected = claims.iter().flatten().any(|other| other.objects_to(stretch));
        (!objected).then_some(stretch)
    }

    /// What the line-scan has shown under the permit.
    pub fn observe(&mut self, now: Micros, report: &StripeReport) {
        if report.passed.is_some() {
            self.used_since = self.used_since.or(Some(now));
        }
        if report.passed.is_some() || report.cutoff.voted.is_some() {
            self.whole = 0;
            return;
        }
        self.whole = self.whole.saturating_add(1).min(VOTE_FRAMES);
        if self.whole == VOTE_FRAMES {
            self.used_since = None;
        }
    }

    /// The permit in use after a line-scan, as the status tells it.
    #[must_use]
    pub fn in_use(&self, now: Micros, passed: Option<Gap>) -> Option<PermitInUse> {
        let (stretch, since) = (passed?, self.used_since?);
        let time_left = Micros::new(LONGEST_RUN_OVER.get().saturating_sub(now.since(since).get()));
        // In its last microsecond it is still in use.
        Some(PermitInUse { stretch, time_left: time_left.max(Micros::new(1)) })
    }

    /// All of it, for the check of the controller's memory.
    pub(crate) fn words(&self) -> [u64; 2 + 2 * EARLIER * LARGEST_CLAIM_COUNT] {
        let mut words = [0; 2 + 2 * EARLIER * LARGEST_CLAIM_COUNT];
        let head = [
            self.used_since.map_or(u64::MAX, Micros::get),
            u64::try_from(self.whole).unwrap_or(u64::MAX) << 8 | if self.allowed { 0xA5 } else { 0x5A },
        ];
        let slots = self.earlier.iter().flatten();
        let claims = slots.flat_map(|slot| slot.as_ref().map_or([0; 2], Claim::words));
        for (word, value) in words.iter_mut().zip(head.into_iter().chain(claims)) {
            *word = value;
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_shared::action::Category;
    use nearfield_shared::cutoff::Cutoff;
    use nearfield_shared::limits::{LEAST_CLAIM_CONFIDENCE, LONGEST_CLAIM_AGE};

    const FRAME: u64 = 20_000;

    fn stretch(start: i16, end: i16) -> Stretch {
        Stretch::new(start, end).unwrap()
    }

    fn tool(start: i16, end: i16) -> Claim {
        let age = Micros::from_millis(50);
        Claim { stretch: stretch(start, end), category: Category::Tool, confidence: 250, age }
    }

    fn only(claim: Claim) -> Claims {
        [None, Some(claim), None, None]
    }

    fn report(passed: bool, cut: bool) -> StripeReport {
        let voted = cut.then(|| Gap::between(0.0, 9.0));
        let cutoff = Cutoff { voted, single: voted, floor_columns: 900 };
        StripeReport { cutoff, passed: passed.then(|| Gap::between(3.0, 8.0)), ..StripeReport::default() }
    }

    /// Shows the same claims in enough line-scans; the last permit.
    fn settled(run_over: &mut RunOver, running: bool, claims: &Claims) -> RunOverPermit {
        (0..RUN_OVER_AGREEMENT as u64)
            .map(|frame| run_over.permit(Micros::new(frame * FRAME), running, claims))
            .last()
            .unwrap()
    }

    /// The whole truth table of what the permit depends on, but the heights, which are the stripe monitor's.
    #[test]
    fn every_combination_but_one_kind_permits_nothing() {
        let objections = [
            None,
            Some(Claim { category: Category::Human, confidence: 0, ..tool(900, 950) }),
            Some(Claim { category: Category::Part, ..tool(60, 90) }),
            Some(Claim { category: Category::Part, ..tool(500, 600) }),
        ];
        let mut permits = 0;
        for case in 0..8 * 2_usize.pow(6) * 4 {
            let category = Category::ALL[case % 8];
            let bit = |index: u32| (case / 8) >> index & 1 == 1;
            let (allowed, running, sure, fresh, short, agreed) =
                (bit(0), bit(1), bit(2), bit(3), bit(4), bit(5));
            let objection = objections[case / 8 / 64];
            let end = if short { 40 } else { 201 };
            let confidence = LEAST_CLAIM_CONFIDENCE - u8::from(!sure);
            let age = LONGEST_CLAIM_AGE.plus(Micros::new(u64::from(!fresh)));
            let claim = Claim { category, confidence, age, ..tool(0, end) };
            let claims = [Some(claim), None, None, objection];
            let mut run_over = RunOver::new(allowed);
            run_over.permit(Micros::ZERO, running, &if agreed { claims } else { NO_CLAIMS });
            run_over.permit(Micros::new(FRAME), running, &claims);
            let permit = run_over.permit(Micros::new(2 * FRAME), running, &claims);
            let category_passes = matches!(category, Category::Tool | Category::Material);
            let unopposed = matches!(case / 8 / 64, 0 | 3);
            let expected =
                allowed && running && sure && fresh && short && agreed && category_passes && unopposed;
            assert_eq!(permit.stretches[0], expected.then(|| stretch(0, end)), "{case}");
            assert_eq!(permit.is_none(), !expected);
            permits += u32::from(expected);
        }
        assert_eq!(permits, 4, "tool and material, with no objection and with one far away");
    }

    #[test]
    fn three_line_scans_must_agree_on_place_and_category() {
        let mut run_over = RunOver::new(true);
        let mut show = |claims: Claims| run_over.permit(Micros::ZERO, true, &claims);
        assert!(show(only(tool(0, 30))).is_none());
        assert!(show(only(tool(10, 40))).is_none());
        let permit = show([Some(tool(20, 50)), None, None, None]);
        assert_eq!(permit.stretches, [Some(stretch(20, 30)), None, None, None], "what all three have");
        assert!(show(only(tool(45, 60))).is_none(), "elsewhere");
        show(only(tool(45, 60)));
        assert!(!show(only(tool(45, 60))).is_none());
        let material = Claim { category: Category::Material, ..tool(45, 60) };
        assert!(show(only(material)).is_none(), "something else");
        assert!(show(only(material)).is_none());
        assert!(!show(only(material)).is_none());
        assert!(show(NO_CLAIMS).is_none());
        assert!(show(only(material)).is_none(), "one line-scan without it");
        run_over.forget();
        assert_eq!(run_over, RunOver::new(true));
    }

    #[test]
    fn pieces_side_by_side_are_no_longer_than_one() {
        let pieces = |length: i16| [Some(tool(0, 100)), Some(tool(400, 400 + length)), None, None];
        assert!(!settled(&mut RunOver::new(true), true, &pieces(100)).is_none());
        assert!(settled(&mut RunOver::new(true), true, &pieces(101)).is_none());
    }

    #[test]
    fn time_runs_from_the_first_use_and_ends_the_permit() {
        let mut run_over = RunOver::new(true);
        let claims = only(tool(0, 40));
        settled(&mut run_over, true, &claims);
        let first = Micros::new(1_000_000);
        assert_eq!(run_over.in_use(first, Some(Gap::between(3.0, 8.0))), None, "permitted, not used");
        run_over.observe(first, &report(true, false));
        let last = first.plus(LONGEST_RUN_OVER);
        let told = |now, run_over: &RunOver| run_over.in_use(now, Some(Gap::between(3.0, 8.0)));
        assert_eq!(told(first, &run_over).unwrap().time_left, LONGEST_RUN_OVER);
        assert!(!run_over.permit(last, true, &claims).is_none());
        run_over.observe(last, &report(true, false));
        assert_eq!(told(last, &run_over).unwrap().time_left, Micros::new(1));
        assert_eq!(run_over.in_use(last, None), None, "nothing passes");
        assert!(run_over.permit(last.plus(Micros::new(1)), true, &claims).is_none());
    }

    #[test]
    fn a_new_permit_needs_a_whole_stripe_between() {
        let claims = only(tool(0, 40));
        for (passed, cut) in [(true, false), (false, true)] {
            let mut run_over = RunOver::new(true);
            settled(&mut run_over, true, &claims);
            run_over.observe(Micros::ZERO, &report(true, false));
            let late = LONGEST_RUN_OVER.plus(Micros::new(1));
            for frame in 0..3 * VOTE_FRAMES {
                // Twice whole, then not.
                let whole = frame % VOTE_FRAMES < VOTE_FRAMES - 1;
                run_over.observe(late, &if whole { report(false, false) } else { report(passed, cut) });
                assert!(run_over.permit(late, true, &claims).is_none(), "frame {frame}");
            }
            for frame in 1..=VOTE_FRAMES {
                run_over.observe(late, &report(false, false));
                assert_eq!(run_over.permit(late, true, &claims).is_none(), frame < VOTE_FRAMES);
            }
        }
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let with = |change: fn(&mut RunOver)| {
            let mut run_over = RunOver::new(true);
            change(&mut run_over);
            run_over
        };
        let all = [
            with(|_| {}),
            with(|run_over| run_over.allowed = false),
            with(|run_over| run_over.whole = 1),
            with(|run_over| run_over.used_since = Some(Micros::ZERO)),
            with(|run_over| run_over.earlier[0][0] = Some(tool(0, 1))),
            with(|run_over| run_over.earlier[1][0] = Some(tool(0, 1))),
            with(|run_over| run_over.earlier[0][1] = Some(tool(0, 1))),
            with(|run_over| run_over.earlier[0][0] = Some(Claim { category: Category::Human, ..tool(0, 1) })),
            with(|run_over| run_over.earlier[0][0] = Some(Claim { confidence: 1, ..tool(0, 1) })),
            with(|run_over| run_over.earlier[0][0] = Some(Claim { age: Micros::ZERO, ..tool(0, 1) })),
        ];
        crate::testing::all_differ(all.map(|run_over| run_over.words()));
    }
}
