//! The processor's and the floating-point unit's registers and arithmetic.
//!
//! The binaries write a seed, rotated one bit further for each register, into all of them at once and fold what they
//! read back into one word; [`signature`] says what that word must be. [`SEEDS`] hold each bit of each register both
//! high and low. Arithmetic is checked against known answers whose operands the compiler cannot see through.
//!
//! Not covered: the stack pointer, the program counter and the status register by patterns of their own (a processor
//! that has them wrong does not come this far); the instruction decoder beyond the instructions used.
//!
//! **Time:** about 400 instructions for all seeds and both register files. **Failure:**
//! [`SelfTestKind::Processor`](super::SelfTestKind::Processor),
//! [`SelfTestKind::FloatingPoint`](super::SelfTestKind::FloatingPoint).

use super::Outcome;
use core::cmp::Ordering;
use core::hint::black_box;

/// r1 to r12 and r14; r0 carries the seed and the result.
pub const CORE_REGISTERS: u32 = 13;
/// s0 to s31.
pub const FLOAT_REGISTERS: u32 = 32;

/// Patterns and their complements: each bit high and low, neighbours equal and different.
pub const SEEDS: [u32; 4] = [0x5A3C_96E1, 0xA5C3_691E, 0x3333_5555, 0xCCCC_AAAA];

/// What the registers' contents fold into: register n holds the seed rotated right by n bits, and
/// `fold = content + rotate_right(fold, 3)` (wrapping) from the first to the last, beginning with the seed.
#[must_use]
pub const fn signature(seed: u32, registers: u32) -> u32 {
    let (mut content, mut fold, mut left) = (seed, seed, registers);
    while left > 0 {
        content = content.rotate_right(1);
        fold = content.wrapping_add(fold.rotate_right(3));
        left = left.saturating_sub(1);
    }
    fold
}

/// Runs `fold` (the binary's own, with this seed) for every seed and compares.
pub fn check_registers(registers: u32, mut fold: impl FnMut(u32) -> u32) -> Outcome {
    Outcome::passed_if(SEEDS.into_iter().all(|seed| fold(seed) == signature(seed, registers)))
}

/// Whole-number arithmetic against known answers.
#[must_use]
pub fn check_arithmetic() -> Outcome {
    let (a, b, shift) = (black_box(0xC3A5_5A3C_u32), black_box(0x1357_9BDF_u32), black_box(13_u32));
    let wide = u64::from(a).wrapping_mul(u64::from(b));
    let answers = [
        a.wrapping_add(b),
        a.wrapping_sub(b),
        a.wrapping_mul(b),
        a.checked_div(b).unwrap_or(0),
        a.checked_rem(b).unwrap_or(0),
        a.rotate_left(shift) ^ (a >> 7) ^ (b << 5),
        a.leading_zeros().wrapping_add(a.reverse_bits()),
        u32::try_from(wide >> 32).unwrap_or(0),
    ];
    Outcome::passed_if(answers == WHOLE_ANSWERS)
}

const WHOLE_ANSWERS: [u32; 8] =
    [0xD6FC_F61B, 0xB04D_BE5D, 0xA90F_EE44, 0x0000_000A, 0x0239_4386, 0xC033_A920, 0x3C5A_A5C3, 0x0EC8_3A03];

/// Single-precision arithmetic against known answers, to the bit (IEEE 754, rounding to nearest).
#[must_use]
pub fn check_float_arithmetic() -> Outcome {
    let (a, b) = (black_box(1234.567_f32), black_box(-0.003_906_25_f32));
    let whole = black_box(-7_654_321_i32);
    let answers =
        [a + b, a - b, a * b, a / b, (a * b + a) * b, a.max(b), b.abs(), f32::from(black_box(51_234_u16))];
    let compared = [b, a, black_box(f32::INFINITY), black_box(f32::NAN)].map(|other| a.partial_cmp(&other));
    let widened = f64::from(whole) + f64::from(a);
    let found = (answers.map(f32::to_bits), compared, widened.to_bits());
    Outcome::passed_if(
        found
            == (
                FLOAT_ANSWERS,
                [Some(Ordering::Greater), Some(Ordering::Equal), Some(Ordering::Less), None],
                WIDENED_ANSWER,
            ),
    )
}

