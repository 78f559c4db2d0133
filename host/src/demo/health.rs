//! The link's figures over a run in which the controller may restart and forget its own.

use nearfield_shared::causes::StopCause;
use nearfield_shared::status::{REFUSAL_KINDS, ResetCause, Status};

use super::check::millis;
use super::record::LinkHealth;

/// Counts of a controller that may restart.
#[derive(Debug, Default)]
pub(super) struct HealthCount {
    earlier: [u32; REFUSAL_KINDS],
    earlier_accepted: u32,
    last: Option<Status>,
    longest_decision_age_ms: f64,
    watchdog_resets: u32,
}

impl HealthCount {
    /// A status; counts that fell mean that the controller has restarted.
    pub(super) fn note(&mut self, status: &Status) {
        if let Some(last) = &self.last
            && status.accepted < last.accepted
        {
            for (sum, count) in self.earlier.iter_mut().zip(last.refused) {
                *sum += count;
            }
            self.earlier_accepted += last.accepted;
            if status.reset_cause == ResetCause::Watchdog {
                self.watchdog_resets += 1;
            }
        }
        self.longest_decision_age_ms = self.longest_decision_age_ms.max(millis(status.longest_decision_age));
        self.last = Some(*status);
    }

    pub(super) fn finish(self) -> LinkHealth {
        let Some(last) = self.last else { return LinkHealth::default() };
        let kinds = StopCause::ALL.into_iter().skip(5);
        let counts = self.earlier.iter().zip(last.refused).map(|(earlier, now)| earlier + now);
        LinkHealth {
            accepted: self.earlier_accepted + last.accepted,
            refused: kinds.map(|cause| cause.name()).zip(counts).collect(),
            longest_decision_age_ms: self.longest_decision_age_ms,
            response_bound_ms: millis(last.response_bound),
            watchdog_resets: self.watchdog_resets,
        }
    }
}
