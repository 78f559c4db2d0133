use super::*;
use crate::testing::{height_rig, rig_of, side_rig};

fn filled(rig: &Rig) -> Box<StripeGeometry<LARGEST_COLUMN_COUNT>> {
    let mut geometry = Box::new(StripeGeometry::empty());
    geometry.fill(rig, Decimation::for_line_scan(rig.image().width)).unwrap();
    geometry
}

#[test]
fn decimation_takes_as_few_image_columns_as_fit() {
    for (width, image_columns, count) in
        [(1151, 1, 1151), (1152, 1, 1152), (1153, 2, 576), (2304, 2, 1152), (4608, 4, 1152)]
    {
        let decimation = Decimation::for_line_scan(width);
        assert_eq!((decimation.image_columns(), decimation.count()), (image_columns, count), "{width}");
    }
    assert_eq!(Decimation::for_line_scan(2304).centre(0), 0.5);
    assert_eq!(Decimation::none(2304).centre(7), 7.0);
}

#[test]
#[cfg_attr(miri, ignore = "thousands of columns")]
fn maps_agree_with_exact_triangulation_from_the_floor_to_200_mm() {
    for rig in [height_rig(), side_rig()] {
        let geometry = filled(&rig);
        let decimation = Decimation::for_line_scan(rig.image().width);
        let (mut worst_height, mut worst_place, mut compared) = (0.0_f64, 0.0_f64, 0_usize);
        for column in geometry.watched() {
            let map = geometry.map(column).unwrap();
            for millimetres in (-20..=200).step_by(5) {
                let row = map.row(millimetres as f32);
                if !(0.0..=f32::from(rig.image().height)).contains(&row) {
                    continue;
                }
                let pixel = Pixel { u: decimation.centre(column as u16), v: f64::from(row) };
                let exact = rig.laser().triangulate(rig.camera(), pixel).unwrap();
                compared += 1;
                worst_height = worst_height.max((exact.z - f64::from(map.height(row))).abs());
                assert!((exact.z - f64::from(millimetres)).abs() < 0.2, "{millimetres}: {}", exact.z);
                if exact.z <= 100.0 {
                    let shadow = rig.stripe().coordinate_of(rig.laser().shadow_on_floor(exact).unwrap());
                    worst_place = worst_place.max((shadow - f64::from(geometry.ray_place(map, row))).abs());
                }
            }
        }
        assert!(compared > 10 * geometry.maps().len(), "{compared} heights compared");
        assert!(worst_height < 0.1, "height {worst_height}");
        assert!(worst_place < 1.5, "place {worst_place}");
    }
}

/// The rule: what is lit decides the maps. A laser lower than the highest mapped height has no light up there.
#[test]
#[cfg_attr(miri, ignore = "thousands of columns")]
fn a_low_laser_gives_true_heights_up_to_its_own() {
    for (camera_height, laser_height, down, focal) in [
        (300.0, 120.0, 19.0, 510.0),
        (300.0, 120.0, 31.0, 510.0),
        (260.0, 90.0, 20.0, 760.0),
        (250.0, 60.0, 15.0, 510.0),
    ] {
        let camera = Vector::new(0.0, 0.0, camera_height);
        let laser = Vector::new(0.0, 0.0, laser_height);
        let rig = rig_of(camera, 0.0, down, focal, (1152, 648), laser, (-200.0, 200.0)).unwrap();
        let geometry = filled(&rig);
        let decimation = Decimation::for_line_scan(1152);
        let mut worst = 0.0_f64;
        for column in geometry.watched() {
            let map = geometry.map(column).unwrap();
            for tenth in 0..=8 {
                let row = map.row((laser_height * f64::from(tenth) / 10.0) as f32);
                if !(0.0..=647.0).contains(&row) {
                    continue;
                }
                let pixel = Pixel { u: decimation.centre(column as u16), v: f64::from(row) };
                let exact = rig.laser().triangulate(rig.camera(), pixel).unwrap();
                worst = worst.max((exact.z - f64::from(map.height(row))).abs());
            }
        }
        assert!(worst < 0.1, "camera {camera_height}, laser {laser_height}: {worst} mm");
    }
}

#[test]
fn every_millimetre_of_the_stripe_is_watched() {
    let rig = side_rig();
    let geometry = filled(&rig);
    let maps = geometry.maps();
    assert!((maps.first().unwrap().floor_place + 500.0).abs() < 1.0);
    assert!((maps.last().unwrap().floor_place - 560.0).abs() < 2.1);
    let widest = maps.windows(2).map(|pair| pair[1].floor_place - pair[0].floor_place).fold(0.0, f32::max);
    assert!((1.9..2.2).contains(&widest), "far end: {widest} mm a column");
    assert_eq!((*geometry.reaches().first().unwrap(), *geometry.reaches().last().unwrap()), (3, 1));
}

