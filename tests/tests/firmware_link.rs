//! The link is a black channel: each way in which messages can go wrong opens the relays, and none closes them.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_firmware::link::Refusal;
use nearfield_host::link::{FRAME_PERIOD, FrameFacts, InProcess, McuSession};
use nearfield_shared::causes::StopCause;
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::{LINK_ERROR_INTERVAL, LINK_TIMEOUT, LONGEST_CAPTURE_AGE};
use nearfield_shared::linescan::{LINE_SCAN_LENGTH, LineScanHeader, encode};
use nearfield_shared::status::{STATUS_LENGTH, Warnings};
use nearfield_shared::units::{CalibrationId, Micros, SequenceNumber, SourceId};
use nearfield_shared::wire::{SEAL_LENGTH, checksum};
use nearfield_tests::stage::{READY_FRAMES, Stage, run_clean};
use proptest::prelude::*;

fn message_of(stage: &Stage, header: &LineScanHeader) -> Vec<u8> {
    let mut bytes = [0; LINE_SCAN_LENGTH];
    encode(&mut bytes, header, &stage.floor(), &BrightnessProfile::DARK, &[]).unwrap();
    bytes.to_vec()
}

fn good_message(stage: &Stage, session: &mut McuSession) -> Vec<u8> {
    session.next_scene_line_scan(&stage.floor(), FrameFacts::default()).unwrap().to_vec()
}

/// The same message under another number.
fn renumbered(mut message: Vec<u8>, number: SequenceNumber) -> Vec<u8> {
    let body = LINE_SCAN_LENGTH - SEAL_LENGTH;
    message[12..16].copy_from_slice(&number.get().to_le_bytes());
    let seal = checksum(&message[..body]).to_le_bytes();
    message[body..].copy_from_slice(&seal);
    message
}

fn count(session: &McuSession, refusal: Refusal) -> u32 {
    let index = Refusal::ALL.iter().position(|kind| *kind == refusal).unwrap();
    session.status().refused[index]
}

/// One wrong message among good ones is discarded, counted under its own name, and warned of. The second one opens the
/// relays at once, and they stay open until somebody acknowledges it.
fn a_second_wrong_message_stops(refusal: Refusal, mut wrong: impl FnMut(&Stage, &mut McuSession) -> Vec<u8>) {
    let stage = Stage::new();
    let mut session = stage.armed();
    let message = wrong(&stage, &mut session);
    session.run_frame(Some(&message)).unwrap();
    assert!(session.relay_commanded_closed(), "{refusal:?}: the first one is discarded");
    assert_eq!((total(&session), count(&session, refusal)), (1, 1), "counted once, under its own name");
    assert!(session.status().warnings.has_any(Warnings::LINK));
    run_clean(&mut session, &stage, 3).unwrap();
    let before = (total(&session), count(&session, refusal));
    let message = wrong(&stage, &mut session);
    session.run_frame(Some(&message)).unwrap();
    assert!(!session.relay_commanded_closed(), "{refusal:?}: the second one stops");
    assert!(session.status().live_causes.contains(refusal.cause()), "{refusal:?}");
    assert!(session.status().latched_causes.contains(refusal.cause()), "{refusal:?}");
    assert_eq!((total(&session), count(&session, refusal)), (before.0 + 1, before.1 + 1));
    run_clean(&mut session, &stage, 50).unwrap();
    assert!(!session.relay_commanded_closed(), "good messages afterwards do not restart");
    assert!(session.status().latched_causes.contains(refusal.cause()));
    assert!(!session.status().live_causes.contains(refusal.cause()), "the link has recovered");
}

fn total(session: &McuSession) -> u32 {
    session.status().refused.iter().sum()
}

/// Rare single errors, each longer than the interval after the one before, never stop.
#[test]
fn single_errors_far_apart_are_discarded_for_ever() {
    let stage = Stage::new();
    let mut session = stage.armed();
    for errors in 1..4 {
        let mut message = good_message(&stage, &mut session);
        message[700] ^= 1;
        session.run_frame(Some(&message)).unwrap();
        let until = session.now().plus(LINK_ERROR_INTERVAL);
        while session.now() <= until {
            run_clean(&mut session, &stage, 50).unwrap();
            assert!(session.relay_closed());
        }
        assert_eq!(count(&session, Refusal::Corruption), errors);
    }
}

