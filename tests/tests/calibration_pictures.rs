//! A rig from pictures: a board on the floor, the clean stripe, the stripe over blocks. Rendered pictures whose true
//! rigs are known; heights are what counts.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use nearfield_host::calibrate::CalibrationError;
use nearfield_host::calibrate::board::Board;
use nearfield_host::calibrate::drift::measure_drift;
use nearfield_host::calibrate::lens::LensKnowledge;
use nearfield_host::calibrate::output::rig_toml;
use nearfield_host::calibrate::picture::CalibrationPicture;
use nearfield_host::calibrate::session::{BlockPicture, Calibration, Inputs, calibrate};
use nearfield_host::calibrate::verdict::{Grade, judge};
use nearfield_host::calibrate::world::WorldTie;
use nearfield_host::rig_file;
use nearfield_shared::camera::Vector;
use nearfield_shared::rig::Rig;

/// Side of the squares of the board in the pictures, millimetres.
const SQUARE_MM: f64 = 50.0;

fn pictures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pictures")
}

fn true_rig(name: &str) -> Rig {
    rig_file::load(&pictures().join("rigs").join(format!("{name}.toml"))).unwrap()
}

fn picture(kind: &str, rig: &str) -> CalibrationPicture {
    CalibrationPicture::read(&pictures().join("calibration").join(format!("{kind}_{rig}.jpg"))).unwrap()
}

/// Where the camera of this rig is mounted, as a tape measures it.
fn camera_foot(rig: &Rig) -> [f64; 2] {
    let centre = rig.camera().pose.centre();
    [centre.x, centre.y]
}

fn inputs(name: &str, lens: LensKnowledge) -> Inputs {
    let block =
        |height_mm: f64| BlockPicture { height_mm, picture: picture(&format!("step{height_mm}"), name) };
    Inputs {
        board: Board { pattern: "11x7".parse().unwrap(), square_mm: SQUARE_MM },
        board_thickness_mm: 0.2,
        floor: picture("board", name),
        lens_views: Vec::new(),
        stripe: picture("stripe", name),
        blocks: vec![block(60.0), block(120.0)],
        block_sigma_mm: 0.1,
        lens,
        tie: WorldTie::Camera { foot: camera_foot(&true_rig(name)), stripe: 0.0 },
        watched: None,
    }
}

fn known_lens(rig: &Rig) -> LensKnowledge {
    LensKnowledge::measured(&rig.camera().intrinsics, [0.0; 9])
}

/// Root mean square and largest difference of the heights that two rigs see in the same pixels, over the whole stripe
/// and 0 to 120 mm, millimetres.
fn height_difference(calibrated: &Rig, truth: &Rig) -> (f64, f64) {
    let (mut count, mut squares, mut worst) = (0.0, 0.0, 0.0_f64);
    for height in [0.0, 25.0, 50.0, 75.0, 100.0, 120.0] {
        for step in 0..=60 {
            let share = f64::from(step) / 60.0;
            let foot = truth.stripe().at(truth.stripe().start * (1.0 - share) + truth.stripe().end * share);
            let origin = truth.laser().origin;
            let lit = foot.plus(origin.minus(foot).scaled(height / origin.z));
            let Some(pixel) = truth.camera().project(lit) else { continue };
            let inside = |value: f64, size: u16| value >= 0.0 && value <= f64::from(size) - 1.0;
            if !inside(pixel.u, truth.image().width) || !inside(pixel.v, truth.image().height) {
                continue;
            }
            let measured = calibrated.laser().triangulate(calibrated.camera(), pixel).unwrap().z;
            count += 1.0;
            squares += (measured - height).powi(2);
            worst = worst.max((measured - height).abs());
        }
    }
    assert!(count > 200.0, "only {count} points of the true stripe are in the picture");
    ((squares / count).sqrt(), worst)
}

fn angle_degrees(one: Vector, other: Vector) -> f64 {
    let cross = one.cross(other);
    cross.dot(cross).sqrt().atan2(one.dot(other)).to_degrees()
}

fn calibrated(name: &str, lens: LensKnowledge) -> Calibration {
    calibrate(&inputs(name, lens), |_| {}).unwrap()
}

