//! Who was heard, when, and what follows for each robot. Time comes in as an argument.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::report::{Report, ReportError, Verdict};

/// A module that was silent for so long is lost: five reports that did not come.
pub const LOST_AFTER: Duration = Duration::from_secs(1);
/// Modules that are kept: more than any fleet that this is made for.
pub const MOST_MODULES: usize = 8192;

/// A module's place in the roster.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The newest report; `None` = another module of its robot expects it.
    pub report: Option<Report>,
    /// When it came; for one that never came: since when it is expected.
    pub since: Instant,
}

impl Entry {
    /// At a time.
    #[must_use]
    pub fn verdict(&self, now: Instant) -> Verdict {
        match &self.report {
            Some(report) if now.duration_since(self.since) < LOST_AFTER => report.verdict(),
            _ => Verdict::Lost,
        }
    }

    /// The robot will not drive by it; `false` for one whose relays are closed.
    fn order(&self) -> Option<(u64, u64)> {
        self.report.as_ref().map(|report| (report.run, report.number))
    }
}

/// What was not believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Refused {
    /// Not a report.
    pub malformed: u64,
    /// Not newer than what is known of the module.
    pub late: u64,
    /// The roster is full.
    pub overflow: u64,
}

/// See the module's documentation.
#[derive(Debug, Clone, Default)]
pub struct Roster {
    robots: BTreeMap<String, BTreeMap<String, Entry>>,
    count: usize,
    taken: u64,
    refused: Refused,
}

impl Roster {
    /// What came from the network, at a time.
    ///
    /// # Errors
    /// It was not a report. It is counted.
    pub fn take(&mut self, bytes: &[u8], now: Instant) -> Result<(), ReportError> {
        match Report::parse(bytes) {
            Ok(report) => {
                self.take_report(report, now);
                Ok(())
            }
            Err(error) => {
                self.refused.malformed += 1;
                Err(error)
            }
        }
    }

    fn take_report(&mut self, report: Report, now: Instant) {
        for name in &report.modules {
            self.place(&report.robot, name, now);
        }
        if !self.place(&report.robot, &report.module, now) {
            self.refused.overflow += 1;
            return;
        }
        let Some(entry) = self.robots.get_mut(&report.robot).and_then(|robot| robot.get_mut(&report.module))
        else {
            return;
        };
        // Networks deliver twice, and late: an old "closed" must not follow a newer "open".
        if entry.order().is_some_and(|known| known >= (report.run, report.number)) {
            self.refused.late += 1;
            return;
        }
        *entry = Entry { report: Some(report), since: now };
        self.taken += 1;
    }

    /// Makes room for a module; `false` = there is none.
    fn place(&mut self, robot: &str, module: &str, now: Instant) -> bool {
        if self.robots.get(robot).is_some_and(|modules| modules.contains_key(module)) {
            return true;
        }
        if self.count >= MOST_MODULES {
            return false;
        }
        self.count += 1;
        let modules = self.robots.entry(robot.to_owned()).or_default();
        modules.insert(module.to_owned(), Entry { report: None, since: now });
        true
    }

    /// A robot that must be there, with its modules, whether they were ever heard or not.
    pub fn expect(&mut self, robot: &str, modules: &[String], now: Instant) {
        for module in modules {
            self.place(robot, module, now);
        }
    }

    /// The worst verdict of a robot's modules; a robot that nobody knows is lost.
    #[must_use]
    pub fn robot(&self, name: &str, now: Instant) -> Verdict {
        let verdicts = self.robots.get(name).into_iter().flat_map(BTreeMap::values);
        verdicts.map(|entry| entry.verdict(now)).max().unwrap_or(Verdict::Lost)
    }

    /// All modules: robot, module, entry; in the order of their names.
    pub fn modules(&self) -> impl Iterator<Item = (&str, &str, &Entry)> {
        self.robots.iter().flat_map(|(robot, modules)| {
            modules.iter().map(move |(module, entry)| (robot.as_str(), module.as_str(), entry))
        })
    }

    /// The robots' names, in order.
    pub fn robots(&self) -> impl Iterator<Item = &str> {
        self.robots.keys().map(String::as_str)
    }

    /// Reports believed so far.
    #[must_use]
    pub const fn taken(&self) -> u64 {
        self.taken
    }

