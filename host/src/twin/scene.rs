//! What stands before the camera, as a file that people write (TOML) and programs generate.
//!
//! Places are given along and across the stripe, so that one scene serves every rig: `along_mm` is the stripe
//! coordinate s, `across_mm` the distance outward from the stripe on the floor (negative towards the robot).
//! The laser comes in low over the floor from the robot's side, so it hits a high object *before* the stripe: an
//! object of height h cuts the stripe if it covers any `across_mm` from about -2.5 h to 0 (for the usual rig).

use serde::{Deserialize, Serialize};

use super::material::{self, LinearColour, Material};
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
    /// How the robot moves that carries camera and laser.
    pub robot: Robot,
    /// Everything on (or in) the floor.
    pub objects: Vec<SceneObject>,
}

/// The floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Floor {
    /// What it is made of.
    pub kind: FloorKind,
    /// Lines painted on it; later ones cover earlier ones.
    pub paint: Vec<PaintedLine>,
    /// How far its pattern and paint lie shifted, along and across the stripe: where the robot stands.
    #[serde(skip_serializing_if = "is_zero")]
    pub shift_mm: [f64; 2],
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over references")]
fn is_zero(values: &[f64; 2]) -> bool {
    *values == [0.0; 2]
}

impl Default for Floor {
    fn default() -> Self {
        Self { kind: FloorKind::Concrete, paint: Vec::new(), shift_mm: [0.0; 2] }
    }
}

/// What a floor is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FloorKind {
    /// Light concrete with stains and cracks.
    Concrete,
    /// Old, dark concrete.
    ConcreteDark,
    /// Ceramic tiles of 300 mm with grout.
    Tiles,
    /// Grey epoxy coating with flakes.
    EpoxyGrey,
    /// Green epoxy coating.
    EpoxyGreen,
    /// Red epoxy coating, the laser's own colour.
    EpoxyRed,
    /// Wooden planks.
    Wood,
    /// Black rubber matting.
    Rubber,
}

impl FloorKind {
    /// All kinds.
    pub const ALL: [Self; 8] = [
        Self::Concrete,
        Self::ConcreteDark,
        Self::Tiles,
        Self::EpoxyGrey,
        Self::EpoxyGreen,
        Self::EpoxyRed,
        Self::Wood,
        Self::Rubber,
    ];
}

/// A straight painted line through a point of the floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaintedLine {
    /// Linear sRGB.
    pub colour: LinearColour,
    /// Its centre line passes through this place along the stripe ...
    #[serde(default)]
    pub along_mm: f64,
    /// ... and this place across it.
    #[serde(default)]
    pub across_mm: f64,
    /// Width of the line.
    pub width_mm: f64,
    /// Direction: 0 along the stripe, 90 straight outward.
    #[serde(default)]
    pub angle_degrees: f64,
}

/// The light of the hall: even light from all sides plus one soft main direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Light {
    /// Illuminance of the floor in lux (100 dim, 400 office, 1500 bright).
    pub lux: f64,
    /// Where the main light comes from, degrees around from the stripe's direction.
    pub from_degrees: f64,
    /// How much it grows or falls over one metre of floor, share of the whole (0 even).
    pub unevenness: f64,
}

impl Default for Light {
    fn default() -> Self {
        Self { lux: 400.0, from_degrees: 60.0, unevenness: 0.15 }
    }
}

