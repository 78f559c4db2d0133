//! The service protocol's rules: frozen bytes, nothing believed that was not checked, nothing lost on the way.

use super::*;
use crate::causes::{StopCause, StopCauses};
use crate::cutoff::{Cutoff, Gap};
use crate::height::{Extreme, Heights};
use crate::linescan::{LineScan, LineScanError};
use crate::monitor::StripeReport;
use crate::status::{ResetCause, StateCode};
use crate::units::{Micros, Millimetres, SequenceNumber};
use proptest::prelude::*;

const SOURCE: SourceId = SourceId::new(0x0102);
const RIG: [u8; COMPACT_LENGTH] = [0xA5; COMPACT_LENGTH];

fn demands() -> [Demand<'static>; 6] {
    [
        Demand::ReadBlackBox { page: 0x0B0C },
        Demand::ReadFaultLog { page: u16::MAX },
        Demand::ReadRig,
        Demand::ReadCandidate,
        Demand::StoreRig { rig: &RIG },
        Demand::AcknowledgeRig { calibration: CalibrationId::new(0x0D0E_0F10) },
    ]
}

fn request(demand: &Demand<'_>) -> [u8; LINE_SCAN_LENGTH] {
    let mut message = [0xEE; LINE_SCAN_LENGTH];
    encode_request(&mut message, SOURCE, 0x0304_0506, demand);
    message
}

/// A request with some bytes changed, and a good seal again.
fn changed(demand: &Demand<'_>, change: impl Fn(&mut [u8])) -> [u8; LINE_SCAN_LENGTH] {
    let mut message = request(demand);
    change(&mut message);
    wire::seal(&mut message[..REQUEST_LENGTH]);
    message
}

fn demand_of(message: &[u8]) -> Result<Demand<'_>, ResultCode> {
    Request::parse(message).unwrap().demand
}

/// Frozen: a controller in the field reads exactly these bytes. Do not change the test; add a version.
#[test]
fn golden_bytes_of_a_request_version_1() {
    assert_eq!((REQUEST_LENGTH, PAGE_LENGTH, PAGE_OFFSET), (184, 1056, 256));
    let message = request(&Demand::AcknowledgeRig { calibration: CalibrationId::new(0x0D0E_0F10) });
    #[rustfmt::skip]
    let head = [
        b'N', b'F', b'S', b'Q', 1, 0, 0x02, 0x01, 0x06, 0x05, 0x04, 0x03, 0x3C, 0x3C, 0, 0,
        0x10, 0x0F, 0x0E, 0x0D,
    ];
    assert_eq!(message[..20], head);
    assert_eq!(message[20..180], [0; 160]);
    assert_eq!(message[180..184], ACKNOWLEDGE_SEAL.to_le_bytes());
    assert_eq!(message[184..], [0; LINE_SCAN_LENGTH - 184]);
    let message = request(&Demand::StoreRig { rig: &RIG });
    assert_eq!(message[12..20], [0x5A, 0x5A, 160, 0, 0, 0, 0, 0]);
    assert_eq!(message[20..180], RIG);
    assert_eq!(message[180..184], STORE_SEAL.to_le_bytes());
    for (demand, code) in demands().iter().zip([0x5555, 0x3333, 0x6666, 0x0F0F, 0x5A5A, 0x3C3C]) {
        assert_eq!(demand.code(), code);
    }
}
/// Computed bit by bit outside this project's code from the catalogue's parameters.
const ACKNOWLEDGE_SEAL: u32 = 0x68CB_E524;
/// As above.
const STORE_SEAL: u32 = 0x2C98_FD92;

#[test]
fn a_change_and_a_read_differ_in_eight_bits_of_their_code() {
    for one in demands() {
        for other in demands() {
            let distance = (one.code() ^ other.code()).count_ones();
            assert!(one.code() == other.code() || distance >= 8, "{one:?} {other:?}");
        }
    }
    assert_eq!(demands().map(|demand| demand.is_change()), [false, false, false, false, true, true]);
}

#[test]
fn what_was_asked_is_what_is_read() {
    for demand in demands() {
        let message = request(&demand);
        let read = Request::parse(&message).unwrap();
        assert_eq!((read.source, read.number, read.code), (SOURCE, 0x0304_0506, demand.code()));
        assert_eq!(read.demand, Ok(demand));
        assert_eq!(read.seal.to_le_bytes(), message[180..184]);
    }
}

