//! A thousand made-up modules through the same bytes, roster and view as real ones.

#![allow(clippy::unwrap_used)]

use std::time::{Duration, Instant};

use nearfield_fleet::report::Verdict;
use nearfield_fleet::roster::LOST_AFTER;
use nearfield_fleet::simulated::{Doing, Fleet};
use nearfield_fleet::{Filter, REPORT_INTERVAL, Roster, View};

const MODULES: usize = 1000;
/// As `nearfield fleet` draws.
const PAGE: usize = 40;

/// Runs the fleet from the beginning to `until`, in report intervals of virtual time.
fn roster_at(fleet: &mut Fleet, begun: Instant, until: Duration) -> Roster {
    let mut roster = Roster::default();
    let mut at = Duration::ZERO;
    while at <= until {
        for report in fleet.reports(at, 0, 1) {
            roster.take(&report.to_bytes(), begun + at).unwrap();
        }
        at += REPORT_INTERVAL;
    }
    roster
}

const fn verdict_of(doing: Doing) -> Verdict {
    match doing {
        Doing::Driving => Verdict::Go,
        Doing::Warning => Verdict::Warn,
        Doing::Stopping => Verdict::Stop,
        Doing::Blind => Verdict::Unknown,
        Doing::Silent => Verdict::Lost,
    }
}

/// At every moment the view shows what the modules do, and what they did a moment ago.
#[test]
fn every_one_of_a_thousand_modules_is_shown_as_it_is() {
    let (mut fleet, begun) = (Fleet::new(MODULES, 7, 1), Instant::now());
    // Well within an episode: who fell silent at its beginning is lost by now.
    let at = Duration::from_millis(21_800);
    let roster = roster_at(&mut fleet, begun, at);
    let expected: Vec<Verdict> = (0..MODULES).map(|index| verdict_of(fleet.doing(index, at))).collect();
    let mut shown = vec![None; MODULES];
    for (robot, module, entry) in roster.modules() {
        let robot: usize = robot.strip_prefix("amr-").unwrap().parse().unwrap();
        let module = ["front", "left", "rear", "right"].iter().position(|name| *name == module).unwrap();
        shown[robot * 4 + module] = Some(entry.verdict(begun + at));
    }
    assert_eq!(shown, expected.iter().copied().map(Some).collect::<Vec<_>>());
    for verdict in Verdict::ALL {
        assert!(expected.contains(&verdict), "the simulation shows no {}", verdict.name());
    }
    let view = View::of(&roster, &Filter::default(), begun + at, 0, PAGE);
    assert_eq!(view.modules.iter().sum::<usize>(), MODULES);
    for (verdict, count) in Verdict::ALL.iter().zip(view.modules) {
        assert_eq!(count, expected.iter().filter(|one| *one == verdict).count(), "{}", verdict.name());
    }
    let worst = expected.chunks(4).map(|robot| *robot.iter().max().unwrap());
    assert_eq!(view.robots[Verdict::Lost as usize], worst.filter(|worst| *worst == Verdict::Lost).count());
}

#[test]
fn when_all_fall_silent_all_are_lost_after_a_second_and_not_before() {
    let (mut fleet, begun) = (Fleet::new(MODULES, 7, 1), Instant::now());
    let last = Duration::from_millis(1000);
    let roster = roster_at(&mut fleet, begun, last);
    let lost = |at: Duration| {
        View::of(&roster, &Filter::default(), begun + at, 0, PAGE).modules[Verdict::Lost as usize]
    };
    let silent = (0..MODULES).filter(|index| fleet.doing(*index, last) == Doing::Silent).count();
    assert_eq!(lost(last + LOST_AFTER - Duration::from_millis(1)), silent);
    assert_eq!(lost(last + LOST_AFTER), MODULES);
}

#[test]
fn filters_and_pages_leave_nobody_out_and_the_worst_come_first() {
    let (mut fleet, begun) = (Fleet::new(MODULES, 7, 1), Instant::now());
    let at = Duration::from_millis(21_800);
    let roster = roster_at(&mut fleet, begun, at);
    let now = begun + at;
    let of = |filter: &Filter, page: usize| View::of(&roster, filter, now, page, PAGE);
    let all = of(&Filter::default(), 0);
    assert_eq!((all.matching, all.rows.len()), (MODULES / 4, PAGE));
    assert!(all.rows.is_sorted_by(|one, other| one.verdict >= other.verdict));
    let pages: usize = (0..10).map(|page| of(&Filter::default(), page).rows.len()).sum();
    assert_eq!(pages, MODULES / 4);
    for verdict in Verdict::ALL {
        let filter = Filter { verdicts: vec![verdict], text: String::new() };
        assert_eq!(of(&filter, 0).matching, all.robots[verdict as usize], "{}", verdict.name());
    }
    let cut = Filter { verdicts: Vec::new(), text: "stripe_cut".to_owned() };
    let cut = of(&cut, 0);
    assert!(cut.matching > 0 && cut.rows.iter().all(|row| row.verdict == Verdict::Stop));
    let one = Filter { verdicts: Vec::new(), text: "amr-0042".to_owned() };
    let text = of(&one, 0).text();
    assert_eq!(of(&one, 0).matching, 1);
    assert!(
        text.contains("250 robots: ") && text.contains("1000 modules: ") && text.contains("amr-0042"),
        "{text}"
    );
}
