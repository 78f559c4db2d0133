//! Inner loops in the widest vector instructions that this processor has, chosen while the program runs.
//!
//! The loops themselves are plain Rust that the compiler turns into vectors; here they are compiled once for each set of
//! instructions (AVX2 on x86-64, NEON on aarch64, and what every processor of the kind has). Whatever the set, results
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
