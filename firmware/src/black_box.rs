//! The stop black box: what the controller saw and decided around a stop, to be read over the link and replayed.
//!
//! It records, all the time, a [`Summary`] of every exchange and the last line-scans as they came. A stop keeps what
//! has been recorded, and a little of what follows:
//!
//! ```text
//!              armed                    stop, when armed                 time after it recorded
//!  Recording ---------> Recording, armed ----------------> Kept, filling ----------------------> Kept
//!      ^                                                         |                                 |
//!      +--------------------------- armed again -----------------+---------------------------------+
//! ```
//!
//! What is kept stays until the controller runs again: then recording starts anew. So a host that fetches the kept stop
//! after every stop (a second at 50 exchanges per second) loses none. Causes and times of older stops are in the
//! [fault log](crate::fault_log).
//!
//! The three newest line-scans up to the stop are what the votes were taken over: they replay the decision bit for
//! bit. Only accepted line-scans are kept; a refused message has its summary, and nothing of it was used.
//!
//! [`recorded::RecordedController`] feeds it, in this order:
//!
//! 1. [`BlackBox::line_scan`] with every accepted line-scan's bytes, before it is judged;
//! 2. [`BlackBox::record`] after every exchange, and after a tick that changed the state or its causes;
//! 3. [`BlackBox::stop`] when the relays are told to open while running;
//! 4. [`BlackBox::armed`] when they are told to close.

pub mod recorded;
pub(crate) mod ring;

use crate::safety::FIRMWARE_ID;
use nearfield_shared::causes::StopCauses;
use nearfield_shared::limits::VOTE_FRAMES;
use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::service::{
    PAGE_DATA_LENGTH, PAGES_PER_SCAN, STOP_INDEX_LENGTH, SUMMARY_COUNT, SUMMARY_LENGTH, SUMMARY_PAGES,
    StopIndex, Summary,
};
use nearfield_shared::units::{CalibrationId, Micros};
use ring::Ring;

/// Line-scans that are kept up to the stop: those of the vote.
pub const SCANS_BEFORE: usize = VOTE_FRAMES;
/// Line-scans that are kept after the stop.
pub const SCANS_AFTER: usize = 1;
/// Summaries that are kept after the stop; a third of a second at 50 frames per second.
pub const SUMMARIES_AFTER: usize = 16;
/// Summaries that are kept up to the stop; about a second at 50 frames per second.
pub const SUMMARIES_BEFORE: usize = SUMMARY_COUNT - SUMMARIES_AFTER;

/// Memory for the data of one page.
pub type PageData = [u8; PAGE_DATA_LENGTH];

/// What a page's data is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageContent {
    /// Bytes of the data that are used.
    pub length: usize,
    /// How many pages there are.
    pub count: u16,
    /// Pages of one revision belong together.
    pub revision: u32,
}

/// The recorder, about 19 KB; see the module's documentation. All zero bits at first: a static of it takes no flash.
#[derive(Debug, Clone)]
pub struct BlackBox {
    summaries: Ring<SUMMARY_COUNT, SUMMARY_LENGTH>,
    scans: Ring<{ SCANS_BEFORE + SCANS_AFTER }, LINE_SCAN_LENGTH>,
    armed: bool,
    kept: bool,
    stops: u32,
    stop_time: Micros,
    stop_causes: StopCauses,
    calibration: Option<CalibrationId>,
    summaries_before: usize,
    scans_before: usize,
}

