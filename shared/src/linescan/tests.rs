use super::*;
use crate::action::Category;
use crate::run_over::Stretch;
use proptest::prelude::*;

fn claim(start: i16) -> Option<Claim> {
    Some(Claim {
        stretch: Stretch::new(start, start + 2).unwrap(),
        category: Category::Tool,
        confidence: 0x1A,
        age: Micros::from_millis(0x1B1C),
    })
}

fn header() -> LineScanHeader {
    LineScanHeader {
        source: SourceId::new(0x0102),
        calibration: CalibrationId::new(0x0304_0506),
        sequence: SequenceNumber::new(0x0708_090A),
        capture_age: Micros::new(0x0B0C_0D0E),
        exposure: Micros::new(0x0F10_1112),
        last_status: 0x1314_1516,
        verdict: HostVerdict::Clear,
        ambient: 0x15,
        saturated: 0x16,
        claims: [claim(0x1718), None, None, claim(0x1728)],
    }
}

fn example() -> [u8; LINE_SCAN_LENGTH] {
    let mut message = [0; LINE_SCAN_LENGTH];
    let columns = [
        LineScanColumn { row: SubpixelRow::from_raw(0x2122), quality: SignalQuality::new(0x23) },
        LineScanColumn::MISSING,
    ];
    let audit = [AuditWindow { column: 0x3132, first_row: 0x3334, pixels: [0x35; AUDIT_PIXELS] }];
    let mut brightness = BrightnessProfile::DARK;
    brightness.blocks[0] = 0x4142;
    brightness.blocks[63] = 0x4344;
    encode(&mut message, &header(), &columns, &brightness, &audit).unwrap();
    message
}

fn resealed(mut message: [u8; LINE_SCAN_LENGTH]) -> [u8; LINE_SCAN_LENGTH] {
    wire::seal(&mut message);
    message
}

/// Frozen: a receiver in the field reads exactly these bytes. Do not change the test; add a version.
#[test]
fn golden_bytes_of_version_3() {
    let message = example();
    assert_eq!(LINE_SCAN_LENGTH, 3944);
    #[rustfmt::skip]
        let head = [
            b'N', b'F', b'L', b'S', 3, 0, 0x02, 0x01, 0x06, 0x05, 0x04, 0x03, 0x0A, 0x09, 0x08, 0x07,
            0x0E, 0x0D, 0x0C, 0x0B, 0x12, 0x11, 0x10, 0x0F, 0x16, 0x15, 0x14, 0x13, 0x5A, 0x3C, 2, 0,
            1, 0, 0x15, 0x16, 0x18, 0x17, 0x1A, 0x17, 0x4B, 0x1A, 0x1C, 0x1B, 0, 0, 0, 0,
            0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x28, 0x17, 0x2A, 0x17,
            0x4B, 0x1A, 0x1C, 0x1B, 0x22, 0x21, 0xFF, 0xFF, 0, 0,
        ];
    assert_eq!(message[..74], head);
    assert_eq!(message[2372..2375], [0x23, 0, 0]);
    assert_eq!(message[3524..3527], [0x42, 0x41, 0]);
    assert_eq!(message[3649..3652], [0, 0x44, 0x43]);
    assert_eq!(message[3652..3657], [0x32, 0x31, 0x34, 0x33, 0x35]);
    assert_eq!(message[3688], 0);
    assert_eq!(message[3940..], GOLDEN_SEAL.to_le_bytes());
}
/// Computed bit by bit outside this project's code from the catalogue's parameters.
const GOLDEN_SEAL: u32 = 0x51AA_F0D8;

#[test]
fn what_was_encoded_is_what_is_read() {
    let message = example();
    let scan = LineScan::parse(&message).unwrap();
    assert_eq!(*scan.header(), header());
    assert_eq!(scan.column_count(), 2);
    let readings: Vec<_> = scan.readings().collect();
    assert_eq!(readings[0].row, f32::from(0x2122_u16) / 16.0);
    assert!(readings[1].row.is_nan() && readings[1].quality == SignalQuality::NONE);
    let audit: Vec<_> = scan.audit_windows().collect();
    assert_eq!((audit.len(), audit[0].column, audit[0].pixels), (1, 0x3132, [0x35; AUDIT_PIXELS]));
}

