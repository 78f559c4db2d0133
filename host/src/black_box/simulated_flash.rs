//! The last pages of the microcontroller's flash, for controllers that are simulated on this computer: the firmware's
//! own [`Store`](nearfield_firmware::store::Store) runs over it.

use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use nearfield_firmware::store::{RIG_PAGES, STORE_PAGES};

/// Bytes of a page, as on the board.
pub const PAGE_LENGTH: usize = 2048;
/// Bytes of a word, as on the board.
pub const WORD_LENGTH: usize = 8;
const LENGTH: usize = PAGE_LENGTH * STORE_PAGES as usize;

/// The store's pages. They keep their content over resets and power cycles of the controller beside them; a clone is
/// another handle to the same chip.
#[derive(Debug, Clone)]
pub struct SimulatedFlash(Arc<Mutex<[u8; LENGTH]>>);

impl SimulatedFlash {
    /// As delivered: erased.
    #[must_use]
    pub fn new() -> Self {
        Self(Arc::new(Mutex::new([0xFF; LENGTH])))
    }

    /// From a file's content; `None` unless it has the length of these pages.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        Some(Self(Arc::new(Mutex::new(bytes.try_into().ok()?))))
    }

    /// The content, for a file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        self.content().to_vec()
    }

    /// Erases the rig's slots: no rig is stored.
    pub fn forget_rig(&self) {
        self.content()[..PAGE_LENGTH * RIG_PAGES as usize].fill(0xFF);
    }

    fn content(&self) -> MutexGuard<'_, [u8; LENGTH]> {
        // Torn content is what the store is made for.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
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
        bytes.copy_from_slice(&self.content()[range(offset, bytes.len(), Self::READ_SIZE)?]);
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
        self.content()[range(from, length as usize, PAGE_LENGTH)?].fill(0xFF);
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let mut content = self.content();
        let words = &mut content[range(offset, bytes.len(), WORD_LENGTH)?];
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
        let copy = SimulatedFlash::from_bytes(&flash.to_bytes()).unwrap();
        assert_eq!(copy.to_bytes()[8..24], [1; 16]);
        assert!(SimulatedFlash::from_bytes(&flash.to_bytes()[1..]).is_none());
        flash.clone().forget_rig();
        assert_eq!(flash.to_bytes(), [0xFF; LENGTH], "the same chip");
        flash = copy;
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
