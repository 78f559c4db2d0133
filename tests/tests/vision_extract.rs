//! `find_stripe` against known truth: it knows no rig, so what it finds must be right by itself.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use std::path::Path;
use std::sync::Arc;

use nearfield_host::capture::{Frame, Pixels, read_picture};
use nearfield_host::scene_file::{ExpectedCutoff, Scene};
use nearfield_host::twin::gallery::{CENTRE, SIDE, Theme, WIDE, random_scene};
use nearfield_host::twin::{Twin, View};
use nearfield_host::vision::grid::picture_geometry;
use nearfield_host::vision::unrigged::{Course, find_stripe};

/// A point counts as right within this many pixels of the true row.
const RIGHT_PX: f32 = 1.0;

#[test]
fn points_on_a_whole_stripe_agree_with_its_rig_to_sub_pixel() {
    let scenes = Scene::load_all(&Path::new(env!("CARGO_MANIFEST_DIR")).join("pictures")).unwrap();
    let (mut right, mut wrong, mut watched, mut square) = (0_u32, 0_u32, 0_usize, 0.0_f32);
    for scene in scenes.iter().filter(|scene| scene.cutoff == ExpectedCutoff::NoTrip) {
        let frame = read_picture(&scene.picture, None).unwrap();
        let stripe = find_stripe(&frame.view()).unwrap_or_else(|| panic!("{}: no stripe", scene.name));
        assert_eq!(stripe.course, Course::Across, "{}", scene.name);
        let geometry = picture_geometry(&scene.rig).unwrap();
        watched += geometry.watched().len();
        for point in &stripe.points {
            let Some(map) = geometry.map(point.column as usize) else { continue };
            let distance = point.row - map.floor_row;
            if distance.abs() <= RIGHT_PX {
                (right, square) = (right + 1, square + distance * distance);
            } else {
                wrong += 1;
            }
        }
    }
    let root_mean_square = (square / right as f32).sqrt();
    println!("{right} of {watched} right (RMS {root_mean_square:.2} px), {wrong} wrong");
    assert!(watched > 4_000, "too few columns to prove anything");
    assert!(right as usize * 100 >= watched * 97 && wrong * 200 <= right && root_mean_square <= 0.3);
}

/// The same scenes with the laser on and off: light is found, and red things are not taken for it.
#[test]
fn a_stripe_is_found_if_and_only_if_the_laser_is_on() {
    for (name, mounting) in [("centre", CENTRE), ("side", SIDE), ("wide", WIDE)] {
        let rig = mounting.rig().unwrap();
        let view = Arc::new(View::new(&rig));
        for seed in 301..309 {
            let scene = random_scene(seed, Theme::Object, rig.stripe());
            let twin = Twin::new(Arc::clone(&view), &scene, seed).unwrap();
            for laser in [0.0, 1.0] {
                let frame = Frame::new(rig.image(), Pixels::Rgb(twin.render(0, laser).rgb)).unwrap();
                let found = find_stripe(&frame.view()).is_some();
                assert_eq!(found, laser > 0.0, "rig {name}, scene random:{seed}, laser {laser}");
            }
        }
    }
}