/// Camera and laser settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Look {
    /// Exposure; at 1 a white floor under 400 lux just saturates. Left out: chosen so that the floor is mid-grey.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f64>,
    /// Amplification; more means more noise at the same brightness.
    pub gain: f64,
    /// Electrons that a pixel holds at gain 1 when it saturates.
    pub full_well_electrons: f64,
    /// Read noise, electrons.
    pub read_noise_electrons: f64,
    /// Contrast of the laser's speckle in the finished picture (standard deviation over mean).
    pub speckle: f64,
    /// Blur of the lens: standard deviation in pixels. Demosaicing adds its own.
    pub blur_pixels: f64,
    /// Share of the laser's light that the lens spreads widely.
    pub halo: f64,
    /// The laser's power relative to 5 mW at full drive.
    pub laser_power: f64,
    /// How far the fan of light reaches beyond both ends of the watched stripe.
    pub fan_overhang_mm: f64,
    /// Width (at 1/e^2) of the band of a red LED with a slit that stands in for the laser, in the focus; such a band is as
    /// much dimmer than the laser's line as it is wider, and has no speckle. Left out: the laser.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub led_band_mm: Option<f64>,
    /// Share of the light that the lens loses in the picture's farthest corner; grows with the square of the distance
    /// from the middle.
    pub vignetting: f64,
    /// Strength of the light that lit bodies throw on what is around them: 0 none, 1 as physics says.
    pub bounce: f64,
    /// Time from one row's exposure to the next one's, microseconds: a rolling shutter (13.4 for the Camera Module 3 at
    /// 2304x1296). 0: all rows at once. Seen only in sequences.
    pub row_time_us: f64,
    /// False: the picture is a Bayer mosaic, which no processor has blurred by reconstructing colours.
    pub demosaiced: bool,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            exposure: None,
            gain: 1.0,
            full_well_electrons: 9000.0,
            read_noise_electrons: 4.0,
            speckle: 0.18,
            blur_pixels: 0.75,
            halo: 0.02,
            laser_power: 1.0,
            fan_overhang_mm: 8.0,
            led_band_mm: None,
            vignetting: 0.0,
            bounce: 0.0,
            row_time_us: 0.0,
            demosaiced: true,
        }
    }
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

/// One object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneObject {
    /// How the truth names it.
    pub name: String,
    /// Its form and size.
    pub shape: Shape,
    /// A name from the list of materials, or one of its own.
    pub material: MaterialChoice,
    /// Place along the stripe (of its centre; for a cable, of its path's origin).
    #[serde(default)]
    pub along_mm: f64,
    /// Place across the stripe.
    #[serde(default)]
    pub across_mm: f64,
    /// Turned about the vertical, degrees.
    #[serde(default)]
    pub yaw_degrees: f64,
    /// Height of its underside over the floor.
    #[serde(default)]
    pub bottom_mm: f64,
    /// Speed along and across the stripe, millimetres a second.
    #[serde(default)]
    pub velocity_mm_per_s: [f64; 2],
}

/// A material by name or by its figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum MaterialChoice {
    /// One of [`material::MATERIALS`].
    Named(String),
    /// Any other.
    Own(Material),
}

impl MaterialChoice {
    /// By name.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self::Named(name.to_owned())
    }

    /// The material, or `None` for an unknown name.
    #[must_use]
    pub fn resolve(&self) -> Option<Material> {
        match self {
            Self::Named(name) => material::named(name),
            Self::Own(material) => Some(*material),
        }
    }
}

/// Form and size; width lies along the stripe and depth across it before the object is turned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A box.
    Box {
        /// Along the stripe.
        width_mm: f64,
        /// Across the stripe.
        depth_mm: f64,
        /// Upwards.
        height_mm: f64,
    },
    /// A cylinder on its end: a can, a post, a leg.
    Post {
        /// Diameter.
        diameter_mm: f64,
        /// Height.
        height_mm: f64,
    },
    /// A cylinder on its side, along the stripe before it is turned.
    Rod {
        /// Diameter.
        diameter_mm: f64,
        /// Length.
        length_mm: f64,
    },
    /// A round cable lying along a path.
    Cable {
        /// Diameter.
        diameter_mm: f64,
        /// Places along and across, relative to the object's own place; a smooth curve passes through them.
        path_mm: Vec<[f64; 2]>,
    },
    /// A forearm with a hand, lying across the stripe, the hand towards the robot.
    Hand {
        /// Height of the forearm; everything else is in proportion.
        height_mm: f64,
    },
    /// A hole with a flat bottom: a pit, a kerb, the edge of a dock.
    Pit {
        /// Along the stripe.
        width_mm: f64,
        /// Across the stripe.
        depth_mm: f64,
        /// Downwards.
        deep_mm: f64,
    },
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
