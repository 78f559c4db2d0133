//! The whole calibrated rig, checked, and its compact stored form for the MCU's flash.
//!
//! The compact form, little-endian, [`COMPACT_LENGTH`] bytes: magic `NFRG`, version u16, options u16 (bit 0: run-over of small
//! debris is allowed; the others are zero), width
//! u16, height u16, then 36 f32: fx fy cx cy, k1 k2 p1 p2 k3, rotation (9, row by row), translation (3), laser origin
//! (3), normal (3), offset, stripe point (3), direction (3), start, end; then the CRC-32 of all that. f32 costs less
//! than 0.001 mm of height.

use crate::camera::{Camera, Intrinsics, Pose, Vector};
use crate::laser::Laser;
use crate::limits::{
    DISTORTION_LIMIT, FARTHEST_COORDINATE_MM, INCIDENCE_TOLERANCE_MM, LARGEST_IMAGE_HEIGHT,
    LARGEST_IMAGE_WIDTH, LOWEST_MOUNT_MM, SHORTEST_STRIPE_MM, UNIT_TOLERANCE,
};
use crate::units::{CalibrationId, narrow};
use crate::wire::{self, Reader, Writer};

/// The picture's size in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageSize {
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

/// Where the laser's sheet meets the floor, and the stretch of it that is watched: `X(s) = point + s * direction`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stripe {
    /// A point on the floor in the sheet (s = 0), world millimetres.
    pub point: Vector,
    /// Unit vector along the stripe.
    pub direction: Vector,
    /// First watched s, millimetres.
    pub start: f64,
    /// Last watched s, millimetres.
    pub end: f64,
}

impl Stripe {
    /// The floor point at stripe coordinate `s`.
    #[must_use]
    pub fn at(&self, s: f64) -> Vector {
        self.point.plus(self.direction.scaled(s))
    }

    /// The stripe coordinate of a point (its foot on the stripe's line).
    #[must_use]
    pub fn coordinate_of(&self, point: Vector) -> f64 {
        self.direction.dot(point.minus(self.point))
    }
}

/// What is wrong with a rig: the field by its name in the rig file, and the rule it breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RigError {
    /// The field's name in the rig file, for instance `laser.plane_normal`.
    pub field: &'static str,
    /// The rule that it breaks.
    pub rule: &'static str,
}

impl core::fmt::Display for RigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}: {}", self.field, self.rule)
    }
}

impl core::error::Error for RigError {}

/// Why a stored compact rig was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CompactRigError {
    /// Not [`COMPACT_LENGTH`] bytes, or not beginning with the magic: nothing was ever stored, or something else.
    NotARig,
    /// Another version of the form.
    Version(u16),
    /// The CRC does not match: the store is damaged.
    Damaged,
    /// Intact, but the values break a rule.
    Invalid(RigError),
}

impl core::fmt::Display for CompactRigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotARig => f.write_str("no stored rig"),
            Self::Version(version) => {
                write!(f, "stored rig has version {version}, expected {COMPACT_VERSION}")
            }
            Self::Damaged => f.write_str("stored rig is damaged (CRC)"),
            Self::Invalid(error) => write!(f, "stored rig is invalid: {error}"),
        }
    }
}

impl core::error::Error for CompactRigError {}

/// `NFRG`, little-endian.
const COMPACT_MAGIC: u32 = 0x4752_464E;
/// Version of the compact form.
pub const COMPACT_VERSION: u16 = 1;
/// Length of the compact form in bytes.
pub const COMPACT_LENGTH: usize = 160;

/// A rig whose parts have been checked against each other; only [`Rig::new`] makes one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rig {
    image: ImageSize,
    camera: Camera,
    laser: Laser,
    stripe: Stripe,
    run_over: bool,
}

/// Bit of the compact form's options.
const RUN_OVER_OPTION: u16 = 1;

