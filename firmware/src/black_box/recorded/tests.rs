//! The recorder's rules: it changes nothing, and it misses nothing.

use super::*;
use crate::selftest::{SelfTestKind, SelfTestReport};
use crate::store::StoreError;
use crate::testing::{Bench, SOURCE, rig};
use nearfield_shared::causes::StopCause;
use nearfield_shared::condition::ResetCause;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::rig::COMPACT_LENGTH;
use nearfield_shared::service::{
    Demand, NO_PAGE, PAGE_DATA_LENGTH, Page, ResultCode, SUMMARY_LENGTH, StopIndex, encode_request,
};
use nearfield_shared::units::{CalibrationId, SequenceNumber};

type Recorded = RecordedController<Box<LineScanMonitor>, Box<RecorderMemory>>;

/// A bare controller and a recorded one, given the same: every output and every status must be the same.
struct Pair {
    bench: Bench,
    recorded: Recorded,
    requests: u32,
}

impl Pair {
    fn new() -> Self {
        let bench = Bench::after(ResetCause::PowerOn);
        let controller = SafetyController::new(SOURCE, Box::new(LineScanMonitor::new()));
        let mut recorded = RecordedController::new(controller, Box::new(RecorderMemory::new(SOURCE)));
        let stored_rig = rig().to_bytes();
        let reset_cause = ResetCause::PowerOn;
        recorded.start(&StartInputs { reset_cause, stored_rig: &stored_rig, secret: [5; 16] }).unwrap();
        Self { bench, recorded, requests: 0 }
    }

    /// `bare` is what the bare controller gets in place of `message`.
    fn exchange_as(&mut self, message: Option<&[u8]>, bare: Option<&[u8]>) {
        assert_eq!(self.bench.controller.status(self.bench.now), self.recorded.status(self.bench.now));
        let outputs = self.bench.exchange(bare);
        assert_eq!(self.recorded.on_exchange(self.bench.now, message), outputs);
        assert_eq!(self.recorded.outputs(), outputs);
    }

    fn tick(&mut self) {
        let (now, pins) = (self.bench.now, self.bench.pins);
        let expected = self.bench.tick();
        let self_test = self.bench.self_test.unwrap_or(SelfTestReport::passed(now));
        let inputs = TickInputs { pins, self_test };
        let output = self.recorded.tick(now, inputs);
        assert_eq!(output.outputs, expected.outputs);
        assert_eq!(output.permit.is_some(), expected.permit.is_some());
    }

    fn ticks(&mut self) {
        for _ in 0..4 {
            self.tick();
        }
    }

    fn frame(&mut self, message: Option<&[u8]>) {
        self.exchange_as(message, message);
        self.ticks();
    }

    fn clean_frame(&mut self) {
        let scan = self.bench.scan(Some(0.0), HostVerdict::Clear);
        self.frame(Some(&scan));
    }

    fn arm(&mut self) {
        self.frame(None);
        for frame in 0..65 {
            self.bench.pins.reset_pressed = (25..31).contains(&frame);
            self.clean_frame();
        }
        assert_eq!(self.recorded.outputs().relays, Channels::CLOSED);
    }

    /// A frame with a request instead of a line-scan; the job that it yields.
    fn request(&mut self, demand: &Demand<'_>) -> Option<FlashJob> {
        self.requests += 1;
        let mut message = [0; LINE_SCAN_LENGTH];
        encode_request(&mut message, SOURCE, self.requests, demand);
        self.exchange_as(Some(&message), None);
        self.ticks();
        self.recorded.take_job()
    }

    fn page(&self) -> Page<'_> {
        Page::parse(self.recorded.page()).unwrap()
    }

    fn events(&mut self) -> Vec<FaultEvent> {
        self.recorded.fault_log().entries().map(|entry| entry.event).collect()
    }

    fn index(&mut self) -> Option<StopIndex> {
        let _ = self.request(&Demand::ReadBlackBox { page: 0 });
        StopIndex::parse(self.page().data)
    }

    fn kinds(&self) -> Vec<ExchangeKind> {
        let black_box = &self.recorded.recorder.black_box;
        let mut data = [0; PAGE_DATA_LENGTH];
        let mut kinds = Vec::new();
        for page in 1..=4 {
            let length = black_box.page(page, &mut data).unwrap().length;
            let summaries = data[..length].chunks(SUMMARY_LENGTH);
            kinds.extend(summaries.map(|bytes| Summary::parse(bytes.try_into().unwrap()).unwrap().kind));
        }
        kinds
    }
}

