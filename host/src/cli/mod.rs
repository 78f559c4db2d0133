//! The command `nearfield`: its subcommands, one file each, and what they share.

pub mod demo;
pub mod evaluate_scenes;
pub mod inspect;
pub mod mcu;
pub mod picture_report;
pub mod replay;
pub mod rig;
pub mod twin;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Bad input: a file that cannot be used, an argument that makes no sense.
const BAD_INPUT: u8 = 2;

/// The near-field safety sensor of a mobile robot: a laser stripe on the floor, a camera, two relays.
#[derive(Debug, Parser)]
#[command(name = "nearfield", version, propagate_version = true)]
pub struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Inspect(inspect::Inspect),
    Replay(replay::Replay),
    Rig(rig::RigArguments),
    EvaluateScenes(evaluate_scenes::EvaluateScenes),
    Twin(twin::TwinArguments),
}

impl CommandLine {
    /// Runs the command and tells errors: exit code 2 for input that cannot be used.
    #[must_use]
    pub fn run(&self) -> ExitCode {
        let result = match &self.command {
            Command::Demo(demo) => demo.run(),
            Command::Inspect(inspect) => inspect.run(),
            Command::Replay(replay) => replay.run(),
            Command::Rig(rig) => rig.run(),
            Command::EvaluateScenes(evaluate) => evaluate.run(),
            Command::Twin(twin) => twin.run(),
        };
        match result {
            Ok(code) => ExitCode::from(code),
            Err(error) => {
                eprintln!("error: {error:#}");
                ExitCode::from(BAD_INPUT)
            }
        }
    }
}
