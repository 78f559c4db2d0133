//! Half a minute of training on toy pictures: drawing, learning, going on after a stop, exporting, being judged.

use crate::run::{Step, root, target_directory};
use anyhow::Result;

/// Pictures have this side, pixels; small ones are learnt from quickly.
const SIDE: &str = "96";

/// Needs PyPI the first time, for PyTorch.
pub fn run() -> Result<()> {
    let target = target_directory();
    let environment = target.join("training-environment");
    let path = |path: &std::path::Path| path.display().to_string();
    if !environment.join("bin/python").exists() {
        Step::program("python3", &["host/training/setup_environment.py", &path(&environment)]).run()?;
    }
    let folder = target.join("train-smoke");
    if folder.exists() {
        std::fs::remove_dir_all(&folder)?;
    }
    let (data, out, export) =
        (path(&folder.join("data")), path(&folder.join("run")), path(&folder.join("export")));
    let training = |arguments: &[&str]| {
        let python = path(&environment.join("bin/python"));
        Step::program(&python, &[&["-m", "nearfield_training"], arguments].concat())
            .env("PYTHONPATH", &path(&root().join("host/training")))
            .env("OMP_WAIT_POLICY", "PASSIVE")
            .run()
    };
    training(&["toy", "--out", &data, "--images", "200", "--side", SIDE])?;
    // The second call finds the first one's checkpoint and goes on.
    for epochs in ["2", "4"] {
        training(&[
            "train", "--data", &data, "--out", &out, "--side", SIDE, "--batch", "8", "--epochs", epochs,
        ])?;
    }
    training(&["export", "--weights", &format!("{out}/best.pt"), "--out", &export])?;
    let model = format!("{export}/detector.onnx");
    let validation = format!("{data}/val");
    let evaluate =
        ["evaluate", "--model", model.as_str(), "--dataset", validation.as_str(), "--windows", "1"];
    let nearfield = ["run", "--release", "--package", "nearfield-host", "--bin", "nearfield", "--"];
    Step::cargo(&[&nearfield[..], &evaluate[..]].concat()).run()
}
