//! The host for a long time, and killed.

use anyhow::Result;
use clap::Args;

use crate::run::Step;
use crate::tools::Controller;
use crate::{firmware, setup};

/// How long, and with what.
#[derive(Debug, Args)]
#[command(after_help = "\
The phases: quiet, tier 3 stalled, disk full, 200 clients, source dies every 10 s, quiet again. The disk is a small tmpfs, which
needs root; without it this phase is left out, and said to be.")]
pub struct Soak {
    /// Length of a phase in seconds; there are six
    #[arg(long, value_name = "N", default_value_t = 60)]
    pub seconds: u64,
    /// Which safety controller decides
    #[arg(long, value_enum, default_value_t)]
    pub mcu: Controller,
    /// Width of the pictures in pixels
    #[arg(long, value_name = "N", default_value_t = 1152)]
    pub width: u16,
    /// Without the detector, and without the phase in which it is stalled
    #[arg(long)]
    pub without_tier_three: bool,
}

/// How often.
#[derive(Debug, Args)]
pub struct Kills {
    /// Runs that are killed
    #[arg(long, value_name = "N", default_value_t = 200)]
    pub kills: u64,
    /// Chooses the moments
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub seed: u64,
}

/// Figures phase by phase; see `host/tests/run_soak`.
pub fn phases(options: &Soak) -> Result<()> {
    if options.mcu == Controller::Emulated {
        setup::everything()?;
        firmware::build()?;
    }
    ignored("run_soak", "nothing_that_listens")
        .env("NEARFIELD_SOAK_SECONDS", &options.seconds.to_string())
        .env("NEARFIELD_SOAK_WIDTH", &options.width.to_string())
        .env("NEARFIELD_SOAK_MCU", options.mcu.name())
        .env("NEARFIELD_SOAK_PROFILE", if options.without_tier_three { "height" } else { "semantics" })
        .run()
}

/// `nearfield run`, killed at random moments; see `host/tests/run_command`.
pub fn kills(options: &Kills) -> Result<()> {
    ignored("run_command", "killed_two_hundred_times")
        .env("NEARFIELD_KILLS", &options.kills.to_string())
        .env("NEARFIELD_KILLS_SEED", &options.seed.to_string())
        .run()
}

/// One ignored test of the host, its words shown.
fn ignored(binary: &str, test: &str) -> Step {
    let arguments = ["test", "--release", "--package", "nearfield-host", "--test", binary, "--", test];
    Step::cargo(&[&arguments[..], &["--ignored", "--nocapture", "--test-threads", "1"]].concat())
}
