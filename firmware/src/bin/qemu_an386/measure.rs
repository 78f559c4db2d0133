//! What a line-scan costs: instructions from its last byte to the relays' command, and the deepest stack.
//!
//! Under QEMU's `-icount shift=5` an instruction takes 32 ns of emulated time, so that SysTick at 25 MHz counts
//! instructions: 1 tick = 40 ns = 1.25 instructions, the same in every run. Not a worst-case execution time: a
//! Cortex-M4's instructions take 1 to 14 cycles.

use crate::bare_metal::memory::{stack, test_block};
use crate::bare_metal::{program, registers};
use crate::semihosting::print;
use crate::target::Controller;
use core::fmt::Write as _;
use core::hint::black_box;
use core::ptr::read_volatile;
use cortex_m::peripheral::syst::SystClkSource;
use embassy_time::Instant;
use nearfield_firmware::relay::MirrorContacts;
use nearfield_firmware::safety::{PinInputs, StartInputs, TickInputs};
use nearfield_firmware::selftest::SelfTestReport;
use nearfield_firmware::selftest::stack::PAINT;
use nearfield_shared::action::Category;
use nearfield_shared::audit::first_row_for;
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::laser::Laser;
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, LASER_DIMMED};
use nearfield_shared::linescan::{
    AUDIT_PIXELS, AuditWindow, HostVerdict, LARGEST_AUDIT_COUNT, LINE_SCAN_LENGTH, LineScan, LineScanColumn,
    LineScanHeader, encode,
};
use nearfield_shared::monitor::StripeMonitor;
use nearfield_shared::rig::{ImageSize, Rig, RigError, Stripe};
use nearfield_shared::run_over::{Claim, RunOverPermit, Stretch};
use nearfield_shared::status::{Challenge, ResetCause, Status};
use nearfield_shared::units::{Micros, SequenceNumber, SignalQuality, SourceId, SubpixelRow};
use static_cell::ConstStaticCell;

unsafe extern "C" {
    /// Lowest address of the stack, from memory.x.
    static _stack_end: u32;
}

/// Bytes of the stack that were ever used; it was painted before start-up.
fn deepest_stack() -> usize {
    let bottom = (&raw const _stack_end) as usize;
    let mut address = bottom;
    // SAFETY: within the stack's own memory: the loop ends at the first word in use, at the latest this frame's.
    while unsafe { read_volatile(address as *const u32) } == PAINT {
        address += size_of::<u32>();
    }
    (bottom + STACK_LENGTH).saturating_sub(address)
}

/// Length of the stack's memory, from memory.x.
const STACK_LENGTH: usize = 32 * 1024;

/// A word to the emulator's user.
struct Output;

impl core::fmt::Write for Output {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        print(text);
        Ok(())
    }
}

fn say(name: &str, value: u32) {
    let _ = writeln!(Output, "measure {name} {value}");
}

/// Instructions that `work` takes, less those of measuring.
fn instructions(mut work: impl FnMut()) -> u32 {
    let count = |work: &mut dyn FnMut()| {
        let start = cortex_m::peripheral::SYST::get_current();
        work();
        // It counts down, in 24 bits.
        start.wrapping_sub(cortex_m::peripheral::SYST::get_current()) & 0x00FF_FFFF
    };
    let empty = count(&mut || {});
    let ticks = count(&mut work).saturating_sub(empty);
    ticks.saturating_add(ticks / 4)
}

static MESSAGE: ConstStaticCell<[u8; LINE_SCAN_LENGTH]> = ConstStaticCell::new([0; LINE_SCAN_LENGTH]);
static COLUMNS: ConstStaticCell<[LineScanColumn; LARGEST_COLUMN_COUNT]> =
    ConstStaticCell::new([LineScanColumn::MISSING; LARGEST_COLUMN_COUNT]);
/// The board's PSRAM, which nothing else uses in this mode: the controller's own RAM has no room for a second monitor.
const SPARE_MEMORY: usize = 0x2100_4000;

/// A monitor of this program's own, to make scenes with. Call once.
fn own_monitor() -> &'static mut StripeMonitor<LARGEST_COLUMN_COUNT> {
    let monitor = SPARE_MEMORY as *mut StripeMonitor<LARGEST_COLUMN_COUNT>;
    // SAFETY: 16 MiB of PSRAM lie there, aligned, and nothing else uses them in this mode; all zeros are
    // `StripeMonitor::new()`, as its documentation says.
    unsafe { monitor.write_bytes(0, 1) };
    // SAFETY: as above, and initialised; called once, so the reference is the only one.
    unsafe { &mut *monitor }
}

