//! The client's rules: whole and consistent or not at all, and a reason that tells what to do.

use super::*;
use crate::black_box::testing::{BOX, Desk, SOURCE, ending_with, other_rig, rig};
use embassy_futures::block_on;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::condition::StateCode;
use nearfield_shared::linescan::LineScan;
use nearfield_shared::service::{FaultEvent, PAGE_OFFSET};
use nearfield_shared::units::Micros;

const CUT: StopCauses = StopCauses::NONE.with(StopCause::StripeCut);

#[test]
fn a_kept_stop_is_fetched_whole_with_rig_and_fault_log() {
    let mut desk = Desk::new();
    desk.play(&ending_with(BOX, 1), CUT);
    let mut seen = Vec::new();
    let recording = desk.client().fetch(|page, pages| seen.push((page, pages))).unwrap().unwrap();
    assert_eq!(recording.index, desk.black_box.index().unwrap());
    assert_eq!(recording.rig, Some(rig().to_bytes()));
    assert_eq!((recording.summaries.len(), recording.scans.len()), (6, 3));
    for (scan, sequence) in recording.scans.iter().zip(103..) {
        assert_eq!(LineScan::parse(&scan[..]).unwrap().header().sequence.get(), sequence);
    }
    assert_eq!(
        recording.faults.iter().map(|entry| entry.event).collect::<Vec<_>>(),
        [FaultEvent::Started, FaultEvent::Stopped]
    );
    assert!(seen.is_sorted() && seen.last() == Some(&(17, 17)), "progress goes to its end: {seen:?}");
}

#[test]
fn nothing_kept_and_nothing_stored_are_answers() {
    let mut desk = Desk::new();
    assert_eq!(desk.client().fetch(|_, _| ()).unwrap(), None);
    desk.store = nearfield_firmware::store::Store::new(Default::default(), 0);
    assert_eq!(desk.client().read_rig().unwrap(), None);
}

#[test]
fn a_rig_is_stored_read_back_and_acknowledged() {
    let mut desk = Desk::new();
    let new = other_rig();
    // As long as a page's erasure on the board takes.
    desk.working = 5;
    assert_eq!(desk.client().store_rig(&new.to_bytes()).unwrap(), new.calibration_id());
    assert_eq!(block_on(desk.store.active_rig()), Some(new.to_bytes()));
    assert_eq!(desk.client().read_rig().unwrap(), Some(new.to_bytes()));
}

#[test]
fn a_refusal_says_why_and_what_to_do() {
    let new = other_rig().to_bytes();
    for (change, expected) in [
        ((|desk: &mut Desk| desk.permissions.service_key = false) as fn(&mut Desk), "hold it"),
        (|desk| desk.permissions.state = StateCode::Running, "stop the robot first"),
        (|desk| desk.permissions.relays_proven_open = false, "both relays have dropped out"),
    ] {
        let mut desk = Desk::new();
        change(&mut desk);
        let error = desk.client().store_rig(&new).unwrap_err().to_string();
        assert!(error.contains("store a rig") && error.contains(expected), "{error}");
        assert_eq!(desk.client().read_rig().unwrap(), Some(rig().to_bytes()), "the old one stays");
    }
    let mut desk = Desk::new();
    let error = desk.client().store_rig(&[7; COMPACT_LENGTH]).unwrap_err().to_string();
    assert!(error.contains("not valid"), "{error}");
    let mut desk = Desk::new();
    let error = ServiceClient::new(&mut desk, SourceId::new(9), 0).read_rig().unwrap_err().to_string();
    assert!(error.contains("another module"), "{error}");
}

#[test]
fn a_candidate_that_is_not_what_was_sent_is_never_acknowledged() {
    let mut desk = Desk::new();
    // Somebody else stores another rig before this client has read back.
    desk.disturb = |desk, _| {
        if block_on(desk.store.candidate()).is_some() {
            let other = nearfield_shared::rig::Rig::new(
                nearfield_shared::rig::ImageSize { width: 640, height: 482 },
                *rig().camera(),
                *rig().laser(),
                *rig().stripe(),
            );
            block_on(desk.store.stage_rig(&other.unwrap().to_bytes())).unwrap();
        }
    };
    let error = desk.client().store_rig(&other_rig().to_bytes()).unwrap_err();
    assert!(matches!(error, ServiceError::NotKept), "{error}");
    assert_eq!(block_on(desk.store.active_rig()), Some(rig().to_bytes()));
}

#[test]
fn a_silent_controller_is_given_up() {
    let mut desk = Desk::new();
    desk.working = u32::MAX;
    let error = desk.client().read_rig().unwrap_err();
    assert!(matches!(error, ServiceError::NoAnswer { transactions: 50, .. }), "{error}");
    assert_eq!(desk.transactions, 50);
}

#[test]
fn another_stop_between_the_pages_starts_the_reading_over() {
    let mut desk = Desk::new();
    desk.play(&ending_with(BOX, 1), CUT);
    desk.disturb = |desk, transaction| {
        if transaction == 12 {
            desk.black_box.armed();
            desk.black_box.stop(Micros::new(9), CUT, None);
        }
    };
    let recording = desk.recording();
    assert_eq!((recording.index.stop, recording.index.time), (2, Micros::new(9)));
    assert_eq!(recording.summaries.len(), 0);

    // Again and again: an error instead of a mixture.
    let mut desk = Desk::new();
    desk.play(&ending_with(BOX, 1), CUT);
    desk.disturb = |desk, _| {
        desk.black_box.armed();
        desk.black_box.stop(Micros::new(9), CUT, None);
    };
    let error = desk.client().fetch(|_, _| ()).unwrap_err();
    assert!(matches!(error, ServiceError::Changing(3)), "{error}");
}

#[test]
fn a_damaged_page_is_an_error() {
    struct Damaged(Desk);
    impl ServiceLink for Damaged {
        type Error = std::io::Error;
        fn transact(&mut self, message: Option<&Transaction>) -> Result<Box<Transaction>, std::io::Error> {
            let mut reply = self.0.transact(message).unwrap();
            if reply[PAGE_OFFSET] != 0 {
                reply[PAGE_OFFSET] ^= 1;
            }
            Ok(reply)
        }
    }
    let mut link = Damaged(Desk::new());
    let error = ServiceClient::new(&mut link, SOURCE, 5).read_rig().unwrap_err();
    assert!(matches!(error, ServiceError::Page(PageError::Corrupted)), "{error}");
}

#[test]
fn pages_that_contradict_their_index_are_no_recording() {
    let mut desk = Desk::new();
    desk.play(&ending_with(BOX, 1), CUT);
    let index = desk.black_box.index().unwrap();
    let summaries = vec![0; 6 * SUMMARY_LENGTH];
    let good = [vec![summaries, Vec::new(), Vec::new(), Vec::new()], vec![vec![0; 978]; 12]].concat();
    assert_eq!(assemble(&index, &good), Err("an impossible summary"));
    assert_eq!(assemble(&index, &good[..3]), Err("fewer pages than the index says"));
    assert_eq!(assemble(&index, &good[..15]), Err("another number of line-scans than the index says"));
    let more = StopIndex { summaries: 7, ..index };
    assert_eq!(assemble(&more, &good), Err("another number of summaries than the index says"));
}
