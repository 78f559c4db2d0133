//! Judges all mutants of the safety core in one build.
//!
//! cargo-mutants builds the package anew for each mutant: some seconds each, and there are more than two thousand. Here
//! all mutants of cargo-mutants' list are put into one copy of the source, each behind a switch that an environment variable
//! turns on when the tests start. What cannot be switched (a guard that binds a name, code that the compiler itself
//! evaluates) or survives is left to cargo-mutants. Used by `cargo xtask mutants`.

mod judge;
mod mutant;
mod places;
mod rewrite;
mod workspace;

use anyhow::{Context as _, Result, bail};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use judge::{TestProgram, Verdict};
use mutant::Mutant;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Judges all mutants of the safety core in one build.
#[derive(Parser)]
struct Options {
    /// The repository's root.
    #[arg(long)]
    root: PathBuf,
    /// Where the copy is made; what it builds comes beside it.
    #[arg(long)]
    tree: PathBuf,
    /// The list of mutants: what `cargo mutants --list --json` printed.
    #[arg(long)]
    list: PathBuf,
    /// Where the verdicts go: JSON, by the mutants' names.
    #[arg(long)]
    verdicts: PathBuf,
    /// Tests to be left out at first, as `package:test`.
    #[arg(long)]
    slow: Vec<String>,
    /// Processor time of one run of the tests, seconds.
    #[arg(long, default_value_t = 60)]
    processor_seconds: u32,
    /// Runs at once.
    #[arg(long, default_value_t = 2)]
    jobs: usize,
}

fn main() -> Result<()> {
    let options = Options::parse();
    let mutants: BTreeMap<u32, Mutant> = (1..).zip(mutant::read_list(&options.list)?).collect();
    let mut workspace = workspace::Workspace::copy(&options.root, &options.tree)?;
    // What the compiler evaluates would never see its switch turned on.
    let in_functions = mutants.iter().filter(|(_, mutant)| mutant.function.is_some());
    let put_in =
        workspace.put_in(&in_functions.map(|(number, mutant)| (*number, mutant.clone())).collect())?;
    eprintln!(
        "{} of {} mutants can be switched on; {} do not compile",
        put_in.switched.len(),
        mutants.len(),
        put_in.unviable.len()
    );
    let programs = test_programs(&options, &workspace, &mutants)?;
    let verdicts = Verdicts::new(&options.verdicts, &mutants, &put_in.unviable);
    judge_all(&options, &programs, &mutants, &put_in.switched, &verdicts)?;
    let verdicts = verdicts.finish()?;
    for word in ["caught", "unviable", "timeout", "missed"] {
        println!("{word}: {}", verdicts.values().filter(|verdict| **verdict == word).count());
    }
    println!("not judged: {}", mutants.len() - verdicts.len());
    Ok(())
}

fn test_programs(
    options: &Options,
    workspace: &workspace::Workspace,
    mutants: &BTreeMap<u32, Mutant>,
) -> Result<BTreeMap<String, TestProgram>> {
    let built = workspace.build()?;
    let packages: BTreeSet<&str> = mutants.values().map(|mutant| mutant.package.as_str()).collect();
    let mut programs = BTreeMap::new();
    for package in packages {
        let Some(program) = built.get(package) else { bail!("{package}: no test program was built") };
        let prefix = format!("{package}:");
        let slow = options.slow.iter().filter_map(|test| test.strip_prefix(&prefix)).map(str::to_owned);
        let tests = TestProgram {
            program: program.clone(),
            folder: workspace.folder(package),
            slow: slow.collect(),
            processor_seconds: options.processor_seconds,
        };
        eprintln!("{package}: its tests without a mutant");
        tests.check()?;
        programs.insert(package.to_owned(), tests);
    }
    Ok(programs)
}

fn judge_all<'a>(
    options: &Options,
    programs: &BTreeMap<String, TestProgram>,
    mutants: &'a BTreeMap<u32, Mutant>,
    switched: &BTreeSet<u32>,
    verdicts: &Verdicts<'a>,
) -> Result<()> {
    let progress = ProgressBar::new(switched.len() as u64);
    let style = "{bar:30} {pos} of {len} mutants, {elapsed} gone, {eta} left";
    progress.set_style(ProgressStyle::with_template(style)?);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.jobs).build()?;
    pool.install(|| {
        let numbers: Vec<u32> = switched.iter().copied().collect();
        // One at a time: what takes long comes in clusters.
        numbers.par_iter().with_max_len(1).try_for_each(|number| {
            let mutant = &mutants[number];
            let verdict = programs[&mutant.package].judge(*number, mutant)?;
            if verdict != Verdict::Caught {
                progress.suspend(|| eprintln!("{verdict:?}: {}", mutant.name));
            }
            progress.inc(1);
            verdicts.add(&mutant.name, verdict)
        })
    })?;
    progress.finish();
    Ok(())
}

/// What is known so far, kept in a file: a run that is interrupted has judged what it has judged.
struct Verdicts<'a> {
    path: &'a Path,
    known: Mutex<BTreeMap<&'a str, &'static str>>,
}

impl<'a> Verdicts<'a> {
    fn new(path: &'a Path, mutants: &'a BTreeMap<u32, Mutant>, unviable: &BTreeSet<u32>) -> Self {
        let known = unviable.iter().map(|number| (mutants[number].name.as_str(), "unviable")).collect();
        Self { path, known: Mutex::new(known) }
    }

    fn add(&self, mutant: &'a str, verdict: Verdict) -> Result<()> {
        let word = match verdict {
            Verdict::Caught => "caught",
            Verdict::TimedOut => "timeout",
            Verdict::Missed => "missed",
        };
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.insert(mutant, word);
        self.write(&known)
    }

    fn write(&self, known: &BTreeMap<&str, &str>) -> Result<()> {
        let text = serde_json::to_string_pretty(known)?;
        std::fs::write(self.path, text).with_context(|| self.path.display().to_string())
    }

    fn finish(self) -> Result<BTreeMap<&'a str, &'static str>> {
        let known = std::mem::take(&mut *self.known.lock().unwrap_or_else(PoisonError::into_inner));
        self.write(&known)?;
        Ok(known)
    }
}
