//! Convolutions that filter every channel by itself, for backends that are slow at them.
//!
//! rten multiplies matrices at the processor's speed but walks through such a convolution number by number; a network like
//! EfficientNet spends most of its time there. Here sixteen neighbouring outputs are summed at once, which compilers turn into
//! vector instructions of any processor.

use serde::{Deserialize, Serialize};

/// Outputs of a row that are summed at once.
const LANES: usize = 16;

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

    /// From `input` (channels, rows, columns) to `output` (channels, rows and columns by [`Self::outputs`]), which is emptied first.
    /// False, and nothing written, if `input` has another size.
    pub fn run(&mut self, input: &[f32], rows: usize, columns: usize, output: &mut Vec<f32>) -> bool {
        output.clear();
        if rows == 0 || columns == 0 || input.len() != self.channels * rows * columns {
            return false;
        }
        let (rows_out, columns_out) = (self.outputs(rows), self.outputs(columns));
        output.resize(self.channels * rows_out * columns_out, 0.0);
        let border = self.size / 2;
        // The last vector of a row may reach beyond the picture.
        let phase = (columns + 2 * border).div_ceil(self.stride) + LANES;
        let line = phase * self.stride;
        self.scratch.clear();
        self.scratch.resize(line * (rows + 2 * border), 0.0);
        let filter = match (self.size, self.stride) {
            (1, 1) => filter::<1, 1>,
            (1, _) => filter::<1, 2>,
            (3, 1) => filter::<3, 1>,
            (3, _) => filter::<3, 2>,
            (5, 1) => filter::<5, 1>,
            (5, _) => filter::<5, 2>,
            (_, 1) => filter::<7, 1>,
            _ => filter::<7, 2>,
        };
        let taps = self.size * self.size;
        let planes = input.chunks_exact(rows * columns).zip(output.chunks_exact_mut(rows_out * columns_out));
        for ((plane, result), (kernel, bias)) in planes.zip(self.kernel.chunks_exact(taps).zip(&self.bias)) {
            let padded = self.scratch.chunks_exact_mut(line).skip(border);
            for (row, padded) in plane.chunks_exact(columns).zip(padded) {
                spread(row, padded, border, self.stride, phase);
            }
            filter(&self.scratch, phase, kernel, *bias, self.limits, result, columns_out);
        }
        true
    }
}

/// Writes a row between its borders, its columns sorted by what remains after division by the stride.
fn spread(row: &[f32], padded: &mut [f32], border: usize, stride: usize, phase: usize) {
    if stride == 1 {
        padded[border..border + row.len()].copy_from_slice(row);
        return;
    }
    // Stride 2: the first column lands in the first half if the border is even.
    let (even, odd) = padded.split_at_mut(phase);
    let (mut first, mut second) = if border.is_multiple_of(2) { (even, odd) } else { (odd, even) };
    let (place, after) = (border / 2, border.div_ceil(2));
    first = &mut first[place..];
    second = &mut second[after..];
    for ((pair, first), second) in row.chunks(2).zip(first).zip(second) {
        match pair {
            [one, other] => (*first, *second) = (*one, *other),
            [one] => *first = *one,
            _ => {}
        }
    }
}

/// One channel. Sizes are known to the compiler, so that sums stay in registers and the loops over the kernel vanish.
fn filter<const SIZE: usize, const STRIDE: usize>(
    scratch: &[f32],
    phase: usize,
    kernel: &[f32],
    bias: f32,
    [low, high]: [f32; 2],
    result: &mut [f32],
    columns: usize,
) {
    let line = phase * STRIDE;
    let mut weights = [[0.0; SIZE]; SIZE];
    for (weights, kernel) in weights.iter_mut().zip(kernel.chunks_exact(SIZE)) {
        weights.copy_from_slice(kernel);
    }
    let mut top = 0;
    for result in result.chunks_exact_mut(columns) {
        let mut first = top;
        for result in result.chunks_mut(LANES) {
            let mut sums = [bias; LANES];
            for (down, weights) in weights.iter().enumerate() {
                for (right, weight) in weights.iter().enumerate() {
                    let start = first + down * line + right % STRIDE * phase + right / STRIDE;
                    let Some(values) = scratch.get(start..).and_then(|rest| rest.first_chunk::<LANES>())
                    else {
                        continue;
                    };
                    for lane in 0..LANES {
                        sums[lane] += weight * values[lane];
                    }
                }
            }
            for (result, sum) in result.iter_mut().zip(sums) {
                *result = sum.max(low).min(high);
            }
            first += LANES;
        }
        top += line * STRIDE;
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
