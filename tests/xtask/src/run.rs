//! Runs one step of a chore and says what failed.

use anyhow::{Context as _, Result, bail};
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// The microcontroller's Rust target.
pub const FIRMWARE_TARGET: &str = "thumbv7em-none-eabihf";
/// The profile in which the firmware is built.
pub const FIRMWARE_PROFILE: &str = "firmware";

/// The repository's root.
pub fn root() -> PathBuf {
    let manifest = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    manifest.ancestors().nth(2).map_or(manifest.clone(), PathBuf::from)
}

/// Where cargo puts what it builds.
pub fn target_directory() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from)
}

/// The built firmware of this name.
pub fn firmware_elf(name: &str) -> PathBuf {
    target_directory().join(FIRMWARE_TARGET).join(FIRMWARE_PROFILE).join(name)
}

/// A command to run from the repository's root.
pub struct Step {
    command: Command,
    words: String,
}

impl Step {
    /// Any program.
    pub fn program(program: &str, arguments: &[&str]) -> Self {
        let mut command = Command::new(program);
        command.args(arguments).current_dir(root());
        Self { command, words: format!("{program} {}", arguments.join(" ")) }
    }

    /// The cargo that runs this chore.
    pub fn cargo(arguments: &[&str]) -> Self {
        let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
        let mut step = Self::program(&cargo, arguments);
        step.words = format!("cargo {}", arguments.join(" "));
        step
    }

    /// With a variable in its environment.
    pub fn env(mut self, name: &str, value: &str) -> Self {
        self.command.env(name, value);
        self
    }

    /// Without a variable of this process's environment.
    pub fn without(mut self, name: &str) -> Self {
        self.command.env_remove(name);
        self
    }

    /// Runs it, its output shown; an error if it does not succeed.
    pub fn run(self) -> Result<()> {
        self.run_with_codes(&[0])
    }

    /// Runs it, its output shown; an error unless it ends with one of these exit codes.
    pub fn run_with_codes(mut self, expected: &[i32]) -> Result<()> {
        eprintln!("\n== {}", self.words);
        let status = self.command.status().with_context(|| format!("cannot start `{}`", self.words))?;
        if !status.code().is_some_and(|code| expected.contains(&code)) {
            bail!("`{}` failed ({status})", self.words);
        }
        Ok(())
    }

    /// Runs it silently; gives what it printed for programs, or an error with what it printed for people.
    pub fn standard_output(mut self) -> Result<String> {
        let output = self.command.stdin(Stdio::null()).output();
        let output = output.with_context(|| format!("cannot start `{}`", self.words))?;
        if !output.status.success() {
            bail!("`{}` failed:\n{}", self.words, String::from_utf8_lossy(&output.stderr));
        }
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// Runs it silently; gives success and all that it printed.
    pub fn capture(mut self) -> Result<(bool, String)> {
        let output = self
            .command
            .stdin(Stdio::null())
            .output()
            .with_context(|| format!("cannot start `{}`", self.words))?;
        let text =
            [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        Ok((output.status.success(), text))
    }
}
