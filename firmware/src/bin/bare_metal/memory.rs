//! Memory as test cells, and tests of the memory that the stack itself is in.

use core::arch::naked_asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::ptr::{read_volatile, write_volatile};
use nearfield_firmware::selftest::Outcome;
use nearfield_firmware::selftest::memory::{self, Cells, Region};

unsafe extern "C" {
    /// Highest address of the stack's memory, from memory.x.
    static _stack_start: u32;
    /// Its lowest address.
    static _stack_end: u32;
}

/// The memory that the stack has to itself.
pub(crate) fn stack() -> Region {
    region((&raw const _stack_end) as usize, (&raw const _stack_start) as usize)
}

/// From an address to another, both multiples of four.
pub(crate) const fn region(start: usize, end: usize) -> Region {
    Region { address: start, words: end.saturating_sub(start) / size_of::<u32>() }
}

/// Words of RAM, read and written as they are.
pub(crate) struct Words {
    region: Region,
}

impl Words {
    /// # Safety
    /// The region is RAM, and while these cells are written nothing else accesses it, or relies on its content.
    pub(crate) const unsafe fn new(region: Region) -> Self {
        Self { region }
    }

    fn pointer(&self, place: usize) -> Option<*mut u32> {
        (place < self.region.words).then_some((self.region.address + place * size_of::<u32>()) as *mut u32)
    }
}

impl Cells for Words {
    #[inline]
    fn count(&self) -> usize {
        self.region.words
    }

    #[inline]
    fn read(&self, place: usize) -> u32 {
        // SAFETY: inside a region of RAM by the constructor's contract, aligned; any content is a u32.
        self.pointer(place).map_or(0, |pointer| unsafe { read_volatile(pointer) })
    }

    #[inline]
    fn write(&mut self, place: usize, value: u32) {
        if let Some(pointer) = self.pointer(place) {
            // SAFETY: inside a region of RAM that nobody else relies on, by the constructor's contract.
            unsafe { write_volatile(pointer, value) };
        }
    }
}

/// What a test on another stack works on.
#[repr(C)]
struct Block {
    region: Region,
    outcome: Outcome,
}

/// The stack for tests of the stack's own memory. 1 KiB: 132 bytes of saved words and two small frames.
#[repr(align(8))]
struct OtherStack(UnsafeCell<MaybeUninit<[u8; 1024]>>);
// SAFETY: used by `test_block` only, with interrupts masked.
unsafe impl Sync for OtherStack {}
static OTHER_STACK: OtherStack = OtherStack(UnsafeCell::new(MaybeUninit::uninit()));

/// Calls `function(argument)` with the stack pointer at `stack_top`.
#[unsafe(naked)]
unsafe extern "C" fn call_on_stack(
    argument: *mut Block,
    function: extern "C" fn(*mut Block),
    stack_top: *mut u8,
) {
    naked_asm!("push {{r4, lr}}", "mov r4, sp", "mov sp, r2", "blx r1", "mov sp, r4", "pop {{r4, pc}}")
}

extern "C" fn test_in_place(block: *mut Block) {
    // SAFETY: `test_block` passes a live block, and its caller sits still meanwhile.
    let region = unsafe { (*block).region };
    // SAFETY: a block of RAM by `test_block`'s contract; interrupts are masked, and the content comes back.
    let mut cells = unsafe { Words::new(region) };
    let outcome = Outcome::passed_if(memory::transparent(&mut cells).is_ok());
    // SAFETY: as above.
    unsafe { (*block).outcome = outcome };
}

/// The transparent march over a block of RAM, its content untouched in the end; about 5,100 instructions, some 35 microseconds at 170 MHz, with
/// interrupts masked. A block of the stack's memory is tested from another
/// stack.
///
/// # Safety
/// The region is RAM that no DMA writes to, outside the other stack if it is in the stack's memory.
pub(crate) unsafe fn test_block(region: Region) -> Outcome {
    let stack = stack();
    let in_stack =
        region.address >= stack.address && region.address < stack.address + stack.words * size_of::<u32>();
    cortex_m::interrupt::free(|_| {
        if in_stack {
            test_on_other_stack(region)
        } else {
            let mut block = Block { region, outcome: Outcome::Failed };
            test_in_place(&raw mut block);
            block.outcome
        }
    })
}

/// The block that is handed over must lie outside the memory under test as well.
static BLOCK: OtherBlock =
    OtherBlock(UnsafeCell::new(Block { region: Region { address: 0, words: 0 }, outcome: Outcome::Failed }));
struct OtherBlock(UnsafeCell<Block>);
// SAFETY: used by `test_on_other_stack` only, with interrupts masked.
unsafe impl Sync for OtherBlock {}

fn test_on_other_stack(region: Region) -> Outcome {
    let block = BLOCK.0.get();
    // SAFETY: interrupts are masked, so nothing else uses it.
    unsafe { *block = Block { region, outcome: Outcome::Failed } };
    // SAFETY: one past the end of the stack's own memory.
    let top = unsafe { OTHER_STACK.0.get().cast::<u8>().add(size_of::<OtherStack>()) };
    // SAFETY: interrupts are masked, so the other stack has one user; it is large enough and aligned to eight.
    unsafe { call_on_stack(block, test_in_place, top) };
    // SAFETY: as above.
    unsafe { (*block).outcome }
}
