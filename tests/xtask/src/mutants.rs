//! Mutation tests of the safety core: every changed line must be noticed by a unit test, or be listed as equivalent.
//!
//! Each group is one run of cargo-mutants over some files, against the unit tests of their own package. Mutants that
//! no test can tell from the original are named in `.cargo/mutants.toml`, each with its reason.
//!
//! Nearly all are judged in one build, in which each can be switched on (`tests/mutation`); what that cannot judge, and
//! what survives it, by cargo-mutants one at a time.

mod groups;

use crate::run::{self, Step};
use crate::slow_tests;
use crate::tools;
use anyhow::{Context as _, Result, bail};
use clap::Args;
use clap::builder::PossibleValuesParser;
use groups::{GROUPS, Group};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Processor time of one run of the unit tests, in seconds; many times what they need, and not longer on a machine that
/// is busy with other things. A mutant that makes them run for ever is caught by it.
const PROCESSOR_SECONDS: &str = "60";

impl Group {
    /// Its mutants by their names, as cargo-mutants lists them for programs.
    fn mutants(&self, only: Option<&str>) -> Result<BTreeMap<String, serde_json::Value>> {
        let mut arguments =
            vec!["mutants", "--list", "--json", "--package", self.package, "--colors", "never"];
        let chosen = self.files.iter().filter(|name| only.is_none_or(|only| only == **name));
        let files: Vec<_> = chosen.map(|name| self.file(name)).collect();
        arguments.extend(files.iter().flat_map(|file| ["--file", file.as_str()]));
        let json = Step::cargo(&arguments).standard_output()?;
        let list: Vec<serde_json::Value> = serde_json::from_str(&json)
            .with_context(|| format!("cargo mutants --list --json: {}", self.name))?;
        let named = list.into_iter().map(|mutant| {
            let name = mutant.get("name").and_then(serde_json::Value::as_str).map(str::to_owned);
            Ok((name.context("cargo mutants --list --json: a mutant without a name")?, mutant))
        });
        named.collect()
    }
}

/// Where all that the runs find is kept.
fn room() -> PathBuf {
    run::target_directory().join("mutants")
}

/// Judges by tests/mutation those of these mutants that can be switched on, in one build. A survivor stays open:
/// cargo-mutants has the last word on it.
fn switched(mutants: &[&serde_json::Value], packages: &BTreeSet<&str>, jobs: &str) -> Result<()> {
    let [list, tree, found] = ["list.json", "switched", "switched.json"].map(|name| room().join(name));
    std::fs::write(&list, serde_json::to_string(mutants)?).with_context(|| list.display().to_string())?;
    let slow: Vec<_> = packages
        .iter()
        .flat_map(|package| slow_tests::of(package).map(move |test| format!("{package}:{test}")))
        .collect();
    let root = run::root();
    let [root, list, tree, path] = [&root, &list, &tree, &found].map(|path| path.display().to_string());
    let mut arguments = vec!["run", "--package", "nearfield-mutation", "--", "--jobs", jobs];
    arguments.extend(["--root", &root, "--tree", &tree, "--list", &list, "--verdicts", &path]);
    arguments.extend(["--processor-seconds", PROCESSOR_SECONDS]);
    arguments.extend(slow.iter().flat_map(|test| ["--slow", test.as_str()]));
    Step::cargo(&arguments).run()?;
    let mut found = verdicts_in(&found)?;
    found.retain(|_, verdict| verdict != "missed");
    add_verdicts(&room(), found)
}

/// One build for each of these mutants of a package.
fn one_by_one(package: &str, mutants: &[String], jobs: &str) -> Result<()> {
    let output = room().display().to_string();
    let mut arguments = vec!["mutants", "--package", package, "--test-package", package];
    arguments.extend(["--jobs", jobs, "--output", &output, "--no-shuffle", "--colors", "never"]);
    // Only a build or a test that waits for something is stopped by the clock.
    arguments.extend(["--timeout", "600", "--build-timeout", "900"]);
    let runner = format!(
        "--cargo-arg=--config=target.\"cfg(unix)\".runner=[\"prlimit\",\"--cpu={PROCESSOR_SECONDS}\"]"
    );
    if Step::program("prlimit", &["--version"]).capture().is_ok_and(|(success, _)| success) {
        arguments.push(&runner);
    }
    // Narrow: mutants without a field in these files are judged again, whatever `--re` asks for.
    let files: BTreeSet<_> = mutants.iter().filter_map(|name| name.split(':').next()).collect();
    arguments.extend(files.into_iter().flat_map(|file| ["--file", file]));
    let names: Vec<_> = mutants.iter().map(|name| exactly(name)).collect();
    arguments.extend(names.iter().flat_map(|name| ["--re", name.as_str()]));
    // Only the package's own unit tests judge: a mutant must be caught beside the code, not by chance elsewhere.
    arguments.extend(["--", "--lib"]);
    // Exit code 2 = survivors, 3 = time-outs: told from the verdicts.
    let step = Step::cargo(&arguments)
        .env("CARGO_PROFILE_DEV_OPT_LEVEL", "1")
        .env("CARGO_PROFILE_TEST_OPT_LEVEL", "1")
        .env("CARGO_PROFILE_TEST_DEBUG", "0")
        .env("CARGO_INCREMENTAL", "1")
        // A backtrace for each of a mutant's failures costs more processor time than the tests.
        .env("RUST_BACKTRACE", "0")
        .without("CARGO_TARGET_DIR");
    step.run_with_codes(&[0, 2, 3])?;
    keep_verdicts(&room())
}