impl BlackBox {
    /// Nothing recorded yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            summaries: Ring::new(),
            scans: Ring::new(),
            armed: false,
            kept: false,
            stops: 0,
            stop_time: Micros::ZERO,
            stop_causes: StopCauses::NONE,
            calibration: None,
            summaries_before: 0,
            scans_before: 0,
        }
    }

    /// The relays are told to close: the next stop is to be kept. A kept one gives way.
    pub fn armed(&mut self) {
        if self.kept {
            self.summaries.keep_newest(0);
            self.scans.keep_newest(0);
        }
        (self.armed, self.kept) = (true, false);
    }

    /// The bytes of an accepted line-scan.
    pub fn line_scan(&mut self, bytes: &[u8; LINE_SCAN_LENGTH]) {
        if !self.kept || self.scans_after() < SCANS_AFTER {
            self.scans.push(bytes);
        }
    }

    /// What an exchange or a tick came to.
    pub fn record(&mut self, summary: &Summary) {
        if !self.kept || self.summaries_after() < SUMMARIES_AFTER {
            self.summaries.push(&summary.to_bytes());
        }
    }

    /// The relays are told to open. Without effect unless the controller was [armed](Self::armed) since the last stop.
    pub fn stop(&mut self, time: Micros, causes: StopCauses, calibration: Option<CalibrationId>) {
        if !self.armed {
            return;
        }
        (self.armed, self.kept) = (false, true);
        self.stops = self.stops.saturating_add(1);
        (self.stop_time, self.stop_causes, self.calibration) = (time, causes, calibration);
        self.summaries.keep_newest(SUMMARIES_BEFORE);
        self.scans.keep_newest(SCANS_BEFORE);
        self.summaries_before = self.summaries.count();
        self.scans_before = self.scans.count();
    }

    /// What is kept; `None` while nothing is.
    #[must_use]
    pub fn index(&self) -> Option<StopIndex> {
        let wire = |count: usize| u16::try_from(count).unwrap_or(u16::MAX);
        self.kept.then(|| StopIndex {
            stop: self.stops,
            time: self.stop_time,
            causes: self.stop_causes,
            firmware: FIRMWARE_ID,
            calibration: self.calibration,
            summaries: wire(self.summaries.count()),
            summaries_before: wire(self.summaries_before),
            scans: wire(self.scans.count()),
            scans_before: wire(self.scans_before),
            complete: self.summaries_after() == SUMMARIES_AFTER && self.scans_after() == SCANS_AFTER,
        })
    }

    /// Fills in a page of what is kept, as the module [`nearfield_shared::service`] lays it out; `None` if nothing is
    /// kept or there is no such page.
    #[must_use]
    pub fn page(&self, page: u16, data: &mut PageData) -> Option<PageContent> {
        let index = self.index()?;
        let scan_pages = self.scans.count().saturating_mul(PAGES_PER_SCAN);
        let count = SUMMARY_PAGES.saturating_add(scan_pages).saturating_add(1);
        let length = match usize::from(page).checked_sub(1) {
            None => fill(data, &index.to_bytes()),
            Some(page) => match page.checked_sub(SUMMARY_PAGES) {
                None => self.fill_summaries(page, data),
                Some(page) => self.fill_scan(page, data)?,
            },
        };
        Some(PageContent { length, count: u16::try_from(count).unwrap_or(u16::MAX), revision: index.stop })
    }

    fn fill_summaries(&self, page: usize, data: &mut PageData) -> usize {
        let (slots, _) = data.as_chunks_mut::<SUMMARY_LENGTH>();
        let skipped = page.saturating_mul(slots.len());
        let mut length = 0_usize;
        for (slot, summary) in slots.iter_mut().zip(self.summaries.oldest_first().skip(skipped)) {
            *slot = *summary;
            length = length.saturating_add(SUMMARY_LENGTH);
        }
        length
    }

    fn fill_scan(&self, page: usize, data: &mut PageData) -> Option<usize> {
        let scan = self.scans.oldest_first().nth(page.checked_div(PAGES_PER_SCAN)?)?;
        let start = page.checked_rem(PAGES_PER_SCAN)?.saturating_mul(PAGE_DATA_LENGTH);
        Some(fill(data, scan.get(start..)?))
    }

    #[cfg(test)]
    pub(crate) fn scans_for_test(&self) -> impl Iterator<Item = &[u8; LINE_SCAN_LENGTH]> {
        self.scans.oldest_first()
    }

    fn summaries_after(&self) -> usize {
        self.summaries.count().saturating_sub(self.summaries_before)
    }

    fn scans_after(&self) -> usize {
        self.scans.count().saturating_sub(self.scans_before)
    }
}

impl Default for BlackBox {
    fn default() -> Self {
        Self::new()
    }
}

const _: () = assert!(STOP_INDEX_LENGTH <= PAGE_DATA_LENGTH, "the index must fit one page");

/// Copies as much as fits; returns how much.
pub(crate) fn fill(data: &mut [u8], bytes: &[u8]) -> usize {
    for (slot, byte) in data.iter_mut().zip(bytes) {
        *slot = *byte;
    }
    data.len().min(bytes.len())
}

#[cfg(test)]
mod tests;
