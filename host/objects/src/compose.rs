//! Scenes: which things lie where, seen from where, in what light, by what camera.

use glam::{Quat, Vec2, Vec3};

use crate::camera::Camera;
use crate::floor::{Floor, Kind, SEEN};
use crate::items::{CLASSES, Item, TRAINED};
use crate::laser::Laser;
use crate::light::Light;
use crate::placed::Placed;
use crate::random::Draw;
use crate::render::Stage;
use crate::sensor::Look;

/// What a split of a dataset draws from.
#[derive(Debug, Clone, Copy)]
pub struct Pool<'a> {
    /// Numbers of the items that may appear: first and how many.
    pub items: (u64, u64),
    /// Numbers of the floors that may appear: first and how many.
    pub floors: (u64, u64),
    /// Kinds of floors with their weights.
    pub kinds: &'a [(Kind, f32)],
    /// Longest side of the pictures, pixels: least and most.
    pub side: (usize, usize),
}

/// A scene that is ready to render.
#[derive(Debug)]
pub struct Scene {
    /// Camera, light, floor and things.
    pub stage: Stage,
    /// What each of the stage's objects is.
    pub items: Vec<Item>,
    /// Number of the floor within its kind.
    pub floor: u64,
    /// How the camera makes a picture of it.
    pub look: Look,
    /// Millimetres per pixel where the camera looks.
    pub scale: f32,
}

/// About how long the things of a trained class are, mm: to choose a scale at which they can be seen.
const TYPICAL: [f32; TRAINED] =
    [45.0, 20.0, 24.0, 42.0, 150.0, 220.0, 210.0, 130.0, 120.0, 95.0, 260.0, 290.0, 420.0, 900.0];
/// The same for the others together.
const TYPICAL_OTHER: f32 = 180.0;
/// How often a class is what the picture is about: people more often, since they rarely fit in as companions.
const FOCUS: [f32; TRAINED] = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.6, 2.0];

/// Things that would be smaller in the picture, pixels, are put elsewhere if there is a place.
const LEAST_SEEN: f32 = 16.0;

fn typical(class: usize) -> f32 {
    TYPICAL.get(class).copied().unwrap_or(TYPICAL_OTHER)
}

/// Aspect ratios of the pictures.
const ASPECTS: [(f32, f32); 4] = [(1.0, 3.0), (4.0 / 3.0, 3.0), (16.0 / 9.0, 2.0), (3.0 / 4.0, 0.6)];

fn size(draw: &mut Draw, side: (usize, usize)) -> (usize, usize) {
    // Multiples of 32: detectors like them.
    let long = draw.whole(side.0 / 32, side.1 / 32) * 32;
    let aspect = ASPECTS[draw.weighted(&ASPECTS.map(|a| a.1))].0;
    let short = |ratio: f32| ((long as f32 / ratio / 16.0).round() as usize).max(4) * 16;
    if aspect >= 1.0 { (long, short(aspect)) } else { (short(1.0 / aspect), long) }
}

/// Draws a scene.
#[must_use]
pub fn compose(draw: &mut Draw, pool: &Pool<'_>) -> Scene {
    let size = size(draw, pool.side);
    let kind = pool.kinds[draw.weighted(&pool.kinds.iter().map(|k| k.1).collect::<Vec<_>>())].0;
    let floor_number = pool.floors.0 + draw.whole(0, pool.floors.1 as usize - 1) as u64;
    let focus = draw.weighted(&FOCUS);
    let short = size.0.min(size.1) as f32;
    let human = CLASSES[focus].human;
    let wanted = if human { draw.octave(0.25 * short, 1.5 * short) } else { draw.octave(20.0, 0.8 * short) };
    let scale = (typical(focus) / wanted).clamp(0.12, if human { 4.5 } else { 2.6 });
    let camera = place_camera(draw, size, scale);
    let mut light = Light::draw(draw);
    let floor = Floor::new(kind, floor_number);
    light.ground = floor.at(Vec2::ZERO, 60.0).colour * 0.7;
    let mut scene = Scene {
        stage: Stage { camera, light, floor, objects: Vec::new(), laser: None },
        items: Vec::new(),
        floor: floor_number,
        look: Look::draw(draw),
        scale,
    };
    let count =
        if draw.chance(0.08) { 0 } else { 1 + draw.weighted(&[1.0, 1.4, 1.8, 2.0, 2.0, 1.6, 1.2, 0.9]) };
    for place in 0..count {
        let class = if place == 0 { focus } else { companion(draw, scale, short) };
        add(draw, pool, &mut scene, class);
    }
    // Clutter that is not trained, also where nothing else lies.
    for _ in 0..draw.weighted(&[6.0, 2.5, 1.0]) {
        if TYPICAL_OTHER / scale < 1.6 * short || draw.chance(0.1) {
            let class = draw.whole(TRAINED, CLASSES.len() - 1);
            add(draw, pool, &mut scene, class);
        }
    }
    if draw.chance(0.38) {
        scene.stage.laser = Some(laser(draw, &scene));
    }
    scene
}

/// A class whose things can be seen at this scale.
fn companion(draw: &mut Draw, scale: f32, short: f32) -> usize {
    for _ in 0..12 {
        let class = draw.whole(0, TRAINED - 1);
        let pixels = typical(class) / scale;
        if pixels > 14.0 && pixels < 1.1 * short {
            return class;
        }
    }
    draw.whole(0, 9)
}

