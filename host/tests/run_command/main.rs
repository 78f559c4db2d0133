//! `nearfield run` and its neighbours as a person calls them.
#![allow(clippy::unwrap_used)]

mod kills;
#[path = "../program/mod.rs"]
mod program;
mod robot;
mod zones;

use std::path::Path;
use std::process::Command;

use robot::{SMALL, file, nearfield, newest, recordings, replayed, robot, start, text, wait_for_bytes};

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

/// Two commands, and it runs: the defaults need no rig file, and name what they take instead.
#[test]
fn the_printed_defaults_run_in_an_empty_folder() {
    let folder = tempfile::tempdir().unwrap();
    let printed = nearfield(&["config", "print"]);
    // The defaults' port may be another run's.
    let defaults = text(&printed.stdout).replace("127.0.0.1:8033", "127.0.0.1:0");
    std::fs::write(folder.path().join("nearfield.toml"), defaults).unwrap();
    let checked = nearfield(&["config", "check", &file(folder.path())]);
    assert!(text(&checked.stdout).contains("the twin's own rig"), "{}", text(&checked.stderr));
    let run = nearfield(&["run", "--config", &file(folder.path()), "--seconds", "3", "--fast", "--json"]);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    assert!(text(&run.stderr).contains("the twin's own rig"));
    assert!(text(&run.stdout).contains("\"relay\":\"closed\""), "{}", text(&run.stdout));
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

#[test]
fn a_recorded_run_is_decided_again_bit_for_bit_with_its_stop() {
    let folder = robot(&format!("{SMALL}input = \"box_45\"\n"));
    let run = nearfield(&[
        "run",
        "--config",
        &file(folder.path()),
        "--seconds",
        "2",
        "--record",
        &recordings(folder.path()),
    ]);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let (code, lines) = replayed(&recordings(folder.path()));
    assert_eq!(code, Some(0), "{lines:?}");
    let told = &lines[0];
    assert_eq!((&told["same"], &told["cut_off"], &told["unasked"]), (&true.into(), &0.into(), &0.into()));
    let recording = nearfield_recording::Recording::open(Path::new(&newest(folder.path()).unwrap())).unwrap();
    for (_, record) in recording.records() {
        if let nearfield_recording::reader::Record::Status(bytes) = record {
            let status = nearfield_shared::status::Status::parse(bytes).unwrap();
            assert_eq!(status.refused, [0; 8], "from the first line-scan on all are accepted");
        }
    }
    // 100 exchanges, 400 ticks, and the first exchange and power-up.
    assert!(told["replies"].as_u64().unwrap() >= 500, "{told}");
    assert!(told["statuses"].as_u64().unwrap() >= 90, "{told}");
}

#[test]
fn a_recording_that_was_tampered_with_is_not_the_same() {
    let folder = robot(SMALL);
    let arguments = ["run", "--config", &file(folder.path()), "--seconds", "1", "--no-page"];
    nearfield(&[&arguments[..], &["--record", &recordings(folder.path())]].concat());
    let entry = std::fs::read_dir(folder.path().join("recordings")).unwrap().next().unwrap().unwrap().path();
    let recording = nearfield_recording::Recording::open(&entry).unwrap();
    let same = nearfield_host::run::redecide::redecide([&recording]).unwrap();
    assert!(same.is_same() && same.replies > 200, "{same:?}");
    // One bit of one line-scan, told as it would have been had the host sent it so: found twice.
    let changed = nearfield_recording::Recording::of(
        recording.records().iter().map(|(time, record)| (*time, record.clone())).map(|(time, record)| {
            match record {
                nearfield_recording::reader::Record::LineScan(mut bytes) if bytes[12] == 40 => {
                    bytes[2000] ^= 1;
                    (time, nearfield_recording::reader::Record::LineScan(bytes))
                }
                record => (time, record),
            }
        }),
    );
    let different = nearfield_host::run::redecide::redecide([&changed]).unwrap();
    assert!(different.different_replies > 0, "{different:?}");
}

#[cfg(unix)]
#[test]
fn a_termination_signal_ends_the_run_and_its_recording_cleanly() {
    let folder = robot(SMALL);
    let mut child = start(folder.path(), &[]);
    wait_for_bytes(folder.path(), 100_000);
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let (code, lines) = replayed(&recordings(folder.path()));
    assert_eq!((code, &lines[0]["cut_off"]), (Some(0), &0.into()), "{lines:?}");
}

#[cfg(unix)]
#[test]
fn a_source_that_dies_is_opened_again_and_the_controller_stops_meanwhile() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = robot("");
    let script = folder.path().join("camera");
    // Twenty black pictures, then it dies.
    std::fs::write(
        &script,
        "#!/bin/sh\nfor i in 1 2 3 4 5 6 7 8 9 10; do head -c 279936 /dev/zero; sleep 0.02; done\n",
    )
    .unwrap();
    std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
    let configuration = format!("{SMALL}source = \"command\"\ninput = \"{}\"\n", script.display());
    std::fs::write(folder.path().join("nearfield.toml"), configuration).unwrap();
    let output =
        nearfield(&["run", "--config", &file(folder.path()), "--seconds", "4", "--json", "--no-page"]);
    let (lines, warnings) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(0), "{warnings}");
    let sum: serde_json::Value = serde_json::from_str(lines.lines().last().unwrap()).unwrap();
    assert!(sum["restarts"].as_u64().unwrap() >= 2, "{sum}");
    assert!(sum["missing"].as_u64().unwrap() >= 10, "nothing is sent a second time: {sum}");
    assert!(warnings.contains("the camera's program has ended"), "{warnings}");
    assert!(lines.contains("link_timeout"), "the controller hears nothing meanwhile: {lines}");
}

#[test]
fn the_doctor_looks_at_this_computer() {
    let output = nearfield(&["doctor", "--json"]);
    let rows: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
    let sound = rows.iter().all(|row| row["verdict"] == "sound" || row["verdict"] == "warning");
    assert_eq!(output.status.code(), Some(i32::from(!sound)));
    assert!(rows.iter().all(|row| !row["name"].as_str().unwrap().is_empty()));
}

/// Without its rig the service does not start: the doctor says so before.
#[test]
fn the_doctor_misses_the_rig_that_a_configuration_names() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("nearfield.toml");
    std::fs::write(&file, "rig = \"robot.toml\"\n").unwrap();
    let output = nearfield(&["doctor", "--json", "--config", file.to_str().unwrap()]);
    let rows: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
    let rig = rows.iter().find(|row| row["name"] == "rig").unwrap();
    assert_eq!(rig["verdict"], "problem");
    assert!(rig["found"].as_str().unwrap().contains("robot.toml"), "{rig}");
    assert_eq!(output.status.code(), Some(1));
}
