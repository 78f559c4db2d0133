//! How sure a share is that was counted.

/// 97.5 % of a normal distribution lies below this many standard deviations: two-sided 95 %.
const QUANTILE: f64 = 1.959_964;

/// Wilson's score interval of the share `hits` of `trials`, 95 % (E. B. Wilson, JASA 22, 1927). Right also where
/// nothing was ever hit; (0, 1) without trials.
#[must_use]
pub fn interval(hits: usize, trials: usize) -> (f64, f64) {
    if trials == 0 {
        return (0.0, 1.0);
    }
    let (count, square) = (trials as f64, QUANTILE * QUANTILE);
    let share = hits as f64 / count;
    let middle = share + square / (2.0 * count);
    let reach = QUANTILE * (share * (1.0 - share) / count + square / (4.0 * count * count)).sqrt();
    let scale = 1.0 + square / count;
    (((middle - reach) / scale).max(0.0), ((middle + reach) / scale).min(1.0))
}

/// Root of the mean square; `None` of nothing.
#[must_use]
pub fn root_mean_square(values: &[f64]) -> Option<f64> {
    let square: f64 = values.iter().map(|value| value * value).sum();
    (!values.is_empty()).then(|| (square / values.len() as f64).sqrt())
}

/// The value that this share of the magnitudes does not exceed; `None` of nothing.
#[must_use]
pub fn magnitude_quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut magnitudes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    magnitudes.sort_by(f64::total_cmp);
    let rank = (share * (magnitudes.len().checked_sub(1)? as f64)).round() as usize;
    magnitudes.get(rank).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values from Newcombe, Statistics in Medicine 17 (1998), table I, method 3.
    #[test]
    fn intervals_are_those_of_the_literature() {
        for (hits, trials, low, high) in [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ] {
            let (found_low, found_high) = interval(hits, trials);
            assert!((found_low - low).abs() < 1e-4 && (found_high - high).abs() < 1e-4, "{hits}/{trials}");
        }
        assert_eq!(interval(0, 0), (0.0, 1.0));
    }

    #[test]
    fn summaries_of_nothing_are_nothing() {
        assert_eq!((root_mean_square(&[]), magnitude_quantile(&[], 0.5)), (None, None));
        assert_eq!(root_mean_square(&[3.0, -4.0]), Some(12.5_f64.sqrt()));
        assert_eq!(magnitude_quantile(&[-5.0, 1.0, 2.0], 0.5), Some(2.0));
    }
}
