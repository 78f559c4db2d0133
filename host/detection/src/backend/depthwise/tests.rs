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
                            let value = (value + 0.25).clamp(-0.9, 0.8);
                            sum +=
                                f64::from(value) * f64::from(kernel[(channel * size + down) * size + right]);
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

fn all_sorted(input: &[f32], columns: usize) -> Vec<f32> {
    let mut all = vec![0.0; input.len()];
    for (row, target) in input.chunks_exact(columns).zip(all.chunks_exact_mut(columns)) {
        sorted(row, target);
    }
    all
}

proptest! {
    #[test]
    fn it_is_the_convolution_by_its_definition(
        channels in 1_usize..4,
        rows in 1_usize..40,
        columns in 1_usize..40,
        half in 0_usize..4,
        stride in 1_usize..3,
        cut in 0.0_f64..1.0,
        seed in any::<u64>(),
    ) {
        let size = 2 * half + 1;
        let input = numbers(channels * rows * columns, seed);
        let (kernel, bias) = (numbers(channels * size * size, seed ^ 1), numbers(channels, seed ^ 2));
        let expected = by_definition(&input, [channels, rows, columns], &kernel, &bias, size, stride);
        let layer = Depthwise::new(kernel, bias, stride, [-0.5, 0.75]).unwrap();
        let mut layer = layer.reading(vec![0.25; channels], [-0.9, 0.8]).unwrap();
        let input = if stride == 1 { input } else { all_sorted(&input, columns) };
        // In two bands, behind each other in every channel; between the channels there is room that must stay.
        let (rows_out, columns_out) = (layer.outputs(rows), layer.outputs(columns));
        let plane = rows_out * columns_out;
        let mut output = vec![9.0; channels * (plane + 1)];
        let cut = (cut * rows_out as f64) as usize;
        for result in [0..cut, cut..rows_out].into_iter().filter(|result| !result.is_empty()) {
            let band = layer.band(result.clone(), rows, columns);
            let source = &input[band.source.start * columns..];
            layer.run(source, rows * columns, &band, &mut output[result.start * columns_out..], plane + 1);
        }
        for (found, exact) in output.chunks_exact(plane + 1).zip(expected.chunks_exact(plane)) {
            prop_assert_eq!(found[plane], 9.0, "between the channels");
            for (found, exact) in found.iter().zip(exact) {
                prop_assert!((found - exact.clamp(-0.5, 0.75)).abs() < 1e-4, "{} instead of {}", found, exact);
            }
        }
    }
}

#[test]
fn a_number_that_is_none_is_not_lost_between_limits() {
    for (stride, place) in [(1, 0), (1, 24), (2, 0), (2, 13)] {
        let mut layer = Depthwise::new(vec![1.0; 9], vec![0.0], stride, [0.0, 6.0]).unwrap();
        let mut input = [1.0; 25];
        input[place] = f32::NAN;
        let input = if stride == 1 { input.to_vec() } else { all_sorted(&input, 5) };
        let band = layer.band(0..layer.outputs(5), 5, 5);
        let mut output = vec![0.0; band.result.len() * band.columns_out];
        let distance_out = output.len();
        layer.run(&input, 25, &band, &mut output, distance_out);
        assert!(output.iter().any(|number| number.is_nan()), "stride {stride}, place {place}: {output:?}");
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    const LIMITS: [f32; 2] = [0.0, 6.0];
    assert!(Depthwise::new(vec![0.0; 18], vec![0.0; 2], 1, LIMITS).is_some());
    assert!(Depthwise::new(vec![0.0; 17], vec![0.0; 2], 1, LIMITS).is_none(), "no whole kernels");
    assert!(Depthwise::new(vec![0.0; 8], vec![0.0; 2], 1, LIMITS).is_none(), "an even kernel has no middle");
    assert!(Depthwise::new(vec![0.0; 81], vec![0.0; 1], 1, LIMITS).is_none(), "larger than any in use");
    assert!(Depthwise::new(vec![], vec![], 1, LIMITS).is_none());
    assert!(Depthwise::new(vec![0.0; 18], vec![0.0; 2], 3, LIMITS).is_none());
}
