//! Verdicts hold when a camera is set, or sees, a little differently than when the pictures with known truth were made.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use image::{Rgb, RgbImage};
use nearfield_host::cli::evaluate_scenes::{Layout, evaluate};
use nearfield_host::scene_file::Scene;
use std::path::Path;

/// Heights may be off by this much, millimetres: those of the undisturbed pictures are within a quarter of it.
const HEIGHT_MM: f32 = 1.0;

/// A pixel's colour at a place (shares of the picture's width and height) as another camera, lens or lamp would give it.
type Disturbance = fn([f32; 3], [f32; 2]) -> [f32; 3];

const DISTURBANCES: [(&str, Disturbance); 9] = [
    ("a third less light", |colour, _| colour.map(|level| level * 0.67)),
    ("a third more light", |colour, _| colour.map(|level| level * 1.33)),
    ("a steeper tone curve", |colour, _| colour.map(|level| 255.0 * (level / 255.0).powf(1.25))),
    ("a flatter tone curve", |colour, _| colour.map(|level| 255.0 * (level / 255.0).powf(0.8))),
    ("white balance too warm", |[red, green, blue], _| [red * 1.15, green, blue * 0.85]),
    ("white balance too cold", |[red, green, blue], _| [red * 0.88, green, blue * 1.15]),
    ("a veil over the lens", |colour, _| colour.map(|level| level * 0.8 + 35.0)),
    ("dark corners", |colour, [x, y]| {
        let loss = (x - 0.5).powi(2) + (y - 0.5).powi(2);
        colour.map(|level| level * (1.0 - loss))
    }),
    ("a red beacon's glow", |[red, green, blue], [x, y]| {
        let glow = (-((x - 0.3) / 0.35).powi(2) - ((y - 0.6) / 0.5).powi(2)).exp();
        [red + 60.0 * glow, green + 4.0 * glow, blue + 2.0 * glow]
    }),
];

fn disturbed(picture: &RgbImage, disturbance: impl Fn([f32; 3], [f32; 2]) -> [f32; 3]) -> RgbImage {
    let (width, height) = (picture.width() as f32, picture.height() as f32);
    let mut changed = picture.clone();
    for (column, row, pixel) in changed.enumerate_pixels_mut() {
        let place = [column as f32 / width, row as f32 / height];
        *pixel = Rgb(
            disturbance(pixel.0.map(f32::from), place).map(|level| level.round().clamp(0.0, 255.0) as u8)
        );
    }
    changed
}

/// Adds noise of this standard deviation, levels; the same for the same seed.
fn noisy(picture: &RgbImage, deviation: f32, seed: u64) -> RgbImage {
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32 - 0.5
    };
    let mut changed = picture.clone();
    for level in changed.iter_mut() {
        // Four uniform values have a third of a unit's variance together.
        let sum: f32 = (0..4).map(|_| uniform()).sum();
        *level = (f32::from(*level) + sum * 3.0_f32.sqrt() * deviation).round().clamp(0.0, 255.0) as u8;
    }
    changed
}

fn judge(scene: &Scene, picture: &RgbImage, layout: Layout, what: &str) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    picture.save(&path).unwrap();
    let result = evaluate(&Scene { picture: path, ..scene.clone() }, layout).unwrap();
    assert!(result.right, "{}, {what}, {layout:?}: host cut {}, {:?}", scene.name, result.cutoff, result.mcu);
    for height in &result.heights {
        if let Some(measured) = height.measured_mm {
            let error = (measured - height.expected_mm).abs();
            assert!(
                error <= HEIGHT_MM,
                "{}, {what}, {layout:?}: {measured} of {} mm",
                scene.name,
                height.expected_mm
            );
        }
    }
}

#[test]
fn other_settings_lenses_and_lamps_change_no_verdict() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pictures");
    let scenes = Scene::load_all(&folder).unwrap();
    assert!(scenes.len() >= 17, "only {} pictures", scenes.len());
    for (index, scene) in scenes.iter().enumerate() {
        let picture = image::open(&scene.picture).unwrap().to_rgb8();
        for (number, (what, disturbance)) in DISTURBANCES.iter().enumerate() {
            // Each picture and each disturbance in both layouts, but not each pair: half the time.
            let layout = if (index + number) % 2 == 0 { Layout::AsRead } else { Layout::Yuv420 };
            judge(scene, &disturbed(&picture, disturbance), layout, what);
        }
        let seed = 20_261_122 + index as u64;
        for layout in [Layout::AsRead, Layout::Yuv420] {
            judge(scene, &noisy(&picture, 4.0, seed), layout, &format!("noise of 4 levels, seed {seed}"));
        }
    }
}
