//! What a module tells of itself: a JSON object of at most [`LARGEST_REPORT`] bytes.

use serde::{Deserialize, Serialize};

/// Version of the format.
pub const VERSION: u8 = 1;
/// Bytes of a report: one datagram that no network cuts up.
pub const LARGEST_REPORT: usize = 1400;
/// Characters of a name.
pub const LONGEST_NAME: usize = 48;
/// Modules of a robot, causes and warnings of a module: the most that are told.
pub const MOST_NAMES: usize = 12;

/// May the robot move, as far as this module's contacts tell?
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Relay {
    /// It may not.
    Open,
    /// It may.
    Closed,
    /// The controller is not heard.
    Unknown,
}

/// What follows for the robot; the greatest wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Drive.
    Go,
    /// Drive, somebody should look.
    Warn,
    /// It stands.
    Stop,
    /// The module is heard, its controller is not.
    Unknown,
    /// Not heard: neither the module nor why.
    Lost,
}

impl Verdict {
    /// All, from the mildest to the worst.
    pub const ALL: [Self; 5] = [Self::Go, Self::Warn, Self::Stop, Self::Unknown, Self::Lost];

    /// For programs and people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Go => "go",
            Self::Warn => "warn",
            Self::Stop => "stop",
            Self::Unknown => "unknown",
            Self::Lost => "lost",
        }
    }

    /// May the robot drive by it? Not known is no.
    #[must_use]
    pub const fn lets_drive(self) -> bool {
        matches!(self, Self::Go | Self::Warn)
    }
}

/// See the module's documentation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// [`VERSION`].
    pub version: u8,
    /// The robot's name.
    pub robot: String,
    /// The module's name, unique on its robot.
    pub module: String,
    /// All modules of this robot: who never reports is known to be missing.
    pub modules: Vec<String>,
    /// Names this run of the program: a greater one is a later run.
    pub run: u64,
    /// Counts the reports of a run.
    pub number: u64,
    /// The contacts.
    pub relay: Relay,
    /// The controller's state; empty = not heard.
    pub state: String,
    /// Causes to stop that hold now.
    pub causes: Vec<String>,
    /// The controller's warnings.
    pub warnings: Vec<String>,
    /// Longest gap, millimetres.
    pub longest_gap_mm: f32,
    /// Pictures since the program began.
    pub pictures: u64,
}

/// Why bytes are no report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ReportError {
    /// More than [`LARGEST_REPORT`] bytes.
    #[error("longer than a report may be")]
    Length,
    /// Not the JSON object that it should be.
    #[error("not a report")]
    Syntax,
    /// Another version.
    #[error("a report of another version")]
    Version,
    /// A name with other characters than a-z, A-Z, 0-9, `_`, `-` and `.`, an empty or too long one, or too many of them.
    #[error("an impossible name in a report")]
    Name,
    /// A figure that is none.
    #[error("an impossible figure in a report")]
    Figure,
}

impl Report {
    /// The bytes to send.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        // Text, numbers and lists of text: there is nothing in it that JSON cannot say.
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// Reads and checks.
    ///
    /// # Errors
    /// See [`ReportError`].
    pub fn parse(bytes: &[u8]) -> Result<Self, ReportError> {
        if bytes.len() > LARGEST_REPORT {
            return Err(ReportError::Length);
        }
        let report: Self = serde_json::from_slice(bytes).map_err(|_| ReportError::Syntax)?;
        if report.version != VERSION {
            return Err(ReportError::Version);
        }
        let lists = [&report.modules, &report.causes, &report.warnings];
        let names_are_sound = is_name(&report.robot)
            && is_name(&report.module)
            && (report.state.is_empty() || is_name(&report.state))
            && lists.iter().all(|list| list.len() <= MOST_NAMES && list.iter().all(|name| is_name(name)));
        if !names_are_sound {
            return Err(ReportError::Name);
        }
        if !report.longest_gap_mm.is_finite() {
            return Err(ReportError::Figure);
        }
        Ok(report)
    }

    /// What follows from it.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        match self.relay {
            Relay::Closed if self.warnings.is_empty() => Verdict::Go,
            Relay::Closed => Verdict::Warn,
            Relay::Open => Verdict::Stop,
            Relay::Unknown => Verdict::Unknown,
        }
    }
}