#[test]
fn what_is_not_whole_is_no_request() {
    let good = request(&Demand::ReadRig);
    assert_eq!(Request::parse(&[]), None);
    assert_eq!(Request::parse(&good[..REQUEST_LENGTH]), None, "shorter than a transaction");
    assert_eq!(Request::parse(&[&good[..], &[0]].concat()), None, "longer than a transaction");
    for bit in 0..8 * REQUEST_LENGTH {
        let mut bad = good;
        bad[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(Request::parse(&bad), None, "bit {bit}");
    }
    for offset in REQUEST_LENGTH..LINE_SCAN_LENGTH {
        let mut bad = good;
        bad[offset] = 1;
        assert_eq!(Request::parse(&bad), None, "byte {offset} must be zero");
    }
    assert_eq!(Request::parse(&changed(&Demand::ReadRig, |bytes| bytes[0] = b'M')), None, "another magic");
}

#[test]
fn what_is_whole_but_not_understood_has_its_code() {
    let read = Demand::ReadRig;
    let page = Demand::ReadBlackBox { page: 3 };
    let store = Demand::StoreRig { rig: &RIG };
    let with = |demand: &Demand<'_>, offset: usize, value: u8| {
        let message = changed(demand, |bytes| bytes[offset] = value);
        demand_of(&message).err()
    };
    assert_eq!(with(&read, 4, 2), Some(ResultCode::OtherVersion));
    assert_eq!(with(&read, 12, 0), Some(ResultCode::UnknownKind));
    assert_eq!(with(&page, 18, 1), Some(ResultCode::NoSuchPage), "page 65539");
    assert_eq!(with(&read, 16, 1), Some(ResultCode::Malformed), "reading a rig has no argument");
    assert_eq!(with(&store, 16, 1), Some(ResultCode::Malformed), "storing a rig has no argument");
    assert_eq!(with(&read, 14, 160), Some(ResultCode::Malformed), "a payload where none belongs");
    assert_eq!(with(&read, 179, 1), Some(ResultCode::Malformed), "bytes where none belong");
    assert_eq!(with(&store, 14, 159), Some(ResultCode::Malformed), "one byte short");
    assert_eq!(with(&store, 14, 161), Some(ResultCode::Malformed), "one byte too many");
    assert_eq!(with(&store, 14, 160), None);
    // The number and the module stay readable, so that the answer names them.
    let message = changed(&read, |bytes| bytes[4] = 9);
    let other = Request::parse(&message).unwrap();
    assert_eq!((other.source, other.number, other.code), (SOURCE, 0x0304_0506, 0x6666));
}

/// A padded request does not carry the seal of a line-scan, and a renamed one is none.
#[test]
fn no_message_is_both_a_request_and_a_line_scan() {
    for demand in demands() {
        assert_eq!(LineScan::parse(&request(&demand)).err(), Some(LineScanError::Corrupted), "{demand:?}");
        let mut renamed = request(&demand);
        renamed[..4].copy_from_slice(b"NFLS");
        assert_eq!(Request::parse(&renamed), None, "{demand:?}");
    }
}

fn header() -> PageHeader {
    PageHeader {
        source: SOURCE,
        request: 0x0304_0506,
        code: 0x5555,
        result: ResultCode::Done,
        index: 0x0708,
        count: 0x090A,
        revision: 0x0B0C_0D0E,
    }
}

fn page(data: &[u8]) -> PageBytes {
    let mut bytes = [0xEE; PAGE_LENGTH];
    encode_page(&mut bytes, &header(), data);
    bytes
}

