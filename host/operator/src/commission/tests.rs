#![allow(clippy::unwrap_used)]

use std::time::Duration;

use nearfield_fields::Report;
use nearfield_shared::columns::Decimation;
use nearfield_shared::linescan::HostVerdict;

use super::*;
use crate::server::tests::rig;

pub fn plan() -> Plan {
    let section =
        |title: &str| Section { title: title.to_owned(), checks: vec![Check::new("a", "yes", "yes", true)] };
    let sections = vec![section("Rig"), section("Size and fields")];
    Plan {
        protocol: Protocol { module: "front".to_owned(), sections, on_hardware: true, ..Protocol::default() },
        stripe_mm: [-300.0, 300.0],
        piece_mm: 12.0,
        worst_ms: 100.0,
        calibration: rig().calibration_id(),
        now: || "today".to_owned(),
        hands: None,
    }
}

/// A desk, and a robot's edge with a person who does what the page says.
struct Scene {
    desk: Desk,
    geometry: Box<StripeGeometry<LARGEST_COLUMN_COUNT>>,
    now: u64,
    closed: bool,
    piece: Option<f64>,
}

impl Scene {
    fn new(plan: Plan) -> Self {
        let mut geometry = Box::new(StripeGeometry::empty());
        geometry.fill(&rig(), Decimation::for_line_scan(rig().image().width)).unwrap();
        Self { desk: Desk::new(plan), geometry, now: 0, closed: true, piece: None }
    }

    /// Rows of a floor with the piece on it.
    fn rows(&self) -> Vec<Option<f32>> {
        let row = |column: usize| {
            let map = self.geometry.map(column)?;
            let is_hidden = self.piece.is_some_and(|piece| (f64::from(map.floor_place) - piece).abs() < 8.0);
            (!is_hidden).then_some(map.floor_row)
        };
        (0..self.geometry.column_count()).map(row).collect()
    }

    /// A picture; the relays open for what lies there.
    fn picture(&mut self) {
        self.now += 20;
        self.closed &= self.piece.is_none();
        let decision = Decision {
            picture: self.now / 20,
            exposed: Micros::from_millis(self.now.saturating_sub(25)),
            verdict: HostVerdict::Clear,
            relay_closed: self.closed,
            fields: Report::default(),
            advice: None,
            latency: Duration::ZERO,
        };
        let rows = self.rows();
        self.desk.watch(&decision, Micros::from_millis(self.now), &self.geometry, Some(&rows));
    }

    /// Until all is done, at most so many pictures; what the page has said, each once.
    fn obey(&mut self, pictures: usize) -> Vec<String> {
        let mut said: Vec<String> = Vec::new();
        for _ in 0..pictures {
            let words = self.desk.view().instruction;
            if words.starts_with("Lay the rod") {
                self.piece = self.desk.view().place_mm;
            } else if words.starts_with("Take the rod away") {
                self.piece = None;
            } else if words.contains("ress the reset button") && self.piece.is_none() {
                self.closed = !words.contains("Do not press");
            }
            if said.last() != Some(&words) {
                said.push(words);
            }
            if !self.desk.view().running {
                break;
            }
            self.picture();
        }
        said
    }
}

#[test]
fn a_person_who_does_what_the_page_says_gets_a_protocol_that_is_passed() {
    let mut scene = Scene::new(plan());
    assert!(scene.desk.protocol().is_none());
    scene.desk.order(Order::Begin("A. Name".to_owned()), Some(rig().calibration_id()));
    let said = scene.obey(2000);
    assert_eq!(said.iter().filter(|words| words.starts_with("Lay the rod of 12 mm")).count(), 3, "{said:?}");
    let view = scene.desk.view();
    assert_eq!((view.passed, view.running), (Some(true), false), "{view:?}");
    let standings: Vec<Standing> = view.steps.iter().map(|step| step.standing).collect();
    assert_eq!(standings, [Standing::Passed, Standing::Passed, Standing::Passed, Standing::Now]);
    let protocol = scene.desk.protocol().unwrap();
    assert_eq!((protocol.person.as_str(), protocol.made.as_str()), ("A. Name", "today"));
    assert!(protocol.is_passed() && protocol.html().contains("To be signed"));
}

#[test]
fn another_calibration_in_the_controller_or_a_walk_that_was_ended_is_not_passed() {
    for (stored, pictures) in
        [(None, 2000), (Some(CalibrationId::new(5)), 2000), (Some(rig().calibration_id()), 300)]
    {
        let mut scene = Scene::new(plan());
        scene.desk.order(Order::Begin("A. Name".to_owned()), stored);
        scene.obey(pictures);
        scene.desk.order(Order::End, None);
        assert_eq!(scene.desk.view().passed, Some(false), "{stored:?}");
        assert!(scene.desk.protocol().unwrap().html().contains("must not be released"));
    }
}

#[test]
fn simulated_hands_are_told_the_same_and_nothing_outside_of_a_walk() {
    let hands = Hands::default();
    let mut scene = Scene::new(Plan { hands: Some(hands.clone()), ..plan() });
    assert_eq!(hands.asked(), HandsAsked::Nothing);
    scene.desk.order(Order::Begin("A. Name".to_owned()), None);
    assert_eq!(hands.asked(), HandsAsked::Press);
    while !matches!(hands.asked(), HandsAsked::Lay(_)) {
        scene.picture();
    }
    let HandsAsked::Lay(place) = hands.asked() else { unreachable!() };
    assert!((place + 240.0).abs() < 1e-3, "{place}");
    assert!(scene.desk.view().instruction.starts_with("Simulated hands do this: Lay the rod"));
    scene.desk.order(Order::End, None);
    assert_eq!(hands.asked(), HandsAsked::Nothing);
}
