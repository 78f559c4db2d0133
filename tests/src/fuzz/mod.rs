//! What every fuzzer calls: one function for each parser, and one for the controller's sequence of inputs.
//!
//! Any bytes are an input. A function panics where a rule is broken; that nothing else panics (an overflow, an index)
//! is the first rule of all. Two callers: the stable test `fuzz_corpus` (the committed corpus and seeded changes of it)
//! and libFuzzer (`cargo xtask fuzz`).
//!
//! A seal stops nearly every changed message at the door. So each message is also tried with its seal made good again:
//! what stands behind the seal must not rely on it.

#![allow(clippy::missing_panics_doc, reason = "panicking is how a broken rule is told")]

mod controller;

pub use controller::{arming_frames, controller};

use nearfield_firmware::fault_log::FaultLog;
use nearfield_firmware::lockstep::{
    REPLY_LENGTH, REQUEST_HEADER_LENGTH, Reply, Request, RequestHeader, SimulatedTick,
};
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::cutoff::Gap;
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::linescan::{LARGEST_AUDIT_COUNT, LINE_SCAN_LENGTH, LineScan, encode};
use nearfield_shared::rig::{COMPACT_LENGTH, Rig};
use nearfield_shared::service::Request as ServiceRequest;
use nearfield_shared::service::{
    FAULT_ENTRY_LENGTH, FaultEntry, PAGE_LENGTH, PAGE_OFFSET, Page, REQUEST_LENGTH, STOP_INDEX_LENGTH,
    SUMMARY_LENGTH, StopIndex, Summary, encode_page, encode_request,
};
use nearfield_shared::status::{HealthFigures, PermitInUse, STATUS_LENGTH, Status};
use nearfield_shared::units::Millimetres;
use nearfield_shared::wire::{SEAL_LENGTH, checksum, is_sealed};

/// A fuzzed function. It tells whether the input got past the door: was anything of it read as a message? were the relays closed?
pub type Target = fn(&[u8]) -> bool;

/// All of them, with their names, which are the corpus's folders and the fuzzers' names as well.
pub const TARGETS: [(&str, Target); 7] = [
    ("line_scan", line_scan),
    ("status", status),
    ("compact_rig", compact_rig),
    ("service_request", service_request),
    ("service_page", service_page),
    ("lockstep_records", lockstep_records),
    ("controller", controller),
];

/// The bytes as they are, and cut or filled up to this length with a good seal.
fn with_good_seal(data: &[u8], length: usize) -> Vec<u8> {
    let mut bytes = data.to_vec();
    bytes.resize(length, 0);
    let body = length.saturating_sub(SEAL_LENGTH);
    let seal = checksum(&bytes[..body]);
    bytes[body..].copy_from_slice(&seal.to_le_bytes());
    bytes
}

/// A bit of the message, chosen by the message itself, is inverted.
fn with_wrong_bit(message: &[u8]) -> Vec<u8> {
    let mut bytes = message.to_vec();
    let bits = bytes.len() * 8;
    let bit = usize::try_from(checksum(message) >> 7).unwrap_or(0) % bits;
    bytes[bit / 8] ^= 1 << (bit % 8);
    bytes
}

/// Rules: only a sealed message of the right length is read; its counts fit its contents; what is read, written again,
/// reads as the same; a single wrong bit is refused.
pub fn line_scan(data: &[u8]) -> bool {
    let mut reached = false;
    for bytes in [data.to_vec(), with_good_seal(data, LINE_SCAN_LENGTH)] {
        let Ok(scan) = LineScan::parse(&bytes) else { continue };
        reached = true;
        assert!(bytes.len() == LINE_SCAN_LENGTH && is_sealed(&bytes), "read without a seal");
        let columns: Vec<_> = scan.columns().collect();
        let windows: Vec<_> = scan.audit_windows().collect();
        assert!((1..=LARGEST_COLUMN_COUNT).contains(&columns.len()) && windows.len() <= LARGEST_AUDIT_COUNT);
        assert_eq!(columns.len(), scan.column_count());
        assert_eq!(scan.readings().count(), columns.len());
        for (column, index) in columns.iter().zip(0..) {
            assert_eq!(scan.column(index), *column);
        }
        let mut again = [0; LINE_SCAN_LENGTH];
        encode(&mut again, scan.header(), &columns, &scan.brightness(), &windows).expect("it was read");
        let read = LineScan::parse(&again).expect("it was just written");
        assert_eq!((read.header(), read.brightness()), (scan.header(), scan.brightness()));
        assert!(read.columns().eq(columns) && read.audit_windows().eq(windows));
        assert!(LineScan::parse(&with_wrong_bit(&bytes)).is_err(), "a wrong bit is not noticed");
    }
    reached
}

