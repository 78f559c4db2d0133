//! The controller as a whole: ticks and exchanges in, pins and statuses out.

use super::*;
use crate::testing::{Bench, SOURCE};
use nearfield_shared::cutoff::Gap;
use nearfield_shared::limits::{
    DARK_PROOFS, LASER_DIMMED, LASER_FULL, LONGEST_ALLOWED_GAP, LONGEST_TICK_PERIOD,
};
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::rig::CompactRigError;
use nearfield_shared::status::{Channels, FaultCode, LaserMode};

fn status(bench: &Bench) -> Status {
    Status::parse(&bench.controller.status(bench.now)).unwrap()
}

#[test]
fn an_armed_controller_closes_feeds_and_tells() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let output = bench.clean_frame();
    let outputs = output.outputs;
    assert_eq!((outputs.relays, outputs.indicator), (Channels::CLOSED, Indicator::Permitted));
    assert!([LASER_FULL, LASER_DIMMED].contains(&outputs.laser_level) && !outputs.warning);
    assert!(output.permit.is_some());
    let status = status(&bench);
    assert_eq!((status.state, status.reset_cause), (StateCode::Running, ResetCause::PowerOn));
    assert_eq!((status.relay_command, status.relay_readback), (Channels::CLOSED, Channels::CLOSED));
    assert!(status.live_causes.is_empty() && status.latched_causes.is_empty());
    assert_eq!(status.accepted, 66);
    assert_eq!((status.trust.liveness_doubt, status.trust.audit_doubt, status.fault), (0, 0, None));
    assert!(status.trust.audits_confirmed > 400 && status.trust.audits_contradicted == 0);
    assert_eq!((status.laser_mode, status.warnings), (LaserMode::Coded, Warnings::NONE));
    assert_eq!(status.refused, [0; 8]);
    assert_eq!(status.echoed_sequence.get(), bench.sequence);
    assert_eq!(
        status.decision_age,
        Micros::from_millis(40),
        "20 ms by the host's word, 20 ms since the status"
    );
    assert!(status.decision_age <= status.response_bound);
}

#[test]
fn an_exchange_can_open_the_relays_at_once_and_never_close_them() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let scan = bench.scan(None, HostVerdict::Clear);
    bench.exchange(Some(&scan));
    assert_eq!(bench.controller.outputs().relays, Channels::OPEN, "before the next tick");
    // Good again within the same tick period: the event is not forgotten.
    for _ in 0..3 {
        let scan = bench.scan(Some(0.0), HostVerdict::Clear);
        bench.exchange(Some(&scan));
        assert_eq!(bench.controller.outputs().relays, Channels::OPEN);
    }
    assert_eq!(bench.tick().outputs.relays, Channels::OPEN);
    assert_eq!(status(&bench).state, StateCode::Stopped);
    assert!(status(&bench).latched_causes.contains(StopCause::StripeMissing));
}

#[test]
fn a_late_tick_stops_and_yields_no_permit() {
    for (late, stops) in [(0, false), (1, true)] {
        let mut bench = Bench::after(ResetCause::PowerOn);
        bench.arm();
        bench.clean_frame();
        let last = Micros::new(bench.now.get() - 5_000);
        bench.now = Micros::new(last.plus(LONGEST_TICK_PERIOD).get() + late);
        let output = bench.tick();
        assert_eq!(output.permit.is_none(), stops);
        assert_eq!(output.outputs.relays == Channels::OPEN, stops);
        assert_eq!(status(&bench).live_causes.contains(StopCause::ProgramFlow), stops);
    }
}

#[test]
fn a_stop_is_no_reason_to_starve_the_watchdog() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    for _ in 0..20 {
        assert!(bench.tick().permit.is_some());
    }
    assert!(status(&bench).live_causes.contains(StopCause::LinkTimeout));
}

#[test]
fn a_watchdogs_reset_is_told_until_the_reset_button_is_pressed() {
    let mut bench = Bench::after(ResetCause::Watchdog);
    bench.exchange(None);
    for _ in 0..25 {
        bench.clean_frame();
    }
    assert_eq!(status(&bench).state, StateCode::Interlocked);
    assert!(status(&bench).latched_causes.contains(StopCause::WatchdogReset));
    assert_eq!(status(&bench).reset_cause, ResetCause::Watchdog);
    bench.arm();
    assert!(status(&bench).latched_causes.is_empty());
}

