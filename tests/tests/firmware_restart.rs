//! The relays never close by themselves: not at power-up, not after a stop, not after a watchdog's reset; only a whole
//! press of the reset button while nothing speaks against it closes them.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::link::{FrameFacts, InProcess, McuSession};
use nearfield_shared::causes::StopCause;
use nearfield_shared::limits::{LONGEST_RESET_PRESS, SHORTEST_RESET_PRESS};
use nearfield_shared::rig::COMPACT_LENGTH;
use nearfield_shared::status::StateCode;
use nearfield_shared::units::Micros;
use nearfield_tests::stage::{ARMING_FRAMES, READY_FRAMES, Stage, run_clean};

fn fresh(stage: &Stage, frames: u32) -> McuSession {
    stage.session(Box::new(InProcess::new()), frames).unwrap()
}

#[test]
fn a_clean_floor_alone_never_closes_the_relays() {
    let session = fresh(&Stage::new(), 500);
    assert!(!session.relay_commanded_closed() && !session.relay_closed());
    assert_eq!(session.status().state, StateCode::Interlocked);
    assert!(session.status().live_causes.contains(StopCause::Interlock));
}

#[test]
fn a_press_of_the_reset_button_on_a_clean_floor_closes_them() {
    let session = Stage::new().armed();
    assert_eq!(session.status().state, StateCode::Running);
    assert!(session.status().live_causes.is_empty() && session.status().latched_causes.is_empty());
}

#[test]
fn a_press_that_is_too_short_or_too_long_closes_nothing() {
    let stage = Stage::new();
    let press = |length: Micros| {
        let mut session = fresh(&stage, READY_FRAMES);
        session.hold_reset(length);
        run_clean(&mut session, &stage, 200).unwrap();
        session.relay_closed()
    };
    assert!(!press(Micros::from_millis(SHORTEST_RESET_PRESS.get() / 1000 - 5)));
    assert!(press(SHORTEST_RESET_PRESS));
    assert!(press(LONGEST_RESET_PRESS));
    assert!(!press(LONGEST_RESET_PRESS.plus(Micros::from_millis(5))));
}

#[test]
fn a_button_that_is_taped_down_from_power_up_closes_nothing_and_is_reported() {
    let stage = Stage::new();
    let mut session = McuSession::start(Box::new(InProcess::new()), &stage.rig).unwrap();
    session.hold_reset(Micros::from_millis(60_000));
    run_clean(&mut session, &stage, 300).unwrap();
    assert!(!session.relay_closed());
    assert!(session.status().live_causes.contains(StopCause::ResetButton));
}

#[test]
fn a_press_before_the_floor_is_clear_does_not_count_afterwards() {
    let stage = Stage::new();
    let mut session = fresh(&stage, READY_FRAMES);
    let cut = stage.with_object(-20.0, 20.0, None);
    for frame in 0..12 {
        if frame == 5 {
            session.press_reset();
        }
        session.run_columns(&cut, FrameFacts::default()).unwrap();
    }
    run_clean(&mut session, &stage, 100).unwrap();
    assert!(!session.relay_closed());
    assert_eq!(session.status().state, StateCode::Interlocked);
}

#[test]
fn after_a_stop_the_cause_is_kept_until_the_reset() {
    let stage = Stage::new();
    let mut session = stage.armed();
    for _ in 0..3 {
        session.run_columns(&stage.with_object(-20.0, 20.0, None), FrameFacts::default()).unwrap();
    }
    run_clean(&mut session, &stage, 100).unwrap();
    assert!(!session.relay_closed(), "no automatic restart");
    assert_eq!(session.status().state, StateCode::Interlocked);
    assert!(session.status().latched_causes.contains(StopCause::StripeCut));
    assert!(
        !session.status().latched_causes.contains(StopCause::Feedback),
        "contacts on their way are no fault"
    );
    session.press_reset();
    run_clean(&mut session, &stage, ARMING_FRAMES).unwrap();
    assert!(session.relay_closed());
    assert!(session.status().latched_causes.is_empty());
}

#[test]
fn without_a_valid_rig_in_its_flash_nothing_closes_the_relays() {
    let stage = Stage::new();
    let good = stage.rig.to_bytes();
    let mut damaged = good;
    damaged[60] ^= 1;
    let stores: [&[u8]; 5] = [&[], &[0xFF; COMPACT_LENGTH], &[0; COMPACT_LENGTH], &damaged, &good[..100]];
    for stored in stores {
        let link = Box::new(InProcess::new());
        let mut session = McuSession::start_with_stored(link, stored, stage.rig.calibration_id()).unwrap();
        for frame in 0..160 {
            if frame % 40 == 30 {
                session.press_reset();
            }
            run_clean(&mut session, &stage, 1).unwrap();
            assert!(!session.relay_commanded_closed() && !session.relay_closed());
        }
        assert!(session.status().live_causes.contains(StopCause::Configuration));
        assert!(session.status().live_causes.contains(StopCause::LinkCalibration));
        assert_eq!(session.status().calibration, None);
    }
}
