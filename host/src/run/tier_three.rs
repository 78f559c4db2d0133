//! The detector that the configuration asks for, ready to look, behind everybody else.

use std::time::Duration;

use anyhow::{Context as _, bail};
use nearfield_configuration::Detector;
use nearfield_detection::model::{Backend, Choice};
use nearfield_detection::network::Settings;
use nearfield_detection::tiles::Tiling;
use nearfield_detection::watch::Watched;
use nearfield_machine::real_time::step_back;

use super::detector_eye::DetectorEye;

/// Loads it and starts its thread.
///
/// A thread inherits the priority of the one that starts it: the detector is started by one that has stepped back. Call this
/// before anything is asked of [`nearfield_machine::real_time`].
///
/// # Errors
/// The model cannot be used, or there is no thread.
pub fn eye(chosen: &Detector) -> anyhow::Result<DetectorEye<Watched>> {
    let backend = match chosen.backend.as_str() {
        "rten" => Backend::Rten,
        "ort" => Backend::Ort,
        "hailo" => Backend::Hailo,
        other => bail!("detector.backend = \"{other}\" replays files and cannot look at live pictures"),
    };
    let settings = Settings { tiling: Tiling::Windows(5), least_score: None };
    let choice = Choice { model: chosen.model.clone(), backend, settings, second_look: true, threads: 1 };
    let deadline = Duration::from_millis(chosen.deadline_ms.into());
    let start = move || -> anyhow::Result<Watched> {
        step_back();
        Watched::new(choice.load()?, deadline).context("cannot start the detector's thread")
    };
    let starting = std::thread::Builder::new()
        .name("detector start".to_owned())
        .spawn(start)
        .context("cannot start the detector's thread")?;
    let watched =
        starting.join().map_err(|_| anyhow::anyhow!("the detector panicked while it was loaded"))??;
    Ok(DetectorEye::new(watched))
}