#[test]
fn a_stop_by_the_stripe_is_recorded_with_its_line_scans_and_its_cause() {
    let mut pair = Pair::new();
    assert_eq!(pair.index(), None);
    pair.arm();
    let object = pair.bench.scan(Some(30.0), HostVerdict::Clear);
    let stopped = pair.bench.now;
    pair.frame(Some(&object));
    assert_eq!(pair.recorded.outputs().relays, Channels::OPEN);
    let index = pair.index().unwrap();
    assert_eq!((index.stop, index.time), (1, stopped));
    assert!(index.causes.contains(StopCause::StripeCut), "{:?}", index.causes);
    assert_eq!(index.calibration, pair.recorded.controller().calibration());
    assert_eq!((index.scans, index.scans_before), (3, 3));
    let scans: Vec<_> = pair.recorded.recorder.black_box.scans_for_test().collect();
    assert_eq!(scans[2][..], object[..], "the deciding one, as it came");
    assert_eq!(pair.events(), [FaultEvent::Started, FaultEvent::Stopped]);
    let entry = pair.recorded.fault_log().entries().last().unwrap();
    assert_eq!((entry.time, entry.causes, entry.state), (stopped, index.causes, StateCode::Stopped));
}

#[test]
fn a_stop_by_silence_and_a_refusal_are_told_apart_in_the_summaries() {
    let mut pair = Pair::new();
    pair.arm();
    for _ in 0..5 {
        pair.frame(None);
    }
    let index = pair.index().unwrap();
    assert!(index.causes.contains(StopCause::LinkTimeout), "{:?}", index.causes);
    // The first line-scan after the silence begins the votes anew; a damaged one is refused.
    pair.clean_frame();
    let mut damaged = pair.bench.scan(Some(0.0), HostVerdict::Clear);
    damaged[77] ^= 1;
    pair.frame(Some(&damaged));
    let kinds = pair.kinds();
    assert!(kinds.contains(&ExchangeKind::Poll) && kinds.contains(&ExchangeKind::Tick), "{kinds:?}");
    let after: Vec<_> = kinds[usize::from(index.summaries_before)..]
        .iter()
        .filter(|kind| !matches!(kind, ExchangeKind::Poll | ExchangeKind::Tick))
        .collect();
    assert_eq!(after, [&ExchangeKind::AcceptedAfterSilence, &ExchangeKind::Refused]);
}

#[test]
fn a_request_while_running_neither_stops_nor_counts_as_a_line_scan() {
    let mut pair = Pair::new();
    pair.arm();
    let before = pair.recorded.controller().findings();
    for demand in [Demand::ReadFaultLog { page: 0 }, Demand::StoreRig { rig: &rig().to_bytes() }] {
        assert_eq!(pair.request(&demand), None);
        pair.clean_frame();
    }
    assert_eq!(pair.page().header.result, ResultCode::ServiceKeyOpen);
    let after = pair.recorded.controller().findings();
    assert_eq!(after.relays, Channels::CLOSED, "one request between line-scans is a frame's loss, no more");
    assert_eq!(after.accepted, before.accepted + 2);
    // Nothing but requests is silence.
    for _ in 0..5 {
        let _ = pair.request(&Demand::ReadRig);
    }
    assert_eq!(pair.recorded.outputs().relays, Channels::OPEN);
}

#[test]
fn a_request_that_is_damaged_is_judged_as_a_damaged_line_scan() {
    let mut pair = Pair::new();
    pair.arm();
    let mut message = [0; LINE_SCAN_LENGTH];
    encode_request(&mut message, SOURCE, 1, &Demand::ReadRig);
    message[8] ^= 1;
    pair.frame(Some(&message));
    assert_eq!(*pair.recorded.page(), NO_PAGE);
    pair.frame(Some(&message));
    assert_eq!(pair.recorded.outputs().relays, Channels::OPEN, "the second one in a minute stops");
}

#[test]
fn a_change_needs_the_key_at_the_pin_and_contacts_that_are_open() {
    let store = Demand::StoreRig { rig: &[1; COMPACT_LENGTH] };
    let mut pair = Pair::new();
    pair.ticks();
    assert_eq!(pair.request(&store), None);
    assert_eq!(pair.page().header.result, ResultCode::ServiceKeyOpen);
    pair.bench.pins.service_key = true;
    pair.ticks();
    assert_eq!(pair.request(&store), Some(FlashJob::StoreRig([1; COMPACT_LENGTH])));
    assert_eq!(pair.recorded.take_job(), None, "each job is given once");
    pair.recorded.finish_job(Micros::new(1), &Err(StoreError::Flash));
    assert_eq!(pair.page().header.result, ResultCode::Flash);
    // A contact that does not say "open".
    pair.bench.pins.mirror = MirrorContacts { a: true, b: false };
    let now = pair.bench.now;
    let inputs = TickInputs { pins: pair.bench.pins, self_test: SelfTestReport::passed(now) };
    pair.bench.controller.tick(now, inputs);
    pair.recorded.tick(now, inputs);
    pair.requests += 1;
    let mut message = [0; LINE_SCAN_LENGTH];
    encode_request(&mut message, SOURCE, pair.requests, &store);
    pair.exchange_as(Some(&message), None);
    assert_eq!(pair.page().header.result, ResultCode::RelaysNotOpen);
}

