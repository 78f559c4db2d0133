//! The replay's rules: the stop is shown again, and the limit that decided is named.

use super::*;
use crate::black_box::testing::{
    BOX, CLEAN, Desk, STOP_TIME, Step, WIRE, ending_with, other_rig, recording_of, recording_of_a_box,
};
use nearfield_shared::condition::StateCode;
use nearfield_shared::units::SequenceNumber;

fn causes(causes: &[StopCause]) -> StopCauses {
    causes.iter().fold(StopCauses::NONE, |set, cause| set.with(*cause))
}

/// The only decider of a replay that shows the stop again.
fn only(steps: &[Step], cause: StopCause) -> Decider {
    let replay = Replay::of(&recording_of(steps, causes(&[cause, StopCause::Interlock]))).unwrap();
    assert_eq!(replay.mismatches, Vec::<String>::new());
    assert!(replay.reproduced, "{:?}", replay.deciders);
    assert_eq!(replay.deciders.len(), 1, "the interlock follows every stop and is none");
    replay.deciders[0].clone()
}

fn near(value: Option<f64>, expected: f64) -> bool {
    value.is_some_and(|value| (value - expected).abs() < 3.0)
}

#[test]
fn a_box_trips_at_once_by_its_gap_in_one_frame() {
    let replay = Replay::of(&recording_of_a_box()).unwrap();
    let decider = &replay.deciders[0];
    assert_eq!((decider.cause, decider.limit), ("stripe_cut", Some("IMMEDIATE_GAP")));
    assert!(near(decider.value, 61.0), "{decider:?}");
    assert_eq!((decider.limit_value, decider.unit, decider.replayed), (Some(20.0), "mm", true));
    assert!(decider.words.contains("> IMMEDIATE_GAP 20 mm in one frame, s = 9"), "{}", decider.words);
    assert!(replay.reproduced);
    assert_eq!(replay.scans.len(), 4);
    assert_eq!(
        replay.scans.iter().map(|scan| scan.after_stop).collect::<Vec<_>>(),
        [false, false, false, true]
    );
    assert_eq!(
        replay.scans.iter().map(|scan| scan.vote_complete).collect::<Vec<_>>(),
        [false, false, true, true]
    );
    assert_eq!(replay.scans[2].t_ms, Some(0.0));
    assert_eq!(replay.scans[0].t_ms, Some(-40.0));
    let raised =
        replay.scans[2].profile.iter().filter(|(_, height)| height.is_some_and(|mm| mm > 25.0)).count();
    assert!((46..=49).contains(&raised), "{raised} columns show the box");
}

#[test]
fn a_wire_trips_by_the_vote() {
    let decider = only(&ending_with(WIRE, 2), StopCause::StripeCut);
    assert_eq!(decider.limit, Some("LONGEST_ALLOWED_GAP"));
    assert!(near(decider.value, 8.0) && decider.limit_value == Some(5.0), "{decider:?}");
    assert!(
        decider.words.starts_with("voted gap") && decider.words.contains("over 3 frames"),
        "{}",
        decider.words
    );
}

#[test]
fn other_causes_of_the_stripe_name_their_limits() {
    let needle: fn(f32) -> Option<f32> = |s| Some(if (0.0..6.0).contains(&s) { 70.0 } else { 0.0 });
    let decider = only(&ending_with(needle, 2), StopCause::LargeObject);
    assert_eq!((decider.limit, decider.limit_value), (Some("LARGE_HEIGHT"), Some(50.0)));
    assert!(near(decider.value, 70.0) && decider.words.contains("in 2 of 3 frames"), "{decider:?}");

    let hole: fn(f32) -> Option<f32> = |s| Some(if (0.0..30.0).contains(&s) { -8.0 } else { 0.0 });
    let decider = only(&ending_with(hole, 2), StopCause::Drop);
    assert_eq!((decider.limit, decider.limit_value), (Some("DEEPEST_ALLOWED_DROP"), Some(-5.0)));
    assert!(near(decider.value, -8.0), "{decider:?}");

    let decider = only(&ending_with(|_| None, 1), StopCause::StripeMissing);
    assert!(decider.words.starts_with("0 of 5"), "{decider:?}");

    let stop = Step { verdict: HostVerdict::Stop, ..Step::accepted(CLEAN) };
    let decider = only(&[Step::accepted(CLEAN), stop], StopCause::HostRequest);
    assert!(decider.words.contains("host verdict"), "{decider:?}");
}

/// A claim that the line-scans do not bear out is not reproduced, whatever the recording says.
#[test]
fn a_cause_that_the_line_scans_do_not_show_is_not_reproduced() {
    for cause in STRIPE_CAUSES {
        let replay = Replay::of(&recording_of(&ending_with(CLEAN, 3), causes(&[cause]))).unwrap();
        assert!(!replay.reproduced, "{cause:?}");
        assert_eq!(replay.deciders[0].limit, None, "{cause:?}");
    }
    // One frame of three is no vote for a large object.
    let needle: fn(f32) -> Option<f32> = |s| Some(if (0.0..6.0).contains(&s) { 70.0 } else { 0.0 });
    let replay =
        Replay::of(&recording_of(&ending_with(needle, 1), causes(&[StopCause::LargeObject]))).unwrap();
    assert!(!replay.reproduced);
}

