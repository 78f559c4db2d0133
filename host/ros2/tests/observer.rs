//! What a robot's navigation is shown of the stripe.

#![allow(clippy::unwrap_used)]

mod scene;

use nearfield_ros2::floor::{Floor, FloorError, Point};
use nearfield_ros2::messages::{Header, LaserScan};
use nearfield_ros2::observer::Observer;
use nearfield_shared::camera::{Pixel, Vector};
use nearfield_shared::columns::Decimation;
use nearfield_shared::linescan::LineScan;
use nearfield_shared::rig::Rig;
use scene::{line_scan, rig, rig_with};

/// Pictures until the vote is full, and until most of it is clean.
const VOTE: usize = 3;
const MOST: usize = 2;

fn observer_of(rig: &Rig, height: impl Fn(f32) -> Option<f32>) -> Observer {
    let mut observer = Observer::new(rig, 0.02).unwrap();
    let bytes = line_scan(rig, height);
    for _ in 0..VOTE {
        observer.see(&LineScan::parse(&bytes).unwrap());
    }
    observer
}

/// The points that nav2's collision monitor takes from a scan: all whose range is neither too short nor too long.
fn obstacles(scan: &LaserScan) -> Vec<(f32, f32)> {
    let taken = |range: f32| range >= scan.range_min && range <= scan.range_max;
    let point = |(index, range): (usize, &f32)| {
        let angle = scan.angle_min + scan.angle_increment * index as f32;
        (range * angle.cos(), range * angle.sin())
    };
    scan.ranges.iter().enumerate().filter(|(_, range)| taken(**range)).map(point).collect()
}

#[test]
fn a_clean_floor_is_free_only_once_most_of_the_vote_says_so() {
    let rig = rig();
    let mut observer = Observer::new(&rig, 0.02).unwrap();
    let bytes = line_scan(&rig, |_| Some(0.0));
    let scan = LineScan::parse(&bytes).unwrap();
    let count = observer.laser_scan(Header::default()).ranges.len();
    for _ in 0..MOST {
        assert_eq!(obstacles(&observer.laser_scan(Header::default())).len(), count, "nothing is proven yet");
        observer.see(&scan);
    }
    assert!(observer.is_free());
    assert!(obstacles(&observer.laser_scan(Header::default())).is_empty());
    observer.forget();
    assert_eq!(obstacles(&observer.laser_scan(Header::default())).len(), count, "nothing is known any more");
}

#[test]
fn where_no_stripe_is_seen_an_obstacle_stands_at_the_stripe_and_nowhere_else() {
    let rig = rig();
    for (start, end) in [(-120.0, -90.0), (0.0, 8.0), (200.0, 290.0)] {
        let cut = |place: f32| (start..=end).contains(&place);
        let scan = observer_of(&rig, |place| (!cut(place)).then_some(0.0)).laser_scan(Header::default());
        let found = obstacles(&scan);
        // ROS: x forward, y left; the stripe is 0.5 m ahead, and its s grows to the right.
        let (left, right) = (-start / 1000.0, -end / 1000.0);
        assert!(found.iter().all(|(x, _)| (x - 0.5).abs() < 0.003), "{found:?}");
        let (lowest, highest) = found
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), (_, y)| (low.min(*y), high.max(*y)));
        // What is cut is shown whole, and at most 3 mm more on each side.
        assert!(lowest <= right + 0.0005 && lowest > right - 0.003, "{lowest} {right}");
        assert!(highest >= left - 0.0005 && highest < left + 0.003, "{highest} {left}");
        let beams: Vec<usize> =
            (0..scan.ranges.len()).filter(|beam| scan.ranges[*beam].is_finite()).collect();
        assert_eq!(beams.len(), beams[beams.len() - 1] - beams[0] + 1, "no beam within is free");
    }
}

#[test]
fn nothing_in_a_scan_is_not_a_number_whatever_was_seen() {
    let rig = rig();
    for height in [None, Some(0.0), Some(120.0), Some(-30.0), Some(199.0)] {
        let scan = observer_of(&rig, |_| height).laser_scan(Header::default());
        assert!(scan.ranges.iter().all(|range| *range >= scan.range_min), "{height:?}");
        let free = scan.ranges.iter().filter(|range| range.is_infinite()).count();
        assert_eq!(free == scan.ranges.len(), height == Some(0.0), "{height:?}: {free} beams are free");
        assert!(free == 0 || height == Some(0.0), "{height:?}: {free} beams are free");
    }
}

