//! `nearfield commission` with the twin: what it writes, and that it fails for what must not be released.
#![allow(clippy::unwrap_used)]

mod program;

use std::path::Path;
use std::process::Output;

/// A robot whose speed the stripe's distance permits, or not.
fn robot(speed_mm_s: u32) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let rig = nearfield_host::twin::gallery::CENTRE.with_width(576).rig().unwrap();
    std::fs::write(folder.path().join("rig.toml"), nearfield_host::rig_file::to_toml(&rig)).unwrap();
    let text = format!("[camera]\nwidth = 576\nheight = 324\n[robot]\nspeed_mm_s = {speed_mm_s}\n");
    std::fs::write(folder.path().join("nearfield.toml"), text).unwrap();
    folder
}

fn commission(folder: &Path, arguments: &[&str]) -> Output {
    program::nearfield()
        .arg("commission")
        .arg("--config")
        .arg(folder.join("nearfield.toml"))
        .arg("--out")
        .arg(folder.join("out"))
        .args(arguments)
        .output()
        .unwrap()
}

fn protocol(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join("out").join(name)).unwrap()
}

#[test]
fn three_rods_are_seen_in_time_and_the_protocol_says_what_it_was_made_with() {
    let folder = robot(800);
    let output = commission(folder.path(), &["--person", "A. <Name>", "--patience", "10"]);
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{told}{}", String::from_utf8_lossy(&output.stderr));
    let markdown = protocol(folder.path(), "protocol.md");
    assert_eq!(markdown.matches("Rod of 12 mm").count(), 9, "three places, three checks each: {markdown}");
    assert!(!markdown.contains("NOT passed") && markdown.contains("Passed, in simulation."), "{markdown}");
    assert!(markdown.contains("pictures: twin; controller: simulated, in process"), "{markdown}");
    assert!(protocol(folder.path(), "protocol.html").contains("A. &lt;Name&gt;"));
}

/// The rest of the protocol is made all the same: a person wants to know everything that is wrong.
#[test]
fn a_robot_that_is_too_fast_or_a_rod_that_is_too_thin_is_not_passed() {
    let folder = robot(3000);
    let output = commission(folder.path(), &["--piece", "5", "--patience", "3"]);
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    let markdown = protocol(folder.path(), "protocol.md");
    let failed: Vec<&str> = markdown.lines().filter(|line| line.ends_with("**NOT passed** |")).collect();
    for name in ["| Smallest thing that is surely seen |", "| Stopping distance |", "| Speed |"] {
        assert!(failed.iter().any(|line| line.starts_with(name)), "{name}: {markdown}");
    }
    assert!(markdown.contains("The robot must not be released") && markdown.contains("Rod of 5 mm, far end"));
    let refused = commission(folder.path(), &["--piece", "4"]);
    assert_eq!(refused.status.code(), Some(2));
}
