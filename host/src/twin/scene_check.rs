//! Are a scene's values possible? Every refusal names its field and the allowed range.

use super::material;
use super::relief::{SLOPE_OF_UNIT_WAVE, STEEPEST};
use super::scene::{Dirt, Floor, MaterialChoice, Scene, SceneError, SceneObject, Shape};

impl Scene {
    /// Checks every value.
    ///
    /// # Errors
    /// Names the first field that breaks a rule.
    pub fn check(&self) -> Result<(), SceneError> {
        let look = &self.look;
        let exposure = look.exposure.unwrap_or(1.0);
        within("look.exposure", exposure, 1e-4, 1e4)?;
        within("look.gain", look.gain, 0.1, 100.0)?;
        within("look.full_well_electrons", look.full_well_electrons, 100.0, 1e6)?;
        within("look.read_noise_electrons", look.read_noise_electrons, 0.0, 1000.0)?;
        within("look.speckle", look.speckle, 0.0, 1.0)?;
        within("look.blur_pixels", look.blur_pixels, 0.0, 5.0)?;
        within("look.halo", look.halo, 0.0, 0.5)?;
        within("look.laser_power", look.laser_power, 0.0, 100.0)?;
        within("look.fan_overhang_mm", look.fan_overhang_mm, -1000.0, 1000.0)?;
        within("look.led_band_mm", look.led_band_mm.unwrap_or(10.0), 1.0, 60.0)?;
        within("look.vignetting", look.vignetting, 0.0, 0.9)?;
        within("look.bounce", look.bounce, 0.0, 10.0)?;
        within("look.row_time_us", look.row_time_us, 0.0, 1000.0)?;
        within("look.exposure_ms", look.exposure_ms, 0.0, 100.0)?;
        check_dirt(&self.dirt)?;
        for speed in self.robot.velocity_mm_per_s {
            within("robot.velocity_mm_per_s", speed, -1e5, 1e5)?;
        }
        within("robot.vibration_mm", self.robot.vibration_mm, 0.0, 50.0)?;
        within("robot.vibration_hz", self.robot.vibration_hz, 0.0, 1000.0)?;
        for shift in self.floor.shift_mm {
            within("floor.shift_mm", shift, -1e7, 1e7)?;
        }
        check_ground(&self.floor)?;
        within("light.lux", self.light.lux, 0.0, 200_000.0)?;
        within("light.from_degrees", self.light.from_degrees, -3600.0, 3600.0)?;
        within("light.unevenness", self.light.unevenness, -1.0, 1.0)?;
        for line in &self.floor.paint {
            within("floor.paint.width_mm", line.width_mm, 0.1, 10_000.0)?;
            within("floor.paint.along_mm", line.along_mm, -10_000.0, 10_000.0)?;
            within("floor.paint.across_mm", line.across_mm, -10_000.0, 10_000.0)?;
            within("floor.paint.angle_degrees", line.angle_degrees, -3600.0, 3600.0)?;
            for share in line.colour {
                within("floor.paint.colour", f64::from(share), 0.0, 1.0)?;
            }
        }
        self.objects.iter().try_for_each(check_object)
    }
}

/// More spots than this are no lens any more.
const MOST_SPOTS: f64 = 1000.0;

fn check_dirt(dirt: &Dirt) -> Result<(), SceneError> {
    within("dirt.smudges", f64::from(dirt.smudges), 0.0, MOST_SPOTS)?;
    within("dirt.dust", f64::from(dirt.dust), 0.0, MOST_SPOTS)?;
    within("dirt.strength", dirt.strength, 0.0, 1.0)?;
    within("dirt.spots (how many)", dirt.spots.len() as f64, 0.0, MOST_SPOTS)?;
    for spot in &dirt.spots {
        spot.at.into_iter().try_for_each(|place| within("dirt.spots.at", place, -1.0, 2.0))?;
        within("dirt.spots.radius", spot.radius, 0.001, 1.0)?;
        within("dirt.spots.strength", spot.strength, 0.0, 1.0)?;
    }
    Ok(())
}