#[test]
fn corruption_stops() {
    a_second_wrong_message_stops(Refusal::Corruption, |stage, session| {
        let mut message = good_message(stage, session);
        message[1000] ^= 0x10;
        message
    });
}

#[test]
fn an_inserted_message_of_another_kind_stops() {
    a_second_wrong_message_stops(Refusal::Format, |_, _| vec![0x55; STATUS_LENGTH]);
}

#[test]
fn a_message_from_another_module_stops() {
    a_second_wrong_message_stops(Refusal::Source, |stage, session| {
        let header = session.next_header(FrameFacts::default());
        message_of(stage, &LineScanHeader { source: SourceId::new(2), ..header })
    });
}

#[test]
fn a_message_with_another_calibration_stops() {
    a_second_wrong_message_stops(Refusal::Calibration, |stage, session| {
        let header = session.next_header(FrameFacts::default());
        let calibration = CalibrationId::new(header.calibration.get() ^ 1);
        message_of(stage, &LineScanHeader { calibration, ..header })
    });
}

#[test]
fn a_repeated_message_stops() {
    a_second_wrong_message_stops(Refusal::Repetition, |stage, session| {
        let message = good_message(stage, session);
        session.run_frame(Some(&message)).unwrap();
        message
    });
}

#[test]
fn a_sequence_number_that_lies_behind_or_too_far_ahead_stops() {
    for step in [2_i64, -1, i64::from(u32::MAX / 2)] {
        a_second_wrong_message_stops(Refusal::Sequence, |stage, session| {
            let header = session.next_header(FrameFacts::default());
            let number = (i64::from(header.sequence.get()) + step) as u32;
            // One behind is the number that was accepted last, that is a repetition: go two back.
            let number = if step == -1 { number - 1 } else { number };
            message_of(stage, &LineScanHeader { sequence: SequenceNumber::new(number), ..header })
        });
    }
}

#[test]
fn a_picture_that_is_too_old_by_the_hosts_own_word_stops() {
    let age = LONGEST_CAPTURE_AGE.plus(Micros::new(1));
    a_second_wrong_message_stops(Refusal::Delay, |stage, session| {
        let header = session.next_header(FrameFacts { capture_age: age, ..FrameFacts::default() });
        message_of(stage, &header)
    });
    let stage = Stage::new();
    let mut session = stage.armed();
    let facts = FrameFacts { capture_age: LONGEST_CAPTURE_AGE, ..FrameFacts::default() };
    session.run_columns(&stage.floor(), facts).unwrap();
    assert!(session.relay_commanded_closed(), "at the limit");
}

/// A recording with valid CRC, replayed with fresh sequence numbers, names an old status: the controller's own clock
/// finds it, whatever the host says about the picture's age.
#[test]
fn a_replayed_recording_stops() {
    a_second_wrong_message_stops(Refusal::Delay, |stage, session| {
        let recorded = good_message(stage, session);
        session.run_frame(Some(&recorded)).unwrap();
        run_clean(session, stage, 3).unwrap();
        let fresh = session.next_header(FrameFacts::default());
        renumbered(recorded, fresh.sequence)
    });
}

#[test]
fn a_message_that_answers_no_status_at_all_stops() {
    for number in [0, u32::MAX] {
        a_second_wrong_message_stops(Refusal::Delay, |stage, session| {
            let header = session.next_header(FrameFacts::default());
            message_of(stage, &LineScanHeader { last_status: number, ..header })
        });
    }
}

/// Loses `frames` line-scans in a row, then goes on.
fn lose(session: &mut McuSession, stage: &Stage, frames: u32) {
    for _ in 0..frames {
        session.next_header(FrameFacts::default());
        session.run_frame(None).unwrap();
    }
    run_clean(session, stage, 3).unwrap();
}

#[test]
fn one_lost_line_scan_is_tolerated_and_a_second_one_in_a_row_is_not() {
    let stage = Stage::new();
    let mut session = stage.armed();
    for _ in 0..10 {
        lose(&mut session, &stage, 1);
        assert!(session.relay_closed());
    }
    assert_eq!(session.status().refused, [0; 8]);
    lose(&mut session, &stage, 2);
    assert!(!session.relay_commanded_closed());
    assert!(session.status().latched_causes.contains(StopCause::LinkTimeout));
    assert_eq!(count(&session, Refusal::Sequence), 1, "the gap in the numbers is seen, too");
}

