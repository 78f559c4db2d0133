//! The lens from many views of a board: pictures made here through a known lens, so that the truth is exact.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use image::{DynamicImage, GrayImage, Luma};
use nalgebra::{Point2, Rotation3, Vector3};
use nearfield_host::calibrate::board::{Board, BoardView};
use nearfield_host::calibrate::lens::{LensKnowledge, calibrate_lens};
use nearfield_host::calibrate::model::BoardPose;
use nearfield_host::calibrate::picture::CalibrationPicture;
use nearfield_shared::camera::{Intrinsics, Pixel};
use nearfield_shared::rig::ImageSize;
use rayon::prelude::*;

const IMAGE: ImageSize = ImageSize { width: 1152, height: 648 };
const SEED: u64 = 20_251;

/// A repeatable stream of numbers from 0 to 1.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn board() -> Board {
    Board { pattern: "9x6".parse().unwrap(), square_mm: 25.0 }
}

/// Brightness of the board's plane: 10 x 7 squares around its middle, a white margin, grey beyond.
fn brightness(place: Point2<f64>) -> f64 {
    let (column, row) = (place.x / 25.0 + 5.0, place.y / 25.0 + 3.5);
    let inside =
        |margin: f64| column > -margin && column < 10.0 + margin && row > -margin && row < 7.0 + margin;
    match (inside(0.0), inside(0.8)) {
        (true, _) if (column.floor() + row.floor()) as i64 % 2 == 0 => 35.0,
        (true, _) | (false, true) => 205.0,
        (false, false) => 110.0,
    }
}

/// A picture of the board: every pixel the mean of 3 x 3 lines of sight through the lens, with noise.
fn render(lens: &Intrinsics, pose: &BoardPose, dice: &mut Dice) -> CalibrationPicture {
    let camera = pose.camera(*lens);
    let centre = camera.pose.centre();
    let width = usize::from(IMAGE.width);
    let mut values = vec![0.0; width * usize::from(IMAGE.height)];
    values.par_chunks_mut(width).enumerate().for_each(|(v, row)| {
        for (u, value) in row.iter_mut().enumerate() {
            for part in 0..9 {
                let offset = |part: usize| (part as f64 - 1.0) / 3.0;
                let pixel = Pixel { u: u as f64 + offset(part % 3), v: v as f64 + offset(part / 3) };
                *value += camera.line_of_sight(pixel).map_or(110.0, |sight| {
                    let reach = -centre.z / sight.z;
                    brightness(Point2::new(centre.x + reach * sight.x, centre.y + reach * sight.y))
                }) / 9.0;
            }
        }
    });
    let picture = GrayImage::from_fn(u32::from(IMAGE.width), u32::from(IMAGE.height), |u, v| {
        let noise = 3.0 * (dice.roll() + dice.roll() + dice.roll() - 1.5) * 2.0;
        Luma([(values[v as usize * width + u as usize] + noise).clamp(0.0, 255.0) as u8])
    });
    CalibrationPicture::new(Path::new("rendered"), &DynamicImage::ImageLuma8(picture))
}

/// A board seen from the front, turned by these angles (radians), its middle at this place of the camera's frame.
fn pose(tilt: f64, turn: f64, roll: f64, place: Vector3<f64>) -> BoardPose {
    // Half a turn about x first: the board's printed side faces the camera.
    let facing = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    BoardPose { rotation: Rotation3::from_euler_angles(tilt, turn, roll) * facing, translation: place }
}

fn views(lens: &Intrinsics, poses: &[BoardPose]) -> Vec<BoardView> {
    let mut dice = Dice(SEED);
    poses.iter().map(|pose| board().find(&render(lens, pose, &mut dice)).unwrap()).collect()
}

/// Tilted views over the whole picture, as the command's help asks for them.
fn good_poses(reach: f64) -> Vec<BoardPose> {
    let mut poses = Vec::new();
    for (index, (across, down)) in [
        (0.0, 0.0),
        (-1.0, -1.0),
        (1.0, -1.0),
        (-1.0, 1.0),
        (1.0, 1.0),
        (0.0, 0.0),
        (-1.0, 0.0),
        (1.0, 0.0),
        (0.3, -0.8),
        (-0.3, 0.8),
    ]
    .into_iter()
    .enumerate()
    {
        let (tilt, turn) = [(0.6, 0.0), (0.0, 0.6), (-0.55, 0.1), (0.1, -0.55), (0.4, 0.4)][index % 5];
        let far = if index % 2 == 0 { 330.0 } else { 420.0 };
        let place = Vector3::new(across * reach * far, down * reach * 0.45 * far, far);
        poses.push(pose(tilt, turn, 0.1 * index as f64, place));
    }
    poses
}

