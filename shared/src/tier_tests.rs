//! Tests of tiers 1 and 2 through the monitor: each states a rule of the safety function.

use crate::columns::{Decimation, GeometryError};
use crate::cutoff::is_floor;
use crate::height::{Cluster, SizeClass};
use crate::limits::{
    FLOOR_TOLERANCE, IMMEDIATE_GAP, LARGE_HEIGHT, LARGEST_COLUMN_COUNT, LONGEST_ALLOWED_GAP, RUN_OVER_HEIGHT,
    WEAKEST_SIGNAL,
};
use crate::monitor::{ColumnReading, StripeMonitor, StripeReport};
use crate::rig::{Rig, Stripe};
use crate::run_over::{RunOverPermit, Stretch};
use crate::testing::{height_rig, rig_of, side_rig};
use crate::units::{Millimetres, SignalQuality};
use proptest::prelude::*;

type Monitor = StripeMonitor<LARGEST_COLUMN_COUNT>;

fn monitor(rig: &Rig) -> Box<Monitor> {
    let mut monitor = Box::new(Monitor::new());
    monitor.configure(rig, Decimation::for_line_scan(rig.image().width)).unwrap();
    monitor
}

/// A scan in which the stripe at place s has height `height_at(s)`; NaN = no stripe.
fn scan(monitor: &Monitor, height_at: impl Fn(f32) -> f32) -> Vec<ColumnReading> {
    let geometry = monitor.geometry();
    (0..geometry.column_count())
        .map(|column| match geometry.map(column) {
            Some(map) => {
                let row = map.row(height_at(map.floor_place));
                let quality = if row.is_nan() { SignalQuality::NONE } else { SignalQuality::BEST };
                ColumnReading { row, quality }
            }
            None => ColumnReading::MISSING,
        })
        .collect()
}

fn show(monitor: &mut Monitor, readings: &[ColumnReading], frames: usize) -> StripeReport {
    let mut report = StripeReport::default();
    for _ in 0..frames {
        report = monitor.update(readings.iter().copied());
    }
    report
}

const FLOOR: fn(f32) -> f32 = |_| 0.0;

/// Nothing on the stripe but a missing stretch around `centre`.
fn cut(centre: f32, length: f32) -> impl Fn(f32) -> f32 {
    move |s| if (s - centre).abs() < length / 2.0 { f32::NAN } else { 0.0 }
}

#[test]
fn a_whole_stripe_is_proven_only_when_the_vote_is_full() {
    for rig in [height_rig(), side_rig()] {
        let mut monitor = monitor(&rig);
        let floor = scan(&monitor, FLOOR);
        assert!(show(&mut monitor, &floor, 1).is_cut(), "one frame is not enough");
        let report = show(&mut monitor, &floor, 2);
        assert!(!report.is_cut() && report.cutoff.voted.is_none(), "{:?}", report.cutoff);
        assert_eq!(report.size(), None);
        assert_eq!(report.cutoff.floor_columns, report.watched_columns);
        monitor.reset();
        assert!(show(&mut monitor, &floor, 1).is_cut(), "a reset empties the vote");
    }
}

#[test]
fn no_configuration_and_no_readings_are_cuts() {
    let mut monitor = Box::new(Monitor::new());
    assert!(monitor.update(core::iter::empty()).is_cut());
    let rig = rig_of(
        crate::camera::Vector::new(0.0, 0.0, 200.0),
        0.0,
        30.0,
        900.0,
        (1152, 648),
        crate::camera::Vector::new(0.0, 0.0, 200.0),
        (-200.0, 200.0),
    )
    .unwrap();
    assert_eq!(monitor.configure(&rig, Decimation::none(1152)), Err(GeometryError::NoParallax));
    let blind = monitor
        .update(core::iter::repeat_n(ColumnReading { row: 300.0, quality: SignalQuality::BEST }, 1152));
    assert!(blind.is_cut() && blind.is_stripe_missing());
    let mut configured = self::monitor(&height_rig());
    let report = show(&mut configured, &[], 3);
    assert!(report.is_cut() && report.is_stripe_missing());
    assert_eq!(report.size(), Some(SizeClass::Unknown));
}

#[test]
fn the_floor_tolerance_holds_on_both_sides_and_unknown_is_never_floor() {
    let limit = FLOOR_TOLERANCE.get();
    for (height, floor) in [(limit, true), (-limit, true), (limit + 0.001, false), (-limit - 0.001, false)] {
        assert_eq!(is_floor(height), floor, "{height}");
    }
    assert!(!is_floor(f32::NAN) && !is_floor(f32::INFINITY));
}

