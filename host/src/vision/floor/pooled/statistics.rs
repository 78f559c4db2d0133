//! Spread and vertex of a few values.

use super::{PLACES, PLACES_ASIDE};

/// Median of the magnitude of a normal value, in standard deviations.
const MEDIAN_MAGNITUDE: f32 = 0.6745;

/// Standard deviation of normal values from their magnitudes; leaves them in another order.
pub(super) fn deviation(magnitudes: &mut [f32]) -> f32 {
    let middle = magnitudes.len() / 2;
    if middle == 0 {
        return f32::INFINITY;
    }
    let (_, median, _) = magnitudes.select_nth_unstable_by(middle, f32::total_cmp);
    *median / MEDIAN_MAGNITUDE
}

/// Where the highest of some values is, by the parabola through it and its neighbours, counted from the middle.
pub(super) fn vertex(values: &[f32; PLACES]) -> f32 {
    let mut best = PLACES_ASIDE;
    for (index, value) in values.iter().enumerate() {
        if *value > values[best] {
            best = index;
        }
    }
    let offset = best as f32 - PLACES_ASIDE as f32;
    if best == 0 || best + 1 == PLACES {
        return offset;
    }
    let (before, here, after) = (values[best - 1], values[best], values[best + 1]);
    let bend = before - 2.0 * here + after;
    if bend < 0.0 { offset + 0.5 * (before - after) / bend } else { offset }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spread_is_that_of_the_normal_values_whose_magnitudes_they_are() {
        // Magnitudes at the quantiles 1/12, 3/12 ... of a normal distribution with a deviation of two.
        let mut magnitudes = [0.21, 0.64, 1.10, 1.63, 2.30, 3.46];
        assert!((deviation(&mut magnitudes) - 2.0).abs() < 0.5);
        assert_eq!(deviation(&mut [1.0]), f32::INFINITY, "one value has no spread");
    }

    #[test]
    fn the_vertex_is_between_the_places_and_not_beyond_the_outermost() {
        let parabola = |at: f32| std::array::from_fn(|place| -(place as f32 - 2.0 - at).powi(2));
        assert!((vertex(&parabola(0.4)) - 0.4).abs() < 1e-4);
        assert!((vertex(&parabola(-1.0)) + 1.0).abs() < 1e-4);
        assert_eq!(vertex(&parabola(7.0)), 2.0);
    }
}