#[test]
fn a_start_forgets_everything_that_was() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let rig = crate::testing::rig().to_bytes();
    let start = StartInputs { reset_cause: ResetCause::Pin, stored_rig: &rig, secret: [1; 16] };
    bench.controller.start(&start).unwrap();
    let mut fresh = SafetyController::new(SOURCE, Box::new(LineScanMonitor::new()));
    fresh.start(&start).unwrap();
    assert_eq!(bench.controller.status(bench.now), fresh.status(bench.now));
    assert_eq!(bench.controller.outputs().relays, Channels::OPEN);
}

#[test]
fn a_rig_that_is_refused_is_told_and_stops() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    let start = StartInputs { reset_cause: ResetCause::PowerOn, stored_rig: &[], secret: [1; 16] };
    let refused = bench.controller.start(&start);
    bench.now = Micros::ZERO;
    assert_eq!(refused, Err(ConfigurationError::Rig(CompactRigError::NotARig)));
    bench.tick();
    assert!(status(&bench).live_causes.contains(StopCause::Configuration));
    assert_eq!(bench.controller.calibration(), None);
}

#[test]
fn the_firmware_names_its_version() {
    let [major, minor, patch] =
        env!("CARGO_PKG_VERSION").split('.').map(|part| part.parse::<u32>().unwrap()).collect::<Vec<_>>()[..]
    else {
        panic!("a version has three parts")
    };
    assert_eq!(FIRMWARE_ID, major * 0x100_0000 + minor * 0x1_0000 + patch);
}

/// Presses and releases the button, and runs clean frames until the laser is dark.
fn darken(bench: &mut Bench) {
    bench.exchange(None);
    for _ in 0..25 {
        bench.clean_frame();
    }
    for frame in 0.. {
        bench.pins.reset_pressed = frame < 6;
        let output = bench.clean_frame();
        if output.outputs.laser_level == 0 {
            return;
        }
        assert!(frame < 10, "never dark");
    }
}

#[test]
fn at_arming_the_laser_goes_dark_and_the_relays_close_only_after_that_was_seen() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    darken(&mut bench);
    let start = bench.now;
    let mut dark = true;
    while bench.controller.outputs().relays == Channels::OPEN {
        assert_eq!(status(&bench).state, StateCode::Arming);
        dark &= status(&bench).laser_mode == LaserMode::Dark;
        bench.clean_frame();
        assert!(bench.now.since(start) <= Micros::from_millis(500), "{:?}", status(&bench));
    }
    assert!(!dark, "the light came back first");
    assert!(bench.now.since(start) >= Micros::from_millis(100));
}

#[test]
fn a_stripe_that_is_seen_in_the_dark_stops() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    darken(&mut bench);
    for _ in 0..10 {
        let scan = bench.scan_in_light(Some(0.0), HostVerdict::Clear, LASER_FULL);
        bench.frame(Some(&scan));
        assert_eq!(bench.controller.outputs().relays, Channels::OPEN);
    }
    assert!(status(&bench).latched_causes.contains(StopCause::DarkTest));
}

/// Clean frames from the laser's going dark to its coming back.
fn frames_in_the_dark(bench: &mut Bench) -> usize {
    darken(bench);
    (0..30).take_while(|_| bench.clean_frame().outputs.laser_level == 0).count()
}

/// What the pictures of an earlier arming said, good or bad, counts for that one alone.
#[test]
fn each_arming_demands_a_dark_test_of_its_own() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    let first = frames_in_the_dark(&mut bench);
    assert!((usize::from(DARK_PROOFS)..30).contains(&first), "{first}");
    bench.arm();
    let cut = bench.scan(None, HostVerdict::Clear);
    bench.frame(Some(&cut));
    assert_eq!(frames_in_the_dark(&mut bench), first, "the old proof counted");
    let mut denied = Bench::after(ResetCause::PowerOn);
    darken(&mut denied);
    for _ in 0..10 {
        let scan = denied.scan_in_light(Some(0.0), HostVerdict::Clear, LASER_FULL);
        denied.frame(Some(&scan));
    }
    assert_eq!(status(&denied).state, StateCode::Stopped);
    assert_eq!(frames_in_the_dark(&mut denied), first, "the old denial counted");
}

