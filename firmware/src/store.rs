//! What outlives a reset: the rig, double-buffered, and the fault log; generic over the flash.
//!
//! [`STORE_PAGES`] pages from an offset on, in this order:
//!
//! | page | holds |
//! |---|---|
//! | 0, 1 | the two slots of the rig, see [`rig_slots`] |
//! | 2, 3 | the fault log, a wear-levelled queue of `sequential-storage` |
//!
//! Power may fail at any byte of any write or erase. The rig is then the old one or the new one, whole; of the fault
//! log the entry that was being written may be missing.
//!
//! This runs below the safety task: slowly, in thread mode, and nothing here can close a relay. The rig in use is read
//! once, at start; a change is in force from the next start on.
//!
//! Not covered: a word whose programming was cut so that it reads differently each time. On a flash with error
//! correction such a word is a read error; a slot that cannot be read is no slot.

pub mod rig_slots;

use crate::fault_log::FaultLog;
use crate::service::{FlashJob, JobOutcome};
use core::ops::Range;
use embedded_storage_async::nor_flash::NorFlash;
use nearfield_shared::rig::{COMPACT_LENGTH, CompactRigError};
use nearfield_shared::service::{FAULT_ENTRY_LENGTH, FaultEntry};
use nearfield_shared::units::CalibrationId;
use rig_slots::RigSlots;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::queue::{QueueConfig, QueueStorage};

/// Pages of the rig's slots.
pub const RIG_PAGES: u32 = 2;
/// Pages of the fault log. A page of 2 KiB holds more entries than the log, and one of the two is always whole.
pub const LOG_PAGES: u32 = 2;
/// Pages in all.
pub const STORE_PAGES: u32 = RIG_PAGES + LOG_PAGES;

/// Why the store did not do what it was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoreError {
    /// The bytes are no valid rig.
    Invalid(CompactRigError),
    /// There is nothing of the kind.
    Nothing,
    /// The candidate has another calibration id.
    OtherCandidate(CalibrationId),
    /// The flash reports an error, or it does not hold what was written.
    Flash,
}

impl core::fmt::Display for StoreError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Invalid(error) => write!(f, "not stored: {error}"),
            Self::Nothing => f.write_str("nothing of the kind is stored"),
            Self::OtherCandidate(id) => write!(f, "the candidate has the calibration id {:08x}", id.get()),
            Self::Flash => f.write_str("the flash does not hold what was written"),
        }
    }
}

impl core::error::Error for StoreError {}

type LogCache = Cache<Uncached, Uncached, Uncached>;

/// The flash's pages that outlive a reset; see the module's documentation.
#[derive(Debug)]
pub struct Store<F> {
    flash: F,
    start: u32,
}

impl<F: NorFlash> Store<F> {
    /// Over [`STORE_PAGES`] pages from the byte offset `start` on, which is a page's beginning.
    #[must_use]
    pub const fn new(flash: F, start: u32) -> Self {
        const {
            assert!(F::ERASE_SIZE >= rig_slots::SLOT_LENGTH, "a slot must fit one page");
            assert!(
                rig_slots::WRITE_UNIT.is_multiple_of(F::WRITE_SIZE),
                "the slots' parts must be whole words"
            );
            assert!(rig_slots::WRITE_UNIT.is_multiple_of(F::READ_SIZE), "the slots' parts must be readable");
        }
        Self { flash, start }
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.flash
    }

    fn page(&self, index: u32) -> u32 {
        let length = u32::try_from(F::ERASE_SIZE).unwrap_or(u32::MAX);
        self.start.saturating_add(length.saturating_mul(index))
    }

    fn rigs(&mut self) -> RigSlots<'_, F> {
        let offsets = [self.page(0), self.page(1)];
        RigSlots::new(&mut self.flash, offsets)
    }

    fn log(&mut self) -> Option<QueueStorage<&mut F, LogCache>> {
        let range: Range<u32> = self.page(RIG_PAGES)..self.page(STORE_PAGES);
        let config = QueueConfig::try_new(range).ok()?;
        Some(QueueStorage::new(&mut self.flash, config, Cache::new_uncached()))
    }

    /// The rig in force at the next start: its compact form; `None` if there is none.
    pub async fn active_rig(&mut self) -> Option<[u8; COMPACT_LENGTH]> {
        self.rigs().active().await
    }

    /// The rig that waits for its acknowledgement.
    pub async fn candidate(&mut self) -> Option<[u8; COMPACT_LENGTH]> {
        self.rigs().candidate().await
    }

    /// Keeps a rig's compact form as the candidate; an earlier candidate is given up, the active rig stays.
    ///
    /// # Errors
    /// The bytes are no valid rig (nothing is touched then), or the flash does not take them.
    pub async fn stage_rig(&mut self, rig: &[u8; COMPACT_LENGTH]) -> Result<(), StoreError> {
        self.rigs().stage(rig).await
    }

    /// Puts the candidate in force; the old rig is erased.
    ///
    /// # Errors
    /// There is no candidate, or another one; or the flash does not take it: the old rig stays.
    pub async fn acknowledge_rig(&mut self, calibration: CalibrationId) -> Result<(), StoreError> {
        self.rigs().acknowledge(calibration).await
    }

    /// Does what a service request needs of the flash.
    pub async fn run(&mut self, job: &FlashJob) -> JobOutcome {
        let rig = |rig: Option<[u8; COMPACT_LENGTH]>| rig.ok_or(StoreError::Nothing).map(Some);
        match job {
            FlashJob::ReadRig => rig(self.active_rig().await),
            FlashJob::ReadCandidate => rig(self.candidate().await),
            FlashJob::StoreRig(rig) => self.stage_rig(rig).await.map(|()| None),
            FlashJob::AcknowledgeRig(calibration) => self.acknowledge_rig(*calibration).await.map(|()| None),
        }
    }

    /// Restores the fault log from what the flash holds, as far as it can be read.
    pub async fn load_log(&mut self, log: &mut FaultLog) {
        let Some(mut queue) = self.log() else { return };
        let Ok(mut entries) = queue.iter().await else { return };
        // A later firmware's entries may be longer: they are passed over, and do not end the log.
        let mut buffer = [0; 2 * FAULT_ENTRY_LENGTH];
        while let Ok(Some(entry)) = entries.next(&mut buffer).await {
            log.restore(&entry);
        }
    }

    /// Keeps an entry of the fault log; the oldest ones give way. A log that is damaged beyond repair is given up:
    /// the newest entry is worth more than none.
    ///
    /// # Errors
    /// The flash does not take it.
    pub async fn save_entry(&mut self, entry: &FaultEntry) -> Result<(), StoreError> {
        let mut queue = self.log().ok_or(StoreError::Flash)?;
        let bytes = entry.to_bytes();
        if queue.push(&bytes, true).await.is_ok() {
            return Ok(());
        }
        queue.erase_all().await.map_err(|_| StoreError::Flash)?;
        queue.push(&bytes, true).await.map_err(|_| StoreError::Flash)
    }
}

#[cfg(test)]
mod flash_model;
#[cfg(test)]
mod tests;
