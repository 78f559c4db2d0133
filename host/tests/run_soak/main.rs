//! `nearfield run` for a while, with everything on, and with what disturbs it: figures, phase by phase.
//!
//! `cargo xtask soak` runs it. Everything is the product's: source, vision, line-scans, controller, tier 3 with the built-in network in
//! its own thread, recorder, page. It is put together here, as `nearfield run` does it, so that the detector and the source can be made
//! to fail. Every figure is of all pictures of its phase, by a listener of its own beside recorder and page.
//!
//! NEARFIELD_SOAK_SECONDS says how long a phase takes (60 without it), NEARFIELD_SOAK_MCU which controller ("in-process" or "emulated"),
//! NEARFIELD_SOAK_WIDTH how wide the pictures are (1152), NEARFIELD_SOAK_PROFILE "semantics" or "height" (without tier 3).
#![allow(clippy::unwrap_used)]
#![cfg(target_os = "linux")]

mod bench;
mod flood;
mod tally;

use std::sync::atomic::Ordering;
use std::time::Duration;

use bench::{Bench, Switches};
use tally::Phase;

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

fn phase_length() -> Duration {
    Duration::from_secs(number("NEARFIELD_SOAK_SECONDS", 60))
}

/// Tier 3 that answers nothing: each look takes so long.
const STALL: Duration = Duration::from_secs(10);

#[test]
#[ignore = "half an hour; see the top of the file"]
fn nothing_that_listens_or_fails_beside_it_disturbs_the_stripes_path() {
    let switches = Switches::default();
    let bench = Bench::start(&switches);
    println!("{}", Phase::HEAD);
    let told = |phase: &Phase| println!("{phase}");
    let undisturbed = |name: &str| {
        let phase = bench.phase(name, phase_length(), || {});
        told(&phase);
        phase.assert_undisturbed();
        phase
    };
    let first = undisturbed("quiet");
    if bench.has_tier_three() {
        switches.stall_ms.store(STALL.as_millis() as u64, Ordering::Relaxed);
        let phase = bench.phase("tier 3 stalled, 10 s a look", phase_length(), || {});
        switches.stall_ms.store(0, Ordering::Relaxed);
        told(&phase);
        phase.assert_undisturbed();
        assert!(
            phase.answers <= phase_length().as_secs() / 9 + 2,
            "tier 3 was not stalled: {}",
            phase.answers
        );
    }
    match bench.disk() {
        Some(disk) => {
            let ballast = disk.join("ballast");
            let phase = bench.phase("disk full", phase_length(), || {
                // As much as there is room for.
                std::fs::write(&ballast, vec![0; 256 << 20]).unwrap_err();
            });
            told(&phase);
            phase.assert_undisturbed();
            assert!(bench.recording_problem().is_some(), "the disk was not full");
            std::fs::remove_file(&ballast).unwrap();
        }
        None => println!("| disk full | left out: a small disk needs the right to mount one |"),
    }
    let mut clients = flood::Clients::start(&bench.page_address(), 200);
    let phase = bench.phase("200 clients", phase_length(), || {});
    let (answered, turned_away) = clients.end();
    told(&phase);
    phase.assert_undisturbed();
    assert!(answered > 0 && turned_away > 0, "{answered} answered, {turned_away} turned away");
    switches.dies_every_ms.store(10_000, Ordering::Relaxed);
    let dying = bench.phase("source dies every 10 s", phase_length(), || {});
    switches.dies_every_ms.store(0, Ordering::Relaxed);
    told(&dying);
    assert!(dying.restarts > 0 && dying.lost == 0, "{dying:?}");
    // Every death stops the robot once, and nothing else does; the phase may end between a stop and its restart.
    assert!(dying.stops.abs_diff(dying.restarts) <= 1, "{dying:?}");
    // Armed again after the last death.
    std::thread::sleep(Duration::from_secs(5));
    let last = undisturbed("quiet again");
    println!(
        "\nmemory {:.1} MiB at the start, {:.1} MiB at the end; {answered} requests of the clients answered, \
         {turned_away} turned away",
        first.memory_mib, last.memory_mib
    );
    let sum = bench.end();
    println!("{sum}");
}

/// A process of its own: what the clients of the flood use is not the sensor's memory. Started by [`flood::Clients`].
#[test]
#[ignore = "a part of the test above"]
fn clients() {
    flood::be_the_clients();
}
