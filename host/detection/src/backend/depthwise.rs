//! Convolutions that filter every channel by itself, for backends that are slow at them.
//!
//! rten multiplies matrices at the processor's speed but walks through such a convolution number by number; a network like
//! EfficientNet spends most of its time there. Here neighbouring outputs of a row are summed at once, in the widest vectors
//! that the processor has (`rten-simd`, as rten itself: AVX-512, AVX2, NEON, or plain loops), chosen while the program runs.

use rten_simd::ops::{BitOps, NumOps};
use rten_simd::{Isa, SimdOp};
use serde::{Deserialize, Serialize};

/// Numbers of the longest vector there is: a row of the scratch is longer than the picture by as much.
const LONGEST_VECTOR: usize = 16;

/// What a model's card tells about one such convolution; names are those of the network's tensors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DepthwiseLayer {
    /// What it reads: (1, channels, rows, columns).
    pub input: String,
    /// What it writes, after the limits.
    pub output: String,
    /// (channels, 1, size, size).
    pub kernel: String,
    /// (channels).
    pub bias: String,
    /// Rows and columns from one output to the next, 1 or 2.
    pub stride: usize,
    /// Outputs are not below this ...
    pub low: f32,
    /// ... nor above this.
    pub high: f32,
}

/// A convolution with its weights. The border is filled with zeros, half a kernel wide.
pub struct Depthwise {
    channels: usize,
    size: usize,
    stride: usize,
    limits: [f32; 2],
    kernel: Vec<f32>,
    bias: Vec<f32>,
    /// One channel with its border, each row as its columns 0, stride, ..., then 1, stride + 1, ...
    scratch: Vec<f32>,
}

impl Depthwise {
    /// `None` if the numbers do not make such a convolution.
    #[must_use]
    pub fn new(kernel: Vec<f32>, bias: Vec<f32>, stride: usize, limits: [f32; 2]) -> Option<Self> {
        let channels = bias.len();
        let taps = kernel.len().checked_div(channels)?;
        let size = taps.isqrt();
        let fits = channels * size * size == kernel.len()
            && matches!(size, 1 | 3 | 5 | 7)
            && matches!(stride, 1 | 2);
        fits.then(|| Self { channels, size, stride, limits, kernel, bias, scratch: Vec::new() })
    }

    /// Rows or columns of the output for those of the input.
    #[must_use]
    pub const fn outputs(&self, inputs: usize) -> usize {
        inputs.div_ceil(self.stride)
    }

    /// Channels.
    #[must_use]
    pub const fn channels(&self) -> usize {
        self.channels
    }

    /// From `input` (channels, rows, columns) to `output` (channels, rows and columns by [`Self::outputs`]), whose former
    /// content is lost. False, and `output` empty, if `input` has another size.
    pub fn run(&mut self, input: &[f32], rows: usize, columns: usize, output: &mut Vec<f32>) -> bool {
        if rows == 0 || columns == 0 || input.len() != self.channels * rows * columns {
            output.clear();
            return false;
        }
        let (rows_out, columns_out) = (self.outputs(rows), self.outputs(columns));
        // Every number is written below: those that are there already need not be cleared.
        output.resize(self.channels * rows_out * columns_out, 0.0);
        let border = self.size / 2;
        let phase = (columns + 2 * border).div_ceil(self.stride) + LONGEST_VECTOR;
        self.scratch.clear();
        self.scratch.resize(phase * self.stride * (rows + 2 * border), 0.0);
        let work = Work { layer: self, input, rows, columns, phase, output };
        match (work.layer.size, work.layer.stride) {
            (1, 1) => Filter::<1, 1>(work).dispatch(),
            (1, _) => Filter::<1, 2>(work).dispatch(),
            (3, 1) => Filter::<3, 1>(work).dispatch(),
            (3, _) => Filter::<3, 2>(work).dispatch(),
            (5, 1) => Filter::<5, 1>(work).dispatch(),
            (5, _) => Filter::<5, 2>(work).dispatch(),
            (_, 1) => Filter::<7, 1>(work).dispatch(),
            _ => Filter::<7, 2>(work).dispatch(),
        }
        true
    }
}

