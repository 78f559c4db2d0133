//! A flash of the store's size in this board's memory, with the word and page of the STM32G474: the emulated controller
//! runs the same store as the board. A reset erases it; the host then sends the rig again.

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use nearfield_firmware::store::{STORE_PAGES, Store};
use nearfield_shared::rig::Rig;
use static_cell::ConstStaticCell;

const PAGE_LENGTH: usize = 2048;
const WORD_LENGTH: usize = 8;
const LENGTH: usize = PAGE_LENGTH * STORE_PAGES as usize;

static CONTENT: ConstStaticCell<[u8; LENGTH]> = ConstStaticCell::new([0; LENGTH]);

/// The pages.
pub(crate) struct MemoryFlash(&'static mut [u8; LENGTH]);

impl MemoryFlash {
    /// Erased. The only one: a second call ends the program.
    pub(crate) fn take() -> Self {
        let content = CONTENT.take();
        content.fill(0xFF);
        Self(content)
    }

    fn range(&mut self, offset: u32, length: usize, unit: usize) -> Result<&mut [u8], NorFlashErrorKind> {
        let start = offset as usize;
        if !start.is_multiple_of(unit) || !length.is_multiple_of(unit) {
            return Err(NorFlashErrorKind::NotAligned);
        }
        let end = start.checked_add(length).ok_or(NorFlashErrorKind::OutOfBounds)?;
        self.0.get_mut(start..end).ok_or(NorFlashErrorKind::OutOfBounds)
    }
}

impl ErrorType for MemoryFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for MemoryFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        bytes.copy_from_slice(self.range(offset, bytes.len(), Self::READ_SIZE)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        LENGTH
    }
}

impl NorFlash for MemoryFlash {
    const WRITE_SIZE: usize = WORD_LENGTH;
    const ERASE_SIZE: usize = PAGE_LENGTH;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        let length = to.checked_sub(from).ok_or(NorFlashErrorKind::OutOfBounds)?;
        self.range(from, length as usize, PAGE_LENGTH)?.fill(0xFF);
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let words = self.range(offset, bytes.len(), WORD_LENGTH)?;
        // A word with error correction takes one write after an erase.
        if words.iter().any(|byte| *byte != 0xFF) {
            return Err(NorFlashErrorKind::Other);
        }
        words.copy_from_slice(bytes);
        Ok(())
    }
}

/// A valid rig is in force in the store from now on.
pub(crate) fn put_rig(store: &mut Store<MemoryFlash>, stored_rig: &[u8]) {
    if let Ok(rig) = Rig::from_bytes(stored_rig) {
        // What the flash did not take shows when the rig is read.
        let _ = block_on(store.stage_rig(&rig.to_bytes()));
        let _ = block_on(store.acknowledge_rig(rig.calibration_id()));
    }
}
