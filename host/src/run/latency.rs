//! How long something takes, counted into fixed buckets: no allocation while running.

use std::time::Duration;

/// Buckets a decade; neighbours differ by 2 %.
const PER_DECADE: f64 = 116.0;
/// From one microsecond to a hundred seconds.
const BUCKETS: usize = 8 * 116 + 1;

/// A histogram of durations with 2 % resolution, 1 microsecond to 100 seconds.
#[derive(Debug, Clone)]
pub struct Latency {
    counts: Box<[u64; BUCKETS]>,
    count: u64,
    longest: Duration,
}

impl Latency {
    /// Nothing counted yet.
    #[must_use]
    pub fn new() -> Self {
        Self { counts: Box::new([0; BUCKETS]), count: 0, longest: Duration::ZERO }
    }

    /// Counts one.
    pub fn add(&mut self, taken: Duration) {
        let micros = taken.as_secs_f64() * 1e6;
        let bucket = (micros.max(1.0).log10() * PER_DECADE) as usize;
        self.counts[bucket.min(BUCKETS - 1)] += 1;
        self.count += 1;
        self.longest = self.longest.max(taken);
    }

    /// How many were counted.
    #[must_use]
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The longest.
    #[must_use]
    pub const fn longest(&self) -> Duration {
        self.longest
    }

    /// The duration that a share (0 to 1) of all keep, to 2 %, never under-reported; zero if nothing was counted.
    #[must_use]
    pub fn quantile(&self, share: f64) -> Duration {
        let wanted = (share.clamp(0.0, 1.0) * self.count as f64).ceil() as u64;
        let mut sum = 0;
        for (bucket, count) in self.counts.iter().enumerate() {
            sum += count;
            if sum >= wanted.max(1) {
                let upper = 10_f64.powf((bucket + 1) as f64 / PER_DECADE) * 1e-6;
                return Duration::from_secs_f64(upper).min(self.longest);
            }
        }
        Duration::ZERO
    }

    /// p50, p99, p99.9 and the longest, milliseconds.
    #[must_use]
    pub fn summary_ms(&self) -> [f64; 4] {
        [self.quantile(0.5), self.quantile(0.99), self.quantile(0.999), self.longest]
            .map(|duration| duration.as_secs_f64() * 1e3)
    }
}

impl Default for Latency {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_within_two_percent_and_never_too_short() {
        let mut latency = Latency::new();
        assert_eq!(latency.quantile(0.5), Duration::ZERO);
        for micros in 1..=10_000 {
            latency.add(Duration::from_micros(micros));
        }
        for (share, exact) in [(0.5, 5000.0), (0.99, 9900.0), (0.999, 9990.0), (1.0, 10_000.0)] {
            let told = latency.quantile(share).as_secs_f64() * 1e6;
            assert!(told >= exact && told <= exact * 1.02 + 1.0, "{share}: {told}");
        }
        assert_eq!((latency.count(), latency.longest()), (10_000, Duration::from_millis(10)));
    }

    #[test]
    fn the_shortest_and_the_longest_fit() {
        let mut latency = Latency::new();
        latency.add(Duration::ZERO);
        latency.add(Duration::from_secs(1_000_000));
        assert!(latency.quantile(0.5) <= Duration::from_micros(2));
        assert_eq!(latency.quantile(1.0).max(latency.longest()), Duration::from_secs(1_000_000));
    }
}
