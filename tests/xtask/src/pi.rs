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
/// What runs on the Pi, without the studies and the twin, which take an emulated processor for ever.
const PACKAGES: [&str; 10] = [
    "nearfield-shared",
    "nearfield-firmware",
    "nearfield-commissioning",
    "nearfield-configuration",
    "nearfield-fields",
    "nearfield-fleet",
    "nearfield-fusion",
    "nearfield-machine",
    "nearfield-operator",
    "nearfield-recording",
];

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
    Step::cargo(arguments)
        .env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", LINKER)
        .env("CC_aarch64_unknown_linux_gnu", LINKER)
        .env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER", &format!("{EMULATOR} -L {LIBRARIES}"))
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
    /// The unit tests of these packages only; else those of all that run on the Pi
    #[arg(value_name = "PACKAGE")]
    packages: Vec<String>,
}

/// Tests under QEMU.
pub fn test(options: &Options) -> Result<()> {
    cross_compiler()?;
    emulator()?;
    let packages = &options.packages;
    let chosen: Vec<&str> =
        if packages.is_empty() { PACKAGES.to_vec() } else { packages.iter().map(String::as_str).collect() };
    // As it is built for the Pi.
    let mut arguments = vec!["test", "--release", "--target", TARGET, "--lib"];
    for package in chosen {
        arguments.extend(["--package", package]);
    }
    cross(&arguments).run()
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
