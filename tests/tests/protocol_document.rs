//! `shared/PROTOCOL.md` and the field tables of the messages say what the code does: offsets, lengths, constants.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use std::collections::BTreeSet;
use std::path::Path;

use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::condition::{
    Channels, FaultCode, HealthFigures, LaserMode, ResetCause, StateCode, TrustFigures, Warnings,
};
use nearfield_shared::cutoff::Gap;
use nearfield_shared::height::{Extreme, SizeClass};
use nearfield_shared::light::{BrightnessProfile, LIGHT_BLOCKS};
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, LINK_ERROR_INTERVAL, LINK_TIMEOUT, RUN_OVER_HEIGHT};
use nearfield_shared::linescan::{
    self, AUDIT_PIXELS, AuditWindow, HostVerdict, LARGEST_AUDIT_COUNT, LINE_SCAN_LENGTH, LINE_SCAN_MAGIC,
    LINE_SCAN_VERSION, LineScanColumn, LineScanHeader,
};
use nearfield_shared::run_over::{LARGEST_CLAIM_COUNT, NO_CLAIMS};
use nearfield_shared::service::{PAGE_LENGTH, PAGE_OFFSET, REQUEST_LENGTH};
use nearfield_shared::status::{Challenge, PermitInUse, STATUS_LENGTH, STATUS_MAGIC, STATUS_VERSION, Status};
use nearfield_shared::units::{
    CalibrationId, Micros, Millimetres, SequenceNumber, SignalQuality, SourceId, SubpixelRow,
};
use nearfield_shared::wire::{SEAL_LENGTH, checksum};

fn text(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The field tables of a source file's documentation: offsets with what stands there.
fn tables(path: &str) -> Vec<Vec<(usize, String)>> {
    let mut tables = Vec::new();
    for line in text(path).lines() {
        if line == "//! | offset | field |" {
            tables.push(Vec::new());
        }
        let row = line.strip_prefix("//! | ").and_then(|row| row.split_once(" | "));
        let row = row.and_then(|(offset, field)| Some((offset.parse().ok()?, field.to_owned())));
        if let (Some(row), Some(table)) = (row, tables.last_mut()) {
            table.push(row);
        }
    }
    tables
}

/// One field made different: words of the table's row that tells of it, and the message's bytes then.
type Probe<'a> = (&'a str, Vec<u8>);