/// All channels of one picture.
struct Work<'a> {
    layer: &'a mut Depthwise,
    input: &'a [f32],
    rows: usize,
    columns: usize,
    /// Numbers from a row's columns 0, stride, ... to its columns 1, stride + 1, ... in the scratch.
    phase: usize,
    output: &'a mut [f32],
}

/// The work for one size of kernel and one stride. Both are known to the compiler, so that the loops over the kernel vanish.
struct Filter<'a, const SIZE: usize, const STRIDE: usize>(Work<'a>);

impl<const SIZE: usize, const STRIDE: usize> SimdOp for Filter<'_, SIZE, STRIDE> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, isa: I) {
        let Work { layer, input, rows, columns, phase, output } = self.0;
        let Depthwise { kernel, bias, scratch, limits, .. } = layer;
        let (border, line) = (SIZE / 2, phase * STRIDE);
        let (rows_out, columns_out) = (rows.div_ceil(STRIDE), columns.div_ceil(STRIDE));
        let planes = input.chunks_exact(rows * columns).zip(kernel.chunks_exact(SIZE * SIZE).zip(&*bias));
        for (channel, (plane, (kernel, bias))) in planes.enumerate() {
            let padded = scratch.chunks_exact_mut(line).skip(border);
            for (row, padded) in plane.chunks_exact(columns).zip(padded) {
                spread::<STRIDE>(row, padded, border, phase);
            }
            let output = &mut output[channel * rows_out * columns_out..];
            filter::<I, SIZE, STRIDE>(
                isa,
                scratch,
                phase,
                kernel,
                *bias,
                *limits,
                output,
                [rows_out, columns_out],
            );
        }
    }
}

/// Writes a row between its borders, its columns sorted by what remains after division by the stride.
#[inline(always)]
fn spread<const STRIDE: usize>(row: &[f32], padded: &mut [f32], border: usize, phase: usize) {
    if STRIDE == 1 {
        padded[border..border + row.len()].copy_from_slice(row);
        return;
    }
    // Stride 2: the first column lands in the first half if the border is even.
    let (even, odd) = padded.split_at_mut(phase);
    let (mut first, mut second) = if border.is_multiple_of(2) { (even, odd) } else { (odd, even) };
    let (place, after) = (border / 2, border.div_ceil(2));
    let pairs = row.len() / 2;
    if let [last] = row[2 * pairs..] {
        first[place + pairs] = last;
    }
    first = &mut first[place..place + pairs];
    second = &mut second[after..after + pairs];
    for ((pair, first), second) in row.chunks_exact(2).zip(first).zip(second) {
        (*first, *second) = (pair[0], pair[1]);
    }
}