/// The rule: focal length to 0.2 %, centre to 1.5 px, and every pixel of the picture where it belongs to 2.5 px (most of
/// which a turn of the camera takes up), for a normal and a wide lens with their distortion; sigmas are honest.
#[test]
fn a_lens_is_found_from_views_of_a_board() {
    println!("seed {SEED}");
    let normal = Intrinsics {
        fx: 896.0,
        fy: 897.0,
        cx: 578.65,
        cy: 321.45,
        distortion: [-0.031, 0.011, 0.0003, -0.0002, 0.0],
    };
    let wide = Intrinsics {
        fx: 500.0,
        fy: 500.6,
        cx: 570.0,
        cy: 330.0,
        distortion: [-0.09, 0.02, 0.0003, -0.0002, 0.0],
    };
    for (name, truth, view, reach) in [("normal", normal, 66.0, 0.32), ("wide", wide, 100.0, 0.55)] {
        let seen = views(&truth, &good_poses(reach));
        let found = calibrate_lens(IMAGE, &seen, &LensKnowledge::nominal(IMAGE, view)).unwrap();
        let lens = found.fit.model.lens;
        let sigmas = found.fit.lens_sigmas();
        println!(
            "{name}: {} views, reprojection {:.3} px; fx {:.2} (true {:.2}, sigma {:.2}), cx {:.2} ({:.2}), cy {:.2} ({:.2}), k1 {:.4} ({:.4}), k2 {:.4} ({:.4})",
            seen.len(),
            found.reprojection_error(),
            lens.fx,
            truth.fx,
            sigmas[0],
            lens.cx,
            truth.cx,
            lens.cy,
            truth.cy,
            lens.distortion[0],
            truth.distortion[0],
            lens.distortion[1],
            truth.distortion[1]
        );
        assert!(found.reprojection_error() < 0.2, "{name}");
        assert!(
            (lens.fx / truth.fx - 1.0).abs() < 0.002 && (lens.fy / truth.fy - 1.0).abs() < 0.002,
            "{name}: {lens:?}"
        );
        assert!((lens.cx - truth.cx).abs() < 1.5 && (lens.cy - truth.cy).abs() < 1.5, "{name}: {lens:?}");
        assert!((lens.fx - truth.fx).abs() < 5.0 * sigmas[0], "{name}: sigma {}", sigmas[0]);
        for pixel in [Pixel { u: 60.0, v: 40.0 }, Pixel { u: 1090.0, v: 600.0 }, Pixel { u: 576.0, v: 324.0 }]
        {
            let sight = truth.undistort(pixel).unwrap();
            let again = lens.distort(sight.x, sight.y).unwrap();
            let away = (again.u - pixel.u).hypot(again.v - pixel.v);
            assert!(away < 2.5, "{name}: the model puts {pixel:?} {away:.2} px away");
        }
    }
}

/// The rule: views that cannot tell focal length from distance are refused, not fitted.
#[test]
fn too_few_or_too_similar_views_are_refused() {
    let lens = Intrinsics { fx: 896.0, fy: 896.0, cx: 576.0, cy: 324.0, distortion: [0.0; 5] };
    let knowledge = LensKnowledge::nominal(IMAGE, 66.0);
    let few = views(&lens, &good_poses(0.3)[..3]);
    let told = calibrate_lens(IMAGE, &few, &knowledge).unwrap_err().to_string();
    assert!(told.contains("3 usable view(s)"), "{told}");
    let frontal: Vec<BoardPose> = (0..6)
        .map(|index| pose(0.02, 0.01, 0.0, Vector3::new(20.0 * f64::from(index) - 50.0, 0.0, 400.0)))
        .collect();
    let told = calibrate_lens(IMAGE, &views(&lens, &frontal), &knowledge).unwrap_err().to_string();
    assert!(told.contains("too alike"), "{told}");
}
