//! What a running module reports of itself, and when.

#![allow(clippy::unwrap_used)]

use std::time::{Duration, Instant};

use nearfield_fleet::carrier::{Channel, Inbox as _};
use nearfield_fleet::outlet::{Outlet, REPORT_INTERVAL, Reporter, SILENCE};
use nearfield_fleet::report::{Relay, Report};
use nearfield_recording::{Decision, Event, queue};
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::status::{
    Challenge, Channels, HealthFigures, LaserMode, ResetCause, StateCode, Status, TrustFigures, Warnings,
};
use nearfield_shared::units::{Micros, Millimetres, SequenceNumber, SourceId};

fn status(causes: StopCauses, state: StateCode) -> Event {
    let zero = Millimetres::new(0.0);
    let status = Status {
        source: SourceId::new(1),
        calibration: None,
        firmware: 1,
        number: 1,
        echoed_sequence: SequenceNumber::new(1),
        now: Micros::from_millis(1),
        state,
        relay_command: Channels::OPEN,
        relay_readback: Channels::OPEN,
        reset_cause: ResetCause::PowerOn,
        live_causes: causes,
        latched_causes: causes,
        longest_gap: None,
        highest: None,
        lowest: None,
        longest_unknown: zero,
        size: None,
        laser_mode: LaserMode::Coded,
        warnings: Warnings::NONE,
        decision_age: Micros::ZERO,
        longest_decision_age: Micros::ZERO,
        response_bound: Micros::ZERO,
        accepted: 1,
        refused: [0; 8],
        challenge: Challenge::default(),
        fault: None,
        failed_self_test: 0,
        trust: TrustFigures::default(),
        health: HealthFigures {
            floor_offset: zero,
            floor_rise: zero,
            smallest_object: zero,
            smallest_object_place: zero,
            permitted_speed_percent: 100,
        },
        run_over: None,
    };
    Event::Exchange { step: None, line_scan: None, status: status.to_bytes() }
}

fn decision(relay_closed: bool) -> Event {
    Event::Decision(Decision {
        picture: 9,
        exposed: Micros::ZERO,
        verdict: HostVerdict::Clear,
        relay_closed,
        fields: nearfield_fields::Report::default(),
        advice: None,
        latency: Duration::ZERO,
    })
}

fn reporter() -> Reporter {
    Reporter::new("amr-1", "front", &["front".to_owned(), "rear".to_owned()], 5)
}

fn hear(reporter: &mut Reporter, causes: StopCauses, closed: bool, now: Instant) {
    let state = if closed { StateCode::Running } else { StateCode::Stopped };
    reporter.take(&status(causes, state), now);
    reporter.take(&decision(closed), now);
}

#[test]
fn changes_are_told_at_once_and_the_rest_five_times_a_second() {
    let (mut reporter, begun) = (reporter(), Instant::now());
    let mut told = Vec::new();
    // A picture every 20 ms for 2 s; the stripe is cut from 1060 ms on.
    for millis in (0..2000).step_by(20) {
        let now = begun + Duration::from_millis(millis);
        let cut = millis >= 1060;
        let causes = StopCauses::NONE.with_if(StopCause::StripeCut, cut);
        hear(&mut reporter, causes, !cut, now);
        told.extend(reporter.due(now).map(|report| (millis, report.relay, report.number)));
    }
    assert_eq!(told[0], (0, Relay::Closed, 1));
    let times: Vec<_> = told.iter().map(|(millis, ..)| *millis).collect();
    assert_eq!(times, [0, 200, 400, 600, 800, 1000, 1060, 1260, 1460, 1660, 1860]);
    assert!(told.iter().all(|(millis, relay, _)| (*relay == Relay::Open) == (*millis >= 1060)), "{told:?}");
    assert!(told.iter().map(|(_, _, number)| *number).eq(1..=11));
}

#[test]
fn without_decisions_the_relay_is_unknown_even_if_it_was_closed() {
    let (mut reporter, begun) = (reporter(), Instant::now());
    assert_eq!(reporter.due(begun).unwrap().relay, Relay::Unknown, "nothing was heard yet");
    hear(&mut reporter, StopCauses::NONE, true, begun);
    assert_eq!(reporter.due(begun).unwrap().relay, Relay::Closed);
    let later = begun + SILENCE;
    let report = reporter.due(later).unwrap();
    assert_eq!((report.relay, report.state.as_str()), (Relay::Unknown, ""));
    // ... and goes on being told.
    assert!(reporter.due(later + REPORT_INTERVAL).is_some());
}

#[test]
fn a_damaged_status_is_none() {
    let (mut reporter, now) = (reporter(), Instant::now());
    hear(&mut reporter, StopCauses::NONE, true, now);
    let Event::Exchange { step, line_scan, mut status } = status(StopCauses::NONE, StateCode::Running) else {
        unreachable!()
    };
    status[40] ^= 1;
    reporter.take(&Event::Exchange { step, line_scan, status }, now);
    reporter.take(&decision(true), now);
    assert_eq!(reporter.due(now).unwrap().relay, Relay::Unknown);
}

#[test]
fn the_thread_sends_what_its_queue_brings() {
    let ((tap, drain), (channel, mut inbox)) = (queue(16), Channel::new(64));
    let outlet = Outlet::start(reporter(), Box::new(channel), drain).unwrap();
    let mut closed = None;
    while closed.is_none() {
        tap.tell(Micros::ZERO, status(StopCauses::NONE, StateCode::Running));
        tap.tell(Micros::ZERO, decision(true));
        inbox
            .receive(Duration::from_millis(50), &mut |bytes| {
                closed = closed
                    .take()
                    .or(Report::parse(bytes).ok().filter(|report| report.relay == Relay::Closed));
            })
            .unwrap();
    }
    let closed = closed.unwrap();
    assert_eq!((closed.robot.as_str(), closed.module.as_str(), closed.pictures), ("amr-1", "front", 9));
    drop(outlet);
}
