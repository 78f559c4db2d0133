//! Ready-made rigs and scenes, and random scenes by the thousand.

use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::laser::Laser;
use nearfield_shared::rig::{ImageSize, Rig, RigError, Stripe};

use super::random::Dice;
use super::scene::{Floor, FloorKind, Light, Look, MaterialChoice, PaintedLine, Scene, SceneObject, Shape};

/// How a rig is mounted, in the words of somebody who mounts it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mounting {
    /// Columns of the picture; it is 16:9.
    pub width: u16,
    /// Focal length in widths of the picture (0.78 is a 65 degree lens, 0.445 a 97 degree one).
    pub focal_widths: f64,
    /// Radial distortion `k1`, `k2`.
    pub distortion: [f64; 2],
    /// Where the camera is: x along the robot's edge, height over the floor, millimetres.
    pub camera_mm: [f64; 2],
    /// Turned sideways (towards +x) and down, degrees.
    pub camera_degrees: [f64; 2],
    /// Where the laser is: x and height, millimetres.
    pub laser_mm: [f64; 2],
    /// How far from the robot's edge the stripe lies, millimetres.
    pub stripe_distance_mm: f64,
    /// First and last watched s, millimetres.
    pub stripe_mm: [f64; 2],
}

/// The paper's tier-2 rig: camera 400 mm and laser 200 mm over the floor, stripe 500 mm away; half resolution.
pub const CENTRE: Mounting = Mounting {
    width: 1152,
    focal_widths: 0.7778,
    distortion: [-0.031, 0.011],
    camera_mm: [0.0, 400.0],
    camera_degrees: [0.0, 50.0],
    laser_mm: [0.0, 200.0],
    stripe_distance_mm: 500.0,
    stripe_mm: [-400.0, 400.0],
};

/// Camera and laser at one end of the stripe, which then runs diagonally through the picture.
pub const SIDE: Mounting = Mounting {
    camera_mm: [-450.0, 500.0],
    camera_degrees: [33.0, 37.0],
    laser_mm: [-520.0, 200.0],
    stripe_mm: [-480.0, 540.0],
    ..CENTRE
};

/// A wide lens.
pub const WIDE: Mounting = Mounting {
    focal_widths: 0.445,
    distortion: [-0.09, 0.02],
    camera_degrees: [0.0, 46.0],
    stripe_mm: [-540.0, 540.0],
    ..CENTRE
};

impl Mounting {
    /// The same rig with a picture of another width.
    #[must_use]
    pub const fn with_width(self, width: u16) -> Self {
        Self { width, ..self }
    }

    /// The rig.
    ///
    /// # Errors
    /// A mounting that makes no rig; the field is the rig file's.
    pub fn rig(&self) -> Result<Rig, RigError> {
        let height = (u32::from(self.width) * 9 / 16) as u16;
        let focal = self.focal_widths * f64::from(self.width);
        let [k1, k2] = self.distortion;
        let intrinsics = Intrinsics {
            fx: focal,
            fy: focal,
            cx: f64::from(self.width) / 2.0 - 0.5 + 0.002 * f64::from(self.width),
            cy: f64::from(height) / 2.0 - 0.5 - 0.003 * f64::from(height),
            distortion: [k1, k2, 0.0003, -0.0002, 0.0],
        };
        let (yaw_sine, yaw_cosine) = self.camera_degrees[0].to_radians().sin_cos();
        let (sine, cosine) = self.camera_degrees[1].to_radians().sin_cos();
        let right = Vector::new(yaw_cosine, -yaw_sine, 0.0);
        let forward = Vector::new(cosine * yaw_sine, cosine * yaw_cosine, -sine);
        let rotation = [right, forward.cross(right), forward];
        let centre = Vector::new(self.camera_mm[0], 0.0, self.camera_mm[1]);
        let turned = Pose { rotation, translation: Vector::default() }.to_camera(centre);
        let camera = Camera { intrinsics, pose: Pose { rotation, translation: turned.scaled(-1.0) } };
        let [x, z] = self.laser_mm;
        let origin = Vector::new(x, 0.0, z);
        let slant = z.hypot(self.stripe_distance_mm);
        let normal = Vector::new(0.0, z / slant, self.stripe_distance_mm / slant);
        let laser = Laser { origin, normal, offset: normal.dot(origin) };
        let stripe = Stripe {
            point: Vector::new(0.0, self.stripe_distance_mm, 0.0),
            direction: Vector::new(1.0, 0.0, 0.0),
            start: self.stripe_mm[0],
            end: self.stripe_mm[1],
        };
        Rig::new(ImageSize { width: self.width, height }, camera, laser, stripe)
    }
}

