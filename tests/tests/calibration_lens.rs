//! The lens from many views of a board: pictures made here through a known lens, so that the truth is exact.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use image::{DynamicImage, GrayImage};
use nalgebra::{Rotation3, Vector3};
use nearfield_host::calibrate::board::{Board, BoardView};
use nearfield_host::calibrate::lens::{LensKnowledge, calibrate_lens};
use nearfield_host::calibrate::model::BoardPose;
use nearfield_host::calibrate::picture::CalibrationPicture;
use nearfield_host::twin::board::{PaintedBoard, lens_views};
use nearfield_shared::camera::{Camera, Intrinsics, Pixel};
use nearfield_shared::rig::ImageSize;

const IMAGE: ImageSize = ImageSize { width: 1152, height: 648 };
const SEED: u64 = 20_251;
const PAINTED: PaintedBoard = PaintedBoard { corners: [9, 6], square_mm: 25.0 };

fn board() -> Board {
    Board { pattern: "9x6".parse().unwrap(), square_mm: PAINTED.square_mm }
}

/// A board seen from the front, turned by these angles (radians), its middle at this place of the camera's frame.
fn pose(tilt: f64, turn: f64, roll: f64, place: Vector3<f64>) -> BoardPose {
    // Half a turn about x first: the board's printed side faces the camera.
    let facing = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    BoardPose { rotation: Rotation3::from_euler_angles(tilt, turn, roll) * facing, translation: place }
}

fn views(cameras: &[Camera]) -> Vec<BoardView> {
    let (width, height) = (u32::from(IMAGE.width), u32::from(IMAGE.height));
    (SEED..)
        .zip(cameras)
        .map(|(seed, camera)| {
            let grey = GrayImage::from_raw(width, height, PAINTED.render(camera, IMAGE, seed)).unwrap();
            let picture = CalibrationPicture::new(Path::new("rendered"), &DynamicImage::ImageLuma8(grey));
            board().find(&picture).unwrap()
        })
        .collect()
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
    for (name, truth, view) in [("normal", normal, 66.0), ("wide", wide, 100.0)] {
        let seen = views(&lens_views(&truth, IMAGE, &PAINTED));
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
    let few = views(&lens_views(&lens, IMAGE, &PAINTED)[..3]);
    let told = calibrate_lens(IMAGE, &few, &knowledge).unwrap_err().to_string();
    assert!(told.contains("3 usable view(s)"), "{told}");
    let frontal: Vec<Camera> = (0..6)
        .map(|index| {
            pose(0.02, 0.01, 0.0, Vector3::new(20.0 * f64::from(index) - 50.0, 0.0, 400.0)).camera(lens)
        })
        .collect();
    let told = calibrate_lens(IMAGE, &views(&frontal), &knowledge).unwrap_err().to_string();
    assert!(told.contains("too alike"), "{told}");
}
