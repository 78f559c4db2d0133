//! Status and diagnostics.

#![allow(clippy::unwrap_used)]

mod scene;

use nearfield_ros2::messages::{DiagnosticStatus, ModuleStatus, Time};
use nearfield_ros2::reporter::{About, Reporter};
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::cutoff::Gap;
use nearfield_shared::height::Extreme;
use nearfield_shared::status::{StateCode, Status, Warnings};
use nearfield_shared::units::Millimetres;
use scene::{decision, exchange, line_scan, rig, status};

const NOW: Time = Time { sec: 1_700_000_000, nanosec: 5 };

fn reporter(tells_heights: bool) -> Reporter {
    let about = About {
        module: "front".to_owned(),
        frame_id: "nearfield_front".to_owned(),
        scan_time: 0.02,
        tells_heights,
    };
    Reporter::new(&rig(), about).unwrap()
}

/// After some pictures of a clean floor with this status.
fn told(status: &Status, relay_closed: bool) -> Reporter {
    let mut reporter = reporter(true);
    for _ in 0..4 {
        assert!(
            reporter.take(&exchange(Some(line_scan(&rig(), |_| Some(0.0))), status.to_bytes())).is_none()
        );
        assert!(reporter.take(&decision(relay_closed)).is_some());
    }
    reporter
}

#[test]
fn before_anything_was_heard_nothing_is_claimed() {
    let reporter = reporter(true);
    let round = reporter.round(NOW);
    assert_eq!((round.status.relay, round.status.state.as_str()), (ModuleStatus::UNKNOWN, ""));
    assert!(round.scan.ranges.iter().all(|range| range.is_finite()), "all of the stripe is an obstacle");
    assert_eq!(reporter.diagnostics(NOW).status[0].level, DiagnosticStatus::STALE);
}

#[test]
fn a_running_sensor_over_a_clean_floor_is_free_and_well() {
    let round = told(&status(), true).round(NOW);
    assert_eq!((round.scan.header.stamp, round.scan.header.frame_id.as_str()), (NOW, "nearfield_front"));
    assert!(round.scan.ranges.iter().all(|range| range.is_infinite()));
    assert_eq!(round.status.relay, ModuleStatus::CLOSED);
    assert!((round.status.decision_age - 0.0321).abs() < 1e-6);
    assert!(round.status.highest.is_nan());
    let diagnosis = &told(&status(), true).diagnostics(NOW).status[0];
    assert_eq!((diagnosis.level, diagnosis.name.as_str()), (DiagnosticStatus::OK, "nearfield: front"));
    assert_eq!(diagnosis.hardware_id, "nearfield source 7");
}

#[test]
fn silence_makes_everything_unknown_again() {
    let mut reporter = told(&status(), true);
    reporter.forget();
    let round = reporter.round(NOW);
    assert_eq!(round.status.relay, ModuleStatus::UNKNOWN);
    assert_eq!(round.status.advice, "stop_and_warn");
    assert!(round.scan.ranges.iter().all(|range| range.is_finite()));
    assert_eq!(reporter.verdict().0, DiagnosticStatus::STALE);
}

/// A transaction without a line-scan, as a poll is, must not show an old line-scan again.
#[test]
fn an_old_line_scan_is_never_shown_twice() {
    let mut reporter = told(&status(), true);
    for _ in 0..2 {
        reporter.take(&exchange(None, status().to_bytes()));
        reporter.take(&decision(true));
    }
    assert!(reporter.round(NOW).scan.ranges.iter().all(|range| range.is_finite()));
}

#[test]
fn a_damaged_status_is_none() {
    let mut bytes = status().to_bytes();
    bytes[50] ^= 1;
    let mut reporter = told(&status(), true);
    reporter.take(&exchange(None, bytes));
    reporter.take(&decision(true));
    assert_eq!(reporter.round(NOW).status.relay, ModuleStatus::UNKNOWN);
}

#[test]
fn what_is_in_the_field_is_no_fault_and_a_dead_laser_is() {
    let with =
        |cause| Status { live_causes: StopCauses::NONE.with(cause), state: StateCode::Stopped, ..status() };
    for (cause, level) in [
        (StopCause::StripeCut, DiagnosticStatus::WARN),
        (StopCause::HostRequest, DiagnosticStatus::WARN),
        (StopCause::Interlock, DiagnosticStatus::WARN),
        (StopCause::OutputStage, DiagnosticStatus::ERROR),
        (StopCause::LinkTimeout, DiagnosticStatus::ERROR),
    ] {
        assert_eq!(told(&with(cause), false).verdict(), (level, cause.words()));
    }
    let locked = Status { state: StateCode::Lockout, ..status() };
    assert_eq!(told(&locked, false).verdict().0, DiagnosticStatus::ERROR);
    let warned = Status { warnings: Warnings::VISIBILITY, ..status() };
    assert_eq!(told(&warned, true).verdict().0, DiagnosticStatus::WARN);
    assert_eq!(told(&status(), false).verdict().0, DiagnosticStatus::WARN, "open without a cause");
}

#[test]
fn lengths_are_metres_and_heights_are_told_only_where_they_may() {
    let place = Millimetres::new(10.0);
    let raised = Status {
        longest_gap: Some(Gap { start: place, end: Millimetres::new(187.5) }),
        highest: Some(Extreme { height: Millimetres::new(45.0), place }),
        ..status()
    };
    for tells_heights in [true, false] {
        let mut reporter = reporter(tells_heights);
        reporter.take(&exchange(None, raised.to_bytes()));
        reporter.take(&decision(false));
        let round = reporter.round(NOW);
        assert!((round.status.longest_gap - 0.1775).abs() < 1e-6);
        assert_eq!((round.status.highest - 0.045).abs() < 1e-6, tells_heights);
        assert_eq!(round.cloud.is_some(), tells_heights);
    }
}
