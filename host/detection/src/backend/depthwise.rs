//! Convolutions that filter every channel by itself, for backends that are slow at them.
//!
//! rten multiplies matrices at the processor's speed but walks through such a convolution number by number; a network like
//! EfficientNet spends most of its time there. Here neighbouring outputs of a row are summed at once, in the widest vectors
//! that the processor has (`rten-simd`, as rten itself: AVX-512, AVX2, NEON, or plain loops), chosen while the program runs.

use std::ops::Range;

use rten_simd::ops::{BitOps, NumOps};
use rten_simd::{Isa, SimdOp};

/// Numbers of the longest vector there is: a row of the scratch is longer than the picture by as much.
const LONGEST_VECTOR: usize = 16;
/// Rows of the output that are summed at once.
pub const BLOCK: usize = 5;

/// A convolution with its weights. The border is filled with zeros, half a kernel wide.
pub struct Depthwise {
    channels: usize,
    size: usize,
    stride: usize,
    /// What is read is first brought between these, its channel's offset added before.
    input_limits: [f32; 2],
    offsets: Vec<f32>,
    limits: [f32; 2],
    kernel: Vec<f32>,
    bias: Vec<f32>,
    /// One channel of a band with its border, each row as its columns 0, stride, ..., then 1, stride + 1, ...
    scratch: Vec<f32>,
}

/// Some rows of a convolution's output, and the rows of its input that they are made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Band {
    /// Rows of the whole input.
    pub rows: usize,
    /// Columns of the input.
    pub columns: usize,
    /// Columns of the output.
    pub columns_out: usize,
    /// Rows of the input that are needed.
    pub source: Range<usize>,
    /// Rows of the output.
    pub result: Range<usize>,
}

impl Depthwise {
    /// `kernel` is (channels, size, size), `bias` (channels). `None` if the numbers do not make such a convolution.
    #[must_use]
    pub fn new(kernel: Vec<f32>, bias: Vec<f32>, stride: usize, limits: [f32; 2]) -> Option<Self> {
        let channels = bias.len();
        let taps = kernel.len().checked_div(channels)?;
        let size = taps.isqrt();
        let fits = channels * size * size == kernel.len()
            && matches!(size, 1 | 3 | 5 | 7)
            && matches!(stride, 1 | 2);
        let (input_limits, offsets) = ([f32::NEG_INFINITY, f32::INFINITY], vec![0.0; channels]);
        let scratch = Vec::new();
        fits.then_some(Self { channels, size, stride, input_limits, offsets, limits, kernel, bias, scratch })
    }

    /// Has it add `offsets` (channels) to what it reads, and bring the sum between `limits` ahead of the filter. `None` if there are
    /// not as many.
    #[must_use]
    pub fn reading(self, offsets: Vec<f32>, limits: [f32; 2]) -> Option<Self> {
        (offsets.len() == self.channels).then_some(Self { offsets, input_limits: limits, ..self })
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

    /// What the output's rows `result` need of an input of `rows` x `columns`. There must be such rows.
    #[must_use]
    pub fn band(&self, result: Range<usize>, rows: usize, columns: usize) -> Band {
        let border = self.size / 2;
        let first = (result.start * self.stride).saturating_sub(border);
        let end = (result.end.saturating_sub(1) * self.stride + border + 1).min(rows);
        Band { rows, columns, columns_out: self.outputs(columns), source: first..end, result }
    }

    /// A band, from [`Self::band`]. Channels' first needed rows begin at multiples of `distance` in `input`, their results at
    /// multiples of `distance_out` in `output`. With a stride of 2, every row has its columns 0, 2, ... first, then 1, 3, ...
    /// (see [`sorted`]).
    ///
    /// # Panics
    /// `input` or `output` is too short for all channels.
    pub fn run(
        &mut self,
        input: &[f32],
        distance: usize,
        band: &Band,
        output: &mut [f32],
        distance_out: usize,
    ) {
        let phase = (band.columns + 2 * (self.size / 2)).div_ceil(self.stride) + LONGEST_VECTOR + self.size;
        // Also behind the last row there is a line for the next one to begin.
        let lines = band.result.len() * self.stride + self.size;
        self.scratch.clear();
        self.scratch.resize(phase * self.stride * lines, 0.0);
        let work = Work { layer: self, input, distance, band, phase, output, distance_out };
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
    }
}

/// All channels of one band.
struct Work<'a> {
    layer: &'a mut Depthwise,
    input: &'a [f32],
    distance: usize,
    band: &'a Band,
    /// Numbers from a row's columns 0, stride, ... to its columns 1, stride + 1, ... in the scratch.
    phase: usize,
    output: &'a mut [f32],
    distance_out: usize,
}

/// The work for one size of kernel and one stride. Both are known to the compiler, so that the loops over the kernel vanish.
struct Filter<'a, const SIZE: usize, const STRIDE: usize>(Work<'a>);