/// Rules: only a sealed status is read; written again it reads as the same; a single wrong bit is refused.
pub fn status(data: &[u8]) -> bool {
    let mut reached = false;
    for bytes in [data.to_vec(), with_good_seal(data, STATUS_LENGTH)] {
        let Ok(status) = Status::parse(&bytes) else { continue };
        reached = true;
        let own = &bytes[..STATUS_LENGTH];
        assert!(is_sealed(own), "read without a seal");
        let read = Status::parse(&status.to_bytes()).expect("it was just written");
        assert_eq!(without_lengths(read), without_lengths(status));
        assert!(Status::parse(&with_wrong_bit(own)).is_err(), "a wrong bit is not noticed");
    }
    reached
}

/// Lengths of many metres, which no stripe has, lose their last micrometres on the way through an f32, and at two
/// kilometres round to "none".
fn without_lengths(status: Status) -> Status {
    let lengths = HealthFigures {
        floor_offset: Millimetres::ZERO,
        floor_rise: Millimetres::ZERO,
        smallest_object: Millimetres::ZERO,
        smallest_object_place: Millimetres::ZERO,
        ..status.health
    };
    let longest_unknown = Millimetres::ZERO;
    let run_over = status.run_over.map(|permit| PermitInUse { stretch: Gap::between(0.0, 0.0), ..permit });
    Status {
        longest_gap: None,
        highest: None,
        lowest: None,
        longest_unknown,
        health: lengths,
        run_over,
        ..status
    }
}

/// Rules: only a sealed rig within its limits is read; written again it is the same rig under the same id; the column
/// maps that follow from it, where there are any, are finite; a single wrong bit is refused.
pub fn compact_rig(data: &[u8]) -> bool {
    let mut reached = false;
    for bytes in [data.to_vec(), with_good_seal(data, COMPACT_LENGTH)] {
        let Ok(rig) = Rig::from_bytes(&bytes) else { continue };
        reached = true;
        let again = rig.to_bytes();
        let read = Rig::from_bytes(&again).expect("it was just written");
        assert_eq!((read.to_bytes(), read.calibration_id()), (again, rig.calibration_id()));
        assert!(Rig::from_bytes(&with_wrong_bit(&bytes)).is_err(), "a wrong bit is not noticed");
        // As the controller does with it; the largest pictures only take longer.
        if rig.image().width > 320 {
            continue;
        }
        let mut geometry = Box::new(StripeGeometry::<LARGEST_COLUMN_COUNT>::empty());
        if geometry.fill(&rig, Decimation::for_line_scan(rig.image().width)).is_ok() {
            assert!(!geometry.watched().is_empty(), "a rig that watches nothing");
            assert!(geometry.watched().end <= geometry.column_count());
            for map in &geometry.maps()[geometry.watched()] {
                assert!(map.floor_place.is_finite() && map.row(0.0).is_finite(), "{map:?}");
            }
        }
    }
    reached
}

/// Rules: only a whole, sealed request with nothing behind it is read; one that is understood is what its own words,
/// written again, say byte by byte.
pub fn service_request(data: &[u8]) -> bool {
    let mut reached = false;
    let mut sealed = with_good_seal(data, REQUEST_LENGTH);
    sealed.resize(LINE_SCAN_LENGTH, 0);
    for bytes in [data.to_vec(), sealed] {
        let Some(request) = ServiceRequest::parse(&bytes) else { continue };
        reached = true;
        assert!(is_sealed(&bytes[..REQUEST_LENGTH]) && bytes[REQUEST_LENGTH..].iter().all(|byte| *byte == 0));
        assert!(LineScan::parse(&bytes).is_err(), "a request is never a line-scan");
        if let Ok(demand) = &request.demand {
            let mut again = [0; LINE_SCAN_LENGTH];
            encode_request(&mut again, request.source, request.number, demand);
            assert_eq!(again[..], bytes[..]);
        }
        let mut wrong = with_wrong_bit(&bytes[..REQUEST_LENGTH]);
        wrong.resize(LINE_SCAN_LENGTH, 0);
        assert!(ServiceRequest::parse(&wrong).is_none(), "a wrong bit is not noticed");
    }
    reached
}