/// Worked out independently, in IEEE 754 single precision.
const FLOAT_ANSWERS: [u32; 8] =
    [0x449A_5205, 0x449A_5245, 0xC09A_5225, 0xC89A_5225, 0xC099_B7D3, 0x449A_5225, 0x3B80_0000, 0x4748_2200];
/// In double precision, which this processor computes in software.
const WIDENED_ANSWER: u64 = 0xC15D_31B7_9BB6_0000;

#[cfg(test)]
mod tests {
    use super::*;

    /// The fold of a processor whose register `faulty` (0 = first) has a bit stuck.
    fn stuck(seed: u32, registers: u32, faulty: u32, bit: u32, high: bool, chained: bool) -> u32 {
        let (mut content, mut fold, mut source) = (0_u32, seed, seed);
        for register in 0..registers {
            source = source.rotate_right(1);
            content = if chained && register > 0 { content.rotate_right(1) } else { source };
            if register == faulty {
                content = if high { content | 1 << bit } else { content & !(1 << bit) };
            }
            fold = content.wrapping_add(fold.rotate_right(3));
        }
        fold
    }

    #[test]
    fn sound_registers_pass() {
        for registers in [CORE_REGISTERS, FLOAT_REGISTERS] {
            assert_eq!(check_registers(registers, |seed| signature(seed, registers)), Outcome::Passed);
        }
    }

    /// Whether each register is loaded from the seed, or from the register before it.
    #[test]
    fn every_stuck_bit_of_every_register_is_found() {
        for (registers, chained) in
            [(CORE_REGISTERS, false), (CORE_REGISTERS, true), (FLOAT_REGISTERS, false)]
        {
            for faulty in 0..registers {
                for bit in 0..32 {
                    for high in [false, true] {
                        let fold = |seed| stuck(seed, registers, faulty, bit, high, chained);
                        assert_eq!(
                            check_registers(registers, fold),
                            Outcome::Failed,
                            "register {faulty}, bit {bit}, high {high}, chained {chained}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn registers_that_are_exchanged_are_found() {
        for registers in [CORE_REGISTERS, FLOAT_REGISTERS] {
            for one in 0..registers {
                for other in 0..one {
                    let fold = |seed: u32| {
                        (0..registers).fold(seed, |fold, register| {
                            let read = match register {
                                read if read == one => other,
                                read if read == other => one,
                                read => read,
                            };
                            seed.rotate_right(read + 1).wrapping_add(fold.rotate_right(3))
                        })
                    };
                    assert_eq!(check_registers(registers, fold), Outcome::Failed, "{one} and {other}");
                }
            }
        }
    }

    #[test]
    fn each_bit_of_a_register_is_high_in_one_seed_and_low_in_another() {
        assert_eq!(SEEDS.iter().fold(0, |all, seed| all | seed), u32::MAX);
        assert_eq!(SEEDS.iter().fold(u32::MAX, |all, seed| all & seed), 0);
    }

    #[test]
    fn known_answers_hold() {
        assert_eq!(check_arithmetic(), Outcome::Passed);
        assert_eq!(check_float_arithmetic(), Outcome::Passed);
    }

    /// What the registers' contents fold into, worked out by hand for the first of them.
    #[test]
    fn the_signature_is_what_its_rule_says() {
        let seed = 0x8000_0003_u32;
        let first = 0xC000_0001_u32.wrapping_add(0x7000_0000);
        let second = 0xE000_0000_u32.wrapping_add(first.rotate_right(3));
        assert_eq!([0, 1, 2].map(|registers| signature(seed, registers)), [seed, first, second]);
    }
}