impl<const SIZE: usize, const STRIDE: usize> SimdOp for Filter<'_, SIZE, STRIDE> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, isa: I) {
        let Work { layer, input, distance, band, phase, output, distance_out } = self.0;
        let Depthwise { kernel, bias, scratch, offsets, input_limits, limits, .. } = layer;
        let (border, line) = (SIZE / 2, phase * STRIDE);
        // Lines of the scratch that lie above the picture stay zero, and so do those below.
        let above = band.source.start + border - band.result.start * STRIDE;
        let [needed, made] = [band.source.len() * band.columns, band.result.len() * band.columns_out];
        let weights = kernel.chunks_exact(SIZE * SIZE).zip(bias.iter().zip(&*offsets));
        for (channel, (kernel, (bias, offset))) in weights.enumerate() {
            let rows = input[channel * distance..][..needed].chunks_exact(band.columns);
            for (row, padded) in rows.zip(scratch.chunks_exact_mut(line).skip(above)) {
                spread::<STRIDE>(row, padded, border, phase, *offset, *input_limits);
            }
            let result = &mut output[channel * distance_out..][..made];
            filter::<I, SIZE, STRIDE>(isa, scratch, phase, kernel, *bias, *limits, result, band.columns_out);
        }
    }
}

/// A number between limits; one that is none stays none, so that it is found at the network's end.
#[inline(always)]
fn limited(number: f32, [low, high]: [f32; 2]) -> f32 {
    let number = if number < low { low } else { number };
    if number > high { high } else { number }
}

/// Writes a row between its borders.
#[inline(always)]
fn spread<const STRIDE: usize>(
    row: &[f32],
    padded: &mut [f32],
    border: usize,
    phase: usize,
    offset: f32,
    limits: [f32; 2],
) {
    // With a stride of 2, the first column lands in the first half of the line if the border is even.
    let (first, second) = row.split_at(row.len().div_ceil(STRIDE));
    let places =
        [border % STRIDE * phase + border / STRIDE, (border + 1) % STRIDE * phase + border.div_ceil(STRIDE)];
    for (part, place) in [first, second].into_iter().zip(places) {
        for (number, padded) in part.iter().zip(&mut padded[place..place + part.len()]) {
            *padded = limited(number + offset, limits);
        }
    }
}

/// Writes a row's columns 0, 2, ..., then 1, 3, ...
pub fn sorted(row: &[f32], sorted: &mut [f32]) {
    let (even, odd) = sorted.split_at_mut(row.len().div_ceil(2));
    for (number, even) in row.iter().step_by(2).zip(even) {
        *even = *number;
    }
    for (number, odd) in row.iter().skip(1).step_by(2).zip(odd) {
        *odd = *number;
    }
}

/// One channel of a band, from the scratch.
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
    result: &mut [f32],
    columns: usize,
) {
    let ops = isa.f32();
    let mut weights = [[ops.zero(); SIZE]; SIZE];
    for (weights, kernel) in weights.iter_mut().zip(kernel.chunks_exact(SIZE)) {
        for (weight, kernel) in weights.iter_mut().zip(kernel) {
            *weight = ops.splat(*kernel);
        }
    }
    let vectors =
        Vectors { weights, bias: ops.splat(bias), low: ops.splat(limits[0]), high: ops.splat(limits[1]) };
    let line = phase * STRIDE;
    let mut lines = scratch;
    let mut blocks = result.chunks_exact_mut(BLOCK * columns);
    for result in blocks.by_ref() {
        block::<I, SIZE, STRIDE, BLOCK>(isa, lines, phase, &vectors, result, columns);
        lines = &lines[BLOCK * STRIDE * line..];
    }
    for result in blocks.into_remainder().chunks_exact_mut(columns) {
        block::<I, SIZE, STRIDE, 1>(isa, lines, phase, &vectors, result, columns);
        lines = &lines[STRIDE * line..];
    }
}

/// A channel's numbers, each in all places of a vector.
struct Vectors<V, const SIZE: usize> {
    weights: [[V; SIZE]; SIZE],
    bias: V,
    low: V,
    high: V,
}

/// Some neighbouring rows of one channel: what is read from a line serves all of them.
#[inline(always)]
fn block<I: Isa, const SIZE: usize, const STRIDE: usize, const ROWS: usize>(
    isa: I,
    lines: &[f32],
    phase: usize,
    vectors: &Vectors<I::F32, SIZE>,
    result: &mut [f32],
    columns: usize,
) {
    let ops = isa.f32();
    let (line, reach) = (phase * STRIDE, (SIZE - 1) / STRIDE + ops.len());
    for column in (0..columns).step_by(ops.len()) {
        let mut sums = [vectors.bias; ROWS];
        for down in 0..(ROWS - 1) * STRIDE + SIZE {
            let start = down * line + column;
            let phases: [&[f32]; STRIDE] = std::array::from_fn(|odd| &lines[start + odd * phase..][..reach]);
            let values: [I::F32; SIZE] =
                std::array::from_fn(|right| ops.load(&phases[right % STRIDE][right / STRIDE..]));
            for (row, sum) in sums.iter_mut().enumerate() {
                // Is this line under the kernel where it stands for this row?
                let Some(weights) = vectors.weights.get(down.wrapping_sub(row * STRIDE)) else { continue };
                for (value, weight) in values.iter().zip(weights) {
                    *sum = ops.mul_add(*value, *weight, *sum);
                }
            }
        }
        for (row, sum) in sums.into_iter().enumerate() {
            // In this order a sum that is no number stays none.
            let sum = ops.min(vectors.high, ops.max(vectors.low, sum));
            let end = ((row + 1) * columns).min(row * columns + column + ops.len());
            let place = &mut result[row * columns + column..end];
            if place.len() == ops.len() {
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
mod tests;
