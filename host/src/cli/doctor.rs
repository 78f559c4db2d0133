//! `nearfield doctor`: is this computer fit for the work?

use std::path::{Path, PathBuf};

use clap::Args;
use nearfield_configuration::Configuration;
use nearfield_machine::doctor::{Check, Patient, Verdict, examine, exit_code};

use crate::run::rig;

/// Look at this computer, and say what to do.
///
/// Camera, focus, SPI device and buffer, GPIO chip, real-time rights, kernel, clock, temperature, power, disk; for the
/// configuration's source, link and rig file. Exit code 0 = nothing is in the way; 1 = a problem, or another computer than a Raspberry Pi.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield doctor --config /etc/nearfield/nearfield.toml
  nearfield doctor --json | jq -r '.[] | select(.verdict == \"problem\") | .advice'")]
pub struct Doctor {
    /// The configuration; a camera on rpicam-vid and the board on SPI without it.
    #[arg(long, value_name = "NEARFIELD.toml")]
    config: Option<PathBuf>,
    /// All rows as one JSON list.
    #[arg(long)]
    json: bool,
}

/// What a robot has, where no configuration says otherwise.
const ON_A_ROBOT: &str = "[camera]\nsource = \"rpicam-vid\"\n[link]\nkind = \"spi\"\n";

/// Can the rig be used that the configuration names? Nothing runs without.
fn rig_check(configuration: &Configuration) -> Check {
    let (verdict, found, advice) = match rig::of(configuration) {
        Ok(_) => (Verdict::Sound, rig::name(configuration), ""),
        Err(error) => (
            Verdict::Problem,
            error.to_string(),
            "make it: `nearfield calibrate --help`; then `nearfield config check`",
        ),
    };
    Check { name: "rig", verdict, found, advice: advice.to_owned() }
}

impl Doctor {
    /// Runs the command.
    ///
    /// # Errors
    /// The configuration cannot be used.
    pub fn run(&self) -> anyhow::Result<u8> {
        let configuration = match &self.config {
            Some(path) => Configuration::load(path)?,
            None => Configuration::read(ON_A_ROBOT, Path::new("a robot's configuration"))?,
        };
        let mut checks = examine(&Patient::this(), &configuration);
        if self.config.is_some() {
            checks.push(rig_check(&configuration));
        }
        if self.json {
            say!("{}", serde_json::to_string(&checks)?);
        } else {
            for check in &checks {
                say!("{:<17} {:<8} {}", check.name, check.verdict.word(), check.found);
                if !check.advice.is_empty() {
                    say!("{:<17} {:<8} -> {}", "", "", check.advice);
                }
            }
        }
        Ok(exit_code(&checks))
    }
}
