//! The long fault-injection campaign, built first.

use crate::run::Step;
use crate::tools::with_options;
use anyhow::Result;
use clap::Args;

/// Those of `tests/src/bin/campaign.rs`.
#[derive(Debug, Args)]
pub struct Options {
    /// Frames to play, over all parts
    #[arg(long, value_name = "N", default_value_t = 1_200_000)]
    frames: u64,
    /// First seed; every part has its own
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Parts, each a robot of its own; the same number gives the same run on any machine
    #[arg(long, value_name = "N", default_value_t = 32)]
    parts: u64,
    /// One JSON object instead of the table
    #[arg(long)]
    json: bool,
}

/// Plays it.
pub fn run(options: &Options) -> Result<()> {
    let run = ["run", "--release", "--package", "nearfield-tests", "--bin", "campaign", "--"];
    let values = [
        ("--frames", options.frames.to_string()),
        ("--seed", options.seed.to_string()),
        ("--parts", options.parts.to_string()),
    ];
    let arguments = with_options(&run, &values, &[("--json", options.json)]);
    Step::cargo(&arguments.iter().map(String::as_str).collect::<Vec<_>>()).run()
}
