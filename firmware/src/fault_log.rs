//! The fault log: the last starts, stops, lock-outs and changes of the rig, over resets and power cycles.
//!
//! It lives in RAM; a queue in flash ([`crate::store`]) keeps what it holds. The flash may be slow and may fail without
//! any effect on safety: entries wait in the log until they are [saved](FaultLog::saved).
//!
//! ```text
//!  start:    store.load_log(&mut log)  ->  log.started(...)
//!  a stop:   log.record(...)
//!  later:    while let Some(entry) = log.unsaved() { store.save_entry(&entry) -> log.saved(entry) }
//! ```
//!
//! Numbers of entries go on over resets, so a gap in them shows that entries were lost.

use crate::black_box::ring::Ring;
use crate::black_box::{PageContent, PageData, fill};
use nearfield_shared::causes::StopCauses;
use nearfield_shared::service::{FAULT_ENTRY_LENGTH, FaultEntry, FaultEvent, PAGE_DATA_LENGTH, PowerCycle};
use nearfield_shared::status::{ResetCause, StateCode};
use nearfield_shared::units::Micros;

/// Entries that the log holds.
pub const LOG_LENGTH: usize = 32;
const _: () = assert!(LOG_LENGTH * FAULT_ENTRY_LENGTH <= PAGE_DATA_LENGTH, "the whole log must fit one page");

/// Something worth an entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Occurrence {
    /// What happened.
    pub event: FaultEvent,
    /// When, by the MCU's clock.
    pub time: Micros,
    /// The status that will tell it first.
    pub status: u32,
    /// Why.
    pub causes: StopCauses,
    /// The state that it led to.
    pub state: StateCode,
    /// Why the MCU had started.
    pub reset_cause: ResetCause,
    /// The fault that locks out, by its code; 0 = none.
    pub fault: u8,
    /// More about it, see [`FaultEntry::detail`].
    pub detail: u32,
}

/// The log, about 1 KB. All zero bits while empty.
#[derive(Debug, Clone)]
pub struct FaultLog {
    entries: Ring<LOG_LENGTH, FAULT_ENTRY_LENGTH>,
    last_number: u32,
    power_cycle: PowerCycle,
    /// The newest entries, these many, are not in flash yet.
    unsaved: usize,
}

impl FaultLog {
    /// Empty.
    #[must_use]
    pub const fn new() -> Self {
        Self { entries: Ring::new(), last_number: 0, power_cycle: PowerCycle::new(0), unsaved: 0 }
    }

    /// Takes an entry that was kept in flash; call it for all of them, oldest first, before anything is recorded.
    /// Bytes that are no entry, or none that can follow, are left out.
    pub fn restore(&mut self, bytes: &[u8]) {
        let Some(entry) = FaultEntry::parse(bytes) else { return };
        if entry.number > self.last_number {
            self.entries.push(&entry.to_bytes());
            self.last_number = entry.number;
            self.power_cycle = self.power_cycle.max(entry.power_cycle);
        }
    }

    /// The MCU has started: the first entry of its power cycle.
    pub fn started(&mut self, reset_cause: ResetCause, causes: StopCauses) {
        self.power_cycle = self.power_cycle.next();
        self.record(&Occurrence {
            event: FaultEvent::Started,
            time: Micros::ZERO,
            status: 0,
            causes,
            state: StateCode::SelfTest,
            reset_cause,
            fault: 0,
            detail: 0,
        });
    }

    /// Enters what happened.
    pub fn record(&mut self, occurrence: &Occurrence) {
        let Occurrence { event, time, status, causes, state, reset_cause, fault, detail } = *occurrence;
        self.last_number = self.last_number.saturating_add(1);
        let (number, power_cycle) = (self.last_number, self.power_cycle);
        let entry = FaultEntry {
            number,
            power_cycle,
            time,
            status,
            causes,
            event,
            state,
            reset_cause,
            fault,
            detail,
        };
        self.entries.push(&entry.to_bytes());
        self.unsaved = self.unsaved.saturating_add(1).min(LOG_LENGTH);
    }

    /// The oldest entry that is not in flash yet.
    #[must_use]
    pub fn unsaved(&self) -> Option<FaultEntry> {
        let saved = self.entries.count().saturating_sub(self.unsaved);
        self.entries.oldest_first().nth(saved).and_then(|bytes| FaultEntry::parse(bytes))
    }

    /// This entry, and with it all older ones, is in flash now. One that is newer than any is left out.
    pub fn saved(&mut self, entry: &FaultEntry) {
        if let Some(newer) = self.last_number.checked_sub(entry.number) {
            self.unsaved = self.unsaved.min(usize::try_from(newer).unwrap_or(usize::MAX));
        }
    }

    /// Number of the newest entry, 0 = none.
    #[must_use]
    pub const fn last_number(&self) -> u32 {
        self.last_number
    }

    /// All entries, oldest first.
    pub fn entries(&self) -> impl Iterator<Item = FaultEntry> {
        self.entries.oldest_first().filter_map(|bytes| FaultEntry::parse(bytes))
    }

    /// Fills in a page of the log; `None` if there is no such page. It has one page, empty if the log is.
    #[must_use]
    pub fn page(&self, page: u16, data: &mut PageData) -> Option<PageContent> {
        if page != 0 {
            return None;
        }
        let mut length = 0_usize;
        for entry in self.entries.oldest_first() {
            length = length.saturating_add(fill(data.get_mut(length..).unwrap_or_default(), entry));
        }
        Some(PageContent { length, count: 1, revision: self.last_number })
    }
}

impl Default for FaultLog {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_shared::causes::StopCause;

