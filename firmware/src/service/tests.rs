//! The service's rules: reading always, changing only with key, open relays and standstill, in the order of steps.

use super::*;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::rig::CompactRigError;
use nearfield_shared::service::{FAULT_ENTRY_LENGTH, FaultEntry, Page, StopIndex, encode_request};
use nearfield_shared::status::ResetCause;
use nearfield_shared::units::Micros;

const SOURCE: SourceId = SourceId::new(7);
const ALLOWED: Permissions =
    Permissions { service_key: true, relays_proven_open: true, state: StateCode::Stopped };
const RUNNING: Permissions =
    Permissions { service_key: false, relays_proven_open: false, state: StateCode::Running };

/// Any bytes with a seal of their own: their content is the store's business.
fn rig(byte: u8) -> [u8; COMPACT_LENGTH] {
    [byte; COMPACT_LENGTH]
}

fn id(byte: u8) -> CalibrationId {
    CalibrationId::new(u32::from_le_bytes([byte; 4]))
}

/// A service with its records, and a host that numbers its requests.
struct Desk {
    service: Service,
    black_box: BlackBox,
    fault_log: FaultLog,
    number: u32,
}

impl Desk {
    fn new() -> Self {
        let (black_box, fault_log) = (BlackBox::new(), FaultLog::new());
        Self { service: Service::new(SOURCE), black_box, fault_log, number: 0 }
    }

    fn send(&mut self, message: &[u8], permissions: &Permissions) -> Option<FlashJob> {
        let records = Records { black_box: &self.black_box, fault_log: &self.fault_log };
        self.service.answer(&Request::parse(message).unwrap(), permissions, &records)
    }

    fn message(&mut self, demand: &Demand<'_>) -> [u8; LINE_SCAN_LENGTH] {
        let mut message = [0; LINE_SCAN_LENGTH];
        self.number += 1;
        encode_request(&mut message, SOURCE, self.number, demand);
        message
    }

    fn ask(&mut self, demand: &Demand<'_>, permissions: &Permissions) -> (ResultCode, Option<FlashJob>) {
        let message = self.message(demand);
        let job = self.send(&message, permissions);
        let page = self.page();
        assert_eq!((page.header.request, page.header.code), (self.number, demand.code()));
        (page.header.result, job)
    }

    fn page(&self) -> Page<'_> {
        let page = Page::parse(self.service.page()).unwrap();
        assert_eq!(page.header.source, SOURCE);
        page
    }

    fn result(&self) -> ResultCode {
        self.page().header.result
    }

    /// Stores and reads back, as far as the service goes.
    fn with_candidate(byte: u8) -> Self {
        let mut desk = Self::new();
        let rig = rig(byte);
        assert_eq!(
            desk.ask(&Demand::StoreRig { rig: &rig }, &ALLOWED),
            (ResultCode::Working, Some(FlashJob::StoreRig(rig)))
        );
        assert_eq!(desk.service.finish(&Ok(None)), None);
        assert_eq!(desk.result(), ResultCode::Done);
        assert_eq!(desk.ask(&Demand::ReadCandidate, &ALLOWED).1, Some(FlashJob::ReadCandidate));
        assert_eq!(desk.service.finish(&Ok(Some(rig))), None);
        assert_eq!((desk.result(), desk.page().data), (ResultCode::Done, &rig[..]));
        desk
    }
}

#[test]
fn reading_is_always_allowed_also_while_running() {
    let mut desk = Desk::new();
    assert_eq!(*desk.service.page(), NO_PAGE);
    assert_eq!(desk.ask(&Demand::ReadBlackBox { page: 0 }, &RUNNING), (ResultCode::Nothing, None));
    assert_eq!(desk.ask(&Demand::ReadFaultLog { page: 0 }, &RUNNING), (ResultCode::Done, None));
    assert_eq!(desk.page().data, []);
    assert_eq!(desk.ask(&Demand::ReadRig, &RUNNING), (ResultCode::Working, Some(FlashJob::ReadRig)));
    assert_eq!(desk.service.finish(&Ok(Some(rig(5)))), None);
    assert_eq!((desk.result(), desk.page().data), (ResultCode::Done, &rig(5)[..]));
    assert_eq!(desk.ask(&Demand::ReadCandidate, &RUNNING).1, Some(FlashJob::ReadCandidate));
    assert_eq!(desk.service.finish(&Ok(None)), None);
    assert_eq!(desk.result(), ResultCode::Nothing);
}