/// Names end up in terminals, keys and logs.
#[must_use]
pub fn is_name(name: &str) -> bool {
    (1..=LONGEST_NAME).contains(&name.len())
        && name.bytes().all(|one| one.is_ascii_alphanumeric() || matches!(one, b'_' | b'-' | b'.'))
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    /// A module that lets its robot drive.
    pub fn report(robot: &str, module: &str) -> Report {
        let names = ["front", "left", "rear", "right"].map(str::to_owned);
        Report {
            version: VERSION,
            robot: robot.to_owned(),
            module: module.to_owned(),
            modules: names.into(),
            run: 1,
            number: 1,
            relay: Relay::Closed,
            state: "running".to_owned(),
            causes: Vec::new(),
            warnings: Vec::new(),
            longest_gap_mm: 0.0,
            pictures: 50,
        }
    }

    #[test]
    fn what_is_sent_is_what_is_read() {
        let report = report("amr-17", "front");
        assert_eq!(Report::parse(&report.to_bytes()), Ok(report));
    }

    /// The longest report that the rules allow fits into a datagram.
    #[test]
    fn the_longest_names_of_this_program_fit() {
        use nearfield_shared::causes::StopCause;
        use nearfield_shared::condition::Warnings;
        let mut report = report(&"r".repeat(LONGEST_NAME), &"m".repeat(LONGEST_NAME));
        report.modules = (0..8).map(|index| format!("{index}{}", "m".repeat(20))).collect();
        let mut causes: Vec<&str> = StopCause::ALL.iter().map(|cause| cause.name()).collect();
        causes.sort_by_key(|name| std::cmp::Reverse(name.len()));
        report.causes = causes.iter().take(MOST_NAMES).map(|name| (*name).to_owned()).collect();
        report.warnings = Warnings::NAMED.iter().map(|(_, name, _)| (*name).to_owned()).collect();
        (report.run, report.number, report.pictures) = (u64::MAX, u64::MAX, u64::MAX);
        assert!(Report::parse(&report.to_bytes()).is_ok(), "{} bytes", report.to_bytes().len());
    }

    #[test]
    fn what_is_no_report_is_refused() {
        let sound = report("amr-17", "front");
        let broken = |change: fn(&mut Report)| {
            let mut report = sound.clone();
            change(&mut report);
            Report::parse(&report.to_bytes())
        };
        assert_eq!(broken(|report| report.version = 2), Err(ReportError::Version));
        assert_eq!(broken(|report| report.robot.clear()), Err(ReportError::Name));
        assert_eq!(broken(|report| report.module = "a\u{1b}[2J".to_owned()), Err(ReportError::Name));
        assert_eq!(broken(|report| report.robot = "r".repeat(LONGEST_NAME + 1)), Err(ReportError::Name));
        assert_eq!(
            broken(|report| report.causes = vec!["c".to_owned(); MOST_NAMES + 1]),
            Err(ReportError::Name)
        );
        assert_eq!(broken(|report| report.causes = vec!["c".repeat(48); 30]), Err(ReportError::Length));
        // JSON has no NaN: it is written as null, which is no number.
        assert_eq!(broken(|report| report.longest_gap_mm = f32::NAN), Err(ReportError::Syntax));
        assert_eq!(Report::parse(b"{}"), Err(ReportError::Syntax));
        let nested = format!("{{\"version\":{}", "[".repeat(1300));
        assert_eq!(Report::parse(nested.as_bytes()), Err(ReportError::Syntax));
    }

    #[test]
    fn only_a_closed_relay_lets_drive() {
        let mut report = report("amr-17", "front");
        assert_eq!(report.verdict(), Verdict::Go);
        report.warnings.push("visibility".to_owned());
        assert_eq!(report.verdict(), Verdict::Warn);
        report.relay = Relay::Open;
        assert_eq!(report.verdict(), Verdict::Stop);
        report.relay = Relay::Unknown;
        assert_eq!(report.verdict(), Verdict::Unknown);
        let drive: Vec<_> = Verdict::ALL.into_iter().filter(|verdict| verdict.lets_drive()).collect();
        assert_eq!(drive, [Verdict::Go, Verdict::Warn]);
        assert!(Verdict::ALL.is_sorted());
    }

    proptest! {
        #[test]
        fn no_bytes_break_the_reader(bytes in proptest::collection::vec(any::<u8>(), 0..1500)) {
            let _ = Report::parse(&bytes);
        }

        /// A changed byte gives a report whose names are sound, or none.
        #[test]
        fn a_changed_byte_gives_no_impossible_name(at in 0_usize..300, to in any::<u8>()) {
            let mut bytes = report("amr-17", "front").to_bytes();
            let at = at % bytes.len();
            bytes[at] = to;
            if let Ok(report) = Report::parse(&bytes) {
                prop_assert!(is_name(&report.robot) && is_name(&report.module));
                prop_assert!(report.longest_gap_mm.is_finite());
            }
        }
    }
}