#[test]
fn a_frozen_picture_in_fresh_messages_stops_within_the_stated_time() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let start = bench.now;
    while bench.controller.outputs().relays == Channels::CLOSED {
        let scan = bench.scan_in_light(Some(0.0), HostVerdict::Clear, LASER_FULL);
        bench.frame(Some(&scan));
        assert!(bench.now.since(start) <= Micros::from_millis(270));
    }
    assert!(status(&bench).latched_causes.contains(StopCause::Liveness));
}

#[test]
fn a_host_that_answers_no_audit_stops_at_once() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let mut scan = bench.scan(Some(0.0), HostVerdict::Clear);
    // No windows: their count is zero.
    scan[32] = 0;
    let length = scan.len() - 4;
    let seal = nearfield_shared::wire::checksum(&scan[..length]);
    scan[length..].copy_from_slice(&seal.to_le_bytes());
    assert_eq!(bench.exchange(Some(&scan)).relays, Channels::OPEN);
    assert!(status(&bench).live_causes.contains(StopCause::Audit));
}

#[test]
fn the_first_refused_message_is_discarded_with_a_warning_and_the_second_stops() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let mut damaged = bench.scan(Some(0.0), HostVerdict::Clear);
    damaged[1000] ^= 4;
    assert_eq!(bench.frame(Some(&damaged)).outputs.relays, Channels::CLOSED);
    assert!(status(&bench).warnings.has_any(Warnings::LINK) && bench.controller.outputs().warning);
    bench.clean_frame();
    assert_eq!(bench.exchange(Some(&damaged)).relays, Channels::OPEN);
    assert!(status(&bench).live_causes.contains(StopCause::LinkCorruption));
}

#[test]
fn a_stuck_driver_locks_out() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    bench.drivers = |driven| Channels { a: true, ..driven };
    let start = bench.now;
    while bench.controller.outputs().relays == Channels::CLOSED {
        bench.clean_frame();
        assert!(bench.now.since(start) <= Micros::from_millis(1_100));
    }
    assert_eq!(status(&bench).fault, Some(FaultCode::OutputStage));
    assert_eq!(bench.controller.outputs().laser_level, 0, "laser off in lockout");
}

#[test]
#[cfg_attr(miri, ignore = "hundreds of controllers or frames")]
fn a_failed_self_test_locks_out_and_is_named() {
    for kind in SelfTestKind::ALL {
        let mut bench = Bench::after(ResetCause::PowerOn);
        bench.arm();
        let passed = crate::selftest::SelfTestReport::passed(bench.now);
        bench.self_test = Some(crate::selftest::SelfTestReport { failed: Some(kind), ..passed });
        assert_eq!(bench.tick().outputs.relays, Channels::OPEN);
        let status = status(&bench);
        assert_eq!((status.fault, status.failed_self_test), (Some(FaultCode::SelfTest), kind.code()));
    }
}

#[test]
fn without_self_tests_nothing_starts() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.self_test = Some(crate::selftest::SelfTestReport::PENDING);
    bench.exchange(None);
    for _ in 0..50 {
        bench.clean_frame();
        assert_eq!(status(&bench).state, StateCode::SelfTest);
    }
}

#[test]
fn a_controller_that_was_never_started_locks_itself_out() {
    let mut controller = SafetyController::new(SOURCE, Box::new(LineScanMonitor::new()));
    let pins = PinInputs { mirror: MirrorContacts::BOTH_OPEN, ..PinInputs::default() };
    let self_test = crate::selftest::SelfTestReport::passed(Micros::ZERO);
    controller.tick(Micros::ZERO, TickInputs { pins, self_test });
    let status = Status::parse(&controller.status(Micros::ZERO)).unwrap();
    assert_eq!((status.state, status.fault), (StateCode::Lockout, Some(FaultCode::CriticalData)));
}

