use super::*;
use crate::testing::{COLUMNS, SOURCE, header, message};
use nearfield_shared::linescan::{LineScanColumn, LineScanHeader};

const CALIBRATION: CalibrationId = CalibrationId::new(0x1234);
const START: Micros = Micros::from_millis(100);

fn receiver() -> Receiver {
    let mut receiver = Receiver::new(SOURCE, Some(CALIBRATION), COLUMNS);
    receiver.status_sent(1, START);
    receiver
}

fn bytes(header: &LineScanHeader) -> Vec<u8> {
    message(header, &[LineScanColumn::MISSING; COLUMNS])
}

fn good(sequence: u32, status: u32) -> Vec<u8> {
    bytes(&header(sequence, status, CALIBRATION))
}

fn at(millis: u64) -> Micros {
    START.plus(Micros::from_millis(millis))
}

fn verdict(receiver: &mut Receiver, now: Micros, bytes: &[u8]) -> Option<Refusal> {
    receiver.receive(now, bytes).err().map(|refused| refused.refusal)
}

/// A receiver that has accepted sequence numbers 10, 11 and 12 and is healthy.
fn healthy() -> Receiver {
    let mut receiver = receiver();
    for sequence in 10..13 {
        assert_eq!(verdict(&mut receiver, START, &good(sequence, 1)), None);
    }
    assert!(receiver.faults().is_empty());
    receiver
}

#[test]
fn the_link_is_healthy_after_a_streak_and_not_before() {
    let mut receiver = receiver();
    for sequence in 1..HEALTHY_STREAK {
        assert_eq!(verdict(&mut receiver, START, &good(sequence, 1)), None);
        assert!(receiver.faults().contains(StopCause::LinkTimeout), "after {sequence}");
    }
    assert_eq!(verdict(&mut receiver, START, &good(HEALTHY_STREAK, 1)), None);
    assert!(receiver.faults().is_empty());
    assert_eq!(receiver.counts().accepted, HEALTHY_STREAK);
    assert_eq!(receiver.echoed_sequence(), SequenceNumber::new(HEALTHY_STREAK));
}

/// Every way in which a message can be refused, told to a healthy receiver.
fn wrong_messages() -> [(Refusal, Vec<u8>); 9] {
    let wrong = |change: fn(LineScanHeader) -> LineScanHeader| bytes(&change(header(13, 1, CALIBRATION)));
    let mut damaged = good(13, 1);
    damaged[500] ^= 1;
    let mut other_magic = good(13, 1);
    other_magic[0] = b'X';
    [
        (Refusal::Corruption, damaged),
        (Refusal::Format, good(13, 1)[..100].to_vec()),
        (Refusal::Corruption, other_magic),
        (Refusal::Source, wrong(|header| LineScanHeader { source: SourceId::new(8), ..header })),
        (
            Refusal::Calibration,
            wrong(|header| LineScanHeader { calibration: CalibrationId::new(1), ..header }),
        ),
        (Refusal::Repetition, good(12, 1)),
        (Refusal::Sequence, good(11, 1)),
        (Refusal::Sequence, good(15, 1)),
        (Refusal::Delay, good(13, 2)),
    ]
}

fn counts_of(kind: Refusal, count: u32) -> [u32; REFUSAL_KINDS] {
    Refusal::ALL.map(|other| if other == kind { count } else { 0 })
}

#[test]
fn a_single_refusal_is_counted_and_discarded() {
    for (expected, bytes) in wrong_messages() {
        let mut receiver = healthy();
        assert!(!receiver.has_refused_lately(START));
        let refused = receiver.receive(START, &bytes).err();
        assert_eq!(refused, Some(Refused { refusal: expected, tolerated: true }));
        assert!(receiver.faults().is_empty() && receiver.has_refused_lately(START));
        assert_eq!(receiver.counts().refused, counts_of(expected, 1));
        assert_eq!(receiver.counts().accepted, 3, "and never used");
        let next = if expected == Refusal::Sequence { 16 } else { 14 };
        let next = if bytes == good(11, 1) { 12 } else { next };
        assert_eq!(
            verdict(&mut receiver, START, &good(next, 1)),
            None,
            "{expected:?}: the next good one counts"
        );
    }
}

