use proptest::prelude::*;

use super::*;

/// Limits of what is wide and of what was filtered; numbers of the tests reach beyond both.
const WIDE_LIMITS: [f32; 2] = [0.0, 1.5];
const LIMITS: [f32; 2] = [-0.5, 1.0];

/// Numbers from -1 to 1.
fn numbers(count: usize, seed: u64) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 24) as f32 * 2.0 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// Three layers' weights.
#[derive(Debug, Clone)]
struct Weights {
    inputs: usize,
    wide: usize,
    size: usize,
    stride: usize,
    expand: Option<[Vec<f32>; 2]>,
    filter: [Vec<f32>; 2],
    project: Option<[Vec<f32>; 2]>,
    shortcut: bool,
}

impl Weights {
    fn random(
        [inputs, wide, outputs]: [usize; 3],
        size: usize,
        stride: usize,
        parts: [bool; 3],
        seed: u64,
    ) -> Self {
        let [expands, projects, shortcut] = parts;
        let inputs = if expands { inputs } else { wide };
        let shortcut = shortcut && projects && stride == 1;
        let outputs = if shortcut { inputs } else { outputs };
        let layer = |kernel, bias, seed| [numbers(kernel, seed), numbers(bias, seed ^ 77)];
        Self {
            inputs,
            wide,
            size,
            stride,
            expand: expands.then(|| layer(wide * inputs, wide, seed ^ 1)),
            filter: layer(wide * size * size, wide, seed ^ 2),
            project: projects.then(|| layer(outputs * wide, outputs, seed ^ 3)),
            shortcut,
        }
    }

    fn bottleneck(&self) -> Option<Bottleneck> {
        let pointwise = |[kernel, bias]: &[Vec<f32>; 2]| Pointwise::new(kernel, bias.clone()).unwrap();
        let [kernel, bias] = self.filter.clone();
        let filter = Depthwise::new(kernel, bias, self.stride, LIMITS).unwrap();
        let expand = self.expand.as_ref().map(|layer| (pointwise(layer), WIDE_LIMITS));
        Bottleneck::new(expand, filter, self.project.as_ref().map(pointwise), self.shortcut)
    }

    /// One layer after the other, number by number.
    fn by_definition(&self, input: &[f32], rows: usize, columns: usize) -> Vec<f64> {
        let exact: Vec<f64> = input.iter().copied().map(f64::from).collect();
        let wide = match &self.expand {
            None => exact.clone(),
            Some(layer) => pointwise(layer, &exact, rows * columns, Some(WIDE_LIMITS)),
        };
        let filtered = self.filtered(&wide, rows as isize, columns as isize);
        let pixels = filtered.len() / self.wide;
        let mut narrow = match &self.project {
            None => filtered,
            Some(layer) => pointwise(layer, &filtered, pixels, None),
        };
        if self.shortcut {
            narrow.iter_mut().zip(&exact).for_each(|(number, added)| *number += added);
        }
        narrow
    }

    fn filtered(&self, wide: &[f64], rows: isize, columns: isize) -> Vec<f64> {
        let border = (self.size / 2) as isize;
        let mut output = Vec::new();
        for channel in 0..self.wide {
            for row in (0..rows).step_by(self.stride) {
                for column in (0..columns).step_by(self.stride) {
                    let mut sum = f64::from(self.filter[1][channel]);
                    for tap in 0..self.size * self.size {
                        let v = row + (tap / self.size) as isize - border;
                        let u = column + (tap % self.size) as isize - border;
                        if (0..rows).contains(&v) && (0..columns).contains(&u) {
                            let place = (channel as isize * rows + v) * columns + u;
                            let weight = self.filter[0][channel * self.size * self.size + tap];
                            sum += wide[place as usize] * f64::from(weight);
                        }
                    }
                    output.push(sum.clamp(LIMITS[0].into(), LIMITS[1].into()));
                }
            }
        }
        output
    }
}