#[test]
fn one_lost_picture_is_no_obstacle_and_two_are() {
    let rig = rig();
    let mut observer = observer_of(&rig, |_| Some(0.0));
    observer.miss();
    assert!(observer.is_free());
    observer.miss();
    assert!(!observer.is_free());
}

#[test]
fn a_long_cut_is_told_at_once_and_a_short_one_by_the_vote() {
    let rig = rig();
    for (length, at_once) in [(60.0, true), (10.0, false)] {
        let mut observer = observer_of(&rig, |_| Some(0.0));
        let bytes = line_scan(&rig, |place| (!(0.0..length).contains(&place)).then_some(0.0));
        let scan = LineScan::parse(&bytes).unwrap();
        observer.see(&scan);
        assert_eq!(observer.is_free(), !at_once, "{length}");
        observer.see(&scan);
        assert!(!observer.is_free(), "{length}");
    }
}

/// Against the exact model of camera and sheet, in double precision.
#[test]
fn points_of_a_raised_body_are_where_camera_and_sheet_of_light_put_them() {
    for rig in [rig(), rig_with(Vector::new(-520.0, -40.0, 180.0), 500.0)] {
        let floor = Floor::new(&rig).unwrap();
        let geometry = floor.geometry();
        let decimation = Decimation::for_line_scan(rig.image().width);
        for (column, map) in geometry.watched().zip(geometry.maps()) {
            for height in [-20.0, 5.0, 50.0, 120.0] {
                let pixel = Pixel {
                    u: decimation.centre(u16::try_from(column).unwrap()),
                    v: f64::from(map.row(height)),
                };
                let Some(truth) = rig.laser().triangulate(rig.camera(), pixel) else { continue };
                let (truth, found) = (Point::of(truth), floor.at_height(map, height).unwrap());
                let off = (truth.x - found.x).hypot(truth.y - found.y).hypot(truth.z - found.z);
                assert!(off < 0.0005, "column {column}, {height} mm: {off} m off");
            }
        }
    }
}

/// A body's front is nearer than the stripe behind it: the scan tells the nearer.
#[test]
fn a_lit_body_is_nearer_than_the_stripe() {
    let rig = rig();
    let scan = observer_of(&rig, |place| Some(if (0.0..100.0).contains(&place) { 100.0 } else { 0.0 }))
        .laser_scan(Header::default());
    let nearest = scan.ranges.iter().copied().fold(f32::INFINITY, f32::min);
    // Half as high as the laser: halfway between the laser's foot and the stripe.
    assert!((nearest - 0.25).abs() < 0.002, "{nearest}");
}

#[test]
fn the_cloud_holds_every_height_and_an_unknown_one_as_high_as_the_laser() {
    let rig = rig();
    let cloud = observer_of(&rig, |place| match place {
        place if place < -100.0 => Some(0.0),
        place if place < 0.0 => Some(45.0),
        place if place < 50.0 => None,
        _ => Some(0.0),
    })
    .point_cloud(Header::default());
    assert_eq!(cloud.data.len(), (cloud.width * cloud.point_step) as usize);
    let points: Vec<([f32; 3], u8)> = cloud
        .data
        .chunks(cloud.point_step as usize)
        .map(|point| {
            let value = |field: usize| {
                f32::from_le_bytes([0, 1, 2, 3].map(|byte| point[cloud.fields[field].offset as usize + byte]))
            };
            ([value(0), value(1), value(2)], point[cloud.fields[3].offset as usize])
        })
        .collect();
    assert!(points.iter().all(|(point, _)| point.iter().all(|value| value.is_finite())));
    let floor = Floor::new(&rig).unwrap();
    let expected = |range: std::ops::Range<f32>| {
        floor.geometry().maps().iter().filter(|map| range.contains(&map.floor_place)).count()
    };
    let at = |height: f32| points.iter().filter(move |(point, _)| (point[2] - height).abs() < 0.0005);
    assert_eq!(at(0.045).count(), expected(-100.0..0.0));
    assert_eq!(at(0.2).count(), expected(0.0..50.0));
    assert!(at(0.2).all(|(point, quality)| *quality == 0 && (point[0] - 0.5).abs() < 1e-5));
    assert!(at(0.045).all(|(_, quality)| *quality == 200));
    assert_eq!(points.len(), floor.geometry().maps().len(), "no column is left out");
}

#[test]
fn a_stripe_around_the_origin_has_no_scan() {
    let rig = rig_with(Vector::new(0.0, -500.0, 200.0), 0.0);
    assert_eq!(Floor::new(&rig).unwrap_err(), FloorError::AroundOrigin);
}
