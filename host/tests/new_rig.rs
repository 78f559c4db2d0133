//! A rig that nobody has built yet, from the study of its mount over its calibration to stops in the twin, by the commands of
//! the operator's guide alone: camera 300 mm, laser 120 mm over the floor, a wide lens.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn nearfield(directory: &Path, arguments: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_nearfield");
    Command::new(program).current_dir(directory).args(arguments.split_whitespace()).output().unwrap()
}

fn done(directory: &Path, arguments: &str) -> String {
    let output = nearfield(directory, arguments);
    assert!(output.status.success(), "nearfield {arguments}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn a_new_rig_goes_from_study_to_calibration_to_stops() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    done(
        at,
        "twin study --camera 300 --laser 120 --view 97 --distance 500 --zone 600 --object 8 --width 1152 --out study",
    );
    for file in ["study.md", "study.json", "placement.svg", "recommended.toml"] {
        assert!(at.join("study").join(file).metadata().unwrap().len() > 200, "{file}");
    }
    done(at, "twin calibration --rig study/recommended.toml --block 30 --block 60 --out pictures");
    let views: Vec<String> = (0..14).map(|index| format!("pictures/lens{index:02}.png")).collect();
    done(at, &format!("calibrate lens --square 25 --view 97 --out lens.toml {}", views.join(" ")));
    let told = done(
        at,
        "calibrate rig --square 25 --lens lens.toml --floor pictures/board.png --stripe pictures/stripe.png \
         --block 30=pictures/block30.png --block 60=pictures/block60.png --out robot.toml --compact robot.bin",
    );
    assert!(told.contains("verdict: good") && !told.contains("estimated from one view"), "{told}");
    done(at, "calibrate check --rig robot.toml pictures/clean.png");
    done(at, "capability --rig robot.toml --picture pictures/clean.png --object 8");
    let report =
        done(at, "inspect --json --rig robot.toml pictures/clean.png pictures/rod.png pictures/object.png");
    let seen: Vec<Value> = report.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let relays: Vec<&Value> = seen.iter().map(|picture| &picture["mcu"]["relay"]).collect();
    assert_eq!(relays, ["closed", "open", "open"], "{report}");
    for (picture, height) in [(&seen[1], 12.0), (&seen[2], 45.0)] {
        let found = picture["objects"][0]["height_mm"].as_f64().unwrap();
        assert!((found - height).abs() < 1.0, "{found} mm instead of {height}");
    }
}

#[test]
fn a_demand_that_no_mount_meets_is_told_with_what_is_missing() {
    let directory = tempfile::tempdir().unwrap();
    let output = nearfield(directory.path(), "twin study --zone 2900 --distance 400 --out study");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stdout).unwrap().contains("of 2900 mm of the zone"));
    let output = nearfield(directory.path(), "twin study --object 3 --out study");
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(String::from_utf8(output.stderr).unwrap().contains("5 to 200 mm"));
}