/// The floor's waves and picture.
fn check_ground(floor: &Floor) -> Result<(), SceneError> {
    within("floor.wave_mm", floor.wave_mm, 0.0, 50.0)?;
    within("floor.wave_length_mm", floor.wave_length_mm, 10.0, 1e5)?;
    if SLOPE_OF_UNIT_WAVE * floor.wave_mm > STEEPEST * floor.wave_length_mm {
        let field = format!("floor.wave_mm = {}", floor.wave_mm);
        let rule =
            "is more than a thirtieth of floor.wave_length_mm: such waves would hide parts of the floor";
        return Err(SceneError::Value { field, rule });
    }
    if let Some(image) = &floor.image {
        within("floor.image.width_mm", image.width_mm, 1.0, 1e5)?;
        if image.texture.is_none() {
            let file = image.file.display().to_string();
            let reason = "was not read; scenes with a picture come from a file (Scene::load)".to_owned();
            return Err(SceneError::Image { file, reason });
        }
    }
    Ok(())
}

fn within(field: &str, value: f64, low: f64, high: f64) -> Result<(), SceneError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    let rule = if value.is_finite() { "is out of its range" } else { "is not a finite number" };
    Err(SceneError::Value { field: format!("{field} = {value} (allowed: {low} to {high})"), rule })
}

fn check_object(object: &SceneObject) -> Result<(), SceneError> {
    let name = &object.name;
    let size = |field: &str, value: f64| within(&format!("object `{name}`: {field}"), value, 0.1, 10_000.0);
    let place = |field: &str, value: f64| within(&format!("object `{name}`: {field}"), value, -1e5, 1e5);
    for (field, value) in [
        ("along_mm", object.along_mm),
        ("across_mm", object.across_mm),
        ("yaw_degrees", object.yaw_degrees),
        ("velocity_mm_per_s", object.velocity_mm_per_s[0]),
        ("velocity_mm_per_s", object.velocity_mm_per_s[1]),
    ] {
        place(field, value)?;
    }
    within(&format!("object `{name}`: bottom_mm"), object.bottom_mm, 0.0, 2000.0)?;
    match &object.shape {
        Shape::Box { width_mm, depth_mm, height_mm: tall_mm }
        | Shape::Pit { width_mm, depth_mm, deep_mm: tall_mm } => {
            size("shape.width_mm", *width_mm)?;
            size("shape.depth_mm", *depth_mm)?;
            size("shape.height_mm or deep_mm", *tall_mm)?;
        }
        Shape::Post { diameter_mm, height_mm: long_mm } | Shape::Rod { diameter_mm, length_mm: long_mm } => {
            size("shape.diameter_mm", *diameter_mm)?;
            size("shape.height_mm or length_mm", *long_mm)?;
        }
        Shape::Hand { height_mm } => size("shape.height_mm", *height_mm)?,
        Shape::Cable { diameter_mm, path_mm } => {
            size("shape.diameter_mm", *diameter_mm)?;
            if !(2..=64).contains(&path_mm.len()) {
                let field = format!("object `{name}`: shape.path_mm");
                return Err(SceneError::Value { field, rule: "must have 2 to 64 places" });
            }
            path_mm.iter().flatten().try_for_each(|value| place("shape.path_mm", *value))?;
        }
    }
    match (&object.material, object.material.resolve()) {
        (MaterialChoice::Named(material), None) => Err(SceneError::Material {
            object: name.clone(),
            material: material.clone(),
            known: material::MATERIALS.map(|(known, _)| known).join(", "),
        }),
        (_, Some(material)) => {
            let field = format!("object `{name}`: material");
            let shares = material.albedo.iter().chain([&material.laser_albedo, &material.gloss]);
            shares.into_iter().try_for_each(|share| within(&field, f64::from(*share), 0.0, 2.0))?;
            within(&field, f64::from(material.tightness), 1.0, 10_000.0)?;
            within(&format!("{field}.translucency"), f64::from(material.translucency), 0.0, 1.0)?;
            within(&format!("{field}.scatter_mm"), f64::from(material.scatter_mm), 0.5, 100.0)
        }
        (MaterialChoice::Own(_), None) => Ok(()),
    }
}
