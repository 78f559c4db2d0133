//! The audit: this controller names columns that nobody can foresee, and looks for the stripe in their raw pixels.
//!
//! Every status names [`LARGEST_AUDIT_COUNT`] columns; the line-scan that answers it must carry their pixels, and
//! [`nearfield_shared::audit`] says whether they bear the reported rows out. Two tests run over the verdicts:
//!
//! * over the whole stripe: a contradiction adds [`AUDIT_CONTRADICTION`] to a doubt, a confirmation takes
//!   [`AUDIT_CONFIRMATION`] away; [`AUDIT_DOUBT_LIMIT`] stops (Wald's sequential test). A host that shifts all rows,
//!   answers nothing or the wrong columns stops with its **first** line-scan; one that invents floor over 60 mm of
//!   800 meets 0.6 contradictions a line-scan and stops after 11 on average;
//! * in each of 64 blocks: [`AUDIT_BLOCK_LIMIT`] contradictions without a confirmation between them. An invention of
//!   a single block's length is asked for every 8th line-scan and stops after 24 on average.
//!
//! An honest host is contradicted where a reflection outshines the stripe or its own filter bridges a gap. Up to one
//! window in 41 leaves the doubt at rest.

use crate::secret::{Secret, Use};
use core::ops::Range;
use nearfield_shared::audit::{AuditVerdict, judge};
use nearfield_shared::light::{BrightnessProfile, LIGHT_BLOCKS};
use nearfield_shared::limits::{
    AUDIT_BLOCK_LIMIT, AUDIT_CONFIRMATION, AUDIT_CONTRADICTION, AUDIT_DOUBT_LIMIT,
};
use nearfield_shared::linescan::{LARGEST_AUDIT_COUNT, LineScan};
use nearfield_shared::status::Challenge;

/// Confirmations that are needed before the host is believed at all.
pub const FEWEST_CONFIRMATIONS: u32 = 16;
/// Doubt grows no further.
const MOST_DOUBT: u16 = AUDIT_DOUBT_LIMIT.saturating_add(AUDIT_CONTRADICTION);

/// The columns that a status of this number asks for, out of those that watch the stripe.
#[must_use]
pub fn challenge(secret: &Secret, status_number: u32, watched: &Range<usize>) -> Challenge {
    let length = u32::try_from(watched.end.saturating_sub(watched.start)).unwrap_or(0);
    let first = u32::try_from(watched.start).unwrap_or(0);
    if length == 0 {
        return Challenge::default();
    }
    let counter = u64::from(status_number);
    let [a0, a1, a2, a3, a4, a5, a6, a7] = secret.word(Use::AuditFirst, counter).to_le_bytes();
    let [b0, b1, b2, b3, b4, b5, b6, b7] = secret.word(Use::AuditSecond, counter).to_le_bytes();
    let lots = [[a0, a1], [a2, a3], [a4, a5], [a6, a7], [b0, b1], [b2, b3], [b4, b5], [b6, b7]];
    // A 16-bit lot scaled to the range: each column comes as often as any other to within 2 per cent.
    let column = |lot: [u8; 2]| {
        let scaled = u32::from(u16::from_le_bytes(lot)).saturating_mul(length) >> 16;
        u16::try_from(first.saturating_add(scaled)).unwrap_or(u16::MAX)
    };
    Challenge { count: 8, columns: lots.map(column) }
}

const _: () = assert!(LARGEST_AUDIT_COUNT == 8, "a challenge is eight lots");

/// Keeps the doubts; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Auditor {
    doubt: u16,
    blocks: [u8; LIGHT_BLOCKS],
    confirmed: u32,
    contradicted: u32,
    /// Confirmations since start or since [`Self::forget`].
    recent: u32,
}