#[test]
fn a_change_needs_key_standstill_and_open_relays_each_by_itself() {
    let rig = rig(3);
    let mut desk = Desk::with_candidate(1);
    for change in [Demand::StoreRig { rig: &rig }, Demand::AcknowledgeRig { calibration: id(1) }] {
        for (permissions, refusal) in [
            (Permissions { service_key: false, ..ALLOWED }, ResultCode::ServiceKeyOpen),
            (Permissions { relays_proven_open: false, ..ALLOWED }, ResultCode::RelaysNotOpen),
            (Permissions { state: StateCode::Running, ..ALLOWED }, ResultCode::Running),
            (Permissions { state: StateCode::Arming, ..ALLOWED }, ResultCode::Running),
            (RUNNING, ResultCode::ServiceKeyOpen),
        ] {
            assert_eq!(desk.ask(&change, &permissions), (refusal, None), "{change:?} {permissions:?}");
        }
    }
    for state in [StateCode::SelfTest, StateCode::Interlocked, StateCode::Stopped, StateCode::Lockout] {
        assert_eq!(Permissions { state, ..ALLOWED }.check_change(), Ok(()), "{state:?}");
    }
    // The refusals have not disturbed the change that was on its way.
    let acknowledge = Demand::AcknowledgeRig { calibration: id(1) };
    assert_eq!(desk.ask(&acknowledge, &ALLOWED).1, Some(FlashJob::AcknowledgeRig(id(1))));
}

#[test]
fn a_rig_comes_into_force_only_after_it_was_read_back_and_named() {
    let acknowledge = |byte| Demand::AcknowledgeRig { calibration: id(byte) };
    let mut desk = Desk::new();
    assert_eq!(desk.ask(&acknowledge(1), &ALLOWED), (ResultCode::NotReadBack, None), "nothing stored");
    let mut desk = Desk::with_candidate(1);
    assert_eq!(desk.ask(&acknowledge(2), &ALLOWED), (ResultCode::OtherCandidate, None));
    assert_eq!(
        desk.ask(&acknowledge(1), &ALLOWED),
        (ResultCode::Working, Some(FlashJob::AcknowledgeRig(id(1))))
    );
    assert_eq!(desk.service.finish(&Ok(None)), Some(id(1)));
    assert_eq!(desk.result(), ResultCode::Done);
    assert_eq!(desk.ask(&acknowledge(1), &ALLOWED), (ResultCode::NotReadBack, None), "once only");

    // A new candidate makes what was read back worthless, also one that the flash did not take.
    for outcome in [Ok(None), Err(StoreError::Flash)] {
        let mut desk = Desk::with_candidate(1);
        let _ = desk.ask(&Demand::StoreRig { rig: &rig(2) }, &ALLOWED);
        assert_eq!(desk.service.finish(&outcome), None);
        assert_eq!(desk.ask(&acknowledge(1), &ALLOWED), (ResultCode::NotReadBack, None), "{outcome:?}");
    }
}

#[test]
fn what_the_flash_refuses_is_told_and_changes_nothing() {
    for (error, result) in [
        (StoreError::Invalid(CompactRigError::Damaged), ResultCode::InvalidRig),
        (StoreError::Nothing, ResultCode::Nothing),
        (StoreError::OtherCandidate(id(9)), ResultCode::OtherCandidate),
        (StoreError::Flash, ResultCode::Flash),
    ] {
        let mut desk = Desk::with_candidate(1);
        let _ = desk.ask(&Demand::AcknowledgeRig { calibration: id(1) }, &ALLOWED);
        assert_eq!(desk.service.finish(&Err(error)), None);
        assert_eq!((desk.result(), desk.page().data), (result, &[][..]));
        let _ = desk.ask(&Demand::ReadRig, &ALLOWED);
        assert_eq!(desk.service.finish(&Err(error)), None);
        assert_eq!(desk.result(), result);
        assert!(!error.to_string().is_empty());
    }
}

