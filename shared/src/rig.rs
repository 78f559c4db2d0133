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
mod tests;
