//! The project's chores, quick to build. `cargo xtask help` tells what there is.
//!
//! A module is a chore; this file has the list, and the help that users read. `run` starts programs and says what failed,
//! `setup` and `tools` fetch what a chore needs, and all others begin with them: read these three first. The rule that holds: a
//! chore sets up what it needs by itself, and what could not be done is an error or a line that says so, never silence.

mod audit;
mod bench;
mod board;
mod board_host;
mod budget;
mod coverage;
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

use anyhow::{Result, bail};
use run::Step;
use std::process::ExitCode;
use std::time::Instant;

const HELP: &str = "\
nearfield's chores. Each sets up what it needs by itself.

  cargo xtask setup      Rust target for the microcontroller, QEMU (through apt where it can)
  cargo xtask demo       a scripted minute at the robot's edge, no hardware: pictures in, relay out;
                         writes target/demo/report.html   (further arguments go to `nearfield demo`)
  cargo xtask test       everything: format, lints, all tests, both firmware builds, emulated tests,
                         the board's binary on its model, the panic-free proof, size and time budgets
  cargo xtask firmware   builds the firmware for the board (stm32g474) and for the emulator (qemu_an386), and seals
                         both images with their CRC
  cargo xtask board      the board's unmodified binary on a register-level model (Python, Unicorn), with injected faults
                         (--list, --only NAME, --json)
  cargo xtask campaign   a million frames with injected faults, alone and in pairs (--frames N, --seed N, --json)
  cargo xtask emulate    the tests that run the firmware on an emulated Cortex-M4
  cargo xtask budget     flash, RAM, stack and instructions of the firmware against tests/budget.toml
                         (--write keeps the measured figures plus headroom as the new budget)
  cargo xtask bench      what a frame of 2304 x 1296 costs the host, against the sum of its bytes and the paper's pipeline in OpenCV
  cargo xtask pi         the host's program for the Raspberry Pi (aarch64; cross-compiler through apt where it can)
  cargo xtask pi-test    tests of the parts that run on the Pi, for its processor, under QEMU (further arguments: packages)
  cargo xtask ros2       the ROS 2 outlet against a second participant, and against Eclipse Cyclone DDS (Python, PyPI)
  cargo xtask page       the operator's page and its commissioning in Chromium: keyboard only, with and without the token, 360 and
                         1280 px, axe-core; screenshots in target/page (Chromium through apt, Python packages from PyPI)
  cargo xtask soak       everything of `nearfield run` at 50 pictures a second: quiet, tier 3 stalled, disk full, flooded, with a
                         dying source; losses, relay, latency, memory (--seconds N a phase, --mcu emulated, --width N,
                         --without-tier-three)
  cargo xtask kills      `nearfield run` killed at 200 random moments: every recording opens and is decided again (--kills N, --seed N)
  cargo xtask deb        the Debian package: program, service, udev rules, configuration
  cargo xtask report     the source paper's tables made again beside ours, in one run: tests/REPORT.md, target/report.html
  cargo xtask train-smoke  half a minute of training the detector on toy pictures, up to being judged (Python, PyPI)
  cargo xtask lint       format and lints only
  cargo xtask panic-free the proof by linking that the safety core cannot panic

Tests of the tests, at length; their figures are in tests/RIGOR.md. Missing tools are installed from crates.io.
  cargo xtask coverage   lines and regions of the safety core that its unit tests reach; fails on what is neither
                         reached nor excused in tests/coverage.toml (--html for a report)
  cargo xtask mutants    changes the safety core a line at a time; a test must notice each change
                         (--group NAME, --file NAME, --resume, --jobs N)
  cargo xtask seeded-faults  known faults put into the safety core; the tests must notice each
                         (--only NAME, --from NUMBER)
  cargo xtask fuzz       parsers and controller under libFuzzer on nightly (TARGET, --seconds N)
  cargo xtask miri       the safety core's unit tests under miri on nightly
  cargo xtask audit      licences, bans and sources of all dependencies (--advisories: also known vulnerabilities)
