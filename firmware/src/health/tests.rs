use super::*;

fn maps() -> Vec<ColumnMap> {
    (0..800)
        .map(|column| ColumnMap {
            floor_row: 100.0,
            floor_place: column as f32 - 400.0,
            height_per_row: 1.0,
            perspective_per_row: 0.0,
            bend_per_row: 0.0,
            place_per_height: 0.0,
        })
        .collect()
}

/// The report after so many pictures of this floor, 800 columns from -400 to 400 mm.
fn after(pictures: usize, height: impl Fn(usize, usize) -> f32) -> HealthReport {
    let mut health = Health::new();
    let maps = maps();
    for picture in 0..pictures {
        let heights: Vec<f32> = (0..800).map(|column| height(picture, column)).collect();
        health.observe(&heights, &maps);
    }
    health.report()
}

#[test]
fn a_good_floor_is_well_seen() {
    let report = after(100, |_, _| 0.0);
    assert!(report.aligned && report.capable && !report.offset_warning && !report.visibility_warning);
    assert_eq!(report.figures.floor_offset, Millimetres::ZERO);
    assert_eq!(report.figures.permitted_speed_percent, 100);
    assert!((report.figures.smallest_object.get() - FLOOR_TOLERANCE.get()).abs() < 0.1);
}

#[test]
fn nothing_is_said_before_enough_was_seen() {
    let few = usize::from(FEWEST_VALUES) * SEGMENTS / SEGMENTS_AT_ONCE;
    assert!(after(few - 4, |_, _| 1.5).aligned);
    assert!(!after(few, |_, _| 1.5).aligned);
    assert!(after(0, |_, _| 0.0).capable);
}

#[test]
fn an_offset_warns_and_stops_at_its_limits() {
    let with = |offset: f32| after(400, move |_, _| offset);
    for side in [-1.0, 1.0] {
        let warning = WARNING_FLOOR_OFFSET.get();
        assert!(!with(side * (warning - 0.01)).offset_warning);
        let warned = with(side * (warning + 0.01));
        assert!(warned.offset_warning && warned.aligned);
        assert_eq!(warned.figures.permitted_speed_percent, REDUCED_SPEED_PERCENT);
        let limit = LARGEST_FLOOR_OFFSET.get();
        assert!(with(side * (limit - 0.01)).aligned);
        assert!(!with(side * (limit + 0.01)).aligned);
        assert!((with(side * limit).figures.floor_offset.get() - side * limit).abs() < 0.01);
    }
}

#[test]
fn noise_takes_capability_and_says_where() {
    let noisy = |deviation: f32| {
        after(400, move |picture, column| {
            let wave = if (picture / 4 + column) % 2 == 0 { deviation } else { -deviation };
            if (600..650).contains(&column) { wave } else { 0.0 }
        })
    };
    // Tolerance 1.8 and three deviations.
    assert!(!noisy(0.32).visibility_warning);
    assert!(noisy(0.35).visibility_warning && noisy(0.35).capable);
    assert!(noisy(0.48).capable);
    assert!(!noisy(0.52).capable);
    let figures = noisy(0.45).figures;
    assert!((figures.smallest_object.get() - 3.15).abs() < 0.01, "{:?}", figures.smallest_object);
    assert!((figures.smallest_object_place.get() - 200.0).abs() < 1.0, "{:?}", figures.smallest_object_place);
}

#[test]
fn a_tilt_is_told_from_end_to_end() {
    let tilted = after(400, |_, column| (column as f32 - 399.5) / 800.0 * 0.8);
    assert!((tilted.figures.floor_rise.get() - 0.75).abs() < 0.02, "{:?}", tilted.figures.floor_rise);
    assert!(tilted.figures.floor_offset.get().abs() < 0.01);
}

#[test]
fn objects_and_gaps_do_not_move_the_floor() {
    let mixed = after(400, |_, column| match column {
        0..200 => 40.0,
        200..300 => f32::NAN,
        _ => 0.25,
    });
    assert!(mixed.aligned && (mixed.figures.floor_offset.get() - 0.25).abs() < 0.01);
    let mut health = Health::new();
    health.observe(&[0.0; 15], &maps()[..15]);
    assert_eq!(health, Health::new(), "fewer columns than segments");
}

#[test]
fn the_square_root_is_good_enough() {
    assert!(square_root(0.0) < 0.02);
    for value in [1e-4_f32, 0.01, 0.04, 0.3, 1.0, 3.24, 4.0] {
        assert!((square_root(value) / value.sqrt() - 1.0).abs() < 1e-2, "{value}");
    }
}

