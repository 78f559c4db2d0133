//! The destructive march over all RAM, before any variable lives, and what memory tells from one reset to the next.
//!
//! cortex-m-rt calls `__pre_init` before it fills the variables. Here that is a few instructions of assembly that run
//! two Rust functions, each on a stack in the memory that the other one tests. Neither may touch a variable, and neither
//! does: they read and write the memory under test and keep the rest in registers and on their stacks. (Constants are in
//! flash; the floating-point unit is switched on first, since the compiler may use its registers.)
//!
//! **Time:** about 13 million instructions for 128 KiB, 0.8 s on the 16 MHz that the board starts with. It is left out
//! between the two provoked bites of the watchdogs' test: the start after them makes up for it.

use super::memory::{Words, region, stack};
use core::arch::global_asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::ptr::{read_volatile, write_volatile};
use nearfield_firmware::selftest::Outcome;
use nearfield_firmware::selftest::memory::{Cells as _, march_all};
use nearfield_firmware::selftest::stack::PAINT;
use nearfield_firmware::selftest::watchdog::Marker;

/// Survives resets: start-up does not clear it.
#[repr(C)]
struct Kept {
    /// The watchdog test's marker.
    marker: [u32; 2],
    /// What the march of this start has found, and its complement.
    march: [u32; 2],
    /// The emulated board's reason of the last reset, and its complement.
    reason: [u32; 2],
}

struct KeptCell(UnsafeCell<MaybeUninit<Kept>>);
// SAFETY: accessed by volatile reads and writes in thread mode before any interrupt is enabled, see below.
unsafe impl Sync for KeptCell {}

// SAFETY: cortex-m-rt's section for memory that start-up leaves alone.
#[unsafe(link_section = ".uninit.KEPT")]
static KEPT: KeptCell = KeptCell(UnsafeCell::new(MaybeUninit::uninit()));

/// Both marches of this start have passed.
const MARCH_PASSED: u32 = 0x6D61_7263;
/// One has found a fault.
const MARCH_FAILED: u32 = 0x92F4_3B58;
/// None was made: another start follows before the controller runs.
const MARCH_LEFT_OUT: u32 = 0x3CC3_A55A;

fn kept() -> *mut Kept {
    KEPT.0.get().cast()
}

fn read_pair(pair: *const [u32; 2]) -> [u32; 2] {
    // SAFETY: two words of `KEPT`, aligned and alive; whatever memory holds is a u32.
    unsafe { read_volatile(pair) }
}

fn write_pair(pair: *mut [u32; 2], words: [u32; 2]) {
    // SAFETY: two words of `KEPT`, aligned and alive.
    unsafe { write_volatile(pair, words) }
}

fn marker_words() -> *mut [u32; 2] {
    // SAFETY: a field of a live static.
    unsafe { &raw mut (*kept()).marker }
}

fn march_words() -> *mut [u32; 2] {
    // SAFETY: a field of a live static.
    unsafe { &raw mut (*kept()).march }
}

/// What the watchdog's test left before the reset.
#[allow(dead_code, reason = "the emulated board has no reset flags to test its watchdog by")]
pub(crate) fn marker() -> Option<Marker> {
    Marker::from_words(read_pair(marker_words()))
}

/// Leaves this for after the next reset.
#[allow(dead_code, reason = "the emulated board has no reset flags to test its watchdog by")]
pub(crate) fn leave(marker: Marker) {
    write_pair(marker_words(), marker.to_words());
}

fn reason_words() -> *mut [u32; 2] {
    // SAFETY: a field of a live static.
    unsafe { &raw mut (*kept()).reason }
}

/// The word that was left before the last reset, for a board without a register that tells its reason.
#[allow(dead_code, reason = "the board's chip has such a register")]
pub(crate) fn reset_reason() -> Option<u32> {
    let [word, complement] = read_pair(reason_words());
    (word == !complement).then_some(word)
}

/// Leaves a word for after the next reset.
#[allow(dead_code, reason = "the board's chip has such a register")]
pub(crate) fn leave_reset_reason(word: u32) {
    write_pair(reason_words(), [word, !word]);
}

/// What the march has found at this start.
pub(crate) fn march_outcome() -> Outcome {
    Outcome::passed_if(read_pair(march_words()) == [MARCH_PASSED, !MARCH_PASSED])
}

unsafe extern "C" {
    static _ram_start: u32;
    static _ram_end: u32;
}

global_asm!(
    ".section .text.__pre_init",
    ".global __pre_init",
    ".type __pre_init,%function",
    ".thumb_func",
    "__pre_init:",
    // r4 to r6 survive the calls: their callees save them on stacks that are not under test at that time.
    "mov r4, lr",
    "mov r5, sp",
    "ldr r0, =0xE000ED88",
    "ldr r1, [r0]",
    "orr r1, r1, #(0xF << 20)",
    "str r1, [r0]",
    "dsb",
    "isb",
    "bl nearfield_march_ram",
    "mov r6, r0",
    "ldr r1, =_ram_end",
    "mov sp, r1",
    "bl nearfield_march_stack",
    "mov sp, r5",
    "bx r4",
    ".pool",
);

/// The march over all RAM but the stack's, on the stack. Gives what it has found.
// SAFETY: the only definition of this symbol.
#[unsafe(no_mangle)]
extern "C" fn nearfield_march_ram() -> u32 {
    let (marker, reason) = (read_pair(marker_words()), read_pair(reason_words()));
    if Marker::from_words(marker).is_some_and(|marker| marker.is_far_from_running()) {
        return MARCH_LEFT_OUT;
    }
    let ram = region((&raw const _ram_start) as usize, (&raw const _ram_end) as usize);
    // SAFETY: no variable lives yet, and the stack is elsewhere.
    let mut cells = unsafe { Words::new(ram) };
    let passed = march_all(&mut cells).is_ok();
    write_pair(marker_words(), marker);
    write_pair(reason_words(), reason);
    if passed { MARCH_PASSED } else { MARCH_FAILED }
}

/// The march over the stack's memory, on a stack at the end of the other RAM; then the stack is painted.
// SAFETY: the only definition of this symbol.
#[unsafe(no_mangle)]
extern "C" fn nearfield_march_stack(so_far: u32) {
    // SAFETY: the caller's stack is not in use: everything that it needs later is in registers.
    let mut cells = unsafe { Words::new(stack()) };
    let marched = so_far == MARCH_LEFT_OUT || march_all(&mut cells).is_ok();
    for place in 0..cells.count() {
        cells.write(place, PAINT);
    }
    let found = if marched { so_far } else { MARCH_FAILED };
    write_pair(march_words(), [found, !found]);
}
