//! The commands `nearfield detect` and `nearfield evaluate` as a program sees them.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

mod program;

use std::path::{Path, PathBuf};
use std::process::Output;

fn nearfield(arguments: &[&str]) -> Output {
    program::nearfield().args(arguments).output().unwrap()
}

fn lines(output: &Output) -> Vec<serde_json::Value> {
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn grey(directory: &Path, name: &str) -> PathBuf {
    let path = directory.join(name);
    image::RgbImage::from_pixel(200, 150, image::Rgb([120; 3])).save(&path).unwrap();
    path
}

#[test]
fn what_cannot_be_used_is_named_and_the_others_are_still_reported() {
    let directory = tempfile::tempdir().unwrap();
    let (good, broken) = (grey(directory.path(), "good.png"), directory.path().join("broken.png"));
    std::fs::write(&broken, "no picture").unwrap();
    let missing = directory.path().join("missing.png");
    let paths = [&missing, &broken, &good].map(|path| path.display().to_string());
    let output = nearfield(&["detect", "--json", &paths[0], &paths[1], &paths[2]]);
    assert_eq!(output.status.code(), Some(2));
    let reports = lines(&output);
    assert_eq!(reports.len(), 3);
    for (report, path) in reports.iter().zip(&paths) {
        assert_eq!(report["image"], path.as_str());
    }
    assert!(reports[0]["unknown"].as_str().unwrap().contains("missing.png"));
    assert!(reports[1]["objects"].is_null() && reports[1]["unknown"].is_string());
    assert!(reports[2]["objects"].is_array() && reports[2]["unknown"].is_null());
}

#[test]
fn drawings_of_pictures_with_one_name_do_not_overwrite_each_other() {
    let directory = tempfile::tempdir().unwrap();
    let other = directory.path().join("other");
    std::fs::create_dir(&other).unwrap();
    let (one, two) = (grey(directory.path(), "a.png"), grey(&other, "a.png"));
    let (one, two) = (one.display().to_string(), two.display().to_string());
    let drawings = directory.path().join("drawings");
    let output = nearfield(&["detect", "--annotate", &drawings.display().to_string(), &one, &two]);
    assert!(output.status.success());
    assert!(drawings.join("a.png").is_file() && drawings.join("a-2.png").is_file());
}

/// A COCO folder with one picture: a bolt, a hand by another name, and something that nobody knows.
fn dataset(folder: &Path) {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    grey(&folder.join("images"), "one.png");
    let text = r#"{"images": [{"id": 5, "file_name": "one.png"}],
        "categories": [{"id": 1, "name": "Bolt"}, {"id": 2, "name": "Allen Key"}, {"id": 3, "name": "teapot"}],
        "annotations": [
            {"id": 1, "image_id": 5, "category_id": 1, "bbox": [10, 10, 30, 20]},
            {"id": 2, "image_id": 5, "category_id": 3, "bbox": [50, 10, 30, 20]}]}"#;
    std::fs::write(folder.join("annotations.json"), text).unwrap();
}

#[test]
fn detections_from_a_file_are_judged_and_unknown_names_are_listed() {
    let directory = tempfile::tempdir().unwrap();
    dataset(directory.path());
    let found = directory.path().join("found.json");
    std::fs::write(&found, r#"[{"image_id": 5, "category_id": 1, "bbox": [10, 10, 30, 20], "score": 0.99}]"#)
        .unwrap();
    let folder = directory.path().display().to_string();
    let output = nearfield(&[
        "evaluate",
        "--json",
        "--dataset",
        &folder,
        "--detections",
        &found.display().to_string(),
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report = &lines(&output)[0][0];
    assert!((report["coco"]["ap"].as_f64().unwrap() - 1.0).abs() < 1e-9);
    assert_eq!(report["left_out"][0][0], "teapot");
    let names: Vec<&str> =
        report["classes"].as_array().unwrap().iter().map(|class| class["class"].as_str().unwrap()).collect();
    assert_eq!(names, ["bolt", "allen_key"]);
}

#[test]
fn a_folder_of_parts_gives_a_report_for_each_and_a_page() {
    let directory = tempfile::tempdir().unwrap();
    for part in ["test", "val"] {
        dataset(&directory.path().join("data").join(part));
    }
    let folder = directory.path().join("data").display().to_string();
    let page = directory.path().join("page");
    let output =
        nearfield(&["evaluate", "--json", "--dataset", &folder, "--html", &page.display().to_string()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let parts: Vec<String> = lines(&output)[0]
        .as_array()
        .unwrap()
        .iter()
        .map(|part| part["part"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(parts, ["test", "val"]);
    let text = std::fs::read_to_string(page.join("index.html")).unwrap();
    assert!(text.contains("teapot") && text.contains("<svg") && page.join("val-00.jpg").is_file());
}

#[test]
fn a_folder_that_is_no_dataset_is_refused_with_what_to_do() {
    let directory = tempfile::tempdir().unwrap();
    let output = nearfield(&["evaluate", "--dataset", &directory.path().display().to_string()]);
    assert_eq!(output.status.code(), Some(2));
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(error.contains("annotations.json") && error.contains("images/"), "{error}");
}
