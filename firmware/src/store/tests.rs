//! The store's rules: the old rig or the new one at every power cut, and a fault log that survives.

use super::flash_model::{FlashModel, PAGE, START, Tear};
use super::rig_slots::SLOT_LENGTH;
use super::*;
use crate::fault_log::Occurrence;
use crate::testing;
use embassy_futures::block_on;
use nearfield_shared::causes::StopCauses;
use nearfield_shared::rig::{ImageSize, Rig};
use nearfield_shared::service::FaultEvent;
use nearfield_shared::status::{ResetCause, StateCode};
use nearfield_shared::units::Micros;
use nearfield_shared::wire::seal_of;

type Bytes = [u8; COMPACT_LENGTH];

/// Valid rigs that differ by their picture's height.
fn rig(number: u16) -> Bytes {
    let rig = testing::rig();
    let image = ImageSize { height: 480 + number, ..rig.image() };
    Rig::new(image, *rig.camera(), *rig.laser(), *rig.stripe()).unwrap().to_bytes()
}

fn id(rig: &Bytes) -> CalibrationId {
    CalibrationId::new(seal_of(rig))
}

fn store(flash: FlashModel) -> Store<FlashModel> {
    Store::new(flash, START)
}

fn active(flash: &FlashModel) -> Option<Bytes> {
    block_on(store(flash.restarted()).active_rig())
}

fn candidate(flash: &FlashModel) -> Option<Bytes> {
    block_on(store(flash.restarted()).candidate())
}

/// Stores and acknowledges; the flash afterwards.
fn change(flash: FlashModel, rig: &Bytes) -> (FlashModel, Result<(), StoreError>) {
    let mut store = store(flash);
    let result = block_on(async {
        store.stage_rig(rig).await?;
        store.acknowledge_rig(id(rig)).await
    });
    (store.into_flash(), result)
}

fn with_rigs(numbers: impl IntoIterator<Item = u16>) -> FlashModel {
    numbers.into_iter().fold(FlashModel::new(), |flash, number| {
        let (flash, result) = change(flash, &rig(number));
        assert_eq!(result, Ok(()));
        flash
    })
}

#[test]
fn an_empty_flash_holds_nothing() {
    let mut store = store(FlashModel::new());
    assert_eq!(block_on(store.active_rig()), None);
    assert_eq!(block_on(store.candidate()), None);
    assert_eq!(block_on(store.acknowledge_rig(id(&rig(1)))), Err(StoreError::Nothing));
    assert_eq!(block_on(store.run(&FlashJob::ReadRig)), Err(StoreError::Nothing));
    assert_eq!(block_on(store.run(&FlashJob::ReadCandidate)), Err(StoreError::Nothing));
}

#[test]
fn a_rig_is_a_candidate_until_it_is_acknowledged_by_its_id() {
    let (old, new) = (rig(1), rig(2));
    let mut store = store(with_rigs([1]));
    assert_eq!(block_on(store.run(&FlashJob::StoreRig(new))), Ok(None));
    assert_eq!(block_on(store.run(&FlashJob::ReadRig)), Ok(Some(old)));
    assert_eq!(block_on(store.run(&FlashJob::ReadCandidate)), Ok(Some(new)));
    assert_eq!(
        block_on(store.run(&FlashJob::AcknowledgeRig(id(&old)))),
        Err(StoreError::OtherCandidate(id(&new)))
    );
    assert_eq!(block_on(store.active_rig()), Some(old));
    assert_eq!(block_on(store.run(&FlashJob::AcknowledgeRig(id(&new)))), Ok(None));
    assert_eq!(block_on(store.active_rig()), Some(new));
    assert_eq!(block_on(store.candidate()), None);
    assert_eq!(block_on(store.acknowledge_rig(id(&new))), Err(StoreError::Nothing), "once");
}

