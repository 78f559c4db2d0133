#![allow(clippy::unwrap_used)]

use std::path::Path;

use proptest::prelude::*;

use super::*;

/// Two zones, and three cases: slow, middle, fast.
const ROBOT: &str = "\
[[zone]]\nname = \"A\"\nstart_mm = -300\nend_mm = 0\n\
[[zone]]\nname = \"B\"\nstart_mm = 0\nend_mm = 300\nfield = \"warning\"\nahead_mm = 100\n\
[[case]]\nup_to_mm_s = 300\nprotective = [\"A\"]\n\
[[case]]\nup_to_mm_s = 700\nprotective = [\"A\"]\nwarning = [\"B\"]\n\
[[case]]\nup_to_mm_s = 1000\nprotective = [\"A\", \"B\"]\n";

fn fields(text: &str) -> Fields {
    Fields::new(&Configuration::read(text, Path::new("robot.toml")).unwrap())
}

fn gap(start_mm: f64, length_mm: f64) -> Stretch {
    Stretch { start_mm, end_mm: start_mm + length_mm, evidence: Evidence::Gap }
}

fn ahead(start_mm: f64, end_mm: f64, behind_mm: i32) -> Stretch {
    Stretch { start_mm, end_mm, evidence: Evidence::Ahead(behind_mm) }
}

/// Role and finding of zones A and B.
fn both(report: &Report) -> [(Role, Finding); 2] {
    [0, 1].map(|index| report.zones[index].map(|zone| (zone.role, zone.finding)).unwrap())
}

#[test]
fn the_speed_selects_the_case_and_ignorance_selects_all_of_them() {
    let fields = fields(ROBOT);
    let roles = |speed| {
        let report = fields.judge(speed, std::iter::empty());
        (report.case, both(&report).map(|(role, _)| role))
    };
    let (named, warning, protective) = (Role::Named, Role::Warning, Role::Protective);
    assert_eq!(roles(Some(0.0)), (Some(1), [protective, named]));
    assert_eq!(roles(Some(300.0)), (Some(1), [protective, named]));
    assert_eq!(roles(Some(300.1)), (Some(2), [protective, warning]));
    assert_eq!(roles(Some(-650.0)), (Some(2), [protective, warning]), "backwards is as fast");
    assert_eq!(roles(Some(1000.0)), (Some(3), [protective, protective]));
    for ignorance in [None, Some(1000.5), Some(f32::INFINITY), Some(f32::NAN)] {
        assert_eq!(roles(ignorance), (None, [protective, protective]), "{ignorance:?}");
    }
}

#[test]
fn without_cases_a_zone_is_what_its_field_says() {
    let text: String = ROBOT.split("[[case]]").next().unwrap().to_owned();
    let report = fields(&text).judge(Some(10.0), std::iter::empty());
    assert_eq!(both(&report), [(Role::Protective, Finding::Free), (Role::Warning, Finding::Free)]);
    assert_eq!((report.case, report.verdict()), (None, HostVerdict::Clear));
    assert_eq!(report.named().map(|(letter, _)| letter).collect::<String>(), "AB");
}

#[test]
fn a_cut_stops_in_a_protective_field_and_warns_in_a_warning_field() {
    let text: String = ROBOT.split("[[case]]").next().unwrap().to_owned();
    let fields = fields(&text);
    let verdict = |place: f64, length: f64| fields.judge(None, std::iter::once(gap(place, length))).verdict();
    let limit = f64::from(LONGEST_ALLOWED_GAP.get());
    assert_eq!(verdict(-200.0, limit / 2.0), HostVerdict::Clear);
    assert_eq!(verdict(-200.0, limit / 2.0 + 0.01), HostVerdict::Warn, "suspect");
    assert_eq!(verdict(-200.0, limit), HostVerdict::Warn);
    assert_eq!(verdict(-200.0, limit + 0.01), HostVerdict::Stop);
    assert_eq!(verdict(100.0, limit / 2.0), HostVerdict::Clear);
    assert_eq!(verdict(100.0, limit / 2.0 + 0.01), HostVerdict::Warn);
    assert_eq!(verdict(100.0, 200.0), HostVerdict::Warn);
    // Across the border it is in both; the stricter one counts.
    assert_eq!(verdict(-4.0, 8.0), HostVerdict::Stop);
    assert_eq!(verdict(320.0, 50.0), HostVerdict::Clear, "beside all zones");
}

