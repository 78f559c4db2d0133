use super::*;
use crate::causes::StopCause;
use proptest::prelude::*;

fn example() -> Status {
    Status {
        source: SourceId::new(0x0102),
        calibration: Some(CalibrationId::new(0x0304_0506)),
        firmware: 0x0708_090A,
        number: 0x0B0C_0D0E,
        echoed_sequence: SequenceNumber::new(0x0F10_1112),
        now: Micros::new(0x1314_1516_1718_191A),
        state: StateCode::Running,
        relay_command: Channels::CLOSED,
        relay_readback: Channels { a: true, b: false },
        reset_cause: ResetCause::Watchdog,
        live_causes: StopCauses::NONE.with(StopCause::StripeCut),
        latched_causes: StopCauses::NONE.with(StopCause::Interlock),
        longest_gap: Some(Gap::between(-3.0, 4.5)),
        highest: Some(Extreme { height: Millimetres::new(52.25), place: Millimetres::new(-1.0) }),
        lowest: Some(Millimetres::new(-6.0)),
        longest_unknown: Millimetres::new(2.0),
        size: Some(SizeClass::Large),
        laser_mode: LaserMode::Coded,
        warnings: Warnings::from_bits(0x2122),
        decision_age: Micros::new(21_000),
        longest_decision_age: Micros::new(31_000),
        response_bound: Micros::new(60_000),
        accepted: 7,
        refused: [0, 1, 2, 3, 4, 5, 6, 7],
        challenge: Challenge { count: 2, columns: [5, 6, 0, 0, 0, 0, 0, 0] },
        fault: Some(FaultCode::SelfTest),
        failed_self_test: 0x3C,
        trust: TrustFigures {
            light_age: Micros::new(0x3132_3334),
            longest_light_age: Micros::new(0x3536_3738),
            liveness_doubt: 0x4142,
            audit_doubt: 0x4344,
            audits_confirmed: 0x4546_4748,
            audits_contradicted: 0x494A_4B4C,
        },
        health: HealthFigures {
            floor_offset: Millimetres::new(0.25),
            floor_rise: Millimetres::new(-0.125),
            smallest_object: Millimetres::new(2.5),
            smallest_object_place: Millimetres::new(-100.0),
            permitted_speed_percent: 50,
        },
        run_over: Some(PermitInUse {
            stretch: Gap::between(-20.5, 31.25),
            time_left: Micros::new(0x5152_5354),
        }),
    }
}

/// Frozen: a host in the field reads exactly these bytes. Do not change the test; add a version.
#[test]
fn golden_bytes_of_version_3() {
    #[rustfmt::skip]
        let head = [
            b'N', b'F', b'S', b'T', 3, 0, 0x02, 0x01, 0x06, 0x05, 0x04, 0x03, 0x0A, 0x09, 0x08, 0x07,
            0x0E, 0x0D, 0x0C, 0x0B, 0x12, 0x11, 0x10, 0x0F, 0x1A, 0x19, 0x18, 0x17, 0x16, 0x15, 0x14, 0x13,
            0x55, 3, 1, 3, 1, 0, 0, 0, 0, 0, 8, 0, // state .. latched causes
            0x4C, 0x1D, 0, 0, 0x48, 0xF4, 0xFF, 0xFF, 0x94, 0x11, 0, 0, // gap 7500, -3000, 4500 um
            0x1A, 0xCC, 0, 0, 0x18, 0xFC, 0xFF, 0xFF, 0x90, 0xE8, 0xFF, 0xFF, 0xD0, 0x07, 0, 0,
            2, 2, 0x22, 0x21, 0x08, 0x52, 0, 0, 0x18, 0x79, 0, 0, 0x60, 0xEA, 0, 0, 7, 0, 0, 0,
        ];
    let bytes = example().to_bytes();
    assert_eq!(bytes[..92], head);
    #[rustfmt::skip]
        let tail = [
            2, 0, 5, 0, 6, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, // challenge
            0xF0, 0x3C, 0x34, 0x33, 0x32, 0x31, 0x38, 0x37, 0x36, 0x35, 0x42, 0x41, 0x44, 0x43,
            0x48, 0x47, 0x46, 0x45, 0x4C, 0x4B, 0x4A, 0x49, // trust
            0xFA, 0, 0, 0, 0x83, 0xFF, 0xFF, 0xFF, 0xC4, 0x09, 0, 0, 0x60, 0x79, 0xFE, 0xFF, 50, 0, 0, 0, // health
            0xEC, 0xAF, 0xFF, 0xFF, 0x12, 0x7A, 0, 0, 0x54, 0x53, 0x52, 0x51, // run-over permit
        ];
    assert_eq!(bytes[124..196], tail);
    assert_eq!(bytes[196..], GOLDEN_SEAL.to_le_bytes());
    assert!(wire::is_sealed(&bytes));
}

