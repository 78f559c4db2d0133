//! Bytes: little-endian reading and writing that cannot panic, and the CRC that seals every message and store.
//!
//! The CRC is the 32-bit one with polynomial 0x32583499 (Koopman's 0x992C1A4C): Hamming distance 6 up to 32,738 data
//! bits, so every pattern of up to five wrong bits in a message of at most 4,092 bytes is caught, and, since it is
//! divisible by x + 1, every odd number of them. Ethernet's, Castagnoli's and MEF's polynomials have only 4 at that
//! length. Source: P. Koopman, "32-bit cyclic redundancy codes for internet applications", DSN 2002; the distance at
//! our longest message is proven again by this module's tests. Register and output are complemented and reflected as
//! Ethernet's are, so that leading and trailing zeros count.

use crc::{Algorithm, Crc, Table};

#[cfg(not(target_os = "none"))]
type CrcTable = Table<16>;
/// One byte a step: 1 KiB of flash instead of 16.
#[cfg(target_os = "none")]
type CrcTable = Table<1>;

/// See the module's documentation.
const ALGORITHM: Algorithm<u32> = Algorithm {
    width: 32,
    poly: 0x3258_3499,
    init: u32::MAX,
    refin: true,
    refout: true,
    xorout: u32::MAX,
    check: 0xEEB7_54CC,
    residue: 0x8C2F_4117,
};

const CRC: Crc<u32, CrcTable> = Crc::<u32, CrcTable>::new(&ALGORITHM);

/// Bytes of the CRC at the end of every sealed message.
pub const SEAL_LENGTH: usize = 4;

/// The CRC of `bytes`.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// The CRC that stands in the last four bytes of a sealed message (0 for one that is too short to hold any).
#[must_use]
pub fn seal_of(message: &[u8]) -> u32 {
    match message.last_chunk::<SEAL_LENGTH>() {
        Some(seal) => u32::from_le_bytes(*seal),
        None => 0,
    }
}

/// True if the last four bytes are the CRC of all before them.
#[must_use]
pub fn is_sealed(message: &[u8]) -> bool {
    match message.split_last_chunk::<SEAL_LENGTH>() {
        Some((body, seal)) => checksum(body) == u32::from_le_bytes(*seal),
        None => false,
    }
}

/// Writes little-endian values one after the other; what does not fit any more is dropped (the message's own length
/// is a constant, and its golden bytes are tested).
pub(crate) struct Writer<'a> {
    rest: &'a mut [u8],
}

impl<'a> Writer<'a> {
    pub(crate) fn new(bytes: &'a mut [u8]) -> Self {
        Self { rest: bytes }
    }

    pub(crate) fn bytes<const L: usize>(&mut self, values: &[u8; L]) {
        match core::mem::take(&mut self.rest).split_first_chunk_mut::<L>() {
            Some((slot, rest)) => {
                *slot = *values;
                self.rest = rest;
            }
            None => self.rest = &mut [],
        }
    }

    /// Leaves bytes as they are.
    pub(crate) fn skip(&mut self, length: usize) {
        self.rest =
            core::mem::take(&mut self.rest).split_at_mut_checked(length).map_or(&mut [], |(_, rest)| rest);
    }

    pub(crate) fn u8(&mut self, value: u8) {
        self.bytes(&[value]);
    }

    pub(crate) fn u16(&mut self, value: u16) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn u64(&mut self, value: u64) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn i32(&mut self, value: i32) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn f32(&mut self, value: f32) {
        self.bytes(&value.to_le_bytes());
    }
}

/// Puts the CRC of all before the last four bytes into the last four bytes.
pub(crate) fn seal(message: &mut [u8]) {
    if let Some((body, seal)) = message.split_last_chunk_mut::<SEAL_LENGTH>() {
        *seal = checksum(body).to_le_bytes();
    }
}