#[test]
fn what_lies_ahead_infringes_as_far_as_the_zone_looks() {
    let text: String = ROBOT.split("[[case]]").next().unwrap().to_owned();
    let fields = fields(&text);
    let verdict = |start: f64, end: f64, behind| {
        fields.judge(None, std::iter::once(ahead(start, end, behind))).verdict()
    };
    assert_eq!(verdict(-100.0, -50.0, 400), HostVerdict::Stop, "A looks 400 mm ahead unless told otherwise");
    assert_eq!(verdict(-100.0, -50.0, 401), HostVerdict::Clear);
    assert_eq!(verdict(50.0, 90.0, 100), HostVerdict::Warn);
    assert_eq!(verdict(50.0, 90.0, 101), HostVerdict::Clear);
    assert_eq!(verdict(50.0, 90.0, -20), HostVerdict::Warn, "on the stripe");
}

#[test]
fn a_zone_that_is_only_named_says_where_something_is_and_asks_for_nothing() {
    let report = fields(ROBOT).judge(Some(100.0), [gap(100.0, 20.0), ahead(100.0, 120.0, 0)].into_iter());
    assert_eq!(both(&report), [(Role::Protective, Finding::Free), (Role::Named, Finding::Infringed)]);
    assert_eq!(report.verdict(), HostVerdict::Clear);
}

#[test]
fn zones_beyond_the_watched_stripe_are_refused_by_name() {
    use nearfield_shared::camera::Vector;
    let stripe = |start, end| Stripe {
        point: Vector::new(0.0, 500.0, 0.0),
        direction: Vector::new(1.0, 0.0, 0.0),
        start,
        end,
    };
    let configuration = Configuration::read(ROBOT, Path::new("robot.toml")).unwrap();
    assert_eq!(Fields::check(&configuration, &stripe(-300.0, 300.0)), Ok(()));
    let told = Fields::check(&configuration, &stripe(-300.0, 299.0)).unwrap_err();
    assert_eq!(told.name, "B");
    assert!(told.to_string().contains("watches -300 to 299 mm only"), "{told}");
}

fn strictness(verdict: HostVerdict) -> u8 {
    match verdict {
        HostVerdict::Clear => 0,
        HostVerdict::Warn => 1,
        HostVerdict::Stop => 2,
    }
}

proptest! {
    /// Whatever is found: not to know the speed is never less strict than to know it, and what is found in addition never
    /// makes anything less strict.
    #[test]
    fn ignorance_and_more_evidence_are_never_less_strict(
        speed in 0.0_f32..2000.0,
        found in prop::collection::vec((-350.0..350.0, 0.0..60.0, prop::option::of(-50..600)), 0..6),
    ) {
        let fields = fields(ROBOT);
        let stretches: Vec<Stretch> = found.iter().map(|(start_mm, length, behind): &(f64, f64, Option<i32>)| Stretch {
            start_mm: *start_mm,
            end_mm: start_mm + length,
            evidence: behind.map_or(Evidence::Gap, Evidence::Ahead),
        }).collect();
        let known = strictness(fields.judge(Some(speed), stretches.iter().copied()).verdict());
        let unknown = strictness(fields.judge(None, stretches.iter().copied()).verdict());
        prop_assert!(unknown >= known, "speed {speed}: {known}, unknown: {unknown}");
        for less in 0..stretches.len() {
            let fewer = fields.judge(Some(speed), stretches[..less].iter().copied());
            prop_assert!(strictness(fewer.verdict()) <= known);
        }
    }
}