#[test]
fn a_row_without_meaning_has_no_height() {
    let geometry = filled(&height_rig());
    let map = geometry.maps()[500];
    assert_eq!(map.height(map.floor_row), 0.0);
    for row in [f32::NAN, f32::INFINITY, map.floor_row - 1.0 / map.perspective_per_row] {
        assert!(map.height(row).is_nan(), "{row}");
    }
    assert!((map.height(map.row(77.0)) - 77.0).abs() < 1e-3);
}

#[test]
fn useless_geometry_is_refused_and_leaves_nothing_watched() {
    let mut geometry = Box::new(StripeGeometry::<LARGEST_COLUMN_COUNT>::empty());
    let within = rig_of(
        Vector::new(0.0, 0.0, 200.0),
        0.0,
        30.0,
        900.0,
        (1152, 648),
        Vector::new(0.0, 0.0, 200.0),
        (-200.0, 200.0),
    )
    .unwrap();
    assert_eq!(geometry.fill(&within, Decimation::none(1152)), Err(GeometryError::NoParallax));
    assert_eq!(geometry.maps().len(), 0);
    let along = rig_of(
        Vector::new(-400.0, 500.0, 400.0),
        90.0,
        45.0,
        900.0,
        (1152, 648),
        Vector::new(0.0, 0.0, 200.0),
        (-100.0, 100.0),
    )
    .unwrap();
    assert_eq!(geometry.fill(&along, Decimation::none(1152)), Err(GeometryError::StripeAlongColumns));
    let wide = height_rig();
    assert_eq!(geometry.fill(&wide, Decimation::none(2304)), Err(GeometryError::TooManyColumns));
    let short = rig_of(
        Vector::new(0.0, 0.0, 400.0),
        0.0,
        50.0,
        30.0,
        (32, 24),
        Vector::new(0.0, 0.0, 200.0),
        (-12.0, 12.0),
    )
    .unwrap();
    assert_eq!(geometry.fill(&short, Decimation::none(32)), Err(GeometryError::TooFewColumns));
}

/// A stripe of so many columns, a millimetre each from 0 on.
pub(crate) fn level(columns: u16) -> Box<StripeGeometry<LARGEST_COLUMN_COUNT>> {
    let mut geometry = Box::new(StripeGeometry::empty());
    for (map, place) in geometry.maps.iter_mut().zip(0..columns) {
        *map = ColumnMap { floor_place: f32::from(place), ..straight(100.0, 1.0) };
    }
    (geometry.first, geometry.last) = (0, usize::from(columns) - 1);
    geometry.count = usize::from(columns);
    geometry
}

/// A map without bend and perspective, on which heights can be worked out by hand.
fn straight(floor_row: f32, height_per_row: f32) -> ColumnMap {
    ColumnMap { floor_row, height_per_row, ..ColumnMap::UNMAPPED }
}

#[test]
fn a_map_without_slope_or_with_endless_figures_is_not_usable() {
    let good = straight(100.0, -0.5);
    assert!(good.is_usable());
    assert!(!straight(100.0, 0.0).is_usable());
    for endless in [f32::INFINITY, f32::NAN] {
        for bad in [
            ColumnMap { height_per_row: endless, ..good },
            ColumnMap { perspective_per_row: endless, ..good },
            ColumnMap { bend_per_row: endless, ..good },
            ColumnMap { place_per_height: endless, ..good },
        ] {
            assert!(!bad.is_usable(), "{bad:?}");
        }
    }
}

/// The inverse holds for far more bend than any lens has, and tells where there is none: beyond the horizon.
#[test]
fn rows_and_heights_are_inverse_to_each_other_up_to_the_horizon() {
    let bent = ColumnMap { bend_per_row: 1e-3, ..straight(50.0, 0.5) };
    for row in [50.0, 60.0, 150.0, 250.0, 350.0] {
        assert!((bent.row(bent.height(row)) - row).abs() < 3e-4, "{row}: {}", bent.row(bent.height(row)));
    }
    // Heights grow without end towards row 100; what lies behind it is seen from below.
    let steep = ColumnMap { perspective_per_row: -0.01, ..straight(0.0, 1.0) };
    assert!((steep.height(50.0) - 100.0).abs() < 1e-4);
    assert!((steep.row(100.0) - 50.0).abs() < 1e-4);
    assert!(steep.height(96.0).is_nan() && steep.height(150.0).is_nan());
    assert!(steep.row(-150.0).is_nan() && steep.row(5_000.0).is_nan());
}

