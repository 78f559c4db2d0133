//! The ROS 2 outlet against another participant of ours, and against an implementation of DDS that is not ours.

use crate::run::{Step, root, target_directory};
use anyhow::{Context as _, Result};
use std::process::{Command, Stdio};

/// The independent implementation, from PyPI.
const LISTENER: &str = "cyclonedds==11.0.1";
/// A domain in which no robot listens.
const DOMAIN: &str = "202";

/// Needs PyPI the first time.
pub fn check() -> Result<()> {
    Step::cargo(&["test", "--release", "--package", "nearfield-ros2", "--features", "dds"]).run()?;
    let example = ["--package", "nearfield-ros2", "--features", "dds", "--example", "made_up_sensor"];
    Step::cargo(&[&["build", "--release"], &example[..]].concat()).run()?;
    let python = environment()?;
    let program = target_directory().join("release").join("examples").join("made_up_sensor");
    let mut sensor = Command::new(&program)
        .args([DOMAIN, "3600"])
        .stdout(Stdio::null())
        .spawn()
        .with_context(|| program.display().to_string())?;
    let script = root().join("host/ros2/tests/listener.py").display().to_string();
    let listened =
        Step::program(&python, &[&script, "--domain", DOMAIN, "--loopback", "--seconds", "20"]).run();
    sensor.kill().context("the sensor cannot be ended")?;
    sensor.wait().context("the sensor cannot be ended")?;
    listened
}

fn environment() -> Result<String> {
    let directory = target_directory().join("ros2-venv");
    let python = directory.join("bin").join("python").display().to_string();
    let is_there = Step::program(&python, &["-c", "import cyclonedds"]).capture();
    if !is_there.is_ok_and(|(success, _)| success) {
        Step::program("python3", &["-m", "venv", &directory.display().to_string()])
            .run()
            .context("needs Python 3.9 or later with its module venv (Debian: python3-venv)")?;
        let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", LISTENER];
        Step::program(&python, &install).run().context("needs a way to PyPI")?;
    }
    Ok(python)
}