impl Auditor {
    /// Nothing is confirmed yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { doubt: 0, blocks: [0; LIGHT_BLOCKS], confirmed: 0, contradicted: 0, recent: 0 }
    }

    /// Earlier confirmations no longer count; doubts do.
    pub const fn forget(&mut self) {
        self.recent = 0;
    }

    /// Judges a line-scan's windows against the challenge that it answers.
    pub fn judge(&mut self, scan: &LineScan<'_>, challenge: &Challenge) {
        let mut windows = scan.audit_windows();
        for asked in challenge.columns {
            let verdict = match windows.next().filter(|window| window.column == asked) {
                Some(window) => judge(&window, scan.column(asked)),
                None => AuditVerdict::Contradicted,
            };
            self.count(usize::from(asked), scan.column_count(), verdict);
        }
    }

    fn count(&mut self, column: usize, columns: usize, verdict: AuditVerdict) {
        let block = self.blocks.get_mut(BrightnessProfile::block_of(column, columns));
        match verdict {
            AuditVerdict::Confirmed => {
                self.doubt = self.doubt.saturating_sub(AUDIT_CONFIRMATION);
                self.confirmed = self.confirmed.saturating_add(1);
                self.recent = self.recent.saturating_add(1);
                if let Some(block) = block {
                    *block = 0;
                }
            }
            AuditVerdict::Contradicted => {
                self.doubt = self.doubt.saturating_add(AUDIT_CONTRADICTION).min(MOST_DOUBT);
                self.contradicted = self.contradicted.saturating_add(1);
                if let Some(block) = block {
                    *block = block.saturating_add(1).min(AUDIT_BLOCK_LIMIT);
                }
            }
            AuditVerdict::NothingClaimed => {}
        }
    }

    /// Is the host's word borne out by its pixels?
    #[must_use]
    pub fn is_believed(&self) -> bool {
        self.recent >= FEWEST_CONFIRMATIONS
            && self.doubt < AUDIT_DOUBT_LIMIT
            && self.blocks.iter().all(|block| *block < AUDIT_BLOCK_LIMIT)
    }

    /// The doubt over the whole stripe.
    #[must_use]
    pub const fn doubt(&self) -> u16 {
        self.doubt
    }

    /// Windows confirmed and contradicted since start.
    #[must_use]
    pub const fn counts(&self) -> [u32; 2] {
        [self.confirmed, self.contradicted]
    }

    /// What it rests on, for the check of the controller's memory.
    pub(crate) fn words(&self) -> impl Iterator<Item = u64> + '_ {
        let (blocks, _) = self.blocks.as_chunks::<8>();
        let scores = [u64::from(self.doubt), u64::from(self.recent)];
        scores.into_iter().chain(blocks.iter().map(|bytes| u64::from_le_bytes(*bytes)))
    }
}

impl Default for Auditor {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{COLUMNS, header, honest_windows, message_with};
    use nearfield_shared::linescan::{AuditWindow, LineScanColumn};
    use nearfield_shared::units::{CalibrationId, SignalQuality, SubpixelRow};

    const WATCHED: Range<usize> = 20..620;

    fn asked(number: u32) -> Challenge {
        challenge(&Secret::new([9; 16]), number, &WATCHED)
    }

    fn column(row: f32) -> LineScanColumn {
        LineScanColumn { row: SubpixelRow::from_pixels(row).unwrap(), quality: SignalQuality::BEST }
    }

    /// A line-scan of these columns, with these windows; judged.
    fn judged(
        auditor: &mut Auditor,
        columns: &[LineScanColumn],
        windows: &[AuditWindow],
        challenge: &Challenge,
    ) {
        let bytes = message_with(&header(1, 1, CalibrationId::new(1)), columns, windows);
        auditor.judge(&LineScan::parse(&bytes).unwrap(), challenge);
    }

    /// A host that reports `claim` in every column and whose pixels show `truth`.
    fn frames_until_disbelief(claim: impl Fn(usize) -> f32, truth: impl Fn(usize) -> f32) -> u32 {
        let mut auditor = Auditor::new();
        let floor = vec![column(200.0); COLUMNS];
        for number in 0..3 {
            judged(&mut auditor, &floor, &honest_windows(&asked(number), |_| 200.0), &asked(number));
        }
        assert!(auditor.is_believed());
        let columns: Vec<_> = (0..COLUMNS).map(|index| column(claim(index))).collect();
        for frame in 1..=2_000 {
            let challenge = asked(100 + frame);
            let windows = honest_windows(&challenge, &truth)
                .into_iter()
                .map(|window| AuditWindow {
                    first_row: nearfield_shared::audit::first_row_for(claim(usize::from(window.column))),
                    ..window
                })
                .zip(challenge.columns)
                .map(|(window, at)| {
                    let shown = honest_windows(&Challenge { count: 8, columns: [at; 8] }, &truth);
                    // The window lies where the claim is; its pixels are the truth's.
                    let offset = i32::from(window.first_row) - i32::from(shown[0].first_row);
                    let pixels = core::array::from_fn(|row| {
                        usize::try_from(row as i32 + offset)
                            .ok()
                            .and_then(|row| shown[0].pixels.get(row))
                            .copied()
                            .unwrap_or(100)
                    });
                    AuditWindow { pixels, ..window }
                })
                .collect::<Vec<_>>();
            judged(&mut auditor, &columns, &windows, &challenge);
            if !auditor.is_believed() {
                return frame;
            }
        }
        u32::MAX
    }

    #[test]
    fn challenges_lie_among_the_watched_columns_and_differ() {
        let mut seen = std::collections::BTreeMap::new();
        for number in 0..20_000 {
            let challenge = asked(number);
            assert_eq!(challenge.count, 8);
            for column in challenge.columns {
                assert!(WATCHED.contains(&usize::from(column)));
                *seen.entry(column).or_insert(0_u32) += 1;
            }
        }
        assert_eq!(seen.len(), WATCHED.len(), "every column is asked for");
        let (least, most) = (seen.values().min().unwrap(), seen.values().max().unwrap());
        assert!(*least > 180 && *most < 360, "about 267 times each: {least} to {most}");
        assert_ne!(asked(1), asked(2));
        assert_ne!(asked(1), challenge(&Secret::new([8; 16]), 1, &WATCHED), "another secret");
        assert_eq!(challenge(&Secret::NONE, 1, &(5..5)), Challenge::default(), "nothing to ask for");
    }

