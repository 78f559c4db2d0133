#![allow(clippy::unwrap_used)]

use std::time::Duration;

use nearfield_recording::Sighting;
use nearfield_shared::linescan::HostVerdict;

use super::*;
use crate::server::tests::rig;

fn model() -> Model {
    Model::new("front", 1_700_000_000_000_000_000, &rig(), Arc::new(Tally::default()), None).unwrap()
}

fn decision(relay_closed: bool, millis: u64) -> Stamped {
    let latency = Duration::from_millis(millis);
    let decision = Decision {
        picture: 1,
        exposed: Micros::ZERO,
        verdict: HostVerdict::Clear,
        relay_closed,
        latency,
        fields: Report::default(),
        advice: None,
    };
    Stamped { at: Micros::from_millis(1000), event: Event::Decision(decision) }
}

fn json(bytes: &[u8]) -> serde_json::Value {
    serde_json::from_slice(bytes).unwrap()
}

#[test]
fn before_anything_was_heard_nothing_is_claimed() {
    let (mut model, board) = (model(), Board::default());
    model.publish(&board);
    let newest = board.newest();
    let status = json(&newest.status);
    assert_eq!((&status["relay"], &status["state"]), (&"unknown".into(), &"".into()));
    let payload = json(&newest.vda5050);
    assert_eq!(payload["safetyState"]["eStop"], "MANUAL", "not known is not permitted");
    assert_eq!(payload["errors"][0]["errorType"], "controller_silent");
    assert!(json(&newest.live)["profile"]["height_mm"].as_array().unwrap().iter().all(|one| one.is_null()));
}

#[test]
fn latencies_and_stops_are_counted() {
    let (mut model, board) = (model(), Board::default());
    for millis in 1..=100 {
        model.take(decision(true, millis));
    }
    model.take(decision(false, 3));
    model.take(decision(false, 3));
    model.take(decision(true, 3));
    model.take(decision(false, 3));
    model.publish(&board);
    let newest = board.newest();
    let live = json(&newest.live);
    assert_eq!(live["status"]["counts"]["stops"], 2);
    assert_eq!(live["stops"][0]["number"], 2, "the newest first");
    assert_eq!(live["stops"][0]["unix_ms"], 1_700_000_001_000_u64);
    let latency = &live["status"]["latency"];
    assert_eq!((&latency["p50_ms"], &latency["longest_ms"]), (&48.0.into(), &100.0.into()));
    let metrics = String::from_utf8(newest.metrics.clone()).unwrap();
    for line in [
        "nearfield_stops_total 2",
        "nearfield_host_latency_seconds_count 104",
        "nearfield_host_latency_seconds_bucket{le=\"0.1\"} 104",
        "nearfield_host_latency_seconds_bucket{le=\"0.002\"} 2",
    ] {
        assert!(metrics.lines().any(|one| one == line), "{line}\n{metrics}");
    }
}

/// Every sample follows a HELP and a TYPE of its own name, and every value is a number.
#[test]
fn metrics_keep_to_the_format() {
    let (mut model, board) = (model(), Board::default());
    model.take(decision(true, 1));
    model.publish(&board);
    let text = String::from_utf8(board.newest().metrics.clone()).unwrap();
    let mut family = "";
    let mut families = 0;
    for line in text.lines() {
        if let Some(rest) = line.strip_prefix("# HELP ") {
            family = rest.split(' ').next().unwrap();
            families += 1;
        } else if let Some(rest) = line.strip_prefix("# TYPE ") {
            assert_eq!(rest.split(' ').next().unwrap(), family);
        } else {
            let (name, value) = line.rsplit_once(' ').unwrap();
            assert!(name.starts_with(family), "{line}");
            assert!(value.parse::<f64>().unwrap().is_finite(), "{line}");
        }
    }
    assert!(families > 20);
}

#[test]
fn what_tier_three_sees_is_shown_with_its_place() {
    let (mut model, board) = (model(), Board::default());
    let one = Sighting { category: "human".to_owned(), confidence: 0.5, pixels: [1.0, 2.0, 3.0, 4.0] };
    for (seen, expected) in [(Ok(vec![one]), Some(true)), (Err("late".to_owned()), Some(false))] {
        let detections = Detections { exposed: Micros::ZERO, seen };
        model.take(Stamped { at: Micros::ZERO, event: Event::Detections(Arc::new(detections)) });
        model.publish(&board);
        let live = json(&board.newest().live);
        assert_eq!(live["tier_three"].as_bool(), expected);
        assert_eq!(live["objects"].as_array().unwrap().len(), usize::from(expected == Some(true)));
    }
}

#[test]
fn zones_case_and_advice_are_told_to_people_and_to_programs() {
    use nearfield_fields::{Finding, Role, ZoneState};
    let (mut model, board) = (model(), Board::default());
    let mut stamped = decision(false, 3);
    if let Event::Decision(decision) = &mut stamped.event {
        decision.fields.speed_mm_s = Some(250.0);
        decision.fields.case = Some(2);
        decision.fields.zones[0] = Some(ZoneState { role: Role::Protective, finding: Finding::Infringed });
        decision.fields.zones[1] = Some(ZoneState { role: Role::Warning, finding: Finding::Suspect });
        decision.fields.zones[3] = Some(ZoneState { role: Role::Named, finding: Finding::Infringed });
        decision.advice = Some(Action::GoAround);
    }
    model.take(stamped);
    model.publish(&board);
    let newest = board.newest();
    let status = json(&newest.status);
    assert_eq!(
        (&status["speed_mm_s"], &status["case"], &status["advice"]),
        (&250.0.into(), &2.into(), &"go_around".into())
    );
    let zone = |index: usize| {
        ["name", "role", "finding"].map(|key| status["zones"][index][key].as_str().unwrap().to_owned())
    };
    assert_eq!(
        [zone(0), zone(1), zone(2)].concat().join(" "),
        "A protective infringed B warning suspect D named infringed"
    );
    let metrics = String::from_utf8(newest.metrics.clone()).unwrap();
    for line in [
        "nearfield_zone_infringed{zone=\"A\",field=\"protective\"} 1",
        "nearfield_zone_infringed{zone=\"B\",field=\"warning\"} 0.5",
        "nearfield_zone_infringed{zone=\"D\",field=\"named\"} 1",
        "nearfield_case 2",
        "nearfield_robot_speed_millimetres_per_second 250",
    ] {
        assert!(metrics.lines().any(|one| one == line), "{line}\n{metrics}");
    }
    let payload = json(&newest.vda5050);
    let fields: Vec<_> = payload["errors"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|error| error["errorType"].as_str().unwrap().ends_with("_field"))
        .collect();
    assert_eq!(fields.len(), 2, "what is only named is no field: {payload}");
    assert_eq!(fields[1]["errorReferences"][1]["referenceValue"], "B");
}

/// Profile "cutoff": where the stripe is cut is told, how high things are is not.
#[test]
fn without_heights_the_profile_is_floor_or_nothing() {
    assert_eq!(
        [-30.0, -1.8, 0.0, 1.7, 1.9, 45.0].map(as_cut),
        [None, Some(0.0), Some(0.0), Some(0.0), None, None]
    );
}
