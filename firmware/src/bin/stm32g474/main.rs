//! The firmware on the STM32G474RE (Nucleo-G474RE). Built, not run on hardware.
//!
//! Three tasks that move bytes and pins; `nearfield_firmware` decides:
//!
//! * `safety_task`, in an interrupt: every 5 ms a slice of the self-tests and a tick, and each received message as it
//!   comes; it alone drives the relays and feeds the watchdogs;
//! * `link_task`, in an interrupt below it: one SPI transaction after the other;
//! * `start_task`, in thread mode: tests and starts everything, then keeps rigs and fault log in flash (see `storage`).
//!
//! | pin | direction | use |
//! |---|---|---|
//! | PC0, PC1 | out | relay coils, channels A and B; high = closed |
//! | PC2, PC3 | in, pull-down | mirror contacts of A and B; high = main contacts proven open |
//! | PC13 | in, pull-down | reset button; high = pressed |
//! | PC8 | in, pull-down | service key; high = the stored rig may be changed while the relays are open; the button is off |
//! | PB0, PB1 | in, pull-down | what the coil drivers of A and B give out |
//! | PC9 | out | laser driver: 20 kHz PWM |
//! | PC6 | out | warning |
//! | PA5, PC4, PC5 | out | lamps: permitted, waiting for reset, service |
//! | PB12, PB13, PB14, PB15 | SPI2 slave | NSS, SCK, MISO, MOSI; mode 0, up to 16 MHz |
//! | PA8 | out | READY: high = the host may clock one transaction |
//!
//! Every output is low in reset, and low means safe. A panic or a fault pulls the relays low and resets.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "../bare_metal/mod.rs"]
mod bare_metal;
#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod host_link;
#[cfg(target_os = "none")]
mod laser;
#[cfg(target_os = "none")]
mod low_speed_clock;
#[cfg(target_os = "none")]
mod random;
#[cfg(target_os = "none")]
mod records;
#[cfg(target_os = "none")]
mod self_tests;
#[cfg(target_os = "none")]
mod settings;
#[cfg(target_os = "none")]
mod storage;
#[cfg(target_os = "none")]
mod supply;
#[cfg(target_os = "none")]
mod watchdogs;

#[cfg(target_os = "none")]
mod target {
    use crate::host_link::{self, Exchanges, HostLink};
    use crate::records::Records;
    use crate::self_tests::SelfTests;
    use crate::watchdogs::{self, Watchdogs};
    use crate::{board, random, storage};
    use defmt_rtt as _;
    use embassy_executor::{Executor, InterruptExecutor};
    use embassy_futures::select::{Either, select};
    use embassy_stm32::interrupt::{self, InterruptExt as _, Priority};
    use embassy_time::{Duration, Instant, Timer};
    use nearfield_firmware::black_box::recorded::{RecordedController, RecorderMemory};
    use nearfield_firmware::link::is_poll;
    use nearfield_firmware::safety::{LineScanMonitor, Outputs, SafetyController, StartInputs, TickInputs};
    use nearfield_shared::limits::TICK_PERIOD;
    use nearfield_shared::rig::COMPACT_LENGTH;
    use nearfield_shared::status::ResetCause;
    use nearfield_shared::units::{Micros, SourceId};
    use static_cell::{ConstStaticCell, StaticCell};

    /// Which module of the robot this is. One module a robot so far; others are built with another number.
    const SOURCE: SourceId = SourceId::new(1);

    /// The controller as this binary holds it.
    pub(crate) type Controller =
        RecordedController<&'static mut LineScanMonitor, &'static mut RecorderMemory>;

    /// All zeros at start, so that it takes no flash.
    static MONITOR: ConstStaticCell<LineScanMonitor> = ConstStaticCell::new(LineScanMonitor::new());
    static CONTROLLER: StaticCell<Controller> = StaticCell::new();
    static RECORDER: StaticCell<RecorderMemory> = StaticCell::new();
    static THREAD_EXECUTOR: StaticCell<Executor> = StaticCell::new();
    /// Runs the safety task above everything else, in an interrupt that no peripheral of this board uses.
    static SAFETY_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
    /// Runs the link task above the flash's, in another one.
    static LINK_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

    defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

    /// The link executor's interrupt.
    #[embassy_stm32::interrupt]
    unsafe fn UART4() {
        // SAFETY: called from the interrupt that the executor was started with, and from nowhere else.
        unsafe { LINK_EXECUTOR.on_interrupt() }
    }

    /// The safety executor's interrupt.
    #[embassy_stm32::interrupt]
    unsafe fn UART5() {
        // SAFETY: called from the interrupt that the executor was started with, and from nowhere else.
        unsafe { SAFETY_EXECUTOR.on_interrupt() }
    }

    #[panic_handler]
    fn panic(_info: &core::panic::PanicInfo<'_>) -> ! {
        board::restart()
    }

    #[cortex_m_rt::exception]
    unsafe fn HardFault(_frame: &cortex_m_rt::ExceptionFrame) -> ! {
        board::restart()
    }

