//! `nearfield config`: the host's configuration file.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::{Args, Subcommand};
use nearfield_configuration::Configuration;
use nearfield_fields::Fields;

use crate::run::rig;

/// Check or print the host's configuration file.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield config print > nearfield.toml      the commented file with all defaults
  nearfield config check nearfield.toml        every error at once, exit code 2")]
pub struct ConfigArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Name everything that is wrong with a file, and with the rig that it names.
    Check {
        /// The configuration.
        #[arg(value_name = "NEARFIELD.toml")]
        file: PathBuf,
    },
    /// Print the commented file with all defaults.
    Print,
}

impl ConfigArguments {
    /// Runs the command.
    ///
    /// # Errors
    /// The file or the rig that it names cannot be used: everything that is wrong with it.
    pub fn run(&self) -> anyhow::Result<u8> {
        match &self.command {
            Command::Print => say!("{}", Configuration::COMMENTED.trim_end()),
            Command::Check { file } => {
                let configuration = Configuration::load(file)?;
                let rig = rig::of(&configuration)?;
                Fields::check(&configuration, rig.stripe()).with_context(|| file.display().to_string())?;
                say!(
                    "{}: sound; module {}, rig {} (calibration {:08x}), {} zones, {} cases",
                    file.display(),
                    configuration.module.name,
                    rig::name(&configuration),
                    rig.calibration_id().get(),
                    configuration.zones.len(),
                    configuration.cases.len()
                );
            }
        }
        Ok(0)
    }
}
