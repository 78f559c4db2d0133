//! A fetched stop, decided again: the line-scans through the controller's own stripe monitor, and the limit by name.
//!
//! The three newest line-scans up to the stop are those of the vote, so the third one's verdict is the controller's own,
//! bit for bit. [`Replay::mismatches`] says where it is not: then recording and firmware do not belong together.
//! Causes that no line-scan can show (the link's, the relays', the self-tests') are told from the summaries.

use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::columns::{Decimation, GeometryError};
use nearfield_shared::limits::{
    AUDIT_DOUBT_LIMIT, DEEPEST_ALLOWED_DROP, IMMEDIATE_GAP, LARGE_HEIGHT, LARGEST_COLUMN_COUNT,
    LARGEST_SEQUENCE_STEP, LINK_TIMEOUT, LIVENESS_DOUBT_LIMIT, LONGEST_ALLOWED_GAP, LONGEST_CAPTURE_AGE,
    LONGEST_MESSAGE_AGE, VOTE_FRAMES,
};
use nearfield_shared::linescan::{HostVerdict, LineScan, LineScanError};
use nearfield_shared::monitor::{StripeMonitor, StripeReport};
use nearfield_shared::rig::CompactRigError;
use nearfield_shared::service::{ExchangeKind, Summary};
use nearfield_shared::units::{CalibrationId, Micros, Millimetres};
use nearfield_shared::wire::seal_of;
use serde::Serialize;

use super::recording::Recording;

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// There is no usable rig in it.
    #[error("the recording cannot be replayed: {0}; give the rig with --rig RIG.toml")]
    Rig(CompactRigError),
    /// The rig is not the one that was in use.
    #[error(
        "the recording was made with the rig {used:08x}, not with {given:08x}; give the right one with --rig RIG.toml"
    )]
    OtherRig {
        /// The calibration id at the stop.
        used: u32,
        /// The calibration id of the rig at hand.
        given: u32,
    },
    /// The rig yields no column maps.
    #[error("the recording's rig cannot be used: {0}")]
    Geometry(GeometryError),
    /// A kept line-scan is none.
    #[error("line-scan {number} of the recording is unreadable: {problem}")]
    LineScan {
        /// Which, from 1.
        number: usize,
        /// What is wrong with it.
        problem: LineScanError,
    },
}

/// One line-scan, judged again.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReplayedScan {
    /// Its sequence number.
    pub sequence: u32,
    /// Time of its summary to the stop, milliseconds; `None` without a summary.
    pub t_ms: Option<f64>,
    /// It came after the stop.
    pub after_stop: bool,
    /// The vote over this and the two line-scans before it is complete, as it was in the controller.
    pub vote_complete: bool,
    /// Longest gap of the vote, millimetres; `None` = whole.
    pub voted_gap_mm: Option<f32>,
    /// Longest gap of this line-scan alone.
    pub single_gap_mm: Option<f32>,
    /// Highest point, millimetres.
    pub highest_mm: Option<f32>,
    /// Lowest point, millimetres.
    pub lowest_mm: Option<f32>,
    /// Place along the stripe and height of every watched column, millimetres; no height = no stripe.
    pub profile: Vec<(f32, Option<f32>)>,
    #[serde(skip)]
    pub(super) report: StripeReport,
}

/// A reason to stop and what decided it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Decider {
    /// The cause's name.
    pub cause: &'static str,
    /// The limit by its name in the controller's source; `None` where none was crossed by a measured value.
    pub limit: Option<&'static str>,
    /// What was measured, in `unit`.
    pub value: Option<f64>,
    /// The limit's value, in `unit`.
    pub limit_value: Option<f64>,
    /// Unit of both.
    pub unit: &'static str,
    /// The replayed line-scans show it; else the summaries tell it.
    pub replayed: bool,
    /// In a sentence.
    pub words: String,
}

/// A recording, replayed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Replay {
    /// Number of the stop since the controller's start.
    pub stop: u32,
    /// When, milliseconds of the controller's clock.
    pub time_ms: f64,
    /// What decided.
    pub deciders: Vec<Decider>,
    /// Every cause at the stop that a line-scan can show is shown again.
    pub reproduced: bool,
    /// Where replay and recording differ.
    pub mismatches: Vec<String>,
    /// Line-scan by line-scan.
    pub scans: Vec<ReplayedScan>,
}

