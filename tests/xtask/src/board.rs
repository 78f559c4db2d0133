//! Runs the board's unmodified binary on a register-level model of the STM32G474 (Unicorn, in Python), and injects faults
//! into it. It proves logic, not silicon; see tests/board/README.md.

use crate::run::{self, Step};
use anyhow::{Context as _, Result};
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

/// Plays the scenarios; further arguments go to `tests/board/run.py`.
pub fn run(arguments: &[String]) -> Result<()> {
    let python = environment()?.display().to_string();
    let script = run::root().join("tests").join("board").join("run.py").display().to_string();
    let elf = run::firmware_elf("stm32g474").display().to_string();
    let host = std::env::current_exe().context("where this chore's program is")?.display().to_string();
    let mut all = vec![script.as_str(), "--elf", &elf, "--host", &host];
    all.extend(arguments.iter().map(String::as_str));
    Step::program(&python, &all).run()
}
