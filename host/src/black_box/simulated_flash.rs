//! The last pages of the microcontroller's flash, for controllers that are simulated on this computer: the firmware's
//! own [`Store`](nearfield_firmware::store::Store) runs over it.

use std::ops::Range;

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use nearfield_firmware::store::STORE_PAGES;

/// Bytes of a page, as on the board.
pub const PAGE_LENGTH: usize = 2048;
/// Bytes of a word, as on the board.
pub const WORD_LENGTH: usize = 8;
const LENGTH: usize = PAGE_LENGTH * STORE_PAGES as usize;

/// The store's pages. They keep their content over resets and power cycles of the controller beside them.
#[derive(Debug, Clone)]
pub struct SimulatedFlash {
    bytes: Box<[u8; LENGTH]>,
}

impl SimulatedFlash {
    /// As delivered: erased.
    #[must_use]
    pub fn new() -> Self {
        Self { bytes: Box::new([0xFF; LENGTH]) }
    }
}

/// The bytes that an operation is about.
fn range(offset: u32, length: usize, unit: usize) -> Result<Range<usize>, NorFlashErrorKind> {
    let start = offset as usize;
    if !start.is_multiple_of(unit) || !length.is_multiple_of(unit) {
        return Err(NorFlashErrorKind::NotAligned);
    }
    let end = start.checked_add(length).filter(|end| *end <= LENGTH);
    end.map(|end| start..end).ok_or(NorFlashErrorKind::OutOfBounds)
}

impl Default for SimulatedFlash {
    fn default() -> Self {
        Self::new()
    }
}

impl ErrorType for SimulatedFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for SimulatedFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        bytes.copy_from_slice(&self.bytes[range(offset, bytes.len(), Self::READ_SIZE)?]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        LENGTH
    }
}

impl NorFlash for SimulatedFlash {
    const WRITE_SIZE: usize = WORD_LENGTH;
    const ERASE_SIZE: usize = PAGE_LENGTH;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        let length = to.checked_sub(from).ok_or(NorFlashErrorKind::OutOfBounds)?;
        self.bytes[range(from, length as usize, PAGE_LENGTH)?].fill(0xFF);
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let words = &mut self.bytes[range(offset, bytes.len(), WORD_LENGTH)?];
        // A word with error correction takes one write after an erase.
        if words.iter().any(|byte| *byte != 0xFF) {
            return Err(NorFlashErrorKind::Other);
        }
        words.copy_from_slice(bytes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embassy_futures::block_on;

    #[test]
    fn a_word_takes_one_write_after_an_erase_and_misuse_is_refused() {
        let mut flash = SimulatedFlash::default();
        let mut read = [0; 16];
        assert_eq!(block_on(flash.write(8, &[1; 16])), Ok(()));
        assert_eq!(block_on(flash.read(8, &mut read)), Ok(()));
        assert_eq!(read, [1; 16]);
        assert_eq!(block_on(flash.write(16, &[0; 8])), Err(NorFlashErrorKind::Other), "written already");
        assert_eq!(block_on(flash.erase(0, 2048)), Ok(()));
        assert_eq!(block_on(flash.write(16, &[0; 8])), Ok(()));
        assert_eq!(block_on(flash.write(4, &[0; 8])), Err(NorFlashErrorKind::NotAligned));
        assert_eq!(block_on(flash.erase(0, 100)), Err(NorFlashErrorKind::NotAligned));
        assert_eq!(block_on(flash.erase(2048, 0)), Err(NorFlashErrorKind::OutOfBounds), "backwards");
        assert_eq!(block_on(flash.erase(2048, 5 * 2048)), Err(NorFlashErrorKind::OutOfBounds));
        assert_eq!(block_on(flash.read(4 * 2048, &mut read)), Err(NorFlashErrorKind::OutOfBounds));
    }
}
