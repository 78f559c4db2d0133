//! Runs the board's unmodified binary on a register-level model of the STM32G474 (Unicorn, in Python), and injects faults
//! into it. It proves logic, not silicon; see tests/board/README.md.

use crate::run::{self, Step};
use crate::tools::with_options;
use anyhow::{Context as _, Result};
use clap::Args;
use std::path::PathBuf;

/// The Python environment with the pinned tools, made once.
fn environment() -> Result<PathBuf> {
    let directory = run::target_directory().join("board-venv");
    let python = directory.join("bin").join("python");
    let requirements = run::root().join("tests").join("board").join("requirements.txt");
    let pinned = std::fs::read_to_string(&requirements)
        .with_context(|| format!("the tools' list {}", requirements.display()))?;
    let done = directory.join("installed.txt");
    if std::fs::read_to_string(&done).is_ok_and(|installed| installed == pinned) {
        return Ok(python);
    }
    let path = |path: &PathBuf| path.display().to_string();
    Step::program("python3", &["-m", "venv", &path(&directory)]).run().context(
        "the register-level model needs Python 3.9 or later with its module venv (Debian: python3-venv)",
    )?;
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--requirement"];
    Step::program(&path(&python), &[&install[..], &[&path(&requirements)]].concat())
        .run()
        .context("pip could not install the model's tools; it needs a way to PyPI")?;
    std::fs::write(&done, pinned).with_context(|| done.display().to_string())?;
    Ok(python)
}

/// Those of `tests/board/run.py`.
#[derive(Debug, Args)]
pub struct Options {
    /// Name the scenarios and end
    #[arg(long)]
    list: bool,
    /// Play these scenarios only; may be repeated
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// One JSON object a line on standard output
    #[arg(long)]
    json: bool,
    /// Random bits of the controller's memory that are flipped
    #[arg(long, value_name = "N", default_value_t = FLIPS)]
    flips: u32,
    /// Seed of the random bits
    #[arg(long, value_name = "N", default_value_t = SEED)]
    seed: u64,
}

const FLIPS: u32 = 24;
const SEED: u64 = 1;

impl Default for Options {
    fn default() -> Self {
        Self { list: false, only: Vec::new(), json: false, flips: FLIPS, seed: SEED }
    }
}

/// Plays the scenarios.
pub fn run(options: &Options) -> Result<()> {
    let python = environment()?.display().to_string();
    let script = run::root().join("tests").join("board").join("run.py").display().to_string();
    let elf = run::firmware_elf("stm32g474").display().to_string();
    let host = std::env::current_exe().context("where this chore's program is")?.display().to_string();
    let program = [script.as_str(), "--elf", &elf, "--host", &host];
    let mut values: Vec<_> = options.only.iter().map(|name| ("--only", name.clone())).collect();
    values.extend([("--flips", options.flips.to_string()), ("--seed", options.seed.to_string())]);
    let arguments = with_options(&program, &values, &[("--list", options.list), ("--json", options.json)]);
    Step::program(&python, &arguments.iter().map(String::as_str).collect::<Vec<_>>()).run()
}
