//! Coverage-guided fuzzing of every parser and of the controller's input sequence, on the nightly toolchain.
//!
//! The same functions are called by the stable test `fuzz_corpus` with the committed corpus and seeded changes of it.

use crate::run::{self, Step};
use crate::tools;
use anyhow::{Context as _, Result};
use clap::Args;
use clap::builder::PossibleValuesParser;

/// The targets in `tests/fuzz/fuzz_targets`, named as the functions in `tests/src/fuzz`.
const TARGETS: [&str; 7] = [
    "line_scan",
    "status",
    "compact_rig",
    "service_request",
    "service_page",
    "lockstep_records",
    "controller",
];

/// What is fuzzed.
#[derive(Debug, Args)]
pub struct Options {
    /// This one only; else all of them in turn
    #[arg(value_name = "TARGET", value_parser = PossibleValuesParser::new(TARGETS))]
    pub target: Option<String>,
    /// How long each target is fed
    #[arg(long, value_name = "N", default_value_t = 60)]
    pub seconds: u32,
}

/// Fuzzes one target, or all of them in turn.
pub fn run(options: &Options) -> Result<()> {
    let wanted = options.target.as_deref();
    let targets = TARGETS.into_iter().filter(|target| wanted.is_none_or(|wanted| wanted == *target));
    tools::nightly(None)?;
    tools::FUZZ.ensure()?;
    let limit = format!("-max_total_time={}", options.seconds);
    let target_directory = run::target_directory().join("fuzz").display().to_string();
    for target in targets {
        // What libFuzzer finds goes to the first folder; the committed corpus is only read.
        let found = run::target_directory().join("fuzz-corpus").join(target);
        std::fs::create_dir_all(&found).with_context(|| found.display().to_string())?;
        let (found, committed) = (found.display().to_string(), format!("tests/corpus/{target}"));
        let fuzz = ["run", "nightly", "cargo", "fuzz", "run", "--fuzz-dir", "tests/fuzz"];
        let arguments = [&fuzz[..], &["--target-dir", &target_directory, target]].concat();
        let corpora = [&found, &committed, "--", &limit, "-max_len=8192", "-print_final_stats=1"];
        Step::program("rustup", &[&arguments[..], &corpora].concat())
            .without("RUSTUP_TOOLCHAIN")
            .without("CARGO")
            .run()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_target_has_its_program_and_its_corpus() {
        for target in TARGETS {
            let program = run::root().join("tests/fuzz/fuzz_targets").join(target).with_extension("rs");
            assert!(program.is_file(), "{}", program.display());
            let corpus = run::root().join("tests/corpus").join(target);
            let inputs = std::fs::read_dir(&corpus).map(Iterator::count).unwrap_or(0);
            assert!(inputs > 0, "no input in {}", corpus.display());
        }
    }
}
