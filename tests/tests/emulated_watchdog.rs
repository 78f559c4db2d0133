//! A controller whose program hangs is reset by its own watchdog, opens its relays, and does not close them again by
//! itself: on the emulated board, with its real watchdog, seen from outside.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::link::{Emulated, FRAME_PERIOD, InProcess, McuLink, McuSession};
use nearfield_shared::causes::StopCause;
use nearfield_shared::limits::WATCHDOG_TIMEOUT;
use nearfield_shared::status::{ResetCause, StateCode};
use nearfield_tests::emulator::without_emulator;
use nearfield_tests::stage::{ARMING_FRAMES, Stage, run_clean};

/// The rules, for either controller: after the watchdog's time the relays are open, the reason is told, nothing
/// closes them but the reset button.
fn hang_and_recover(stage: &Stage, link: Box<dyn McuLink>) {
    let mut session = stage.armed_with(link).unwrap();
    session.hang().unwrap();
    let hung_at = session.now();
    while session.relay_commanded_closed() {
        run_clean(&mut session, stage, 1).unwrap();
        let since = session.now().since(hung_at);
        assert!(since <= WATCHDOG_TIMEOUT.plus(FRAME_PERIOD), "still closed {since:?} after the hang");
    }
    run_clean(&mut session, stage, 50).unwrap();
    assert!(!session.relay_closed());
    let status = session.status();
    assert_eq!(status.reset_cause, ResetCause::Watchdog);
    assert_eq!(status.state, StateCode::Interlocked, "no automatic restart");
    assert!(status.latched_causes.contains(StopCause::WatchdogReset), "told until it is acknowledged");
    press_and_check(&mut session, stage);
}

fn press_and_check(session: &mut McuSession, stage: &Stage) {
    session.press_reset();
    run_clean(session, stage, ARMING_FRAMES).unwrap();
    assert!(session.relay_closed());
    assert!(session.status().latched_causes.is_empty());
}

#[test]
fn a_hung_in_process_controller_is_reset_and_stays_open() {
    hang_and_recover(&Stage::new(), Box::new(InProcess::new()));
}

/// `Emulated::hang` itself waits for QEMU's events WATCHDOG and RESET and looks at the board's LEDs.
#[test]
fn a_hung_emulated_controller_is_reset_and_stays_open() {
    match Emulated::new() {
        Ok(emulated) => hang_and_recover(&Stage::new(), Box::new(emulated)),
        Err(error) => without_emulator(&error),
    }
}

#[test]
fn the_emulated_boards_leds_follow_and_its_watchdog_resets_are_counted() {
    let mut link = match Emulated::new() {
        Ok(emulated) => emulated,
        Err(error) => return without_emulator(&error),
    };
    let stage = Stage::new();
    let now = nearfield_shared::units::Micros::ZERO;
    link.start(now, [7; 16], &stage.rig.to_bytes()).unwrap();
    assert_eq!(link.watchdog_resets(), 0);
    link.hang(now).unwrap();
    assert_eq!(link.watchdog_resets(), 1);
    assert!(!link.coils_seen().unwrap().a && !link.coils_seen().unwrap().b);
}