/// Frozen: a host in the field reads exactly these bytes. Do not change the test; add a version.
#[test]
fn golden_bytes_of_a_page_version_1() {
    let bytes = page(&[0x31, 0x32, 0x33]);
    #[rustfmt::skip]
    let head = [
        b'N', b'F', b'P', b'G', 1, 0, 0x02, 0x01, 0x06, 0x05, 0x04, 0x03, 0x55, 0x55, 1, 0,
        0x08, 0x07, 0x0A, 0x09, 0x0E, 0x0D, 0x0C, 0x0B, 3, 0, 0, 0, 0x31, 0x32, 0x33, 0,
    ];
    assert_eq!(bytes[..32], head);
    assert_eq!(bytes[32..1052], [0; 1020]);
    assert_eq!(bytes[1052..], PAGE_SEAL.to_le_bytes());
    let codes = ResultCode::ALL.map(ResultCode::code);
    assert_eq!(codes, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]);
}
/// Computed bit by bit outside this project's code from the catalogue's parameters.
const PAGE_SEAL: u32 = 0x48EB_75A5;

#[test]
fn every_result_has_words_of_its_own() {
    let words: std::collections::BTreeSet<_> = ResultCode::ALL.map(ResultCode::words).into();
    assert_eq!(words.len(), ResultCode::ALL.len());
}

#[test]
fn pages_of_every_length_and_result_are_read_back() {
    let data: Vec<u8> = (0..PAGE_DATA_LENGTH + 1).map(|index| index as u8 | 1).collect();
    for length in [0, 1, PAGE_DATA_LENGTH - 1, PAGE_DATA_LENGTH] {
        let bytes = page(&data[..length]);
        assert_eq!(Page::parse(&bytes), Ok(Page { header: header(), data: &data[..length] }));
    }
    assert_eq!(
        Page::parse(&page(&data)).unwrap().data,
        &data[..PAGE_DATA_LENGTH],
        "what does not fit is cut"
    );
    for result in ResultCode::ALL {
        let mut bytes = NO_PAGE;
        encode_page(&mut bytes, &PageHeader { result, ..header() }, &[]);
        assert_eq!(Page::parse(&bytes).unwrap().header.result, result);
    }
}

#[test]
fn a_page_stands_behind_the_status_or_is_absent() {
    let mut transaction = [0_u8; LINE_SCAN_LENGTH];
    transaction[..PAGE_OFFSET].fill(0xEE);
    assert_eq!(Page::find(&transaction), Ok(None));
    transaction[PAGE_OFFSET..PAGE_OFFSET + PAGE_LENGTH].copy_from_slice(&page(b"x"));
    assert_eq!(Page::find(&transaction).unwrap().unwrap().data, b"x");
    let end = PAGE_OFFSET + PAGE_LENGTH;
    assert!(Page::find(&transaction[..end]).unwrap().is_some());
    for length in [0, PAGE_OFFSET - 1, PAGE_OFFSET, end - 1] {
        assert_eq!(Page::find(&transaction[..length]), Err(PageError::Length), "{length} bytes");
    }
}

#[test]
fn each_rule_of_a_page_has_its_error() {
    let with = |offset: usize, value: u8| {
        let mut bytes = page(b"abc");
        bytes[offset] = value;
        wire::seal(&mut bytes);
        Page::parse(&bytes).err()
    };
    let mut damaged = page(b"abc");
    damaged[40] ^= 1;
    assert_eq!(Page::parse(&damaged), Err(PageError::Corrupted));
    assert_eq!(with(0, 0), Some(PageError::Magic));
    assert_eq!(with(4, 2), Some(PageError::Version));
    for (offset, value) in [(14, 0), (14, 17), (15, 1), (24, 2), (25, 5), (26, 1), (27, 1), (1051, 1)] {
        assert_eq!(with(offset, value), Some(PageError::Field), "{offset} = {value}");
    }
    assert_eq!(with(24, 4), None, "a zero may be data");
    let words =
        [PageError::Length, PageError::Corrupted, PageError::Magic, PageError::Version, PageError::Field]
            .map(|error| error.to_string());
    assert_eq!(std::collections::BTreeSet::from(words).len(), 5);
}

fn summary() -> Summary {
    Summary {
        time: Micros::new(0x0102_0304_0506_0708),
        sequence: SequenceNumber::new(0x0910_1112),
        live_causes: StopCauses::from_bits(0x1314_1516),
        new_causes: StopCauses::NONE.with(StopCause::StripeCut),
        state: StateCode::Stopped,
        kind: ExchangeKind::Accepted,
        laser_level: 0x17,
        voted_gap: Some(Millimetres::new(7.5)),
        single_gap: None,
        gap_start: Millimetres::new(-3.0),
        highest: Some(Millimetres::new(52.25)),
        lowest: None,
        longest_unknown: Millimetres::new(2.0),
        capture_age: Micros::new(21_000),
        decision_age: Micros::new(31_000),
        liveness_score: 0x1819,
        audit_score: 0x2021,
        floor_columns: 0x2223,
        watched_columns: 0x2425,
    }
}

