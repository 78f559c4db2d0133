//! `nearfield demo`: a scripted minute through the whole safety path.

use std::io::{IsTerminal as _, stdout};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;

use super::mcu::McuChoice;
use crate::demo::view::{Live, Nobody, PlainLines};
use crate::demo::{Audience, Engine, Outcome, report, script};
use crate::link::{Emulated, InProcess, McuLink};
use crate::twin::gallery::CENTRE;

/// A promise of the script was not kept.
const BROKEN_PROMISE: u8 = 1;

/// Play a minute at the robot's edge: pictures in, relays out, every promise checked.
///
/// The digital twin renders every camera frame, the vision reads it, the line-scan goes to the firmware's own code, and
/// its decisions move the (modelled) relays: reset, a cable, a box, a hand, a lying host, lost, damaged and repeated
/// messages, a dead laser, a covered lens, a frozen camera, a replaying host, a hung controller. Writes DIR/report.html (open it in a browser) and DIR/demo.json (every
/// frame). Exit code 0 if every promise was kept, 1 if not, 2 if it could not be played.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield demo                      live in the terminal, one minute; then open demo/report.html
  nearfield demo --fast --out /tmp/d  as fast as this computer can
  nearfield demo --mcu emulated       the firmware's Arm binary in QEMU decides
  nearfield demo --json | jq .acts    for programs")]
pub struct Demo {
    /// Which safety controller decides.
    #[arg(long, value_enum, default_value_t)]
    mcu: McuChoice,
    /// Directory for the report; it is made if it is not there.
    #[arg(long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,
    /// The whole run as JSON on standard output, and nothing else.
    #[arg(long)]
    json: bool,
    /// Chooses floor pattern, speckle, noise and damaged bits.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// In the live view: do not wait for the clock.
    #[arg(long)]
    fast: bool,
}

impl Demo {
    /// Plays it.
    ///
    /// # Errors
    /// The controller cannot be reached, or a file cannot be written.
    pub fn run(&self) -> anyhow::Result<u8> {
        // Before the minute, not after it: a directory that cannot be made is a mistake to be told at once.
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("{}: cannot make the directory", self.out.display()))?;
        let link: Box<dyn McuLink> = match self.mcu {
            McuChoice::InProcess => Box::new(InProcess::new()),
            McuChoice::Emulated => Box::new(Emulated::new()?),
        };
        let engine = Engine::new(&CENTRE.rig()?, link, self.seed)?;
        let outcome = {
            let mut audience = self.audience()?;
            engine.play(&mut *audience)?
        };
        let json = serde_json::to_string(&outcome.record).context("the run as JSON")?;
        write(&self.out.join("demo.json"), json.as_bytes())?;
        let page = self.out.join("report.html");
        write(&page, report::page(&outcome, &script::minute()).as_bytes())?;
        let said = if self.json { line(&json) } else { summary(&outcome, &page) };
        if !outcome.record.met {
            // Whoever listens or not: a broken promise is told by the exit code.
            return Ok(BROKEN_PROMISE);
        }
        said.map(|()| 0)
    }

    fn audience(&self) -> anyhow::Result<Box<dyn Audience>> {
        Ok(if self.json {
            Box::new(Nobody)
        } else if stdout().is_terminal() {
            Box::new(Live::open(self.fast).context("the terminal cannot show the live view; try `| cat`")?)
        } else {
            Box::new(PlainLines::new(stdout()))
        })
    }
}

fn line(text: &str) -> anyhow::Result<()> {
    say!("{text}");
    Ok(())
}

fn summary(outcome: &Outcome, page: &Path) -> anyhow::Result<()> {
    let record = &outcome.record;
    let (met, all) = record.score();
    say!("{met} of {all} promises kept, {} frames in {:.1} s", record.frames.len(), record.wall_seconds);
    if let Some((median, slowest)) = record.light_reactions() {
        say!("interrupted light to open command: median {median:.0} ms, slowest {slowest:.0} ms");
    }
    for act in record.acts.iter().filter(|act| !act.met()) {
        for check in act.checks.iter().filter(|check| !check.met) {
            say!("FAILED {}: {}; but: {}", act.title, check.expected, check.happened);
        }
    }
    say!("report: {}", page.display());
    Ok(())
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("{}: cannot write", path.display()))
}
