//! `cargo xtask bench`: one table of what a frame costs, against the sum of the bytes that it reads.

use anyhow::{Context as _, Result};
use serde::Deserialize;
use std::path::Path;

use crate::run::{Step, target_directory};

/// Criterion's estimates of one measurement, nanoseconds.
#[derive(Deserialize)]
struct Estimates {
    median: Estimate,
}

#[derive(Deserialize)]
struct Estimate {
    point_estimate: f64,
}

/// Layouts with the goal for the extraction, in byte-sums of the plane that it reads.
const LAYOUTS: [(&str, f64); 2] = [("yuv420", 3.0), ("rgb", 2.0)];
const SCENES: [&str; 3] = ["clean", "crowded", "weak"];
const STAGES: [&str; 2] = ["extract", "whole-path"];
/// Goal for extraction, tiers and line-scan together, milliseconds.
const WHOLE_PATH_GOAL_MS: f64 = 1.0;

/// Measures, then prints the table.
///
/// # Errors
/// The benchmark cannot be run, or has not left its figures.
pub fn table() -> Result<()> {
    Step::cargo(&["bench", "--package", "nearfield-host", "--bench", "frame"]).run()?;
    let directory = target_directory().join("criterion").join("frame");
    println!("\none frame of 2304 x 1296, one thread, medians");
    println!("{:<8} {:<9} {:<12} {:>9} {:>11}   goal", "layout", "scene", "stage", "ms", "byte-sums");
    for (layout, goal) in LAYOUTS {
        let floor = median_ms(&directory, &format!("{layout}_byte-sum"))?;
        println!("{layout:<8} {:<9} {:<12} {floor:>9.3} {:>11.1}", "", "byte-sum", 1.0);
        for scene in SCENES {
            for stage in STAGES {
                let time = median_ms(&directory, &format!("{layout}_{scene}_{stage}"))?;
                let (met, wanted) = match stage {
                    "extract" => (time <= goal * floor, format!("<= {goal:.0} byte-sums")),
                    _ => (time <= WHOLE_PATH_GOAL_MS, format!("<= {WHOLE_PATH_GOAL_MS:.0} ms")),
                };
                let verdict = if met { "met" } else { "MISSED" };
                println!(
                    "{layout:<8} {scene:<9} {stage:<12} {time:>9.3} {:>11.1}   {wanted}: {verdict}",
                    time / floor
                );
            }
        }
    }
    Ok(())
}

/// The median that criterion kept for one measurement, milliseconds.
fn median_ms(directory: &Path, measurement: &str) -> Result<f64> {
    let path = directory.join(measurement).join("new").join("estimates.json");
    let text = std::fs::read_to_string(&path)
        .with_context(|| format!("{}: the benchmark has left no figures", path.display()))?;
    let estimates: Estimates =
        serde_json::from_str(&text).with_context(|| format!("{}: not criterion's", path.display()))?;
    Ok(estimates.median.point_estimate / 1e6)
}
