//! Rules that models, placement and rendering must keep, over the whole catalogue.
#![allow(clippy::unwrap_used)]

use glam::{Quat, Vec2, Vec3};

use crate::camera::Camera;
use crate::floor::{Floor, Kind};
use crate::items::{CLASSES, Item, TRAINED};
use crate::light::Light;
use crate::placed::Placed;
use crate::random::Draw;
use crate::render::{Rendering, Stage, render};
use crate::sprite::sprite;
use crate::visible::inside_share;

fn placed(class: usize, number: u64) -> Placed {
    let model = Item { class, number }.model(&mut Draw::new(3, &[class as u64, number]));
    Placed::new(model, Vec2::ZERO, 0.7, Quat::IDENTITY)
}

/// A stage with a camera that looks down at the origin from 45 degrees, `far` mm away.
fn stage(objects: Vec<Placed>, far: f32) -> Stage {
    let position = Vec3::new(0.0, -1.0, 1.0).normalize() * far;
    let camera = Camera::new(position, Vec3::ZERO, 0.0, 120.0, 0.0, (96, 96));
    let mut light = Light::draw(&mut Draw::new(1, &[6]));
    light.ground = Vec3::splat(0.2);
    Stage { camera, light, floor: Floor::new(Kind::Plain, 1), objects, laser: None }
}

#[test]
fn a_step_by_the_distance_never_passes_through_a_surface() {
    // The rule that sphere tracing rests on: nothing is nearer than the distance says.
    for (class, _) in CLASSES.iter().enumerate() {
        let mut draw = Draw::new(9, &[class as u64]);
        let model = Item { class, number: 2 }.model(&mut draw.clone());
        let (low, high) = model.bounds();
        for _ in 0..400 {
            let t = Vec3::new(draw.unit(), draw.unit(), draw.unit());
            let p = low + (high - low) * t;
            let free = model.distance(p);
            if free <= 0.0 {
                continue;
            }
            let toward = Vec3::new(draw.normal(), draw.normal(), draw.normal()).normalize();
            let inside = model.distance(p + toward * free * 0.9);
            // Wrinkles are steeper than the field says by a little.
            assert!(
                inside > -0.06 * free - 0.3,
                "{}: {free} free at {p}, {inside} inside",
                CLASSES[class].name
            );
        }
    }
}

#[test]
fn everything_lies_on_the_floor_and_not_in_it() {
    for (class, _) in CLASSES.iter().enumerate() {
        for number in 0..4 {
            let thing = placed(class, number);
            let top = thing.centre.z + thing.half_extent().z;
            let mut lowest = f32::MAX;
            let mut draw = Draw::new(2, &[class as u64, number]);
            for _ in 0..300 {
                // Lines of sight from below meet the lowest parts first.
                let from = thing.centre.truncate() + draw.in_square(1.0) * thing.half_extent().truncate();
                let start = from.extend(-400.0);
                if let (Some(t), _) = thing.trace(start, Vec3::Z, 1e-4) {
                    lowest = lowest.min(t - 400.0);
                }
            }
            let name = CLASSES[class].name;
            // Crumpled cloth has dents that the search for the lowest point can miss.
            let dents = 1.0 + 0.015 * thing.radius;
            assert!(lowest > -dents, "{name} {number} reaches {lowest} mm into the floor");
            assert!(
                lowest - thing.model.lift < 0.35 * top + 3.0,
                "{name} {number} floats {lowest} mm above the floor"
            );
        }
    }
}

#[test]
fn every_trained_class_has_many_different_items() {
    for (class, trained) in CLASSES.iter().enumerate().take(TRAINED) {
        let shapes: Vec<Vec3> = (0..16).map(|number| placed(class, number).half_extent()).collect();
        for (place, one) in shapes.iter().enumerate() {
            let twin = shapes[..place].iter().any(|other| other.abs_diff_eq(*one, 1e-3));
            assert!(!twin, "{}: item {place} is as large as an earlier one", trained.name);
        }
    }
}