/// Frozen: kept stops in the field are read by this form. Do not change the test; add a version.
#[test]
fn golden_bytes_of_a_summary() {
    #[rustfmt::skip]
    let golden = [
        8, 7, 6, 5, 4, 3, 2, 1, 0x12, 0x11, 0x10, 0x09, 0x16, 0x15, 0x14, 0x13, 1, 0, 0, 0,
        0x69, 1, 0x17, 0, 0x4C, 0x1D, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF, 0x48, 0xF4, 0xFF, 0xFF,
        0x1A, 0xCC, 0, 0, 0xFF, 0xFF, 0xFF, 0x7F, 0xD0, 0x07, 0, 0, 0x08, 0x52, 0, 0, 0x18, 0x79, 0, 0,
        0x19, 0x18, 0x21, 0x20, 0x23, 0x22, 0x25, 0x24,
    ];
    assert_eq!(summary().to_bytes(), golden);
    assert_eq!(Summary::parse(&golden), Some(summary()));
}

#[test]
fn a_summary_of_every_kind_and_state_is_read_back_and_nothing_else_is() {
    for kind in ExchangeKind::ALL {
        for state in StateCode::ALL {
            let one = Summary { kind, state, ..summary() };
            assert_eq!(Summary::parse(&one.to_bytes()), Some(one));
        }
    }
    let quiet = Summary::new(Micros::ZERO, StateCode::SelfTest, ExchangeKind::Poll);
    assert_eq!(Summary::parse(&quiet.to_bytes()), Some(quiet));
    let other = Summary {
        voted_gap: None,
        single_gap: Some(Millimetres::ZERO),
        highest: None,
        lowest: Some(Millimetres::new(-6.0)),
        ..summary()
    };
    assert_eq!(Summary::parse(&other.to_bytes()), Some(other));
    assert_eq!(Summary::parse(&[0; SUMMARY_LENGTH]), None, "an empty slot");
    for (offset, value) in [(20, 0x68), (21, 0), (21, 6), (23, 1)] {
        let mut bytes = summary().to_bytes();
        bytes[offset] = value;
        assert_eq!(Summary::parse(&bytes), None, "{offset} = {value}");
    }
    let names: std::collections::BTreeSet<_> = ExchangeKind::ALL.map(ExchangeKind::name).into();
    assert_eq!(names.len(), 5);
}

#[test]
fn a_summary_takes_what_decides_from_the_monitors_report() {
    let report = StripeReport {
        cutoff: Cutoff {
            voted: Some(Gap::between(1.0, 8.0)),
            single: Some(Gap::between(-20.0, 4.0)),
            floor_columns: 11,
        },
        heights: Heights {
            highest: Some(Extreme { height: Millimetres::new(9.0), place: Millimetres::ZERO }),
            lowest: Some(Extreme { height: Millimetres::new(-7.0), place: Millimetres::ZERO }),
            longest_unknown: Millimetres::new(3.0),
        },
        large: false,
        watched_columns: 12,
        passed: None,
    };
    let one = Summary::new(Micros::ZERO, StateCode::Running, ExchangeKind::Accepted).with_report(&report);
    assert_eq!(one.voted_gap, Some(Millimetres::new(7.0)));
    assert_eq!(one.single_gap, Some(Millimetres::new(24.0)));
    assert_eq!(one.gap_start, Millimetres::new(-20.0), "the longer one trips at once and is told");
    assert_eq!(one.highest, Some(Millimetres::new(9.0)));
    assert_eq!(one.lowest, Some(Millimetres::new(-7.0)));
    assert_eq!(one.longest_unknown, Millimetres::new(3.0));
    assert_eq!((one.floor_columns, one.watched_columns), (11, 12));
}