/// Reads little-endian values one after the other; `None` once the bytes have run out.
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.bytes.split_first_chunk::<N>()?;
        self.bytes = rest;
        Some(*head)
    }

    pub(crate) fn slice(&mut self, length: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.bytes.split_at_checked(length)?;
        self.bytes = rest;
        Some(head)
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|[value]| value)
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub(crate) fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_le_bytes)
    }

    pub(crate) fn f64_from_f32(&mut self) -> Option<f64> {
        self.array().map(f32::from_le_bytes).map(f64::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crc_is_the_stated_one() {
        // Computed bit by bit outside this project's code.
        assert_eq!(checksum(b"123456789"), 0xEEB7_54CC);
        assert_eq!(ALGORITHM.check, 0xEEB7_54CC);
    }

    /// What a single wrong bit does to the check of a sealed message, for every bit, the last one first.
    fn syndromes(bits: usize) -> Vec<u32> {
        // The reflected register, shifted by one bit for each place.
        let polynomial = ALGORITHM.poly.reverse_bits();
        let mut syndrome = 1_u32 << 31;
        (0..bits)
            .map(|_| {
                let now = syndrome;
                syndrome = if syndrome & 1 == 0 { syndrome >> 1 } else { (syndrome >> 1) ^ polynomial };
                now
            })
            .collect()
    }

    /// An even number of terms: every odd number of wrong bits is found. Two or four of them would have to cancel: none
    /// do, in a message of our greatest length.
    #[test]
    #[cfg_attr(miri, ignore = "half a billion steps")]
    fn every_pattern_of_up_to_five_wrong_bits_is_found() {
        assert!((ALGORITHM.poly.count_ones() + 1).is_multiple_of(2), "divisible by x + 1");
        let bits = 8 * crate::linescan::LINE_SCAN_LENGTH;
        let syndromes = syndromes(bits);
        let first = syndromes[0];
        // A pattern may be moved until its last bit is the message's last.
        let mut rest: Vec<u32> = syndromes[1..].iter().map(|syndrome| first ^ syndrome).collect();
        assert!(!rest.contains(&0), "two wrong bits");
        let mut filter = vec![0_u64; 1 << 20];
        for pair in &rest {
            let low = (pair & 0x03FF_FFFF) as usize;
            filter[low / 64] |= 1 << (low % 64);
        }
        rest.sort_unstable();
        for (index, one) in syndromes[1..].iter().enumerate() {
            for other in &syndromes[index + 2..] {
                let pair = one ^ other;
                let low = (pair & 0x03FF_FFFF) as usize;
                if filter[low / 64] >> (low % 64) & 1 != 0 {
                    assert!(rest.binary_search(&pair).is_err(), "four wrong bits");
                }
            }
        }
    }

    /// The syndromes are those of the CRC in use.
    #[test]
    fn syndromes_are_what_wrong_bits_do() {
        let mut message = vec![0; 40];
        seal(&mut message);
        let syndromes = syndromes(8 * 40);
        for (place, syndrome) in syndromes.iter().enumerate() {
            let bit = 8 * 40 - 1 - place;
            let mut bad = message.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            let (body, told) = bad.split_last_chunk::<SEAL_LENGTH>().unwrap();
            assert_eq!(checksum(body) ^ u32::from_le_bytes(*told), *syndrome, "bit {bit}");
        }
    }

    #[test]
    fn a_seal_holds_until_a_bit_changes() {
        let mut message = [1, 2, 3, 4, 0, 0, 0, 0];
        seal(&mut message);
        assert!(is_sealed(&message));
        for bit in 0..64 {
            let mut bad = message;
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(!is_sealed(&bad), "bit {bit}");
        }
        assert!(!is_sealed(&[]) && !is_sealed(&[0, 0, 0]));
    }

    #[test]
    fn a_writer_drops_what_does_not_fit_and_a_reader_ends() {
        let mut bytes = [0; 3];
        let mut writer = Writer::new(&mut bytes);
        writer.u16(0x0201);
        writer.u16(0xFFFF);
        writer.u8(3);
        assert_eq!(bytes, [1, 2, 0]);
        let mut reader = Reader::new(&bytes);
        assert_eq!(
            (reader.u32(), reader.u16(), reader.u16(), reader.u8()),
            (None, Some(0x0201), None, Some(0))
        );
        assert_eq!((Reader::new(&bytes).slice(4), Reader::new(&bytes).slice(3)), (None, Some(&bytes[..])));
    }

    #[test]
    fn what_is_too_short_for_a_seal_has_none() {
        assert_eq!(seal_of(&[1, 2, 3]), 0);
        assert_eq!(seal_of(&[9, 1, 0, 0, 0]), 1);
        seal(&mut [1, 2, 3]);
    }
}
