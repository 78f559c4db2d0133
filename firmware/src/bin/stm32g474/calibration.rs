//! The calibrated rig in the flash's last two pages, in a wear-levelled map that survives a power cut at any byte.

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Blocking, Flash};
use embassy_stm32::peripherals::FLASH;
use nearfield_shared::rig::COMPACT_LENGTH;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

/// Where memory.x leaves room, as offsets into the flash: bank 2's end, so that writing does not stall the program.
const PAGES: core::ops::Range<u32> = 0x7_F000..0x8_0000;
/// The rig's key in the map.
const RIG: u8 = 1;
/// Working memory of the map: key, length and value, rounded up to the flash's word.
const BUFFER_LENGTH: usize = COMPACT_LENGTH + 32;

type Storage = BlockingAsync<Flash<'static, Blocking>>;

/// The stored rig.
pub(crate) struct Store {
    map: MapStorage<u8, Storage, Cache<Uncached, Uncached, Uncached, u8>>,
}

impl Store {
    pub(crate) fn new(flash: Peri<'static, FLASH>) -> Self {
        let storage = BlockingAsync::new(Flash::new_blocking(flash));
        Self { map: MapStorage::new(storage, const { MapConfig::new(PAGES) }, Cache::new_uncached()) }
    }

    /// Copies the stored rig's compact form; without one `rig` is left as it is, and that is no valid rig.
    pub(crate) async fn load(&mut self, rig: &mut [u8; COMPACT_LENGTH]) {
        let mut buffer = [0; BUFFER_LENGTH];
        if let Ok(Some(stored)) = self.map.fetch_item::<&[u8]>(&mut buffer, &RIG).await
            && let Ok(stored) = <&[u8; COMPACT_LENGTH]>::try_from(stored)
        {
            *rig = *stored;
        }
    }

    /// Stores a rig's compact form; `false` if the flash refuses.
    pub(crate) async fn save(&mut self, rig: &[u8; COMPACT_LENGTH]) -> bool {
        let mut buffer = [0; BUFFER_LENGTH];
        self.map.store_item(&mut buffer, &RIG, &rig.as_slice()).await.is_ok()
    }
}
