//! `nearfield run` and its neighbours as a person calls them.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Output};

fn nearfield(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_nearfield")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A folder with a configuration for the twin and a rig of small pictures.
fn robot(configuration: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let rig = nearfield_host::twin::gallery::CENTRE.with_width(576).rig().unwrap();
    std::fs::write(folder.path().join("rig.toml"), nearfield_host::rig_file::to_toml(&rig)).unwrap();
    std::fs::write(folder.path().join("nearfield.toml"), configuration).unwrap();
    folder
}

fn file(folder: &Path) -> String {
    folder.join("nearfield.toml").display().to_string()
}

const SMALL: &str = "[camera]\nwidth = 576\nheight = 324\n";

#[test]
fn over_clean_floor_the_robot_is_let_go_and_the_end_is_summed_up() {
    let folder = robot(SMALL);
    let output = nearfield(&["run", "--config", &file(folder.path()), "--seconds", "3", "--fast", "--json"]);
    let lines = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{lines}{}", text(&output.stderr));
    let lines: Vec<serde_json::Value> =
        lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let (sum, changes) = lines.split_last().unwrap();
    assert_eq!((&sum["pictures"], &sum["lost"], &sum["missing"]), (&150.into(), &0.into(), &0.into()));
    assert!(sum["latency_ms"]["p50"].as_f64().unwrap() > 0.0);
    assert_eq!(changes.first().unwrap()["relay"], "open");
    assert_eq!(changes.last().unwrap()["relay"], "closed", "{changes:?}");
}

#[test]
fn something_on_the_stripe_keeps_the_relay_open_and_is_named() {
    let folder = robot(&format!("{SMALL}input = \"box_75_glossy\"\n"));
    let output = nearfield(&["run", "--config", &file(folder.path()), "--seconds", "2", "--fast", "--json"]);
    let lines = text(&output.stdout);
    assert!(!lines.contains("\"relay\":\"closed\"") && lines.contains("stripe_cut"), "{lines}");
}

#[test]
fn mistakes_are_named_with_what_to_do() {
    let cases = [
        ("[camera]\nwidth = 1152\nheight = 324\n", "change camera.width"),
        ("[camera]\nwidth = 576\nheight = 324\nsource = \"libcamera\"\n", "rpicam-vid"),
        ("[camera]\nwidth = 576\nheight = 324\nsource = \"replay\"\ninput = \"/no/such\"\n", "/no/such"),
        ("[camera]\nexposure_us = 0\ngain = 0\n", "2 errors"),
    ];
    for (configuration, expected) in cases {
        let folder = robot(configuration);
        let output = nearfield(&["run", "--config", &file(folder.path()), "--seconds", "1", "--fast"]);
        let told = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.starts_with("error: ") && told.contains(expected), "{told}");
    }
}

#[test]
fn the_printed_configuration_is_sound() {
    let folder = robot("");
    let printed = nearfield(&["config", "print"]);
    std::fs::write(folder.path().join("nearfield.toml"), &printed.stdout).unwrap();
    let checked = nearfield(&["config", "check", &file(folder.path())]);
    assert_eq!(checked.status.code(), Some(0), "{}", text(&checked.stderr));
    let budget = nearfield(&["budget", "--config", &file(folder.path()), "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&budget.stdout).unwrap();
    assert!(report["permitted_speed_mm_s"].as_f64().unwrap() > 0.0);
    let near = nearfield(&["budget", "--distance", "100"]);
    assert_eq!(near.status.code(), Some(1), "too near for 1 m/s");
}