/// Half a pixel beyond the first and the last row a picture ends. An edge less than a millimetre from the floor says
/// nothing: there the floor itself is at the edge.
#[test]
fn only_what_the_picture_shows_is_fitted() {
    let full = HeightRange { low: -500.0, high: 500.0 };
    let of = |map: ColumnMap, rows| {
        let HeightRange { low, high } = full.within_picture(&map, rows);
        (low, high)
    };
    assert_eq!(of(straight(50.0, -2.0), 100), (-99.0, 101.0));
    assert_eq!(of(straight(50.0, 2.0), 100), (-101.0, 99.0));
    assert_eq!(of(straight(50.0, -20.0), 100), (-500.0, 500.0), "no more than is ever mapped");
    assert_eq!(of(straight(0.0, -2.0), 100), (-199.0, 500.0), "exactly a millimetre above");
    assert_eq!(of(straight(99.0, -2.0), 100), (-500.0, 199.0), "exactly a millimetre below");
    assert_eq!(of(straight(0.0, -2.5), 100), (-248.75, 1.25), "more than a millimetre above");
    assert_eq!(of(straight(99.0, -2.5), 100), (-1.25, 248.75), "more than a millimetre below");
    assert_eq!(full.samples(), [-500.0, 150.0, 325.0, 500.0]);
}

/// A stripe of fewer columns a millimetre than the limit is not resolved, wherever that is found out.
#[test]
fn a_stripe_that_the_picture_does_not_resolve_is_refused() {
    let rig = |focal| {
        let (camera, laser) = (Vector::new(0.0, 0.0, 400.0), Vector::new(0.0, 0.0, 200.0));
        rig_of(camera, 0.0, 50.0, focal, (32, 24), laser, (-400.0, 400.0)).unwrap()
    };
    let mut geometry = Box::new(StripeGeometry::<LARGEST_COLUMN_COUNT>::empty());
    // 640 mm away: 0.019 and 0.023 columns a millimetre.
    let (coarse, fine) = (rig(12.0), rig(15.0));
    assert_eq!(geometry.fill(&coarse, Decimation::none(32)), Err(GeometryError::StripeAlongColumns));
    assert_eq!(Sheet::new(&coarse).unwrap().solve(20.0, 0.0, 0.0), None);
    assert!(geometry.fill(&fine, Decimation::none(32)).is_ok());
    assert!(Sheet::new(&fine).unwrap().solve(20.0, 0.0, 0.0).is_some());
}

/// A rig that is refused leaves nothing of the one before.
#[test]
#[cfg_attr(miri, ignore = "thousands of columns")]
fn a_refused_rig_leaves_nothing_of_the_one_before() {
    let good = height_rig();
    let decimation = Decimation::for_line_scan(good.image().width);
    let at = |height, pitch, focal, size, span: f64| {
        let (camera, laser) = (Vector::new(0.0, 0.0, height), Vector::new(0.0, 0.0, 200.0));
        rig_of(camera, 0.0, pitch, focal, size, laser, (-span, span)).unwrap()
    };
    let mut geometry = filled(&good);
    for (bad, decimation, error) in [
        (at(200.0, 30.0, 900.0, (1152, 648), 200.0), Decimation::none(1152), GeometryError::NoParallax),
        (at(400.0, 50.0, 30.0, (32, 24), 12.0), Decimation::none(32), GeometryError::TooFewColumns),
        (good, Decimation::none(2304), GeometryError::TooManyColumns),
    ] {
        geometry.fill(&good, Decimation::for_line_scan(good.image().width)).unwrap();
        assert_eq!(geometry.fill(&bad, decimation), Err(error));
        assert!(geometry.maps().is_empty() && geometry.reaches().is_empty());
        assert_eq!(geometry.column_count(), 0);
    }
    geometry.fill(&good, decimation).unwrap();
    assert!(!geometry.maps().is_empty());
}

/// No ray of the laser comes down from its own height, or from above it.
#[test]
#[cfg_attr(miri, ignore = "thousands of columns")]
fn at_the_laser_s_own_height_no_ray_has_a_place() {
    let geometry = filled(&height_rig());
    let map = ColumnMap { floor_place: 50.0, ..straight(0.0, 1.0) };
    let laser = geometry.laser_height().get();
    assert!(geometry.ray_place(&map, laser.next_down()).is_finite());
    assert!(geometry.ray_place(&map, laser).is_nan());
    assert!(geometry.ray_place(&map, laser.next_up()).is_nan());
}

/// Columns much narrower than the window: the average takes as many as a byte counts, no more.
#[test]
#[cfg_attr(miri, ignore = "thousands of columns")]
fn the_reach_has_an_end() {
    const COLUMNS: usize = 4_000;
    let (camera, laser) = (Vector::new(0.0, 0.0, 400.0), Vector::new(0.0, 0.0, 200.0));
    for (focal, span, reach) in
        [(100_000.0, 12.0, LARGEST_REACH), (35_000.0, 30.0, LARGEST_REACH), (20_000.0, 60.0, 78)]
    {
        let pitch = (400.0_f64 / 500.0).atan().to_degrees();
        let rig = rig_of(camera, 0.0, pitch, focal, (COLUMNS as u16, 648), laser, (-span, span)).unwrap();
        let mut geometry = Box::new(StripeGeometry::<COLUMNS>::empty());
        geometry.fill(&rig, Decimation::none(rig.image().width)).unwrap();
        let [first, ..] = geometry.reaches() else { panic!("no column") };
        assert!(first.abs_diff(reach) <= 3, "{focal}: {first}");
    }
}