    /// Reports that were not.
    #[must_use]
    pub const fn refused(&self) -> Refused {
        self.refused
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::report::Relay;
    use crate::report::tests::report;
    use proptest::prelude::*;

    const MODULES: [&str; 4] = ["front", "left", "rear", "right"];

    fn all_heard(now: Instant) -> Roster {
        let mut roster = Roster::default();
        for module in MODULES {
            roster.take(&report("amr", module).to_bytes(), now).unwrap();
        }
        roster
    }

    #[test]
    fn a_robot_drives_only_when_all_of_its_modules_were_heard() {
        let now = Instant::now();
        let mut roster = Roster::default();
        for (index, module) in MODULES.iter().enumerate() {
            assert_eq!(roster.robot("amr", now), Verdict::Lost, "{index} of 4 were heard");
            roster.take(&report("amr", module).to_bytes(), now).unwrap();
        }
        assert_eq!(roster.robot("amr", now), Verdict::Go);
        assert_eq!(roster.robot("nobody", now), Verdict::Lost);
    }

    #[test]
    fn a_module_is_lost_after_a_second_and_not_before() {
        let now = Instant::now();
        let roster = all_heard(now);
        assert_eq!(roster.robot("amr", now + LOST_AFTER - Duration::from_millis(1)), Verdict::Go);
        assert_eq!(roster.robot("amr", now + LOST_AFTER), Verdict::Lost);
    }

    #[test]
    fn a_late_report_does_not_close_what_a_newer_one_opened() {
        let now = Instant::now();
        let mut roster = all_heard(now);
        let open = crate::Report { relay: Relay::Open, number: 9, ..report("amr", "rear") };
        roster.take(&open.to_bytes(), now).unwrap();
        for number in [1, 8, 9] {
            let late = crate::Report { number, ..report("amr", "rear") };
            roster.take(&late.to_bytes(), now).unwrap();
            assert_eq!(roster.robot("amr", now), Verdict::Stop);
        }
        assert_eq!(roster.refused().late, 3);
        // A later run counts from the beginning.
        let again = crate::Report { run: 2, number: 0, ..report("amr", "rear") };
        roster.take(&again.to_bytes(), now).unwrap();
        assert_eq!(roster.robot("amr", now), Verdict::Go);
    }

    /// Repeating an old report does not keep a dead module alive.
    #[test]
    fn a_repeated_report_is_no_sign_of_life() {
        let now = Instant::now();
        let mut roster = all_heard(now);
        for millis in (0..2000).step_by(100) {
            roster.take(&report("amr", "rear").to_bytes(), now + Duration::from_millis(millis)).unwrap();
        }
        assert_eq!(roster.robot("amr", now + Duration::from_secs(2)), Verdict::Lost);
    }

    #[test]
    fn a_flood_of_strangers_fills_no_memory_and_hides_nobody() {
        let now = Instant::now();
        let mut roster = all_heard(now);
        for index in 0..2 * MOST_MODULES {
            let stranger = crate::Report { modules: Vec::new(), ..report(&format!("x{index}"), "front") };
            roster.take(&stranger.to_bytes(), now).unwrap();
        }
        assert_eq!(roster.modules().count(), MOST_MODULES);
        assert_eq!(roster.refused().overflow, (MOST_MODULES + MODULES.len()) as u64);
        assert_eq!(roster.robot("amr", now), Verdict::Go, "who was there first stays");
    }

    proptest! {
        /// One more module, or a worse one, never makes a robot's verdict milder.
        #[test]
        fn the_worst_wins(relays in proptest::collection::vec(0_u8..4, 1..8)) {
            let now = Instant::now();
            let mut roster = Roster::default();
            let mut worst = Verdict::Go;
            for (index, relay) in relays.iter().enumerate() {
                let mut one = crate::Report { modules: Vec::new(), ..report("amr", &format!("m{index}")) };
                match relay {
                    0 => {}
                    1 => one.warnings.push("visibility".to_owned()),
                    2 => one.relay = Relay::Open,
                    _ => one.relay = Relay::Unknown,
                }
                worst = worst.max(one.verdict());
                roster.take(&one.to_bytes(), now).unwrap();
                prop_assert_eq!(roster.robot("amr", now), worst);
            }
        }
    }
}