/// A ready-made scene: name, what it shows, how it is made.
pub type Exhibit = (&'static str, &'static str, fn() -> Scene);

/// All ready-made scenes.
pub const GALLERY: [Exhibit; 14] = [
    ("clean", "bare concrete, nothing on the stripe", Scene::default),
    ("red_line", "dark concrete with a painted red line across the stripe", red_line),
    ("tiles", "tiles with grout and a yellow line along the stripe's far side", tiles),
    ("near_miss", "a box just beyond the stripe, which stays whole", near_miss),
    ("cable_3", "a 3 mm cable across the stripe", || with(cable("cable", 3.0, 0.0))),
    ("cable_6", "a 6 mm cable across the stripe", || with(cable("cable", 6.0, 0.0))),
    ("rod_12", "an upright 12 mm rod", || with(post("rod", 12.0, 160.0, -60.0))),
    ("cylinder_22", "a 22 mm cylinder lying along the stripe", || with(rod("cylinder", 22.0, -28.0))),
    ("box_45", "a cardboard box 45 mm high", || with(carton("box", [120.0, 90.0, 45.0], -60.0, "cardboard"))),
    ("box_75_glossy", "a glossy plastic box 75 mm high", || {
        with(carton("box", [120.0, 90.0, 75.0], -90.0, "plastic_yellow"))
    }),
    ("hand", "a hand and forearm 52 mm high", || with(hand("hand", 52.0, -200.0))),
    ("leg", "an upright leg, 110 mm thick", || with(post("leg", 110.0, 400.0, -60.0))),
    ("drop", "a pit 40 mm deep", || {
        with(plain("pit", Shape::Pit { width_mm: 160.0, depth_mm: 200.0, deep_mm: 40.0 }, 20.0, "grey_card"))
    }),
    ("black_hole", "a block covered with black velvet", || {
        with(carton("block", [60.0, 60.0, 30.0], -40.0, "velvet_black"))
    }),
];

/// The ready-made scene of this name.
#[must_use]
pub fn scene(name: &str) -> Option<Scene> {
    GALLERY
        .iter()
        .find(|(known, ..)| *known == name)
        .map(|(_, note, make)| Scene { note: (*note).to_owned(), ..make() })
}

fn with(object: SceneObject) -> Scene {
    Scene { objects: vec![object], ..Scene::default() }
}

/// An object in the middle of the stripe, not turned, at rest.
#[must_use]
pub fn plain(name: &str, shape: Shape, across_mm: f64, material: &str) -> SceneObject {
    SceneObject {
        name: name.to_owned(),
        shape,
        material: MaterialChoice::named(material),
        along_mm: 0.0,
        across_mm,
        yaw_degrees: 0.0,
        bottom_mm: 0.0,
        velocity_mm_per_s: [0.0; 2],
    }
}

/// A cable that crosses the stripe in a gentle curve.
#[must_use]
pub fn cable(name: &str, diameter_mm: f64, across_mm: f64) -> SceneObject {
    let path_mm =
        vec![[-40.0, 260.0], [-12.0, 120.0], [0.0, 0.0], [6.0, -90.0], [30.0, -190.0], [110.0, -250.0]];
    plain(name, Shape::Cable { diameter_mm, path_mm }, across_mm, "cable_black")
}

/// A box of width, depth, height.
#[must_use]
pub fn carton(
    name: &str,
    [width_mm, depth_mm, height_mm]: [f64; 3],
    across_mm: f64,
    material: &str,
) -> SceneObject {
    let turned = plain(name, Shape::Box { width_mm, depth_mm, height_mm }, across_mm, material);
    SceneObject { yaw_degrees: 12.0, ..turned }
}