#[test]
fn while_the_flash_works_everything_else_waits_but_the_records() {
    let mut desk = Desk::new();
    assert!(desk.ask(&Demand::ReadRig, &ALLOWED).1.is_some());
    let number = desk.number;
    for demand in [Demand::ReadRig, Demand::ReadCandidate, Demand::StoreRig { rig: &rig(1) }] {
        assert_eq!(desk.ask(&demand, &ALLOWED), (ResultCode::Busy, None), "{demand:?}");
    }
    assert_eq!(desk.ask(&Demand::ReadFaultLog { page: 0 }, &ALLOWED).0, ResultCode::Done);
    desk.service.finish(&Ok(Some(rig(4))));
    assert_eq!(
        (desk.page().header.request, desk.page().data),
        (number, &rig(4)[..]),
        "the first one's answer"
    );
    assert_eq!(desk.service.finish(&Ok(Some(rig(5)))), None);
    assert_eq!(desk.page().data, rig(4), "nobody waits for a second outcome");
}

#[test]
fn a_request_that_is_repeated_is_carried_out_once() {
    let mut desk = Desk::new();
    let message = desk.message(&Demand::StoreRig { rig: &rig(1) });
    assert!(desk.send(&message, &ALLOWED).is_some());
    assert_eq!(desk.send(&message, &ALLOWED), None, "while it is worked on");
    assert_eq!(desk.result(), ResultCode::Working);
    desk.service.finish(&Ok(None));
    assert_eq!(desk.send(&message, &ALLOWED), None, "a stuck host does not wear the flash out");
    assert_eq!(desk.result(), ResultCode::Done);
    let again = desk.message(&Demand::StoreRig { rig: &rig(1) });
    assert!(desk.send(&again, &ALLOWED).is_some(), "another number is another request");
}

#[test]
fn what_is_not_understood_or_not_ours_is_refused_with_its_code() {
    let mut desk = Desk::new();
    let mut message = [0; LINE_SCAN_LENGTH];
    encode_request(&mut message, SourceId::new(8), 1, &Demand::ReadRig);
    assert_eq!(desk.send(&message, &ALLOWED), None);
    assert_eq!(desk.result(), ResultCode::OtherModule);
    // An unknown kind, sealed by hand: the CRC stands behind the first 180 bytes.
    let mut message = [0; LINE_SCAN_LENGTH];
    encode_request(&mut message, SOURCE, 2, &Demand::ReadRig);
    message[12] = 0xFF;
    let seal = nearfield_shared::wire::checksum(&message[..180]).to_le_bytes();
    message[180..184].copy_from_slice(&seal);
    assert_eq!(desk.send(&message, &ALLOWED), None);
    assert_eq!((desk.result(), desk.page().header.code), (ResultCode::UnknownKind, 0x66FF));
}

#[test]
fn records_are_read_page_by_page() {
    let mut desk = Desk::new();
    desk.black_box.armed();
    desk.black_box.line_scan(&[9; LINE_SCAN_LENGTH]);
    desk.black_box.stop(Micros::new(5), StopCauses::NONE.with(StopCause::Drop), None);
    assert_eq!(desk.ask(&Demand::ReadBlackBox { page: 0 }, &RUNNING).0, ResultCode::Done);
    let page = desk.page();
    assert_eq!((page.header.index, page.header.count, page.header.revision), (0, 9, 1));
    assert_eq!(StopIndex::parse(page.data).unwrap().time, Micros::new(5));
    assert_eq!(desk.ask(&Demand::ReadBlackBox { page: 8 }, &RUNNING).0, ResultCode::Done);
    let page = desk.page();
    assert_eq!((page.header.index, page.data), (8, &[9; LINE_SCAN_LENGTH - 3 * PAGE_DATA_LENGTH][..]));
    assert_eq!(desk.ask(&Demand::ReadBlackBox { page: 9 }, &RUNNING), (ResultCode::NoSuchPage, None));

    desk.fault_log.started(ResetCause::Pin, StopCauses::NONE);
    assert_eq!(desk.ask(&Demand::ReadFaultLog { page: 0 }, &RUNNING).0, ResultCode::Done);
    let page = desk.page();
    assert_eq!((page.header.count, page.header.revision, page.data.len()), (1, 1, FAULT_ENTRY_LENGTH));
    assert_eq!(FaultEntry::parse(page.data).unwrap().reset_cause, ResetCause::Pin);
    assert_eq!(desk.ask(&Demand::ReadFaultLog { page: 1 }, &RUNNING), (ResultCode::NoSuchPage, None));
}
