//! Every fault, alone and in pairs, at random times: the relays are commanded open within the fault's stated time and
//! stay open while it lasts. A part of the campaign that `cargo xtask campaign` runs at length.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::link::{Emulated, InProcess};
use nearfield_tests::campaign::{Fault, Findings, Scenes, each_once, run};
use nearfield_tests::emulator::without_emulator;
use nearfield_tests::stage::Stage;
use rayon::prelude::*;

const SEED: u64 = 20_261_122;
/// Frames in all; about a minute of one core.
const FRAMES: u64 = 120_000;
const PARTS: u64 = 8;

#[test]
fn every_fault_and_every_pair_stops_within_its_time() {
    println!("seed {SEED}");
    let stage = Stage::new();
    let scenes = Scenes::new(&stage);
    let parts: Vec<Findings> = (0..PARTS)
        .into_par_iter()
        .map(|part| {
            let link = || Ok(Box::new(InProcess::new()) as Box<_>);
            run(&stage, &scenes, SEED + part, FRAMES / PARTS, link, |_| {}).unwrap()
        })
        .collect();
    let mut all = Findings::default();
    parts.into_iter().for_each(|part| all.add(part));
    println!("{}", all.table());
    println!("{} frames, {} pairs, {} clean frames", all.frames, all.pairs, all.clean_frames);
    assert!(
        all.broken.is_empty(),
        "{} broken: {:#?}",
        all.broken.len(),
        &all.broken[..all.broken.len().min(10)]
    );
    assert_eq!(all.false_stops, 0, "in {} clean frames", all.clean_frames);
    assert_eq!(all.alone.len(), Fault::ALL.len(), "every fault was played alone");
}

#[test]
fn every_fault_stops_the_emulated_controller_within_its_time() {
    if let Err(error) = Emulated::new() {
        return without_emulator(&error);
    }
    println!("seed {SEED}");
    let stage = Stage::new();
    let scenes = Scenes::new(&stage);
    let findings = each_once(&stage, &scenes, SEED, || Ok(Box::new(Emulated::new()?) as Box<_>)).unwrap();
    println!("{}", findings.table());
    assert!(findings.broken.is_empty(), "{:#?}", findings.broken);
    assert_eq!((findings.false_stops, findings.alone.len()), (0, Fault::ALL.len()));
}
