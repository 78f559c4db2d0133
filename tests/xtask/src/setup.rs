//! Installs what the chores need, or says in clear words what a person has to install.

use crate::run::{FIRMWARE_TARGET, Step};
use anyhow::{Context as _, Result, bail};

/// The emulator of the microcontroller.
pub const QEMU: &str = "qemu-system-arm";

/// All that any chore needs.
pub fn everything() -> Result<()> {
    firmware_target()?;
    emulator()
}

/// The microcontroller's Rust target. (rust-toolchain.toml names it too, but rustup ignores that list where the
/// toolchain itself is already there.)
pub fn firmware_target() -> Result<()> {
    let (_, installed) = rustup(&["target", "list", "--installed"])?;
    if installed.lines().any(|line| line.trim() == FIRMWARE_TARGET) {
        return Ok(());
    }
    Step::program("rustup", &["target", "add", FIRMWARE_TARGET]).run()
}

/// rustfmt and clippy.
pub fn components() -> Result<()> {
    let (_, installed) = rustup(&["component", "list", "--installed"])?;
    for component in ["rustfmt", "clippy"] {
        if !installed.lines().any(|line| line.starts_with(component)) {
            Step::program("rustup", &["component", "add", component]).run()?;
        }
    }
    Ok(())
}

fn rustup(arguments: &[&str]) -> Result<(bool, String)> {
    Step::program("rustup", arguments)
        .capture()
        .context("rustup is needed to set up the microcontroller's target; see https://rustup.rs")
}

/// Debian packages, through apt, as root or with sudo.
pub fn install(packages: &[&str]) -> Result<()> {
    let root = Step::program("id", &["-u"]).capture().is_ok_and(|(_, user)| user.trim() == "0");
    let apt = |arguments: &[&str]| {
        let step = if root {
            Step::program("apt-get", arguments)
        } else {
            Step::program("sudo", &[&["--non-interactive", "apt-get"], arguments].concat())
        };
        step.env("DEBIAN_FRONTEND", "noninteractive").run()
    };
    apt(&["update", "--quiet"])?;
    apt(&[&["install", "--yes", "--quiet", "--no-install-recommends"], packages].concat())
}

/// QEMU, through apt where that is possible.
fn emulator() -> Result<()> {
    if Step::program(QEMU, &["--version"]).capture().is_ok_and(|(success, _)| success) {
        return Ok(());
    }
    if let Err(error) = install(&[QEMU]) {
        bail!(
            "the emulator `{QEMU}` is missing and could not be installed ({error:#}). Install it by hand: \
             Debian/Ubuntu `apt-get install qemu-system-arm`, Fedora `dnf install qemu-system-arm`, \
             macOS `brew install qemu`; version 7.2 or later"
        );
    }
    Ok(())
}
