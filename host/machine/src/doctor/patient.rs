//! The computer that is looked at: its files, its programs, its GPIO chips.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// What a program prints; `None` = it is not there, fails, or does not end.
type Ask = Box<dyn Fn(&str, &[&str]) -> Option<String>>;

/// A computer.
pub struct Patient {
    /// `/`, or a made-up tree.
    root: PathBuf,
    ask: Ask,
    chips: Vec<String>,
}

/// No question takes longer.
const LONGEST_ANSWER: Duration = Duration::from_secs(10);

impl Patient {
    /// This computer.
    #[must_use]
    pub fn this() -> Self {
        Self { root: PathBuf::from("/"), ask: Box::new(run), chips: chip_labels() }
    }

    /// A made-up one: files below `root`, answers of programs, labels of GPIO chips.
    #[must_use]
    pub fn made_up(
        root: &Path,
        ask: impl Fn(&str, &[&str]) -> Option<String> + 'static,
        chips: &[&str],
    ) -> Self {
        let chips = chips.iter().map(|label| (*label).to_owned()).collect();
        Self { root: root.to_path_buf(), ask: Box::new(ask), chips }
    }

    /// Where a file of the computer lies.
    pub(super) fn path(&self, absolute: &Path) -> PathBuf {
        self.root.join(absolute.strip_prefix("/").unwrap_or(absolute))
    }

    /// A small file's text without blanks and zero bytes at its ends.
    pub(super) fn text(&self, absolute: &str) -> Option<String> {
        let bytes = std::fs::read(self.path(Path::new(absolute))).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        Some(text.trim_matches(|c: char| c.is_whitespace() || c == '\0').to_owned())
    }

    pub(super) fn exists(&self, absolute: &Path) -> bool {
        self.path(absolute).exists()
    }

    pub(super) fn ask(&self, program: &str, arguments: &[&str]) -> Option<String> {
        (self.ask)(program, arguments)
    }

    pub(super) fn chips(&self) -> &[String] {
        &self.chips
    }
}

fn run(program: &str, arguments: &[&str]) -> Option<String> {
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .ok()?;
    let begun = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(_)) => break,
            Ok(None) if begun.elapsed() < LONGEST_ANSWER => std::thread::sleep(Duration::from_millis(20)),
            _ => {
                // It may have ended by itself meanwhile.
                let _ = child.kill();
                let _ = child.wait();
                return None;
            }
        }
    }
    // What these programs print fits into a pipe's buffer.
    let output = child.wait_with_output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

#[cfg(target_os = "linux")]
fn chip_labels() -> Vec<String> {
    let Ok(paths) = gpiocdev::chip::chips() else { return Vec::new() };
    let label = |path| Some(gpiocdev::Chip::from_path(path).ok()?.info().ok()?.label);
    paths.into_iter().filter_map(label).collect()
}

#[cfg(not(target_os = "linux"))]
const fn chip_labels() -> Vec<String> {
    Vec::new()
}