#[test]
fn a_signal_weaker_than_the_limit_is_no_stripe() {
    let mut monitor = monitor(&height_rig());
    for (quality, cut) in [(WEAKEST_SIGNAL.get(), false), (WEAKEST_SIGNAL.get() - 1, true)] {
        let mut readings = scan(&monitor, FLOOR);
        for reading in &mut readings {
            reading.quality = SignalQuality::new(quality);
        }
        assert_eq!(show(&mut monitor, &readings, 3).is_cut(), cut, "quality {quality}");
    }
}

#[test]
#[cfg_attr(miri, ignore = "thousands of line-scans")]
fn five_millimetres_are_found_everywhere_and_less_than_two_columns_short_of_it_is_not() {
    for rig in [height_rig(), side_rig()] {
        let mut monitor = monitor(&rig);
        let (start, end) = (rig.stripe().start as f32, rig.stripe().end as f32);
        let mut place = start + 10.0;
        while place < end - 10.0 {
            let pitch = pitch_at(&monitor, place);
            let found = scan(&monitor, cut(place, 5.0 + pitch));
            let report = show(&mut monitor, &found, 3);
            assert!(report.is_cut(), "5 mm (and a column) at {place}: {:?}", report.cutoff.voted);
            let gap = report.cutoff.voted.unwrap();
            assert!(gap.start.get() < place && gap.end.get() > place);
            assert!(gap.length().get() < 5.0 + 3.0 * pitch + 0.1, "{:?} at {place}", gap.length());
            let small = scan(&monitor, cut(place, 5.0 - 2.0 * pitch - 0.1));
            let report = show(&mut monitor, &small, 3);
            assert!(!report.is_cut(), "5 mm less two columns at {place}: {:?}", report.cutoff.voted);
            place += 7.3;
        }
    }
}

/// Millimetres between columns at a place.
fn pitch_at(monitor: &Monitor, place: f32) -> f32 {
    let maps = monitor.geometry().maps();
    let pair = maps.windows(2).find(|pair| pair[1].floor_place >= place).unwrap();
    pair[1].floor_place - pair[0].floor_place
}

#[test]
fn the_gap_limit_decides_on_both_sides() {
    let mut monitor = monitor(&height_rig());
    let pitch = pitch_at(&monitor, 0.0);
    // Between bounding floor columns a run of n missing columns measures (n + 1) pitches.
    let columns_at_limit = (LONGEST_ALLOWED_GAP.get() / pitch).floor() as usize;
    let centre = monitor.geometry().watched().start + 500;
    for (bounds, cut) in [(columns_at_limit, false), (columns_at_limit + 1, true)] {
        let mut readings = scan(&monitor, FLOOR);
        readings[centre..centre + bounds - 1].fill(ColumnReading::MISSING);
        let report = show(&mut monitor, &readings, 3);
        let length = report.cutoff.voted.unwrap().length().get();
        assert_eq!(length > LONGEST_ALLOWED_GAP.get(), cut, "{length}");
        assert_eq!(report.is_cut(), cut, "{length} mm");
    }
}

#[test]
fn a_small_gap_needs_two_frames_of_three_and_a_large_one_needs_one() {
    let mut monitor = monitor(&height_rig());
    let floor = scan(&monitor, FLOOR);
    for (length, frames) in [(12.0, 2), (IMMEDIATE_GAP.get() + 1.0, 1)] {
        let gap = scan(&monitor, cut(50.0, length));
        assert!(!show(&mut monitor, &floor, 3).is_cut());
        for frame in 1..=frames {
            assert_eq!(show(&mut monitor, &gap, 1).is_cut(), frame == frames, "{length} mm, frame {frame}");
        }
    }
    assert!(!show(&mut monitor, &floor, 3).is_cut());
    let not_quite = scan(&monitor, cut(50.0, IMMEDIATE_GAP.get() - 2.0));
    assert!(!show(&mut monitor, &not_quite, 1).is_cut());
}