#[test]
fn causes_of_the_link_are_told_from_the_summaries() {
    let mut recording = recording_of(&ending_with(CLEAN, 1), causes(&[StopCause::LinkTimeout]));
    recording.index.time = STOP_TIME.plus(Micros::from_millis(61));
    let decider = &Replay::of(&recording).unwrap().deciders[0];
    assert_eq!(
        (decider.limit, decider.value, decider.limit_value),
        (Some("LINK_TIMEOUT"), Some(61.0), Some(60.0))
    );
    assert!(decider.words.contains("61.0 ms > LINK_TIMEOUT 60 ms") && !decider.replayed, "{}", decider.words);

    let mut recording = recording_of(&ending_with(CLEAN, 1), causes(&[StopCause::LinkDelay]));
    let deciding = usize::from(recording.index.summaries_before) - 1;
    let mut told = |capture_ms: u64, decision_ms: u64| {
        recording.summaries[deciding].capture_age = Micros::from_millis(capture_ms);
        recording.summaries[deciding].decision_age = Micros::from_millis(decision_ms);
        Replay::of(&recording).unwrap().deciders[0].clone()
    };
    let decider = told(61, 0);
    assert_eq!((decider.limit, decider.value), (Some("LONGEST_CAPTURE_AGE"), Some(61.0)));
    let decider = told(60, 106);
    assert_eq!((decider.limit, decider.value), (Some("LONGEST_MESSAGE_AGE"), Some(46.0)));
    let decider = told(60, 105);
    assert_eq!((decider.limit, decider.value), (Some("LONGEST_MESSAGE_AGE"), None), "a status out of memory");
}

#[test]
fn scores_are_told_when_they_have_reached_their_limit() {
    let both = causes(&[StopCause::Liveness, StopCause::Audit]);
    let mut recording = recording_of(&ending_with(CLEAN, 1), both);
    let deciding = usize::from(recording.index.summaries_before) - 1;
    for (liveness, audit, limits) in [
        (LIVENESS_DOUBT_LIMIT, AUDIT_DOUBT_LIMIT, [Some("LIVENESS_DOUBT_LIMIT"), Some("AUDIT_DOUBT_LIMIT")]),
        (LIVENESS_DOUBT_LIMIT - 1, AUDIT_DOUBT_LIMIT - 1, [None, None]),
    ] {
        recording.summaries[deciding].liveness_score = liveness;
        recording.summaries[deciding].audit_score = audit;
        let replay = Replay::of(&recording).unwrap();
        assert_eq!(replay.deciders.iter().map(|decider| decider.limit).collect::<Vec<_>>(), limits);
    }
}

#[test]
fn every_cause_has_a_sentence() {
    let empty = recording_of(&[], StopCauses::NONE);
    for cause in StopCause::ALL {
        let mut recording = empty.clone();
        recording.index.causes = StopCauses::NONE.with(cause);
        let replay = Replay::of(&recording).unwrap();
        if cause == StopCause::Interlock {
            assert_eq!(replay.deciders, []);
        } else {
            assert_eq!(replay.deciders[0].cause, cause.name());
            assert!(!replay.deciders[0].words.is_empty(), "{cause:?}");
        }
    }
}

#[test]
fn a_vote_that_began_anew_after_a_silence_is_replayed_as_it_was() {
    let mut steps = ending_with(CLEAN, 1);
    let last = steps.len() - 1;
    steps[last].kind = ExchangeKind::AcceptedAfterSilence;
    let replay = Replay::of(&recording_of(&steps, causes(&[StopCause::StripeCut]))).unwrap();
    assert!(replay.reproduced, "{:?}", replay.mismatches);
    assert_eq!(replay.deciders[0].limit, Some("LONGEST_ALLOWED_GAP"), "an empty vote proves no floor");
    assert!(replay.scans[2].vote_complete);
}

#[test]
fn what_differs_from_the_controllers_own_figures_is_told() {
    let mut recording = recording_of_a_box();
    let deciding = usize::from(recording.index.summaries_before) - 1;
    recording.summaries[deciding].single_gap = Some(Millimetres::new(12.0));
    recording.summaries[deciding].highest = None;
    let replay = Replay::of(&recording).unwrap();
    assert!(!replay.reproduced);
    assert_eq!(replay.mismatches.len(), 2, "{:?}", replay.mismatches);
    assert!(
        replay.mismatches[0].contains("gap in this frame was 12 mm, replayed 6"),
        "{:?}",
        replay.mismatches
    );
    // A vote whose beginning is not in the recording is not held against it.
    let mut recording = recording_of_a_box();
    let first =
        recording.summaries.iter().position(|summary| summary.sequence == SequenceNumber::new(103)).unwrap();
    recording.summaries[first].voted_gap = None;
    assert!(Replay::of(&recording).unwrap().reproduced);
}

#[test]
fn a_recording_without_its_rig_or_with_another_one_is_refused() {
    let recording = recording_of_a_box();
    let bare = Recording { rig: None, ..recording.clone() };
    let error = Replay::of(&bare).unwrap_err().to_string();
    assert!(error.contains("--rig"), "{error}");
    let other = Recording { rig: Some(other_rig().to_bytes()), ..recording.clone() };
    let error = Replay::of(&other).unwrap_err();
    assert!(matches!(error, ReplayError::OtherRig { .. }) && error.to_string().contains("--rig"), "{error}");
    let mut damaged = recording;
    damaged.scans[1][50] ^= 1;
    let error = Replay::of(&damaged).unwrap_err();
    assert!(matches!(error, ReplayError::LineScan { number: 2, .. }), "{error}");
}

#[test]
fn a_stop_at_once_after_arming_has_no_line_scan_to_replay() {
    let mut desk = Desk::new();
    desk.play(&[], causes(&[StopCause::StripeCut]));
    let replay = Replay::of(&desk.recording()).unwrap();
    assert!(!replay.reproduced && replay.scans.is_empty());
    let _ = (BOX, StateCode::Running);
}
