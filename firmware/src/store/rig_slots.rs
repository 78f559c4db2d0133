//! The rig in two slots of one flash page each, so that a power cut leaves the old rig or the new one.
//!
//! A slot, little-endian, [`SLOT_LENGTH`] bytes:
//!
//! | offset | field |
//! |---|---|
//! | 0 | magic `NFRS`, version u16 (1), zero u16 |
//! | 8 | generation u32, calibration id u32 |
//! | 16 | the rig's compact form, 160 bytes |
//! | 176 | CRC-32 (see [`nearfield_shared::wire`]) of all before, and its complement |
//! | 184 | the mark: magic `NFOK`, generation u32, calibration id u32, CRC-32 of these; erased = not in force |
//!
//! ```text
//!           stage                          acknowledge
//!  erased ---------> candidate: whole,  ---------------> active: whole and marked
//!    ^               not marked                            |
//!    +-----------------------------------------------------+ the other slot becomes active
//! ```
//!
//! The marked slot of the highest generation is active. A mark names the generation and the rig of its own slot, so
//! that it cannot speak for what is written over it. The old slot is erased as soon as the new one is active: damage to
//! the new one then leaves no rig at all, and the relays stay open, instead of bringing an outdated one back unnoticed.

use super::StoreError;
use embedded_storage_async::nor_flash::NorFlash;
use nearfield_shared::rig::{COMPACT_LENGTH, Rig};
use nearfield_shared::units::CalibrationId;
use nearfield_shared::wire::{checksum, is_sealed, seal_of};

/// The parts of a slot begin and end at multiples of this, in bytes.
pub const WRITE_UNIT: usize = 8;
const BODY_LENGTH: usize = 16 + COMPACT_LENGTH + 8;
const MARK_LENGTH: usize = 16;
/// Bytes of a slot.
pub const SLOT_LENGTH: usize = BODY_LENGTH + MARK_LENGTH;
const _: () = assert!(BODY_LENGTH.is_multiple_of(WRITE_UNIT) && MARK_LENGTH.is_multiple_of(WRITE_UNIT));

const SLOT_MAGIC: [u8; 4] = *b"NFRS";
const MARK_MAGIC: [u8; 4] = *b"NFOK";
const SLOT_VERSION: u16 = 1;
const ERASED: u8 = 0xFF;

/// A slot that holds a whole rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stored {
    generation: u32,
    rig: [u8; COMPACT_LENGTH],
    mark: Mark,
}

/// What stands behind the rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mark {
    /// Nothing: the rig waits for its acknowledgement.
    Erased,
    /// The rig's own mark.
    Whole,
    /// Something else, for instance a mark that was cut short: the slot must be written anew.
    Spoiled,
}

impl Stored {
    fn calibration(&self) -> CalibrationId {
        CalibrationId::new(seal_of(&self.rig))
    }

    fn is_active(&self) -> bool {
        self.mark == Mark::Whole
    }

    fn is_candidate(&self) -> bool {
        self.mark == Mark::Erased
    }

    fn body(&self) -> [u8; BODY_LENGTH] {
        let mut body = [0; BODY_LENGTH];
        let head = SLOT_MAGIC
            .into_iter()
            .chain(SLOT_VERSION.to_le_bytes())
            .chain([0, 0])
            .chain(self.generation.to_le_bytes())
            .chain(self.calibration().get().to_le_bytes());
        for (slot, byte) in body.iter_mut().zip(head.chain(self.rig)) {
            *slot = byte;
        }
        if let Some((sealed, seal)) = body.split_last_chunk_mut::<8>() {
            let [a, b, c, d] = checksum(sealed).to_le_bytes();
            *seal = [a, b, c, d, !a, !b, !c, !d];
        }
        body
    }

    fn mark_bytes(&self) -> [u8; MARK_LENGTH] {
        let mut mark = [0; MARK_LENGTH];
        let fields = MARK_MAGIC
            .into_iter()
            .chain(self.generation.to_le_bytes())
            .chain(self.calibration().get().to_le_bytes());
        for (slot, byte) in mark.iter_mut().zip(fields) {
            *slot = byte;
        }
        if let Some((sealed, seal)) = mark.split_last_chunk_mut::<4>() {
            *seal = checksum(sealed).to_le_bytes();
        }
        mark
    }

