//! The firmware's Arm binary in QEMU answers the same bytes as the firmware library in this process, over a whole
//! simulated life of start, reset, every kind of scene and every kind of link fault. The answers' digest is kept.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::link::{Emulated, FrameFacts, McuLink as _, MirrorContacts, PinInputs};
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode};
use nearfield_shared::status::Status;
use nearfield_shared::units::{Micros, SequenceNumber, SourceId};
use nearfield_tests::emulator::without_emulator;
use nearfield_tests::oracle::Random;
use nearfield_tests::pair::Pair;
use nearfield_tests::stage::Stage;

const SEED: u64 = 20_260_402;
const SCANS: u32 = 10_000;
/// FNV-1a over all replies of the run. A change here is a change of what the controller answers: find out why
/// before you renew it.
const GOLDEN_DIGEST: u64 = 0xEDA3_B8B1_8F1C_6CE6;

/// Uniform in `0..limit`.
fn below(random: &mut Random, limit: u64) -> u64 {
    random.bits() % limit
}

/// A random stripe: pieces of floor, raised, sunk and missing stretches, some noise, some weak columns.
fn random_columns(stage: &Stage, random: &mut Random) -> Vec<LineScanColumn> {
    let pieces: Vec<(f32, Option<f32>)> = (0..below(random, 12))
        .map(|_| {
            let height = match below(random, 6) {
                0 => None,
                1 => Some(random.within(2.0, 140.0) as f32),
                2 => Some(random.within(-25.0, -2.0) as f32),
                _ => Some(0.0),
            };
            (random.within(-450.0, 450.0) as f32, height)
        })
        .collect();
    let mut columns = stage.profile(|s| {
        pieces
            .iter()
            .filter(|(start, _)| *start <= s)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(Some(0.0), |piece| piece.1)
    });
    for column in &mut columns {
        if below(random, 60) == 0 {
            column.quality = nearfield_shared::units::SignalQuality::new(below(random, 48) as u8);
        }
    }
    columns
}

#[test]
fn emulated_and_in_process_controllers_answer_the_same_bytes() {
    let emulated = match Emulated::new() {
        Ok(emulated) => emulated,
        Err(error) => return without_emulator(&error),
    };
    println!("seed {SEED}");
    let stage = Stage::new();
    let mut pair = Pair::new(emulated);
    let rig = stage.rig.to_bytes();
    pair.start(Micros::ZERO, &rig).unwrap();
    let mut random = Random::new(SEED);
    let floor = stage.floor();
    let mut columns = floor.clone();
    let (mut sequence, mut last_status) = (0, 0);
    let mut mirror = MirrorContacts::BOTH_OPEN;
    let mut scene_left = 0;
    for frame in 0..u64::from(SCANS) {
        let start = Micros::from_millis(frame * 20);
        if scene_left == 0 {
            // Mostly clean floor, so that the relays get closed between the scenes.
            scene_left = if below(&mut random, 3) == 0 {
                1 + below(&mut random, 4)
            } else {
                15 + below(&mut random, 30)
            };
            columns = if scene_left < 6 { random_columns(&stage, &mut random) } else { floor.clone() };
        }
        scene_left -= 1;
        sequence += 1;
        let message = message(&stage, &columns, &mut random, &mut sequence, last_status);
        let reply = pair.exchange(start, message.as_deref()).unwrap();
        last_status = Status::parse(&reply.status).unwrap().number;
        for tick in 0..4 {
            let now = start.plus(Micros::from_millis(tick * 5));
            let reset_pressed = frame % 16 >= 2 && frame % 16 < 10;
            let reply = pair.tick(now, PinInputs { mirror, reset_pressed }).unwrap();
            mirror = MirrorContacts { a: !reply.outputs.relays.a, b: !reply.outputs.relays.b };
        }
    }
    println!("digest {:#018x}, relays closed in {} replies", pair.digest(), pair.closed_replies());
    assert!(pair.closed_replies() > SCANS, "the run must exercise closed relays, too");
    assert!(pair.closed_replies() < 4 * SCANS, "and open ones");
    assert_eq!(pair.digest(), GOLDEN_DIGEST);
}

/// The frame's message: mostly a good one, now and then nothing or a broken one.
fn message(
    stage: &Stage,
    columns: &[LineScanColumn],
    random: &mut Random,
    sequence: &mut u32,
    last_status: u32,
) -> Option<Vec<u8>> {
    let fault = below(random, 150);
    let facts = FrameFacts::default();
    let mut header = LineScanHeader {
        source: SourceId::new(1),
        calibration: stage.rig.calibration_id(),
        sequence: SequenceNumber::new(*sequence),
        capture_age: facts.capture_age,
        exposure: facts.exposure,
        last_status,
        verdict: facts.verdict,
    };
    match fault {
        0 => return None,
        1 => header.source = SourceId::new(2),
        2 => header.verdict = HostVerdict::Stop,
        3 => header.capture_age = Micros::from_millis(61),
        4 => *sequence += 5,
        5 => header.last_status = last_status.saturating_sub(5),
        _ => {}
    }
    let mut bytes = [0; LINE_SCAN_LENGTH];
    encode(&mut bytes, &header, columns, &[]).unwrap();
    match fault {
        6 => bytes[below(random, LINE_SCAN_LENGTH as u64) as usize] ^= 4,
        7 => return Some(bytes[..100].to_vec()),
        _ => {}
    }
    Some(bytes.to_vec())
}