/// So few are judged one by one at once: the one build takes longer.
const FEW: usize = 20;

/// A regular expression that only this text matches.
fn exactly(text: &str) -> String {
    let escaped = text.chars().flat_map(|character| {
        let escape = r"\.+*?()|[]{}^$".contains(character).then_some('\\');
        escape.into_iter().chain([character])
    });
    format!("^{}$", escaped.collect::<String>())
}

/// What became of a group's mutants in all runs so far.
#[derive(Debug, Default, PartialEq, Eq)]
struct Verdicts {
    total: usize,
    caught: usize,
    unviable: usize,
    timed_out: usize,
    survived: Vec<String>,
    unjudged: Vec<String>,
}

/// cargo-mutants' lists of one run, the later one wins.
const LISTS: [&str; 4] = ["caught", "unviable", "timeout", "missed"];

impl Verdicts {
    fn of<'a>(output: &Path, mutants: impl IntoIterator<Item = &'a String>) -> Result<Self> {
        // A run that was interrupted has left its lists where cargo-mutants puts them.
        keep_verdicts(output)?;
        let kept = verdicts_in(&verdict_file(output))?;
        let mut verdicts = Self::default();
        for mutant in mutants {
            verdicts.total += 1;
            match kept.get(mutant).map(String::as_str) {
                Some("caught") => verdicts.caught += 1,
                Some("unviable") => verdicts.unviable += 1,
                Some("timeout") => verdicts.timed_out += 1,
                Some("missed") => verdicts.survived.push(mutant.clone()),
                _ => verdicts.unjudged.push(mutant.clone()),
            }
        }
        Ok(verdicts)
    }

    /// Mutants that are not known to be noticed or not to build.
    fn open(&self) -> Vec<String> {
        [&self.survived[..], &self.unjudged[..]].concat()
    }
}

fn verdict_file(output: &Path) -> PathBuf {
    output.join("verdicts.json")
}

/// Verdicts by the mutants' names; none if there is no such file.
fn verdicts_in(path: &Path) -> Result<BTreeMap<String, String>> {
    match std::fs::read_to_string(path) {
        Ok(text) => serde_json::from_str(&text).with_context(|| path.display().to_string()),
        Err(_) => Ok(BTreeMap::new()),
    }
}

/// Adds cargo-mutants' lists of the last run to those of the runs before: it keeps only the last itself.
fn keep_verdicts(output: &Path) -> Result<()> {
    let mut found = BTreeMap::new();
    for list in LISTS {
        let path = output.join("mutants.out").join(list).with_extension("txt");
        let Ok(text) = std::fs::read_to_string(&path) else { continue };
        found.extend(text.lines().map(|mutant| (mutant.to_owned(), list.to_owned())));
    }
    add_verdicts(output, found)
}

/// Forgets what earlier runs have found of these.
fn forget(output: &Path, mutants: &BTreeMap<String, serde_json::Value>) -> Result<()> {
    keep_verdicts(output)?;
    let path = verdict_file(output);
    let mut kept = verdicts_in(&path)?;
    kept.retain(|name, _| !mutants.contains_key(name));
    std::fs::write(&path, serde_json::to_string_pretty(&kept)?)
        .with_context(|| path.display().to_string())?;
    match std::fs::remove_dir_all(output.join("mutants.out")) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error.into()),
        _ => Ok(()),
    }
}

/// The later verdict wins.
fn add_verdicts(output: &Path, found: BTreeMap<String, String>) -> Result<()> {
    let path = verdict_file(output);
    let mut kept = verdicts_in(&path)?;
    kept.extend(found);
    std::fs::write(&path, serde_json::to_string_pretty(&kept)?).with_context(|| path.display().to_string())
}

/// In the names of mutants without a field. cargo-mutants 27.1 lists and judges them whatever `--re` asks for.
const FIELD: &str = ": delete field ";

/// What this file needs of `.cargo/mutants.toml`.
#[derive(serde::Deserialize)]
struct Settings {
    exclude_re: Vec<String>,
}

/// Every exception must still name a mutant: one that names none has lost its place in the source, and might find another.
fn check_exceptions() -> Result<()> {
    let path = run::root().join(".cargo/mutants.toml");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let settings: Settings = toml::from_str(&text).with_context(|| path.display().to_string())?;
    for exception in &settings.exclude_re {
        let mut arguments = vec!["mutants", "--list", "--no-config", "--colors", "never", "--re", exception];
        arguments.extend(["--package", "nearfield-shared", "--package", "nearfield-firmware"]);
        let named = Step::cargo(&arguments).standard_output()?;
        if !named.lines().any(|line| line.contains(".rs:") && !line.contains(FIELD)) {
            bail!(".cargo/mutants.toml: the exception {exception:?} names no mutant any more");
        }
    }
    Ok(())
}

