//! The long fault-injection campaign; `cargo xtask campaign` runs it.

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use nearfield_host::link::{InProcess, LinkError, McuLink};
use nearfield_tests::campaign::{Findings, Scenes, run};
use nearfield_tests::stage::Stage;
use rayon::prelude::*;
use std::process::ExitCode;

/// Inject every fault, alone and in pairs, at random times, and hold the controller to its stated times.
///
/// Prints the worst time to open of every fault as Markdown. Exit code 0 if every promise was kept and nothing stopped
/// without a reason.
#[derive(Debug, Parser)]
struct Campaign {
    /// Frames to play, over all parts.
    #[arg(long, default_value_t = 1_200_000)]
    frames: u64,
    /// First seed; every part has its own.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Parts, each a robot of its own; the same number gives the same run on any machine.
    #[arg(long, default_value_t = 32)]
    parts: u64,
    /// One JSON object instead of the table.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    let campaign = Campaign::parse();
    match campaign.play() {
        Ok(findings) => campaign.report(&findings),
        Err(error) => {
            eprintln!("campaign: {error}");
            ExitCode::from(2)
        }
    }
}

impl Campaign {
    fn play(&self) -> Result<Findings, LinkError> {
        let stage = Stage::new();
        let scenes = Scenes::new(&stage);
        let bar = ProgressBar::new(self.frames);
        if let Ok(style) = ProgressStyle::with_template("{wide_bar} {pos}/{len} frames, {eta} left") {
            bar.set_style(style);
        }
        let parts = self.parts.max(1);
        let played: Result<Vec<Findings>, LinkError> = (0..parts)
            .into_par_iter()
            .map(|part| {
                let link = || Ok(Box::new(InProcess::new()) as Box<dyn McuLink>);
                let mut before = 0;
                let progress = |frames: u64| {
                    bar.inc(frames - before);
                    before = frames;
                };
                run(&stage, &scenes, self.seed + part, self.frames / parts, link, progress)
            })
            .collect();
        bar.finish_and_clear();
        let mut all = Findings::default();
        played?.into_iter().for_each(|findings| all.add(findings));
        Ok(all)
    }

    fn report(&self, findings: &Findings) -> ExitCode {
        let kept = findings.broken.is_empty() && findings.false_stops == 0;
        if self.json {
            let alone: serde_json::Map<_, _> = findings
                .alone
                .iter()
                .map(|(name, seen)| {
                    let worst = seen.worst.get() as f64 / 1000.0;
                    let value = serde_json::json!({ "injections": seen.injections, "worst_ms": worst });
                    (name.clone(), value)
                })
                .collect();
            let report = serde_json::json!({
                "frames": findings.frames, "pairs": findings.pairs, "clean_frames": findings.clean_frames,
                "false_stops": findings.false_stops, "broken": findings.broken, "faults": alone,
            });
            println!("{report}");
        } else {
            println!("{}\n", findings.table());
            println!(
                "{} frames (seeds {} to {}), {} pairs of faults; {} frames without a fault, {} false stops",
                findings.frames,
                self.seed,
                self.seed + self.parts.max(1) - 1,
                findings.pairs,
                findings.clean_frames,
                findings.false_stops
            );
            for broken in &findings.broken {
                println!("BROKEN {broken}");
            }
        }
        if kept { ExitCode::SUCCESS } else { ExitCode::FAILURE }
    }
}
