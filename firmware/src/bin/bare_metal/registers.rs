//! Patterns in all registers of the processor and of the floating-point unit at once; what they must fold into is in
//! `nearfield_firmware::selftest::processor`.

use core::arch::naked_asm;
use nearfield_firmware::selftest::Outcome;
use nearfield_firmware::selftest::processor::{self, CORE_REGISTERS, FLOAT_REGISTERS};

/// Processor registers and whole-number arithmetic.
pub(crate) fn check_processor() -> Outcome {
    // SAFETY: keeps to the calling convention and touches nothing but registers and its own stack.
    let fold = |seed| unsafe { fold_core(seed) };
    match processor::check_registers(CORE_REGISTERS, fold) {
        Outcome::Passed => processor::check_arithmetic(),
        other => other,
    }
}

/// Floating-point registers and arithmetic.
pub(crate) fn check_floating_point() -> Outcome {
    // SAFETY: keeps to the calling convention and touches nothing but registers and its own stack.
    let fold = |seed| unsafe { fold_float(seed) };
    match processor::check_registers(FLOAT_REGISTERS, fold) {
        Outcome::Passed => processor::check_float_arithmetic(),
        other => other,
    }
}

/// Fills r1 to r12 and r14, each from the one before, then folds them into r0.
#[unsafe(naked)]
unsafe extern "C" fn fold_core(seed: u32) -> u32 {
    naked_asm!(
        "push {{r4-r11, lr}}",
        "ror r1, r0, #1",
        "ror r2, r1, #1",
        "ror r3, r2, #1",
        "ror r4, r3, #1",
        "ror r5, r4, #1",
        "ror r6, r5, #1",
        "ror r7, r6, #1",
        "ror r8, r7, #1",
        "ror r9, r8, #1",
        "ror r10, r9, #1",
        "ror r11, r10, #1",
        "ror r12, r11, #1",
        "ror lr, r12, #1",
        "add r0, r1, r0, ror #3",
        "add r0, r2, r0, ror #3",
        "add r0, r3, r0, ror #3",
        "add r0, r4, r0, ror #3",
        "add r0, r5, r0, ror #3",
        "add r0, r6, r0, ror #3",
        "add r0, r7, r0, ror #3",
        "add r0, r8, r0, ror #3",
        "add r0, r9, r0, ror #3",
        "add r0, r10, r0, ror #3",
        "add r0, r11, r0, ror #3",
        "add r0, r12, r0, ror #3",
        "add r0, lr, r0, ror #3",
        "pop {{r4-r11, pc}}"
    )
}

/// Fills s0 to s31, then folds them into r0.
#[unsafe(naked)]
unsafe extern "C" fn fold_float(seed: u32) -> u32 {
    naked_asm!(
        "vpush {{s16-s31}}",
        "mov r1, r0",
        ".irp register, 0,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23,24,25,26,27,28,29,30,31",
        "ror r1, r1, #1",
        "vmov s\\register, r1",
        ".endr",
        ".irp register, 0,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23,24,25,26,27,28,29,30,31",
        "vmov r1, s\\register",
        "add r0, r1, r0, ror #3",
        ".endr",
        "vpop {{s16-s31}}",
        "bx lr"
    )
}
