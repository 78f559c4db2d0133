//! The configuration in use against the stored one: the rig's compact form under its CRC.
//!
//! At start the controller computes its column maps from the stored rig and names it by its calibration id. While
//! running, the stored form is checked again and again: a rig that has changed since is not the one in use any more.
//!
//! **Time:** about 15 instructions a byte. **Failure:**
//! [`SelfTestKind::Configuration`](super::SelfTestKind::Configuration).

use super::Outcome;
use nearfield_shared::rig::Rig;
use nearfield_shared::units::CalibrationId;
use nearfield_shared::wire;

/// Is the stored rig (its compact form) whole, and the one that is in use? A controller that has none passes: it never
/// closes the relays, for a cause of its own.
#[must_use]
pub fn check(stored: &[u8], in_use: Option<CalibrationId>) -> Outcome {
    let Some(in_use) = in_use else { return Outcome::Passed };
    let same = wire::is_sealed(stored)
        && Rig::from_bytes(stored).is_ok_and(|stored| stored.calibration_id() == in_use);
    Outcome::passed_if(same)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::rig;

    #[test]
    fn the_stored_rig_that_is_in_use_passes() {
        assert_eq!(check(&rig().to_bytes(), Some(rig().calibration_id())), Outcome::Passed);
    }

    #[test]
    fn another_rig_fails() {
        let other = CalibrationId::new(rig().calibration_id().get() ^ 1);
        assert_eq!(check(&rig().to_bytes(), Some(other)), Outcome::Failed);
    }

    #[test]
    fn every_damaged_byte_fails() {
        let sound = rig().to_bytes();
        for place in 0..sound.len() {
            let mut stored = sound;
            stored[place] ^= 0x10;
            assert_eq!(check(&stored, Some(rig().calibration_id())), Outcome::Failed, "byte {place}");
        }
        assert_eq!(check(&[], Some(rig().calibration_id())), Outcome::Failed);
    }

    #[test]
    fn without_a_rig_in_use_there_is_nothing_to_compare() {
        assert_eq!(check(&[], None), Outcome::Passed);
    }
}
