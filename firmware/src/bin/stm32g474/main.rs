//! The firmware on the STM32G474RE (Nucleo-G474RE). Built, not run on hardware.
//!
//! Two tasks that move bytes and pins; `nearfield_firmware` decides:
//!
//! * `safety_task`, in an interrupt: every 5 ms a slice of the self-tests and a tick, and each received message as it
//!   comes; it alone drives the relays and feeds the watchdogs;
//! * `link_task`, in thread mode: one SPI transaction after the other.
//!
//! | pin | direction | use |
//! |---|---|---|
//! | PC0, PC1 | out | relay coils, channels A and B; high = closed |
//! | PC2, PC3 | in, pull-down | mirror contacts of A and B; high = main contacts proven open |
//! | PC13 | in, pull-down | reset button; high = pressed |
//! | PC8 | in, pull-down | service key; high at power-up = service mode, see `service` |
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
mod calibration;
#[cfg(target_os = "none")]
mod host_link;
#[cfg(target_os = "none")]
mod laser;
#[cfg(target_os = "none")]
mod low_speed_clock;
#[cfg(target_os = "none")]
mod random;
#[cfg(target_os = "none")]
mod self_tests;
#[cfg(target_os = "none")]
mod service;
#[cfg(target_os = "none")]
mod settings;
#[cfg(target_os = "none")]
mod supply;
#[cfg(target_os = "none")]
mod watchdogs;

#[cfg(target_os = "none")]
mod target {
    use crate::host_link::{self, Exchanges, HostLink};
    use crate::self_tests::SelfTests;
    use crate::watchdogs::{self, Watchdogs};
    use crate::{board, calibration, random, service};
    use defmt_rtt as _;
    use embassy_executor::{Executor, InterruptExecutor};
    use embassy_futures::select::{Either, select};
    use embassy_stm32::interrupt::{self, InterruptExt as _, Priority};
    use embassy_time::{Duration, Instant, Timer};
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
    pub(crate) type Controller = SafetyController<&'static mut LineScanMonitor>;

    /// All zeros at start, so that it takes no flash.
    static MONITOR: ConstStaticCell<LineScanMonitor> = ConstStaticCell::new(LineScanMonitor::new());
    static CONTROLLER: StaticCell<Controller> = StaticCell::new();
    static THREAD_EXECUTOR: StaticCell<Executor> = StaticCell::new();
    /// Runs the safety task above the link task, in an interrupt that no peripheral of this board uses.
    static SAFETY_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

    defmt::timestamp!("{=u64:us}", Instant::now().as_micros());

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
        THREAD_EXECUTOR.init(Executor::new()).run(|spawner| match link_task() {
            Ok(task) => spawner.spawn(task),
            Err(_) => board::restart(),
        })
    }

    /// Sets the board up, tests it, starts the safety task, and then moves messages.
    #[embassy_executor::task]
    async fn link_task() {
        let mut board = board::start();
        // After power-up this resets the chip twice.
        let (reset_cause, bites) = watchdogs::test(&mut board.watchdogs);
        defmt::info!("reset cause {=u8}", log_code(reset_cause));
        let secret = random::draw_secret();
        let mut self_tests = SelfTests::start(bites, secret.is_some()).await;
        let mut stored = [0; COMPACT_LENGTH];
        let mut store = calibration::Store::new(board.flash);
        store.load(&mut stored).await;
        let mut link = HostLink::new(board.link);
        if board.pins.read(None).service_key {
            // The controller is not even started: nothing can close the relays.
            service::run(&mut link, &mut store).await;
        }
        let controller = CONTROLLER.init(SafetyController::new(SOURCE, MONITOR.take()));
        // Without a secret the self-tests have failed, and what takes its place is never used.
        let inputs = StartInputs { reset_cause, stored_rig: &stored, secret: secret.unwrap_or_default() };
        match controller.start(&inputs) {
            Ok(()) => defmt::info!("calibration in use"),
            Err(_) => defmt::warn!("no valid calibration: the relays stay open"),
        }
        self_tests.finish_start(&stored, controller.calibration());
        let exchanges = host_link::exchanges();
        exchanges.publish(controller.status(now()));
        let watchdogs = Watchdogs::start(board.watchdogs);
        interrupt::UART5.set_priority(Priority::P6);
        let spawner = SAFETY_EXECUTOR.start(interrupt::UART5);
        match safety_task(controller, board.pins, watchdogs, self_tests, exchanges) {
            Ok(task) => spawner.spawn(task),
            Err(_) => board::restart(),
        }
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
                    exchanges.give_back(message);
                }
                Either::Second(()) => {
                    // Measured from now: ticks that were missed are not made up for in a burst.
                    next_tick = Instant::now() + period;
                    let self_test = self_tests.step(pins.laser(), controller.calibration());
                    let inputs = TickInputs { pins: pins.read(pulse.take()), self_test };
                    let tick = controller.tick(now(), inputs);
                    outputs = tick.outputs;
                    pins.drive(outputs);
                    pulse = outputs.pulse.map(|channel| pins.pulse(channel, outputs.relays));
                    if let Some(permit) = tick.permit {
                        watchdogs.feed(permit);
                    }
                    exchanges.publish(controller.status(now()));
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