#[test]
fn a_candidate_survives_a_reset_and_gives_way_to_another() {
    let mut store = store(with_rigs([1]));
    block_on(store.stage_rig(&rig(2))).unwrap();
    block_on(store.stage_rig(&rig(3))).unwrap();
    let flash = store.into_flash();
    assert_eq!((active(&flash), candidate(&flash)), (Some(rig(1)), Some(rig(3))));
}

#[test]
fn what_is_no_valid_rig_touches_nothing() {
    let mut store = store(with_rigs([1]));
    let before = store.flash.bytes.clone();
    let mut damaged = rig(2);
    damaged[100] ^= 1;
    assert_eq!(block_on(store.stage_rig(&damaged)), Err(StoreError::Invalid(CompactRigError::Damaged)));
    assert_eq!(store.flash.bytes, before);
}

#[test]
fn many_changes_use_both_slots_alike_and_leave_only_the_newest() {
    let flash = with_rigs(1..=20);
    assert_eq!(active(&flash), Some(rig(20)));
    assert_eq!(flash.erases[0], 0, "outside the store");
    assert!(flash.erases[1].abs_diff(flash.erases[2]) <= 1, "{:?}", flash.erases);
    let (one, other) = (&flash.bytes[PAGE..2 * PAGE], &flash.bytes[2 * PAGE..3 * PAGE]);
    assert!([one, other].iter().any(|page| page.iter().all(|byte| *byte == 0xFF)), "the old one is erased");
}

/// Every byte at which the power can fail while a rig is stored and acknowledged, with every kind of torn word and
/// page, from an empty flash and over an old rig, from either slot.
#[test]
#[cfg_attr(miri, ignore = "thousands of flash images")]
fn a_power_cut_at_any_byte_leaves_the_old_rig_or_the_new_one() {
    let new = rig(9);
    let mut cuts = 0;
    for old in [vec![], vec![1], vec![1, 2]] {
        let before = with_rigs(old.iter().copied());
        let old_rig = old.last().map(|number| rig(*number));
        let (after, result) = change(before.restarted(), &new);
        assert_eq!(result, Ok(()));
        let steps = after.changed - before.changed;
        for tear in Tear::ALL {
            let mut seen_new = false;
            for power in 0..steps {
                cuts += 1;
                let cut = before.failing_after(power, tear);
                let (flash, result) = change(cut, &new);
                let found = active(&flash);
                let context = format!("old {old:?}, {tear:?}, power fails after {power} of {steps} bytes");
                assert!(found == old_rig || found == Some(new), "{context}");
                assert!(!seen_new || found == Some(new), "once it is the new one it stays: {context}");
                seen_new |= found == Some(new);
                assert!(result != Ok(()) || found == Some(new), "what was confirmed is in force: {context}");
                // Whatever is left, the next try succeeds.
                let (again, result) = change(flash.restarted(), &new);
                assert_eq!((result, active(&again)), (Ok(()), Some(new)), "{context}");
            }
            assert!(seen_new, "the cuts reach into the time after the change");
        }
    }
    assert!(cuts > 3 * 3 * 4000, "{cuts} cuts");
}

/// The power fails in a change, comes back, and fails again in the next try: nothing adds up to a mixture.
#[test]
#[cfg_attr(miri, ignore = "thousands of flash images")]
fn a_second_power_cut_after_the_first_leaves_a_whole_rig_too() {
    let (old, new, newer) = (rig(1), rig(2), rig(3));
    let before = with_rigs([1]);
    let steps = change(before.restarted(), &new).0.changed - before.changed;
    for (round, tear) in (0..3_usize).zip(Tear::ALL) {
        for first in (round..steps).step_by(47) {
            let cut = before.failing_after(first, tear);
            let (flash, _) = change(cut, &new);
            let middle = active(&flash);
            for second in (round..steps).step_by(53) {
                let cut = flash.failing_after(second, tear);
                let (flash, _) = change(cut, &newer);
                let found = active(&flash);
                assert!(found == middle || found == Some(newer), "{tear:?} {first} {second}");
                assert!([Some(old), Some(new), Some(newer)].contains(&found), "{tear:?} {first} {second}");
            }
        }
    }
}

