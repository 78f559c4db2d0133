//! The unit tests of the safety core under miri, which finds undefined behaviour, leaks and uses of uninitialised memory.

use crate::run::Step;
use crate::tools;
use anyhow::Result;
use clap::Args;

/// Packages with the tests that are left out of it: they play thousands of line-scans of a thousand columns, for hours under
/// miri. The modules that do the work are tested piece by piece by what is left.
const PACKAGES: [(&str, &[&str]); 2] = [
    (
        "nearfield-shared",
        &["columns::tests", "tier_tests::", "service::tests::what_is_not_whole", "service::tests::garbage"],
    ),
    (
        "nearfield-firmware",
        &["audit::", "black_box::recorded::", "liveness::", "map_check::", "model_check::", "safety::"],
    ),
];

/// Which tests.
#[derive(Debug, Args)]
pub struct Options {
    /// Also the tests that take hours there
    #[arg(long)]
    all: bool,
}

/// Runs them on the nightly toolchain. Single tests that would take too long say so themselves.
pub fn check(options: &Options) -> Result<()> {
    tools::nightly(Some("miri"))?;
    for (package, left_out) in PACKAGES {
        let mut arguments =
            vec!["run", "nightly", "cargo", "miri", "test", "--package", package, "--lib", "--"];
        if !options.all {
            arguments.extend(left_out.iter().flat_map(|tests| ["--skip", tests]));
        }
        // proptest keeps its failures in files, which miri's isolation forbids; a few cases are enough here.
        Step::program("rustup", &arguments)
            .env("MIRIFLAGS", "-Zmiri-disable-isolation")
            .env("PROPTEST_CASES", "2")
            .without("RUSTUP_TOOLCHAIN")
            .without("CARGO")
            .run()?;
    }
    Ok(())
}