fn index() -> StopIndex {
    StopIndex {
        stop: 0x0102_0304,
        time: Micros::new(0x0506_0708_090A_0B0C),
        causes: StopCauses::from_bits(0x0D0E_0F10),
        firmware: 0x1112_1314,
        calibration: Some(CalibrationId::new(0x1516_1718)),
        summaries: 64,
        summaries_before: 48,
        scans: 4,
        scans_before: 3,
        complete: true,
    }
}

/// Frozen: hosts in the field read exactly these bytes. Do not change the test; add a version.
#[test]
fn golden_bytes_of_a_stop_index() {
    #[rustfmt::skip]
    let golden = [
        4, 3, 2, 1, 0x0C, 0x0B, 0x0A, 9, 8, 7, 6, 5, 0x10, 0x0F, 0x0E, 0x0D, 0x14, 0x13, 0x12, 0x11,
        0x18, 0x17, 0x16, 0x15, 64, 0, 48, 0, 4, 0, 3, 0, 1, 0, 0, 0, 0, 0, 0, 0,
    ];
    assert_eq!(index().to_bytes(), golden);
    assert_eq!(StopIndex::parse(&golden), Some(index()));
}

#[test]
fn a_stop_index_that_contradicts_itself_is_none() {
    for good in [
        StopIndex { calibration: None, complete: false, ..index() },
        StopIndex { summaries: 0, summaries_before: 0, scans: 0, scans_before: 0, ..index() },
        StopIndex { summaries_before: 64, scans_before: 4, ..index() },
    ] {
        assert_eq!(StopIndex::parse(&good.to_bytes()), Some(good));
    }
    for bad in [
        StopIndex { stop: 0, ..index() },
        StopIndex { summaries: 65, ..index() },
        StopIndex { summaries: 47, ..index() },
        StopIndex { scans: 2, ..index() },
    ] {
        assert_eq!(StopIndex::parse(&bad.to_bytes()), None, "{bad:?}");
    }
    for (offset, value) in [(32, 2), (33, 1), (39, 1)] {
        let mut bytes = index().to_bytes();
        bytes[offset] = value;
        assert_eq!(StopIndex::parse(&bytes), None, "{offset} = {value}");
    }
    assert_eq!(StopIndex::parse(&index().to_bytes()[..39]), None);
}

fn entry() -> FaultEntry {
    FaultEntry {
        number: 0x0102_0304,
        power_cycle: PowerCycle::new(0x0506_0708),
        time: Micros::new(0x090A_0B0C_0D0E_0F10),
        status: 0x1112_1314,
        causes: StopCauses::from_bits(0x1516_1718),
        event: FaultEvent::LockedOut,
        state: StateCode::Lockout,
        reset_cause: ResetCause::Pin,
        fault: 0x19,
        detail: 0x2021_2223,
    }
}

/// Frozen: logs in the field are kept in this form. Do not change the test; add a version.
#[test]
fn golden_bytes_of_a_fault_entry() {
    #[rustfmt::skip]
    let golden = [
        4, 3, 2, 1, 8, 7, 6, 5, 0x10, 0x0F, 0x0E, 0x0D, 0x0C, 0x0B, 0x0A, 9, 0x14, 0x13, 0x12, 0x11,
        0x18, 0x17, 0x16, 0x15, 3, 0xF0, 2, 0x19, 0x23, 0x22, 0x21, 0x20,
    ];
    assert_eq!(entry().to_bytes(), golden);
    assert_eq!(FaultEntry::parse(&golden), Some(entry()));
}

#[test]
fn a_fault_entry_with_an_unknown_code_is_none() {
    for event in FaultEvent::ALL {
        for reset_cause in ResetCause::ALL {
            let one = FaultEntry { event, reset_cause, ..entry() };
            assert_eq!(FaultEntry::parse(&one.to_bytes()), Some(one));
        }
    }
    let mut zero = entry().to_bytes();
    zero[..4].fill(0);
    assert_eq!(FaultEntry::parse(&zero), None, "number 0");
    for (offset, value) in [(24, 0), (24, 5), (25, 1), (26, 0), (26, 99)] {
        let mut bytes = entry().to_bytes();
        bytes[offset] = value;
        assert_eq!(FaultEntry::parse(&bytes), None, "{offset} = {value}");
    }
    assert_eq!(FaultEntry::parse(&entry().to_bytes()[..31]), None);
    let names: std::collections::BTreeSet<_> = FaultEvent::ALL.map(FaultEvent::name).into();
    assert_eq!(names.len(), 4);
    assert_eq!(PowerCycle::new(u32::MAX).next(), PowerCycle::new(u32::MAX));
    assert_eq!(PowerCycle::new(6).next().get(), 7);
}

