//! What stands before the camera, as a file that people write (TOML) and programs generate.
//!
//! Places are given along and across the stripe, so that one scene serves every rig: `along_mm` is the stripe
//! coordinate s, `across_mm` the distance outward from the stripe on the floor (negative towards the robot).
//! The laser comes in low over the floor from the robot's side, so it hits a high object *before* the stripe: an
//! object of height h cuts the stripe if it covers any `across_mm` from about -2.5 h to 0 (for the usual rig).

mod dirt;
mod floor;
mod look;
mod object;

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use self::dirt::{Dirt, DirtKind, DirtSpot};
pub use self::floor::{Floor, FloorImage, FloorKind, PaintedLine};
pub use self::look::{Light, Look};
pub use self::object::{MaterialChoice, SceneObject, Shape};
use super::texture::ImageTexture;
use super::truth::Moment;

/// A floor, its light, the camera's settings and the objects.
///
/// ```
/// let scene = nearfield_host::twin::Scene::from_toml(r#"
///     [floor]
///     kind = "tiles"
///     [[objects]]
///     name = "box"
///     material = "cardboard"
///     across_mm = -40.0
///     shape = { kind = "box", width_mm = 120.0, depth_mm = 90.0, height_mm = 45.0 }
/// "#)?;
/// assert_eq!(scene.objects.len(), 1);
/// # Ok::<(), nearfield_host::twin::SceneError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scene {
    /// What the scene is for.
    pub note: String,
    /// The floor.
    pub floor: Floor,
    /// The light of the hall.
    pub light: Light,
    /// Camera and laser settings.
    pub look: Look,
    /// Dirt on the lens.
    #[serde(skip_serializing_if = "Dirt::is_clean")]
    pub dirt: Dirt,
    /// How the robot moves that carries camera and laser.
    pub robot: Robot,
    /// Everything on (or in) the floor.
    pub objects: Vec<SceneObject>,
}

/// How the robot moves; camera and laser with it. The floor and all that stands on it goes by.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Robot {
    /// Speed along the stripe and outward across it, millimetres a second.
    pub velocity_mm_per_s: [f64; 2],
    /// How far the mast swings up and down (amplitude).
    pub vibration_mm: f64,
    /// How often, hertz. Where in its period it begins follows from the seed.
    pub vibration_hz: f64,
}

impl Robot {
    /// Does the floor look different from picture to picture?
    #[must_use]
    pub fn is_moving(&self) -> bool {
        self.velocity_mm_per_s != [0.0; 2] || (self.vibration_mm != 0.0 && self.vibration_hz != 0.0)
    }

    /// Where the robot is after `seconds`, from where it started; `phase` is the vibration's at the start, radians.
    #[must_use]
    pub fn at(&self, seconds: f64, phase: f64) -> Moment {
        let [along, across] = self.velocity_mm_per_s.map(|speed| speed * seconds);
        let swing = if self.vibration_hz == 0.0 { 0.0 } else { self.vibration_mm };
        let robot_up_mm = swing * (std::f64::consts::TAU * self.vibration_hz * seconds + phase).sin();
        Moment { seconds, robot_along_mm: along, robot_across_mm: across, robot_up_mm }
    }
}

/// Why a scene cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SceneError {
    /// Not TOML, or not a scene's fields; the text names line and field.
    #[error("not a scene: {0}")]
    Format(String),
    /// A value that makes no sense.
    #[error("{field}: {rule}")]
    Value {
        /// The field's name, with the object's name where it belongs to one.
        field: String,
        /// The rule that it breaks.
        rule: &'static str,
    },
    /// A material that nobody knows.
    #[error("object `{object}`: unknown material `{material}`; known are {known}")]
    Material {
        /// The object's name.
        object: String,
        /// What was asked for.
        material: String,
        /// All known names.
        known: String,
    },
    /// A floor's picture that cannot be used.
    #[error("floor.image.file: {file}: {reason}")]
    Image {
        /// The file.
        file: String,
        /// Why not.
        reason: String,
    },
    /// The scene's file cannot be read.
    #[error("{file}: {reason}")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        reason: String,
    },
}

impl Scene {
    /// Reads a scene's text and checks it.
    ///
    /// # Errors
    /// See [`SceneError`].
    pub fn from_toml(text: &str) -> Result<Self, SceneError> {
        let scene: Self = toml::from_str(text).map_err(|error| SceneError::Format(error.to_string()))?;
        scene.check()?;
        Ok(scene)
    }

