//! Every fuzzed function over the committed corpus and a few thousand seeded changes of it. The same functions run
//! under libFuzzer for as long as one likes: `cargo xtask fuzz`.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use nearfield_firmware::lockstep::{Request, RequestHeader, SimulatedSelfTest, SimulatedTick};
use nearfield_firmware::selftest::SelfTestKind;
use nearfield_host::link::{InProcess, McuSession};
use nearfield_shared::action::Category;
use nearfield_shared::audit::first_row_for;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::linescan::{
    AUDIT_PIXELS, AuditWindow, HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode,
};
use nearfield_shared::run_over::{Claim, Stretch};
use nearfield_shared::service::{
    Demand, FaultEntry, FaultEvent, NO_PAGE, PageHeader, PowerCycle, ResultCode, encode_page, encode_request,
};
use nearfield_shared::status::{ResetCause, StateCode};
use nearfield_shared::units::{CalibrationId, Micros, SequenceNumber, SignalQuality, SourceId, SubpixelRow};
use nearfield_tests::fuzz::{TARGETS, arming_frames};
use nearfield_tests::stage::Stage;
use proptest::prelude::Rng;
use proptest::test_runner::{RngAlgorithm, TestRng};
use std::path::{Path, PathBuf};

const SEED: u64 = 20_261_122;
/// Changed inputs for each parser.
const CHANGES: usize = 3_000;
/// Changed inputs for the controller, each some seconds of a robot's life.
const SEQUENCES: usize = 300;

fn folder(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target)
}

/// The corpus in the order of its names, so that a seed means the same everywhere.
fn corpus(target: &str) -> Vec<Vec<u8>> {
    let mut files: Vec<_> =
        std::fs::read_dir(folder(target)).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.iter().map(|file| std::fs::read(file).unwrap()).collect()
}

/// A change as fuzzers make them: bits, bytes, runs, lengths, pieces of another input.
fn changed(random: &mut TestRng, inputs: &[Vec<u8>]) -> Vec<u8> {
    let mut below = |limit: usize| usize::try_from(random.next_u64()).unwrap() % limit.max(1);
    let mut bytes = inputs[below(inputs.len())].clone();
    for _ in 0..=below(4) {
        let place = below(bytes.len());
        match below(7) {
            0 if !bytes.is_empty() => bytes[place] ^= 1 << below(8),
            1 if !bytes.is_empty() => bytes[place] = [0, 1, 0x7F, 0x80, 0xFF][below(5)],
            2 if !bytes.is_empty() => bytes[place] = u8::try_from(below(256)).unwrap(),
            3 => bytes.truncate(place),
            4 => bytes.insert(place, u8::try_from(below(256)).unwrap()),
            5 => {
                let other = &inputs[below(inputs.len())];
                let from = below(other.len());
                let length = below(64).min(other.len() - from).min(bytes.len() - place);
                bytes[place..place + length].copy_from_slice(&other[from..from + length]);
            }
            _ => {
                let length = below(24).min(bytes.len() - place);
                bytes[place..place + length].fill(u8::try_from(below(256)).unwrap());
            }
        }
    }
    bytes
}

#[test]
fn the_corpus_and_its_changes_break_no_rule() {
    println!("seed {SEED}");
    for (name, target) in TARGETS {
        let inputs = corpus(name);
        let read: Vec<_> = inputs.iter().filter(|input| target(input)).cloned().collect();
        // A corpus of an older version would be refused at the door and prove nothing.
        assert!(
            !read.is_empty(),
            "{name}: nothing in its corpus is read any more; renew it (see tests/RIGOR.md)"
        );
        let mut seed = [0; 32];
        seed[..8].copy_from_slice(&SEED.to_le_bytes());
        let mut random = TestRng::from_seed(RngAlgorithm::ChaCha, &seed);
        let rounds = if name == "controller" { SEQUENCES } else { CHANGES };
        // Much of what a fuzzer finds interesting is refused: every second change begins with what is read.
        let bases = [&inputs, &read].into_iter().cycle().take(rounds);
        let past_the_door = bases.filter(|base| target(&changed(&mut random, base))).count();
        let (all, read) = (inputs.len(), read.len());
        println!("{name}: {all} inputs, {read} read; {rounds} changed, {past_the_door} read");
        assert!(past_the_door > rounds / 50, "{name}: the changes hardly ever get past the door");
    }
}

