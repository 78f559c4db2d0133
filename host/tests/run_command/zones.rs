//! Zones and cases in force, and what they make of things on the stripe.

use std::process::Command;
use std::time::Duration;

use crate::robot::{
    SMALL, decisions, file, nearfield, recordings, replayed, robot, start, text, wait_for_bytes,
};

/// Two zones; the fast case protects both, the slow one only A.
const ZONES: &str = "\
[[zone]]\nname = \"A\"\nstart_mm = -250\nend_mm = 0\n\
[[zone]]\nname = \"B\"\nstart_mm = 0\nend_mm = 250\n\
[[case]]\nup_to_mm_s = 300\nprotective = [\"A\"]\n\
[[case]]\nup_to_mm_s = 1000\nprotective = [\"A\", \"B\"]\n";

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
