//! The unit tests of the safety core under miri, which finds undefined behaviour, leaks and uses of uninitialised memory.

use crate::run::Step;
use crate::tools;
use anyhow::Result;

/// Runs them on the nightly toolchain. Tests that would take too long there say so themselves.
pub fn check(rest: &[String]) -> Result<()> {
    tools::nightly(Some("miri"))?;
    let mut arguments = vec!["run", "nightly", "cargo", "miri", "test"];
    arguments.extend(["--package", "nearfield-shared", "--package", "nearfield-firmware", "--lib"]);
    arguments.extend(rest.iter().map(String::as_str));
    // proptest keeps its failures in files, which miri's isolation forbids; a few cases are enough here.
    Step::program("rustup", &arguments)
        .env("MIRIFLAGS", "-Zmiri-disable-isolation")
        .env("PROPTEST_CASES", "2")
        .without("RUSTUP_TOOLCHAIN")
        .without("CARGO")
        .run()
}
