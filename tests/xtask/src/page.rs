//! The operator's page in a real browser: by keyboard, with and without the token, at a telephone's width, for screen readers.

use crate::run::{Step, root, target_directory};
use crate::{setup, tools};
use anyhow::Result;

/// Drives a browser that is installed already, and judges what a screen reader gets; both from PyPI.
const PACKAGES: [&str; 2] = ["playwright==1.65.2", "axe-playwright-python==0.1.8"];
/// The names under which Chromium and its sisters are installed.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// Needs PyPI and a browser the first time; leaves screenshots in `target/page`.
pub fn check() -> Result<()> {
    let browser = browser()?;
    let python = tools::python_with("page-venv", "axe_playwright_python.sync_playwright", &PACKAGES)?;
    Step::cargo(&["build", "--release", "--package", "nearfield-host", "--bin", "nearfield"]).run()?;
    let path = |path: std::path::PathBuf| path.display().to_string();
    let script = path(root().join("host/operator/tests/browser.py"));
    let program = path(target_directory().join("release").join("nearfield"));
    let out = path(target_directory().join("page"));
    let arguments = [&script, "--program", &program, "--browser", &browser, "--out", &out];
    Step::program(&python, &arguments).run()?;
    eprintln!("\nscreenshots: {out}");
    Ok(())
}

fn browser() -> Result<String> {
    if let Some(found) = installed() {
        return Ok(found);
    }
    let problem = setup::install(&["chromium"]).err();
    installed().ok_or_else(|| {
        let why = problem.map_or_else(String::new, |error| format!(" ({error:#})"));
        anyhow::anyhow!(
            "a browser is missing and could not be installed{why}. Install it by hand: Debian `apt-get install chromium`"
        )
    })
}

fn installed() -> Option<String> {
    BROWSERS.iter().find_map(|name| {
        let (found, place) = Step::program("which", &[name]).capture().ok()?;
        found.then(|| place.trim().to_owned())
    })
}