/// One channel, from the scratch to the beginning of `output`. What is behind the channel's end may be overwritten: the next
/// channel's numbers come later.
#[inline(always)]
#[allow(
    clippy::too_many_arguments,
    reason = "a structure would have to be taken apart again for the registers"
)]
fn filter<I: Isa, const SIZE: usize, const STRIDE: usize>(
    isa: I,
    scratch: &[f32],
    phase: usize,
    kernel: &[f32],
    bias: f32,
    limits: [f32; 2],
    output: &mut [f32],
    [rows, columns]: [usize; 2],
) {
    let ops = isa.f32();
    let mut weights = [[ops.zero(); SIZE]; SIZE];
    for (weights, kernel) in weights.iter_mut().zip(kernel.chunks_exact(SIZE)) {
        for (weight, kernel) in weights.iter_mut().zip(kernel) {
            *weight = ops.splat(*kernel);
        }
    }
    let (bias, low, high) = (ops.splat(bias), ops.splat(limits[0]), ops.splat(limits[1]));
    let line = phase * STRIDE;
    for row in 0..rows {
        let lines = &scratch[row * STRIDE * line..][..SIZE * line];
        for column in (0..columns).step_by(ops.len()) {
            let mut sum = bias;
            for (line, weights) in lines.chunks_exact(line).zip(&weights) {
                for (right, weight) in weights.iter().enumerate() {
                    let values = ops.load(&line[right % STRIDE * phase + right / STRIDE + column..]);
                    sum = ops.mul_add(values, *weight, sum);
                }
            }
            let sum = ops.clamp(sum, low, high);
            let place = &mut output[row * columns + column..];
            if place.len() >= ops.len() {
                // The end of the last vector is overwritten by the next row.
                ops.store(sum, place);
            } else {
                let mut last = [0.0; LONGEST_VECTOR];
                ops.store(sum, &mut last);
                place.copy_from_slice(&last[..place.len()]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, number by number.
    fn by_definition(
        input: &[f32],
        [channels, rows, columns]: [usize; 3],
        kernel: &[f32],
        bias: &[f32],
        size: usize,
        stride: usize,
    ) -> Vec<f32> {
        let border = (size / 2) as isize;
        let mut output = Vec::new();
        for channel in 0..channels {
            for row in (0..rows).step_by(stride) {
                for column in (0..columns).step_by(stride) {
                    let mut sum = f64::from(bias[channel]);
                    for down in 0..size {
                        for right in 0..size {
                            let v = row as isize + down as isize - border;
                            let u = column as isize + right as isize - border;
                            if (0..rows as isize).contains(&v) && (0..columns as isize).contains(&u) {
                                let value = input[(channel * rows + v as usize) * columns + u as usize];
                                sum += f64::from(value)
                                    * f64::from(kernel[(channel * size + down) * size + right]);
                            }
                        }
                    }
                    output.push(sum as f32);
                }
            }
        }
        output
    }

    fn numbers(count: usize, seed: u64) -> Vec<f32> {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1_u64 << 24) as f32 * 2.0 - 1.0
        };
        (0..count).map(|_| next()).collect()
    }

    proptest! {
        #[test]
        fn it_is_the_convolution_by_its_definition(
            channels in 1_usize..4,
            rows in 1_usize..40,
            columns in 1_usize..40,
            half in 0_usize..4,
            stride in 1_usize..3,
            seed in any::<u64>(),
        ) {
            let size = 2 * half + 1;
            let input = numbers(channels * rows * columns, seed);
            let (kernel, bias) = (numbers(channels * size * size, seed ^ 1), numbers(channels, seed ^ 2));
            let expected = by_definition(&input, [channels, rows, columns], &kernel, &bias, size, stride);
            let mut layer = Depthwise::new(kernel, bias, stride, [-0.5, 0.75]).unwrap();
            let mut output = vec![9.0; 3];
            prop_assert!(layer.run(&input, rows, columns, &mut output));
            prop_assert_eq!(output.len(), expected.len());
            for (found, exact) in output.iter().zip(&expected) {
                prop_assert!((found - exact.clamp(-0.5, 0.75)).abs() < 1e-4, "{} instead of {}", found, exact);
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert!(Depthwise::new(vec![0.0; 18], vec![0.0; 2], 1, [0.0, 6.0]).is_some());
        assert!(Depthwise::new(vec![0.0; 17], vec![0.0; 2], 1, [0.0, 6.0]).is_none(), "no whole kernels");
        assert!(
            Depthwise::new(vec![0.0; 8], vec![0.0; 2], 1, [0.0, 6.0]).is_none(),
            "an even kernel has no middle"
        );
        assert!(
            Depthwise::new(vec![0.0; 81], vec![0.0; 1], 1, [0.0, 6.0]).is_none(),
            "larger than any in use"
        );
        assert!(Depthwise::new(vec![], vec![], 1, [0.0, 6.0]).is_none());
        assert!(Depthwise::new(vec![0.0; 18], vec![0.0; 2], 3, [0.0, 6.0]).is_none());
        let mut layer = Depthwise::new(vec![0.0; 18], vec![0.0; 2], 1, [0.0, 6.0]).unwrap();
        let mut output = vec![1.0];
        assert!(!layer.run(&[0.0; 31], 4, 4, &mut output) && output.is_empty());
    }
}
