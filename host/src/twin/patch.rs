//! A rectangle of one plane of light, and the two ways in which a lens smears it.

use rayon::prelude::*;

use super::view::PixelRectangle;
use crate::simd::{self, Kernel};

/// Columns that the wide fall-off is followed down at a time.
const BLOCK: usize = 128;

/// The values of one plane within a rectangle, row by row.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Where it belongs.
    pub area: PixelRectangle,
    /// One value a pixel.
    pub values: Vec<f32>,
}

/// A Gaussian's weights from its centre outwards; they sum to 1 over both sides.
#[must_use]
pub fn gaussian(deviation: f64) -> Vec<f32> {
    if deviation < 0.05 {
        return vec![1.0];
    }
    let reach = (3.0 * deviation).ceil() as i32;
    let weight = |i: i32| (-0.5 * (f64::from(i) / deviation).powi(2)).exp();
    let total: f64 = (-reach..=reach).map(weight).sum();
    (0..=reach).map(|i| (weight(i) / total) as f32).collect()
}

impl Patch {
    /// All dark.
    #[must_use]
    pub fn dark(area: PixelRectangle) -> Self {
        Self { area, values: vec![0.0; (area.right - area.left) * (area.bottom - area.top)] }
    }

    /// A rectangle of it, which must lie within it.
    #[must_use]
    pub fn part(&self, area: PixelRectangle) -> Self {
        let mut part =
            Self { area, values: Vec::with_capacity((area.right - area.left) * (area.bottom - area.top)) };
        for row in area.top..area.bottom {
            let start = (row - self.area.top) * self.width() + area.left - self.area.left;
            part.values.extend_from_slice(&self.values[start..start + area.right - area.left]);
        }
        part
    }

    /// Takes over the values of another patch, which must lie within this one.
    pub fn put(&mut self, other: &Self) {
        let (width, left) = (self.width(), other.area.left - self.area.left);
        for (line, row) in other.values.chunks_exact(other.width()).zip(other.area.top - self.area.top..) {
            let start = row * width + left;
            self.values[start..start + line.len()].copy_from_slice(line);
        }
    }

    /// Columns.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.area.right - self.area.left
    }

    /// Smears it with a symmetric kernel ([`gaussian`]); beyond its edges the edge's value goes on. Rows without any light
    /// near cost nothing.
    pub fn blur(&mut self, kernel: &[f32]) {
        if kernel.len() < 2 || self.values.is_empty() {
            return;
        }
        let width = self.width();
        let lit = self.lit_rows();
        let mut across = vec![0.0_f32; self.values.len()];
        let lines = across.par_chunks_mut(width).zip(self.values.par_chunks(width)).zip(&lit);
        lines.filter(|(_, lit)| **lit).for_each(|((to, from), _)| simd::run(Line { from, to, kernel }));
        let (reach, last) = (kernel.len() - 1, lit.len() - 1);
        self.values.par_chunks_mut(width).enumerate().for_each(|(row, to)| {
            let near = row.saturating_sub(reach)..=(row + reach).min(last);
            if !lit[near].contains(&true) {
                return;
            }
            to.fill(0.0);
            let mut add = |row: usize, weight: f32| {
                if lit[row] {
                    simd::run(Add { to, from: &across[row * width..(row + 1) * width], weight });
                }
            };
            add(row, kernel[0]);
            for (offset, weight) in kernel.iter().enumerate().skip(1) {
                add(row.saturating_sub(offset), *weight);
                add((row + offset).min(last), *weight);
            }
        });
    }

    /// Spreads it widely: an exponential fall-off of `reach` pixels in all four directions (forward and backward
    /// recursive filters, so the cost does not depend on the reach).
    pub fn spread(&mut self, reach: f64) {
        let width = self.width();
        if self.values.is_empty() {
            return;
        }
        let keep = (-1.0 / reach.max(0.1)).exp() as f32;
        let lit = self.lit_rows();
        let lines = self.values.par_chunks_mut(width).zip(&lit);
        lines.filter(|(_, lit)| **lit).for_each(|(line, _)| {
            follow(line.iter_mut(), keep);
            follow(line.iter_mut().rev(), keep);
        });
        self.spread_down(keep, &lit);
    }

    /// The vertical half of [`Self::spread`], a few columns at a time: all of their rows fit into a processor's cache.
    fn spread_down(&mut self, keep: f32, lit: &[bool]) {
        let (width, rows) = (self.width(), lit.len());
        let mut blocks = vec![0.0_f32; width.div_ceil(BLOCK) * rows * BLOCK];
        let values = &self.values;
        blocks.par_chunks_mut(rows * BLOCK).enumerate().for_each(|(index, block)| {
            let columns = index * BLOCK..((index + 1) * BLOCK).min(width);
            let lines = block.chunks_exact_mut(BLOCK).enumerate().filter(|(row, _)| lit[*row]);
            for (row, line) in lines {
                let start = row * width;
                let from = &values[start + columns.start..start + columns.end];
                line[..from.len()].copy_from_slice(from);
            }
            simd::run(Down { block, keep });
        });
        self.values.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
            for (index, to) in line.chunks_mut(BLOCK).enumerate() {
                let start = (index * rows + row) * BLOCK;
                to.copy_from_slice(&blocks[start..start + to.len()]);
            }
        });
    }

    /// Rows that are not all dark.
    fn lit_rows(&self) -> Vec<bool> {
        self.values.par_chunks(self.width()).map(|row| row.iter().any(|value| *value != 0.0)).collect()
    }
}

