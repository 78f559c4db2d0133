use super::*;
use crate::testing::{height_rig, side_rig};
use proptest::prelude::*;

fn with(change: impl FnOnce(&mut Rig)) -> Result<Rig, RigError> {
    let mut rig = height_rig();
    change(&mut rig);
    Rig::new(rig.image, rig.camera, rig.laser, rig.stripe)
}

fn field(result: Result<Rig, RigError>) -> &'static str {
    result.map_or_else(|error| error.field, |_| "accepted")
}

#[test]
fn the_compact_form_keeps_the_rig_and_its_name() {
    for rig in [height_rig(), side_rig()] {
        let bytes = rig.to_bytes();
        let stored = Rig::from_bytes(&bytes).unwrap();
        assert_eq!(stored.calibration_id(), rig.calibration_id());
        assert_eq!(stored.to_bytes(), bytes);
        assert!((stored.camera().pose.centre().z - rig.camera().pose.centre().z).abs() < 1e-3);
    }
    assert_ne!(height_rig().calibration_id(), side_rig().calibration_id());
}

#[test]
fn a_damaged_or_foreign_store_is_refused() {
    let good = height_rig().to_bytes();
    for length in 0..COMPACT_LENGTH {
        assert_eq!(Rig::from_bytes(&good[..length]), Err(CompactRigError::NotARig));
    }
    for bit in 0..COMPACT_LENGTH * 8 {
        let mut bad = good;
        bad[bit / 8] ^= 1 << (bit % 8);
        assert!(Rig::from_bytes(&bad).is_err(), "bit {bit}");
    }
    assert_eq!(Rig::from_bytes(&[0xFF; COMPACT_LENGTH]), Err(CompactRigError::NotARig));
    let resealed = |offset: usize, value: &[u8]| {
        let mut bad = good;
        bad[offset..offset + value.len()].copy_from_slice(value);
        wire::seal(&mut bad);
        Rig::from_bytes(&bad)
    };
    assert_eq!(resealed(4, &[2, 0]), Err(CompactRigError::Version(2)));
    assert!(!Rig::from_bytes(&good).unwrap().allows_run_over());
    assert!(resealed(6, &[1, 0]).unwrap().allows_run_over());
    for options in [[2, 0], [3, 0], [0, 1], [0, 0x80]] {
        let refused = resealed(6, &options);
        assert!(matches!(refused, Err(CompactRigError::Invalid(RigError { field: "options", .. }))));
    }
    let not_a_number = resealed(12, &f32::NAN.to_le_bytes());
    assert!(matches!(not_a_number, Err(CompactRigError::Invalid(RigError { field: "camera.fx", .. }))));
}

#[test]
fn each_broken_rule_names_its_field() {
    let nan = f64::NAN;
    assert_eq!(field(with(|rig| rig.image.width = 15)), "image.width");
    assert_eq!(field(with(|rig| rig.image.height = 4096)), "image.height");
    assert_eq!(field(with(|rig| rig.camera.intrinsics.fx = nan)), "camera.fx");
    assert_eq!(field(with(|rig| rig.camera.intrinsics.fy = 0.0)), "camera.fy");
    assert_eq!(field(with(|rig| rig.camera.intrinsics.cx = f64::INFINITY)), "camera.cx");
    assert_eq!(field(with(|rig| rig.camera.intrinsics.cy = 10_001.0)), "camera.cy");
    assert_eq!(field(with(|rig| rig.camera.intrinsics.distortion[3] = 2.1)), "camera.distortion");
    assert_eq!(field(with(|rig| rig.camera.intrinsics.distortion[0] = nan)), "camera.distortion");
    assert_eq!(field(with(|rig| rig.camera.pose.rotation[0].x = 1.01)), "camera.rotation");
    assert_eq!(field(with(|rig| rig.camera.pose.rotation[1].y = nan)), "camera.rotation");
    assert_eq!(
        field(with(|rig| rig.camera.pose.rotation[0] = rig.camera.pose.rotation[0].scaled(-1.0))),
        "camera.rotation",
        "left-handed"
    );
    assert_eq!(field(with(|rig| rig.camera.pose.translation.z = nan)), "camera.translation_mm");
    assert_eq!(
        field(with(|rig| rig.camera.pose.translation = rig.camera.pose.translation.scaled(-1.0))),
        "camera.translation_mm",
        "below the floor"
    );
    assert_eq!(
        field(with(|rig| rig.camera.pose.translation = rig.camera.pose.translation.scaled(100.0))),
        "camera.translation_mm",
        "40 m away"
    );
    assert_eq!(field(with(|rig| rig.laser.origin.y = nan)), "laser.origin_mm");
    assert_eq!(field(with(|rig| rig.laser.origin.z = 9.0)), "laser.origin_mm");
    assert_eq!(field(with(|rig| rig.laser.origin.x = 10_001.0)), "laser.origin_mm");
    assert_eq!(field(with(|rig| rig.laser.normal = rig.laser.normal.scaled(1.001))), "laser.plane_normal");
    assert_eq!(field(with(|rig| rig.laser.normal.z = nan)), "laser.plane_normal");
    assert_eq!(field(with(|rig| rig.laser.offset += 1.5)), "laser.plane_offset_mm");
    assert_eq!(field(with(|rig| rig.laser.offset = nan)), "laser.plane_offset_mm");
    assert_eq!(field(with(|rig| rig.stripe.direction.x = 1.1)), "stripe.direction");
    assert_eq!(field(with(|rig| rig.stripe.direction.x = nan)), "stripe.direction");
    assert_eq!(field(with(|rig| rig.stripe.end = 10_001.0)), "stripe.end_mm", "10 m away");
    assert_eq!(field(with(|rig| rig.stripe.point.y = nan)), "stripe.point_mm");
    assert_eq!(field(with(|rig| rig.stripe.point.y += 5.0)), "stripe.start_mm", "out of the sheet");
    assert_eq!(field(with(|rig| rig.stripe.point.z += 1.1)), "stripe.start_mm", "off the floor");
    assert_eq!(field(with(|rig| rig.stripe.start = nan)), "stripe.start_mm");
    assert_eq!(field(with(|rig| rig.stripe.end = rig.stripe.start + 19.0)), "stripe.end_mm", "19 mm long");
    assert_eq!(field(with(|rig| rig.stripe.end = rig.stripe.start + 20.0)), "accepted", "20 mm long");
    assert_eq!(field(with(|rig| rig.stripe.end = 600.0)), "stripe.end_mm", "out of the picture");
    assert_eq!(field(with(|_| ())), "accepted");
}