impl Rig {
    /// Checks every part and how they fit together.
    ///
    /// # Errors
    /// Names the field and the broken rule: a value that is not finite or out of range, a rotation that is none, a
    /// stripe that is not on the floor or not in the laser's sheet, an end of the stripe that the camera cannot see.
    pub fn new(image: ImageSize, camera: Camera, laser: Laser, stripe: Stripe) -> Result<Self, RigError> {
        check_image(image)?;
        check_intrinsics(&camera.intrinsics)?;
        check_pose(&camera.pose)?;
        check_laser(&laser)?;
        check_stripe(&stripe, &laser)?;
        let rig = Self { image, camera, laser, stripe, run_over: false };
        rig.check_view()?;
        Ok(rig)
    }

    /// The picture's size.
    #[must_use]
    pub const fn image(&self) -> ImageSize {
        self.image
    }

    /// The camera.
    #[must_use]
    pub const fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The laser.
    #[must_use]
    pub const fn laser(&self) -> &Laser {
        &self.laser
    }

    /// The stripe.
    #[must_use]
    pub const fn stripe(&self) -> &Stripe {
        &self.stripe
    }

    /// May small debris be run over, if the controller itself finds it low (see [`crate::run_over`])? Off unless
    /// [`Self::with_run_over`] has allowed it; part of the calibration's identity, so that host and controller agree.
    #[must_use]
    pub const fn allows_run_over(&self) -> bool {
        self.run_over
    }

    /// With run-over of small debris allowed or not.
    #[must_use]
    pub const fn with_run_over(self, run_over: bool) -> Self {
        Self { run_over, ..self }
    }

    /// The compact form for the MCU's flash.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; COMPACT_LENGTH] {
        let mut bytes = [0; COMPACT_LENGTH];
        let mut writer = Writer::new(&mut bytes);
        writer.u32(COMPACT_MAGIC);
        writer.u16(COMPACT_VERSION);
        writer.u16(if self.run_over { RUN_OVER_OPTION } else { 0 });
        writer.u16(self.image.width);
        writer.u16(self.image.height);
        let lens = &self.camera.intrinsics;
        for value in [lens.fx, lens.fy, lens.cx, lens.cy].into_iter().chain(lens.distortion) {
            writer.f32(narrow(value));
        }
        for vector in self.camera.pose.rotation.into_iter().chain([
            self.camera.pose.translation,
            self.laser.origin,
            self.laser.normal,
        ]) {
            write_vector(&mut writer, vector);
        }
        writer.f32(narrow(self.laser.offset));
        write_vector(&mut writer, self.stripe.point);
        write_vector(&mut writer, self.stripe.direction);
        writer.f32(narrow(self.stripe.start));
        writer.f32(narrow(self.stripe.end));
        wire::seal(&mut bytes);
        bytes
    }

    /// Reads the compact form and checks it as [`Rig::new`] does.
    ///
    /// # Errors
    /// See [`CompactRigError`]; nothing of a damaged or invalid store is ever used.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, CompactRigError> {
        if bytes.len() != COMPACT_LENGTH {
            return Err(CompactRigError::NotARig);
        }
        let mut reader = Reader::new(bytes);
        if reader.u32() != Some(COMPACT_MAGIC) {
            return Err(CompactRigError::NotARig);
        }
        if !wire::is_sealed(bytes) {
            return Err(CompactRigError::Damaged);
        }
        match reader.u16() {
            Some(COMPACT_VERSION) => {}
            other => return Err(CompactRigError::Version(other.unwrap_or(0))),
        }
        let options = reader.u16().ok_or(CompactRigError::NotARig)?;
        if options & !RUN_OVER_OPTION != 0 {
            let unknown = RigError { field: "options", rule: "an option that this version does not know" };
            return Err(CompactRigError::Invalid(unknown));
        }
        let parts = read_parts(&mut reader).ok_or(CompactRigError::NotARig)?;
        let (image, camera, laser, stripe) = parts;
        let rig = Self::new(image, camera, laser, stripe).map_err(CompactRigError::Invalid)?;
        Ok(rig.with_run_over(options & RUN_OVER_OPTION != 0))
    }

    /// The name of this rig for host and MCU to agree on: the CRC of the compact form.
    #[must_use]
    pub fn calibration_id(&self) -> CalibrationId {
        CalibrationId::new(wire::seal_of(&self.to_bytes()))
    }

    fn check_view(&self) -> Result<(), RigError> {
        const UNSEEN: &str =
            "the camera does not see this end of the stripe; check pose, lens and the picture's size";
        for (s, field) in [(self.stripe.start, "stripe.start_mm"), (self.stripe.end, "stripe.end_mm")] {
            let pixel = self.camera.project(self.stripe.at(s)).ok_or(RigError { field, rule: UNSEEN })?;
            // One pixel of grace: "usable stretch" as tools write it is rounded to the nearest millimetre or so.
            let (width, height) = (f64::from(self.image.width), f64::from(self.image.height));
            if !(-2.0..=width + 1.0).contains(&pixel.u) || !(-2.0..=height + 1.0).contains(&pixel.v) {
                return Err(RigError { field, rule: UNSEEN });
            }
        }
        Ok(())
    }
}

