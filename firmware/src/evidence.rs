//! What accepted line-scans prove about the stripe. A proof is positive: whatever is not proven is a reason to stop.

use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::limits::{DEEPEST_ALLOWED_DROP, VOTE_FRAMES};
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::monitor::StripeReport;
use nearfield_shared::units::Micros;

/// The causes that only a line-scan can disprove.
pub const SCAN_CAUSES: StopCauses = StopCauses::NONE
    .with(StopCause::StripeCut)
    .with(StopCause::StripeMissing)
    .with(StopCause::LargeObject)
    .with(StopCause::Drop)
    .with(StopCause::HostRequest)
    .with(StopCause::Liveness)
    .with(StopCause::Audit)
    .with(StopCause::Misaligned)
    .with(StopCause::Capability);

/// The causes among them that a laser which is off on purpose brings about (arming). The host sees the dark as well, and
/// asks for a stop.
pub const DARK_CAUSES: StopCauses = StopCauses::NONE
    .with(StopCause::StripeCut)
    .with(StopCause::StripeMissing)
    .with(StopCause::LargeObject)
    .with(StopCause::Drop)
    .with(StopCause::HostRequest)
    .with(StopCause::Liveness);

/// What one accepted line-scan, with the votes over its predecessors, disproves. Kept twice, the second time
/// complemented: a proof that a flipped bit has made is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Evidence {
    taken: Micros,
    disproven: u32,
    complement: u32,
}

/// What other judges say of the same line-scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Assent {
    /// The light follows the laser's code.
    pub live: bool,
    /// Raw pixels bear the host's report out.
    pub believed: bool,
    /// The floor lies where it should.
    pub aligned: bool,
    /// Small objects are seen everywhere.
    pub capable: bool,
}

impl Evidence {
    /// When the line-scan was accepted, by the MCU's clock.
    #[must_use]
    pub const fn taken(&self) -> Micros {
        self.taken
    }

    /// The causes to stop that this line-scan proves absent; none if the memory of them is damaged.
    #[must_use]
    pub const fn disproven(&self) -> StopCauses {
        if self.disproven == !self.complement {
            StopCauses::from_bits(self.disproven)
        } else {
            StopCauses::NONE
        }
    }

    /// All of it, for the check of the controller's memory.
    pub(crate) fn words(&self) -> [u64; 2] {
        [self.taken.get(), u64::from(self.disproven) << 32 | u64::from(self.complement)]
    }

    /// The causes that it leaves standing.
    #[must_use]
    pub fn standing(&self) -> StopCauses {
        self.disproven().iter().fold(SCAN_CAUSES, StopCauses::without)
    }
}

/// Judges line-scan after line-scan; keeps the votes that the stripe monitor does not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Judge {
    /// Was the floor proven not to drop away, newest first? At start nothing is proven.
    no_drop: [bool; VOTE_FRAMES],
}

impl Judge {
    /// No line-scan yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { no_drop: [false; VOTE_FRAMES] }
    }

    /// Forgets all line-scans.
    pub const fn reset(&mut self) {
        *self = Self::new();
    }

    /// All of it, for the check of the controller's memory.
    pub(crate) fn word(&self) -> u64 {
        self.no_drop.iter().fold(1, |word, proven| (word << 8) | if *proven { 0xA5 } else { 0x5A })
    }

    /// What this line-scan proves.
    pub fn judge(
        &mut self,
        now: Micros,
        report: &StripeReport,
        verdict: HostVerdict,
        assent: Assent,
    ) -> Evidence {
        self.no_drop.rotate_right(1);
        if let Some(newest) = self.no_drop.first_mut() {
            // A depth that is not a number proves nothing.
            *newest = report.heights.lowest.is_none_or(|lowest| lowest.height >= DEEPEST_ALLOWED_DROP);
        }
        let proofs = self.no_drop.iter().filter(|proven| **proven).count();
        let disproven = StopCauses::NONE
            .with_if(StopCause::StripeCut, !report.is_cut())
            .with_if(StopCause::StripeMissing, !report.is_stripe_missing())
            .with_if(StopCause::LargeObject, !report.large)
            .with_if(StopCause::Drop, proofs.saturating_mul(2) > VOTE_FRAMES)
            .with_if(StopCause::HostRequest, is_free_of_objection(verdict))
            .with_if(StopCause::Liveness, assent.live)
            .with_if(StopCause::Audit, assent.believed)
            .with_if(StopCause::Misaligned, assent.aligned)
            .with_if(StopCause::Capability, assent.capable)
            .bits();
        Evidence { taken: now, disproven, complement: !disproven }
    }
}

