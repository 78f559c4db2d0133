//! The project's chores, quick to build. `cargo xtask help` tells what there is.
//!
//! A module is a chore; `chores` has the list, and the help that users read. `run` starts programs and says what failed,
//! `setup` and `tools` fetch what a chore needs, and all others begin with them: read these four first. The rule that holds: a
//! chore sets up what it needs by itself, and what could not be done is an error or a line that says so, never silence.

mod audit;
mod bench;
mod board;
mod board_host;
mod budget;
mod campaign;
mod chores;
mod coverage;
mod demo;
mod firmware;
mod fuzz;
mod miri;
mod mutants;
mod page;
mod panic_free;
mod pi;
mod quotations;
mod report;
mod ros2;
mod run;
mod seeded_faults;
mod setup;
mod slow_tests;
mod soak;
mod tools;
mod train_smoke;
mod whole;

use clap::Parser as _;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    // What cannot be understood ends here, with exit code 2, and so does a question for help, with 0.
    let chores = chores::Chores::parse();
    let verb = std::env::args().nth(1).unwrap_or_default();
    let started = Instant::now();
    match chores.run() {
        Ok(()) => {
            if chores.is_for_people() {
                eprintln!("xtask {verb}: done in {:.0} s", started.elapsed().as_secs_f64());
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("xtask {verb}: {error:#}");
            ExitCode::FAILURE
        }
    }
}