/// Honest messages of every kind, as the first inputs of the corpus.
fn honest_inputs() -> Vec<(&'static str, String, Vec<u8>)> {
    let mut all = Vec::new();
    let mut add =
        |target: &'static str, name: &str, bytes: Vec<u8>| all.push((target, name.to_owned(), bytes));
    let stage = Stage::new();
    let rig = &stage.rig;
    for (name, columns, audits, verdict) in [
        ("floor", 1152, 8, HostVerdict::Clear),
        ("few", 1, 0, HostVerdict::Stop),
        ("odd", 641, 3, HostVerdict::Warn),
    ] {
        add("line_scan", name, line_scan(columns, audits, verdict));
    }
    let mut session = McuSession::start(Box::new(InProcess::new()), rig).unwrap();
    add("status", "fresh", session.status().to_bytes().to_vec());
    session = stage.armed();
    add("status", "running", session.status().to_bytes().to_vec());
    session.stall(Micros::from_millis(200));
    session.run_poll().unwrap();
    add("status", "stopped", session.status().to_bytes().to_vec());
    add("compact_rig", "large", rig.to_bytes().to_vec());
    add("compact_rig", "side", Stage::with_rig("t1_side_std.toml").rig.to_bytes().to_vec());
    let demands = [
        ("black_box", Demand::ReadBlackBox { page: 3 }),
        ("fault_log", Demand::ReadFaultLog { page: 0 }),
        ("read_rig", Demand::ReadRig),
        ("candidate", Demand::ReadCandidate),
        ("store", Demand::StoreRig { rig: &rig.to_bytes() }),
        ("acknowledge", Demand::AcknowledgeRig { calibration: rig.calibration_id() }),
    ];
    for (name, demand) in demands {
        let mut message = [0; LINE_SCAN_LENGTH];
        encode_request(&mut message, SourceId::new(1), 77, &demand);
        // The zeros behind it are put back by the function itself.
        add("service_request", name, message[..184].to_vec());
    }
    let header = PageHeader {
        source: SourceId::new(1),
        request: 77,
        code: 0x3333,
        result: ResultCode::Done,
        index: 0,
        count: 1,
        revision: 5,
    };
    let entry = FaultEntry {
        number: 5,
        power_cycle: PowerCycle::new(2),
        time: Micros::from_millis(12_345),
        status: 600,
        causes: StopCauses::NONE.with(StopCause::StripeCut).with(StopCause::Audit),
        event: FaultEvent::ALL[0],
        state: StateCode::Stopped,
        reset_cause: ResetCause::Watchdog,
        fault: 0,
        detail: 0,
    };
    let mut page = NO_PAGE;
    encode_page(
        &mut page,
        &header,
        &[entry.to_bytes(), FaultEntry { number: 6, ..entry }.to_bytes()].concat(),
    );
    add("service_page", "fault_log", page.to_vec());
    encode_page(&mut page, &header, &[]);
    add("service_page", "empty", page.to_vec());
    add("service_page", "bare_entry", entry.to_bytes().to_vec());
    add("lockstep_records", "session", lockstep_session(&rig.to_bytes()));
    let armed = arming_frames();
    add("controller", "arms", armed.clone());
    for byte in 1..=255_u8 {
        // One input for every kind of host and of robot is enough: the changes mix them.
        if byte < 16 || byte & 15 == 0 {
            add("controller", &format!("then_{byte:02x}"), [&armed[..], &[byte; 3], &[0; 30]].concat());
        }
    }
    all
}

fn line_scan(columns: usize, audits: usize, verdict: HostVerdict) -> Vec<u8> {
    let claim = Claim {
        stretch: Stretch::new(-20, 30).unwrap(),
        category: Category::Tool,
        confidence: 240,
        age: Micros::from_millis(60),
    };
    let header = LineScanHeader {
        source: SourceId::new(1),
        calibration: CalibrationId::new(0x1234_5678),
        sequence: SequenceNumber::new(42),
        capture_age: Micros::from_millis(21),
        exposure: Micros::from_millis(4),
        last_status: 41,
        verdict,
        ambient: 90,
        saturated: 10,
        claims: [Some(claim), None, None, None],
    };
    let row = |column: usize| 400.0 + f32::from(u16::try_from(column).unwrap()) / 16.0;
    let columns: Vec<_> = (0..columns)
        .map(|column| match SubpixelRow::from_pixels(row(column)) {
            Some(row) if column % 97 != 0 => LineScanColumn { row, quality: SignalQuality::new(200) },
            _ => LineScanColumn::MISSING,
        })
        .collect();
    let windows: Vec<_> = (0..audits)
        .map(|window| {
            let first_row = first_row_for(row(window * 13));
            AuditWindow {
                column: u16::try_from(window * 13).unwrap(),
                first_row,
                pixels: [120; AUDIT_PIXELS],
            }
        })
        .collect();
    let mut message = [0; LINE_SCAN_LENGTH];
    let brightness = BrightnessProfile { blocks: [9_000; 64] };
    encode(&mut message, &header, &columns, &brightness, &windows).unwrap();
    message.to_vec()
}

fn lockstep_session(stored_rig: &[u8]) -> Vec<u8> {
    let now = Micros::from_millis(5);
    let start = [&[5; 16], stored_rig].concat();
    let record = |request, payload: &[u8]| {
        let payload_length = u16::try_from(payload.len()).unwrap();
        [&RequestHeader { request, now, payload_length }.to_bytes()[..], payload].concat()
    };
    let failed = SimulatedTick {
        self_test: SimulatedSelfTest::Failed(SelfTestKind::Clock),
        ..SimulatedTick::default()
    };
    [
        record(Request::Start, &start),
        record(Request::Tick(SimulatedTick::default()), &[]),
        record(Request::Tick(failed), &[]),
        record(Request::Exchange, &line_scan(8, 0, HostVerdict::Clear)),
        record(Request::Hang, &[]),
    ]
    .concat()
}

/// Not a test: `cargo test -p nearfield-tests --test fuzz_corpus -- --ignored` writes the honest inputs anew.
#[test]
#[ignore = "writes the corpus; run it after a change of a format"]
fn write_honest_inputs() {
    for (target, name, bytes) in honest_inputs() {
        std::fs::create_dir_all(folder(target)).unwrap();
        std::fs::write(folder(target).join(format!("honest_{name}")), bytes).unwrap();
    }
}