/// One pass of the recursive filter.
fn follow<'a>(values: impl Iterator<Item = &'a mut f32>, keep: f32) {
    let mut carried = 0.0;
    for value in values {
        carried = keep * carried + (1.0 - keep) * *value;
        *value = carried;
    }
}

/// The recursive filter down and up a block of [`BLOCK`] columns.
struct Down<'a> {
    block: &'a mut [f32],
    keep: f32,
}

impl Kernel for Down<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { block, keep } = self;
        let step = |carried: &mut [f32; BLOCK], line: &mut [f32]| {
            for (value, memory) in line.iter_mut().zip(carried) {
                *memory = keep * *memory + (1.0 - keep) * *value;
                *value = *memory;
            }
        };
        let mut carried = [0.0; BLOCK];
        block.chunks_exact_mut(BLOCK).for_each(|line| step(&mut carried, line));
        carried = [0.0; BLOCK];
        block.chunks_exact_mut(BLOCK).rev().for_each(|line| step(&mut carried, line));
    }
}

/// A row added to another.
struct Add<'a> {
    to: &'a mut [f32],
    from: &'a [f32],
    weight: f32,
}

impl Kernel for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        add_into(self.to, self.from, self.weight);
    }
}

/// The kernel along one row.
struct Line<'a> {
    from: &'a [f32],
    to: &'a mut [f32],
    kernel: &'a [f32],
}

impl Kernel for Line<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { from, to, kernel } = self;
        let reach = kernel.len() - 1;
        let last = from.len() - 1;
        let slow = |x: usize| {
            let mut sum = kernel[0] * from[x];
            for (offset, weight) in kernel.iter().enumerate().skip(1) {
                sum += weight * (from[x.saturating_sub(offset)] + from[(x + offset).min(last)]);
            }
            sum
        };
        if from.len() <= 2 * reach {
            to.iter_mut().enumerate().for_each(|(x, value)| *value = slow(x));
            return;
        }
        for x in (0..reach).chain(from.len() - reach..from.len()) {
            to[x] = slow(x);
        }
        let inner = reach..from.len() - reach;
        to[inner.clone()].fill(0.0);
        add_into(&mut to[inner.clone()], &from[inner.clone()], kernel[0]);
        for (offset, weight) in kernel.iter().enumerate().skip(1) {
            add_into(&mut to[inner.clone()], &from[reach - offset..from.len() - reach - offset], *weight);
            add_into(&mut to[inner.clone()], &from[reach + offset..from.len() - reach + offset], *weight);
        }
    }
}

#[inline(always)]
fn add_into(to: &mut [f32], from: &[f32], weight: f32) {
    to.iter_mut().zip(from).for_each(|(value, other)| *value += weight * other);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_a_point(width: usize, height: usize) -> Patch {
        let mut patch = Patch::dark(PixelRectangle { left: 0, top: 0, right: width, bottom: height });
        patch.values[(height / 2) * width + width / 2] = 1.0;
        patch
    }

    #[test]
    fn blurring_and_spreading_keep_the_light_and_the_centre() {
        let (width, height) = (61, 41);
        let mut blurred = with_a_point(width, height);
        blurred.blur(&gaussian(1.2));
        let mut spread = with_a_point(width, height);
        spread.spread(2.0);
        for patch in [blurred, spread] {
            let total: f32 = patch.values.iter().sum();
            let weighted = |f: &dyn Fn(usize) -> usize| -> f32 {
                patch.values.iter().enumerate().map(|(i, v)| v * f(i) as f32).sum::<f32>() / total
            };
            assert!((total - 1.0).abs() < 1e-3, "{total}");
            assert!((weighted(&|i| i % width) - 30.0).abs() < 1e-2);
            assert!((weighted(&|i| i / width) - 20.0).abs() < 1e-2);
        }
    }

    #[test]
    fn the_blur_has_the_stated_deviation() {
        let mut patch = with_a_point(61, 41);
        patch.blur(&gaussian(1.2));
        let variance: f32 =
            patch.values.iter().enumerate().map(|(i, v)| v * ((i % 61) as f32 - 30.0).powi(2)).sum();
        assert!((variance.sqrt() - 1.2).abs() < 0.03, "{}", variance.sqrt());
    }

    #[test]
    fn an_even_patch_stays_even_up_to_its_edges_and_tiny_ones_work() {
        for (width, height) in [(20, 9), (2, 2), (1, 1)] {
            let mut patch =
                Patch::dark(PixelRectangle { left: 3, top: 4, right: 3 + width, bottom: 4 + height });
            patch.values.fill(0.7);
            patch.blur(&gaussian(1.0));
            assert!(patch.values.iter().all(|value| (value - 0.7).abs() < 1e-5));
        }
    }
}