impl Replay {
    /// Replays a recording.
    ///
    /// # Errors
    /// See [`ReplayError`].
    pub fn of(recording: &Recording) -> Result<Self, ReplayError> {
        let index = &recording.index;
        let scans = replay_scans(recording)?;
        let before = &scans[..scans.len().min(usize::from(index.scans_before))];
        let mismatches = compare(recording, &scans);
        let deciders: Vec<_> = causes_of(recording)
            .iter()
            .map(|cause| decider(cause, recording, before).unwrap_or_else(|| untold(cause)))
            .collect();
        // Without its own line-scan nothing of the stripe's causes can be shown.
        let reproduced = deciders.iter().all(|decider| decider.replayed || !is_shown_by_scans(decider.cause));
        Ok(Self {
            stop: index.stop,
            time_ms: millis(index.time),
            reproduced: reproduced && mismatches.is_empty(),
            deciders,
            mismatches,
            scans,
        })
    }
}

/// The causes of the stop, without the interlock that follows every stop.
fn causes_of(recording: &Recording) -> StopCauses {
    recording.index.causes.without(StopCause::Interlock)
}

fn replay_scans(recording: &Recording) -> Result<Vec<ReplayedScan>, ReplayError> {
    let index = &recording.index;
    let rig = recording.rig().map_err(ReplayError::Rig)?;
    let given = rig.calibration_id();
    if let Some(used) = index.calibration.filter(|used| *used != given) {
        return Err(ReplayError::OtherRig { used: used.get(), given: given.get() });
    }
    let mut monitor = Box::new(StripeMonitor::<LARGEST_COLUMN_COUNT>::new());
    monitor.configure(&rig, Decimation::for_line_scan(rig.image().width)).map_err(ReplayError::Geometry)?;
    let mut history = 0_usize;
    let mut anew = false;
    let mut replayed = Vec::new();
    for (position, bytes) in recording.scans.iter().enumerate() {
        let scan = LineScan::parse(&bytes[..])
            .map_err(|problem| ReplayError::LineScan { number: position + 1, problem })?;
        let sequence = scan.header().sequence;
        let summary = summary_of(recording, sequence.get());
        if summary.is_some_and(|summary| summary.kind == ExchangeKind::AcceptedAfterSilence) {
            // The controller forgot its votes here, too.
            monitor.reset();
            (history, anew) = (0, true);
        }
        history += 1;
        let report = monitor.update(scan.readings());
        let places = monitor.geometry().maps().iter().map(|map| map.floor_place);
        let heights =
            monitor.heights().iter().map(|height| Some(*height).filter(|height| height.is_finite()));
        replayed.push(ReplayedScan {
            sequence: sequence.get(),
            t_ms: summary.map(|summary| millis(summary.time) - millis(index.time)),
            after_stop: position >= usize::from(index.scans_before),
            vote_complete: history >= VOTE_FRAMES || anew,
            voted_gap_mm: report.cutoff.voted.map(|gap| gap.length().get()),
            single_gap_mm: report.cutoff.single.map(|gap| gap.length().get()),
            highest_mm: report.heights.highest.map(|highest| highest.height.get()),
            lowest_mm: report.heights.lowest.map(|lowest| lowest.height.get()),
            profile: places.zip(heights).collect(),
            report,
        });
    }
    Ok(replayed)
}

/// The summary of the exchange that brought this line-scan.
fn summary_of(recording: &Recording, sequence: u32) -> Option<&Summary> {
    recording.summaries.iter().find(|summary| {
        summary.sequence.get() == sequence
            && matches!(summary.kind, ExchangeKind::Accepted | ExchangeKind::AcceptedAfterSilence)
    })
}

/// Summaries carry micrometres, and f32 rounds them once more on the way back.
const ROUNDING_MICROMETRES: u32 = 2;

/// Where the controller's own figures differ from the replayed ones.
fn compare(recording: &Recording, scans: &[ReplayedScan]) -> Vec<String> {
    let mut mismatches = Vec::new();
    for scan in scans {
        let Some(summary) = summary_of(recording, scan.sequence) else { continue };
        let again = Summary::new(summary.time, summary.state, summary.kind).with_report(&scan.report);
        let mut differ = |what: &str, kept: Option<Millimetres>, again: Option<Millimetres>| {
            let same = match (kept, again) {
                (Some(kept), Some(again)) => {
                    kept.to_micrometres().abs_diff(again.to_micrometres()) <= ROUNDING_MICROMETRES
                }
                (kept, again) => kept.is_none() && again.is_none(),
            };
            if !same {
                let told = |value: Option<Millimetres>| {
                    value.map_or("none".to_owned(), |mm| format!("{} mm", mm.get()))
                };
                mismatches.push(format!(
                    "line-scan {}: {what} was {}, replayed {}",
                    scan.sequence,
                    told(kept),
                    told(again)
                ));
            }
        };
        differ("gap in this frame", summary.single_gap, again.single_gap);
        differ("highest point", summary.highest, again.highest);
        differ("lowest point", summary.lowest, again.lowest);
        if scan.vote_complete {
            differ("voted gap", summary.voted_gap, again.voted_gap);
        }
    }
    mismatches
}