/// The rule: with the camera's true lens, heights are those of the true rig to 1 mm (RMSE), and the sheet is right to
/// 0.1 degrees and 1 mm. The pictures have half the camera's size here.
#[test]
fn with_a_known_lens_heights_and_sheet_are_those_of_the_true_rig() {
    for name in ["t2_std", "t1_side_std"] {
        let truth = true_rig(name);
        let calibration = calibrated(name, known_lens(&truth));
        let (error, worst) = height_difference(&calibration.rig, &truth);
        let angle = angle_degrees(calibration.rig.laser().normal, truth.laser().normal);
        let shift = calibration.rig.laser().offset - truth.laser().offset;
        println!(
            "{name}: heights {error:.3} mm RMSE, worst {worst:.3}; sheet {angle:.4} degrees, {shift:+.3} mm"
        );
        assert!(error < 0.2, "{name}: heights are {error} mm off");
        assert!(angle < 0.05 && shift.abs() < 0.5, "{name}: sheet {angle} degrees, {shift} mm off");
        assert_eq!(judge(&calibration).grade, Grade::Good);
    }
}

/// The rule: with a lens that is only nominally known, heights are right to 3 mm, and the stated uncertainty covers the
/// true error.
#[test]
fn with_a_nominal_lens_heights_are_within_three_millimetres_and_the_uncertainty_is_honest() {
    for (name, view) in [("t2_std", 66.0), ("t1_side_std", 66.0), ("t2_std", 63.0), ("t1_side_std", 69.0)] {
        let truth = true_rig(name);
        let calibration = calibrated(name, LensKnowledge::nominal(truth.image(), view));
        let (error, worst) = height_difference(&calibration.rig, &truth);
        let stated = judge(&calibration)
            .height_sigmas
            .iter()
            .map(|sigma| sigma.sigma_mm)
            .filter(|sigma| sigma.is_finite())
            .fold(0.0, f64::max);
        println!(
            "{name} ({view} degrees): heights {error:.3} mm RMSE, worst {worst:.3}; stated sigma {stated:.3}"
        );
        assert!(error < 1.0 && worst < 3.0, "{name}: {error} mm RMSE, worst {worst}");
        assert!(worst < 4.0 * stated + 0.05, "{name}: worst {worst} mm, but stated sigma {stated}");
    }
}

/// The rule: the shadows of the blocks tell where the laser stands, to what places of raised things need.
#[test]
fn the_lasers_place_comes_from_the_blocks_shadows() {
    for (name, allowed) in [("t2_std", 15.0), ("t1_side_std", 15.0)] {
        let truth = true_rig(name);
        let calibration = calibrated(name, known_lens(&truth));
        let away = calibration.rig.laser().origin.minus(truth.laser().origin);
        let distance = away.dot(away).sqrt();
        println!("{name}: laser {distance:.1} mm off, from {} shadows", calibration.apex.rays);
        assert!(distance < allowed, "{name}: {away:?}");
    }
}

/// The rule: the file that is written is a rig file like any other, and says how sure it is.
#[test]
fn the_written_rig_is_read_back_bit_for_bit() {
    let truth = true_rig("t2_std");
    let calibration = calibrated("t2_std", known_lens(&truth));
    let text = rig_toml(&calibration, &judge(&calibration));
    assert_eq!(rig_file::parse(&text, Path::new("written.toml")).unwrap(), calibration.rig);
    let table: toml::Table = text.parse().unwrap();
    assert_eq!(table["uncertainty"]["heights_mm"].as_array().unwrap().len(), 15);
    let compact = Rig::from_bytes(&calibration.rig.to_bytes()).unwrap();
    assert!(height_difference(&compact, &calibration.rig).1 < 0.01);
}