/// Every bit of a slot is covered: damage is never taken for a rig, and never brings an old one back.
#[test]
#[cfg_attr(miri, ignore = "thousands of flash images")]
fn any_wrong_bit_in_a_slot_means_no_rig() {
    let flash = with_rigs([1, 2]);
    let slot = [PAGE, 2 * PAGE].into_iter().find(|page| flash.bytes[*page] != 0xFF).unwrap();
    let staged = {
        let mut store = store(FlashModel::new());
        block_on(store.stage_rig(&rig(1))).unwrap();
        store.into_flash()
    };
    for bit in 0..8 * SLOT_LENGTH {
        let (byte, mask) = (bit / 8, 1 << (bit % 8));
        let mut damaged = flash.clone();
        damaged.bytes[slot + byte] ^= mask;
        assert_eq!(active(&damaged), None, "bit {bit}");
        assert_eq!(candidate(&damaged), None, "bit {bit}");
        let mut damaged = staged.clone();
        damaged.bytes[PAGE + byte] ^= mask;
        assert_eq!((active(&damaged), candidate(&damaged)), (None, None), "bit {bit} of a candidate");
    }
    // Behind the slot nothing counts.
    let mut scribbled = flash;
    scribbled.bytes[slot + SLOT_LENGTH] = 0;
    assert_eq!(active(&scribbled), Some(rig(2)));
}

#[test]
fn a_slot_that_cannot_be_read_is_no_slot_but_is_spared_until_another_rig_is_in_force() {
    let mut flash = with_rigs([1]);
    flash.unreadable = Some(PAGE + 20);
    assert_eq!(active(&flash), None);
    let slot = flash.bytes[PAGE..2 * PAGE].to_vec();
    let mut store = store(flash);
    block_on(store.stage_rig(&rig(2))).unwrap();
    assert_eq!(store.flash.bytes[PAGE..2 * PAGE], slot, "it may be the active one after all");
    block_on(store.acknowledge_rig(id(&rig(2)))).unwrap();
    let mut flash = store.into_flash();
    flash.unreadable = None;
    assert_eq!(active(&flash), Some(rig(2)), "the old one does not come back with its readability");

    // The other slot, and a defect that stays.
    flash.unreadable = Some(2 * PAGE);
    let (flash, result) = change(flash, &rig(3));
    assert_eq!((result, active(&flash)), (Ok(()), Some(rig(3))));
    let (flash, result) = change(flash, &rig(4));
    assert_eq!((result, active(&flash)), (Err(StoreError::Flash), Some(rig(3))), "the only other slot");
}

#[test]
#[cfg_attr(miri, ignore = "thousands of flash images")]
fn a_byte_that_does_not_take_what_is_written_is_noticed_and_the_old_rig_stays() {
    for byte in 0..SLOT_LENGTH {
        let mut flash = with_rigs([1]);
        flash.stuck = Some(2 * PAGE + byte);
        let (flash, result) = change(flash, &rig(2));
        let same = flash.bytes[2 * PAGE + byte] == 0xFF && result == Ok(());
        assert!(result == Err(StoreError::Flash) || same, "byte {byte}");
        assert_eq!(active(&flash), Some(if same { rig(2) } else { rig(1) }), "byte {byte}");
    }
}

#[test]
fn a_flash_that_refuses_to_erase_refuses_a_candidate_but_not_an_acknowledgement() {
    let mut flash = with_rigs([1]);
    flash.no_erase = true;
    let (flash, result) = change(flash, &rig(2));
    assert_eq!((result, active(&flash)), (Err(StoreError::Flash), Some(rig(1))));
    let mut store = store(with_rigs([1]));
    block_on(store.stage_rig(&rig(2))).unwrap();
    store.flash.no_erase = true;
    assert_eq!(block_on(store.acknowledge_rig(id(&rig(2)))), Ok(()), "the old one's generation is lower");
    assert_eq!(block_on(store.active_rig()), Some(rig(2)));
}