proptest! {
    #[test]
    fn garbage_is_neither_request_nor_page(bytes in proptest::collection::vec(any::<u8>(), LINE_SCAN_LENGTH)) {
        prop_assert_eq!(Request::parse(&bytes), None);
        prop_assert!(Page::find(&bytes).is_err());
    }

    #[test]
    fn a_whole_request_is_understood_or_has_a_code(
        version in 0_u16..3,
        code in prop_oneof![any::<u16>(), Just(READ_BLACK_BOX), Just(STORE_RIG), Just(ACKNOWLEDGE_RIG)],
        length in prop_oneof![Just(0_u16), Just(160), any::<u16>()],
        argument: u32,
        payload: u8,
    ) {
        let mut message = [0_u8; LINE_SCAN_LENGTH];
        message[..4].copy_from_slice(b"NFSQ");
        message[4..6].copy_from_slice(&version.to_le_bytes());
        message[12..14].copy_from_slice(&code.to_le_bytes());
        message[14..16].copy_from_slice(&length.to_le_bytes());
        message[16..20].copy_from_slice(&argument.to_le_bytes());
        message[20..180].fill(payload);
        wire::seal(&mut message[..REQUEST_LENGTH]);
        let request = Request::parse(&message).unwrap();
        prop_assert_eq!(request.code, code);
        // What is understood is written again as the same bytes: nothing was ignored.
        if let Ok(demand) = request.demand {
            let mut again = [0; LINE_SCAN_LENGTH];
            encode_request(&mut again, request.source, request.number, &demand);
            prop_assert_eq!(&again[..], &message[..]);
        }
    }

    #[test]
    fn any_data_travels_in_a_page(data in proptest::collection::vec(any::<u8>(), 0..=PAGE_DATA_LENGTH)) {
        let bytes = page(&data);
        prop_assert_eq!(Page::parse(&bytes).unwrap().data, &data[..]);
    }

    #[test]
    fn any_summary_bytes_are_read_without_loss_or_not_at_all(bytes: [u8; 32], more: [u8; 32]) {
        let mut all = [0; SUMMARY_LENGTH];
        all[..32].copy_from_slice(&bytes);
        all[32..].copy_from_slice(&more);
        all[20] = 0x55;
        all[21] = 1 + all[21] % 5;
        all[23] = 0;
        let read = Summary::parse(&all).unwrap();
        // Lengths beyond 2^23 micrometres (8 m, which no stripe has) lose their last digits in f32, each time anew.
        let twice = Summary::parse(&read.to_bytes()).unwrap();
        prop_assert_eq!((twice.state, twice.kind, twice.live_causes), (read.state, read.kind, read.live_causes));
        prop_assert_eq!((twice.time, twice.sequence, twice.new_causes), (read.time, read.sequence, read.new_causes));
    }

    #[test]
    fn any_fault_entry_bytes_are_read_without_loss_or_not_at_all(bytes: [u8; FAULT_ENTRY_LENGTH]) {
        if let Some(entry) = FaultEntry::parse(&bytes) {
            prop_assert_eq!(entry.to_bytes(), bytes);
        }
    }
}

#[test]
fn only_exchanges_with_a_line_scan_have_accepted_one() {
    let accepted = ExchangeKind::ALL.map(ExchangeKind::is_accepted);
    assert_eq!(accepted, [true, true, false, false, false]);
}

/// Host and controller count the pages alike: 64 summaries of 64 bytes, 16 a page; a line-scan has pages of its own.
#[test]
fn the_black_box_has_the_pages_that_its_table_says() {
    assert_eq!((SUMMARY_COUNT, SUMMARY_LENGTH, PAGE_DATA_LENGTH / SUMMARY_LENGTH), (64, 64, 16));
    assert_eq!(SUMMARY_PAGES, 4);
    assert_eq!(PAGES_PER_SCAN, LINE_SCAN_LENGTH.div_ceil(PAGE_DATA_LENGTH));
}