";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (verb, rest) = match arguments.split_first() {
        Some((verb, rest)) => (verb.as_str(), rest),
        None => ("help", &[][..]),
    };
    let started = Instant::now();
    match dispatch(verb, rest) {
        Ok(()) => {
            if !matches!(verb, "board-host" | "help" | "-h" | "--help") {
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

fn dispatch(verb: &str, rest: &[String]) -> Result<()> {
    match verb {
        "setup" => setup::everything(),
        "demo" => demo(rest),
        "test" => test(),
        "firmware" => {
            setup::firmware_target()?;
            firmware::build()
        }
        "board" => {
            setup::firmware_target()?;
            firmware::build()?;
            board::run(rest)
        }
        // For the model that `board` starts, not for people.
        "board-host" => board_host::run(),
        "campaign" => campaign(rest),
        "emulate" => emulate(),
        "budget" => {
            setup::everything()?;
            firmware::build()?;
            budget::check(rest.iter().any(|argument| argument == "--write"))
        }
        "bench" => bench::table(),
        "report" => report::make(),
        "lint" => {
            setup::firmware_target()?;
            setup::components()?;
            lint()
        }
        "panic-free" => {
            setup::firmware_target()?;
            panic_free::prove()
        }
        "pi" => pi::build(),
        "pi-test" => pi::test(rest),
        "deb" => pi::package(),
        "ros2" => ros2::check(),
        "page" => page::check(),
        "soak" => soak::phases(rest),
        "kills" => soak::kills(rest),
        "coverage" => coverage::check(rest),
        "mutants" => mutants::check(rest),
        "seeded-faults" => seeded_faults::check(rest),
        "fuzz" => fuzz::run(rest),
        "miri" => miri::check(rest),
        "audit" => audit::check(rest),
        "train-smoke" => train_smoke::run(),
        "help" | "-h" | "--help" => {
            print!("{HELP}");
            Ok(())
        }
        unknown => bail!("there is no chore {unknown:?}; `cargo xtask help` lists them"),
    }
}

fn demo(rest: &[String]) -> Result<()> {
    if rest.iter().any(|argument| argument == "emulated" || argument == "--mcu=emulated") {
        setup::everything()?;
        firmware::build()?;
    }
    let mut arguments =
        vec!["run", "--release", "--package", "nearfield-host", "--bin", "nearfield", "--", "demo"];
    let out = ["--out", "target/demo"];
    if !rest.iter().any(|argument| argument.starts_with("--out")) {
        arguments.extend(out);
    }
    arguments.extend(rest.iter().map(String::as_str));
    Step::cargo(&arguments).run()
}

fn test() -> Result<()> {
    setup::everything()?;
    setup::components()?;
    lint()?;
    firmware::build()?;
    Step::cargo(&["test", "--workspace", "--exclude", "panic-free"])
        .env("NEARFIELD_EMULATOR_REQUIRED", "1")
        .run()?;
    board::run(&[])?;
    panic_free::prove()?;
    budget::check(false)?;
    eprintln!(
        "everything passed: format, lints, tests, both firmware builds, emulated runs, the board's binary on its \
         model, panic-free proof, budgets"
    );
    Ok(())
}

fn campaign(rest: &[String]) -> Result<()> {
    let mut arguments = vec!["run", "--release", "--package", "nearfield-tests", "--bin", "campaign", "--"];
    arguments.extend(rest.iter().map(String::as_str));
    Step::cargo(&arguments).run()
}

fn emulate() -> Result<()> {
    setup::everything()?;
    firmware::build()?;
    Step::cargo(&["test", "--package", "nearfield-tests", "--test", "emulated*"])
        .env("NEARFIELD_EMULATOR_REQUIRED", "1")
        .run()
}

fn lint() -> Result<()> {
    Step::cargo(&["fmt", "--all", "--check"]).run()?;
    Step::cargo(&["clippy", "--workspace", "--all-targets", "--", "--deny", "warnings"]).run()?;
    let firmware = ["clippy", "--package", "nearfield-firmware", "--target", run::FIRMWARE_TARGET];
    Step::cargo(&[&firmware[..], &["--profile", run::FIRMWARE_PROFILE, "--", "--deny", "warnings"]].concat())
        .run()?;
    // A link that leads nowhere, or to what readers of the documentation cannot see.
    Step::cargo(&["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "--deny warnings").run()
}