#[test]
fn two_marked_slots_of_one_generation_are_a_contradiction_and_no_rig() {
    let mut flash = with_rigs([1]);
    flash.bytes.copy_within(PAGE..2 * PAGE, 2 * PAGE);
    assert_eq!(active(&flash), None);
    assert_eq!(candidate(&flash), None);
    let (flash, result) = change(flash, &rig(2));
    assert_eq!((result, active(&flash)), (Ok(()), Some(rig(2))), "service ends it");
}

fn stop(time: u64) -> Occurrence {
    Occurrence {
        event: FaultEvent::Stopped,
        time: Micros::new(time),
        status: 0,
        causes: StopCauses::NONE,
        state: StateCode::Stopped,
        reset_cause: ResetCause::PowerOn,
        fault: 0,
        detail: 0,
    }
}

fn load(flash: &FlashModel) -> FaultLog {
    let mut log = FaultLog::new();
    block_on(store(flash.restarted()).load_log(&mut log));
    log
}

fn numbers(log: &FaultLog) -> Vec<u32> {
    log.entries().map(|entry| entry.number).collect()
}

/// Records one entry and saves all that wait; `false` if the flash did not take it.
fn log_one(flash: FlashModel, log: &mut FaultLog) -> (FlashModel, bool) {
    log.record(&stop(1));
    let mut store = store(flash);
    for _ in 0..100 {
        let Some(entry) = log.unsaved() else { return (store.into_flash(), true) };
        if block_on(store.save_entry(&entry)).is_err() {
            return (store.into_flash(), false);
        }
        log.saved(&entry);
    }
    panic!("a saved entry is saved again and again");
}

fn with_entries(count: u32) -> FlashModel {
    let mut log = FaultLog::new();
    (0..count).fold(FlashModel::new(), |flash, _| {
        let (flash, saved) = log_one(flash, &mut log);
        assert!(saved);
        flash
    })
}

#[test]
fn the_fault_log_survives_a_reset_with_its_newest_entries() {
    assert_eq!(numbers(&load(&FlashModel::new())), []);
    for count in [1, 2, 31, 32, 33, 60, 100, 300] {
        let log = load(&with_entries(count));
        let oldest = count.saturating_sub(32) + 1;
        assert_eq!(numbers(&log), (oldest..=count).collect::<Vec<_>>(), "{count} entries");
        assert_eq!(log.unsaved(), None);
    }
}

#[test]
fn the_fault_log_wears_its_pages_alike_and_leaves_the_rig_alone() {
    let mut flash = with_rigs([1, 2]);
    let before = flash.erases;
    let mut log = FaultLog::new();
    for _ in 0..500 {
        flash = log_one(flash, &mut log).0;
    }
    assert_eq!(flash.erases[..3], before[..3]);
    assert!(flash.erases[3].abs_diff(flash.erases[4]) <= 1, "{:?}", flash.erases);
    assert!(flash.erases[3] + flash.erases[4] <= 500 / 32, "few erases: {:?}", flash.erases);
    assert_eq!(active(&flash), Some(rig(2)));
}

