//! A flash for tests: pages of 2 KiB and words of 8 bytes as on the board, and a power supply that fails at any byte.
//!
//! What a power cut leaves behind is worse than any real flash is allowed to leave: the word that is being written and
//! the page that is being erased may hold anything.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// As on the board.
pub(crate) const PAGE: usize = 2048;
/// As on the board.
pub(crate) const WORD: usize = 8;
/// The store's four pages behind another one, so that an offset of zero by mistake is noticed.
pub(crate) const PAGES: usize = 5;
/// Where the store begins.
pub(crate) const START: u32 = 2048;

/// What stands in the bytes that a cut operation had still to change, within the word (writing) or the page (erasing).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tear {
    /// What stood there before.
    Old,
    /// Some bits as before, some as they were to be.
    Mixed,
    /// Anything.
    Garbage,
}

impl Tear {
    pub(crate) const ALL: [Self; 3] = [Self::Old, Self::Mixed, Self::Garbage];
}

/// Why an operation failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FlashError {
    /// The power is gone.
    Power,
    /// This word does not pass its error correction, or takes no data.
    Defect,
    /// A misuse: unaligned, out of bounds, or a word that was written twice.
    Misuse(NorFlashErrorKind),
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Misuse(kind) => *kind,
            Self::Power | Self::Defect => NorFlashErrorKind::Other,
        }
    }
}

/// The flash.
#[derive(Debug, Clone)]
pub(crate) struct FlashModel {
    pub(crate) bytes: Vec<u8>,
    written: Vec<bool>,
    /// Bytes that can still be changed before the power fails.
    power: Option<usize>,
    /// The power has failed: nothing works any more.
    dead: bool,
    tear: Tear,
    /// Reading this byte is an error.
    pub(crate) unreadable: Option<usize>,
    /// Writes leave this byte as it is, silently.
    pub(crate) stuck: Option<usize>,
    /// Erasing is an error.
    pub(crate) no_erase: bool,
    /// Bytes changed (written or erased) so far.
    pub(crate) changed: usize,
    pub(crate) erases: [u32; PAGES],
    random: u64,
}

impl FlashModel {
    pub(crate) fn new() -> Self {
        Self {
            bytes: vec![0xFF; PAGES * PAGE],
            written: vec![false; PAGES * PAGE / WORD],
            power: None,
            dead: false,
            tear: Tear::Old,
            unreadable: None,
            stuck: None,
            no_erase: false,
            changed: 0,
            erases: [0; PAGES],
            random: 0x9E37_79B9_7F4A_7C15,
        }
    }

    /// The same flash after the power has come back.
    pub(crate) fn restarted(&self) -> Self {
        Self { power: None, dead: false, ..self.clone() }
    }

    /// The same flash, whose power will fail after this many bytes have been changed.
    pub(crate) fn failing_after(&self, power: usize, tear: Tear) -> Self {
        Self { power: Some(power), tear, ..self.clone() }
    }

    fn byte(&mut self) -> u8 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random.to_le_bytes()[3]
    }

    /// Changes bytes one after the other until the power fails; `region` is what may be torn then.
    fn change(
        &mut self,
        at: usize,
        values: impl Iterator<Item = u8>,
        region: usize,
    ) -> Result<(), FlashError> {
        for (address, value) in (at..).zip(values) {
            if self.power == Some(0) {
                self.dead = true;
                let end = (address / region + 1) * region;
                for torn in address..end {
                    let (old, random) = (self.bytes[torn], self.byte());
                    self.bytes[torn] = match self.tear {
                        Tear::Old => old,
                        Tear::Mixed if region == PAGE => old | random,
                        Tear::Mixed => (old & random) | (value & !random),
                        Tear::Garbage => random,
                    };
                }
                return Err(FlashError::Power);
            }
            self.power = self.power.map(|power| power - 1);
            self.changed += 1;
            if self.stuck != Some(address) {
                self.bytes[address] = value;
            }
        }
        Ok(())
    }

    fn check(&self, offset: u32, length: usize, unit: usize) -> Result<usize, FlashError> {
        let offset = offset as usize;
        if self.dead {
            return Err(FlashError::Power);
        }
        if !offset.is_multiple_of(unit) || !length.is_multiple_of(unit) {
            return Err(FlashError::Misuse(NorFlashErrorKind::NotAligned));
        }
        if offset < START as usize || offset + length > self.bytes.len() {
            return Err(FlashError::Misuse(NorFlashErrorKind::OutOfBounds));
        }
        Ok(offset)
    }
}

impl ErrorType for FlashModel {
    type Error = FlashError;
}

impl ReadNorFlash for FlashModel {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let at = self.check(offset, bytes.len(), Self::READ_SIZE)?;
        if self.unreadable.is_some_and(|bad| (at..at + bytes.len()).contains(&bad)) {
            return Err(FlashError::Defect);
        }
        bytes.copy_from_slice(&self.bytes[at..at + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for FlashModel {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let length = (to as usize).checked_sub(from as usize).unwrap();
        let at = self.check(from, length, PAGE)?;
        if self.no_erase {
            return Err(FlashError::Defect);
        }
        for page in (at..at + length).step_by(PAGE) {
            self.erases[page / PAGE] += 1;
            // A torn page counts as written all over: only a whole erase makes it writable.
            self.written[page / WORD..(page + PAGE) / WORD].fill(true);
            self.change(page, std::iter::repeat_n(0xFF, PAGE), PAGE)?;
            self.written[page / WORD..(page + PAGE) / WORD].fill(false);
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let at = self.check(offset, bytes.len(), WORD)?;
        for (word, values) in (at..).step_by(WORD).zip(bytes.chunks(WORD)) {
            // Error correction: a word takes one write, except for zeros.
            if self.written[word / WORD] && values.iter().any(|value| *value != 0) {
                return Err(FlashError::Misuse(NorFlashErrorKind::Other));
            }
            self.written[word / WORD] = true;
            self.change(word, values.iter().copied(), WORD)?;
        }
        Ok(())
    }
}