    /// Flash that cannot be corrected any more, or a clock that failed.
    #[cortex_m_rt::exception]
    unsafe fn NonMaskableInt() -> ! {
        board::restart()
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        THREAD_EXECUTOR.init(Executor::new()).run(|spawner| match start_task() {
            Ok(task) => spawner.spawn(task),
            Err(_) => board::restart(),
        })
    }

    /// Sets the board up, tests it, starts the other tasks, and then serves the flash.
    #[embassy_executor::task]
    async fn start_task() {
        let mut board = board::start();
        // After power-up this resets the chip twice.
        let (reset_cause, bites) = watchdogs::test(&mut board.watchdogs);
        defmt::info!("reset cause {=u8}", log_code(reset_cause));
        let secret = random::draw_secret();
        let mut self_tests = SelfTests::start(bites, secret.is_some()).await;
        let recorder = RECORDER.init_with(|| RecorderMemory::new(SOURCE));
        let controller =
            CONTROLLER.init(Controller::new(SafetyController::new(SOURCE, MONITOR.take()), recorder));
        let mut store = storage::open(board.flash);
        store.load_log(controller.fault_log()).await;
        // Without a rig, or without a secret, the relays never close: the first is a cause to stop, the other a failed
        // self-test; what takes their place here is never used.
        let stored_rig = store.active_rig().await.unwrap_or([0; COMPACT_LENGTH]);
        let secret = secret.unwrap_or_default();
        match controller.start(&StartInputs { reset_cause, stored_rig: &stored_rig, secret }) {
            Ok(()) => defmt::info!("calibration in use"),
            Err(_) => defmt::warn!("no valid calibration: the relays stay open"),
        }
        self_tests.finish_start(&stored_rig, controller.controller().calibration());
        let exchanges = host_link::exchanges();
        exchanges.publish(controller.status(now()));
        let watchdogs = Watchdogs::start(board.watchdogs);
        interrupt::UART5.set_priority(Priority::P6);
        let safety = SAFETY_EXECUTOR.start(interrupt::UART5);
        interrupt::UART4.set_priority(Priority::P8);
        let link = LINK_EXECUTOR.start(interrupt::UART4);
        let tasks = (
            safety_task(controller, board.pins, watchdogs, self_tests, exchanges),
            link_task(HostLink::new(board.link), exchanges),
        );
        match tasks {
            (Ok(safety_task), Ok(link_task)) => {
                safety.spawn(safety_task);
                link.spawn(link_task);
            }
            _ => board::restart(),
        }
        storage::run(store).await
    }

    /// Moves messages.
    #[embassy_executor::task]
    async fn link_task(mut link: HostLink, exchanges: &'static Exchanges) {
        link.run(exchanges).await
    }

    fn now() -> Micros {
        Micros::new(Instant::now().as_micros())
    }

    const fn log_code(cause: ResetCause) -> u8 {
        match cause {
            ResetCause::PowerOn => 1,
            ResetCause::Pin => 2,
            ResetCause::Watchdog => 3,
            ResetCause::Software => 4,
            ResetCause::Unknown => 5,
        }
    }

    /// The only task that drives outputs and feeds watchdogs.
    #[embassy_executor::task]
    async fn safety_task(
        controller: &'static mut Controller,
        mut pins: board::Pins,
        mut watchdogs: Watchdogs,
        mut self_tests: SelfTests,
        exchanges: &'static Exchanges,
    ) {
        let period = Duration::from_micros(TICK_PERIOD.get());
        let mut outputs = Outputs::SAFE;
        let mut pulse = None;
        let mut records = Records::new();
        // A whole period after the window watchdog's start: an early feed would be a reset.
        let mut next_tick = Instant::now() + period;
        loop {
            let before = outputs.relays;
            match select(exchanges.received(), Timer::at(next_tick)).await {
                Either::First(message) => {
                    let line_scan = (!is_poll(message)).then_some(message.as_slice());
                    outputs = controller.on_exchange(now(), line_scan);
                    pins.drive(outputs);
                    exchanges.publish(controller.status(now()));
                    exchanges.publish_page(controller.page());
                    exchanges.give_back(message);
                }
                Either::Second(()) => {
                    // Measured from now: ticks that were missed are not made up for in a burst.
                    next_tick = Instant::now() + period;
                    let self_test = self_tests.step(pins.laser(), controller.controller().calibration());
                    let inputs = TickInputs { pins: pins.read(pulse.take()), self_test };
                    let tick = controller.tick(now(), inputs);
                    outputs = tick.outputs;
                    pins.drive(outputs);
                    pulse = outputs.pulse.map(|channel| pins.pulse(channel, outputs.relays));
                    if let Some(permit) = tick.permit {
                        watchdogs.feed(permit);
                    }
                    exchanges.publish(controller.status(now()));
                    if records.step(now(), controller) {
                        exchanges.publish_page(controller.page());
                    }
                }
            }
            if outputs.relays != before {
                defmt::info!("relays {=bool} {=bool}", outputs.relays.a, outputs.relays.b);
            }
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("stm32g474 runs on a board; build it with `cargo xtask firmware` and flash it with probe-rs");
}