/// Any change of a field that permission rests on, between two calls, locks out with the next tick.
#[test]
#[cfg_attr(miri, ignore = "hundreds of controllers or frames")]
fn damaged_memory_locks_out() {
    type Damage = fn(&mut SafetyController<Box<LineScanMonitor>>);
    let damages: [(&str, Damage); 14] = [
        ("state", |it| it.state = State::Interlocked { latched: StopCauses::NONE }),
        ("evidence", |it| it.evidence = None),
        ("calibration", |it| it.calibration = Some(CalibrationId::new(1))),
        ("receiver", |it| it.receiver.expire(Micros::from_millis(1 << 40))),
        ("judge", |it| it.judge.reset()),
        ("liveness", |it| it.liveness.forget()),
        ("auditor", |it| it.auditor.forget()),
        ("laser", |it| it.laser = LaserCode::new(Secret::NONE)),
        ("dark test", |it| it.dark.observe(&UNSEEN)),
        ("events", |it| it.events = StopCauses::NONE.with(StopCause::Drop)),
        ("output test", |it| it.output_test = OutputTest::new()),
        ("button", |it| it.button = ResetButton::new()),
        ("statuses sent", |it| it.statuses_sent += 1),
        ("seal", |it| it.seal = Digest::new().sealed()),
    ];
    for (what, damage) in damages {
        for exchange_first in [false, true] {
            let mut bench = Bench::after(ResetCause::PowerOn);
            bench.arm();
            let scan = bench.scan(Some(0.0), HostVerdict::Clear);
            damage(&mut bench.controller);
            if exchange_first {
                assert_eq!(bench.exchange(Some(&scan)).relays, Channels::OPEN, "{what}: at once");
            }
            assert_eq!(bench.tick().outputs.relays, Channels::OPEN, "{what}");
            assert_eq!(status(&bench).fault, Some(FaultCode::CriticalData), "{what}");
        }
    }
}

#[test]
fn the_light_is_measured_without_the_hosts_clock() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let trust = status(&bench).trust;
    // 20 ms from the exposure to the message, up to 15 ms to the first exposure that lies wholly in the new level, and
    // up to 20 ms until a picture is taken.
    assert!(trust.light_age >= Micros::from_millis(20), "{trust:?}");
    assert!(trust.longest_light_age <= Micros::from_millis(60), "{trust:?}");
}

#[test]
fn the_surroundings_warn_at_their_limits() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let warned = |bench: &mut Bench, ambient: u8, saturated: u8, verdict: HostVerdict| {
        bench.controller.surroundings =
            Surroundings { ambient, saturated, host_warns: verdict == HostVerdict::Warn };
        status(bench).warnings
    };
    let quiet = warned(&mut bench, WARNING_AMBIENT - 1, WARNING_SATURATED - 1, HostVerdict::Clear);
    assert_eq!(quiet, Warnings::NONE);
    assert_eq!(warned(&mut bench, WARNING_AMBIENT, 0, HostVerdict::Clear), Warnings::AMBIENT);
    assert_eq!(warned(&mut bench, 0, WARNING_SATURATED, HostVerdict::Clear), Warnings::SATURATED);
    assert_eq!(warned(&mut bench, 0, 0, HostVerdict::Warn), Warnings::HOST);
    let scan = bench.scan(Some(0.0), HostVerdict::Warn);
    bench.frame(Some(&scan));
    assert_eq!(status(&bench).warnings, Warnings::HOST);
    assert_eq!(bench.controller.outputs().relays, Channels::CLOSED, "a warning is no stop");
}

#[test]
fn a_gap_that_is_still_allowed_warns_and_one_that_stops_needs_no_warning() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.arm();
    let limit = LONGEST_ALLOWED_GAP.get();
    for (gap, warnings) in [
        (None, Warnings::NONE),
        (Some(limit / 2.0), Warnings::STRIPE),
        (Some(limit), Warnings::STRIPE),
        (Some(limit * 2.0), Warnings::NONE),
    ] {
        bench.controller.report.cutoff.voted = gap.map(|length| Gap::between(0.0, length));
        assert_eq!(status(&bench).warnings, warnings, "{gap:?}");
    }
}

