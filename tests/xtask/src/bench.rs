//! `cargo xtask bench`: one table of what a frame costs, against the sum of the bytes that it reads and against the
//! source paper's pipeline in OpenCV.

use anyhow::Result;
use std::path::{Path, PathBuf};

use crate::run::{Step, root, target_directory};

/// The OpenCV that is compared with.
const OPENCV: &str = "opencv-python-headless==5.0.0.93";

/// Measures and prints the table; without Python or a way to its packages the row about OpenCV says so.
///
/// # Errors
/// The benchmark cannot be built or run.
pub fn table() -> Result<()> {
    let script = path(&root().join("host").join("benches").join("paper_pipeline.py"));
    let mut arguments = vec!["bench", "--package", "nearfield-host", "--bench", "ratios", "--"];
    let python = match environment() {
        Ok(python) => Some(path(&python)),
        Err(error) => {
            eprintln!("the paper's pipeline in OpenCV is left out: {error:#}");
            None
        }
    };
    if let Some(python) = &python {
        arguments.extend([python.as_str(), &script]);
    }
    Step::cargo(&arguments).run()
}

/// A Python with OpenCV of its own, made once.
fn environment() -> Result<PathBuf> {
    let directory = target_directory().join("bench-venv");
    let python = directory.join("bin").join("python");
    let done = directory.join("installed.txt");
    if std::fs::read_to_string(&done).is_ok_and(|installed| installed == OPENCV) {
        return Ok(python);
    }
    Step::program("python3", &["-m", "venv", &path(&directory)]).run()?;
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", OPENCV];
    Step::program(&path(&python), &install).run()?;
    std::fs::write(&done, OPENCV)?;
    Ok(python)
}

fn path(path: &Path) -> String {
    path.display().to_string()
}
