//! The program's own bytes in flash, and the place that its seal is written to.

use core::ptr::read_volatile;
use nearfield_firmware::selftest::Outcome;
use nearfield_firmware::selftest::program::{ProgramCheck, Progress, SEAL_BYTES, SLICE_BYTES};

/// `cargo xtask firmware` writes the seal here after linking; this content means "not sealed". memory.x puts it behind
/// the vectors.
#[used]
// SAFETY: the only content of this section.
#[unsafe(link_section = ".image_seal")]
static UNSEALED: [u8; SEAL_BYTES] = [0xFF; SEAL_BYTES];

unsafe extern "C" {
    /// First byte of flash, from the linker.
    static __vector_table: u8;
}

/// Reads flash by volatile accesses: the seal is not what the compiler saw, and on the emulator the program begins at
/// address zero.
fn copy(address: usize, bytes: &mut [u8]) {
    for (offset, byte) in bytes.iter_mut().enumerate() {
        // SAFETY: within the flash, which is readable everywhere and written only by the store of the calibration.
        *byte = unsafe { read_volatile((address + offset) as *const u8) };
    }
}

fn origin() -> usize {
    (&raw const __vector_table) as usize
}

/// A check that begins at the program's first byte.
pub(crate) fn check() -> ProgramCheck {
    let seal_address = (&raw const UNSEALED) as usize;
    let mut seal = [0; SEAL_BYTES];
    copy(seal_address, &mut seal);
    let offset = u32::try_from(seal_address - origin()).unwrap_or(u32::MAX);
    ProgramCheck::new(&seal, offset)
}

/// The next slice.
pub(crate) fn step(check: &mut ProgramCheck) -> Outcome {
    let mut bytes = [0; SLICE_BYTES];
    let Some(wanted) = check.wanted() else { return Outcome::Failed };
    let (Ok(start), Ok(length)) = (usize::try_from(wanted.start), usize::try_from(wanted.length)) else {
        return Outcome::Failed;
    };
    let Some(bytes) = bytes.get_mut(..length) else { return Outcome::Failed };
    copy(origin() + start, bytes);
    match check.feed(bytes) {
        Progress::Underway => Outcome::Pending,
        Progress::Intact => Outcome::Passed,
        Progress::Damaged => Outcome::Failed,
    }
}

/// The whole program at once: some million instructions.
pub(crate) fn check_whole() -> Outcome {
    let mut check = check();
    loop {
        match step(&mut check) {
            Outcome::Pending => {}
            outcome => return outcome,
        }
    }
}