/// Every probe must change bytes of its row and of no other, the CRC aside; every row but the fixed ones must have a probe.
fn hold_table_to_bytes(table: &[(usize, String)], base: &[u8], probes: &[Probe<'_>]) {
    let row_at = |position: usize| {
        table.iter().rev().find(|(offset, _)| *offset <= position).map(|(_, field)| field.as_str()).unwrap()
    };
    let mut seen = BTreeSet::new();
    for (words, bytes) in probes {
        let body = base.len() - SEAL_LENGTH;
        let changed: BTreeSet<&str> =
            (0..body).filter(|position| base[*position] != bytes[*position]).map(row_at).collect();
        assert_eq!(changed.len(), 1, "changing `{words}` changed {changed:?}");
        let row = changed.first().unwrap();
        assert!(row.contains(words), "changing `{words}` changed the row `{row}`");
        seen.insert(*row);
    }
    for (_, field) in table {
        let is_fixed = field.starts_with("magic") || field.starts_with("version") || field.starts_with("CRC");
        assert!(is_fixed || seen.contains(field.as_str()), "no probe for `{field}`");
    }
}

fn header() -> LineScanHeader {
    LineScanHeader {
        source: SourceId::new(1),
        calibration: CalibrationId::new(2),
        sequence: SequenceNumber::new(3),
        capture_age: Micros::new(4),
        exposure: Micros::new(5),
        last_status: 6,
        verdict: HostVerdict::Clear,
        ambient: 7,
        saturated: 8,
        claims: NO_CLAIMS,
    }
}

fn line_scan(
    header: &LineScanHeader,
    columns: &[LineScanColumn],
    block: u16,
    audit: &[AuditWindow],
) -> Vec<u8> {
    let mut bytes = [0; LINE_SCAN_LENGTH];
    let brightness = BrightnessProfile { blocks: [block; LIGHT_BLOCKS] };
    linescan::encode(&mut bytes, header, columns, &brightness, audit).unwrap();
    bytes.to_vec()
}

fn column(row: f32, quality: u8) -> LineScanColumn {
    LineScanColumn { row: SubpixelRow::from_pixels(row).unwrap(), quality: SignalQuality::new(quality) }
}

#[test]
fn the_line_scans_table_is_where_its_bytes_are() {
    let table = &tables("src/linescan.rs")[0];
    let columns = vec![column(100.0, 9); LARGEST_COLUMN_COUNT];
    let audit = [AuditWindow { column: 1, first_row: 2, pixels: [3; AUDIT_PIXELS] }; LARGEST_AUDIT_COUNT];
    let of = |change: &dyn Fn(&mut LineScanHeader)| {
        let mut header = header();
        change(&mut header);
        line_scan(&header, &columns, 10, &audit)
    };
    let base = of(&|_| ());
    let other_columns = |index: usize, other: LineScanColumn| {
        let mut columns = columns.clone();
        columns[index] = other;
        line_scan(&header(), &columns, 10, &audit)
    };
    let mut last_audit = audit;
    last_audit[LARGEST_AUDIT_COUNT - 1].pixels[AUDIT_PIXELS - 1] = 77;
    let claim = line_scan_with_a_claim(&base);
    hold_table_to_bytes(
        table,
        &base,
        &[
            ("source id", of(&|header| header.source = SourceId::new(0xFFFF))),
            ("calibration id", of(&|header| header.calibration = CalibrationId::new(u32::MAX))),
            ("sequence number", of(&|header| header.sequence = SequenceNumber::new(u32::MAX))),
            ("age of the picture", of(&|header| header.capture_age = Micros::new(0x7FFF_FFFF))),
            ("exposure", of(&|header| header.exposure = Micros::new(0x7FFF_FFFF))),
            ("number of the last status", of(&|header| header.last_status = u32::MAX)),
            ("host verdict", of(&|header| header.verdict = HostVerdict::Stop)),
            ("columns u16", {
                let mut bytes = base.clone();
                let shorter = line_scan(&header(), &columns[1..], 10, &audit);
                bytes[30..32].copy_from_slice(&shorter[30..32]);
                assert_eq!(bytes[30..32], 1151_u16.to_le_bytes());
                bytes
            }),
            ("audit windows u16", {
                let mut bytes = base.clone();
                let fewer = line_scan(&header(), &columns, 10, &audit[1..]);
                bytes[32..34].copy_from_slice(&fewer[32..34]);
                assert_eq!(bytes[32..34], 7_u16.to_le_bytes());
                bytes
            }),
            ("ambient", of(&|header| header.ambient = 255)),
            ("saturated", of(&|header| header.saturated = 255)),
            ("claims", claim),
            ("1152 rows", other_columns(0, column(2000.0, 9))),
            ("1152 rows", other_columns(LARGEST_COLUMN_COUNT - 1, column(2000.0, 9))),
            ("1152 signal qualities", other_columns(0, column(100.0, 200))),
            ("1152 signal qualities", other_columns(LARGEST_COLUMN_COUNT - 1, column(100.0, 200))),
            ("64 brightnesses", line_scan(&header(), &columns, 0xFFFF, &audit)),
            ("8 audit windows", line_scan(&header(), &columns, 10, &last_audit)),
        ],
    );
    assert_eq!(table.last().unwrap().0, LINE_SCAN_LENGTH - SEAL_LENGTH, "the CRC's offset");
}

/// The base with the bytes of a claim, as the message's own encoder writes them.
fn line_scan_with_a_claim(base: &[u8]) -> Vec<u8> {
    use nearfield_shared::action::Category;
    use nearfield_shared::run_over::{Claim, Stretch};
    let claim = Claim {
        stretch: Stretch::new(-300, 300).unwrap(),
        category: Category::ALL[0],
        confidence: 0xFF,
        age: Micros::from_millis(200),
    };
    let header = LineScanHeader { claims: [Some(claim); LARGEST_CLAIM_COUNT], ..header() };
    let columns = vec![column(100.0, 9); LARGEST_COLUMN_COUNT];
    let audit = [AuditWindow { column: 1, first_row: 2, pixels: [3; AUDIT_PIXELS] }; LARGEST_AUDIT_COUNT];
    let bytes = line_scan(&header, &columns, 10, &audit);
    assert_ne!(bytes, base);
    bytes
}

fn status() -> Status {
    let at = |height: f32, place: f32| Extreme {
        height: Millimetres::new(height),
        place: Millimetres::new(place),
    };
    Status {
        source: SourceId::new(1),
        calibration: Some(CalibrationId::new(2)),
        firmware: 3,
        number: 4,
        echoed_sequence: SequenceNumber::new(5),
        now: Micros::new(6),
        state: StateCode::Running,
        relay_command: Channels::CLOSED,
        relay_readback: Channels { a: true, b: false },
        reset_cause: ResetCause::Watchdog,
        live_causes: StopCauses::NONE,
        latched_causes: StopCauses::NONE,
        longest_gap: Some(Gap::between(-3.0, 4.5)),
        highest: Some(at(52.0, -1.0)),
        lowest: Some(Millimetres::new(-6.0)),
        longest_unknown: Millimetres::new(2.0),
        size: Some(SizeClass::Large),
        laser_mode: LaserMode::Coded,
        warnings: Warnings::from_bits(1),
        decision_age: Micros::new(7),
        longest_decision_age: Micros::new(8),
        response_bound: Micros::new(9),
        accepted: 10,
        refused: [11; 8],
        challenge: Challenge { count: 8, columns: [12; 8] },
        fault: None,
        failed_self_test: 13,
        trust: TrustFigures {
            light_age: Micros::new(14),
            longest_light_age: Micros::new(15),
            liveness_doubt: 16,
            audit_doubt: 17,
            audits_confirmed: 18,
            audits_contradicted: 19,
        },
        health: HealthFigures {
            floor_offset: Millimetres::new(0.25),
            floor_rise: Millimetres::new(-0.125),
            smallest_object: Millimetres::new(2.5),
            smallest_object_place: Millimetres::new(-100.0),
            permitted_speed_percent: 50,
        },
        run_over: Some(PermitInUse { stretch: Gap::between(-20.0, 31.0), time_left: Micros::new(20) }),
    }
}

#[test]
fn the_statuss_table_is_where_its_bytes_are() {
    let table = &tables("src/status.rs")[0];
    let of = |change: &dyn Fn(&mut Status)| {
        let mut status = status();
        change(&mut status);
        status.to_bytes().to_vec()
    };
    let far = Micros::new(0x7FFF_FFFF);
    let probes: &[Probe<'_>] = &[
        ("source id", of(&|status| status.source = SourceId::new(0xFFFF))),
        ("calibration id", of(&|status| status.calibration = Some(CalibrationId::new(u32::MAX)))),
        ("firmware id", of(&|status| status.firmware = u32::MAX)),
        ("number of this status", of(&|status| status.number = u32::MAX)),
        ("last accepted line-scan", of(&|status| status.echoed_sequence = SequenceNumber::new(u32::MAX))),
        ("MCU time", of(&|status| status.now = Micros::new(u64::MAX))),
        ("state u8", of(&|status| status.state = StateCode::Stopped)),
        ("relay command u8", of(&|status| status.relay_command = Channels { a: true, b: false })),
        ("relay read-back u8", of(&|status| status.relay_readback = Channels::CLOSED)),
        ("reset cause u8", of(&|status| status.reset_cause = ResetCause::PowerOn)),
        ("live causes", of(&|status| status.live_causes = StopCauses::NONE.with(StopCause::StripeCut))),
        ("latched causes", of(&|status| status.latched_causes = StopCauses::NONE.with(StopCause::Audit))),
        ("longest gap", of(&|status| status.longest_gap = Some(Gap::between(-300.0, 300.0)))),
        ("highest point", of(&|status| status.highest = None)),
        ("lowest point", of(&|status| status.lowest = None)),
        ("longest stretch without", of(&|status| status.longest_unknown = Millimetres::new(900.0))),
        ("size class", of(&|status| status.size = None)),
        ("laser mode", of(&|status| status.laser_mode = LaserMode::Off)),
        ("warnings", of(&|status| status.warnings = Warnings::from_bits(0xFFFF))),
        ("decision age", of(&|status| status.decision_age = far)),
        ("longest decision age", of(&|status| status.longest_decision_age = far)),
        ("response bound", of(&|status| status.response_bound = far)),
        ("line-scans accepted", of(&|status| status.accepted = u32::MAX)),
        ("line-scans refused", of(&|status| status.refused = [u32::MAX; 8])),
        ("challenge", of(&|status| status.challenge = Challenge { count: 1, columns: [9; 8] })),
        ("fault u8", of(&|status| status.fault = Some(FaultCode::SelfTest))),
        ("failed self-test", of(&|status| status.failed_self_test = 255)),
        ("light age", of(&|status| status.trust.light_age = far)),
        ("longest light age", of(&|status| status.trust.longest_light_age = far)),
        ("liveness doubt", of(&|status| status.trust.liveness_doubt = u16::MAX)),
        ("audit doubt", of(&|status| status.trust.audit_doubt = u16::MAX)),
        ("confirmed", of(&|status| status.trust.audits_confirmed = u32::MAX)),
        ("contradicted", of(&|status| status.trust.audits_contradicted = u32::MAX)),
        ("floor's offset", of(&|status| status.health.floor_offset = Millimetres::new(9.0))),
        ("its rise", of(&|status| status.health.floor_rise = Millimetres::new(9.0))),
        ("lowest object", of(&|status| status.health.smallest_object = Millimetres::new(9.0))),
        ("where it is worst", of(&|status| status.health.smallest_object_place = Millimetres::new(9.0))),
        ("permitted speed", of(&|status| status.health.permitted_speed_percent = 100)),
        ("run-over permit", of(&|status| status.run_over = None)),
    ];
    hold_table_to_bytes(table, &status().to_bytes(), probes);
    assert_eq!(table.last().unwrap().0, STATUS_LENGTH - SEAL_LENGTH, "the CRC's offset");
}

#[test]
fn the_last_offset_of_every_service_table_is_its_crcs() {
    let tables = tables("src/service.rs");
    let lengths = [REQUEST_LENGTH, PAGE_LENGTH];
    assert_eq!(tables.len(), lengths.len(), "request and page");
    for (table, length) in tables.iter().zip(lengths) {
        let (offset, field) = table.last().unwrap();
        assert!(
            field.starts_with("CRC-32") && *offset == length - SEAL_LENGTH,
            "{field} at {offset} of {length}"
        );
    }
}

/// Each sentence with a figure is made again from the code's constants and looked for.
#[test]
fn the_documents_figures_are_the_codes() {
    let document = text("PROTOCOL.md");
    let seconds = |time: Micros| time.get() / 1_000_000;
    for sentence in [
        format!("exactly {LINE_SCAN_LENGTH} bytes"),
        format!("a line-scan has {}", thousands((LINE_SCAN_LENGTH - SEAL_LENGTH) * 8)),
        format!("| host to microcontroller | 0..{LINE_SCAN_LENGTH} |"),
        format!("| microcontroller to host | 0..{STATUS_LENGTH} |"),
        format!("| | {PAGE_OFFSET}..{} |", PAGE_OFFSET + PAGE_LENGTH),
        format!("in {LIGHT_BLOCKS} parts of the width"),
        format!("window of {AUDIT_PIXELS} rows"),
        format!("{} ms) bounds the silence", LINK_TIMEOUT.get() / 1000).replacen("", "(", 1),
        format!("The first within {} seconds", seconds(LINK_ERROR_INTERVAL)),
        format!("is below {} mm**", RUN_OVER_HEIGHT.get()),
        format!("are at version {LINE_SCAN_VERSION}."),
    ] {
        assert!(document.contains(&sentence), "shared/PROTOCOL.md does not say `{sentence}`");
    }
    assert_eq!(LINE_SCAN_VERSION, STATUS_VERSION, "`Line-scan and status are at version` one number");
    assert_eq!(
        (LARGEST_AUDIT_COUNT, LARGEST_CLAIM_COUNT),
        (8, 4),
        "`(eight columns)`, `up to four stretches`"
    );
    let magic = |magic: u32| String::from_utf8(magic.to_le_bytes().to_vec()).unwrap();
    assert!(text("src/linescan.rs").contains(&format!("magic `{}`", magic(LINE_SCAN_MAGIC))));
    assert!(text("src/status.rs").contains(&format!("magic `{}`", magic(STATUS_MAGIC))));
}

/// The channel's errors name stop causes that exist, and every cause of the link is named.
#[test]
fn the_causes_of_the_link_are_all_named_and_exist() {
    let document = text("PROTOCOL.md");
    let names: BTreeSet<&str> = StopCause::ALL.into_iter().map(StopCause::name).collect();
    let rows = document.lines().filter(|line| line.starts_with("| ") && line.ends_with("` |"));
    let named: BTreeSet<&str> =
        rows.filter_map(|row| row.trim_end_matches("` |").rsplit_once('`').map(|(_, name)| name)).collect();
    assert!(named.len() >= 8 && named.is_subset(&names), "{named:?}");
    for name in names.iter().filter(|name| name.starts_with("link_")) {
        assert!(named.contains(name), "`{name}` is not in the table of the channel's errors");
    }
}

/// The polynomial that the document names is the one that the code divides by: computed bit by bit.
#[test]
fn the_seal_is_made_with_the_polynomial_that_the_document_names() {
    let document = text("PROTOCOL.md");
    let (_, rest) = document.split_once("polynomial 0x").unwrap();
    let polynomial = u32::from_str_radix(&rest[..8], 16).unwrap().reverse_bits();
    let message = b"nearfield";
    let mut register = u32::MAX;
    for byte in message {
        register ^= u32::from(*byte);
        for _ in 0..8 {
            register = (register >> 1) ^ if register & 1 == 1 { polynomial } else { 0 };
        }
    }
    assert_eq!(checksum(message), !register);
}

fn thousands(number: usize) -> String {
    format!("{},{:03}", number / 1000, number % 1000)
}