/// Rules: only a sealed page is read, and written again it is the same byte by byte; so is all that a page carries: the
/// stop's index, summaries and entries of the fault log, which the fault log itself takes from any flash.
pub fn service_page(data: &[u8]) -> bool {
    let mut reached = false;
    for bytes in [data.to_vec(), with_good_seal(data, PAGE_LENGTH)] {
        let mut transaction = vec![0; PAGE_OFFSET];
        transaction.extend(&bytes);
        let found = Page::find(&transaction);
        let Some(bytes) = bytes.first_chunk::<PAGE_LENGTH>() else {
            assert!(found.is_err(), "a page out of too few bytes");
            continue;
        };
        let Ok(page) = Page::parse(bytes) else { continue };
        reached = true;
        assert_eq!(found, Ok(Some(page)));
        let mut again = [0; PAGE_LENGTH];
        encode_page(&mut again, &page.header, page.data);
        assert_eq!(again, *bytes);
        page_contents(page.data);
    }
    page_contents(data);
    reached
}

fn page_contents(data: &[u8]) {
    if let Some(bytes) = data.first_chunk::<STOP_INDEX_LENGTH>() {
        if let Some(index) = StopIndex::parse(bytes) {
            assert_eq!(StopIndex::parse(&index.to_bytes()), Some(index));
        }
        assert!(bytes.len() == data.len() || StopIndex::parse(data).is_none(), "more than its own bytes");
    }
    for bytes in data.as_chunks::<SUMMARY_LENGTH>().0 {
        let Some(summary) = Summary::parse(bytes) else { continue };
        let read = Summary::parse(&summary.to_bytes()).expect("it was just written");
        let exact = |summary: &Summary| (summary.time, summary.state, summary.kind, summary.live_causes);
        assert_eq!(exact(&read), exact(&summary));
    }
    let mut log = FaultLog::new();
    for bytes in [data.to_vec(), with_good_seal(data, FAULT_ENTRY_LENGTH)] {
        log.restore(&bytes);
        for bytes in bytes.chunks(FAULT_ENTRY_LENGTH) {
            let Some(entry) = FaultEntry::parse(bytes) else { continue };
            assert_eq!(FaultEntry::parse(&entry.to_bytes()), Some(entry));
        }
    }
    assert!(log.entries().all(|entry| entry.number <= log.last_number()));
}

/// Rules: what is read as a request or a reply, written again, is the same byte by byte; a request's payload fits a
/// transfer. The stream is read record by record as the emulated controller does, until it cannot be followed.
pub fn lockstep_records(data: &[u8]) -> bool {
    let mut reached = false;
    let mut rest = data;
    while let Some((bytes, behind)) = rest.split_first_chunk::<REQUEST_HEADER_LENGTH>() {
        let Ok(header) = RequestHeader::parse(bytes) else { break };
        reached = true;
        assert_eq!(header.to_bytes(), *bytes);
        let length = usize::from(header.payload_length);
        assert!(length <= nearfield_shared::limits::LARGEST_TRANSFER);
        let Some((payload, behind)) = behind.split_at_checked(length) else { break };
        if let Request::Exchange = header.request {
            line_scan(payload);
        }
        rest = behind;
    }
    for request in [Request::Start, Request::Tick(SimulatedTick::default()), Request::Exchange, Request::Hang]
    {
        for bytes in data.as_chunks::<REPLY_LENGTH>().0 {
            if let Ok(reply) = Reply::parse(bytes, request) {
                reached = true;
                assert_eq!(reply.to_bytes(request), *bytes);
            }
        }
    }
    reached
}