const STRIPE_CAUSES: [StopCause; 5] = [
    StopCause::StripeCut,
    StopCause::StripeMissing,
    StopCause::LargeObject,
    StopCause::Drop,
    StopCause::HostRequest,
];

fn is_shown_by_scans(name: &str) -> bool {
    STRIPE_CAUSES.iter().any(|cause| cause.name() == name)
}

/// What decided for this cause; `None` if the recording does not show it.
fn decider(cause: StopCause, recording: &Recording, before: &[ReplayedScan]) -> Option<Decider> {
    let newest = before.last();
    match cause {
        StopCause::StripeCut => cut(newest?),
        StopCause::StripeMissing => {
            let report = newest?.report;
            report.is_stripe_missing().then(|| Decider {
                words: format!("0 of {} watched columns show the stripe", report.watched_columns),
                replayed: true,
                ..untold(cause)
            })
        }
        StopCause::LargeObject => vote(cause, before, ("LARGE_HEIGHT", LARGE_HEIGHT, ">="), |scan| {
            scan.highest_mm.filter(|height| *height >= LARGE_HEIGHT.get())
        }),
        StopCause::Drop => vote(cause, before, ("DEEPEST_ALLOWED_DROP", DEEPEST_ALLOWED_DROP, "<"), |scan| {
            scan.lowest_mm.filter(|height| *height < DEEPEST_ALLOWED_DROP.get())
        }),
        StopCause::HostRequest => host_request(recording),
        StopCause::LinkTimeout => silence(recording),
        StopCause::LinkDelay => delay(recording),
        StopCause::LinkSequence => {
            let words = format!(
                "sequence number behind, or more than {LARGEST_SEQUENCE_STEP} ahead of the last accepted one \
                 ({}; LARGEST_SEQUENCE_STEP)",
                last_summary(recording)?.sequence.get()
            );
            let limit_value = Some(f64::from(LARGEST_SEQUENCE_STEP));
            Some(Decider { limit: Some("LARGEST_SEQUENCE_STEP"), limit_value, words, ..untold(cause) })
        }
        StopCause::Liveness => {
            score(cause, recording, "LIVENESS_DOUBT_LIMIT", LIVENESS_DOUBT_LIMIT, |summary| {
                summary.liveness_score
            })
        }
        StopCause::Audit => {
            score(cause, recording, "AUDIT_DOUBT_LIMIT", AUDIT_DOUBT_LIMIT, |summary| summary.audit_score)
        }
        _ => None,
    }
}

/// A cause of which the recording shows no more than its name.
fn untold(cause: StopCause) -> Decider {
    Decider {
        cause: cause.name(),
        limit: None,
        value: None,
        limit_value: None,
        unit: "",
        replayed: false,
        words: cause.words().to_owned(),
    }
}

fn cut(scan: &ReplayedScan) -> Option<Decider> {
    let report = &scan.report;
    let over = |gap: Option<nearfield_shared::cutoff::Gap>, limit: Millimetres| {
        gap.filter(|gap| gap.length() > limit)
    };
    let (gap, name, limit, kind, where_) =
        match (over(report.cutoff.single, IMMEDIATE_GAP), over(report.cutoff.voted, LONGEST_ALLOWED_GAP)) {
            (Some(gap), _) => (gap, "IMMEDIATE_GAP", IMMEDIATE_GAP, "gap", "in one frame".to_owned()),
            (None, Some(gap)) => (
                gap,
                "LONGEST_ALLOWED_GAP",
                LONGEST_ALLOWED_GAP,
                "voted gap",
                format!("over {VOTE_FRAMES} frames"),
            ),
            (None, None) => return None,
        };
    let words = format!(
        "{kind} {} mm > {name} {} mm {where_}, s = {} to {} mm",
        tenth(gap.length().get()),
        limit.get(),
        tenth(gap.start.get()),
        tenth(gap.end.get())
    );
    Some(Decider {
        limit: Some(name),
        value: Some(f64::from(gap.length().get())),
        limit_value: Some(f64::from(limit.get())),
        unit: "mm",
        replayed: true,
        words,
        ..untold(StopCause::StripeCut)
    })
}

