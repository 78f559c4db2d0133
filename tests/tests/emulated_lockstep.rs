//! The firmware's Arm binary in QEMU answers the same bytes as the firmware library in this process, over a whole
//! simulated life of start, reset, every kind of scene and every kind of link fault. The answers' digest is kept.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::link::{Emulated, FrameFacts, McuSession};
use nearfield_shared::action::Category;
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH, LineScanColumn};
use nearfield_shared::run_over::{Claim, Claims, NO_CLAIMS, Stretch};
use nearfield_shared::units::Micros;
use nearfield_shared::wire::{SEAL_LENGTH, checksum};
use nearfield_tests::emulator::without_emulator;
use nearfield_tests::oracle::Random;
use nearfield_tests::pair::{Pair, SharedPair};
use nearfield_tests::stage::Stage;

const SEED: u64 = 20_260_402;
const SCANS: u32 = 10_000;
/// FNV-1a over all replies of the run. A change here is a change of what the controller answers: find out why
/// before you renew it.
const GOLDEN_DIGEST: u64 = 0xF32C_439A_8DE3_9F50;

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
    let mut stage = Stage::new();
    stage.rig = stage.rig.with_run_over(true);
    let pair = SharedPair::new(Pair::new(emulated));
    let mut session = McuSession::start(Box::new(pair.clone()), &stage.rig).unwrap();
    let mut random = Random::new(SEED);
    let floor = stage.floor();
    let mut columns = floor.clone();
    let mut scene_left = 0;
    for frame in 0..SCANS {
        if scene_left == 0 {
            // Mostly clean floor, so that the relays get closed between the scenes.
            let scene = below(&mut random, 3) == 0;
            scene_left = if scene { 1 + below(&mut random, 4) } else { 70 + below(&mut random, 80) };
            columns = if scene { random_columns(&stage, &mut random) } else { floor.clone() };
        }
        scene_left -= 1;
        if frame % 40 == 30 {
            session.press_reset();
        }
        let message = message(&mut session, &columns, &mut random);
        session.run_frame(message.as_deref()).unwrap();
    }
    println!("digest {:#018x}, relays closed in {} replies", pair.digest(), pair.closed_replies());
    assert!(pair.closed_replies() > SCANS, "the run must exercise closed relays, too");
    assert!(pair.closed_replies() < 4 * SCANS, "and open ones");
    assert_eq!(pair.digest(), GOLDEN_DIGEST);
}

/// Claims that change every two seconds: none, debris here or there, somebody beside it.
fn claims(now: Micros) -> Claims {
    let claim = |start: i16, category| {
        let stretch = Stretch::new(start, start + 90)?;
        Some(Claim { stretch, category, confidence: 240, age: Micros::from_millis(80) })
    };
    match now.get() / 2_000_000 % 5 {
        0 => NO_CLAIMS,
        1 => [claim(-200, Category::Tool), claim(100, Category::Material), None, None],
        2 => [claim(-50, Category::Tool), None, None, claim(250, Category::Human)],
        3 => [claim(-50, Category::Material), claim(60, Category::Tool), None, None],
        _ => [claim(-100, Category::Tool), claim(150, Category::Vehicle), None, None],
    }
}

/// The frame's message: mostly a good one, now and then nothing or a broken one.
fn message(session: &mut McuSession, columns: &[LineScanColumn], random: &mut Random) -> Option<Vec<u8>> {
    let fault = below(random, 300);
    let mut facts = FrameFacts { claims: claims(session.now()), ..FrameFacts::default() };
    match fault {
        0 => return None,
        1 => facts.verdict = HostVerdict::Stop,
        2 => facts.capture_age = Micros::from_millis(61),
        3 => {
            for _ in 0..5 {
                session.next_header(facts);
            }
        }
        _ => {}
    }
    let mut bytes = session.next_scene_line_scan(columns, facts).unwrap().to_vec();
    match fault {
        // Another module, an older status, light that does not fit, no audit windows: each with a good seal.
        4 => bytes[6] ^= 3,
        5 => bytes[24] = bytes[24].wrapping_sub(5),
        6 => bytes[3524..3652].fill(0x50),
        7 => bytes[32] = 0,
        8 => {
            bytes[below(random, LINE_SCAN_LENGTH as u64) as usize] ^= 4;
            return Some(bytes);
        }
        9 => return Some(bytes[..100].to_vec()),
        _ => {}
    }
    let body = LINE_SCAN_LENGTH - SEAL_LENGTH;
    let seal = checksum(&bytes[..body]).to_le_bytes();
    bytes[body..].copy_from_slice(&seal);
    Some(bytes)
}
