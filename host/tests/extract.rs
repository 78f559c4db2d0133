//! The command `nearfield extract` as a program sees it.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

mod program;

use std::path::{Path, PathBuf};
use std::process::Output;

/// A grey picture with a red line of light from side to side.
fn picture(directory: &Path) -> PathBuf {
    let picture = image::RgbImage::from_fn(200, 120, |column, row| {
        let distance = row as f32 - 50.0 - column as f32 / 20.0;
        let light = 90.0 * (-distance * distance / 6.0).exp();
        let ground = 70 + (column * 7 + row * 13) % 5;
        image::Rgb([(ground as f32 + light) as u8, ground as u8, ground as u8])
    });
    let path = directory.join("lit.png");
    picture.save(&path).unwrap();
    path
}

fn extract(arguments: &[&Path]) -> Output {
    program::nearfield().args(["extract", "--json"]).args(arguments).output().unwrap()
}

#[test]
fn one_json_object_a_picture_with_three_lists_of_one_length() {
    let directory = tempfile::tempdir().unwrap();
    let lit = picture(directory.path());
    let drawings = directory.path().join("drawings");
    let output = extract(&[Path::new("--annotate"), &drawings, &lit]);
    assert!(output.status.success(), "{output:?}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["image"], lit.display().to_string());
    assert_eq!(report["stripe_found"], true);
    let lists = ["columns", "rows", "confidence"].map(|name| report[name].as_array().unwrap().clone());
    assert!(lists[0].len() >= 180 && lists.iter().all(|list| list.len() == lists[0].len()));
    for (column, row) in lists[0].iter().zip(&lists[1]) {
        let truth = 50.0 + column.as_f64().unwrap() / 20.0;
        assert!((row.as_f64().unwrap() - truth).abs() < 0.5, "column {column}: row {row}, true {truth}");
    }
    assert!(drawings.join("lit.png").is_file());
}

/// A picture that cannot be used is named with the remedy, and costs the others nothing.
#[test]
fn bad_pictures_are_told_and_the_others_still_reported() {
    let directory = tempfile::tempdir().unwrap();
    let lit = picture(directory.path());
    let cut = directory.path().join("cut.png");
    std::fs::write(&cut, &std::fs::read(&lit).unwrap()[..300]).unwrap();
    let raw = directory.path().join("frame.nv12");
    std::fs::write(&raw, [128; 96]).unwrap();
    let missing = directory.path().join("missing.png");
    let output = extract(&[&cut, &raw, &missing, &lit]);
    assert_eq!(output.status.code(), Some(2));
    let errors = String::from_utf8(output.stderr).unwrap();
    for words in ["cut.png", "damaged", "frame.nv12", "--size", "missing.png", "cannot read"] {
        assert!(errors.contains(words), "`{words}` is not in: {errors}");
    }
    let lines = String::from_utf8(output.stdout).unwrap();
    assert!(lines.lines().count() == 1 && lines.contains("\"stripe_found\":true"), "{lines}");
}