/// A height that crosses its limit in most frames of the vote.
fn vote(
    cause: StopCause,
    before: &[ReplayedScan],
    (name, limit, comparison): (&'static str, Millimetres, &str),
    crossing: impl Fn(&ReplayedScan) -> Option<f32>,
) -> Option<Decider> {
    let frames = before.get(before.len().saturating_sub(VOTE_FRAMES)..)?;
    let crossings: Vec<f32> = frames.iter().filter_map(crossing).collect();
    let value = *crossings.last()?;
    // Frames that the controller had not seen count against the drop, see its judge; here they are not known.
    let complete = frames.last().is_some_and(|scan| scan.vote_complete);
    (crossings.len() * 2 > VOTE_FRAMES || !complete).then(|| Decider {
        limit: Some(name),
        value: Some(f64::from(value)),
        limit_value: Some(f64::from(limit.get())),
        unit: "mm",
        replayed: true,
        words: format!(
            "height {} mm {comparison} {name} {} mm in {} of {} frames",
            tenth(value),
            limit.get(),
            crossings.len(),
            frames.len()
        ),
        ..untold(cause)
    })
}

fn host_request(recording: &Recording) -> Option<Decider> {
    let newest = recording.scans.get(usize::from(recording.index.scans_before).checked_sub(1)?)?;
    let verdict = LineScan::parse(&newest[..]).ok()?.header().verdict;
    (verdict == HostVerdict::Stop).then(|| Decider {
        replayed: true,
        words: "the line-scan's host verdict is `stop`".to_owned(),
        ..untold(StopCause::HostRequest)
    })
}

fn silence(recording: &Recording) -> Option<Decider> {
    let before = recording.summaries.get(..usize::from(recording.index.summaries_before))?;
    let last = before.iter().rev().find(|summary| {
        matches!(summary.kind, ExchangeKind::Accepted | ExchangeKind::AcceptedAfterSilence)
    })?;
    let silent = recording.index.time.since(last.time);
    let value = millis(silent);
    let over = silent > LINK_TIMEOUT;
    Some(Decider {
        limit: Some("LINK_TIMEOUT"),
        value: Some(value),
        limit_value: Some(millis(LINK_TIMEOUT)),
        unit: "ms",
        words: format!(
            "no accepted line-scan for {value:.1} ms {} LINK_TIMEOUT {} ms; the last one had the number {}",
            if over { ">" } else { "within" },
            millis(LINK_TIMEOUT),
            last.sequence.get()
        ),
        ..untold(StopCause::LinkTimeout)
    })
}

fn delay(recording: &Recording) -> Option<Decider> {
    let summary = last_summary(recording)?;
    let (age, name, limit, words) = if summary.capture_age > LONGEST_CAPTURE_AGE {
        (summary.capture_age, "LONGEST_CAPTURE_AGE", LONGEST_CAPTURE_AGE, "picture by the host's own word")
    } else {
        let message = Micros::new(summary.decision_age.get().saturating_sub(summary.capture_age.get()));
        if message <= LONGEST_MESSAGE_AGE {
            // It answers a status that is no longer remembered: older than any that counts.
            return Some(Decider {
                limit: Some("LONGEST_MESSAGE_AGE"),
                limit_value: Some(millis(LONGEST_MESSAGE_AGE)),
                unit: "ms",
                words: format!(
                    "the message answers a status older than LONGEST_MESSAGE_AGE {} ms, or none of this start",
                    millis(LONGEST_MESSAGE_AGE)
                ),
                ..untold(StopCause::LinkDelay)
            });
        }
        (message, "LONGEST_MESSAGE_AGE", LONGEST_MESSAGE_AGE, "message by the controller's clock")
    };
    Some(Decider {
        limit: Some(name),
        value: Some(millis(age)),
        limit_value: Some(millis(limit)),
        unit: "ms",
        words: format!("age of the {words} {:.1} ms > {name} {} ms", millis(age), millis(limit)),
        ..untold(StopCause::LinkDelay)
    })
}

/// A doubt that has reached its limit, as the newest summary up to the stop tells it.
fn score(
    cause: StopCause,
    recording: &Recording,
    name: &'static str,
    limit: u16,
    score: impl Fn(&Summary) -> u16,
) -> Option<Decider> {
    let value = score(last_summary(recording)?);
    (value >= limit).then(|| Decider {
        limit: Some(name),
        value: Some(f64::from(value)),
        limit_value: Some(f64::from(limit)),
        words: format!("{}: doubt {value} >= {name} {limit}", cause.words()),
        ..untold(cause)
    })
}

fn last_summary(recording: &Recording) -> Option<&Summary> {
    recording.summaries.get(usize::from(recording.index.summaries_before).checked_sub(1)?)
}

/// In milliseconds.
pub(super) fn millis(time: Micros) -> f64 {
    time.get() as f64 / 1000.0
}

/// One decimal, as many as matter; more where rounding would hide on which side of a limit a value lies.
fn tenth(value: f32) -> String {
    let short = format!("{value:.1}");
    if short.ends_with(".0") && value.fract() != 0.0 { format!("{value:.3}") } else { short }
}

/// The calibration id of a compact form.
#[must_use]
pub fn calibration_of(rig: &[u8]) -> CalibrationId {
    CalibrationId::new(seal_of(rig))
}

#[cfg(test)]
mod tests;