/// A hand with its forearm.
#[must_use]
pub fn hand(name: &str, height_mm: f64, across_mm: f64) -> SceneObject {
    SceneObject { yaw_degrees: 6.0, ..plain(name, Shape::Hand { height_mm }, across_mm, "skin_dark") }
}

fn post(name: &str, diameter_mm: f64, height_mm: f64, across_mm: f64) -> SceneObject {
    plain(name, Shape::Post { diameter_mm, height_mm }, across_mm, "denim")
}

fn rod(name: &str, diameter_mm: f64, across_mm: f64) -> SceneObject {
    let lying = plain(name, Shape::Rod { diameter_mm, length_mm: 140.0 }, across_mm, "grey_card");
    SceneObject { yaw_degrees: 8.0, ..lying }
}

fn line(colour: [f32; 3], along_mm: f64, across_mm: f64, angle_degrees: f64) -> PaintedLine {
    PaintedLine { colour, along_mm, across_mm, width_mm: 75.0, angle_degrees }
}

/// Linear sRGB of floor paints.
const RED_PAINT: [f32; 3] = [0.55, 0.05, 0.04];
const YELLOW_PAINT: [f32; 3] = [0.72, 0.48, 0.04];
const WHITE_PAINT: [f32; 3] = [0.78, 0.78, 0.76];

fn red_line() -> Scene {
    let floor = Floor {
        kind: FloorKind::ConcreteDark,
        paint: vec![line(RED_PAINT, -20.0, 0.0, 75.0)],
        ..Floor::default()
    };
    Scene { floor, light: Light { lux: 1500.0, ..Light::default() }, ..Scene::default() }
}

fn tiles() -> Scene {
    let floor =
        Floor { kind: FloorKind::Tiles, paint: vec![line(YELLOW_PAINT, 0.0, 90.0, 3.0)], ..Floor::default() };
    Scene { floor, ..Scene::default() }
}

fn near_miss() -> Scene {
    with(SceneObject { along_mm: -120.0, ..carton("box behind", [160.0, 100.0, 110.0], 95.0, "cardboard") })
}

/// What a random scene is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Theme {
    /// Nothing that cuts the stripe: paint, all floors and lights, objects near by.
    Clean,
    /// One object on the stripe.
    Object,
    /// A thin cable or rod on the stripe.
    Thin,
}

/// A random scene for a rig's stripe; the same seed gives the same scene.
#[must_use]
pub fn random_scene(seed: u64, theme: Theme, stripe: &Stripe) -> Scene {
    let mut dice = Dice::new(seed);
    let kind = dice.choose(&FloorKind::ALL).copied().unwrap_or(FloorKind::Concrete);
    let mut paint = Vec::new();
    if dice.chance(0.35) {
        let colour = dice.choose(&[RED_PAINT, YELLOW_PAINT, WHITE_PAINT]).copied().unwrap_or(WHITE_PAINT);
        let along = dice.between(stripe.start, stripe.end);
        paint.push(line(colour, along, dice.between(-60.0, 60.0), dice.between(0.0, 180.0)));
    }
    let lux = dice.choose(&[120.0, 400.0, 700.0, 1500.0]).copied().unwrap_or(400.0) * dice.between(0.8, 1.25);
    let light = Light { lux, from_degrees: dice.between(0.0, 360.0), unevenness: dice.between(0.0, 0.3) };
    let look = Look {
        speckle: dice.between(0.10, 0.24),
        blur_pixels: dice.between(0.55, 0.95),
        halo: dice.between(0.01, 0.03),
        gain: if lux < 200.0 { dice.between(1.5, 3.0) } else { 1.0 },
        fan_overhang_mm: dice.between(0.0, 15.0),
        ..Look::default()
    };
    let along = dice.between(stripe.start + 80.0, stripe.end - 80.0);
    let mut objects = match theme {
        Theme::Clean => Vec::new(),
        Theme::Object => vec![random_object(&mut dice)],
        Theme::Thin => vec![random_thin(&mut dice)],
    };
    objects.iter_mut().for_each(|object| object.along_mm += along);
    if theme == Theme::Clean && dice.chance(0.4) {
        objects.push(bystander(&mut dice, along));
    }
    let note = format!("random {theme:?}, seed {seed}");
    Scene { note, floor: Floor { kind, paint, ..Floor::default() }, light, look, objects, ..Scene::default() }
}