#[test]
fn a_second_refusal_stops_with_its_name_and_begins_the_streak_anew() {
    for (expected, bytes) in wrong_messages() {
        let mut receiver = healthy();
        let mut damaged = good(13, 1);
        damaged[501] ^= 1;
        assert!(receiver.receive(START, &damaged).is_err_and(|refused| refused.tolerated), "the first one");
        let refused = receiver.receive(START, &bytes).err();
        assert_eq!(refused, Some(Refused { refusal: expected, tolerated: false }));
        assert_eq!(receiver.faults(), StopCauses::NONE.with(expected.cause()));
        for sequence in 20..23 {
            assert!(!receiver.faults().is_empty());
            // After a wrong number the next good one may itself be out of order; the streak counts from there.
            let _ = verdict(&mut receiver, START, &good(sequence, 1));
        }
        assert_eq!(verdict(&mut receiver, START, &good(23, 1)), None);
        assert!(receiver.faults().is_empty(), "{expected:?}: it recovers");
    }
}

#[test]
fn a_second_refusal_counts_as_one_within_the_interval() {
    for (change, tolerated) in [(-1, false), (0, false), (1, true)] {
        let mut receiver = healthy();
        let mut damaged = good(13, 1);
        damaged[500] ^= 1;
        assert!(receiver.receive(START, &damaged).is_err_and(|refused| refused.tolerated));
        let later = Micros::new(START.plus(LINK_ERROR_INTERVAL).get().saturating_add_signed(change));
        assert_eq!(receiver.has_refused_lately(later), !tolerated);
        let refused = receiver.receive(later, &damaged);
        assert!(refused.is_err_and(|refused| refused.tolerated == tolerated), "{change}");
    }
}

#[test]
fn a_line_scan_with_another_number_of_columns_than_the_rig_is_malformed() {
    for (columns, expected) in
        [(COLUMNS - 1, Some(Refusal::Format)), (COLUMNS, None), (COLUMNS + 1, Some(Refusal::Format))]
    {
        let bytes = message(&header(13, 1, CALIBRATION), &vec![LineScanColumn::MISSING; columns]);
        assert_eq!(verdict(&mut healthy(), START, &bytes), expected);
    }
}

#[test]
fn without_a_calibration_nothing_is_accepted() {
    let mut receiver = Receiver::new(SOURCE, None, COLUMNS);
    receiver.status_sent(1, START);
    assert_eq!(verdict(&mut receiver, START, &good(1, 1)), Some(Refusal::Calibration));
    let zero = bytes(&header(2, 1, CalibrationId::new(0)));
    assert_eq!(verdict(&mut receiver, START, &zero), Some(Refusal::Calibration));
}

#[test]
fn sequence_numbers_may_rise_by_the_largest_step_and_wrap() {
    for (step, expected) in [
        (0, Some(Refusal::Repetition)),
        (LARGEST_SEQUENCE_STEP - 1, None),
        (LARGEST_SEQUENCE_STEP, None),
        (LARGEST_SEQUENCE_STEP + 1, Some(Refusal::Sequence)),
        (u32::MAX, Some(Refusal::Sequence)),
    ] {
        for start in [12, u32::MAX] {
            let mut receiver = receiver();
            assert_eq!(verdict(&mut receiver, START, &good(start, 1)), None);
            let next = good(start.wrapping_add(step), 1);
            assert_eq!(verdict(&mut receiver, START, &next), expected, "{start} + {step}");
        }
    }
}