fn write_vector(writer: &mut Writer<'_>, vector: Vector) {
    for value in [vector.x, vector.y, vector.z] {
        writer.f32(narrow(value));
    }
}

fn read_vector(reader: &mut Reader<'_>) -> Option<Vector> {
    Some(Vector::new(reader.f64_from_f32()?, reader.f64_from_f32()?, reader.f64_from_f32()?))
}

fn read_parts(reader: &mut Reader<'_>) -> Option<(ImageSize, Camera, Laser, Stripe)> {
    let image = ImageSize { width: reader.u16()?, height: reader.u16()? };
    let (fx, fy) = (reader.f64_from_f32()?, reader.f64_from_f32()?);
    let (cx, cy) = (reader.f64_from_f32()?, reader.f64_from_f32()?);
    let mut distortion = [0.0; 5];
    for coefficient in &mut distortion {
        *coefficient = reader.f64_from_f32()?;
    }
    let rotation = [read_vector(reader)?, read_vector(reader)?, read_vector(reader)?];
    let translation = read_vector(reader)?;
    let camera = Camera {
        intrinsics: Intrinsics { fx, fy, cx, cy, distortion },
        pose: Pose { rotation, translation },
    };
    let (origin, normal) = (read_vector(reader)?, read_vector(reader)?);
    let laser = Laser { origin, normal, offset: reader.f64_from_f32()? };
    let (point, direction) = (read_vector(reader)?, read_vector(reader)?);
    let (start, end) = (reader.f64_from_f32()?, reader.f64_from_f32()?);
    Some((image, camera, laser, Stripe { point, direction, start, end }))
}

const NOT_FINITE: &str = "is not a finite number";
const TOO_FAR: &str = "is more than 10 m away; the unit is millimetres";

fn ensure(holds: bool, field: &'static str, rule: &'static str) -> Result<(), RigError> {
    if holds { Ok(()) } else { Err(RigError { field, rule }) }
}

fn check_image(image: ImageSize) -> Result<(), RigError> {
    ensure((16..=LARGEST_IMAGE_WIDTH).contains(&image.width), "image.width", "must be 16 to 4608 pixels")?;
    ensure((16..=LARGEST_IMAGE_HEIGHT).contains(&image.height), "image.height", "must be 16 to 4095 pixels")
}

fn check_intrinsics(lens: &Intrinsics) -> Result<(), RigError> {
    for (value, field) in [(lens.fx, "camera.fx"), (lens.fy, "camera.fy")] {
        ensure(value.is_finite(), field, NOT_FINITE)?;
        ensure((10.0..=100_000.0).contains(&value), field, "must be 10 to 100000 pixels")?;
    }
    for (value, field) in [(lens.cx, "camera.cx"), (lens.cy, "camera.cy")] {
        ensure(value.is_finite(), field, NOT_FINITE)?;
        ensure(value.abs() <= 10_000.0, field, "must lie within 10000 pixels of the picture's corner")?;
    }
    for value in lens.distortion {
        ensure(value.is_finite(), "camera.distortion", NOT_FINITE)?;
        ensure(
            value.abs() <= DISTORTION_LIMIT,
            "camera.distortion",
            "a coefficient is beyond 2 in magnitude",
        )?;
    }
    Ok(())
}

fn is_unit(vector: Vector) -> bool {
    (vector.dot(vector) - 1.0).abs() <= UNIT_TOLERANCE
}

