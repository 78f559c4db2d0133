//! A robot in a folder: configuration, rig, recordings, and the program that works with them.

use std::path::Path;
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use crate::program;

pub fn nearfield(arguments: &[&str]) -> Output {
    program::nearfield().args(arguments).output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A folder with a configuration for the twin and a rig of small pictures.
pub fn robot(configuration: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let rig = nearfield_host::twin::gallery::CENTRE.with_width(576).rig().unwrap();
    std::fs::write(folder.path().join("rig.toml"), nearfield_host::rig_file::to_toml(&rig)).unwrap();
    std::fs::write(folder.path().join("nearfield.toml"), configuration).unwrap();
    folder
}

pub fn file(folder: &Path) -> String {
    folder.join("nearfield.toml").display().to_string()
}

/// Small pictures, and a page on a port that nobody else has.
pub const SMALL: &str = "[page]\nlisten = \"127.0.0.1:0\"\n[camera]\nwidth = 576\nheight = 324\n";

/// Starts a run that records, without waiting for its end.
pub fn start(folder: &Path, arguments: &[&str]) -> Child {
    program::nearfield()
        .args(["run", "--config", &file(folder), "--record", &recordings(folder)])
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

pub fn recordings(folder: &Path) -> String {
    folder.join("recordings").display().to_string()
}

/// The JSON lines of `nearfield replay`, and its exit code.
pub fn replayed(path: &str) -> (Option<i32>, Vec<serde_json::Value>) {
    let output = nearfield(&["replay", path, "--json"]);
    let lines = text(&output.stdout);
    let lines = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    (output.status.code(), lines)
}

/// Waits until the recorder has written so much; a loaded machine needs its time.
pub fn wait_for_bytes(folder: &Path, bytes: u64) {
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

/// The newest file of the recordings.
pub fn newest(folder: &Path) -> Option<String> {
    let entries = std::fs::read_dir(folder.join("recordings")).ok()?;
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    Some(paths.last()?.display().to_string())
}

/// Every decision of all recordings, in order.
pub fn decisions(folder: &Path) -> Vec<nearfield_recording::messages::DecisionMessage> {
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