#[test]
fn each_rule_has_its_error() {
    let good = example();
    let with = |offset: usize, value: u8| {
        let mut message = good;
        message[offset] = value;
        LineScan::parse(&resealed(message)).err()
    };
    assert_eq!(LineScan::parse(&good[..LINE_SCAN_LENGTH - 1]).err(), Some(LineScanError::Length));
    assert_eq!(LineScan::parse(&[]).err(), Some(LineScanError::Length));
    let mut damaged = good;
    damaged[100] ^= 1;
    assert_eq!(LineScan::parse(&damaged).err(), Some(LineScanError::Corrupted));
    assert_eq!(with(0, b'X'), Some(LineScanError::Magic));
    assert_eq!(with(4, 2), Some(LineScanError::Version), "the version before this one");
    assert_eq!(with(4, 4), Some(LineScanError::Version));
    assert_eq!(with(28, 0), Some(LineScanError::Field), "verdict");
    assert_eq!(with(30, 0), Some(LineScanError::Field), "no columns");
    assert_eq!(with(31, 5), Some(LineScanError::Field), "1282 columns");
    assert_eq!(with(32, 9), Some(LineScanError::Field), "9 audit windows");
    assert_eq!(with(32, 8), None, "8 audit windows");
    assert_eq!(with(34, 0xFF), None, "any ambient light");
    assert_eq!(with(35, 0xFF), None, "any saturation");
    assert_eq!(with(40, 0x4A), Some(LineScanError::Field), "a claim of no category");
    assert_eq!(with(44, 1), Some(LineScanError::Field), "a claim in part");
}

#[test]
fn the_column_count_is_bounded_on_both_sides() {
    let mut message = [0; LINE_SCAN_LENGTH];
    let columns = [LineScanColumn::MISSING; LARGEST_COLUMN_COUNT + 1];
    assert!(
        encode(&mut message, &header(), &columns[..LARGEST_COLUMN_COUNT], &BrightnessProfile::DARK, &[])
            .is_ok()
    );
    assert_eq!(LineScan::parse(&message).unwrap().column_count(), LARGEST_COLUMN_COUNT);
    assert_eq!(
        encode(&mut message, &header(), &columns, &BrightnessProfile::DARK, &[]),
        Err(LineScanError::Field)
    );
    assert_eq!(
        encode(&mut message, &header(), &[], &BrightnessProfile::DARK, &[]),
        Err(LineScanError::Field)
    );
    let window = AuditWindow { column: 0, first_row: 0, pixels: [0; AUDIT_PIXELS] };
    assert_eq!(
        encode(&mut message, &header(), &columns[..1], &BrightnessProfile::DARK, &[window; 9]),
        Err(LineScanError::Field)
    );
    assert!(LineScan::parse(&message).is_err(), "a refused message is not sealed");
}

#[test]
fn verdict_codes_are_far_apart() {
    let codes = [HostVerdict::Clear, HostVerdict::Warn, HostVerdict::Stop].map(HostVerdict::code);
    for (index, one) in codes.iter().enumerate() {
        for other in &codes[index + 1..] {
            assert!((one ^ other).count_ones() >= 7, "{one:04x} {other:04x}");
        }
    }
}

#[test]
fn every_truncation_is_refused() {
    let message = example();
    for length in 0..LINE_SCAN_LENGTH {
        assert_eq!(LineScan::parse(&message[..length]).err(), Some(LineScanError::Length));
    }
}

proptest! {
    /// Hamming distance 6: up to five wrong bits are always caught.
    #[test]
    fn up_to_five_wrong_bits_are_caught(bits in proptest::collection::hash_set(0..LINE_SCAN_LENGTH * 8, 1..=5)) {
        let mut message = example();
        for bit in bits {
            message[bit / 8] ^= 1 << (bit % 8);
        }
        prop_assert_eq!(LineScan::parse(&message).err(), Some(LineScanError::Corrupted));
    }

    #[test]
    fn garbage_is_refused_and_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..4096)) {
        prop_assert!(LineScan::parse(&bytes).is_err());
    }
}

#[test]
fn a_column_beyond_the_last_is_missing() {
    let bytes = example();
    let scan = LineScan::parse(&bytes).unwrap();
    assert_eq!(scan.column(0).row, SubpixelRow::from_raw(0x2122));
    assert_eq!(scan.column_count(), 2);
    assert_eq!((scan.column(2), scan.column(u16::MAX)), (LineScanColumn::MISSING, LineScanColumn::MISSING));
}

#[test]
fn columns_that_cannot_be_counted_are_refused() {
    let mut message = [0; LINE_SCAN_LENGTH];
    let columns = vec![LineScanColumn::MISSING; 70_000];
    let refused = encode(&mut message, &header(), &columns, &BrightnessProfile::DARK, &[]);
    assert_eq!(refused, Err(LineScanError::Field));
}

#[test]
fn as_many_windows_as_fit_are_written_and_no_more() {
    let window = AuditWindow { column: 1, first_row: 2, pixels: [3; AUDIT_PIXELS] };
    let with = |count| {
        let mut message = [0; LINE_SCAN_LENGTH];
        let windows = vec![window; count];
        encode(&mut message, &header(), &[LineScanColumn::MISSING], &BrightnessProfile::DARK, &windows)
    };
    assert_eq!(with(LARGEST_AUDIT_COUNT), Ok(()));
    assert_eq!(with(LARGEST_AUDIT_COUNT + 1), Err(LineScanError::Field));
}