proptest! {
    #[test]
    fn garbage_is_refused_and_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(Rig::from_bytes(&bytes).is_err());
    }
}

/// Both ends of the stripe may lie up to a pixel and a half beyond the picture's edges, and no further.
#[test]
fn the_ends_of_the_stripe_are_seen_up_to_the_grace() {
    let rig = height_rig();
    let at = |s: f64| rig.camera.project(rig.stripe.at(s)).unwrap();
    let (first, last) = (at(rig.stripe.start), at(rig.stripe.end));
    let (width, height) = (f64::from(rig.image.width), f64::from(rig.image.height));
    let across = |shift: f64| field(with(|rig| rig.camera.intrinsics.cx += shift));
    let down = |shift: f64| field(with(|rig| rig.camera.intrinsics.cy += shift));
    assert_eq!(across(-1.99 - first.u), "accepted");
    assert_eq!(across(-2.01 - first.u), "stripe.start_mm");
    assert_eq!(across(width + 0.99 - last.u), "accepted");
    assert_eq!(across(width + 1.01 - last.u), "stripe.end_mm");
    let (upper, lower) = (first.v.min(last.v), first.v.max(last.v));
    assert_eq!(down(-1.99 - upper), "accepted");
    assert_ne!(down(-2.01 - upper), "accepted");
    assert_eq!(down(height + 0.99 - lower), "accepted");
    assert_ne!(down(height + 1.01 - lower), "accepted");
}

/// The farthest coordinate is allowed, and nothing beyond it, along each axis for itself.
#[test]
fn laser_and_camera_lie_within_ten_metres() {
    let axes = [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, 1.0, 0.0), Vector::new(0.0, 0.0, 1.0)];
    for (axis, signs) in axes.into_iter().zip([&[-1.0, 1.0][..], &[-1.0, 1.0], &[1.0]]) {
        for (sign, distance, allowed) in signs.iter().flat_map(|sign| {
            [(*sign, FARTHEST_COORDINATE_MM, true), (*sign, FARTHEST_COORDINATE_MM.next_up(), false)]
        }) {
            // Both stand 20 mm high, unless they are moved upwards.
            let mount = Vector::new(0.0, 0.0, 20.0 * (1.0 - axis.z));
            let place = mount.plus(axis.scaled(sign * distance));
            let laser = Laser { origin: place, normal: axis, offset: axis.dot(place) };
            assert_eq!(check_laser(&laser).is_ok(), allowed, "laser {place:?}");
            // Looks straight down: the centre of such a pose is exact.
            let [right, down, forward] =
                [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, -1.0, 0.0), Vector::new(0.0, 0.0, -1.0)];
            let translation = Vector::new(-place.x, place.y, place.z);
            let pose = Pose { rotation: [right, down, forward], translation };
            assert_eq!(pose.centre(), place);
            assert_eq!(check_pose(&pose).is_ok(), allowed, "camera {place:?}");
        }
    }
}

/// The plane has to hold the laser and the stripe, on whichever side of it they are said to lie.
#[test]
fn a_plane_that_misses_laser_or_stripe_is_refused_on_both_sides() {
    for side in [-1.0, 1.0] {
        assert_eq!(field(with(|rig| rig.laser.offset += side * 1.5)), "laser.plane_offset_mm");
        assert_eq!(field(with(|rig| rig.stripe.point.y += side * 5.0)), "stripe.start_mm");
    }
}
