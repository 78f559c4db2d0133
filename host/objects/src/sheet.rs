//! Sheets of items to look at.

use glam::{Quat, Vec2, Vec3};
use image::{RgbImage, imageops};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::floor::{Floor, Kind};
use crate::items::{CLASSES, Item};
use crate::light::Light;
use crate::placed::Placed;
use crate::random::Draw;
use crate::render::{Stage, render};
use crate::sensor::Look;

/// One item on a grey floor, seen obliquely, filling a square of `pixels`.
#[must_use]
pub fn portrait(item: Item, turn: u64, pixels: usize) -> RgbImage {
    let mut pose = Draw::new(7, &[item.class as u64, item.number, turn]);
    let model = item.model(&mut pose);
    let placed = Placed::new(model, Vec2::ZERO, pose.angle(), Quat::IDENTITY);
    let reach = placed.half_extent().length();
    let aim = placed.centre;
    let position = aim + Vec3::new(0.0, -0.75, 1.0).normalize() * reach * 4.2;
    let camera = Camera::new(position, aim, 0.0, pixels as f32 * 1.9, 0.0, (pixels, pixels));
    let mut light = Light::draw(&mut pose);
    let floor = Floor::new(Kind::Concrete, item.number);
    light.ground = floor.at(Vec2::ZERO, 60.0).colour * 0.7;
    let stage = Stage { camera, light, floor, objects: vec![placed], laser: None };
    Look::plain().expose(&render(&stage), (pixels, pixels), &mut pose)
}

/// A sheet: a row for every given class, `columns` items in each from number `first` on.
#[must_use]
pub fn sheet(classes: &[usize], first: u64, columns: usize, pixels: usize) -> RgbImage {
    let places: Vec<(usize, usize)> =
        (0..classes.len()).flat_map(|row| (0..columns).map(move |column| (row, column))).collect();
    let portraits: Vec<RgbImage> = places
        .par_iter()
        .map(|&(row, column)| {
            let class = classes[row].min(CLASSES.len() - 1);
            portrait(Item { class, number: first + column as u64 }, 0, pixels)
        })
        .collect();
    let mut sheet = RgbImage::new((columns * pixels) as u32, (classes.len() * pixels) as u32);
    for ((row, column), portrait) in places.into_iter().zip(portraits) {
        imageops::replace(&mut sheet, &portrait, (column * pixels) as i64, (row * pixels) as i64);
    }
    sheet
}
