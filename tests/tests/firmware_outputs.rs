//! A relay that does not do what it is told is found on either edge, and nothing but a power cycle leads out.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::link::{FRAME_PERIOD, FrameFacts, Indicator, McuSession, RelayFault};
use nearfield_shared::causes::StopCause;
use nearfield_shared::limits::FEEDBACK_DISCREPANCY;
use nearfield_shared::status::StateCode;
use nearfield_tests::stage::{ARMING_FRAMES, READY_FRAMES, Stage, run_clean};

/// Locked out for good: the causes, the laser, and no effect of clean floor and reset button.
fn assert_locked_out(session: &mut McuSession, stage: &Stage) {
    for _ in 0..3 {
        session.press_reset();
        for _ in 0..20 {
            run_clean(session, stage, 1).unwrap();
            assert!(!session.relay_commanded_closed());
        }
    }
    assert_eq!(session.status().state, StateCode::Lockout);
    assert!(session.status().live_causes.contains(StopCause::Feedback));
    assert_eq!(session.outputs().laser_level, 0, "no light in lockout");
    assert_eq!(session.outputs().indicator, Indicator::Service);
}

fn stop(session: &mut McuSession, stage: &Stage) {
    session.run_columns(&stage.with_object(-20.0, 20.0, None), FrameFacts::default()).unwrap();
    assert!(!session.relay_commanded_closed());
}

#[test]
fn a_welded_contact_of_either_channel_locks_out_at_the_next_stop() {
    let stage = Stage::new();
    for set_fault in
        [nearfield_host::link::RelayPlant::set_fault_a, nearfield_host::link::RelayPlant::set_fault_b]
    {
        let mut session = stage.armed();
        set_fault(&mut session.plant, Some(RelayFault::Welded));
        run_clean(&mut session, &stage, 20).unwrap();
        assert!(session.relay_closed(), "a weld cannot be seen while closed");
        stop(&mut session, &stage);
        let stopped_at = session.now();
        while session.status().state != StateCode::Lockout {
            run_clean(&mut session, &stage, 1).unwrap();
            let since = session.now().since(stopped_at);
            assert!(since <= FEEDBACK_DISCREPANCY.plus(FRAME_PERIOD), "not found after {since:?}");
        }
        assert!(!session.relay_closed(), "the other channel has opened");
        assert_locked_out(&mut session, &stage);
    }
}

#[test]
fn a_coil_that_does_not_pick_up_locks_out() {
    let stage = Stage::new();
    let mut session = stage.session(Box::new(nearfield_host::link::InProcess::new()), READY_FRAMES).unwrap();
    session.plant.set_fault_b(Some(RelayFault::DeadCoil));
    session.press_reset();
    run_clean(&mut session, &stage, ARMING_FRAMES).unwrap();
    assert!(!session.relay_closed());
    assert_locked_out(&mut session, &stage);
}

#[test]
fn a_contact_that_opens_by_itself_locks_out() {
    let stage = Stage::new();
    let mut session = stage.armed();
    session.plant.set_fault_a(Some(RelayFault::DeadCoil));
    run_clean(&mut session, &stage, 5).unwrap();
    assert_locked_out(&mut session, &stage);
}

#[test]
fn a_broken_feedback_wire_is_found_while_open() {
    let stage = Stage::new();
    let mut session = stage.session(Box::new(nearfield_host::link::InProcess::new()), READY_FRAMES).unwrap();
    session.plant.set_fault_a(Some(RelayFault::BrokenFeedback));
    run_clean(&mut session, &stage, 5).unwrap();
    assert_locked_out(&mut session, &stage);
}

#[test]
fn a_healthy_pair_of_relays_is_never_blamed() {
    let stage = Stage::new();
    let mut session = stage.armed();
    for _ in 0..20 {
        stop(&mut session, &stage);
        run_clean(&mut session, &stage, 8).unwrap();
        session.press_reset();
        run_clean(&mut session, &stage, ARMING_FRAMES).unwrap();
        assert!(session.relay_closed(), "{:?}", session.status());
    }
}