    #[test]
    fn an_honest_host_is_believed_after_its_first_confirmations() {
        let mut auditor = Auditor::new();
        assert!(!auditor.is_believed());
        let floor = vec![column(200.0); COLUMNS];
        judged(&mut auditor, &floor, &honest_windows(&asked(0), |_| 200.0), &asked(0));
        assert!(!auditor.is_believed(), "8 of 16");
        judged(&mut auditor, &floor, &honest_windows(&asked(1), |_| 200.0), &asked(1));
        assert!(auditor.is_believed());
        assert_eq!((auditor.counts(), auditor.doubt()), ([16, 0], 0));
        auditor.forget();
        assert!(!auditor.is_believed(), "it must confirm anew");
    }

    #[test]
    fn no_answer_the_wrong_columns_and_shifted_rows_stop_with_the_first_line_scan() {
        let floor = vec![column(200.0); COLUMNS];
        let cases: [(&str, Vec<AuditWindow>); 2] =
            [("no answer", vec![]), ("other columns", honest_windows(&asked(7), |_| 200.0))];
        for (what, windows) in cases {
            let mut auditor = Auditor::new();
            for number in 0..3 {
                judged(&mut auditor, &floor, &honest_windows(&asked(number), |_| 200.0), &asked(number));
            }
            judged(&mut auditor, &floor, &windows, &asked(3));
            assert!(!auditor.is_believed(), "{what}");
            assert_eq!(auditor.doubt(), AUDIT_DOUBT_LIMIT + AUDIT_CONTRADICTION, "{what}: and no further");
        }
        assert_eq!(frames_until_disbelief(|_| 195.0, |_| 200.0), 1, "shifted by five rows");
    }

    #[test]
    fn an_invented_floor_is_found_within_the_stated_line_scans() {
        // 45 of 600 columns: 60 mm of 800. The object shows the stripe 40 rows away.
        let lifted = |column: usize| if (200..245).contains(&column) { 240.0 } else { 200.0 };
        let frames = frames_until_disbelief(|_| 200.0, lifted);
        assert!(frames <= 25, "60 mm: {frames}");
        // One block's length (10 columns).
        let lifted = |column: usize| if (200..210).contains(&column) { 240.0 } else { 200.0 };
        let frames = frames_until_disbelief(|_| 200.0, lifted);
        assert!(frames <= 60, "one block: {frames}");
    }

    #[test]
    fn rare_contradictions_do_not_add_up() {
        let mut auditor = Auditor::new();
        for _ in 0..FEWEST_CONFIRMATIONS {
            auditor.count(3, COLUMNS, AuditVerdict::Confirmed);
        }
        for round in 0..1_000 {
            auditor.count(round % COLUMNS, COLUMNS, AuditVerdict::Contradicted);
            for index in 0..41 {
                auditor.count((round * 41 + index * 15) % COLUMNS, COLUMNS, AuditVerdict::Confirmed);
            }
        }
        assert!(auditor.doubt() <= AUDIT_CONTRADICTION);
    }

    #[test]
    fn the_limits_of_doubt_hold_on_both_sides() {
        let believed_after = |verdicts: &[(usize, AuditVerdict)]| {
            let mut auditor = Auditor::new();
            for _ in 0..FEWEST_CONFIRMATIONS {
                auditor.count(639, COLUMNS, AuditVerdict::Confirmed);
            }
            for (column, verdict) in verdicts {
                auditor.count(*column, COLUMNS, *verdict);
            }
            auditor.is_believed()
        };
        let spread =
            |count: usize| (0..count).map(|at| (at * 20, AuditVerdict::Contradicted)).collect::<Vec<_>>();
        let most = usize::from(AUDIT_DOUBT_LIMIT / AUDIT_CONTRADICTION);
        assert!(believed_after(&spread(most - 1)));
        assert!(!believed_after(&spread(most)));
        let mut excused = spread(most);
        excused.push((639, AuditVerdict::Confirmed));
        assert!(believed_after(&excused), "one below the limit");
        let here = |count: usize| vec![(5, AuditVerdict::Contradicted); count];
        assert!(believed_after(&here(usize::from(AUDIT_BLOCK_LIMIT) - 1)));
        assert!(!believed_after(&here(usize::from(AUDIT_BLOCK_LIMIT))));
        let mut excused = here(9);
        excused.extend([(5, AuditVerdict::Confirmed); 200]);
        assert!(believed_after(&excused), "the block is good again, and the doubt has limits");
        assert!(!believed_after(&[
            (5, AuditVerdict::NothingClaimed),
            (5, AuditVerdict::Contradicted),
            (6, AuditVerdict::Contradicted),
            (7, AuditVerdict::Contradicted)
        ]));
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let new = Auditor::new;
        let mut all = vec![new(), Auditor { doubt: 1, ..new() }, Auditor { recent: 1, ..new() }];
        for block in 0..LIGHT_BLOCKS {
            let mut auditor = new();
            auditor.blocks[block] = 1;
            all.push(auditor);
        }
        crate::testing::all_differ(all.iter().map(|auditor| auditor.words().collect::<Vec<_>>()));
    }
}