#[test]
fn the_gap_that_trips_at_once_is_the_one_that_is_told() {
    let mut monitor = monitor(&height_rig());
    let floor = scan(&monitor, FLOOR);
    let large = scan(&monitor, cut(50.0, IMMEDIATE_GAP.get() + 10.0));
    let small = scan(&monitor, cut(-50.0, 12.0));
    assert_eq!(show(&mut monitor, &floor, 3).longest_gap(), None);
    let report = show(&mut monitor, &large, 1);
    assert!(
        report.cutoff.voted.is_none() && report.longest_gap() == report.cutoff.single,
        "{:?}",
        report.cutoff
    );
    let report = show(&mut monitor, &large, 2);
    assert_eq!(report.longest_gap(), report.cutoff.voted, "the vote has caught up");
    let report = show(&mut monitor, &floor, 1);
    assert_eq!(report.longest_gap(), report.cutoff.voted, "the vote still holds it");
    show(&mut monitor, &floor, 2);
    assert_eq!(show(&mut monitor, &small, 1).longest_gap(), None, "too small to trip at once, and outvoted");
}

#[test]
fn scattered_weak_columns_do_not_stop() {
    for rig in [height_rig(), side_rig()] {
        let mut monitor = monitor(&rig);
        let mut readings = scan(&monitor, FLOOR);
        for reading in readings.iter_mut().step_by(4) {
            *reading = ColumnReading::MISSING;
        }
        assert!(!show(&mut monitor, &readings, 3).is_cut());
    }
}

#[test]
fn gaps_at_either_end_of_the_stripe_are_found() {
    let rig = side_rig();
    let mut monitor = monitor(&rig);
    for range in [-500.0_f32..-490.0, 548.0..561.0] {
        let readings = scan(&monitor, |s| if range.contains(&s) { f32::NAN } else { 0.0 });
        let report = show(&mut monitor, &readings, 3);
        assert!(report.is_cut(), "{range:?}: {:?}", report.cutoff.voted);
    }
}

#[test]
fn every_gap_is_told_with_its_place() {
    let mut monitor = monitor(&height_rig());
    let readings = scan(&monitor, |s| {
        if (s + 100.0).abs() < 10.0 {
            f32::NAN
        } else if (s - 60.0).abs() < 20.0 {
            30.0
        } else {
            0.0
        }
    });
    show(&mut monitor, &readings, 2);
    let mut gaps = Vec::new();
    let mut clusters: Vec<Cluster> = Vec::new();
    let report = monitor.update_with(
        readings.iter().copied(),
        &RunOverPermit::NONE,
        |gap| gaps.push(gap),
        |cluster| clusters.push(cluster),
    );
    assert_eq!(gaps.len(), 2);
    for (gap, start, end) in [(gaps[0], -110.0, -90.0), (gaps[1], 40.0, 80.0)] {
        assert!((gap.start.get() - start).abs() < 1.0 && (gap.end.get() - end).abs() < 1.0, "{gap:?}");
    }
    assert_eq!(report.cutoff.voted, Some(gaps[1]));
    let [cluster] = clusters[..] else { panic!("{clusters:?}") };
    assert!((cluster.extreme.height.get() - 30.0).abs() < 0.01);
    assert!((cluster.first.get() - 40.0).abs() < 1.0 && (cluster.last.get() - 80.0).abs() < 1.0);
    assert!((19.0..21.0).contains(&report.heights.longest_unknown.get()));
    assert_eq!(report.size(), Some(SizeClass::Unknown), "a missing stretch makes the size unknown");
}

#[test]
fn sizes_divide_at_50_mm() {
    let limit = LARGE_HEIGHT.get();
    for (height, class) in [
        (limit - 0.01, SizeClass::Small),
        (limit, SizeClass::Large),
        (limit + 0.01, SizeClass::Large),
        (f32::NAN, SizeClass::Unknown),
    ] {
        assert_eq!(SizeClass::of(Millimetres::new(height)), class, "{height}");
    }
}

#[test]
fn something_high_stops_however_narrow_it_is() {
    let mut monitor = monitor(&height_rig());
    let floor = scan(&monitor, FLOOR);
    for (height, columns, large) in [(51.0, 2, true), (51.0, 1, false), (49.0, 3, false)] {
        let mut narrow = floor.clone();
        let geometry = monitor.geometry();
        for (column, reading) in narrow.iter_mut().enumerate().skip(600).take(columns) {
            reading.row = geometry.map(column).unwrap().row(height);
        }
        show(&mut monitor, &floor, 3);
        assert!(!show(&mut monitor, &narrow, 1).large, "one frame of three");
        let report = show(&mut monitor, &narrow, 1);
        assert_eq!(report.large, large, "{height} mm, {columns} columns");
        assert!(!report.is_cut(), "too narrow for tier 1");
    }
}