#[test]
#[cfg_attr(miri, ignore = "hundreds of controllers or frames")]
fn a_sensor_that_has_moved_warns_and_then_stops() {
    let after = |height: f32| {
        let mut bench = Bench::after(ResetCause::PowerOn);
        bench.arm();
        for _ in 0..200 {
            let scan = bench.scan(Some(height), HostVerdict::Clear);
            bench.frame(Some(&scan));
        }
        (status(&bench), bench.controller.outputs())
    };
    let (status, outputs) = after(0.7);
    assert_eq!((status.warnings, outputs.relays), (Warnings::FLOOR_OFFSET, Channels::CLOSED));
    assert_eq!(status.health.permitted_speed_percent, 50);
    let (status, outputs) = after(1.2);
    assert_eq!(outputs.relays, Channels::OPEN);
    assert!(status.latched_causes.contains(StopCause::Misaligned));
}

#[test]
fn an_empty_start_is_the_same_by_either_name() {
    use core::fmt::Debug;
    let same = |one: &dyn Debug, other: &dyn Debug| assert_eq!(format!("{one:?}"), format!("{other:?}"));
    same(&DarkTest::default(), &DarkTest::new());
    same(&Auditor::default(), &Auditor::new());
    same(&Judge::default(), &Judge::new());
    same(&FlowMonitor::default(), &FlowMonitor::new());
    same(&Health::default(), &Health::new());
    same(&ResetButton::default(), &ResetButton::new());
    same(&Liveness::default(), &Liveness::new());
    same(&OutputTest::default(), &OutputTest::new());
    same(&Relays::default(), &Relays::new());
}

/// A rig that is sound by itself, but whose stripe runs along the picture's columns: no heights, so no operation.
#[test]
fn a_rig_without_column_maps_is_refused_and_stops() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    let rig = crate::testing::rig();
    let mut camera = *rig.camera();
    // The camera is turned by a quarter about its line of sight.
    let [right, down, forward] = camera.pose.rotation;
    camera.pose.rotation = [down, right.scaled(-1.0), forward];
    let old = camera.pose.translation;
    camera.pose.translation = nearfield_shared::camera::Vector::new(old.y, -old.x, old.z);
    let stripe = nearfield_shared::rig::Stripe { start: -100.0, end: 100.0, ..*rig.stripe() };
    let turned = Rig::new(rig.image(), camera, *rig.laser(), stripe);
    let stored_rig = turned.unwrap().to_bytes();
    let start = StartInputs { reset_cause: ResetCause::PowerOn, stored_rig: &stored_rig, secret: [5; 16] };
    let refused = bench.controller.start(&start);
    assert!(matches!(refused, Err(ConfigurationError::Geometry(_))), "{refused:?}");
    assert_eq!(bench.controller.calibration(), None);
    bench.tick();
    assert!(status(&bench).live_causes.contains(StopCause::Configuration));
}

#[test]
fn while_the_service_key_is_turned_the_button_starts_nothing() {
    let mut bench = Bench::after(ResetCause::PowerOn);
    bench.exchange(None);
    bench.pins.service_key = true;
    for frame in 0..80 {
        bench.pins.reset_pressed = frame % 20 >= 12;
        bench.clean_frame();
    }
    assert_eq!(status(&bench).state, StateCode::Interlocked);
    bench.pins.service_key = false;
    bench.arm();
}

/// The host reads major, minor and patch version out of this word.
#[test]
fn a_version_is_one_word() {
    assert_eq!(version_word([2, 3, 4]), 0x0203_0004);
    assert_eq!(["0", "17", "255"].map(version_part), [0, 17, 255]);
    assert_eq!(version_part("1-alpha"), 0);
    let version: Vec<u32> = env!("CARGO_PKG_VERSION").split('.').map(|part| part.parse().unwrap()).collect();
    assert_eq!(FIRMWARE_ID.to_be_bytes()[..2], [version[0] as u8, version[1] as u8]);
}