    /// Reads a slot; `None` unless it holds a whole and valid rig.
    fn parse(bytes: &[u8; SLOT_LENGTH]) -> Option<Self> {
        let (body, mark) = bytes.split_first_chunk::<BODY_LENGTH>()?;
        let (head, rest) = body.split_first_chunk::<16>()?;
        let (rig, _) = rest.split_first_chunk::<COMPACT_LENGTH>()?;
        let generation = u32::from_le_bytes(*head.get(8..)?.first_chunk::<4>()?);
        let mut stored = Self { generation, rig: *rig, mark: Mark::Spoiled };
        // Written again from what was read, every byte must be the same: magic, version, id, CRC and its complement.
        if *body != stored.body() || !is_sealed(rig) || Rig::from_bytes(rig).is_err() {
            return None;
        }
        if mark.iter().all(|byte| *byte == ERASED) {
            stored.mark = Mark::Erased;
        } else if *mark == stored.mark_bytes() {
            stored.mark = Mark::Whole;
        }
        Some(stored)
    }
}

/// Both slots, looked at together.
struct Survey {
    active: Option<Stored>,
    /// The slot that is not active.
    spare: u32,
    /// The candidate in the spare slot.
    candidate: Option<Stored>,
    /// Above every generation that is stored.
    next_generation: u32,
}

/// Both slots.
#[derive(Debug)]
pub(super) struct RigSlots<'a, F> {
    flash: &'a mut F,
    offsets: [u32; 2],
}

impl<'a, F: NorFlash> RigSlots<'a, F> {
    pub(super) const fn new(flash: &'a mut F, offsets: [u32; 2]) -> Self {
        Self { flash, offsets }
    }

    /// What a slot holds; the error is the flash's.
    async fn read(&mut self, offset: u32) -> Result<Option<Stored>, StoreError> {
        let mut bytes = [0; SLOT_LENGTH];
        self.flash.read(offset, &mut bytes).await.map_err(|_| StoreError::Flash)?;
        Ok(Stored::parse(&bytes))
    }

    /// Where the active rig is and where a candidate may stand.
    async fn survey(&mut self) -> Survey {
        let [first, second] = self.offsets;
        let (one, other) = (self.read(first).await, self.read(second).await);
        let first_readable = one.is_ok() || other.is_err();
        let (one, other) = (one.ok().flatten(), other.ok().flatten());
        let generation = |slot: Option<Stored>| slot.map_or(0, |stored| stored.generation);
        let generations = [generation(one), generation(other)];
        let next = generations.into_iter().fold(0, u32::max).saturating_add(1);
        let marked = |slot: Option<Stored>| slot.filter(Stored::is_active);
        let (active, spare) = match (marked(one), marked(other)) {
            (Some(one), Some(other)) if one.generation > other.generation => (Some(one), second),
            (Some(one), Some(other)) if one.generation < other.generation => (Some(other), first),
            // Two marks of one generation cannot come from here: neither is believed.
            (Some(_), Some(_)) => (None, first),
            (Some(one), None) => (Some(one), second),
            (None, Some(other)) => (Some(other), first),
            // A slot that cannot be read now may be the active one after all: it is spared if possible.
            (None, None) => (None, if first_readable { first } else { second }),
        };
        let candidate = if spare == first { one } else { other };
        // A candidate that does not supersede the active rig could never come into force.
        let superseded = active.map_or(0, |active| active.generation);
        let candidate = candidate.filter(|slot| slot.is_candidate() && slot.generation > superseded);
        Survey { active, spare, candidate, next_generation: next }
    }

    pub(super) async fn active(&mut self) -> Option<[u8; COMPACT_LENGTH]> {
        self.survey().await.active.map(|stored| stored.rig)
    }

    pub(super) async fn candidate(&mut self) -> Option<[u8; COMPACT_LENGTH]> {
        self.survey().await.candidate.map(|stored| stored.rig)
    }

