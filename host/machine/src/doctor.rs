//! Looks at the computer and says what to do.
//!
//! Everything is read through a [`Patient`], so that what a Raspberry Pi would show can be made up in a test.

mod checks;
mod patient;

pub use patient::Patient;

use nearfield_configuration::Configuration;
use serde::Serialize;

/// How a check came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// As it should be.
    Sound,
    /// It works, less well than it could.
    Warning,
    /// It will not work.
    Problem,
    /// It cannot be looked at: this is another computer.
    NotHere,
}

impl Verdict {
    /// The word in a table.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Sound => "ok",
            Self::Warning => "warning",
            Self::Problem => "PROBLEM",
            Self::NotHere => "-",
        }
    }
}

/// One row.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Check {
    /// What was looked at.
    pub name: &'static str,
    /// How it came out.
    pub verdict: Verdict,
    /// What was found.
    pub found: String,
    /// What to do; empty = nothing.
    pub advice: String,
}

impl Check {
    fn sound(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Sound, found: found.into(), advice: String::new() }
    }

    fn warning(name: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Warning, found: found.into(), advice: advice.into() }
    }

    fn problem(name: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::Problem, found: found.into(), advice: advice.into() }
    }

    fn not_here(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, verdict: Verdict::NotHere, found: found.into(), advice: String::new() }
    }
}

/// All rows.
#[must_use]
pub fn examine(patient: &Patient, configuration: &Configuration) -> Vec<Check> {
    checks::all(patient, configuration)
}

/// 0 = nothing is in the way; 1 = a problem, or something that could not be looked at.
#[must_use]
pub fn exit_code(checks: &[Check]) -> u8 {
    let stands_in_the_way = |check: &Check| matches!(check.verdict, Verdict::Problem | Verdict::NotHere);
    u8::from(checks.iter().any(stands_in_the_way))
}

#[cfg(test)]
mod tests;
