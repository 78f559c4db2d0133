//! The program killed at random moments: no recording may be lost by that.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::robot::{SMALL, file, nearfield, newest, recordings, replayed, robot, start, text};

/// A number that a person may give.
fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
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
