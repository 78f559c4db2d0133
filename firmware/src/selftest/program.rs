//! The program in flash against the seal that the build puts beside it.
//!
//! The image is everything that is flashed: vectors, code, constants and the variables' initial values. After linking,
//! `cargo xtask firmware` writes its length and CRC into a reserved place inside it, the [`ImageSeal`]; the seal's own
//! bytes are left out of the CRC. An image that was never sealed fails the test, and the relays never close.
//!
//! **Polynomial:** 0x93A409EB (Koopman's 0xC9D204F5): Hamming distance 4 up to 2,147,483,615 data bits, so every
//! pattern of up to three wrong bits anywhere in the largest image (504 KiB, 4.1 million bits) is found, every odd
//! number of them, every burst of up to 32 bits, and of all other damage all but one in 2^32. Ethernet's polynomial
//! has distance 4 only up to 91,607 bits (11 KB). Source: P. Koopman, "Best CRC Polynomials", users.ece.cmu.edu/~koopman/crc;
//! the distance at this length is proven again by this module's tests.
//!
//! **Time:** about 12 instructions a byte; [`SLICE_BYTES`] a slice. **Failure:**
//! [`SelfTestKind::Program`](super::SelfTestKind::Program).

use crc::{Algorithm, Crc, Digest, Table};

/// Bytes of a slice of the running test.
pub const SLICE_BYTES: usize = 256;
/// Bytes of a seal.
pub const SEAL_BYTES: usize = 16;
/// `NFIM`, little-endian: the seal was written.
pub const SEAL_MAGIC: u32 = 0x4D49_464E;
/// The longest image: flash without the pages that hold data, see memory.x.
pub const LONGEST_IMAGE: u32 = 504 * 1024;

const ALGORITHM: Algorithm<u32> = Algorithm {
    width: 32,
    poly: 0x93A4_09EB,
    init: u32::MAX,
    refin: true,
    refout: true,
    xorout: u32::MAX,
    check: 0xEEA8_BAA4,
    residue: 0,
};

static CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&ALGORITHM);

/// What the build writes into the image: magic, length, CRC, complement of the CRC; u32 each, little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageSeal {
    /// Bytes of the image from the beginning of flash on, the seal's own among them.
    pub length: u32,
    /// CRC of the image without the seal's own bytes.
    pub checksum: u32,
}

impl ImageSeal {
    /// Reads a seal; `None` if none was written, or if it is damaged.
    #[must_use]
    pub fn parse(bytes: &[u8; SEAL_BYTES]) -> Option<Self> {
        let (words, _) = bytes.as_chunks::<4>();
        let [magic, length, checksum, complement] =
            <[[u8; 4]; 4]>::try_from(words).ok()?.map(u32::from_le_bytes);
        (magic == SEAL_MAGIC && complement == !checksum && length <= LONGEST_IMAGE)
            .then_some(Self { length, checksum })
    }

    /// What the build writes.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; SEAL_BYTES] {
        let mut bytes = [0; SEAL_BYTES];
        let (slots, _) = bytes.as_chunks_mut::<4>();
        for (slot, word) in slots.iter_mut().zip([SEAL_MAGIC, self.length, self.checksum, !self.checksum]) {
            *slot = word.to_le_bytes();
        }
        bytes
    }

    /// Seals an image: its bytes before and after the seal's place.
    #[must_use]
    pub fn of(before: &[u8], after: &[u8]) -> Option<Self> {
        let length = before.len().checked_add(SEAL_BYTES)?.checked_add(after.len())?;
        let length = u32::try_from(length).ok().filter(|length| *length <= LONGEST_IMAGE)?;
        let mut digest = CRC.digest();
        digest.update(before);
        digest.update(after);
        Some(Self { length, checksum: digest.finalize() })
    }
}

/// A stretch of the image, as offsets from the beginning of flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretch {
    /// First byte.
    pub start: u32,
    /// Number of bytes, at most [`SLICE_BYTES`].
    pub length: u32,
}

/// How far a pass over the image has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Some of the image is left.
    Underway,
    /// The whole image was read, and its CRC is the sealed one.
    Intact,
    /// There is no seal, or the image differs from it.
    Damaged,
}

/// A pass over the image, slice by slice, again and again.
#[derive(Clone)]
pub struct ProgramCheck {
    seal: Option<ImageSeal>,
    /// Where the seal stands in the image.
    seal_offset: u32,
    next: u32,
    digest: Digest<'static, u32, Table<1>>,
}

impl ProgramCheck {
    /// Nothing was read yet. `seal_offset`: where the seal stands, from the beginning of flash.
    #[must_use]
    pub fn new(seal: &[u8; SEAL_BYTES], seal_offset: u32) -> Self {
        Self { seal: ImageSeal::parse(seal), seal_offset, next: 0, digest: CRC.digest() }
    }

    /// The stretch that [`Self::feed`] wants next; `None` without a seal.
    #[must_use]
    pub fn wanted(&self) -> Option<Stretch> {
        let end = self.seal?.length;
        let seal_end = self.seal_offset.saturating_add(u32::try_from(SEAL_BYTES).ok()?);
        let (start, stop) = if self.next < self.seal_offset {
            (self.next, self.seal_offset.min(end))
        } else {
            (self.next.max(seal_end), end)
        };
        let length = stop.saturating_sub(start).min(u32::try_from(SLICE_BYTES).ok()?);
        Some(Stretch { start, length })
    }

