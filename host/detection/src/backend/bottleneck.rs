//! Inverted bottlenecks: features made wide, filtered channel by channel, and made narrow again.
//!
//! Wide features are megabytes. Computed one layer after the other they travel to memory and back between any two of them, and
//! that takes longer than the arithmetic. Here a band of rows goes through all three layers while it is in the core's cache;
//! only narrow features are kept. Matrices are multiplied by `rten-gemm`, as in rten itself.

use std::ops::Range;

use rten_gemm::{GemmExecutor, GemmInputA, GemmInputB, GemmOptions, PackedAMatrix};
use rten_tensor::NdTensorView;
use rten_tensor::prelude::*;

use super::depthwise::{BLOCK, Band, Depthwise, sorted};

/// Numbers of wide features in a band, about: a megabyte, half of the second-level cache of a current processor.
const WIDE_NUMBERS: usize = 1 << 18;

/// A convolution of single pixels: every channel of the output is a sum over all channels of the input.
pub struct Pointwise {
    kernel: PackedAMatrix<f32>,
    bias: Vec<f32>,
    inputs: usize,
}

impl Pointwise {
    /// `kernel` is (outputs, inputs), `bias` (outputs). `None` if they do not fit each other.
    #[must_use]
    pub fn new(kernel: &[f32], bias: Vec<f32>) -> Option<Self> {
        let inputs = kernel.len().checked_div(bias.len())?;
        let matrix = NdTensorView::try_from_data([bias.len(), inputs], kernel).ok()?;
        if inputs == 0 {
            return None;
        }
        Some(Self { kernel: GemmExecutor::new().prepack_a(matrix), bias, inputs })
    }

    /// From `input` (channels, pixels) to `output` (channels, pixels without gaps), without the bias: who reads it adds that.
    fn run(&self, input: NdTensorView<'_, f32, 2>, output: &mut Vec<f32>) -> Result<(), String> {
        output.resize(self.bias.len() * input.size(1), 0.0);
        let (kernel, input) = (GemmInputA::Packed(&self.kernel), GemmInputB::Unpacked(input));
        // An executor cannot be sent to another thread, and costs nothing.
        let executor = GemmExecutor::new();
        executor.gemm(output, kernel, input, GemmOptions::default()).map_err(|error| error.to_string())
    }
}

/// Widening, filter and narrowing with their weights; without the first and the last it is a filter alone.
pub struct Bottleneck {
    expand: Option<Pointwise>,
    filter: Depthwise,
    project: Option<Pointwise>,
    /// Is the input added to the output? Only with a narrowing.
    shortcut: bool,
    /// Numbers of wide features in a band, about.
    wide_numbers: usize,
    /// The band's input with its columns sorted for a stride of 2.
    sorted: Vec<f32>,
    wide: Vec<f32>,
    filtered: Vec<f32>,
    narrow: Vec<f32>,
}

impl Bottleneck {
    /// What is wide is brought between `wide_limits` if there is an `expand`. `None` if the layers' channels do not fit each
    /// other.
    #[must_use]
    pub fn new(
        expand: Option<(Pointwise, [f32; 2])>,
        filter: Depthwise,
        project: Option<Pointwise>,
        shortcut: bool,
    ) -> Option<Self> {
        if project.as_ref().is_some_and(|layer| layer.inputs != filter.channels()) {
            return None;
        }
        let (expand, filter) = match expand {
            None => (None, filter),
            Some((layer, limits)) => {
                let filter = filter.reading(layer.bias.clone(), limits)?;
                (Some(layer), filter)
            }
        };
        let [sorted, wide, filtered, narrow] = [const { Vec::new() }; 4];
        let wide_numbers = WIDE_NUMBERS;
        let whole = Self { expand, filter, project, shortcut, wide_numbers, sorted, wide, filtered, narrow };
        // What is added must have the output's shape, and is added where features are made narrow.
        let same = whole.inputs() == whole.outputs() && whole.filter.outputs(2) == 2;
        (!shortcut || (same && whole.project.is_some())).then_some(whole)
    }

