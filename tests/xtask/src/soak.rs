//! The host for a long time, and killed.

use anyhow::Result;

use crate::run::Step;
use crate::{firmware, setup, tools};

/// Figures phase by phase; see `host/tests/run_soak`.
pub fn phases(rest: &[String]) -> Result<()> {
    let controller = tools::option(rest, "--mcu")?.unwrap_or("in-process");
    if controller == "emulated" {
        setup::everything()?;
        firmware::build()?;
    }
    let has = |flag: &str| rest.iter().any(|argument| argument == flag);
    ignored("run_soak", "nothing_that_listens")
        .env("NEARFIELD_SOAK_SECONDS", tools::option(rest, "--seconds")?.unwrap_or("60"))
        .env("NEARFIELD_SOAK_WIDTH", tools::option(rest, "--width")?.unwrap_or("1152"))
        .env("NEARFIELD_SOAK_MCU", controller)
        .env("NEARFIELD_SOAK_PROFILE", if has("--without-tier-three") { "height" } else { "semantics" })
        .run()
}

/// `nearfield run`, killed at random moments; see `host/tests/run_command`.
pub fn kills(rest: &[String]) -> Result<()> {
    ignored("run_command", "killed_two_hundred_times")
        .env("NEARFIELD_KILLS", tools::option(rest, "--kills")?.unwrap_or("200"))
        .env("NEARFIELD_KILLS_SEED", tools::option(rest, "--seed")?.unwrap_or("6"))
        .run()
}

/// One ignored test of the host, its words shown.
fn ignored(binary: &str, test: &str) -> Step {
    let arguments = ["test", "--release", "--package", "nearfield-host", "--test", binary, "--", test];
    Step::cargo(&[&arguments[..], &["--ignored", "--nocapture", "--test-threads", "1"]].concat())
}