#[test]
fn what_differs_has_other_words_for_the_memory_check() {
    let mut all = vec![Health::new()];
    for segment in 0..SEGMENTS {
        for change in [
            |segment: &mut Segment| segment.offset = 1.0,
            |segment: &mut Segment| segment.variance = 1.0,
            |segment: &mut Segment| segment.values = 1,
        ] {
            let mut health = Health::new();
            change(&mut health.segments[segment]);
            all.push(health);
        }
    }
    crate::testing::all_differ(all.iter().map(|health| health.words().collect::<Vec<_>>()));
}

/// A segment of 50 columns, seen often enough.
fn segment(heights: impl Fn(usize) -> f32) -> Segment {
    let mut segment = Segment::UNSEEN;
    let heights: Vec<_> = (0..50).map(heights).collect();
    for _ in 0..FEWEST_VALUES {
        segment.update(&heights);
    }
    segment
}

#[test]
fn half_of_a_segment_must_show_floor() {
    for (floor_columns, judged) in [(0, false), (24, false), (25, true), (26, true)] {
        let segment = segment(|column| if column < floor_columns { 0.5 } else { 40.0 });
        assert_eq!(segment.is_judged(), judged, "{floor_columns}");
        assert_eq!(segment.offset, if judged { 0.5 } else { 0.0 });
    }
}

/// The first value counts in full, every further one by a twelfth.
#[test]
fn a_mean_follows_slowly() {
    let mut segment = segment(|_| 1.0);
    assert!((segment.offset - 1.0).abs() < 1e-6);
    segment.update(&[0.0; 50]);
    assert!((segment.offset - 11.0 / 12.0).abs() < 1e-6, "{}", segment.offset);
}

/// Scatter is measured about the mean, and both take their part of the capability.
#[test]
fn offset_and_scatter_add_up_in_the_smallest_object() {
    let segment = segment(|column| if column % 2 == 0 { 1.2 } else { 0.6 });
    assert!((segment.offset - 0.9).abs() < 1e-5 && (segment.variance - 0.09).abs() < 1e-5, "{segment:?}");
    let expected = FLOOR_TOLERANCE.get() + 0.9 + 3.0 * 0.3;
    assert!((segment.smallest_object() - expected).abs() < 0.01, "{}", segment.smallest_object());
}

/// A health whose segments have these offsets, without scatter, at their numbers as places.
fn with_offsets(offsets: [f32; SEGMENTS]) -> HealthReport {
    let mut health = Health::new();
    for ((segment, offset), place) in health.segments.iter_mut().zip(offsets).zip(0_u8..) {
        *segment = Segment { offset, variance: 0.0, place: f32::from(place), values: FEWEST_VALUES };
    }
    health.report()
}

#[test]
fn of_equally_blind_places_the_first_is_told() {
    let mut offsets = [0.0; SEGMENTS];
    (offsets[3], offsets[9]) = (-0.25, 0.25);
    assert_eq!(with_offsets(offsets).figures.smallest_object_place, Millimetres::new(3.0));
}

#[test]
fn exactly_at_a_warning_s_limit_there_is_none() {
    let limit = WARNING_FLOOR_OFFSET.get();
    assert!(!with_offsets([limit; SEGMENTS]).offset_warning);
    assert!(with_offsets([limit.next_up(); SEGMENTS]).offset_warning);
    // The offset that brings the smallest object exactly to its limit, within the rounding of the sum.
    let limit = WARNING_OBJECT_HEIGHT.get();
    let smallest = |offset: f32| with_offsets([offset; SEGMENTS]).figures.smallest_object.get();
    let near = limit - smallest(0.0) - 1e-6;
    let offsets = core::iter::successors(Some(near), |offset| Some(offset.next_up())).take(100);
    let (mut at, mut beyond) = (0, 0);
    for offset in offsets {
        let smallest = smallest(offset);
        assert_eq!(with_offsets([offset; SEGMENTS]).visibility_warning, smallest > limit);
        at += u32::from(smallest == limit);
        beyond += u32::from(smallest > limit);
    }
    assert!(at > 0 && beyond > 0, "{at} at the limit, {beyond} beyond");
}

#[test]
fn without_a_judged_segment_no_offset_is_told() {
    assert_eq!(Health::new().report(), HealthReport::UNSEEN);
}

/// Damage in one place changes the words whatever stands in the others.
#[test]
fn no_field_hides_another_one_from_the_memory_check() {
    let words = |variance: u32, values: u8| {
        let mut health = Health::new();
        health.segments[0] = Segment { variance: f32::from_bits(variance), values, ..Segment::UNSEEN };
        health.words().next()
    };
    assert_ne!(words(2, 3), words(2, 1));
    assert_ne!(words(2, 3), words(3, 3));
}
