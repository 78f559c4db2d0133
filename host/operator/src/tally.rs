//! Numbers that the stripe's path counts and the page shows; adding one costs nothing and waits for nobody.

use std::sync::atomic::{AtomicU64, Ordering};

macro_rules! tally {
    ($($(#[$doc:meta])* $field:ident)*) => {
        /// What a run has counted since it began.
        #[derive(Debug, Default)]
        pub struct Tally {
            $($(#[$doc])* pub $field: Count,)*
        }
    };
}

tally! {
    /// Pictures asked for.
    pictures
    /// Pictures that did not come in time, or could not be used.
    missing
    /// Line-scans that the controller did not take.
    lost
    /// Times that the source of pictures was opened again.
    restarts
}

/// A number that only grows.
#[derive(Debug, Default)]
pub struct Count(AtomicU64);

impl Count {
    /// One more.
    pub fn add(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    /// How many.
    #[must_use]
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}