impl Default for Judge {
    fn default() -> Self {
        Self::new()
    }
}

/// The host can add a stop, and nothing else.
const fn is_free_of_objection(verdict: HostVerdict) -> bool {
    match verdict {
        HostVerdict::Clear | HostVerdict::Warn => true,
        HostVerdict::Stop => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_shared::cutoff::{Cutoff, Gap};
    use nearfield_shared::height::{Extreme, Heights};
    use nearfield_shared::units::Millimetres;

    const ASSENT: Assent = Assent { live: true, believed: true, aligned: true, capable: true };

    /// A whole stripe on flat floor.
    fn whole() -> StripeReport {
        StripeReport {
            cutoff: Cutoff { voted: None, single: None, floor_columns: 900 },
            heights: Heights::default(),
            large: false,
            watched_columns: 900,
            passed: None,
        }
    }

    fn with_drop(depth: f32) -> StripeReport {
        let lowest = Extreme { height: Millimetres::new(depth), place: Millimetres::ZERO };
        StripeReport { heights: Heights { lowest: Some(lowest), ..Heights::default() }, ..whole() }
    }

    fn standing(judge: &mut Judge, report: &StripeReport, verdict: HostVerdict) -> StopCauses {
        let evidence = judge.judge(Micros::new(9), report, verdict, ASSENT);
        assert_eq!(evidence.taken(), Micros::new(9));
        assert_eq!(evidence.standing().union(evidence.disproven()), SCAN_CAUSES, "each cause is on one side");
        evidence.standing()
    }

    /// The causes that stand after three equal line-scans.
    fn settled(report: &StripeReport, verdict: HostVerdict) -> StopCauses {
        let mut judge = Judge::new();
        standing(&mut judge, report, verdict);
        standing(&mut judge, report, verdict);
        standing(&mut judge, report, verdict)
    }

    fn only(cause: StopCause) -> StopCauses {
        StopCauses::NONE.with(cause)
    }

    #[test]
    fn a_whole_stripe_disproves_every_cause() {
        assert_eq!(settled(&whole(), HostVerdict::Clear), StopCauses::NONE);
        assert_eq!(settled(&whole(), HostVerdict::Warn), StopCauses::NONE);
    }

    #[test]
    fn the_host_can_add_a_stop_and_nothing_else() {
        assert_eq!(settled(&whole(), HostVerdict::Stop), only(StopCause::HostRequest));
        let gap = Some(Gap::between(0.0, 6.0));
        let cut = StripeReport { cutoff: Cutoff { voted: gap, single: gap, floor_columns: 800 }, ..whole() };
        for verdict in [HostVerdict::Clear, HostVerdict::Warn, HostVerdict::Stop] {
            assert!(settled(&cut, verdict).contains(StopCause::StripeCut), "{verdict:?}");
        }
    }

    #[test]
    fn each_finding_of_the_monitor_has_its_cause() {
        let missing = StripeReport { cutoff: Cutoff { floor_columns: 0, ..Cutoff::default() }, ..whole() };
        assert_eq!(settled(&missing, HostVerdict::Clear), only(StopCause::StripeMissing));
        let large = StripeReport { large: true, ..whole() };
        assert_eq!(settled(&large, HostVerdict::Clear), only(StopCause::LargeObject));
        assert!(settled(&StripeReport::default(), HostVerdict::Clear).contains(StopCause::StripeCut));
    }

    #[test]
    fn each_judge_that_does_not_assent_has_its_cause() {
        let cases = [
            (Assent { live: false, ..ASSENT }, StopCause::Liveness),
            (Assent { believed: false, ..ASSENT }, StopCause::Audit),
            (Assent { aligned: false, ..ASSENT }, StopCause::Misaligned),
            (Assent { capable: false, ..ASSENT }, StopCause::Capability),
        ];
        for (assent, cause) in cases {
            let mut judge = Judge::new();
            let judged = [0; 3].map(|_| judge.judge(Micros::ZERO, &whole(), HostVerdict::Clear, assent));
            assert_eq!(judged[2].standing(), only(cause));
        }
    }

    #[test]
    fn evidence_that_was_damaged_in_memory_proves_nothing() {
        let mut judge = Judge::new();
        let good = [0; 3].map(|_| judge.judge(Micros::ZERO, &whole(), HostVerdict::Clear, ASSENT))[2];
        assert_eq!(good.standing(), StopCauses::NONE);
        for bit in 0..32 {
            let damaged = [
                Evidence { disproven: good.disproven ^ (1 << bit), ..good },
                Evidence { complement: good.complement ^ (1 << bit), ..good },
            ];
            for evidence in damaged {
                assert_eq!(evidence.disproven(), StopCauses::NONE);
                assert_eq!(evidence.standing(), SCAN_CAUSES);
            }
        }
        let all_zero = Evidence { taken: Micros::ZERO, disproven: 0, complement: 0 };
        let all_one = Evidence { taken: Micros::ZERO, disproven: u32::MAX, complement: u32::MAX };
        assert_eq!([all_zero, all_one].map(|evidence| evidence.disproven()), [StopCauses::NONE; 2]);
    }

    #[test]
    fn a_drop_stops_beyond_its_limit() {
        let limit = DEEPEST_ALLOWED_DROP.get();
        assert_eq!(settled(&with_drop(limit + 0.001), HostVerdict::Clear), StopCauses::NONE);
        assert_eq!(settled(&with_drop(limit), HostVerdict::Clear), StopCauses::NONE);
        assert_eq!(settled(&with_drop(limit - 0.001), HostVerdict::Clear), only(StopCause::Drop));
        assert_eq!(settled(&with_drop(f32::NAN), HostVerdict::Clear), only(StopCause::Drop), "unknown depth");
    }

    #[test]
    fn a_drop_needs_two_of_three_line_scans_and_so_does_its_end() {
        let (flat, deep) = (whole(), with_drop(-20.0));
        let mut judge = Judge::new();
        let mut drop = |report| standing(&mut judge, report, HostVerdict::Clear).contains(StopCause::Drop);
        assert!(drop(&flat), "one line-scan proves nothing yet");
        assert!(!drop(&flat));
        assert!(!drop(&flat));
        assert!(!drop(&deep), "one wild line-scan is outvoted");
        assert!(drop(&deep));
        assert!(drop(&flat), "two of the last three");
        assert!(!drop(&flat));
        judge.reset();
        assert_eq!(judge, Judge::new());
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let evidence =
            |taken, disproven, complement| Evidence { taken: Micros::new(taken), disproven, complement };
        let all = [evidence(1, 2, !2), evidence(2, 2, !2), evidence(1, 3, !2), evidence(1, 2, !3)];
        crate::testing::all_differ(all.map(|evidence| evidence.words()));
        let judges = (0..1_u32 << VOTE_FRAMES)
            .map(|bits| Judge { no_drop: core::array::from_fn(|frame| bits >> frame & 1 == 1) });
        crate::testing::all_differ(judges.map(|judge| judge.word()));
    }
}
