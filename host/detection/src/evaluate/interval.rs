//! How sure a share is: intervals that hold the true share with 95 % confidence.

use serde::Serialize;

/// Normal quantile for 95 %, two-sided.
const Z: f64 = 1.959_963_984_540_054;
/// What is left outside on either side.
const TAIL: f64 = 0.025;

/// So many of so many, with its intervals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Share {
    /// Successes.
    pub hits: usize,
    /// Tries.
    pub of: usize,
    /// hits / of; none without tries.
    pub share: Option<f64>,
    /// Clopper and Pearson's exact interval, 95 %: never too narrow.
    pub clopper_pearson: (f64, f64),
    /// Wilson's interval, 95 %: nearer to the nominal coverage.
    pub wilson: (f64, f64),
}

impl Share {
    /// Without tries everything is possible: 0 to 1.
    #[must_use]
    pub fn new(hits: usize, of: usize) -> Self {
        let hits = hits.min(of);
        let share = (of > 0).then(|| hits as f64 / of as f64);
        Self { hits, of, share, clopper_pearson: clopper_pearson(hits, of), wilson: wilson(hits, of) }
    }
}

impl std::fmt::Display for Share {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.share {
            None => write!(formatter, "none to find"),
            Some(share) => {
                let (low, high) = self.clopper_pearson;
                write!(formatter, "{share:.3} ({}/{}, 95 %: {low:.3} to {high:.3})", self.hits, self.of)
            }
        }
    }
}

/// Source: Wilson, "Probable inference", JASA 1927.
fn wilson(hits: usize, of: usize) -> (f64, f64) {
    if of == 0 {
        return (0.0, 1.0);
    }
    let (count, share) = (of as f64, hits as f64 / of as f64);
    let denominator = 1.0 + Z * Z / count;
    let centre = (share + Z * Z / (2.0 * count)) / denominator;
    let half = Z / denominator * (share * (1.0 - share) / count + Z * Z / (4.0 * count * count)).sqrt();
    ((centre - half).max(0.0), (centre + half).min(1.0))
}

/// Source: Clopper and Pearson, Biometrika 1934. The bounds are the shares at which as few, or as many, hits would be
/// just 2.5 % likely; they are found by bisection.
fn clopper_pearson(hits: usize, of: usize) -> (f64, f64) {
    // Probability of at least `hits` rises with the share, of at most `hits` falls.
    let low = if hits == 0 { 0.0 } else { bisect(|share| 1.0 - at_most(hits - 1, of, share) < TAIL) };
    let high = if hits == of { 1.0 } else { bisect(|share| at_most(hits, of, share) > TAIL) };
    (low, high)
}

/// The largest share for which the condition still holds; it holds at 0 and fails at 1.
fn bisect(holds: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if holds(middle) { low = middle } else { high = middle }
    }
    low
}

/// Probability of at most `hits` successes in `of` tries. Summed from logarithms: exact enough for any number of tries.
fn at_most(hits: usize, of: usize, share: f64) -> f64 {
    if share <= 0.0 {
        return 1.0;
    }
    if share >= 1.0 {
        return if hits >= of { 1.0 } else { 0.0 };
    }
    let (log_hit, log_miss) = (share.ln(), (1.0 - share).ln());
    let mut log_term = of as f64 * log_miss;
    let mut sum = log_term.exp();
    for count in 1..=hits {
        log_term += ((of - count + 1) as f64 / count as f64).ln() + log_hit - log_miss;
        sum += log_term.exp();
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(got: (f64, f64), wanted: (f64, f64)) {
        assert!(
            (got.0 - wanted.0).abs() < 1e-6 && (got.1 - wanted.1).abs() < 1e-6,
            "{got:?}, not {wanted:?}"
        );
    }

    /// Reference values: scipy.stats.binomtest(k, n).proportion_ci("exact" and "wilson").
    #[test]
    fn intervals_are_those_of_the_tables() {
        near(Share::new(8, 10).clopper_pearson, (0.443_904_5, 0.974_789_3));
        near(Share::new(8, 10).wilson, (0.490_162_4, 0.943_317_8));
        near(Share::new(0, 20).clopper_pearson, (0.0, 0.168_433_5));
        near(Share::new(20, 20).clopper_pearson, (0.831_566_5, 1.0));
        near(Share::new(0, 20).wilson, (0.0, 0.161_125_2));
    }

    #[test]
    fn without_tries_everything_is_possible() {
        let nothing = Share::new(0, 0);
        assert_eq!((nothing.share, nothing.clopper_pearson, nothing.wilson), (None, (0.0, 1.0), (0.0, 1.0)));
    }

    #[test]
    fn the_share_lies_inside_and_more_tries_narrow() {
        for (hits, of) in [(0, 3), (1, 3), (3, 3), (990, 1000), (99_000, 100_000)] {
            let share = Share::new(hits, of);
            for (low, high) in [share.clopper_pearson, share.wilson] {
                let middle = share.share.unwrap();
                assert!(low <= middle + 1e-12 && middle <= high + 1e-12, "{share}");
            }
        }
        let width = |share: Share| share.clopper_pearson.1 - share.clopper_pearson.0;
        assert!(width(Share::new(990, 1000)) < width(Share::new(99, 100)));
    }
}
