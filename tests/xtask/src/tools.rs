//! The tools of the tests of the tests: cargo subcommands that are installed from crates.io where they are missing.

use crate::run::{Step, target_directory};
use anyhow::{Context as _, Result};
use clap::ValueEnum;

/// A cargo subcommand and the version that the figures in `tests/RIGOR.md` were made with.
pub struct Tool {
    /// As in `cargo <verb>`.
    pub verb: &'static str,
    /// The crate that brings it.
    pub package: &'static str,
    /// The version to install where there is none; another one that is there already is used.
    pub version: &'static str,
}

/// Line and region coverage.
pub const COVERAGE: Tool = Tool { verb: "llvm-cov", package: "cargo-llvm-cov", version: "0.9.1" };
/// Mutation tests.
pub const MUTANTS: Tool = Tool { verb: "mutants", package: "cargo-mutants", version: "27.1.0" };
/// Coverage-guided fuzzing.
pub const FUZZ: Tool = Tool { verb: "fuzz", package: "cargo-fuzz", version: "0.13.2" };
/// Licences, sources and duplicates of the dependencies.
pub const AUDIT: Tool = Tool { verb: "deny", package: "cargo-deny", version: "0.20.2" };

/// Debian packages.
pub const DEB: Tool = Tool { verb: "deb", package: "cargo-deb", version: "3.8.0" };

impl Tool {
    /// Installs it if it is missing.
    pub fn ensure(&self) -> Result<()> {
        let present = Step::cargo(&[self.verb, "--version"]).capture().is_ok_and(|(success, _)| success);
        if present {
            return Ok(());
        }
        Step::cargo(&["install", self.package, "--version", self.version, "--locked"]).run().with_context(
            || format!("cargo {} is missing; install it by hand: cargo install {}", self.verb, self.package),
        )
    }
}

/// Python with these packages from PyPI, in a folder of this name below `target`; `module` tells whether they are there.
pub fn python_with(folder: &str, module: &str, packages: &[&str]) -> Result<String> {
    let directory = target_directory().join(folder);
    let python = directory.join("bin").join("python").display().to_string();
    let is_there = Step::program(&python, &["-c", &format!("import {module}")]).capture();
    if !is_there.is_ok_and(|(success, _)| success) {
        Step::program("python3", &["-m", "venv", &directory.display().to_string()])
            .run()
            .context("needs Python 3.9 or later with its module venv (Debian: python3-venv)")?;
        let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
        Step::program(&python, &[&install[..], packages].concat()).run().context("needs a way to PyPI")?;
    }
    Ok(python)
}

/// The nightly toolchain with this component, for fuzzers and miri; the product itself is built with the pinned one.
pub fn nightly(component: Option<&str>) -> Result<()> {
    let (found, _) = Step::program("rustup", &["run", "nightly", "rustc", "--version"])
        .capture()
        .context("rustup is needed; see https://rustup.rs")?;
    if !found {
        let install = ["toolchain", "install", "nightly", "--profile", "minimal", "--no-self-update"];
        Step::program("rustup", &install).run()?;
    }
    if let Some(component) = component {
        Step::program("rustup", &["component", "add", "--toolchain", "nightly", component]).run()?;
    }
    Ok(())
}

/// Which safety controller decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Controller {
    /// The firmware's library in the host's process
    #[default]
    InProcess,
    /// The firmware's binary in QEMU
    Emulated,
}

impl Controller {
    /// As the host's programs call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::InProcess => "in-process",
            Self::Emulated => "emulated",
        }
    }
}

/// The words of a command, then options with their values, then the flags that are set.
pub fn with_options(command: &[&str], values: &[(&str, String)], flags: &[(&str, bool)]) -> Vec<String> {
    let mut words: Vec<String> = command.iter().map(|word| (*word).to_owned()).collect();
    words.extend(values.iter().flat_map(|(name, value)| [(*name).to_owned(), value.clone()]));
    words.extend(flags.iter().filter(|(_, set)| *set).map(|(name, _)| (*name).to_owned()));
    words
}
