//! The host's program for the Raspberry Pi: cross-built, tested for its processor under QEMU, and packed.

use crate::run::{Step, target_directory};
use crate::{setup, tools};
use anyhow::{Context as _, Result};
use clap::Args;

const TARGET: &str = "aarch64-unknown-linux-gnu";
const LINKER: &str = "aarch64-linux-gnu-gcc";
/// Runs programs of the Pi's processor on this one.
const EMULATOR: &str = "qemu-aarch64";
const LIBRARIES: &str = "/usr/aarch64-linux-gnu";
/// What runs on the Pi: the unit tests of each of these. Rendering of training pictures and the study of a mount are a desk's work
/// (nearfield-objects, nearfield-study), ROS 2 is behind a feature and has a chore of its own.
const PACKAGES: [&str; 12] = [
    "nearfield-shared",
    "nearfield-firmware",
    "nearfield-commissioning",
    "nearfield-configuration",
    "nearfield-detection",
    "nearfield-fields",
    "nearfield-fleet",
    "nearfield-fusion",
    "nearfield-host",
    "nearfield-machine",
    "nearfield-operator",
    "nearfield-recording",
];
/// Unit tests that are left out: an emulated processor takes more than five minutes for it, and the twin's moving pictures are
/// made on a desk.
const TOO_SLOW: [&str; 1] =
    ["twin::render::tests::a_moving_scene_gives_the_same_pictures_on_any_number_of_threads_and_in_every_run"];
/// Tests of the program as people call it. Left out are `new_rig`, the plan of a mount that is made at a desk (many pictures of the
/// twin, one after the other), and `run_soak`, whose figures say something of the computer that it runs on, and of no emulated one.
const PROGRAM_TESTS: [&str; 5] = ["bad_input", "detect", "extract", "run_command", "run_commission"];

fn cross_compiler() -> Result<()> {
    Step::program("rustup", &["target", "add", TARGET]).run()?;
    if Step::program(LINKER, &["--version"]).capture().is_ok_and(|(success, _)| success) {
        return Ok(());
    }
    setup::install(&["gcc-aarch64-linux-gnu", "libc6-dev-arm64-cross"]).with_context(|| {
        format!(
            "{LINKER} is missing; install it by hand: Debian/Ubuntu `apt-get install gcc-aarch64-linux-gnu`"
        )
    })
}

fn emulator() -> Result<()> {
    if Step::program(EMULATOR, &["--version"]).capture().is_ok_and(|(success, _)| success) {
        return Ok(());
    }
    setup::install(&["qemu-user"]).with_context(|| {
        format!("{EMULATOR} is missing; install it by hand: Debian/Ubuntu `apt-get install qemu-user`")
    })
}

fn cross(arguments: &[&str]) -> Step {
    let runner = format!("{EMULATOR} -L {LIBRARIES}");
    Step::cargo(arguments)
        .env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", LINKER)
        .env("CC_aarch64_unknown_linux_gnu", LINKER)
        .env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER", &runner)
        // For the programs that tests start.
        .env("NEARFIELD_RUNNER", &runner)
}

/// The program.
pub fn build() -> Result<()> {
    cross_compiler()?;
    cross(&["build", "--release", "--package", "nearfield-host", "--target", TARGET]).run()?;
    let program = target_directory().join(TARGET).join("release").join("nearfield");
    eprintln!("\n{}: built, not run on hardware", program.display());
    Ok(())
}

/// Which tests.
#[derive(Debug, Args)]
pub struct Options {
    /// The unit tests of these packages only; else those of all that run on the Pi, and the tests of the program
    #[arg(value_name = "PACKAGE")]
    packages: Vec<String>,
}

/// Tests under QEMU, as they are built for the Pi: vision in its vector instructions (NEON), the detector's network too.
pub fn test(options: &Options) -> Result<()> {
    cross_compiler()?;
    emulator()?;
    let packages = &options.packages;
    let chosen: Vec<&str> =
        if packages.is_empty() { PACKAGES.to_vec() } else { packages.iter().map(String::as_str).collect() };
    let mut unit_tests = vec!["test", "--release", "--target", TARGET, "--lib"];
    for package in chosen {
        unit_tests.extend(["--package", package]);
    }
    unit_tests.push("--");
    unit_tests.extend(TOO_SLOW.iter().flat_map(|test| ["--skip", test]));
    cross(&unit_tests).run()?;
    if !packages.is_empty() {
        return Ok(());
    }
    let mut program_tests = vec!["test", "--release", "--target", TARGET, "--package", "nearfield-host"];
    program_tests.extend(PROGRAM_TESTS.iter().flat_map(|test| ["--test", test]));
    cross(&program_tests).run()
}

/// The Debian package.
pub fn package() -> Result<()> {
    tools::DEB.ensure()?;
    build()?;
    // The debugging information, five sixths of the program, stays in the build's own directory.
    let program = target_directory().join(TARGET).join("release").join("nearfield");
    let arguments = ["deb", "--no-build", "--strip", "--package", "nearfield-host", "--target", TARGET];
    cross(&arguments).run()?;
    eprintln!("\nmade from {}: built, not installed on hardware", program.display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::root;
    use anyhow::Result;

    /// What is left out by a name that nothing has any more would be run again unnoticed; a program test that is not there would
    /// only be missed by who runs all of it.
    #[test]
    fn what_is_named_is_there() -> Result<()> {
        for test in TOO_SLOW {
            let (module, name) = test.split_once("::tests::").context("a unit test")?;
            let file = root().join("host/src").join(module.replace("::", "/")).join("tests.rs");
            let source = std::fs::read_to_string(&file).with_context(|| file.display().to_string())?;
            assert!(source.contains(&format!("fn {name}(")), "{test}");
        }
        for test in PROGRAM_TESTS {
            let folder = root().join("host/tests");
            let is_there =
                folder.join(test).join("main.rs").exists() || folder.join(test).with_extension("rs").exists();
            assert!(is_there, "{test}");
        }
        Ok(())
    }
}