    /// Reads a scene's file, and the picture of its floor if it names one.
    ///
    /// # Errors
    /// See [`SceneError`].
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(path).map_err(|error| SceneError::Read {
            file: path.display().to_string(),
            reason: error.to_string(),
        })?;
        let mut scene: Self = toml::from_str(&text).map_err(|error| SceneError::Format(error.to_string()))?;
        scene.load_images(path.parent().unwrap_or(Path::new("")))?;
        scene.check()?;
        Ok(scene)
    }

    /// Reads the picture of the floor, if the scene names one; its file is looked for in this folder.
    ///
    /// # Errors
    /// The file cannot be read or is no picture.
    pub fn load_images(&mut self, folder: &Path) -> Result<(), SceneError> {
        if let Some(image) = &mut self.floor.image {
            image.file = folder.join(&image.file);
            image.texture = Some(Arc::new(ImageTexture::read(&image.file)?));
        }
        Ok(())
    }

    /// Does a picture of this scene depend on when it is taken, in a way that one moment does not show: a moving robot, a
    /// rolling shutter, blur by motion? Such pictures come from [`super::Sequence`].
    #[must_use]
    pub fn needs_sequence(&self) -> bool {
        self.robot.is_moving() || self.look.row_time_us > 0.0 || self.look.exposure_ms > 0.0
    }

    /// The scene after `seconds`, as the robot sees it: every object has moved by its velocity, and the floor with all on
    /// it against the robot's.
    #[must_use]
    pub fn after(&self, seconds: f64) -> Self {
        let mut moved = self.clone();
        for object in &mut moved.objects {
            let [along, across] = object.velocity_mm_per_s;
            object.along_mm += (along - self.robot.velocity_mm_per_s[0]) * seconds;
            object.across_mm += (across - self.robot.velocity_mm_per_s[1]) * seconds;
        }
        for (shift, speed) in moved.floor.shift_mm.iter_mut().zip(self.robot.velocity_mm_per_s) {
            *shift -= speed * seconds;
        }
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxed() -> SceneObject {
        SceneObject {
            name: "box".into(),
            shape: Shape::Box { width_mm: 100.0, depth_mm: 80.0, height_mm: 45.0 },
            material: MaterialChoice::named("cardboard"),
            along_mm: 10.0,
            across_mm: -30.0,
            yaw_degrees: 12.0,
            bottom_mm: 0.0,
            velocity_mm_per_s: [5.0, -10.0],
        }
    }

    #[test]
    fn a_scene_survives_its_own_file() {
        let mut scene = Scene { objects: vec![boxed()], ..Scene::default() };
        scene.floor.paint.push(PaintedLine {
            colour: [0.6, 0.05, 0.04],
            along_mm: 0.0,
            across_mm: 0.0,
            width_mm: 75.0,
            angle_degrees: 70.0,
        });
        let text = toml::to_string(&scene).unwrap();
        assert_eq!(Scene::from_toml(&text), Ok(scene));
    }

    #[test]
    fn objects_move_by_their_velocity() {
        let scene = Scene { objects: vec![boxed()], ..Scene::default() }.after(2.0);
        assert_eq!((scene.objects[0].along_mm, scene.objects[0].across_mm), (20.0, -50.0));
    }

    #[test]
    fn mistakes_are_named() {
        let refuse = |change: &dyn Fn(&mut Scene), words: &str| {
            let mut scene = Scene { objects: vec![boxed()], ..Scene::default() };
            change(&mut scene);
            let message = scene.check().unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        };
        refuse(&|scene| scene.look.gain = f64::NAN, "look.gain = NaN");
        refuse(&|scene| scene.light.lux = -1.0, "light.lux = -1");
        refuse(&|scene| scene.objects[0].bottom_mm = -1.0, "`box`: bottom_mm");
        refuse(&|scene| scene.objects[0].material = MaterialChoice::named("lava"), "unknown material `lava`");
        refuse(
            &|scene| scene.objects[0].shape = Shape::Cable { diameter_mm: 5.0, path_mm: vec![[0.0, 0.0]] },
            "2 to 64 places",
        );
        assert!(Scene::from_toml("[flor]\n").unwrap_err().to_string().contains("flor"));
    }
}