/// Which mutants, and how.
#[derive(Debug, Args)]
pub struct Options {
    /// Those of this group of files only
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(GROUPS.map(|group| group.name)))]
    group: Option<String>,
    /// Those of this file only, named like `supervisor/mod`
    #[arg(long, value_name = "NAME")]
    file: Option<String>,
    /// Keep the verdicts of the last run; judge only what is still open
    #[arg(long)]
    resume: bool,
    /// Test programs at a time
    #[arg(long, value_name = "N", default_value_t = 2)]
    jobs: u32,
}

/// Runs the groups and prints what became of their mutants; survivors fail.
pub fn check(options: &Options) -> Result<()> {
    tools::MUTANTS.ensure()?;
    check_exceptions()?;
    let (wanted, only) = (options.group.as_deref(), options.file.as_deref());
    let jobs = &*options.jobs.to_string();
    let groups: Vec<_> = GROUPS
        .iter()
        .filter(|group| wanted.is_none_or(|wanted| wanted == group.name))
        .filter(|group| only.is_none_or(|only| group.files.contains(&only)))
        .collect();
    if groups.is_empty() {
        let names = GROUPS.map(|group| group.name).join(", ");
        bail!("no such group or file; groups: {names}; files are named like `supervisor/mod`");
    }
    std::fs::create_dir_all(room()).with_context(|| room().display().to_string())?;
    let mut mutants = BTreeMap::new();
    let mut of_groups = Vec::new();
    for group in groups {
        let of_group = group.mutants(only)?;
        of_groups.push((group, of_group.keys().cloned().collect::<Vec<_>>()));
        mutants.extend(of_group);
    }
    if !options.resume {
        forget(&room(), &mutants)?;
    }
    let packages: BTreeSet<_> = of_groups.iter().map(|(group, _)| group.package).collect();
    let open = Verdicts::of(&room(), mutants.keys())?.open();
    if open.len() > FEW {
        let open: Vec<_> = open.iter().filter_map(|name| mutants.get(name)).collect();
        switched(&open, &packages, jobs)?;
    }
    for package in packages {
        let of_package = of_groups.iter().filter(|(group, _)| group.package == package);
        let open = Verdicts::of(&room(), of_package.flat_map(|(_, names)| names))?.open();
        if !open.is_empty() {
            one_by_one(package, &open, jobs)?;
        }
    }
    let mut rows = Vec::new();
    for (group, names) in &of_groups {
        rows.push((group.name, Verdicts::of(&room(), names)?));
    }
    println!(
        "\n{:<12} {:>7} {:>7} {:>9} {:>9} {:>9}",
        "group", "mutants", "caught", "unviable", "timed out", "survived"
    );
    for (name, row) in &rows {
        println!(
            "{name:<12} {:>7} {:>7} {:>9} {:>9} {:>9}",
            row.total,
            row.caught,
            row.unviable,
            row.timed_out,
            row.survived.len()
        );
    }
    let survivors: Vec<_> = rows.iter().flat_map(|(_, row)| &row.survived).collect();
    for mutant in &survivors {
        println!("survived: {mutant}");
    }
    let unjudged: Vec<_> = rows.iter().flat_map(|(_, row)| &row.unjudged).collect();
    for mutant in &unjudged {
        println!("not judged: {mutant}");
    }
    if !survivors.is_empty() || !unjudged.is_empty() {
        bail!(
            "{} mutants survive and {} were not judged: add a test that states the rule, or name the mutant in \
             .cargo/mutants.toml with the reason why it is equivalent",
            survivors.len(),
            unjudged.len()
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A name with brackets and stars must not match another one.
    #[test]
    fn a_name_matches_itself_only() {
        assert_eq!(exactly("a.rs:1:2: replace * with +"), r"^a\.rs:1:2: replace \* with \+$");
    }

    /// Runs are added up: the later one wins, and what the source no longer has does not count.
    #[test]
    fn verdicts_of_several_runs_are_added_up() -> Result<()> {
        let output = std::env::temp_dir().join(format!("nearfield-verdicts-{}", std::process::id()));
        let lists = output.join("mutants.out");
        std::fs::create_dir_all(&lists)?;
        let mutants: BTreeSet<String> = ["a", "b", "c", "d"].map(str::to_owned).into();
        std::fs::write(lists.join("caught.txt"), "a\nold\n")?;
        std::fs::write(lists.join("missed.txt"), "b\nc\n")?;
        let first = Verdicts::of(&output, &mutants)?;
        std::fs::write(lists.join("caught.txt"), "b\n")?;
        std::fs::write(lists.join("missed.txt"), "c\n")?;
        let second = Verdicts::of(&output, &mutants)?;
        std::fs::remove_dir_all(&output)?;
        assert_eq!((first.caught, first.survived.len(), first.open().len()), (1, 2, 3));
        assert_eq!((second.caught, second.survived, second.total), (2, vec!["c".to_owned()], 4));
        Ok(())
    }
}
