//! Bad input ends in a clear error (file, field, what to do) and exit code 2, never in a panic, and what is good beside
//! it is still reported.
#![allow(clippy::unwrap_used)]

mod program;

use std::path::{Path, PathBuf};
use std::process::Output;

fn pictures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/pictures")
}

fn rig() -> PathBuf {
    pictures().join("rigs/t1_side_std.toml")
}

/// A directory of this test's own, removed at its end.
struct Scratch(PathBuf);

impl Scratch {
    fn new(test: &str) -> Self {
        let path = std::env::temp_dir().join(format!("nearfield-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, content).unwrap();
        path
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn nearfield(arguments: &[&Path]) -> Output {
    program::nearfield().args(arguments).output().unwrap()
}

fn inspect(rig: &Path, image: &Path) -> Output {
    nearfield(&[Path::new("inspect"), Path::new("--json"), Path::new("--rig"), rig, image])
}

/// Exit code 2, the words on standard error, no panic.
#[track_caller]
fn refused(output: &Output, words: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(!error.contains("panicked"), "{error}");
    for word in words {
        assert!(error.contains(word), "{word:?} is missing in: {error}");
    }
}

#[test]
fn pictures_that_are_none_are_refused_by_name() {
    let scratch = Scratch::new("pictures");
    let good = std::fs::read(pictures().join("cut_wrench.png")).unwrap();
    for (name, content) in [
        ("empty.png", Vec::new()),
        ("text.png", b"this is no picture".to_vec()),
        ("half.png", good[..good.len() / 2].to_vec()),
        ("header.png", good[..40].to_vec()),
        ("text.jpg", b"\xFF\xD8\xFF\xE0 no more".to_vec()),
        ("short.yuv", vec![16; 1000]),
        ("short.nv12", vec![16; 1000]),
        ("picture.gif", b"GIF89a".to_vec()),
    ] {
        refused(&inspect(&rig(), &scratch.file(name, content)), &[name]);
    }
    refused(&inspect(&rig(), &scratch.0.join("not-there.png")), &["not-there.png"]);
    refused(&inspect(&rig(), &scratch.0), &[]);
}

#[test]
fn a_picture_of_another_size_than_the_rigs_is_refused_with_both_sizes() {
    let scratch = Scratch::new("sizes");
    let mut tiny = Vec::new();
    image::RgbImage::new(64, 48)
        .write_to(&mut std::io::Cursor::new(&mut tiny), image::ImageFormat::Png)
        .unwrap();
    let output = inspect(&rig(), &scratch.file("tiny.png", tiny));
    refused(&output, &["tiny.png", "64", "48"]);
}

#[test]
fn a_good_picture_beside_a_bad_one_is_still_reported() {
    let scratch = Scratch::new("beside");
    let bad = scratch.file("bad.png", "no picture");
    let good = pictures().join("cut_wrench.png");
    let output =
        nearfield(&[Path::new("inspect"), Path::new("--json"), Path::new("--rig"), &rig(), &bad, &good]);
    refused(&output, &["bad.png"]);
    let lines = String::from_utf8(output.stdout).unwrap();
    let report: serde_json::Value = serde_json::from_str(lines.trim()).unwrap();
    assert!(report["image"].as_str().unwrap().ends_with("cut_wrench.png"));
    assert_eq!(report["mcu"]["relay"], "open");
}

#[test]
fn a_picture_without_a_stripe_opens_the_relay() {
    let output = inspect(&rig(), &pictures().join("laser_off.png"));
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["stripe_found"], &report["cutoff"]), (&false.into(), &true.into()));
    assert_eq!(report["mcu"]["relay"], "open");
}

#[test]
fn a_rig_that_cannot_be_is_refused_by_file_and_field() {
    let scratch = Scratch::new("rigs");
    let good = std::fs::read_to_string(rig()).unwrap();
    let picture = pictures().join("cut_wrench.png");
    let line = |name: &str| {
        good.lines().find(|line| line.trim_start().starts_with(name)).unwrap_or_else(|| panic!("no {name}"))
    };
    let changed = |name: &str, value: &str| good.replacen(line(name), &format!("{name} = {value}"), 1);
    let without = |name: &str| good.replacen(line(name), "", 1);
    for (text, words) in [
        (String::new(), vec!["image"]),
        ("this is [no toml".to_owned(), vec![]),
        (without("fx"), vec!["camera.fx"]),
        (without("plane_offset_mm"), vec!["laser.plane_offset_mm"]),
        (changed("fx", "nan"), vec!["camera.fx"]),
        (changed("fx", "\"wide\""), vec!["camera.fx"]),
        (changed("fy", "-1.0"), vec!["camera.fy"]),
        (changed("width", "0"), vec!["image.width"]),
        (changed("width", "99999"), vec!["image.width"]),
        (changed("distortion", "[0.0, 0.0]"), vec!["camera.distortion"]),
        (good.replacen("0.838670568", "0.9", 1), vec!["camera.rotation"]),
        (changed("plane_normal", "[0.0, 0.0, 0.0]"), vec!["laser.plane_normal"]),
        (changed("plane_offset_mm", "500.0"), vec!["laser.plane_offset_mm"]),
        (changed("origin_mm", "[0.0, 0.0, inf]"), vec!["laser.origin_mm"]),
        (changed("end_mm", "-9000.0"), vec!["stripe.end_mm"]),
        (changed("direction", "[0.0, 0.0, 1.0]"), vec!["stripe"]),
        (format!("{good}\n[surprise]\nfield = 1\n"), vec!["surprise"]),
    ] {
        let file = scratch.file("rig.toml", &text);
        let mut expected = vec!["rig.toml"];
        expected.extend(words);
        refused(&inspect(&file, &picture), &expected);
        refused(&nearfield(&[Path::new("rig"), Path::new("check"), &file]), &expected);
    }
    refused(&inspect(&scratch.0.join("missing.toml"), &picture), &["missing.toml"]);
}

#[test]
fn arguments_that_make_no_sense_are_refused() {
    for arguments in [
        &["inspect"][..],
        &["inspect", "--rig"],
        &["replay", "--fps", "fast"],
        &["no-such-command"],
        &["inspect", "--rig", "a.toml", "--mcu", "guess", "b.png"],
    ] {
        let paths: Vec<&Path> = arguments.iter().map(Path::new).collect();
        refused(&nearfield(&paths), &[]);
    }
    let scratch = Scratch::new("arguments");
    let (word, rig) = (Path::new("replay"), rig());
    refused(&nearfield(&[word, Path::new("--rig"), &rig, &scratch.0]), &[]);
    refused(
        &nearfield(&[word, Path::new("--fps"), Path::new("0"), Path::new("--rig"), &rig, &pictures()]),
        &["fps"],
    );
}

/// `nearfield ... | head -1`: the reader goes away in the middle.
#[test]
fn a_reader_that_goes_away_is_no_panic() {
    use std::io::Read as _;
    let mut child = program::nearfield()
        .args(["evaluate-scenes", "--json"])
        .arg(pictures())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = [0];
    let mut stdout = child.stdout.take().unwrap();
    stdout.read_exact(&mut first).unwrap();
    drop(stdout);
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!error.contains("panicked") && output.status.success(), "{:?}: {error}", output.status);
}
