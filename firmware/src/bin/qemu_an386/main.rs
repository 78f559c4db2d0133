//! The firmware on QEMU's `mps2-an386`, an emulated Cortex-M4F board: the same library, a real executor, a real
//! (emulated) watchdog. Relays are the board's LEDs 0 (channel A) and 1 (channel B).
//!
//! The mode is the last word of the semihosting command line:
//!
//! * `lockstep`: the host gives time, pins and line-scans record by record over two FIFOs, `requests` and `replies`,
//!   in the emulator's working directory (see `nearfield_firmware::lockstep`);
//! * `shared-memory`: tasks on the board's own clock; line-scans come through memory that the host shares, with a
//!   doorbell on the serial line (see `shared_memory`);
//! * `measure`: prints the instructions that a line-scan takes and the deepest stack, and ends.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "../bare_metal/mod.rs"]
mod bare_metal;
#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod clock;
#[cfg(target_os = "none")]
mod flash;
#[cfg(target_os = "none")]
mod lockstep;
#[cfg(target_os = "none")]
mod measure;
#[cfg(target_os = "none")]
mod self_tests;
#[cfg(target_os = "none")]
mod semihosting;
#[cfg(target_os = "none")]
mod shared_memory;

#[cfg(target_os = "none")]
mod target {
    use crate::{board, clock, lockstep, measure, semihosting, shared_memory};
    use cortex_m::peripheral::NVIC;
    use cortex_m_rt::{entry, exception};
    use embassy_executor::InterruptExecutor;
    use nearfield_firmware::black_box::recorded::{RecordedController, RecorderMemory};
    use nearfield_firmware::safety::{LineScanMonitor, SafetyController};
    use nearfield_shared::units::SourceId;
    use static_cell::{ConstStaticCell, StaticCell};

    /// The module that emulated controllers are; simulated hosts address it.
    const SOURCE: SourceId = SourceId::new(1);

    /// The controller as this binary holds it.
    pub(crate) type Controller =
        RecordedController<&'static mut LineScanMonitor, &'static mut RecorderMemory>;

    /// All zeros at start, so that it takes no flash.
    static MONITOR: ConstStaticCell<LineScanMonitor> = ConstStaticCell::new(LineScanMonitor::new());
    static RECORDER: StaticCell<RecorderMemory> = StaticCell::new();
    static CONTROLLER: StaticCell<Controller> = StaticCell::new();

    /// WFE does nothing on this machine, so that a thread-mode executor would spin: tasks run in an interrupt.
    static EXECUTOR: InterruptExecutor = InterruptExecutor::new();

    /// The board's interrupts that are used.
    #[derive(Clone, Copy)]
    #[repr(u16)]
    pub(crate) enum Interrupt {
        SerialReceive = 0,
        Timer0 = 8,
        Timer1 = 9,
        Executor = 31,
    }

    // SAFETY: the numbers are those of the board's vector table below, all under 32.
    unsafe impl cortex_m::interrupt::InterruptNumber for Interrupt {
        fn number(self) -> u16 {
            self as u16
        }
    }

    /// A vector of the table.
    type Handler = unsafe extern "C" fn();

    unsafe extern "C" fn unexpected() {
        board::restart("unexpected interrupt");
    }

    unsafe extern "C" fn run_executor() {
        // SAFETY: called from the interrupt that the executor was started with, and from nowhere else.
        unsafe { EXECUTOR.on_interrupt() }
    }

    const fn vectors() -> [Handler; 32] {
        let mut vectors: [Handler; 32] = [unexpected; 32];
        vectors[Interrupt::SerialReceive as usize] = shared_memory::on_serial_receive;
        vectors[Interrupt::Timer0 as usize] = clock::on_timer0;
        vectors[Interrupt::Timer1 as usize] = clock::on_timer1;
        vectors[Interrupt::Executor as usize] = run_executor;
        vectors
    }

    /// Part of the vector table, under the name and in the section that cortex-m-rt's linker script expects.
    // SAFETY: the only definition of this symbol and this section.
    #[unsafe(link_section = ".vector_table.interrupts")]
    // SAFETY: as above.
    #[unsafe(no_mangle)]
    static __INTERRUPTS: [Handler; 32] = vectors();

    #[exception]
    unsafe fn NonMaskableInt() -> ! {
        // The watchdog's first stage; its second one resets the board, and nothing here may prevent that.
        loop {
            cortex_m::asm::nop();
        }
    }

    #[exception]
    unsafe fn HardFault(_frame: &cortex_m_rt::ExceptionFrame) -> ! {
        board::restart("hard fault")
    }

    #[panic_handler]
    fn panic(_info: &core::panic::PanicInfo<'_>) -> ! {
        board::restart("panic")
    }

    #[entry]
    fn main() -> ! {
        board::open_relays();
        clock::start();
        // SAFETY: their handlers are in the vector table.
        unsafe { NVIC::unmask(Interrupt::SerialReceive) };
        // SAFETY: as above.
        unsafe { NVIC::unmask(Interrupt::Timer0) };
        // SAFETY: as above.
        unsafe { NVIC::unmask(Interrupt::Timer1) };
        // SAFETY: nothing else uses the core's peripherals at this point.
        let mut core = unsafe { cortex_m::Peripherals::steal() };
        measure::start_counter(&mut core.SYST);
        // SAFETY: lower priority than the drivers' interrupts; nothing relies on masking by priority.
        unsafe { core.NVIC.set_priority(Interrupt::Executor, 0xE0) };
        let spawner = EXECUTOR.start(Interrupt::Executor);
        match run_mode() {
            Ok(task) => spawner.spawn(task),
            Err(_) => board::restart("no room for a task"),
        }
        loop {
            cortex_m::asm::wfi();
        }
    }

    #[embassy_executor::task]
    async fn run_mode() {
        let reset_cause = board::reset_cause();
        let recorder = RECORDER.init_with(|| RecorderMemory::new(SOURCE));
        let controller = SafetyController::new(SOURCE, MONITOR.take());
        let controller = CONTROLLER.init(RecordedController::new(controller, recorder));
        let mut command_line = [0; 96];
        match semihosting::last_word(&mut command_line) {
            "lockstep" => lockstep::run(controller, reset_cause),
            "measure" => measure::run(controller),
            "shared-memory" => shared_memory::run(controller, reset_cause).await,
            _ => semihosting::print("unknown mode; use lockstep, shared-memory or measure\n"),
        }
        semihosting::exit();
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("qemu_an386 runs on an emulated board; build it with `cargo xtask firmware`");
}
