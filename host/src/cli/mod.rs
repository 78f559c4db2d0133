//! The command `nearfield`: its subcommands, one file each, and what they share.

/// Writes a line to standard output; a reader that has gone away (`| head`) is an error like any other, and ends the
/// command quietly in [`CommandLine::run`]. `println!` would panic.
macro_rules! say {
    ($($part:tt)*) => {{
        use std::io::Write as _;
        writeln!(std::io::stdout().lock(), $($part)*)?
    }};
}

pub mod blackbox;
pub mod budget;
pub mod calibrate;
pub mod campaign;
pub mod capability;
pub mod commission;
pub mod config;
pub mod dataset;
pub mod demo;
pub mod doctor;
pub mod evaluate_scenes;
pub mod extract;
pub mod fleet;
pub mod inspect;
pub mod mcu;
pub mod paper;
pub mod picture_report;
pub mod replay;
pub mod rig;
pub mod run;
pub mod service;
pub mod study;
pub mod twin;
pub mod twin_calibration;
pub mod twin_compare;
pub mod twin_speed;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use nearfield_detection::cli::{detect, evaluate};

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
    Budget(budget::Budget),
    Calibrate(calibrate::CalibrateArguments),
    Capability(capability::CapabilityArguments),
    Commission(commission::Commission),
    Config(config::ConfigArguments),
    Dataset(dataset::Dataset),
    Demo(demo::Demo),
    Detect(detect::Detect),
    Doctor(doctor::Doctor),
    Evaluate(evaluate::Evaluate),
    Inspect(inspect::Inspect),
    Extract(extract::Extract),
    Fleet(fleet::Fleet),
    Replay(replay::Replay),
    Rig(rig::RigArguments),
    Run(run::Run),
    EvaluateScenes(evaluate_scenes::EvaluateScenes),
    #[command(name = "evaluate-twin")]
    Campaign(campaign::Campaign),
    Paper(paper::PaperArguments),
    Twin(twin::TwinArguments),
    #[command(name = "blackbox")]
    BlackBox(blackbox::BlackBoxArguments),
    Service(service::ServiceArguments),
}

impl CommandLine {
    /// Runs the command and tells errors: exit code 2 for input that cannot be used.
    #[must_use]
    pub fn run(&self) -> ExitCode {
        let result = match &self.command {
            Command::Budget(budget) => budget.run(),
            Command::Calibrate(calibrate) => calibrate.run(),
            Command::Capability(capability) => capability.run(),
            Command::Commission(commission) => commission.run(),
            Command::Config(config) => config.run(),
            Command::Dataset(dataset) => dataset.run(),
            Command::Demo(demo) => demo.run(),
            Command::Detect(detect) => detect.run(),
            Command::Doctor(doctor) => doctor.run(),
            Command::Evaluate(evaluate) => evaluate.run(),
            Command::Inspect(inspect) => inspect.run(),
            Command::Extract(extract) => extract.run(),
            Command::Fleet(fleet) => fleet.run(),
            Command::Replay(replay) => replay.run(),
            Command::Rig(rig) => rig.run(),
            Command::Run(run) => run.run(),
            Command::EvaluateScenes(evaluate) => evaluate.run(),
            Command::Campaign(campaign) => campaign.run(),
            Command::Paper(paper) => paper.run(),
            Command::Twin(twin) => twin.run(),
            Command::BlackBox(black_box) => black_box.run(),
            Command::Service(service) => service.run(),
        };
        match result {
            Ok(code) => ExitCode::from(code),
            Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("error: {error:#}");
                ExitCode::from(BAD_INPUT)
            }
        }
    }
}

/// Has the reader of standard output gone away?
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let kinds =
        error.chain().filter_map(|cause| cause.downcast_ref::<std::io::Error>()).map(std::io::Error::kind);
    kinds.into_iter().any(|kind| kind == std::io::ErrorKind::BrokenPipe)
}