#[test]
fn silence_counts_from_the_timeout_on_once() {
    for (change, silent) in [(-1, false), (0, false), (1, true)] {
        let mut receiver = healthy();
        let now = Micros::new(START.plus(LINK_TIMEOUT).get().saturating_add_signed(change));
        receiver.expire(now);
        receiver.expire(now);
        assert_eq!(receiver.faults().contains(StopCause::LinkTimeout), silent, "{change}");
        assert_eq!(receiver.counts().refused[0], u32::from(silent));
    }
}

#[test]
fn a_line_scan_after_silence_says_so() {
    let mut receiver = healthy();
    receiver.status_sent(2, at(200));
    let next = good(13, 2);
    assert!(receiver.receive(at(200), &next).is_ok_and(|accepted| accepted.after_silence));
    let next = good(14, 2);
    assert!(receiver.receive(at(200), &next).is_ok_and(|accepted| !accepted.after_silence));
}

#[test]
fn the_age_of_a_message_is_bounded_on_the_controllers_own_clock() {
    for (change, expected) in [(-1, None), (0, None), (1, Some(Refusal::Delay))] {
        let mut receiver = receiver();
        let now = Micros::new(START.plus(LONGEST_MESSAGE_AGE).get().saturating_add_signed(change));
        assert_eq!(verdict(&mut receiver, now, &good(1, 1)), expected, "{change}");
    }
}

#[test]
fn the_age_of_a_picture_is_bounded_by_the_hosts_word() {
    for (change, expected) in [(-1, None), (0, None), (1, Some(Refusal::Delay))] {
        let capture_age = Micros::new(LONGEST_CAPTURE_AGE.get().saturating_add_signed(change));
        let bytes = bytes(&LineScanHeader { capture_age, ..header(1, 1, CALIBRATION) });
        assert_eq!(verdict(&mut receiver(), START, &bytes), expected, "{change}");
    }
}

#[test]
fn the_reported_age_adds_both_bounds() {
    let mut receiver = receiver();
    let bytes = good(1, 1);
    let accepted = receiver.receive(at(20), &bytes).unwrap();
    assert_eq!(accepted.age, Micros::from_millis(40));
}

#[test]
fn only_the_last_statuses_are_remembered() {
    let mut receiver = receiver();
    for number in 2..=9 {
        receiver.status_sent(number, START);
    }
    assert_eq!(verdict(&mut receiver, START, &good(1, 1)), Some(Refusal::Delay), "sent, but forgotten");
    assert_eq!(verdict(&mut receiver, START, &good(2, 2)), None);
    assert_eq!(verdict(&mut receiver, START, &good(3, 10)), Some(Refusal::Delay), "never sent");
}

#[test]
fn zeros_are_a_poll_and_anything_else_is_not() {
    assert!(is_poll(&[0; 64]) && is_poll(&[]));
    assert!(!is_poll(&[0, 0, 1]));
}

#[test]
fn what_differs_has_other_words_for_the_memory_check() {
    let new = || Receiver::new(SOURCE, Some(CALIBRATION), COLUMNS);
    let sent = |statuses: &[(u32, u64)]| {
        let mut receiver = new();
        statuses.iter().for_each(|(number, millis)| receiver.status_sent(*number, at(*millis)));
        receiver
    };
    let all = [
        new(),
        Receiver { source: SourceId::new(8), ..new() },
        Receiver { calibration: None, ..new() },
        Receiver { columns: COLUMNS + 1, ..new() },
        Receiver { sequence: Some(SequenceNumber::new(0)), ..new() },
        Receiver { sequence: Some(SequenceNumber::new(1)), ..new() },
        Receiver { streak: 1, ..new() },
        Receiver { faults: StopCauses::NONE, ..new() },
        Receiver { last_accepted: Some(START), ..new() },
        Receiver { last_refused: Some(START), ..new() },
        sent(&[(1, 0)]),
        sent(&[(2, 0)]),
        sent(&[(1, 1)]),
        sent(&[(1, 0), (2, 1)]),
    ];
    crate::testing::all_differ(all.iter().map(|receiver| receiver.words().collect::<Vec<_>>()));
}
