//! SPI2 as the host's slave: one full-duplex transaction of a fixed length for each camera frame.
//!
//! READY goes high when the DMA is armed, and the host may clock one transaction. While a received message is looked
//! at, READY is low, so that one buffer is enough; it serves both directions.

use crate::bare_metal::memory::test_block;
use crate::board::LinkParts;
use core::cell::Cell;
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::{bind_interrupts, dma, pac, peripherals};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, Instant, with_timeout};
use nearfield_firmware::selftest::Outcome;
use nearfield_firmware::selftest::memory::Region;
use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::service::{NO_PAGE, PAGE_LENGTH, PAGE_OFFSET, PageBytes};
use nearfield_shared::status::STATUS_LENGTH;
use nearfield_shared::units::Micros;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Interrupts {
    DMA1_CHANNEL1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
    DMA1_CHANNEL2 => dma::InterruptHandler<peripherals::DMA1_CH2>;
});

/// One transaction's bytes.
pub(crate) type Message = [u8; LINE_SCAN_LENGTH];

/// A transaction that does not complete in this time was short or never came: start over. Longer than the link's
/// timeout; the relays do not wait for it.
const TRANSACTION_TIMEOUT: Duration = Duration::from_millis(100);

/// In whole words, so that the memory's test finds it in whole words.
#[repr(align(4))]
struct Buffer(ConstStaticCell<Message>);

/// In RAM, not on the stack: DMA cannot reach the stack's memory.
static BUFFER: Buffer = Buffer(ConstStaticCell::new([0; LINE_SCAN_LENGTH]));

/// The buffer's memory, with its lock: not for the safety task's test, since DMA writes to it at any time.
pub(crate) fn buffer_region() -> Region {
    Region { address: (&raw const BUFFER) as usize, words: size_of::<Buffer>() / size_of::<u32>() }
}

/// Blocks of the buffer that are tested before each transaction. Reason: all of them in 8 transactions, 0.2 s with a
/// host, 0.8 s without; a transaction then waits 0.1 ms.
const BLOCKS_AT_ONCE: usize = 4;
/// A test of the whole buffer counts for this long.
const BUFFER_TEST_VALIDITY: Micros = Micros::from_millis(2_000);

/// When the whole buffer was last tested, or that it is faulty.
static BUFFER_TEST: Mutex<CriticalSectionRawMutex, Cell<BufferTest>> =
    Mutex::new(Cell::new(BufferTest { passed: None, failed: false }));

#[derive(Clone, Copy)]
struct BufferTest {
    passed: Option<Micros>,
    failed: bool,
}

/// For the safety task's round of self-tests.
pub(crate) fn buffer_outcome(now: Micros) -> Outcome {
    let BufferTest { passed, failed } = BUFFER_TEST.lock(Cell::get);
    if failed {
        Outcome::Failed
    } else if passed.is_some_and(|passed| now.since(passed) <= BUFFER_TEST_VALIDITY) {
        Outcome::Passed
    } else {
        Outcome::Pending
    }
}

/// What the link task and the safety task hand each other.
pub(crate) struct Exchanges {
    received: Channel<CriticalSectionRawMutex, &'static mut Message, 1>,
    returned: Channel<CriticalSectionRawMutex, &'static mut Message, 1>,
    status: Mutex<CriticalSectionRawMutex, Cell<[u8; STATUS_LENGTH]>>,
    page: Mutex<CriticalSectionRawMutex, Cell<PageBytes>>,
}

static EXCHANGES: Exchanges = Exchanges {
    received: Channel::new(),
    returned: Channel::new(),
    status: Mutex::new(Cell::new([0; STATUS_LENGTH])),
    page: Mutex::new(Cell::new(NO_PAGE)),
};

/// The only one.
pub(crate) const fn exchanges() -> &'static Exchanges {
    &EXCHANGES
}

