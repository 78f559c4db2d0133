//! The ROS 2 outlet against another participant of ours, and against an implementation of DDS that is not ours.

use crate::run::{Step, root, target_directory};
use crate::tools;
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
    let python = tools::python_with("ros2-venv", "cyclonedds", &[LISTENER])?;
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
