//! Inner loops in the widest vector instructions that this processor has, chosen while the program runs.
//!
//! The loops themselves are plain Rust that the compiler turns into vectors; here they are compiled once for each set of
//! instructions (AVX-512 or AVX2 on x86-64, NEON on aarch64, and what every processor of the kind has). Whatever the set, results
//! are the same to the last bit: vectors add up in the same order as the plain loop, and no multiplication is fused.

use pulp::{Arch, Simd, WithSimd};

/// A piece of work made of loops over neighbouring values. Its function, and all that it calls in loops, must be
/// `#[inline(always)]`: only what is inlined is compiled for the instructions that were chosen.
pub trait Kernel {
    /// What comes out.
    type Output;

    /// Does it.
    fn run(self) -> Self::Output;
}

struct Dispatched<K>(K);

impl<K: Kernel> WithSimd for Dispatched<K> {
    type Output = K::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> K::Output {
        self.0.run()
    }
}

/// Runs a kernel with the best instructions there are.
pub fn run<K: Kernel>(kernel: K) -> K::Output {
    Arch::new().dispatch(Dispatched(kernel))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32]);

    impl Kernel for Sum<'_> {
        type Output = f32;

        #[inline(always)]
        fn run(self) -> f32 {
            self.0.iter().fold(0.0, |sum, value| sum + value * 0.1)
        }
    }

    /// Pictures are judged alike on every computer.
    #[test]
    fn whatever_the_instructions_the_result_is_that_of_the_plain_loop() {
        let values: Vec<f32> = (0_i16..1001).map(|value| f32::from(value).sqrt()).collect();
        assert_eq!(run(Sum(&values)).to_bits(), Sum(&values).run().to_bits());
    }

    /// Where this crate's tests run on the Pi's processor, they test the vector instructions that the Pi has.
    #[cfg(target_arch = "aarch64")]
    #[test]
    fn on_the_pis_processor_kernels_run_in_neon() {
        assert!(matches!(Arch::new(), Arch::Neon(_)));
    }
}
