//! Made-up modules, for trying out a view of many: most drive, some stand, some warn, some fall silent and come back.

use std::time::Duration;

use crate::outlet::REPORT_INTERVAL;
use crate::report::{Relay, Report, VERSION};

/// Modules of a robot.
pub const MODULES: [&str; 4] = ["front", "left", "rear", "right"];
/// What a module does, it does for so long.
const EPISODE: Duration = Duration::from_secs(8);

/// What a module does for a while.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doing {
    /// Its robot may drive.
    Driving,
    /// ... and somebody should look.
    Warning,
    /// Something is on the stripe.
    Stopping,
    /// Its controller is not heard.
    Blind,
    /// It sends nothing.
    Silent,
}

/// A fleet of made-up modules, the same for the same seed.
#[derive(Debug, Clone)]
pub struct Fleet {
    count: usize,
    seed: u64,
    run: u64,
    numbers: Vec<u64>,
}

impl Fleet {
    /// So many modules, four on a robot. `run` as in [`Report`].
    #[must_use]
    pub fn new(count: usize, seed: u64, run: u64) -> Self {
        Self { count, seed, run, numbers: vec![0; count] }
    }

    /// How many modules.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.count
    }

    /// What a module does at a time since the beginning: one robot in ten is troubled, by one of its modules.
    #[must_use]
    pub fn doing(&self, index: usize, at: Duration) -> Doing {
        let episode = at.as_secs() / EPISODE.as_secs();
        let draw = mixed(self.seed ^ mixed((index / MODULES.len()) as u64 ^ mixed(episode)));
        let is_troubled =
            draw.is_multiple_of(10) && (draw >> 8) as usize % MODULES.len() == index % MODULES.len();
        match (is_troubled, (draw >> 16) % 5) {
            (false, _) => Doing::Driving,
            (true, 0) => Doing::Warning,
            (true, 1 | 2) => Doing::Stopping,
            (true, 3) => Doing::Blind,
            (true, _) => Doing::Silent,
        }
    }

    /// The reports of the modules whose turn it is in slice `slice` of `slices` of a report interval: they are spread over it, as
    /// the reports of real modules are.
    pub fn reports(&mut self, at: Duration, slice: usize, slices: usize) -> Vec<Report> {
        let mut reports = Vec::with_capacity(self.count / slices.max(1) + 1);
        for index in (slice..self.count).step_by(slices.max(1)) {
            let doing = self.doing(index, at);
            if doing == Doing::Silent {
                continue;
            }
            self.numbers[index] += 1;
            reports.push(self.report(index, doing, at));
        }
        reports
    }

    fn report(&self, index: usize, doing: Doing, at: Duration) -> Report {
        let text = |text: &str| vec![text.to_owned()];
        let (relay, state) = match doing {
            Doing::Driving | Doing::Warning => (Relay::Closed, "running"),
            Doing::Stopping => (Relay::Open, "stopped"),
            Doing::Blind | Doing::Silent => (Relay::Unknown, ""),
        };
        Report {
            version: VERSION,
            robot: format!("amr-{:04}", index / MODULES.len()),
            module: MODULES[index % MODULES.len()].to_owned(),
            modules: MODULES.map(str::to_owned).into(),
            run: self.run,
            number: self.numbers[index],
            relay,
            state: state.to_owned(),
            causes: if doing == Doing::Stopping { text("stripe_cut") } else { Vec::new() },
            warnings: if doing == Doing::Warning { text("visibility") } else { Vec::new() },
            longest_gap_mm: if doing == Doing::Stopping { 42.0 } else { 0.0 },
            pictures: (at.as_secs_f64() * 50.0) as u64,
        }
    }
}

/// Slices of a report interval, and how long one is.
#[must_use]
pub fn pace(slices: usize) -> Duration {
    REPORT_INTERVAL / u32::try_from(slices.max(1)).unwrap_or(u32::MAX)
}

/// Splitmix64's finaliser: neighbouring numbers become strangers.
const fn mixed(value: u64) -> u64 {
    let value = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let value = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    value ^ (value >> 31)
}
