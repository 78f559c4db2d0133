//! The demo, set up and built first.

use crate::run::Step;
use crate::tools::{Controller, with_options};
use crate::{firmware, setup};
use anyhow::Result;
use clap::Args;

/// Those of `nearfield demo`.
#[derive(Debug, Args)]
pub struct Options {
    /// Which safety controller decides
    #[arg(long, value_enum, default_value_t)]
    mcu: Controller,
    /// Directory for the report; it is made if it is not there
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
    out: String,
    /// Chooses floor pattern, speckle, noise and damaged bits
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The whole run as JSON on standard output, and nothing else
    #[arg(long)]
    json: bool,
    /// In the live view: do not wait for the clock
    #[arg(long)]
    fast: bool,
}

/// A scripted minute; see `nearfield demo --help`.
pub fn play(options: &Options) -> Result<()> {
    if options.mcu == Controller::Emulated {
        setup::everything()?;
        firmware::build()?;
    }
    let run = ["run", "--release", "--package", "nearfield-host", "--bin", "nearfield", "--", "demo"];
    let values = [
        ("--mcu", options.mcu.name().to_owned()),
        ("--out", options.out.clone()),
        ("--seed", options.seed.to_string()),
    ];
    let arguments = with_options(&run, &values, &[("--json", options.json), ("--fast", options.fast)]);
    Step::cargo(&arguments.iter().map(String::as_str).collect::<Vec<_>>()).run()
}