#[test]
fn a_changed_rig_and_a_lock_out_are_in_the_fault_log_until_saved() {
    let mut pair = Pair::new();
    pair.bench.pins.service_key = true;
    pair.ticks();
    assert!(pair.request(&Demand::ReadCandidate).is_some());
    let mut compact = [0; COMPACT_LENGTH];
    compact[COMPACT_LENGTH - 4..].copy_from_slice(&[4, 3, 2, 1]);
    pair.recorded.finish_job(pair.bench.now, &Ok(Some(compact)));
    let calibration = CalibrationId::new(0x0102_0304);
    assert!(pair.request(&Demand::AcknowledgeRig { calibration }).is_some());
    pair.recorded.finish_job(pair.bench.now, &Ok(None));
    let changed = pair.recorded.fault_log().entries().last().unwrap();
    assert_eq!((changed.event, changed.detail), (FaultEvent::RigChanged, 0x0102_0304));

    // A failed self-test locks out; one entry, however long it lasts.
    let mut pair = Pair::new();
    pair.ticks();
    let now = pair.bench.now;
    pair.bench.self_test =
        Some(SelfTestReport { failed: Some(SelfTestKind::Memory), ..SelfTestReport::passed(now) });
    for _ in 0..10 {
        pair.frame(None);
    }
    let events = pair.events();
    assert_eq!(events.iter().filter(|event| **event == FaultEvent::LockedOut).count(), 1, "{events:?}");
    let locked = pair.recorded.fault_log().entries().last().unwrap();
    assert!(locked.fault != 0 && locked.state == StateCode::Lockout, "{locked:?}");
    let first = pair.recorded.unsaved_fault().unwrap();
    assert_eq!((first.number, first.event), (1, FaultEvent::Started));
    pair.recorded.fault_saved(&first);
    assert_eq!(pair.recorded.unsaved_fault().unwrap().number, 2);
}

/// Every figure of a summary is the controller's own.
#[test]
fn a_summary_tells_what_the_controller_found() {
    let mut pair = Pair::new();
    pair.arm();
    let known = pair.recorded.controller.findings();
    let both = StopCauses::NONE.with(StopCause::StripeCut).with(StopCause::Drop);
    pair.recorded.causes = StopCauses::NONE.with(StopCause::Drop);
    let findings = Findings {
        sequence: SequenceNumber::new(77),
        causes: both,
        laser_level: 123,
        decision_age: Micros::new(33_000),
        liveness_doubt: 9,
        audit_doubt: 11,
        ..known
    };
    let summary = pair.recorded.summary_of(Micros::new(5), ExchangeKind::Poll, &findings);
    assert_eq!((summary.time, summary.kind), (Micros::new(5), ExchangeKind::Poll));
    assert_eq!((summary.sequence, summary.laser_level), (findings.sequence, 123));
    assert_eq!(summary.live_causes, both);
    assert_eq!(
        summary.new_causes,
        StopCauses::NONE.with(StopCause::StripeCut),
        "the other one is known already"
    );
    assert_eq!(summary.decision_age, findings.decision_age);
    assert_eq!((summary.liveness_score, summary.audit_score), (9, 11));
}

#[test]
fn the_capture_age_is_the_host_s_word() {
    let mut pair = Pair::new();
    let scan = pair.bench.scan(Some(0.0), HostVerdict::Clear);
    let line_scan = nearfield_shared::linescan::LineScan::parse(&scan).unwrap();
    let header = line_scan.header();
    assert!(header.capture_age > Micros::ZERO);
    assert_eq!(told_capture_age(&scan), header.capture_age);
    assert_eq!(told_capture_age(&scan[..19]), Micros::ZERO);
}

/// The very first exchange after the relays have closed can stop, and that stop is kept.
#[test]
fn a_stop_right_after_closing_is_kept() {
    let mut pair = Pair::new();
    pair.frame(None);
    let mut frame = 0;
    while pair.recorded.outputs().relays == Channels::OPEN {
        pair.bench.pins.reset_pressed = (25..31).contains(&frame);
        let scan = pair.bench.scan(Some(0.0), HostVerdict::Clear);
        pair.exchange_as(Some(&scan), Some(&scan));
        for _ in 0..4 {
            if pair.recorded.outputs().relays == Channels::OPEN {
                pair.tick();
            }
        }
        frame += 1;
        assert!(frame < 100, "never closed");
    }
    let object = pair.bench.scan(Some(30.0), HostVerdict::Clear);
    pair.exchange_as(Some(&object), Some(&object));
    assert_eq!(pair.recorded.outputs().relays, Channels::OPEN);
    pair.ticks();
    assert_eq!(pair.index().unwrap().stop, 1);
}