/// The rule: a freshly calibrated rig is true on the clean floor; a rig of another place, or one that is half a degree
/// out, is not.
#[test]
fn drift_is_told_from_a_clean_floor() {
    let truth = true_rig("t2_std");
    let rig = calibrated("t2_std", known_lens(&truth)).rig;
    let clean = picture("stripe", "t2_std");
    let drift = measure_drift(&rig, &clean).unwrap();
    assert!(!drift.has_drifted() && drift.worst_mm < 0.2 && drift.seen > 0.95, "{drift:?}");
    let tilted = tilted_camera(&rig, 0.25);
    let drift = measure_drift(&tilted, &clean).unwrap();
    println!("a quarter of a degree: {:+.2} mm, {:+.2} rows", drift.height_mm, drift.rows);
    assert!(drift.has_drifted(), "{drift:?}");
    let error = measure_drift(&rig, &picture("board", "t2_std")).unwrap_err().to_string();
    assert!(error.contains("is the laser on"), "{error}");
}

/// The rig with its camera pitched by so many degrees.
fn tilted_camera(rig: &Rig, degrees: f64) -> Rig {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let mut camera = *rig.camera();
    let turn = |vector: Vector| {
        Vector::new(vector.x, cosine * vector.y - sine * vector.z, sine * vector.y + cosine * vector.z)
    };
    let [right, down, forward] = camera.pose.rotation;
    camera.pose.rotation = [
        right,
        down.scaled(cosine).minus(forward.scaled(sine)),
        down.scaled(sine).plus(forward.scaled(cosine)),
    ];
    camera.pose.translation = turn(camera.pose.translation);
    Rig::new(rig.image(), camera, *rig.laser(), *rig.stripe()).unwrap()
}

fn refusal(change: impl FnOnce(&mut Inputs)) -> String {
    let mut inputs = inputs("t2_std", known_lens(&true_rig("t2_std")));
    change(&mut inputs);
    match calibrate(&inputs, |_| {}) {
        Ok(_) => panic!("was accepted"),
        Err(error @ CalibrationError::Rig(_)) => panic!("not explained: {error}"),
        Err(error) => error.to_string(),
    }
}

/// The rule: what is set wrongly is explained, with what to do; nothing is calibrated from it.
#[test]
fn mistakes_are_explained() {
    let other_board = refusal(|inputs| inputs.board.pattern = "9x6".parse().unwrap());
    assert!(other_board.contains("11 x 7 inner corners, not 9 x 6"), "{other_board}");
    let larger_board = refusal(|inputs| inputs.board.pattern = "14x10".parse().unwrap());
    assert!(larger_board.contains("another board than"), "{larger_board}");
    let no_board = refusal(|inputs| inputs.floor = picture("stripe", "t2_std"));
    assert!(no_board.contains("no chessboard is found"), "{no_board}");
    let laser_off = refusal(|inputs| inputs.stripe = picture("board", "t2_std"));
    assert!(laser_off.contains("is the laser on"), "{laser_off}");
    let no_block = refusal(|inputs| inputs.blocks.clear());
    assert!(no_block.contains("no block"), "{no_block}");
    let bare = refusal(|inputs| {
        inputs.blocks = vec![BlockPicture { height_mm: 60.0, picture: picture("stripe", "t2_std") }];
    });
    assert!(bare.contains("no block can be used"), "{bare}");
    let mixed_up = refusal(|inputs| {
        inputs.blocks[0].height_mm = 120.0;
        inputs.blocks[1].height_mm = 60.0;
    });
    assert!(mixed_up.contains("mixed up"), "{mixed_up}");
    let other_size = refusal(|inputs| {
        let colours = image::RgbImage::new(640, 480);
        inputs.stripe =
            CalibrationPicture::new(Path::new("small.png"), &image::DynamicImage::ImageRgb8(colours));
    });
    assert!(other_size.contains("small.png") && other_size.contains("640 x 480"), "{other_size}");
}

/// The rule: two blocks check the board: squares that are not as stated are told, with the size that fits.
#[test]
fn squares_of_another_size_are_told_with_the_size_that_fits() {
    let told = refusal(|inputs| inputs.board.square_mm = 60.0);
    let hint = told.split("if the squares are ").nth(1).unwrap();
    let size: f64 = hint.trim_end_matches(" mm").parse().unwrap();
    assert!((size - SQUARE_MM).abs() < 1.0, "{told}");
}