    pub(super) async fn stage(&mut self, rig: &[u8; COMPACT_LENGTH]) -> Result<(), StoreError> {
        Rig::from_bytes(rig).map_err(StoreError::Invalid)?;
        let Survey { spare, next_generation: generation, .. } = self.survey().await;
        let stored = Stored { generation, rig: *rig, mark: Mark::Erased };
        self.erase(spare).await?;
        self.flash.write(spare, &stored.body()).await.map_err(|_| StoreError::Flash)?;
        if self.survey().await.candidate == Some(stored) { Ok(()) } else { Err(StoreError::Flash) }
    }

    pub(super) async fn acknowledge(&mut self, calibration: CalibrationId) -> Result<(), StoreError> {
        let before = self.survey().await;
        let candidate = before.candidate.ok_or(StoreError::Nothing)?;
        if candidate.calibration() != calibration {
            return Err(StoreError::OtherCandidate(candidate.calibration()));
        }
        let mark = u32::try_from(BODY_LENGTH).map_err(|_| StoreError::Flash)?;
        let mark = before.spare.saturating_add(mark);
        self.flash.write(mark, &candidate.mark_bytes()).await.map_err(|_| StoreError::Flash)?;
        let after = self.survey().await;
        if after.active.map(|active| active.rig) != Some(candidate.rig) {
            return Err(StoreError::Flash);
        }
        // The new rig is in force whether or not this succeeds: the old one's generation is lower.
        let _ = self.erase(after.spare).await;
        Ok(())
    }

    async fn erase(&mut self, offset: u32) -> Result<(), StoreError> {
        let page = u32::try_from(F::ERASE_SIZE).map_err(|_| StoreError::Flash)?;
        self.flash.erase(offset, offset.saturating_add(page)).await.map_err(|_| StoreError::Flash)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::flash_model::{FlashModel, START};
    use crate::testing;
    use embassy_futures::block_on;

    fn stored(generation: u32, mark: Mark) -> Stored {
        Stored { generation, rig: testing::rig().to_bytes(), mark }
    }

    /// The bytes of the module's table, so that a rig that one version has stored is read by the next.
    #[test]
    fn a_slot_has_the_bytes_that_its_table_says() {
        let slot = stored(0x0102_0304, Mark::Whole);
        let id = seal_of(&slot.rig).to_le_bytes();
        let body = slot.body();
        assert_eq!(&body[..12], b"NFRS\x01\0\0\0\x04\x03\x02\x01");
        assert_eq!(body[12..16], id);
        assert_eq!(body[16..176], slot.rig);
        let seal = checksum(&body[..176]).to_le_bytes();
        assert_eq!(body[176..180], seal);
        assert_eq!(body[180..184], seal.map(|byte| !byte));
        let mark = slot.mark_bytes();
        assert_eq!(&mark[..8], b"NFOK\x04\x03\x02\x01");
        assert_eq!(mark[8..12], id);
        assert_eq!(mark[12..], checksum(&mark[..12]).to_le_bytes());
    }

    /// A candidate must be newer than the rig in force: one of the same age could never come into force.
    #[test]
    fn a_candidate_supersedes_the_rig_in_force() {
        for (generation, is_candidate) in [(6, false), (7, false), (8, true)] {
            let mut flash = FlashModel::new();
            let [first, second] = [START, START + 2048];
            let mut put = |offset: u32, bytes: &[u8]| {
                let offset = usize::try_from(offset).unwrap();
                flash.bytes[offset..offset + bytes.len()].copy_from_slice(bytes);
            };
            let in_force = stored(7, Mark::Whole);
            put(first, &in_force.body());
            put(first + 184, &in_force.mark_bytes());
            put(second, &stored(generation, Mark::Erased).body());
            let mut slots = RigSlots::new(&mut flash, [first, second]);
            assert_eq!(block_on(slots.active()), Some(in_force.rig));
            assert_eq!(block_on(slots.candidate()).is_some(), is_candidate, "{generation}");
        }
    }
}
