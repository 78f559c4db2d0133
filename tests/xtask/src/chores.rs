//! The chores by name, as people type them: what each is for, and the options of those that take any.
//!
//! What a chore does is in the module of its name. An option that a chore does not have is refused before anything begins:
//! some of them take hours, and a misspelt option must not start one with its defaults.

use anyhow::Result;
use clap::{Parser, Subcommand};

use crate::{
    audit, bench, board, board_host, budget, campaign, coverage, demo, firmware, fuzz, miri, mutants, page,
    panic_free, pi, report, ros2, seeded_faults, setup, soak, train_smoke, whole,
};

/// nearfield's chores. Each sets up what it needs by itself.
#[derive(Debug, Parser)]
#[command(
    bin_name = "cargo xtask",
    arg_required_else_help = true,
    disable_version_flag = true,
    subcommand_value_name = "CHORE",
    subcommand_help_heading = "Chores",
    after_help = "\
`cargo xtask CHORE --help` tells a chore's options. The tests of the tests are coverage, mutants, seeded-faults, fuzz and miri;
their figures are in tests/RIGOR.md. Missing tools are installed from crates.io, PyPI or through apt, where that can be done."
)]
pub struct Chores {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Debug, Subcommand)]
enum Chore {
    /// Install the Rust target for the microcontroller, and QEMU (through apt where it can)
    Setup,
    /// Play a scripted minute at the robot's edge, no hardware: pictures in, relay out; writes target/demo/report.html
    Demo(demo::Options),
    /// Test everything: format, lints, all tests, both firmware builds, emulated tests, the board's binary on its model,
    /// the panic-free proof, size and time budgets
    Test,
    /// Build the firmware for the board (stm32g474) and for the emulator (qemu_an386), and seal both images with their CRC
    Firmware,
    /// Run the board's unmodified binary on a register-level model (Python, Unicorn), with injected faults
    Board(board::Options),
    /// For the model that `board` starts, not for people: an honest host over standard input and output
    #[command(hide = true)]
    BoardHost,
    /// Inject every fault, alone and in pairs, into a million frames, and hold the controller to its stated times
    Campaign(campaign::Options),
    /// Run the tests of the firmware on an emulated Cortex-M4
    Emulate,
    /// Hold flash, RAM, stack and instructions of the firmware against tests/budget.toml
    Budget(budget::Options),
    /// Measure what a frame of 2304 x 1296 costs the host, against the sum of its bytes and the paper's pipeline in OpenCV
    Bench,
    /// Build the host's program for the Raspberry Pi (aarch64; cross-compiler through apt where it can)
    Pi,
    /// Run the tests of what runs on the Pi, built for its processor, under QEMU
    PiTest(pi::Options),
    /// Hold the ROS 2 outlet against a second participant, and against Eclipse Cyclone DDS (Python, PyPI)
    Ros2,
    /// Use the operator's page and its commissioning in Chromium: keyboard only, with and without the token, 360 and 1280 px,
    /// axe-core; screenshots in target/page (Chromium through apt, Python packages from PyPI)
    Page,
    /// Run everything of `nearfield run` at 50 pictures a second, quiet and disturbed: losses, relay, latency, memory
    Soak(soak::Soak),
    /// Kill `nearfield run` at random moments: every recording must open and be decided again
    Kills(soak::Kills),
    /// Make the Debian package: program, service, udev rules, configuration
    Deb,
    /// Make the source paper's tables again beside ours, in one run: tests/REPORT.md, target/report.html, README's quotations
    Report,
    /// Train the detector for half a minute on toy pictures, up to its being judged (Python, PyPI)
    TrainSmoke,
    /// Check format, lints and the documentation's links only
    Lint,
    /// Prove by linking that the safety core cannot panic
    PanicFree,
    /// Measure lines and regions of the safety core that its unit tests reach; fails on what is neither reached nor excused in
    /// tests/coverage.toml
    Coverage(coverage::Options),
    /// Change the safety core a line at a time; a unit test must notice each change
    Mutants(mutants::Options),
    /// Put known faults into the safety core; the tests must notice each
    SeededFaults(seeded_faults::Options),
    /// Feed parsers and controller with libFuzzer, on nightly
    Fuzz(fuzz::Options),
    /// Run the safety core's unit tests under miri, on nightly
    Miri(miri::Options),
    /// Check licences, bans and sources of all dependencies, by cargo-deny
    Audit(audit::Options),
}

impl Chores {
    /// Whether a person waits for it, and wants to know how long it took.
    pub fn is_for_people(&self) -> bool {
        !matches!(self.chore, Chore::BoardHost)
    }