#[test]
fn the_trained_classes_come_first_and_no_name_comes_twice() {
    assert!(CLASSES[..TRAINED].iter().all(|c| c.trained) && CLASSES[TRAINED..].iter().all(|c| !c.trained));
    assert!(CLASSES.iter().filter(|c| c.human).all(|c| c.trained), "people are never left out of training");
    let mut names = CLASSES.map(|c| c.name).to_vec();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), CLASSES.len());
}

fn brightness(rendering: &Rendering, x: usize, y: usize) -> f32 {
    rendering.colour[y * 96 + x].y
}

#[test]
fn a_thing_darkens_the_floor_beside_it_and_far_away_nothing_changes() {
    let cube = CLASSES.iter().position(|c| c.name == "box").unwrap();
    let thing = placed(cube, 0);
    let far = thing.radius * 6.0;
    let with = render(&stage(vec![thing], far));
    let without = render(&stage(Vec::new(), far));
    let darker =
        (0..96 * 96).filter(|&i| with.owner[i] == 0 && with.colour[i].y < 0.8 * without.colour[i].y).count();
    assert!(darker > 40, "{darker} pixels of shadow");
    for (x, y) in [(1, 94), (94, 94), (1, 1), (94, 1)] {
        let change = brightness(&with, x, y) / brightness(&without, x, y);
        assert!((0.9..1.1).contains(&change), "the corner {x} {y} changes by {change}");
    }
}

#[test]
fn what_is_hidden_is_not_counted_as_visible() {
    let cube = CLASSES.iter().position(|c| c.name == "box").unwrap();
    let washer = CLASSES.iter().position(|c| c.name == "washer").unwrap();
    let wall = placed(cube, 1);
    let far = wall.radius * 6.0;
    let mut small = placed(washer, 1);
    small.move_to(wall.centre.truncate() + Vec2::new(0.0, wall.half_extent().y + small.radius + 2.0), 0.0);
    let both = render(&stage(vec![small, wall], far));
    assert_eq!(both.visible[0].bounds, None, "behind the box");
    assert!(both.visible[0].unhidden > 0.0, "but on the line of sight");
}

#[test]
fn a_box_holds_exactly_the_pixels_that_show_the_thing() {
    let thing = placed(0, 5);
    let rendering = render(&stage(vec![thing.clone()], thing.radius * 5.0));
    let [left, top, right, bottom] = rendering.visible[0].bounds.unwrap();
    let shown: Vec<(usize, usize)> =
        (0..96 * 96).filter(|&i| rendering.owner[i] == 1).map(|i| (i % 96, i / 96)).collect();
    assert!(!shown.is_empty());
    assert!(shown.iter().all(|&(x, y)| (left..=right).contains(&x) && (top..=bottom).contains(&y)));
    // At most a pixel of thin edges beyond the centres that show it.
    let (least, most) = (shown.iter().map(|p| p.0).min().unwrap(), shown.iter().map(|p| p.0).max().unwrap());
    assert!(least - left <= 2 && right - most <= 2, "box {left}..{right}, shown {least}..{most}");
}

#[test]
fn half_of_a_thing_at_the_border_is_about_half_inside() {
    let ball = CLASSES.iter().position(|c| c.name == "tape_roll").unwrap();
    let thing = placed(ball, 0);
    let scene = stage(Vec::new(), thing.radius * 8.0);
    assert!((inside_share(&scene.camera, &thing) - 1.0).abs() < 1e-6);
    let mut edge = thing.clone();
    // The picture shows 0.4 of the distance to either side.
    edge.move_to(Vec2::new(0.4 * thing.radius * 8.0, 0.0), 0.0);
    let share = inside_share(&scene.camera, &edge);
    assert!((0.3..0.7).contains(&share), "{share}");
}

#[test]
fn a_cut_out_is_opaque_on_the_item_and_clear_far_from_it() {
    let picture = sprite(Item { class: 0, number: 1 }, 2, 3, 64);
    let opaque = picture.pixels().filter(|p| p.0[3] == 255).count();
    assert!((20..2500).contains(&opaque), "{opaque} opaque pixels");
    assert!(picture.get_pixel(0, 0).0[3] < 30, "the corner is clear");
}
