//! Runs the unit tests with one mutant on.

use crate::mutant::Mutant;
use anyhow::{Context as _, Result, bail};
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What the tests say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// A test failed.
    Caught,
    /// The tests did not end within their processor time, or asked for more memory than there is.
    TimedOut,
    /// All tests passed.
    Missed,
}

/// The unit tests of one package.
pub struct TestProgram {
    /// The program.
    pub program: PathBuf,
    /// Where it runs.
    pub folder: PathBuf,
    /// The tests to be left out at first.
    pub slow: Vec<String>,
    /// Processor time of one run, seconds.
    pub processor_seconds: u32,
}

/// Memory of one run, bytes: a mutant that collects for ever is stopped.
const MEMORY: &str = "--as=4294967296";

impl TestProgram {
    /// Judges one mutant: by the tests of its own module, by all quick ones, by all.
    ///
    /// # Errors
    /// The tests cannot be started.
    pub fn judge(&self, number: u32, mutant: &Mutant) -> Result<Verdict> {
        let own = [module(&mutant.file)];
        let quick: Vec<_> = self.slow.iter().flat_map(|test| ["--skip".to_owned(), test.clone()]).collect();
        let first = [&own[..], &quick[..]].concat();
        for arguments in [&first[..], &quick[..], &[]] {
            let verdict = self.run(number, arguments)?;
            if verdict != Verdict::Missed {
                return Ok(verdict);
            }
        }
        Ok(Verdict::Missed)
    }

    /// The tests must pass without a mutant.
    ///
    /// # Errors
    /// They do not.
    pub fn check(&self) -> Result<()> {
        match self.run(0, &[])? {
            Verdict::Missed => Ok(()),
            verdict => bail!("{}: without a mutant already: {verdict:?}", self.program.display()),
        }
    }

    fn run(&self, number: u32, arguments: &[String]) -> Result<Verdict> {
        let mut command = Command::new("prlimit");
        command.arg(format!("--cpu={}", self.processor_seconds)).args([MEMORY, "--core=0"]);
        command.arg(&self.program).args(arguments).arg("--test-threads=1").current_dir(&self.folder);
        command.env("NEARFIELD_MUTANT", number.to_string()).env("RUST_BACKTRACE", "0");
        // A failure is enough: it need not be made small, and not be kept.
        command.env("PROPTEST_MAX_SHRINK_ITERS", "0");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let status = command.status().context("prlimit (of Debian's util-linux) is needed")?;
        Ok(match (status.code(), status.signal()) {
            (Some(0), _) => Verdict::Missed,
            // SIGKILL and SIGXCPU: out of processor time.
            (_, Some(9 | 24)) | (Some(137 | 152), _) => Verdict::TimedOut,
            _ => Verdict::Caught,
        })
    }
}

/// The module of a file, as its tests' names begin.
fn module(file: &str) -> String {
    let path = Path::new(file).with_extension("");
    let parts: Vec<_> = path.iter().filter_map(|part| part.to_str()).collect();
    // Behind the package's folder and `src`.
    let parts = parts.get(2..).unwrap_or_default();
    let parts = if parts.last() == Some(&"mod") { &parts[..parts.len() - 1] } else { parts };
    format!("{}::", parts.join("::"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A module's own tests come first: the wrong name would run none, and cost time only.
    #[test]
    fn a_module_is_named_by_its_path() {
        assert_eq!(module("shared/src/wire.rs"), "wire::");
        assert_eq!(module("firmware/src/safety/mod.rs"), "safety::");
        assert_eq!(module("firmware/src/store/rig_slots.rs"), "store::rig_slots::");
    }
}
