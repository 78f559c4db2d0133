//! What lies on the stripe, or is missing from the floor, opens the relays within the vote; what lies elsewhere, and
//! what a single frame's noise shows, does not.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::link::{FrameFacts, McuSession};
use nearfield_shared::causes::StopCause;
use nearfield_shared::height::SizeClass;
use nearfield_shared::limits::VOTE_FRAMES;
use nearfield_shared::linescan::{HostVerdict, LineScanColumn};
use nearfield_tests::stage::{Stage, run_clean};

/// Frames of this scene until the command opens; `None` if it does not within ten.
fn frames_until_open(session: &mut McuSession, scene: &[LineScanColumn]) -> Option<usize> {
    (1..=10).find(|_| {
        session.run_columns(scene, FrameFacts::default()).unwrap();
        !session.relay_commanded_closed()
    })
}

fn causes_of(stage: &Stage, scene: &[LineScanColumn]) -> (usize, McuSession) {
    let mut session = stage.armed();
    let frames = frames_until_open(&mut session, scene).unwrap();
    (frames, session)
}

#[test]
fn a_cable_opens_within_the_vote() {
    let stage = Stage::new();
    let cable = stage.with_object(100.0, 110.0, Some(8.0));
    let (frames, mut session) = causes_of(&stage, &cable);
    assert!(frames <= VOTE_FRAMES, "{frames}");
    assert!(session.status().latched_causes.contains(StopCause::StripeCut));
    // With the cable in every frame of the vote, the gap is reported in full.
    session.run_columns(&cable, FrameFacts::default()).unwrap();
    session.run_columns(&cable, FrameFacts::default()).unwrap();
    let gap = session.status().longest_gap.unwrap();
    assert!(gap.start.get() <= 100.0 && gap.end.get() >= 109.0, "{gap:?}");
}

#[test]
fn a_foot_opens_in_its_first_frame() {
    let stage = Stage::new();
    let (frames, session) = causes_of(&stage, &stage.with_object(-50.0, 50.0, Some(90.0)));
    assert_eq!(frames, 1);
    assert!(session.status().highest.unwrap().height.get() > 85.0);
    assert_eq!(session.status().size, Some(SizeClass::Large));
}

#[test]
fn the_contacts_open_within_the_relays_drop_out_after_the_command() {
    let stage = Stage::new();
    let mut session = stage.armed();
    let foot = stage.with_object(-50.0, 50.0, Some(90.0));
    session.run_columns(&foot, FrameFacts::default()).unwrap();
    session.run_columns(&foot, FrameFacts::default()).unwrap();
    assert!(!session.relay_closed());
}

#[test]
fn a_missing_stripe_opens_in_its_first_frame() {
    let stage = Stage::new();
    let (frames, session) = causes_of(&stage, &stage.profile(|_| None));
    assert_eq!(frames, 1);
    assert!(session.status().latched_causes.contains(StopCause::StripeMissing));
    assert_eq!(session.status().size, Some(SizeClass::Unknown));
}

#[test]
fn a_drop_opens_within_the_vote() {
    let stage = Stage::new();
    let (frames, mut session) = causes_of(&stage, &stage.with_object(200.0, 420.0, Some(-12.0)));
    assert!(frames <= VOTE_FRAMES);
    assert!(session.status().live_causes.contains(StopCause::StripeCut));
    session.run_columns(&stage.with_object(200.0, 420.0, Some(-12.0)), FrameFacts::default()).unwrap();
    assert!(session.status().live_causes.contains(StopCause::Drop));
}

#[test]
fn one_noisy_frame_does_not_stop() {
    let stage = Stage::new();
    let mut session = stage.armed();
    for _ in 0..20 {
        session.run_columns(&stage.with_object(100.0, 110.0, None), FrameFacts::default()).unwrap();
        run_clean(&mut session, &stage, 4).unwrap();
        assert!(session.relay_closed());
    }
}

#[test]
fn a_weak_signal_is_no_floor() {
    let stage = Stage::new();
    let mut weak = stage.floor();
    for column in &mut weak {
        column.quality = nearfield_shared::units::SignalQuality::new(23);
    }
    let (frames, _) = causes_of(&stage, &weak);
    assert_eq!(frames, 1);
}

/// The host can add a stop and nothing else: no verdict of its keeps the relays closed over a cut stripe.
#[test]
fn the_host_can_only_add_a_stop() {
    let stage = Stage::new();
    let stop = FrameFacts { verdict: HostVerdict::Stop, ..FrameFacts::default() };
    let mut session = stage.armed();
    session.run_columns(&stage.floor(), stop).unwrap();
    assert!(!session.relay_commanded_closed());
    assert!(session.status().latched_causes.contains(StopCause::HostRequest));
    run_clean(&mut session, &stage, 50).unwrap();
    assert!(!session.relay_commanded_closed(), "a withdrawn request does not restart");
    for verdict in [HostVerdict::Clear, HostVerdict::Warn] {
        let mut session = stage.armed();
        session.run_columns(&stage.floor(), FrameFacts { verdict, ..FrameFacts::default() }).unwrap();
        assert!(session.relay_commanded_closed());
        let cut = stage.with_object(-20.0, 20.0, None);
        session.run_columns(&cut, FrameFacts { verdict, ..FrameFacts::default() }).unwrap();
        assert!(!session.relay_commanded_closed(), "{verdict:?}");
    }
}