#[test]
fn one_wild_column_does_not_set_the_height() {
    let mut monitor = monitor(&height_rig());
    let mut readings = scan(&monitor, |s| if s.abs() < 30.0 { 20.0 } else { 0.0 });
    let wild = monitor.geometry().watched().start + 570;
    readings[wild].row = monitor.geometry().map(wild).unwrap().row(31.0);
    let report = show(&mut monitor, &readings, 3);
    assert!((report.heights.highest.unwrap().height.get() - 20.0).abs() < 0.01, "{:?}", report.heights);
}

#[test]
fn of_two_objects_the_higher_is_told_wherever_it_stands() {
    let rig = height_rig();
    let mut monitor = monitor(&rig);
    for (left, right) in [(30.0, 70.0), (70.0, 30.0)] {
        let two = move |s: f32| match s {
            s if (-200.0..-150.0).contains(&s) => left,
            s if (100.0..150.0).contains(&s) => right,
            _ => 0.0,
        };
        let readings = scan(&monitor, two);
        let highest = show(&mut monitor, &readings, 3).heights.highest.unwrap();
        assert!((highest.height.get() - 70.0).abs() < 0.2, "{left} {right}: {highest:?}");
    }
    for (left, right) in [(-8.0, -20.0), (-20.0, -8.0)] {
        let two = move |s: f32| match s {
            s if (-200.0..-150.0).contains(&s) => left,
            s if (100.0..150.0).contains(&s) => right,
            _ => 0.0,
        };
        let readings = scan(&monitor, two);
        let lowest = show(&mut monitor, &readings, 3).heights.lowest.unwrap();
        assert!((lowest.height.get() + 20.0).abs() < 0.2, "{left} {right}: {lowest:?}");
    }
}

/// No ray comes down to a point at or above the laser itself.
#[test]
fn a_point_above_the_laser_has_no_place_on_the_floor() {
    let monitor = monitor(&height_rig());
    let geometry = monitor.geometry();
    let map = geometry.map(geometry.watched().start).unwrap();
    assert_eq!(geometry.laser_height(), Millimetres::new(200.0));
    assert!(geometry.ray_place(map, map.row(199.0)).is_finite());
    assert!(geometry.ray_place(map, map.row(201.0)).is_nan() && geometry.ray_place(map, f32::NAN).is_nan());
}

#[test]
fn a_gap_has_the_same_ends_whichever_is_named_first() {
    assert_eq!(crate::cutoff::Gap::between(3.0, -2.0), crate::cutoff::Gap::between(-2.0, 3.0));
    assert_eq!(crate::cutoff::Gap::between(3.0, -2.0).length(), Millimetres::new(5.0));
}

#[test]
fn a_drop_is_measured_below_the_floor() {
    let mut monitor = monitor(&height_rig());
    let readings = scan(&monitor, |s| if (s - 10.0).abs() < 15.0 { -12.0 } else { 0.0 });
    let report = show(&mut monitor, &readings, 3);
    assert!(report.is_cut());
    assert!((report.heights.lowest.unwrap().height.get() + 12.0).abs() < 0.01);
    assert_eq!(report.heights.highest, None);
}

proptest! {
    /// Unknown means stop: taking readings away never turns a cut stripe into a whole one.
    #[test]
    fn losing_columns_never_heals_a_cut(centre in -300.0..300.0_f32, length in 0.0..40.0_f32, lost in proptest::collection::vec(0..1152_usize, 0..40)) {
        let mut monitor = monitor(&height_rig());
        let readings = scan(&monitor, cut(centre, length));
        let before = show(&mut monitor, &readings, 3).is_cut();
        let mut fewer = readings;
        for column in lost {
            fewer[column] = ColumnReading::MISSING;
        }
        monitor.reset();
        prop_assert!(show(&mut monitor, &fewer, 3).is_cut() || !before);
    }

    #[test]
    fn no_reading_panics(rows in proptest::collection::vec((any::<f32>(), any::<u8>()), 0..1300)) {
        let mut monitor = monitor(&side_rig());
        let report = monitor.update(rows.into_iter().map(|(row, quality)| ColumnReading { row, quality: SignalQuality::new(quality) }));
        prop_assert!(report.is_cut(), "one frame never fills the vote");
    }
}

/// A permit for one stretch.
fn permit(start: i16, end: i16) -> RunOverPermit {
    RunOverPermit { stretches: [None, Stretch::new(start, end), None, None] }
}

