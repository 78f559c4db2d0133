//! `nearfield run` for a while, with everything on, and with what disturbs it: figures, phase by phase.
//!
//! `cargo xtask soak` runs it; NEARFIELD_SOAK_SECONDS says how long a phase takes (20 without it), NEARFIELD_SOAK_PROFILE which profile
//! ("height" without it; "semantics" runs tier 3, too).
#![allow(clippy::unwrap_used)]
#![cfg(target_os = "linux")]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;

/// A run with a page, and where that is.
struct Sensor {
    child: Child,
    output: BufReader<ChildStdout>,
    address: String,
}

impl Sensor {
    fn start(folder: &Path, configuration: &str, record: &Path) -> Self {
        let rig = nearfield_host::twin::gallery::CENTRE.with_width(576).rig().unwrap();
        std::fs::write(folder.join("rig.toml"), nearfield_host::rig_file::to_toml(&rig)).unwrap();
        let config = folder.join("nearfield.toml");
        std::fs::write(&config, configuration).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_nearfield"))
            .arg("run")
            .arg("--config")
            .arg(&config)
            .arg("--record")
            .arg(record)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        output.read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("the page: http://").expect("no page").to_owned();
        Self { child, output, address }
    }

    fn status(&self) -> Value {
        let answer = get(&self.address, "/api/status").unwrap();
        let (_, body) = answer.split_once("\r\n\r\n").unwrap();
        serde_json::from_str(body).unwrap_or(Value::Null)
    }

    /// Resident memory, KiB.
    fn memory(&self) -> u64 {
        let text = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").trim().parse().unwrap()
    }

    /// Ends it as a service manager does; the last lines of its output.
    fn end(mut self) -> String {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
        let mut rest = String::new();
        self.output.read_to_string(&mut rest).unwrap();
        assert!(self.child.wait().unwrap().success());
        rest
    }
}

fn get(address: &str, path: &str) -> std::io::Result<String> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(Duration::from_secs(30)))?;
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n").as_bytes())?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

fn phase_length() -> Duration {
    let seconds = std::env::var("NEARFIELD_SOAK_SECONDS").ok().and_then(|text| text.parse().ok());
    Duration::from_secs(seconds.unwrap_or(20))
}

fn configuration(camera: &str) -> String {
    let profile = std::env::var("NEARFIELD_SOAK_PROFILE").unwrap_or_else(|_| "height".to_owned());
    format!(
        "profile = \"{profile}\"\n[page]\nlisten = \"127.0.0.1:0\"\n[camera]\nwidth = 576\nheight = 324\n{camera}"
    )
}

fn number(status: &Value, pointer: &str) -> f64 {
    status.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN)
}

/// A phase: what was lost in it, and the latency of its last thousand pictures.
fn phase(sensor: &Sensor, name: &str, disturb: impl FnOnce()) -> (f64, f64) {
    let before = sensor.status();
    let memory = sensor.memory();
    let begun = Instant::now();
    disturb();
    std::thread::sleep(phase_length().saturating_sub(begun.elapsed()));
    // A page that is being flooded turns this question away, too.
    let after = sensor.status();
    let grown = |pointer: &str| number(&after, pointer) - number(&before, pointer);
    println!(
        "{name:<22} {:>6} pictures, {} missing, {} lost, {} stops; latency p50 {:.2}, p99 {:.2}, longest {:.2} ms; \
         memory {:.1} -> {:.1} MiB; {} recorder events dropped",
        grown("/counts/pictures"),
        grown("/counts/missing"),
        grown("/counts/lost"),
        grown("/counts/stops"),
        number(&after, "/latency/p50_ms"),
        number(&after, "/latency/p99_ms"),
        number(&after, "/latency/longest_ms"),
        memory as f64 / 1024.0,
        sensor.memory() as f64 / 1024.0,
        grown("/recording/dropped"),
    );
    (grown("/counts/lost") + grown("/counts/missing"), grown("/counts/stops"))
}