/// Every byte at which the power can fail while an entry is saved, at places within a page and at the change of pages.
#[test]
#[cfg_attr(miri, ignore = "thousands of flash images")]
fn a_power_cut_at_any_byte_costs_at_most_the_entry_that_was_being_written() {
    for count in [0, 1, 20, 41, 42, 43, 83, 84, 85] {
        let before = with_entries(count);
        let kept = numbers(&load(&before));
        let mut log = load(&before);
        let steps = log_one(before.restarted(), &mut log).0.changed - before.changed;
        for tear in Tear::ALL {
            for power in 0..steps {
                let cut = before.failing_after(power, tear);
                let (flash, saved) = log_one(cut, &mut load(&before));
                let context =
                    format!("{count} entries, {tear:?}, power fails after {power} of {steps} bytes");
                let mut after = load(&flash);
                let whole: Vec<u32> = kept.iter().copied().chain([count + 1]).collect();
                let newest = |all: &[u32]| all[all.len().saturating_sub(32)..].to_vec();
                let found = numbers(&after);
                assert!(found == kept || found == newest(&whole), "{context}: {found:?}");
                assert!(!saved || found == newest(&whole), "{context}");
                // And it goes on.
                let (flash, saved) = log_one(flash.restarted(), &mut after);
                assert!(saved, "{context}");
                assert_eq!(load(&flash).last_number(), after.last_number(), "{context}");
            }
        }
    }
}

#[test]
fn a_damaged_log_loses_entries_but_takes_new_ones() {
    let good = with_entries(50);
    for page in [3, 4] {
        for offset in (0..PAGE).step_by(61) {
            let mut flash = good.clone();
            for byte in &mut flash.bytes[page * PAGE + offset..][..8.min(PAGE - offset)] {
                *byte = !*byte;
            }
            let mut log = load(&flash);
            assert!(numbers(&log).is_sorted());
            let (flash, saved) = log_one(flash, &mut log);
            assert!(saved, "page {page}, offset {offset}");
            let after = load(&flash);
            assert_eq!(after.last_number(), log.last_number(), "page {page}, offset {offset}");
        }
    }
}

#[test]
fn a_flash_that_does_not_take_an_entry_says_so() {
    let mut flash = with_entries(3);
    flash.unreadable = Some(3 * PAGE);
    flash.no_erase = true;
    let mut log = FaultLog::new();
    let (_, saved) = log_one(flash, &mut log);
    assert!(!saved);
    assert_eq!(log.unsaved().unwrap().number, 1, "it waits");
}

#[test]
fn every_error_of_the_store_has_words() {
    let words = [
        StoreError::Invalid(CompactRigError::Damaged),
        StoreError::Nothing,
        StoreError::OtherCandidate(CalibrationId::new(0xABCD)),
        StoreError::Flash,
    ]
    .map(|error| error.to_string());
    assert!(words[2].contains("0000abcd"));
    assert_eq!(std::collections::BTreeSet::from(words).len(), 4);
}

/// A range that is no range of pages holds no log: it says so instead of writing somewhere.
#[test]
fn a_store_that_does_not_begin_at_a_page_keeps_no_log() {
    let mut store = Store::new(FlashModel::new(), START + 8);
    let mut log = FaultLog::new();
    log.started(ResetCause::PowerOn, StopCauses::NONE);
    let entry = log.unsaved().unwrap();
    assert_eq!(block_on(store.save_entry(&entry)), Err(StoreError::Flash));
    let mut restored = FaultLog::new();
    block_on(store.load_log(&mut restored));
    assert_eq!(restored.entries().count(), 0);
    assert_eq!(store.into_flash().bytes, FlashModel::new().bytes, "and nothing was touched");
}

/// After a return to an older firmware the log holds entries that it cannot read, up to twice as long as its own.
#[test]
fn entries_of_a_later_firmware_do_not_hide_the_others() {
    let mut store = store(with_entries(2));
    let pushed = block_on(async {
        let mut queue = store.log().unwrap();
        queue.push(&[0xA7; 2 * FAULT_ENTRY_LENGTH], false).await?;
        let mut third = FaultLog::new();
        for _ in 0..3 {
            third.record(&stop(3));
        }
        let newest = third.entries().last().unwrap();
        queue.push(&newest.to_bytes(), false).await
    });
    assert!(pushed.is_ok());
    assert_eq!(numbers(&load(&store.into_flash())), [1, 2, 3]);
}