impl Exchanges {
    /// For the safety task: the next received message.
    pub(crate) async fn received(&self) -> &'static mut Message {
        self.received.receive().await
    }

    /// For the safety task: the message was looked at.
    pub(crate) fn give_back(&self, message: &'static mut Message) {
        // There is one message, so there is room for it.
        let _ = self.returned.try_send(message);
    }

    /// For the safety task: the status that the next transaction carries.
    pub(crate) fn publish(&self, status: [u8; STATUS_LENGTH]) {
        self.status.lock(|cell| cell.set(status));
    }

    /// For the safety task: the page that the next transactions carry behind the status. Masks interrupts for some
    /// hundred instructions.
    pub(crate) fn publish_page(&self, page: &PageBytes) {
        self.page.lock(|cell| cell.set(*page));
    }

    /// Writes what the next transaction carries into its buffer.
    fn write_answer(&self, message: &mut Message) {
        message.fill(0);
        let status = self.status.lock(Cell::get);
        if let Some(slot) = message.first_chunk_mut::<STATUS_LENGTH>() {
            *slot = status;
        }
        if let Some(slot) =
            message.get_mut(PAGE_OFFSET..).and_then(|rest| rest.first_chunk_mut::<PAGE_LENGTH>())
        {
            *slot = self.page.lock(Cell::get);
        }
    }
}

/// The link's hardware.
pub(crate) struct HostLink {
    parts: LinkParts,
    next_block: usize,
}

impl HostLink {
    pub(crate) const fn new(parts: LinkParts) -> Self {
        Self { parts, next_block: 0 }
    }

    /// Transaction after transaction.
    pub(crate) async fn run(&mut self, exchanges: &'static Exchanges) {
        let mut message = BUFFER.0.take();
        loop {
            self.test_buffer();
            exchanges.write_answer(message);
            if self.exchange(message).await {
                exchanges.received.send(message).await;
                message = exchanges.returned.receive().await;
            } else {
                defmt::debug!("no transaction");
            }
        }
    }

    /// Between two transactions: DMA is off, and this task alone has the buffer.
    fn test_buffer(&mut self) {
        let buffer = buffer_region();
        for _ in 0..BLOCKS_AT_ONCE {
            let Some(block) = buffer.block(self.next_block) else {
                self.next_block = 0;
                let passed = Some(Micros::new(Instant::now().as_micros()));
                BUFFER_TEST.lock(|test| test.set(BufferTest { passed, ..test.get() }));
                return;
            };
            self.next_block += 1;
            // SAFETY: RAM that DMA does not write to now, and not of the stack.
            if unsafe { test_block(block) } != Outcome::Passed {
                BUFFER_TEST.lock(|test| test.set(BufferTest { failed: true, ..test.get() }));
            }
        }
    }

    /// One transaction: what `message` holds goes out, and what comes in takes its place. `false` if it did not
    /// complete.
    async fn exchange(&mut self, message: &mut Message) -> bool {
        let parts = &mut self.parts;
        // A new driver each time resets the SPI: nothing else empties its transmit FIFO after a short transaction.
        let mut driver = Spi::new_slave(
            parts.spi.reborrow(),
            parts.clock.reborrow(),
            parts.from_host.reborrow(),
            parts.to_host.reborrow(),
            parts.select.reborrow(),
            parts.transmit.reborrow(),
            parts.receive.reborrow(),
            Interrupts,
            spi::Config::default(),
        );
        // The driver leaves MISO at the lowest slew rate, too slow for 16 MHz.
        pac::GPIOB
            .ospeedr()
            .modify(|register| register.set_ospeedr(14, pac::gpio::vals::Ospeedr::VERY_HIGH_SPEED));
        let transfer = async {
            // The transfer arms the DMA at its first poll, in the same breath as this.
            parts.ready.set_high();
            driver.transfer_in_place(message.as_mut_slice()).await
        };
        let done = with_timeout(TRANSACTION_TIMEOUT, transfer).await;
        parts.ready.set_low();
        matches!(done, Ok(Ok(())))
    }
}