fn check_pose(pose: &Pose) -> Result<(), RigError> {
    const FIELD: &str = "camera.rotation";
    const NO_ROTATION: &str = "is not a rotation matrix (rows must be orthogonal unit vectors, right-handed)";
    let [right, down, forward] = pose.rotation;
    for row in [right, down, forward] {
        ensure(row.is_finite(), FIELD, NOT_FINITE)?;
        ensure(is_unit(row), FIELD, NO_ROTATION)?;
    }
    let handed = right.cross(down).minus(forward);
    ensure(handed.dot(handed) <= UNIT_TOLERANCE, FIELD, NO_ROTATION)?;
    ensure(pose.translation.is_finite(), "camera.translation_mm", NOT_FINITE)?;
    let centre = pose.centre();
    let far = centre.x.abs() > FARTHEST_COORDINATE_MM || centre.y.abs() > FARTHEST_COORDINATE_MM;
    ensure(!far && centre.z <= FARTHEST_COORDINATE_MM, "camera.translation_mm", TOO_FAR)?;
    ensure(
        centre.z >= LOWEST_MOUNT_MM,
        "camera.translation_mm",
        "puts the camera below 10 mm over the floor (x_cam = R x_world + t; centre = -R^T t)",
    )
}

fn check_laser(laser: &Laser) -> Result<(), RigError> {
    ensure(laser.origin.is_finite(), "laser.origin_mm", NOT_FINITE)?;
    ensure(laser.normal.is_finite(), "laser.plane_normal", NOT_FINITE)?;
    ensure(laser.offset.is_finite(), "laser.plane_offset_mm", NOT_FINITE)?;
    ensure(is_unit(laser.normal), "laser.plane_normal", "is not a unit vector")?;
    let far = laser.origin.x.abs() > FARTHEST_COORDINATE_MM
        || laser.origin.y.abs() > FARTHEST_COORDINATE_MM
        || laser.origin.z > FARTHEST_COORDINATE_MM;
    ensure(!far, "laser.origin_mm", TOO_FAR)?;
    ensure(laser.origin.z >= LOWEST_MOUNT_MM, "laser.origin_mm", "is below 10 mm over the floor")?;
    ensure(
        (laser.normal.dot(laser.origin) - laser.offset).abs() <= INCIDENCE_TOLERANCE_MM,
        "laser.plane_offset_mm",
        "contradicts laser.origin_mm: the origin does not lie in the plane normal . X = offset",
    )
}

fn check_stripe(stripe: &Stripe, laser: &Laser) -> Result<(), RigError> {
    ensure(stripe.point.is_finite(), "stripe.point_mm", NOT_FINITE)?;
    ensure(stripe.direction.is_finite(), "stripe.direction", NOT_FINITE)?;
    ensure(is_unit(stripe.direction), "stripe.direction", "is not a unit vector")?;
    for (value, field) in [(stripe.start, "stripe.start_mm"), (stripe.end, "stripe.end_mm")] {
        ensure(value.is_finite(), field, NOT_FINITE)?;
        ensure(value.abs() <= FARTHEST_COORDINATE_MM, field, TOO_FAR)?;
    }
    ensure(
        stripe.end - stripe.start >= SHORTEST_STRIPE_MM,
        "stripe.end_mm",
        "must be at least 20 mm beyond stripe.start_mm",
    )?;
    for (s, field) in [(stripe.start, "stripe.start_mm"), (stripe.end, "stripe.end_mm")] {
        let point = stripe.at(s);
        ensure(
            point.z.abs() <= INCIDENCE_TOLERANCE_MM,
            field,
            "this end of the stripe is not on the floor (z = 0)",
        )?;
        ensure(
            (laser.normal.dot(point) - laser.offset).abs() <= INCIDENCE_TOLERANCE_MM,
            field,
            "this end of the stripe contradicts the laser: it does not lie in its plane",
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
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
        assert_eq!(
            field(with(|rig| rig.laser.normal = rig.laser.normal.scaled(1.001))),
            "laser.plane_normal"
        );
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
        assert_eq!(
            field(with(|rig| rig.stripe.end = rig.stripe.start + 19.0)),
            "stripe.end_mm",
            "19 mm long"
        );
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
}