    /// Channels of the input.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.expand.as_ref().map_or(self.filter.channels(), |layer| layer.inputs)
    }

    /// Channels of the output.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.project.as_ref().map_or(self.filter.channels(), |layer| layer.bias.len())
    }

    /// Rows and columns of the output for those of the input.
    #[must_use]
    pub fn shape(&self, rows: usize, columns: usize) -> [usize; 2] {
        [self.filter.outputs(rows), self.filter.outputs(columns)]
    }

    /// From `input` (channels, pictures, rows, columns) to `output` (channels, pictures, rows and columns by [`Self::shape`]), whose
    /// former content is lost.
    ///
    /// # Errors
    /// `input` has another size.
    pub fn run(
        &mut self,
        input: &[f32],
        [pictures, rows, columns]: [usize; 3],
        output: &mut Vec<f32>,
    ) -> Result<(), String> {
        let numbers = self.inputs() * pictures * rows * columns;
        if numbers == 0 || input.len() != numbers {
            let inputs = self.inputs();
            let shape = format!("{inputs} channels of {pictures} times {rows} x {columns}");
            return Err(format!("{} numbers are not {shape}", input.len()));
        }
        let [rows_out, columns_out] = self.shape(rows, columns);
        output.resize(self.outputs() * pictures * rows_out * columns_out, 0.0);
        // Large pictures are cut into bands; of small ones several make a band, so that the weights are fetched less often.
        let of_one_picture = self.filter.channels() * columns * rows;
        let bands = of_one_picture.div_ceil(self.wide_numbers);
        let height = rows_out.div_ceil(bands).next_multiple_of(BLOCK);
        let together = (self.wide_numbers / of_one_picture).max(1);
        for first_picture in (0..pictures).step_by(together) {
            let some = first_picture..pictures.min(first_picture + together);
            for first in (0..rows_out).step_by(height) {
                let band = self.filter.band(first..rows_out.min(first + height), rows, columns);
                self.band(input, pictures, some.clone(), band, output)?;
            }
        }
        Ok(())
    }

    /// Some rows of the output of one picture, or all rows of some pictures of `pictures`.
    fn band(
        &mut self,
        input: &[f32],
        pictures: usize,
        some: Range<usize>,
        band: Band,
        output: &mut [f32],
    ) -> Result<(), String> {
        let picture = band.rows * band.columns;
        let plane = pictures * picture;
        let plane_out = output.len() / self.outputs();
        let [needed, made] = [band.source.len() * band.columns, band.result.len() * band.columns_out];
        let first = some.start * picture + band.source.start * band.columns;
        let pixels = first..first + (some.len() - 1) * picture + needed;
        let first_out = some.start * (plane_out / pictures) + band.result.start * band.columns_out;
        let out = first_out..first_out + some.len() * made;
        let mut source = (&input[pixels.start..], plane);
        if self.filter.outputs(2) == 1 {
            self.sort(input, plane, pixels.clone(), band.columns);
            source = (&self.sorted[..], pixels.len());
        }
        if let Some(layer) = &self.expand {
            let (numbers, distance) = source;
            let view =
                NdTensorView::from_slice_with_strides([layer.inputs, pixels.len()], numbers, [distance, 1]);
            layer.run(view.map_err(|error| error.to_string())?, &mut self.wide)?;
            source = (&self.wide[..], pixels.len());
        }
        let (numbers, distance) = source;
        let Some(project) = &self.project else {
            for index in 0..some.len() {
                let target = &mut output[out.start + index * made..];
                self.filter.run(&numbers[index * picture..], distance, &band, target, plane_out);
            }
            return Ok(());
        };
        self.filtered.resize(self.filter.channels() * out.len(), 0.0);
        for index in 0..some.len() {
            let target = &mut self.filtered[index * made..];
            self.filter.run(&numbers[index * picture..], distance, &band, target, out.len());
        }
        let filtered = NdTensorView::from_data([self.filter.channels(), out.len()], &self.filtered[..]);
        project.run(filtered, &mut self.narrow)?;
        for (channel, (numbers, bias)) in self.narrow.chunks_exact(out.len()).zip(&project.bias).enumerate() {
            let target = output[channel * plane_out..][out.clone()].iter_mut().zip(numbers);
            if self.shortcut {
                let added = &input[channel * plane_out..][out.clone()];
                target.zip(added).for_each(|((target, number), added)| *target = number + bias + added);
            } else {
                target.for_each(|(target, number)| *target = number + bias);
            }
        }
        Ok(())
    }

    /// Sorts the columns of a band's input: there are fewer of these numbers than of wide ones.
    fn sort(&mut self, input: &[f32], plane: usize, pixels: Range<usize>, columns: usize) {
        self.sorted.resize(self.inputs() * pixels.len(), 0.0);
        let channels = input.chunks_exact(plane).zip(self.sorted.chunks_exact_mut(pixels.len()));
        for (numbers, target) in channels {
            let rows = numbers[pixels.clone()].chunks_exact(columns);
            for (row, target) in rows.zip(target.chunks_exact_mut(columns)) {
                sorted(row, target);
            }
        }
    }
}

#[cfg(test)]
mod tests;