const SOLID_MATERIALS: [&str; 10] = [
    "cardboard",
    "white_card",
    "grey_card",
    "pallet_wood",
    "plastic_yellow",
    "plastic_blue",
    "plastic_black",
    "aluminium",
    "leather_brown",
    "rubber_black",
];

fn random_object(dice: &mut Dice) -> SceneObject {
    let material = dice.choose(&SOLID_MATERIALS).copied().unwrap_or("grey_card");
    let height_mm = dice.between(8.0, 150.0);
    // Somewhere in the stretch before the stripe where the low sheet meets a body of this height.
    let reach = -2.0 * height_mm.min(60.0);
    let object = match (dice.between(0.0, 4.0)) as u32 {
        0 => plain(
            "box",
            Shape::Box {
                width_mm: dice.between(25.0, 180.0),
                depth_mm: dice.between(25.0, 120.0),
                height_mm,
            },
            dice.between(reach, 0.0),
            material,
        ),
        1 => plain(
            "post",
            Shape::Post { diameter_mm: dice.between(20.0, 120.0), height_mm },
            dice.between(reach, 0.0),
            material,
        ),
        2 => {
            let diameter_mm = dice.between(8.0, 60.0);
            let shape = Shape::Rod { diameter_mm, length_mm: dice.between(60.0, 200.0) };
            plain("rod", shape, dice.between(-diameter_mm, 0.0), material)
        }
        _ => {
            let height = dice.between(30.0, 80.0);
            plain(
                "hand",
                Shape::Hand { height_mm: height },
                dice.between(-5.0 * height, height),
                "skin_light",
            )
        }
    };
    let turn = if matches!(object.shape, Shape::Hand { .. }) {
        dice.between(-25.0, 25.0)
    } else {
        dice.between(0.0, 180.0)
    };
    SceneObject { yaw_degrees: turn, ..object }
}

fn random_thin(dice: &mut Dice) -> SceneObject {
    let material =
        dice.choose(&["cable_black", "cable_orange", "cable_grey"]).copied().unwrap_or("cable_grey");
    let object = SceneObject {
        material: MaterialChoice::named(material),
        ..cable("cable", dice.between(3.0, 12.0), 0.0)
    };
    SceneObject { yaw_degrees: dice.between(-40.0, 40.0), ..object }
}

/// Something that stands wholly beyond the stripe, where it neither cuts the light nor hides it.
fn bystander(dice: &mut Dice, along: f64) -> SceneObject {
    let (width_mm, depth_mm) = (dice.between(60.0, 180.0), dice.between(60.0, 120.0));
    let corner = f64::hypot(width_mm, depth_mm) / 2.0;
    let shape = Shape::Box { width_mm, depth_mm, height_mm: dice.between(30.0, 150.0) };
    let material = dice.choose(&SOLID_MATERIALS).copied().unwrap_or("cardboard");
    let behind = plain("bystander", shape, corner + dice.between(12.0, 80.0), material);
    SceneObject { along_mm: along, yaw_degrees: dice.between(0.0, 180.0), ..behind }
}

/// [`CENTRE`] for this crate's tests.
#[cfg(test)]
pub(crate) fn default_rig() -> Rig {
    CENTRE.rig().unwrap()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_rigs_are_rigs_at_every_camera_width() {
        for mounting in [CENTRE, SIDE, WIDE] {
            for width in [1152, 2304] {
                mounting.with_width(width).rig().unwrap();
            }
        }
    }

    #[test]
    fn every_exhibit_is_a_sound_scene() {
        for (name, note, _) in GALLERY {
            let scene = scene(name).unwrap();
            assert_eq!(scene.check(), Ok(()), "{name}");
            assert_eq!(scene.note, note);
        }
        assert_eq!(scene("no such scene"), None);
    }

    #[test]
    fn random_scenes_are_sound_and_repeatable() {
        let rig = default_rig();
        for seed in 0..300 {
            for theme in [Theme::Clean, Theme::Object, Theme::Thin] {
                let scene = random_scene(seed, theme, rig.stripe());
                assert_eq!(scene.check(), Ok(()), "seed {seed} {theme:?}");
                assert_eq!(scene, random_scene(seed, theme, rig.stripe()));
            }
        }
    }
}