fn show_with(monitor: &mut Monitor, permit: &RunOverPermit, height_at: impl Fn(f32) -> f32) -> StripeReport {
    let readings = scan(monitor, height_at);
    let mut report = StripeReport::default();
    for _ in 0..3 {
        report = monitor.update_with(readings.iter().copied(), permit, |_| {}, |_| {});
    }
    report
}

/// Rigs whose places rise with the column, and fall: the second one's stripe is told from its other end.
fn both_ways() -> [Rig; 2] {
    let rig = height_rig();
    let stripe = *rig.stripe();
    let told =
        Stripe { direction: stripe.direction.scaled(-1.0), start: -stripe.end, end: -stripe.start, ..stripe };
    let rigs = [rig, Rig::new(rig.image(), *rig.camera(), *rig.laser(), told).unwrap()];
    let directions = rigs.map(|rig| {
        let monitor = monitor(&rig);
        let maps = monitor.geometry().maps();
        maps.first().unwrap().floor_place < maps.last().unwrap().floor_place
    });
    assert_ne!(directions[0], directions[1], "the tests need both");
    rigs
}

#[test]
fn under_a_permit_low_columns_pass_and_only_there() {
    let limit = RUN_OVER_HEIGHT.get();
    for rig in both_ways() {
        let mut monitor = monitor(&rig);
        let raised = |height: f32| move |s: f32| if (0.0..60.0).contains(&s) { height } else { 0.0 };
        for (height, passes) in [(limit - 0.5, true), (limit + 0.5, false), (-3.0, false), (f32::NAN, false)]
        {
            let report = show_with(&mut monitor, &permit(-10, 70), raised(height));
            assert_eq!(!report.is_cut(), passes, "{height}");
            assert_eq!(report.passed.is_some(), passes, "{height}");
        }
        let report = show_with(&mut monitor, &permit(-10, 70), raised(20.0));
        let passed = report.passed.unwrap();
        assert!(
            passed.start.get() >= 0.0 && passed.end.get() <= 60.0 && passed.length().get() > 50.0,
            "{passed:?}"
        );
        assert!((report.heights.highest.unwrap().height.get() - 20.0).abs() < 0.5, "tier 2 sees what passes");
        for elsewhere in
            [permit(-10, 30), permit(30, 70), permit(100, 200), permit(-300, -100), RunOverPermit::NONE]
        {
            assert!(show_with(&mut monitor, &elsewhere, raised(20.0)).is_cut(), "{elsewhere:?}");
        }
        let two = RunOverPermit { stretches: [Stretch::new(-10, 30), None, None, Stretch::new(25, 70)] };
        assert_eq!(show_with(&mut monitor, &two, raised(20.0)).passed, Some(passed), "pieces add up");
    }
}

#[test]
fn a_permit_hides_no_gap_in_its_stretch() {
    for rig in both_ways() {
        let mut monitor = monitor(&rig);
        // Low debris with a stretch without stripe in it: unknown is never floor.
        for (unknown, cut) in [(3.0, false), (12.0, true)] {
            let report = show_with(&mut monitor, &permit(-10, 70), |s| {
                let hidden = (s - 30.0).abs() < unknown / 2.0;
                if hidden {
                    f32::NAN
                } else if (0.0..60.0).contains(&s) {
                    15.0
                } else {
                    0.0
                }
            });
            assert_eq!(report.is_cut(), cut, "{unknown} mm");
        }
    }
}

#[test]
fn a_permit_over_no_rig_passes_nothing() {
    let mut monitor = Box::new(Monitor::new());
    let report = monitor.update_with(core::iter::empty(), &permit(-100, 100), |_| {}, |_| {});
    assert!(report.is_cut() && report.passed.is_none());
}

/// A gap is in this frame at once and in the vote a frame later; it leaves both in the same order.
#[test]
fn a_frame_s_own_gap_and_the_vote_s_come_and_go_apart() {
    let mut monitor = monitor(&height_rig());
    let (clean, gap) = (scan(&monitor, FLOOR), scan(&monitor, cut(0.0, 12.0)));
    show(&mut monitor, &clean, 3);
    for (readings, single, voted) in
        [(&gap, true, false), (&gap, true, true), (&clean, false, true), (&clean, false, false)]
    {
        let cutoff = show(&mut monitor, readings, 1).cutoff;
        assert_eq!((cutoff.single.is_some(), cutoff.voted.is_some()), (single, voted));
    }
}