    /// Takes the bytes of the wanted stretch. When the image is through, the next pass begins.
    pub fn feed(&mut self, bytes: &[u8]) -> Progress {
        let (Some(seal), Some(wanted)) = (self.seal, self.wanted()) else { return Progress::Damaged };
        if usize::try_from(wanted.length).is_ok_and(|length| length != bytes.len()) {
            return Progress::Damaged;
        }
        self.digest.update(bytes);
        self.next = wanted.start.saturating_add(wanted.length);
        if self.next < seal.length {
            return Progress::Underway;
        }
        self.next = 0;
        let found = core::mem::replace(&mut self.digest, CRC.digest()).finalize();
        if found == seal.checksum { Progress::Intact } else { Progress::Damaged }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEAL_OFFSET: u32 = 472;

    /// A sealed image with a seal inside.
    fn image(length: usize) -> Vec<u8> {
        let mut image: Vec<u8> =
            (0..length as u32).map(|place| (place.wrapping_mul(0x9E37_79B9) >> 24) as u8).collect();
        let seal_end = SEAL_OFFSET as usize + SEAL_BYTES;
        let seal = ImageSeal::of(&image[..SEAL_OFFSET as usize], &image[seal_end..]).unwrap();
        image[SEAL_OFFSET as usize..seal_end].copy_from_slice(&seal.to_bytes());
        image
    }

    fn check_of(image: &[u8]) -> ProgramCheck {
        let seal = image[SEAL_OFFSET as usize..].first_chunk().unwrap();
        ProgramCheck::new(seal, SEAL_OFFSET)
    }

    /// One pass over the image; panics if it takes longer than the image is.
    fn pass(check: &mut ProgramCheck, image: &[u8]) -> Progress {
        for _ in 0..=image.len() {
            let Some(wanted) = check.wanted() else { return check.feed(&[]) };
            let end = (wanted.start + wanted.length) as usize;
            let bytes = &image[(wanted.start as usize).min(image.len())..end.min(image.len())];
            assert!(bytes.len() <= SLICE_BYTES);
            match check.feed(bytes) {
                Progress::Underway => {}
                end => return end,
            }
        }
        panic!("the pass does not end")
    }

    #[test]
    fn a_sealed_image_passes_again_and_again() {
        for length in [488, 489, 488 + SLICE_BYTES, 488 + SLICE_BYTES + 1, 5_000] {
            let image = image(length);
            let mut check = check_of(&image);
            for _ in 0..3 {
                assert_eq!(pass(&mut check, &image), Progress::Intact, "{length} bytes");
            }
        }
    }

    #[test]
    fn every_changed_byte_is_found_in_the_pass_that_reads_it() {
        let sound = image(1_500);
        for place in 0..sound.len() {
            let mut image = sound.clone();
            image[place] ^= 1 << (place % 8);
            assert_eq!(pass(&mut check_of(&image), &image), Progress::Damaged, "byte {place}");
        }
        let mut check = check_of(&sound);
        assert_eq!(pass(&mut check, &sound), Progress::Intact);
        let mut later = sound.clone();
        later[900] ^= 0x80;
        assert_eq!(pass(&mut check, &later), Progress::Damaged, "damaged between two passes");
    }

    #[test]
    fn an_image_without_a_seal_fails() {
        for blank in [[0; SEAL_BYTES], [0xFF; SEAL_BYTES]] {
            let mut check = ProgramCheck::new(&blank, SEAL_OFFSET);
            assert_eq!(check.wanted(), None);
            assert_eq!(check.feed(&[]), Progress::Damaged);
        }
        let too_long = ImageSeal { length: LONGEST_IMAGE + 1, checksum: 3 }.to_bytes();
        assert_eq!(ImageSeal::parse(&too_long), None);
        let longest = ImageSeal { length: LONGEST_IMAGE, checksum: 3 };
        assert_eq!(ImageSeal::parse(&longest.to_bytes()), Some(longest));
    }

    #[test]
    fn the_seal_has_one_form() {
        let seal = ImageSeal { length: 0x0001_0203, checksum: 0xA1B2_C3D4 };
        assert_eq!(seal.to_bytes(), *b"NFIM\x03\x02\x01\x00\xD4\xC3\xB2\xA1\x2B\x3C\x4D\x5E");
    }

    #[test]
    fn an_image_that_is_too_long_cannot_be_sealed() {
        let most = LONGEST_IMAGE as usize - SEAL_BYTES;
        assert!(ImageSeal::of(&vec![0; most], &[]).is_some());
        assert_eq!(ImageSeal::of(&vec![0; most], &[0]), None);
    }

    #[test]
    fn a_slice_of_another_length_fails() {
        let image = image(1_000);
        for length in [0, SLICE_BYTES - 1, SLICE_BYTES + 1] {
            assert_eq!(check_of(&image).feed(&image[..length]), Progress::Damaged, "{length}");
        }
    }

    #[test]
    fn the_algorithm_is_the_one_that_is_described() {
        assert_eq!(CRC.checksum(b"123456789"), ALGORITHM.check);
    }

    /// Distance 4 at the longest image: no codeword of weight 1, 2 or 3. Odd weights cannot be, since the polynomial
    /// has the factor x + 1 (an even number of terms); weight 2 would be x^i = 1 for some i up to the length.
    #[test]
    #[cfg_attr(miri, ignore = "millions of steps")]
    fn any_three_wrong_bits_of_the_longest_image_are_found() {
        assert_eq!((ALGORITHM.poly.count_ones() + 1) % 2, 0, "x + 1 divides the polynomial");
        let bits = LONGEST_IMAGE * 8 + 32;
        let mut power = 1_u32;
        for exponent in 1..=bits {
            power = (power << 1) ^ if power >> 31 == 1 { ALGORITHM.poly } else { 0 };
            assert_ne!(power, 1, "two wrong bits {exponent} apart would cancel");
        }
    }
}
