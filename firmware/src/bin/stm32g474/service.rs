//! Service mode: with the service key closed at power-up the controller is not started, the relays stay open, and the
//! host may store a calibration.
//!
//! A transaction whose first bytes are a valid rig's compact form stores it. Every transaction answers with the
//! compact form that the flash holds (zeros: none), so that the host reads back what was stored. Opening the key and
//! resetting the chip leads back to normal operation.

use crate::calibration::Store;
use crate::host_link::{HostLink, Message};
use nearfield_shared::rig::{COMPACT_LENGTH, Rig};
use static_cell::ConstStaticCell;

static MESSAGE: ConstStaticCell<[u8; COMPACT_LENGTH]> = ConstStaticCell::new([0; COMPACT_LENGTH]);

/// Never returns.
pub(crate) async fn run(link: &mut HostLink, store: &mut Store) -> ! {
    defmt::warn!("service mode: relays open, waiting for a calibration");
    let stored = MESSAGE.take();
    let message: &mut Message = link.take_buffer();
    loop {
        store.load(stored).await;
        if !link.exchange(message, stored).await {
            continue;
        }
        if let Some(rig) = message.first_chunk::<COMPACT_LENGTH>()
            && Rig::from_bytes(rig).is_ok()
        {
            let saved = store.save(rig).await;
            defmt::info!("calibration received, saved {=bool}", saved);
        }
    }
}