fn pointwise(
    [kernel, bias]: &[Vec<f32>; 2],
    input: &[f64],
    pixels: usize,
    limits: Option<[f32; 2]>,
) -> Vec<f64> {
    let mut output = Vec::new();
    for (weights, bias) in kernel.chunks_exact(kernel.len() / bias.len()).zip(bias) {
        for pixel in 0..pixels {
            let products =
                weights.iter().zip(input.chunks_exact(pixels)).map(|(w, x)| f64::from(*w) * x[pixel]);
            let sum = f64::from(*bias) + products.sum::<f64>();
            output.push(limits.map_or(sum, |[low, high]| sum.clamp(low.into(), high.into())));
        }
    }
    output
}

proptest! {
    /// The rule: in bands of whatever height, for pictures apart or together, with any of its parts left out, a block is its layers
    /// one after the other.
    #[test]
    fn it_is_its_layers_one_after_the_other(
        channels in (1_usize..7, 1_usize..15, 1_usize..7),
        pictures in 1_usize..5,
        rows in 1_usize..30,
        columns in 1_usize..30,
        half in 0_usize..4,
        stride in 1_usize..3,
        parts in any::<[bool; 3]>(),
        wide_numbers in 1_usize..4000,
        seed in any::<u64>(),
    ) {
        let (inputs, wide, outputs) = channels;
        let weights = Weights::random([inputs, wide, outputs], 2 * half + 1, stride, parts, seed);
        let mut block = weights.bottleneck().unwrap();
        block.wide_numbers = wide_numbers;
        // Twice: what the first picture left in the buffers must not be seen in the second.
        for seed in [seed ^ 5, seed ^ 6] {
            let [pixels, channels] = [rows * columns, weights.inputs];
            let input = numbers(channels * pictures * pixels, seed);
            let mut output = vec![9.0; 3];
            block.run(&input, [pictures, rows, columns], &mut output).unwrap();
            let [rows_out, columns_out] = block.shape(rows, columns);
            let made = rows_out * columns_out;
            prop_assert_eq!(output.len(), block.outputs() * pictures * made);
            for picture in 0..pictures {
                let own = |channel: usize| &input[(channel * pictures + picture) * pixels..][..pixels];
                let alone: Vec<f32> = (0..channels).flat_map(own).copied().collect();
                let expected = weights.by_definition(&alone, rows, columns);
                for (channel, expected) in expected.chunks_exact(made).enumerate() {
                    let found = &output[(channel * pictures + picture) * made..][..made];
                    for (found, exact) in found.iter().zip(expected) {
                        prop_assert!((f64::from(*found) - exact).abs() < 1e-4, "{} instead of {}", found, exact);
                    }
                }
            }
        }
    }
}

#[test]
fn layers_that_do_not_fit_are_refused() {
    let good = Weights::random([3, 6, 3], 3, 1, [true, true, true], 1);
    assert!(good.shortcut && good.bottleneck().is_some());
    let layer = |kernel: usize, bias: usize| Some([vec![0.0; kernel], vec![0.0; bias]]);
    assert!(
        Weights { expand: layer(15, 5), ..good.clone() }.bottleneck().is_none(),
        "five channels into six"
    );
    assert!(
        Weights { project: layer(15, 3), ..good.clone() }.bottleneck().is_none(),
        "six channels into five"
    );
    assert!(Weights { project: layer(24, 4), ..good.clone() }.bottleneck().is_none(), "three added to four");
    assert!(
        Weights { stride: 2, ..good.clone() }.bottleneck().is_none(),
        "a picture added to one of half its size"
    );
    assert!(
        Weights { project: None, ..good.clone() }.bottleneck().is_none(),
        "added where nothing is narrowed"
    );
    assert!(Pointwise::new(&[0.0; 5], vec![0.0; 2]).is_none(), "no whole kernels");
    assert!(Pointwise::new(&[], vec![]).is_none());
    assert!(Pointwise::new(&[], vec![0.0; 2]).is_none());
    let mut block = good.bottleneck().unwrap();
    assert!(block.run(&[0.0; 3 * 20 + 1], [1, 4, 5], &mut Vec::new()).is_err());
    assert!(block.run(&[], [1, 0, 5], &mut Vec::new()).is_err());
    assert!(block.run(&[], [0, 4, 5], &mut Vec::new()).is_err());
}