/// A camera over a laser at the robot's edge, whose stripe fills the picture's width.
fn rig() -> Result<Rig, RigError> {
    let (sine, cosine) = (0.766_044_443_119, 0.642_787_609_687);
    let rotation =
        [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, -sine, -cosine), Vector::new(0.0, cosine, -sine)];
    let unmoved = Pose { rotation, translation: Vector::default() };
    let translation = unmoved.to_camera(Vector::new(0.0, 0.0, 400.0)).scaled(-1.0);
    let intrinsics = Intrinsics {
        fx: 1792.0,
        fy: 1792.0,
        cx: 1151.5,
        cy: 647.5,
        distortion: [-0.031, 0.011, 0.0003, -0.0002, 0.0],
    };
    let (rise, run) = (0.928_476_690_885, 0.371_390_676_354);
    let laser = Laser {
        origin: Vector::new(0.0, 0.0, 200.0),
        normal: Vector::new(0.0, run, rise),
        offset: 200.0 * rise,
    };
    let stripe = Stripe {
        point: Vector::new(0.0, 500.0, 0.0),
        direction: Vector::new(1.0, 0.0, 0.0),
        start: -407.0,
        end: 407.0,
    };
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    Rig::new(ImageSize { width: 2304, height: 1296 }, camera, laser, stripe)
}

/// What a line-scan shows, column by column: a height over the floor, or no stripe.
#[derive(Clone, Copy)]
struct Scene {
    name: &'static str,
    height: fn(usize) -> Option<f32>,
}

const SCENES: [Scene; 6] = [
    Scene { name: "instructions_clean_floor", height: |_| Some(0.0) },
    Scene { name: "instructions_cable", height: |column| Some(if column % 300 < 12 { 8.0 } else { 0.0 }) },
    Scene { name: "instructions_box", height: |column| Some(if column < 600 { 0.0 } else { 60.0 }) },
    Scene { name: "instructions_rough", height: |column| Some([0.0, 9.0, 30.0, -8.0][column % 4]) },
    Scene { name: "instructions_slope", height: |column| Some(if column % 2 == 0 { 20.0 } else { 21.0 }) },
    Scene { name: "instructions_no_stripe", height: |column| (column % 2 == 0).then_some(0.0) },
];

/// Prints every figure.
pub(crate) fn run(controller: &mut Controller) {
    let Ok(rig) = rig() else { return print("the measurement's rig is refused\n") };
    let message = MESSAGE.take();
    let columns = COLUMNS.take();
    let monitor = own_monitor();
    let before = Instant::now();
    let stored_rig = rig.to_bytes();
    let start = StartInputs { reset_cause: ResetCause::PowerOn, stored_rig: &stored_rig, secret: [7; 16] };
    let _ = black_box(controller.start(&start));
    // Too long for SysTick's 24 bits; 1 microsecond = 31.25 instructions.
    let start = before.elapsed().as_micros().saturating_mul(125) / 4;
    say("start_instructions", u32::try_from(start).unwrap_or(u32::MAX));
    let decimation = nearfield_shared::columns::Decimation::for_line_scan(2304);
    let _ = monitor.configure(&rig, decimation);
    say("watched_columns", u32::try_from(monitor.geometry().maps().len()).unwrap_or(0));
    let (mut worst, mut permit) = (0, 0);
    let mut sequence = 0;
    let mut last_challenge = Challenge::default();
    for scene in SCENES {
        for (index, column) in columns.iter_mut().enumerate() {
            let row = monitor
                .geometry()
                .map(index)
                .and_then(|map| SubpixelRow::from_pixels(map.row((scene.height)(index)?)));
            *column = row
                .map_or(LineScanColumn::MISSING, |row| LineScanColumn { row, quality: SignalQuality::BEST });
        }
        // Four in a row: votes fill up.
        for _ in 0..4 {
            sequence += 1;
            let taken = one_scan(controller, &rig, message, columns, sequence, &mut last_challenge);
            worst = worst.max(taken);
            if sequence % 4 == 0 {
                say(scene.name, taken);
            }
        }
        if sequence == 4 {
            split(message, monitor);
        }
        if scene.name == "instructions_slope" {
            permit = permit_instructions(message, monitor);
            say("permit_instructions", permit);
        }
    }
    // The controller is not running here, so that it grants no permit: its work is measured apart and added.
    say("scan_instructions", worst.saturating_add(permit));
    self_test_slices();
    say("stack_bytes", u32::try_from(deepest_stack()).unwrap_or(u32::MAX));
}