fn place_camera(draw: &mut Draw, size: (usize, usize), scale: f32) -> Camera {
    let width = size.0 as f32;
    let distortion = if draw.chance(0.5) { draw.between(-0.06, 0.04) } else { 0.0 };
    let roll = if draw.chance(0.25) { 0.12 * draw.normal() } else { 0.0 };
    if draw.chance(0.3) {
        // The robot's own camera: low above the floor, looking out and down at the stripe.
        let high = draw.between(220.0, 430.0);
        let out = draw.between(280.0, 650.0);
        let position = Vec3::new(draw.between(-60.0, 60.0), -out, high);
        let target = Vec3::new(draw.between(-120.0, 120.0), draw.between(-60.0, 60.0), 0.0);
        let focal = (position.distance(target) / scale).clamp(0.35 * width, 7.0 * width);
        return Camera::new(position, target, roll, focal, distortion, size);
    }
    let elevation = if draw.chance(0.3) { draw.between(1.2, 1.55) } else { draw.between(0.32, 1.25) };
    let focal = width * draw.octave(0.65, 2.4);
    let distance = (scale * focal).max(70.0);
    let azimuth = draw.angle();
    let level = Vec2::from_angle(azimuth) * elevation.cos();
    let position = Vec3::new(level.x, level.y, elevation.sin()) * distance;
    Camera::new(position, Vec3::ZERO, roll, focal, distortion, size)
}

/// A place on the floor that the picture shows at about `(x, y)` of its size.
fn floor_under(camera: &Camera, x: f32, y: f32) -> Option<Vec2> {
    let ray = camera.ray(x * camera.size.0 as f32, y * camera.size.1 as f32);
    if ray.z > -0.08 {
        return None;
    }
    let run = -camera.position.z / ray.z;
    let far = camera.position.length() * 3.0;
    (run < far).then(|| (camera.position + ray * run).truncate())
}

fn add(draw: &mut Draw, pool: &Pool<'_>, scene: &mut Scene, class: usize) {
    if scene.stage.objects.len() >= 14 {
        return;
    }
    let number = pool.items.0 + draw.whole(0, pool.items.1 as usize - 1) as u64;
    let item = Item { class, number };
    let mut pose = Draw::new(u64::from(draw.seed()), &[class as u64]);
    let model = item.model(&mut pose);
    let (yaw, tilt) = (draw.angle(), if draw.chance(0.08) { draw.small_turn(0.12) } else { Quat::IDENTITY });
    let mut placed = Placed::new(model, Vec2::ZERO, yaw, tilt);
    let edge = if CLASSES[class].human { 0.12 } else { 0.04 };
    let half = placed.half_extent();
    for attempt in 0..24 {
        let (x, y) = (draw.between(-edge, 1.0 + edge), draw.between(-edge, 1.0 + edge));
        let Some(place) = floor_under(&scene.stage.camera, x, y) else { continue };
        let under = scene.stage.objects.iter().find(|other| {
            let apart = (other.centre.truncate() - place).abs();
            let reach = (other.half_extent() + half).truncate() * 0.92;
            apart.x < reach.x && apart.y < reach.y
        });
        let mut lift = 0.0;
        if let Some(other) = under {
            // Sometimes a thing lies on another; a hand may hang over it.
            if attempt < 18 || !draw.chance(0.3) || other.half_extent().z > 30.0 {
                continue;
            }
            lift = other.centre.z + other.half_extent().z * 0.85;
        }
        placed.move_to(place, lift);
        // Large enough to tell what it is.
        let seen = 2.0 * placed.radius
            / (scene.stage.camera.spread() * placed.centre.distance(scene.stage.camera.position));
        if seen < LEAST_SEEN && attempt < 20 {
            continue;
        }
        // Never around the camera.
        let room = 25.0_f32.max(0.25 * placed.radius).max(0.3 * scene.stage.camera.position.length());
        if placed.about(scene.stage.camera.position) < room {
            continue;
        }
        scene.stage.objects.push(placed);
        scene.items.push(item);
        return;
    }
}

/// A laser whose stripe crosses the picture, mostly from side to side, often over a thing.
fn laser(draw: &mut Draw, scene: &Scene) -> Laser {
    let camera = &scene.stage.camera;
    let over = if scene.stage.objects.is_empty() || draw.chance(0.35) {
        floor_under(camera, 0.5, draw.between(0.3, 0.9)).unwrap_or(Vec2::ZERO)
    } else {
        let object = &scene.stage.objects[draw.whole(0, scene.stage.objects.len() - 1)];
        object.centre.truncate() + draw.in_square(0.4) * object.half_extent().truncate()
    };
    let toward = -camera.position.truncate().normalize_or(Vec2::Y);
    let slant = if draw.chance(0.75) { 0.15 * draw.normal() } else { draw.angle() };
    let along = Vec2::from_angle(slant).rotate(toward.perp());
    let reach = scene.scale * camera.size.0 as f32;
    let (first, second) = (over - along * reach, over + along * reach);
    let behind = toward * -draw.between(0.3, 1.5) * reach * draw.pick(&[1.0, 1.0, 0.3, -0.6]);
    let origin = (over + behind).extend(reach * draw.between(0.25, 0.9))
        + (along * reach * draw.between(-1.0, 1.0)).extend(0.0);
    // A band of red light-emitting diodes is broad and dim, a laser thin and bright.
    let band = draw.chance(0.12);
    let half = if band { draw.between(4.0, 9.0) } else { draw.octave(0.5, 2.2) } * scene.scale.max(0.4);
    let strength = if band { draw.between(0.3, 1.2) } else { draw.octave(1.0, 9.0) };
    Laser::new(origin, first.extend(0.0), second.extend(0.0), half, strength)
}

/// The kinds of floors that training may see.
#[must_use]
pub fn seen_kinds() -> &'static [(Kind, f32)] {
    &SEEN
}
