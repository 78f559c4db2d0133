//! Cut-outs of items, as the paper's data were made from: 8 angles in 5 lights, transparent outside the item, its shadow a
//! layer of black.

use std::path::Path;

use anyhow::Context as _;
use glam::{Quat, Vec2, Vec3};
use image::{Rgba, RgbaImage};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::floor::{Floor, Kind};
use crate::items::{CLASSES, Item};
use crate::light::Light;
use crate::placed::Placed;
use crate::random::Draw;
use crate::render::{Stage, render};

/// Angles around the vertical.
pub const ANGLES: usize = 8;
/// Lights: drawn once, the same for all items.
pub const LIGHTS: usize = 5;

/// One cut-out: an item, seen from one of [`ANGLES`] in one of [`LIGHTS`], `pixels` wide and high.
#[must_use]
pub fn sprite(item: Item, angle: usize, light: usize, pixels: usize) -> RgbaImage {
    let mut pose = Draw::new(11, &[item.class as u64, item.number]);
    let model = item.model(&mut pose);
    let yaw = angle as f32 / ANGLES as f32 * std::f32::consts::TAU;
    let placed = Placed::new(model, Vec2::ZERO, yaw, Quat::IDENTITY);
    let aim = placed.centre;
    let position = aim + Vec3::new(0.0, -0.7, 0.72) * placed.half_extent().length() * 4.4;
    let camera = Camera::new(position, aim, 0.0, pixels as f32 * 1.7, 0.0, (pixels, pixels));
    let mut place = Light::draw(&mut Draw::new(12, &[light as u64]));
    let floor = Floor::new(Kind::Plain, 0);
    place.ground = floor.at(Vec2::ZERO, 60.0).colour * 0.7;
    let mut stage = Stage { camera, light: place, floor, objects: vec![placed], laser: None };
    let with = render(&stage);
    stage.objects.clear();
    let without = render(&stage);
    let mut picture = RgbaImage::new(pixels as u32, pixels as u32);
    for (index, pixel) in picture.pixels_mut().enumerate() {
        *pixel = if with.owner[index] > 0 {
            let c = with.colour[index].clamp(Vec3::ZERO, Vec3::ONE).powf(1.0 / 2.2) * 255.0;
            Rgba([c.x as u8, c.y as u8, c.z as u8, 255])
        } else {
            let left = with.colour[index].y / without.colour[index].y.max(1e-4);
            Rgba([0, 0, 0, ((1.0 - left.clamp(0.0, 1.0)) * 255.0) as u8])
        };
    }
    picture
}

/// Writes all cut-outs of `items` items of every class as `folder/CLASS/NUMBER/ANGLE_LIGHT.png`; calls `done` after every
/// item. Returns how many there are.
///
/// # Errors
/// A file that cannot be written.
pub fn write_all(
    folder: &Path,
    classes: &[usize],
    items: u64,
    pixels: usize,
    done: &(dyn Fn() + Sync),
) -> anyhow::Result<usize> {
    let all: Vec<Item> =
        classes.iter().flat_map(|&class| (0..items).map(move |number| Item { class, number })).collect();
    all.par_iter()
        .map(|&item| {
            let home = folder.join(CLASSES[item.class].name).join(item.number.to_string());
            std::fs::create_dir_all(&home).with_context(|| format!("{}: cannot be made", home.display()))?;
            for angle in 0..ANGLES {
                for light in 0..LIGHTS {
                    let path = home.join(format!("{angle}_{light}.png"));
                    let picture = sprite(item, angle, light, pixels);
                    picture.save(&path).with_context(|| format!("{}: cannot be written", path.display()))?;
                }
            }
            done();
            Ok(ANGLES * LIGHTS)
        })
        .sum()
}