/// So many clients at once, as fast as they can, for a phase; how many were answered and how many turned away.
fn flood(address: &str, clients: usize) -> (u64, u64) {
    let ending = Arc::new(AtomicBool::new(false));
    let answered = Arc::new(AtomicU64::new(0));
    let refused = Arc::new(AtomicU64::new(0));
    let threads: Vec<_> = (0..clients)
        .map(|_| {
            let (address, ending) = (address.to_owned(), Arc::clone(&ending));
            let (answered, refused) = (Arc::clone(&answered), Arc::clone(&refused));
            std::thread::spawn(move || {
                while !ending.load(Ordering::Relaxed) {
                    let served =
                        get(&address, "/api/live").is_ok_and(|answer| answer.starts_with("HTTP/1.1 200"));
                    if served { &answered } else { &refused }.fetch_add(1, Ordering::Relaxed);
                }
            })
        })
        .collect();
    std::thread::sleep(phase_length());
    ending.store(true, Ordering::Relaxed);
    for thread in threads {
        thread.join().unwrap();
    }
    (answered.load(Ordering::Relaxed), refused.load(Ordering::Relaxed))
}

#[test]
#[ignore = "minutes; see the top of the file"]
fn nothing_that_listens_disturbs_the_stripes_path() {
    let folder = tempfile::tempdir().unwrap();
    let sensor = Sensor::start(folder.path(), &configuration(""), &folder.path().join("recordings"));
    // Self-tests, arming, buffers.
    std::thread::sleep(Duration::from_secs(5));
    let (lost, stops) = phase(&sensor, "quiet", || {});
    assert_eq!((lost, stops), (0.0, 0.0));
    let (lost, stops) = phase(&sensor, "200 clients", || {
        let (answered, refused) = flood(&sensor.address, 200);
        println!("  {answered} requests answered, {refused} turned away");
    });
    assert_eq!((lost, stops), (0.0, 0.0));
    let (lost, stops) = phase(&sensor, "quiet again", || {});
    assert_eq!((lost, stops), (0.0, 0.0));
    println!("{}", sensor.end());
}

#[test]
#[ignore = "minutes; see the top of the file"]
fn a_full_disk_disturbs_nothing_but_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let disk = folder.path().join("disk");
    std::fs::create_dir(&disk).unwrap();
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=36m", "tmpfs"]).arg(&disk).status();
    if !mounted.is_ok_and(|status| status.success()) {
        println!("left out: a small disk needs the right to mount one");
        return;
    }
    let sensor = Sensor::start(folder.path(), &configuration(""), &disk);
    std::thread::sleep(Duration::from_secs(5));
    let (lost, stops) = phase(&sensor, "disk fills up", || {
        std::fs::write(disk.join("ballast"), vec![0; 64 << 20]).unwrap_err();
    });
    let status = sensor.status();
    println!("  the recording says: {}", status["recording"]["problem"]);
    let rest = sensor.end();
    assert!(Command::new("umount").arg(&disk).status().unwrap().success());
    assert_eq!((lost, stops), (0.0, 0.0), "{rest}");
    assert!(status["recording"]["problem"].is_string());
}

#[test]
#[ignore = "minutes; see the top of the file"]
fn a_source_that_dies_every_ten_seconds_stops_the_robot_and_comes_back() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("camera");
    let text = "#!/bin/sh\nend=$(( $(date +%s) + 10 ))\nwhile [ $(date +%s) -lt $end ]; do head -c 279936 /dev/zero; sleep 0.015; done\n";
    std::fs::write(&script, text).unwrap();
    std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
    let camera = format!("source = \"command\"\ninput = \"{}\"\n", script.display());
    let sensor = Sensor::start(folder.path(), &configuration(&camera), &folder.path().join("recordings"));
    phase(&sensor, "source dies every 10 s", || std::thread::sleep(Duration::from_secs(25)));
    let status = sensor.status();
    println!("  opened again {} times; relay {}", status["counts"]["restarts"], status["relay"]);
    assert!(number(&status, "/counts/restarts") >= 2.0 && status["relay"] == "open");
    println!("{}", sensor.end());
}