    fn stop(time: u64) -> Occurrence {
        Occurrence {
            event: FaultEvent::Stopped,
            time: Micros::new(time),
            status: 9,
            causes: StopCauses::NONE.with(StopCause::Drop),
            state: StateCode::Stopped,
            reset_cause: ResetCause::PowerOn,
            fault: 3,
            detail: 4,
        }
    }

    fn numbers(log: &FaultLog) -> Vec<u32> {
        log.entries().map(|entry| entry.number).collect()
    }

    #[test]
    fn an_entry_says_what_happened_and_in_which_power_cycle() {
        let mut log = FaultLog::default();
        log.started(ResetCause::Watchdog, StopCauses::NONE.with(StopCause::WatchdogReset));
        log.record(&stop(77));
        let entries: Vec<_> = log.entries().collect();
        assert_eq!((entries[0].event, entries[0].reset_cause), (FaultEvent::Started, ResetCause::Watchdog));
        assert_eq!(entries[0].causes, StopCauses::NONE.with(StopCause::WatchdogReset));
        assert_eq!((entries[0].number, entries[0].state), (1, StateCode::SelfTest));
        let expected = FaultEntry {
            number: 2,
            power_cycle: PowerCycle::new(1),
            time: Micros::new(77),
            status: 9,
            causes: StopCauses::NONE.with(StopCause::Drop),
            event: FaultEvent::Stopped,
            state: StateCode::Stopped,
            reset_cause: ResetCause::PowerOn,
            fault: 3,
            detail: 4,
        };
        assert_eq!(entries[1], expected);
        assert_eq!(log.last_number(), 2);
    }

    #[test]
    fn the_log_holds_the_newest_entries_and_no_more() {
        let mut log = FaultLog::new();
        for time in 0..LOG_LENGTH as u64 {
            log.record(&stop(time));
        }
        assert_eq!(numbers(&log), (1..=32).collect::<Vec<_>>());
        log.record(&stop(99));
        assert_eq!(numbers(&log), (2..=33).collect::<Vec<_>>());
    }

    #[test]
    fn every_entry_waits_until_it_is_saved_in_order() {
        let mut log = FaultLog::new();
        assert_eq!(log.unsaved(), None);
        for time in 0..3 {
            log.record(&stop(time));
        }
        let first = log.unsaved().unwrap();
        assert_eq!(first.number, 1);
        assert_eq!(log.unsaved(), Some(first), "until it is saved");
        log.saved(&first);
        let second = log.unsaved().unwrap();
        assert_eq!(second.number, 2);
        log.saved(&first);
        assert_eq!(log.unsaved(), Some(second), "told twice");
        // A new entry comes while one is being written.
        log.record(&stop(3));
        log.saved(&second);
        assert_eq!(log.unsaved().unwrap().number, 3);
        log.saved(&FaultEntry { number: 100, ..second });
        assert_eq!(log.unsaved().unwrap().number, 3, "nothing newer than the newest can be saved");
        log.saved(&FaultEntry { number: 4, ..second });
        assert_eq!(log.unsaved(), None);
    }

    #[test]
    fn entries_that_nobody_saves_give_way_to_newer_ones() {
        let mut log = FaultLog::new();
        for time in 0..40 {
            log.record(&stop(time));
        }
        assert_eq!(log.unsaved().unwrap().number, 9);
        log.saved(&log.unsaved().unwrap());
        assert_eq!(log.unsaved().unwrap().number, 10);
    }

    #[test]
    fn numbers_and_power_cycles_go_on_over_a_reset() {
        let mut before = FaultLog::new();
        before.started(ResetCause::PowerOn, StopCauses::NONE);
        before.record(&stop(1));
        let mut log = FaultLog::new();
        for entry in before.entries() {
            log.restore(&entry.to_bytes());
        }
        assert_eq!(log.unsaved(), None, "what comes from flash is in flash");
        assert!(log.entries().eq(before.entries()));
        log.started(ResetCause::Pin, StopCauses::NONE);
        let newest = log.unsaved().unwrap();
        assert_eq!((newest.number, newest.power_cycle), (3, PowerCycle::new(2)));
        assert_eq!(numbers(&log), [1, 2, 3]);
    }

    #[test]
    fn what_is_no_entry_or_out_of_order_is_not_restored() {
        let mut source = FaultLog::new();
        source.started(ResetCause::PowerOn, StopCauses::NONE);
        source.record(&stop(1));
        let [one, two] = [0, 1].map(|index| source.entries().nth(index).unwrap().to_bytes());
        let mut log = FaultLog::new();
        log.restore(&[0xFF; FAULT_ENTRY_LENGTH]);
        log.restore(&[]);
        log.restore(&two);
        log.restore(&two);
        log.restore(&one);
        assert_eq!(numbers(&log), [2]);
        assert_eq!(log.last_number(), 2);
    }

    #[test]
    fn the_log_is_one_page_oldest_first() {
        let mut log = FaultLog::new();
        let mut data = [0xEE; PAGE_DATA_LENGTH];
        assert_eq!(log.page(0, &mut data), Some(PageContent { length: 0, count: 1, revision: 0 }));
        for time in 0..40 {
            log.record(&stop(time));
        }
        assert_eq!(log.page(0, &mut data), Some(PageContent { length: 1024, count: 1, revision: 40 }));
        let read: Vec<_> =
            data.chunks(FAULT_ENTRY_LENGTH).map(|bytes| FaultEntry::parse(bytes).unwrap()).collect();
        assert!(log.entries().eq(read));
        assert_eq!(log.page(1, &mut data), None);
    }
}