#[test]
fn silence_stops_within_the_timeout() {
    let stage = Stage::new();
    let mut session = stage.armed();
    // The last line-scan came one frame period ago.
    let silent_since = Micros::new(session.now().get() - FRAME_PERIOD.get());
    while session.relay_commanded_closed() {
        session.run_frame(None).unwrap();
        let silence = session.now().since(silent_since);
        assert!(silence <= LINK_TIMEOUT.plus(FRAME_PERIOD), "still closed after {silence:?}");
    }
    assert!(session.status().live_causes.contains(StopCause::LinkTimeout));
    assert_eq!(count(&session, Refusal::Timeout), 1);
    let scan_causes = [StopCause::StripeCut, StopCause::LargeObject, StopCause::Drop];
    assert!(
        !scan_causes.iter().any(|cause| session.status().live_causes.contains(*cause)),
        "nothing is known"
    );
}

/// Without a host, and with one that polls but never shows a picture, the relays never close, button or not.
#[test]
fn without_line_scans_the_relays_never_close() {
    for poll in [None, Some(&[0_u8; 0][..])] {
        let stage = Stage::new();
        let mut session = stage.session(Box::new(InProcess::new()), 0).unwrap();
        for frame in 0..500 {
            if frame % 40 == 10 {
                session.press_reset();
            }
            session.run_frame(poll).unwrap();
            assert!(!session.relay_commanded_closed() && !session.relay_closed());
        }
    }
}

/// A fresh controller that is shown `message` in every frame, and its reset button pressed, never closes.
fn never_closes(stage: &Stage, message: &[u8]) {
    let mut session = stage.session(Box::new(InProcess::new()), 0).unwrap();
    for frame in 0..60 {
        if frame == 20 {
            session.press_reset();
        }
        session.run_frame(Some(message)).unwrap();
        assert!(!session.relay_commanded_closed());
    }
}

#[test]
fn truncated_messages_open_closed_relays() {
    let stage = Stage::new();
    for length in (0..LINE_SCAN_LENGTH).step_by(97).chain([LINE_SCAN_LENGTH - 1]) {
        let mut session = stage.armed();
        for _ in 0..2 {
            let message = good_message(&stage, &mut session);
            session.run_frame(Some(&message[..length])).unwrap();
        }
        assert!(!session.relay_commanded_closed(), "{length} bytes");
    }
}

#[test]
fn no_truncation_of_a_good_message_ever_closes_the_relays() {
    let stage = Stage::new();
    let mut session = stage.session(Box::new(InProcess::new()), READY_FRAMES).unwrap();
    for length in 0..LINE_SCAN_LENGTH {
        if length.is_multiple_of(20) {
            session.press_reset();
        }
        let message = good_message(&stage, &mut session);
        session.run_frame(Some(&message[..length])).unwrap();
        assert!(!session.relay_commanded_closed(), "{length} bytes");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn garbage_never_closes_the_relays(message in prop::collection::vec(any::<u8>(), 0..4096)) {
        never_closes(&Stage::new(), &message);
    }

    /// Any bytes at all, in two frames of a running controller, open the relays.
    #[test]
    fn garbage_opens_closed_relays(message in prop::collection::vec(any::<u8>(), 0..4096)) {
        let mut session = Stage::new().armed();
        session.run_frame(Some(&message)).unwrap();
        session.run_frame(Some(&message)).unwrap();
        prop_assert!(!session.relay_commanded_closed());
    }

    /// The same message again and again, be it whole or damaged, never closes them.
    #[test]
    fn a_frozen_host_never_closes_the_relays(byte in 0..LINE_SCAN_LENGTH, flip in any::<u8>()) {
        let stage = Stage::new();
        let mut session = stage.session(Box::new(InProcess::new()), 0).unwrap();
        let mut message = good_message(&stage, &mut session);
        message[byte] ^= flip;
        never_closes(&stage, &message);
    }
}
