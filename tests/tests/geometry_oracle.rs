//! The column maps that the MCU computes against an independent exact model, over random rigs of every family.
#![allow(clippy::unwrap_used)]

use nearfield_host::rig_file;
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::laser::PaperGeometry;
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::rig::Rig;
use nearfield_tests::oracle::{FAMILIES, LOW, OracleRig, Random, random_rig};
use std::path::Path;

const SEED: u64 = 20_260_401;
const RIGS_A_FAMILY: usize = 12;

/// The rig as the MCU has it: through the rig file and the compact form in flash.
fn as_on_the_mcu(oracle: &OracleRig) -> Rig {
    let rig = rig_file::parse(&oracle.to_toml(), Path::new(oracle.family)).unwrap();
    Rig::from_bytes(&rig.to_bytes()).unwrap()
}

/// Largest error of height (0 to 200 mm) and of the ray's place (up to 100 mm), over rows inside the picture; below a low laser, which
/// lights nothing above itself, up to 95 % and half of its height.
fn worst_errors(oracle: &OracleRig) -> (f64, f64) {
    let rig = as_on_the_mcu(oracle);
    let mut geometry = Box::new(StripeGeometry::<LARGEST_COLUMN_COUNT>::empty());
    let decimation = Decimation::for_line_scan(rig.image().width);
    geometry.fill(&rig, decimation).unwrap();
    let laser = oracle.laser_origin[2];
    let (highest, highest_place) =
        if oracle.family == LOW { (0.95 * laser, 0.5 * laser) } else { (200.0, 100.0) };
    let (mut height_error, mut place_error, mut compared) = (0.0_f64, 0.0_f64, 0);
    for column in geometry.watched().step_by(9) {
        let map = geometry.map(column).unwrap();
        let u = decimation.centre(u16::try_from(column).unwrap());
        for row in (0..rig.image().height).step_by(7) {
            let lit = oracle.lit_point(u, f64::from(row));
            if !(0.0..=highest).contains(&lit[2]) {
                continue;
            }
            compared += 1;
            height_error = height_error.max((f64::from(map.height(f32::from(row))) - lit[2]).abs());
            if lit[2] <= highest_place {
                let place = f64::from(geometry.ray_place(map, f32::from(row)));
                place_error = place_error.max((place - oracle.ray_name(lit)).abs());
            }
        }
    }
    assert!(compared > 1000, "only {compared} points compared");
    (height_error, place_error)
}

#[test]
fn column_maps_are_within_a_tenth_of_a_millimetre_of_the_exact_model() {
    println!("seed {SEED}");
    let mut random = Random::new(SEED);
    for family in FAMILIES.into_iter().chain([LOW]) {
        let mut worst = (0.0_f64, 0.0_f64);
        for _ in 0..RIGS_A_FAMILY {
            let oracle = random_rig(family, &mut random);
            let (height, place) = worst_errors(&oracle);
            assert!(height <= 0.1, "{family}: height off by {height} mm\n{}", oracle.to_toml());
            let place_bound = if ["wide", LOW].contains(&family) { 5.0 } else { 1.5 };
            assert!(place <= place_bound, "{family}: place off by {place} mm\n{}", oracle.to_toml());
            worst = (worst.0.max(height), worst.1.max(place));
        }
        println!("{family}: height within {:.4} mm, place within {:.3} mm", worst.0, worst.1);
    }
}

/// The paper's Eq. (hobj) where its assumptions hold: no distortion, camera straight above the laser, tilted about the
/// stripe's direction only, central column.
#[test]
fn the_papers_closed_form_equals_the_exact_model_where_it_applies() {
    println!("seed {SEED}");
    let mut random = Random::new(SEED);
    for _ in 0..200 {
        let pitch = random.within(35.0, 60.0);
        let (camera_height, laser_height) = (random.within(300.0, 600.0), random.within(100.0, 250.0));
        let distance = random.within(300.0, 700.0);
        let oracle = OracleRig {
            family: "paper",
            size: (2304, 1296),
            lens: [1792.0, 1792.0, 1151.5, 647.5],
            distortion: [0.0; 5],
            rotation: OracleRig::rotation_of(0.0, pitch, 0.0),
            centre: [0.0, 0.0, camera_height],
            laser_origin: [0.0, 0.0, laser_height],
            stripe_point: [0.0, distance, 0.0],
            stripe_direction: [1.0, 0.0, 0.0],
            stretch: (-50.0, 50.0),
        };
        let paper = PaperGeometry { laser_height, camera_height, distance, focal_length: 1792.0 };
        let nadir = 1792.0 / pitch.to_radians().tan();
        for share in [0.0, 0.1, 0.3, 0.6, 0.9] {
            let height = share * laser_height;
            let [_, v] = oracle.project([0.0, distance * (1.0 - share), height]);
            let closed = paper.height(nadir, v - 647.5).unwrap();
            assert!((closed - height).abs() < 1e-3, "closed form {closed} mm, true {height} mm");
        }
    }
}