/// Instructions of one line-scan: exchange and the tick after it.
fn one_scan(
    controller: &mut Controller,
    rig: &Rig,
    message: &mut [u8; LINE_SCAN_LENGTH],
    columns: &[LineScanColumn; LARGEST_COLUMN_COUNT],
    sequence: u32,
    last_challenge: &mut Challenge,
) -> u32 {
    let now = Micros::from_millis(u64::from(sequence) * 20);
    let header = LineScanHeader {
        source: SourceId::new(1),
        calibration: rig.calibration_id(),
        sequence: SequenceNumber::new(sequence),
        capture_age: Micros::from_millis(20),
        exposure: Micros::from_millis(4),
        last_status: sequence - 1,
        verdict: HostVerdict::Clear,
        ambient: 80,
        saturated: 9,
        claims: core::array::from_fn(|slot| claim(slot, sequence)),
    };
    // Every check has its full work: light in all blocks, and the windows that the last status asked for.
    let challenge = *last_challenge;
    let windows = challenge.columns.map(|column| window(column, columns));
    let level = if sequence % 4 < 2 { u16::from(u8::MAX) } else { u16::from(LASER_DIMMED) };
    let brightness = BrightnessProfile { blocks: [level * 80; 64] };
    let _ = encode(message, &header, columns, &brightness, &windows);
    *last_challenge = Status::parse(&controller.status(now)).map_or(challenge, |status| status.challenge);
    let pins = PinInputs { mirror: MirrorContacts::BOTH_OPEN, ..PinInputs::default() };
    let inputs = TickInputs { pins, self_test: SelfTestReport::passed(now) };
    instructions(|| {
        black_box(controller.on_exchange(now, Some(black_box(message))));
        let _ = black_box(controller.tick(now, inputs));
    })
}

/// Debris in pieces that move: every check of a claim has its full work.
fn claim(slot: usize, sequence: u32) -> Option<Claim> {
    let start = i16::try_from(slot * 60 + (sequence as usize % 3) * 5).ok()?;
    let stretch = Stretch::new(start, start + 50)?;
    Some(Claim { stretch, category: Category::Tool, confidence: u8::MAX, age: Micros::from_millis(40) })
}

/// What the camera shows around the reported row of a column.
fn window(column: u16, columns: &[LineScanColumn; LARGEST_COLUMN_COUNT]) -> AuditWindow {
    let reported = columns.get(usize::from(column)).copied().unwrap_or(LineScanColumn::MISSING);
    let first_row = first_row_for(reported.row.to_pixels().unwrap_or(400.0));
    let mut pixels = [120; AUDIT_PIXELS];
    for (pixel, light) in pixels.iter_mut().skip(14).zip([30, 70, 90, 70, 30]) {
        *pixel += light;
    }
    AuditWindow { column, first_row, pixels }
}

const _: () = assert!(LARGEST_AUDIT_COUNT == 8, "a challenge asks for eight windows");

/// The parts of it, on a clean floor.
fn split(message: &[u8; LINE_SCAN_LENGTH], monitor: &mut StripeMonitor<LARGEST_COLUMN_COUNT>) {
    let parse = instructions(|| {
        let _ = black_box(LineScan::parse(black_box(message)));
    });
    say("parse_instructions", parse);
    if let Ok(scan) = LineScan::parse(message) {
        say(
            "monitor_instructions",
            instructions(|| {
                black_box(monitor.update(black_box(scan).readings()));
            }),
        );
    }
}

/// What a run-over permit of the largest size costs the monitor over low debris everywhere.
fn permit_instructions(
    message: &[u8; LINE_SCAN_LENGTH],
    monitor: &mut StripeMonitor<LARGEST_COLUMN_COUNT>,
) -> u32 {
    let Ok(scan) = LineScan::parse(message) else { return 0 };
    let stretches =
        [Stretch::new(-100, -50), Stretch::new(-50, 0), Stretch::new(0, 50), Stretch::new(50, 100)];
    let [without, with] = [RunOverPermit::NONE, RunOverPermit { stretches }].map(|permit| {
        instructions(|| {
            black_box(monitor.update_with(black_box(scan).readings(), black_box(&permit), |_| {}, |_| {}));
        })
    });
    with.saturating_sub(without)
}

/// What each slice of the running self-tests takes; a tick makes one.
fn self_test_slices() {
    let first = stack().block(0);
    let block = first.map_or(0, |block| {
        instructions(|| {
            // SAFETY: the stack's far end; no DMA on this board, and the other stack is elsewhere.
            let _ = black_box(unsafe { test_block(block) });
        })
    });
    say("self_test_memory_block", block);
    let mut check = program::check();
    say(
        "self_test_program_slice",
        instructions(|| {
            let _ = black_box(program::step(&mut check));
        }),
    );
    let registers = instructions(|| {
        let _ = black_box(registers::check_processor());
        let _ = black_box(registers::check_floating_point());
    });
    say("self_test_registers", registers);
}

/// SysTick on the processor's clock, over its whole range.
pub(crate) fn start_counter(systick: &mut cortex_m::peripheral::SYST) {
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(0x00FF_FFFF);
    systick.clear_current();
    systick.enable_counter();
}
