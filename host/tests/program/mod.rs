//! The program under test.

use std::process::Command;

/// `nearfield`, built beside the test. NEARFIELD_RUNNER names the command that runs it where both are built for another processor
/// (`cargo xtask pi-test`): a test's own runner does not reach what the test starts.
pub fn nearfield() -> Command {
    let runner = std::env::var("NEARFIELD_RUNNER").unwrap_or_default();
    let mut words = runner.split_whitespace().chain([env!("CARGO_BIN_EXE_nearfield")]);
    let mut command = Command::new(words.next().unwrap_or_default());
    command.args(words);
    command
}
