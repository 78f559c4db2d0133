//! The checks of the whole workspace: `test`, `lint`, `emulate`.

use crate::run::{self, Step};
use crate::{board, budget, firmware, panic_free, setup};
use anyhow::Result;

/// Everything that continuous integration holds a change against.
pub fn test() -> Result<()> {
    setup::everything()?;
    setup::components()?;
    lint()?;
    firmware::build()?;
    Step::cargo(&["test", "--workspace", "--exclude", "panic-free"])
        .env("NEARFIELD_EMULATOR_REQUIRED", "1")
        .run()?;
    board::run(&board::Options::default())?;
    panic_free::prove()?;
    budget::check(&budget::Options::default())?;
    eprintln!(
        "everything passed: format, lints, tests, both firmware builds, emulated runs, the board's binary on its \
         model, panic-free proof, budgets"
    );
    Ok(())
}

/// The firmware's binary on the emulated controller.
pub fn emulate() -> Result<()> {
    setup::everything()?;
    firmware::build()?;
    Step::cargo(&["test", "--package", "nearfield-tests", "--test", "emulated*"])
        .env("NEARFIELD_EMULATOR_REQUIRED", "1")
        .run()
}

/// Format, lints and the documentation's links.
pub fn lint() -> Result<()> {
    Step::cargo(&["fmt", "--all", "--check"]).run()?;
    Step::cargo(&["clippy", "--workspace", "--all-targets", "--", "--deny", "warnings"]).run()?;
    let firmware = ["clippy", "--package", "nearfield-firmware", "--target", run::FIRMWARE_TARGET];
    Step::cargo(&[&firmware[..], &["--profile", run::FIRMWARE_PROFILE, "--", "--deny", "warnings"]].concat())
        .run()?;
    // A link that leads nowhere, or to what readers of the documentation cannot see.
    Step::cargo(&["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "--deny warnings").run()
}
