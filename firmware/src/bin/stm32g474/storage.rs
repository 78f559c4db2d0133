//! The flash's last four pages: the rig's two slots and the fault log (see `nearfield_firmware::store`), served in thread
//! mode, below the link and far below the safety task.
//!
//! The pages lie in bank 2, so that the program in bank 1 runs on while they are erased (22 ms). What the flash does or
//! fails to do has no way to the relays; a request that it cannot serve is told so.

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Blocking, Flash};
use embassy_stm32::peripherals::FLASH;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use nearfield_firmware::service::{FlashJob, JobOutcome};
use nearfield_firmware::store;
use nearfield_shared::service::FaultEntry;

/// Where memory.x leaves room, as an offset into the flash.
const START: u32 = 0x7_E000;

/// The store over this chip's flash.
pub(crate) type Store = store::Store<BlockingAsync<Flash<'static, Blocking>>>;

pub(crate) fn open(flash: Peri<'static, FLASH>) -> Store {
    Store::new(BlockingAsync::new(Flash::new_blocking(flash)), START)
}

/// What the safety task wants of the flash.
pub(crate) enum Wanted {
    /// What a service request needs.
    Job(FlashJob),
    /// This entry of the fault log is to be kept.
    Entry(FaultEntry),
}

/// What came of it.
pub(crate) enum Done {
    /// A job's outcome.
    Job(JobOutcome),
    /// The entry is kept; `None` if the flash did not take it.
    Entry(Option<FaultEntry>),
}

/// One piece of work at a time, and what came of it.
pub(crate) struct Counter {
    pub(crate) wanted: Channel<CriticalSectionRawMutex, Wanted, 1>,
    pub(crate) done: Channel<CriticalSectionRawMutex, Done, 1>,
}

static COUNTER: Counter = Counter { wanted: Channel::new(), done: Channel::new() };

/// The only one.
pub(crate) const fn counter() -> &'static Counter {
    &COUNTER
}

/// Serves the counter for ever.
pub(crate) async fn run(mut store: Store) -> ! {
    loop {
        let done = match COUNTER.wanted.receive().await {
            Wanted::Job(job) => Done::Job(store.run(&job).await),
            Wanted::Entry(entry) => Done::Entry(store.save_entry(&entry).await.ok().map(|()| entry)),
        };
        COUNTER.done.send(done).await;
    }
}