    /// Does it.
    pub fn run(&self) -> Result<()> {
        match &self.chore {
            Chore::Setup => setup::everything(),
            Chore::Demo(options) => demo::play(options),
            Chore::Test => whole::test(),
            Chore::Firmware => firmware::set_up_and_build(),
            Chore::Board(options) => {
                firmware::set_up_and_build()?;
                board::run(options)
            }
            Chore::BoardHost => board_host::run(),
            Chore::Campaign(options) => campaign::run(options),
            Chore::Emulate => whole::emulate(),
            Chore::Budget(options) => {
                setup::everything()?;
                firmware::build()?;
                budget::check(options)
            }
            Chore::Bench => bench::table(),
            Chore::Pi => pi::build(),
            Chore::PiTest(options) => pi::test(options),
            Chore::Ros2 => ros2::check(),
            Chore::Page => page::check(),
            Chore::Soak(options) => soak::phases(options),
            Chore::Kills(options) => soak::kills(options),
            Chore::Deb => pi::package(),
            Chore::Report => report::make(),
            Chore::TrainSmoke => train_smoke::run(),
            Chore::Lint => {
                setup::firmware_target()?;
                setup::components()?;
                whole::lint()
            }
            Chore::PanicFree => {
                setup::firmware_target()?;
                panic_free::prove()
            }
            Chore::Coverage(options) => coverage::check(options),
            Chore::Mutants(options) => mutants::check(options),
            Chore::SeededFaults(options) => seeded_faults::check(options),
            Chore::Fuzz(options) => fuzz::run(options),
            Chore::Miri(options) => miri::check(options),
            Chore::Audit(options) => audit::check(options),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use clap::CommandFactory as _;
    use clap::error::ErrorKind;

    fn names() -> Vec<String> {
        Chores::command().get_subcommands().map(|chore| chore.get_name().to_owned()).collect()
    }

    fn refused(arguments: &[&str]) -> ErrorKind {
        Chores::try_parse_from([&["xtask"], arguments].concat()).unwrap_err().kind()
    }

    /// clap's own check of names, defaults and conflicts.
    #[test]
    fn the_chores_are_well_formed() {
        Chores::command().debug_assert();
        assert!(names().len() > 20);
    }

    /// A question must never begin a chore: some take hours.
    #[test]
    fn every_chore_answers_help_without_being_begun() {
        for name in names() {
            assert_eq!(refused(&[&name, "--help"]), ErrorKind::DisplayHelp, "{name}");
            assert_eq!(refused(&[&name, "-h"]), ErrorKind::DisplayHelp, "{name}");
        }
    }

    /// What a chore is for, and what each option means, is told.
    #[test]
    fn every_chore_and_every_option_is_described() {
        for chore in Chores::command().get_subcommands() {
            assert!(chore.get_about().is_some(), "{}", chore.get_name());
            for option in chore.get_arguments() {
                assert!(option.get_help().is_some(), "{} {}", chore.get_name(), option.get_id());
            }
        }
    }

    /// A misspelt option must not start a chore with its defaults, nor a stray word.
    #[test]
    fn every_chore_refuses_what_it_does_not_know() {
        for name in names() {
            assert_eq!(refused(&[&name, "--sceonds", "3"]), ErrorKind::UnknownArgument, "{name}");
            // Packages to test are named freely; cargo refuses those that there are not.
            if name != "pi-test" {
                let kind = refused(&[&name, "word"]);
                assert!(
                    matches!(kind, ErrorKind::UnknownArgument | ErrorKind::InvalidValue),
                    "{name}: {kind:?}"
                );
            }
        }
        assert_eq!(refused(&["soke"]), ErrorKind::InvalidSubcommand);
        assert_eq!(refused(&["soak", "--seconds"]), ErrorKind::InvalidValue);
        assert_eq!(refused(&["soak", "--seconds", "many"]), ErrorKind::ValueValidation);
    }

    /// A chore that the README's readers are told of, with options, is what it was told to be.
    #[test]
    fn options_reach_their_chore() {
        let parsed = Chores::try_parse_from(["xtask", "soak", "--seconds", "300", "--mcu", "emulated"]);
        let Chore::Soak(soak) = parsed.unwrap().chore else { panic!("another chore") };
        assert_eq!((soak.seconds, soak.mcu), (300, crate::tools::Controller::Emulated));
        let parsed = Chores::try_parse_from(["xtask", "fuzz", "status", "--seconds", "5"]);
        let Chore::Fuzz(fuzz) = parsed.unwrap().chore else { panic!("another chore") };
        assert_eq!((fuzz.target.as_deref(), fuzz.seconds), (Some("status"), 5));
    }
}
