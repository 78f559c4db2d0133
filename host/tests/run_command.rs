//! `nearfield run` and its neighbours as a person calls them.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

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

/// Small pictures, and a page on a port that nobody else has.
const SMALL: &str = "[page]\nlisten = \"127.0.0.1:0\"\n[camera]\nwidth = 576\nheight = 324\n";

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

/// Starts a run that records, without waiting for its end.
fn start(folder: &Path, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_nearfield"))
        .args(["run", "--config", &file(folder), "--record", &recordings(folder)])
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn recordings(folder: &Path) -> String {
    folder.join("recordings").display().to_string()
}

/// The JSON lines of `nearfield replay`, and its exit code.
fn replayed(path: &str) -> (Option<i32>, Vec<serde_json::Value>) {
    let output = nearfield(&["replay", path, "--json"]);
    let lines = text(&output.stdout);
    let lines = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    (output.status.code(), lines)
}

/// Waits until the recorder has written so much; a loaded machine needs its time.
fn wait_for_bytes(folder: &Path, bytes: u64) {
    let begun = Instant::now();
    let written = || -> u64 {
        let Ok(entries) = std::fs::read_dir(folder.join("recordings")) else { return 0 };
        entries.filter_map(|entry| Some(entry.ok()?.metadata().ok()?.len())).sum()
    };
    while written() < bytes {
        assert!(begun.elapsed() < Duration::from_secs(300), "nothing is recorded");
        std::thread::sleep(Duration::from_millis(5));
    }
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

/// A number that a person may give.
fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// The newest file of the recordings.
fn newest(folder: &Path) -> Option<String> {
    let entries = std::fs::read_dir(folder.join("recordings")).ok()?;
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    Some(paths.last()?.display().to_string())
}

/// Waits until a run has begun its recording, or for so long.
fn wait_for_another(folder: &Path, before: Option<&String>, longest: Duration) {
    let begun = Instant::now();
    while newest(folder).as_ref() == before && begun.elapsed() < longest {
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Runs killed at random moments, one after the other, into the same folder. Each recording is replayed as its death left it, and
/// all of them at the end, when later starts have completed them.
fn killed(kills: u64, seed: u64) {
    println!("{kills} kills, seed {seed}");
    let folder = robot(SMALL);
    let mut state = seed;
    let (mut cut_off, mut replies) = (0, 0);
    for kill in 1..=kills {
        let before = newest(folder.path());
        let mut child = start(folder.path(), &["--no-page"]);
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        // One in eight while it starts; the others from before the first chunk is out to some chunks later.
        if kill % 8 != 0 {
            wait_for_another(folder.path(), before.as_ref(), Duration::from_secs(60));
        }
        let wait = Duration::from_millis((state >> 33) % 3000);
        std::thread::sleep(wait);
        child.kill().unwrap();
        child.wait().unwrap();
        let Some(left) = newest(folder.path()).filter(|path| Some(path) != before.as_ref()) else { continue };
        let output = nearfield(&["replay", &left, "--json"]);
        // Nothing may be whole in it yet; that is said, and is no difference.
        let empty = text(&output.stderr).contains("breaks off before anything was recorded");
        let lines = text(&output.stdout);
        let told: Vec<serde_json::Value> =
            lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let sound = told.iter().all(|line| line["same"] == true || line["replies"] == 0);
        assert!(
            sound && (empty || !told.is_empty()),
            "kill {kill} after {wait:?}: {lines}{}",
            text(&output.stderr)
        );
        cut_off += told.iter().map(|line| line["cut_off"].as_u64().unwrap()).sum::<u64>();
        replies += told.iter().map(|line| line["replies"].as_u64().unwrap()).sum::<u64>();
        if kill % 20 == 0 {
            println!(
                "  {kill} killed, {cut_off} recordings cut off, {replies} replies asked again, all the same"
            );
        }
    }
    // One more start completes the last one; nothing is lost by that.
    nearfield(&[
        "run",
        "--config",
        &file(folder.path()),
        "--record",
        &recordings(folder.path()),
        "--no-page",
        "--seconds",
        "1",
    ]);
    let (_, lines) = replayed(&recordings(folder.path()));
    let different: Vec<_> =
        lines.iter().filter(|line| line["same"] != true && line["replies"] != 0).collect();
    assert!(different.is_empty(), "{different:?}");
    assert!(lines.iter().all(|line| line["cut_off"] == 0), "all were completed: {lines:?}");
    let decided = lines.iter().filter(|line| line["replies"].as_u64().unwrap() > 0).count();
    let again: u64 = lines.iter().map(|line| line["replies"].as_u64().unwrap()).sum();
    assert!(
        decided > 1 && again >= replies,
        "{decided} with decisions, {replies} replies before, {again} now"
    );
    println!(
        "{kills} kills: {cut_off} recordings cut off, {} of {} runs with decisions; as the kill left them {replies} replies, \
         completed {again} replies, all the same",
        decided - 1,
        lines.len() - 1
    );
}

#[test]
fn recordings_survive_being_killed() {
    killed(4, 20);
}

/// `cargo xtask kills`
#[test]
#[ignore = "ten minutes"]
fn recordings_survive_being_killed_two_hundred_times() {
    killed(number("NEARFIELD_KILLS", 200), number("NEARFIELD_KILLS_SEED", 6));
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

/// Two zones; the fast case protects both, the slow one only A.
const ZONES: &str = "\
[[zone]]\nname = \"A\"\nstart_mm = -250\nend_mm = 0\n\
[[zone]]\nname = \"B\"\nstart_mm = 0\nend_mm = 250\n\
[[case]]\nup_to_mm_s = 300\nprotective = [\"A\"]\n\
[[case]]\nup_to_mm_s = 1000\nprotective = [\"A\", \"B\"]\n";

/// Every decision of all recordings, in order.
fn decisions(folder: &Path) -> Vec<nearfield_recording::messages::DecisionMessage> {
    let mut paths: Vec<_> =
        std::fs::read_dir(folder.join("recordings")).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let mut decisions = Vec::new();
    for path in paths {
        let recording = nearfield_recording::Recording::open(&path).unwrap();
        for (_, record) in recording.records() {
            if let nearfield_recording::reader::Record::Decision(decision) = record {
                decisions.push(decision.clone());
            }
        }
    }
    decisions
}

#[test]
fn the_robots_speed_selects_the_case_and_its_silence_selects_all() {
    // A port that is free now.
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let speed = format!("[speed]\nsource = \"udp\"\nlisten = \"127.0.0.1:{port}\"\nlongest_age_ms = 300\n");
    let folder = robot(&format!("{SMALL}source = \"twin-loop\"\n{speed}{ZONES}"));
    let mut child = start(folder.path(), &["--no-page"]);
    wait_for_bytes(folder.path(), 20_000);
    let robot = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    for _ in 0..200 {
        robot.send_to(b"200", ("127.0.0.1", port)).unwrap();
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_secs(2));
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let told = decisions(folder.path());
    let roles = |decision: &nearfield_recording::messages::DecisionMessage| -> String {
        decision.zones.iter().map(|zone| format!("{} {}, ", zone.name, zone.role)).collect()
    };
    let (slow, unknown): (Vec<_>, Vec<_>) = told.iter().partition(|decision| decision.speed_mm_s.is_some());
    assert!(!slow.is_empty() && !unknown.is_empty(), "{} slow, {} unknown", slow.len(), unknown.len());
    for decision in slow {
        let seen = (decision.speed_mm_s, decision.case, roles(decision));
        assert_eq!(seen, (Some(200.0), Some(1), "A protective, B named, ".to_owned()));
    }
    for decision in unknown {
        assert_eq!((decision.case, roles(decision)), (None, "A protective, B protective, ".to_owned()));
    }
    assert!(told.last().unwrap().speed_mm_s.is_none(), "a silent robot's speed is not known");
}

#[test]
fn a_zone_says_where_the_stripe_is_cut_and_one_beyond_it_is_refused() {
    let zones = "[[zone]]\nname = \"C\"\nstart_mm = -280\nend_mm = -240\n[[zone]]\nname = \"D\"\nstart_mm = -60\nend_mm = 60\n";
    let folder = robot(&format!("{SMALL}input = \"box_45\"\n{zones}"));
    let arguments = ["run", "--config", &file(folder.path()), "--seconds", "1", "--fast", "--no-page"];
    let run = nearfield(&[&arguments[..], &["--record", &recordings(folder.path())]].concat());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let told = decisions(folder.path());
    let last = told.last().unwrap();
    let findings: Vec<_> = last.zones.iter().map(|zone| (zone.name, zone.finding.as_str())).collect();
    assert_eq!(findings, [('C', "free"), ('D', "infringed")]);
    assert_eq!((last.verdict.as_str(), last.advice.as_deref()), ("stop", Some("stop_and_warn")));
    let beyond = robot(&format!("{SMALL}{}", zones.replace("-280", "-2800")));
    let run = nearfield(&["run", "--config", &file(beyond.path()), "--seconds", "1", "--fast"]);
    assert_eq!(run.status.code(), Some(2));
    assert!(text(&run.stderr).contains("zone C reaches from -2800"), "{}", text(&run.stderr));
    let checked = nearfield(&["config", "check", &file(beyond.path())]);
    assert_eq!(checked.status.code(), Some(2));
}

#[test]
fn something_that_comes_and_goes_is_a_stop_with_its_zone_and_the_robot_may_go_on_after_the_button() {
    let scene = "[[objects]]\nname = \"box\"\nmaterial = \"cardboard\"\nacross_mm = 420.0\n\
                 velocity_mm_per_s = [0.0, -150.0]\n\
                 shape = { kind = \"box\", width_mm = 120.0, depth_mm = 60.0, height_mm = 45.0 }\n";
    let zone = "[[zone]]\nname = \"E\"\nstart_mm = -100\nend_mm = 100\n";
    let folder = robot("");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, scene).unwrap();
    let configuration = format!("{SMALL}input = \"{}\"\n{zone}", path.display());
    std::fs::write(folder.path().join("nearfield.toml"), configuration).unwrap();
    let arguments = ["run", "--config", &file(folder.path()), "--seconds", "7", "--fast", "--no-page"];
    let run = nearfield(&[&arguments[..], &["--record", &recordings(folder.path())]].concat());
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let told = decisions(folder.path());
    let closed: Vec<bool> = told.iter().map(|decision| decision.relay == "closed").collect();
    let changes = closed.windows(2).filter(|two| two[0] != two[1]).count();
    assert_eq!((changes, closed.last()), (3, Some(&true)), "closed, opened for the box, closed again");
    let stop = closed.windows(2).position(|two| two[0] && !two[1]).unwrap() + 1;
    assert_eq!(told[stop].zones[0].finding, "infringed", "{:?}", told[stop]);
    // Recorded in full: the controller decides all of it again.
    let (code, lines) = replayed(&recordings(folder.path()));
    assert_eq!(
        (code, &lines[0]["same"], &lines[0]["stops"]),
        (Some(0), &true.into(), &1.into()),
        "{lines:?}"
    );
}