/// Computed bit by bit outside this project's code from the catalogue's parameters.
const GOLDEN_SEAL: u32 = 0x2A1E_6AB0;

#[test]
fn what_was_encoded_is_what_is_read() {
    assert_eq!(Status::parse(&example().to_bytes()), Ok(example()));
    let quiet = Status {
        calibration: None,
        longest_gap: None,
        highest: None,
        lowest: None,
        size: None,
        challenge: Challenge::default(),
        fault: None,
        failed_self_test: 0,
        run_over: None,
        ..example()
    };
    assert_eq!(Status::parse(&quiet.to_bytes()), Ok(quiet));
    for state in StateCode::ALL {
        for reset_cause in ResetCause::ALL {
            for size in [SizeClass::Small, SizeClass::Unknown] {
                let status = Status { state, reset_cause, size: Some(size), ..example() };
                assert_eq!(Status::parse(&status.to_bytes()), Ok(status));
            }
        }
    }
    for laser_mode in [LaserMode::Off, LaserMode::Dark] {
        let status = Status { laser_mode, ..example() };
        assert_eq!(Status::parse(&status.to_bytes()), Ok(status));
    }
    for fault in FaultCode::ALL {
        let status = Status { fault: Some(fault), ..example() };
        assert_eq!(Status::parse(&status.to_bytes()), Ok(status));
    }
    for command in [Channels::OPEN, Channels { a: false, b: true }] {
        let status = Status { relay_command: command, ..example() };
        assert_eq!(Status::parse(&status.to_bytes()), Ok(status));
    }
}

#[test]
fn each_rule_has_its_error() {
    let with = |offset: usize, value: u8| {
        let mut bytes = example().to_bytes();
        bytes[offset] = value;
        wire::seal(&mut bytes);
        Status::parse(&bytes).err()
    };
    for length in 0..STATUS_LENGTH {
        assert_eq!(Status::parse(&example().to_bytes()[..length]).err(), Some(StatusError::Length));
    }
    let mut damaged = example().to_bytes();
    damaged[60] ^= 0x10;
    assert_eq!(Status::parse(&damaged).err(), Some(StatusError::Corrupted));
    assert_eq!(with(3, 0), Some(StatusError::Magic));
    assert_eq!(with(4, 2), Some(StatusError::Version), "the version before this one");
    assert_eq!(with(4, 4), Some(StatusError::Version));
    for (offset, value) in [
        (32, 0x54),
        (33, 4),
        (34, 4),
        (35, 6),
        (72, 4),
        (73, 3),
        (124, 9),
        (142, 1),
        (181, 1),
        (182, 1),
        (183, 1),
        (187, 0x7F),
    ] {
        assert_eq!(with(offset, value), Some(StatusError::Field), "offset {offset}");
    }
    assert_eq!(with(124, 8), None);
    // A permit without time is none, and must say so whole.
    let mut bytes = example().to_bytes();
    bytes[192..196].fill(0);
    wire::seal(&mut bytes);
    assert_eq!(Status::parse(&bytes), Err(StatusError::Field));
}

proptest! {
    #[test]
    fn garbage_is_refused_and_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..256)) {
        prop_assert!(Status::parse(&bytes).is_err());
    }
}

/// No permit is zeros throughout; a stretch without a time, or with its ends swapped, is no permit but an error.
#[test]
fn a_permit_is_whole_or_nothing() {
    let parsed = |start: i32, end: i32, time: u32| {
        let bytes = [start.to_le_bytes(), end.to_le_bytes(), time.to_le_bytes()].concat();
        parse_permit(&mut Reader::new(&bytes)).map(|permit| permit.is_some())
    };
    assert_eq!(parsed(0, 0, 0), Some(false));
    for (start, end) in [(0, 5_000), (-5_000, 0), (-5_000, 5_000)] {
        assert_eq!(parsed(start, end, 0), None);
        assert_eq!(parsed(start, end, 1), Some(true));
        assert_eq!(parsed(end, start, 1), None);
    }
    assert_eq!(parsed(0, 0, 1), Some(true));
}

/// What is not there has a value of its own on the wire, the module's table says which.
#[test]
fn what_is_not_there_is_told_by_its_own_value() {
    let nothing = Status { longest_gap: None, highest: None, lowest: None, ..example() };
    let bytes = nothing.to_bytes();
    let word = |value: i32| value.to_le_bytes();
    for absent in [word(-1), word(i32::MIN), word(i32::MAX)] {
        assert!(bytes.windows(4).any(|window| window == absent), "{absent:?}");
    }
    assert_eq!((WHOLE, NOTHING_RAISED, NOTHING_BELOW), (-1, i32::MIN, i32::MAX));
}
