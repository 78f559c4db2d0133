//! Mutation tests of the safety core: every changed line must be noticed by a unit test, or be listed as equivalent.
//!
//! Each group is one run of cargo-mutants over some files, against the unit tests of their own package. Mutants that
//! no test can tell from the original are named in `.cargo/mutants.toml`, each with its reason.
//!
//! Nearly all are judged in one build, in which each can be switched on (`tests/mutation`); what that cannot judge, and
//! what survives it, by cargo-mutants one at a time.

use crate::run::{self, Step};
use crate::slow_tests;
use crate::tools::{self, option};
use anyhow::{Context as _, Result, bail};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Files that are mutated together.
struct Group {
    name: &'static str,
    package: &'static str,
    files: &'static [&'static str],
}

/// The most safety-relevant first.
const GROUPS: [Group; 6] = [
    Group {
        name: "permission",
        package: "nearfield-firmware",
        files: &["supervisor/mod", "relay", "output_test", "interlock", "flow", "integrity", "map_check"],
    },
    Group {
        name: "evidence",
        package: "nearfield-firmware",
        files: &[
            "link",
            "evidence",
            "secret",
            "liveness",
            "audit",
            "laser_code",
            "arming",
            "run_over",
            "safety/mod",
            "safety/findings",
            "safety/io",
        ],
    },
    Group {
        name: "judgement",
        package: "nearfield-shared",
        files: &["cutoff", "height", "monitor", "run_over", "light", "audit", "linescan", "status", "wire"],
    },
    Group { name: "health", package: "nearfield-firmware", files: &["health", "lockstep"] },
    Group {
        name: "formats",
        package: "nearfield-shared",
        files: &[
            "causes",
            "condition",
            "units",
            "limits",
            "action",
            "service",
            "service/page",
            "service/summary",
            "service/fault_entry",
            "rig",
            "columns",
            "camera",
            "laser",
        ],
    },
    Group {
        name: "records",
        package: "nearfield-firmware",
        files: &[
            "black_box",
            "black_box/recorded",
            "black_box/ring",
            "fault_log",
            "service",
            "store",
            "store/rig_slots",
            "selftest/mod",
            "selftest/clock",
            "selftest/configuration",
            "selftest/memory",
            "selftest/processor",
            "selftest/program",
            "selftest/random",
            "selftest/schedule",
            "selftest/stack",
            "selftest/supply",
            "selftest/watchdog",
        ],
    },
];

/// Processor time of one run of the unit tests, in seconds; many times what they need, and not longer on a machine that
/// is busy with other things. A mutant that makes them run for ever is caught by it.
const PROCESSOR_SECONDS: &str = "60";

impl Group {
    fn output(&self) -> PathBuf {
        run::target_directory().join("mutants").join(self.name)
    }

    fn file(&self, name: &str) -> String {
        format!("{}/src/{name}.rs", self.package.trim_start_matches("nearfield-"))
    }

    fn chosen_files(&self, only: Option<&str>) -> Vec<String> {
        let chosen = self.files.iter().filter(|name| only.is_none_or(|only| only == **name));
        chosen.flat_map(|name| ["--file".to_owned(), self.file(name)]).collect()
    }

    /// Forgets what earlier runs found, unless this one goes on where they ended.
    fn begin(&self, resume: bool) -> Result<()> {
        let output = self.output();
        if !resume && output.exists() {
            std::fs::remove_dir_all(&output).with_context(|| output.display().to_string())?;
        }
        std::fs::create_dir_all(&output).with_context(|| output.display().to_string())
    }

    /// What is known so far.
    fn verdicts(&self, only: Option<&str>) -> Result<Verdicts> {
        Verdicts::of(&self.output(), &self.mutants(only)?)
    }

    /// Judges what is still open, one by one.
    fn finish(&self, only: Option<&str>, jobs: &str) -> Result<Verdicts> {
        let open = self.verdicts(only)?.open();
        if !open.is_empty() {
            self.one_by_one(&open, only, jobs)?;
        }
        self.verdicts(only)
    }

    /// The list of its mutants for programs.
    fn list(&self, only: Option<&str>) -> Result<Vec<serde_json::Value>> {
        let mut arguments =
            vec!["mutants", "--list", "--json", "--package", self.package, "--colors", "never"];
        let files = self.chosen_files(only);
        arguments.extend(files.iter().map(String::as_str));
        let json = Step::cargo(&arguments).standard_output()?;
        serde_json::from_str(&json).with_context(|| format!("cargo mutants --list: {}", self.name))
    }

    /// The names of all mutants.
    fn mutants(&self, only: Option<&str>) -> Result<BTreeSet<String>> {
        let mut arguments = vec!["mutants", "--list", "--package", self.package, "--colors", "never"];
        let files = self.chosen_files(only);
        arguments.extend(files.iter().map(String::as_str));
        let (success, text) = Step::cargo(&arguments).capture()?;
        if !success {
            bail!("cargo mutants cannot list the mutants of {}:\n{text}", self.name);
        }
        Ok(text.lines().filter(|line| line.contains(".rs:")).map(str::to_owned).collect())
    }

    /// One build for each of these mutants.
    fn one_by_one(&self, mutants: &[String], only: Option<&str>, jobs: &str) -> Result<()> {
        let output = self.output().display().to_string();
        let mut arguments = vec!["mutants", "--package", self.package, "--test-package", self.package];
        arguments.extend(["--jobs", jobs, "--output", &output, "--no-shuffle", "--colors", "never"]);
        // Only a build or a test that waits for something is stopped by the clock.
        arguments.extend(["--timeout", "600", "--build-timeout", "900"]);
        let runner = format!(
            "--cargo-arg=--config=target.\"cfg(unix)\".runner=[\"prlimit\",\"--cpu={PROCESSOR_SECONDS}\"]"
        );
        if Step::program("prlimit", &["--version"]).capture().is_ok_and(|(success, _)| success) {
            arguments.push(&runner);
        }
        let files = self.chosen_files(only);
        arguments.extend(files.iter().map(String::as_str));
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
        keep_verdicts(&self.output())
    }
}

/// Judges by tests/mutation what can be switched on, in one build for all groups. A survivor stays open: cargo-mutants has
/// the last word on it.
fn switched(groups: &[&Group], only: Option<&str>, jobs: &str) -> Result<()> {
    let room = run::target_directory().join("mutants");
    let [list, tree, verdicts] = ["list.json", "switched", "switched.json"].map(|name| room.join(name));
    let mut mutants = Vec::new();
    let mut slow = BTreeSet::new();
    for group in groups {
        mutants.extend(group.list(only)?);
        slow.extend(slow_tests::of(group.package).map(|test| format!("{}:{test}", group.package)));
    }
    std::fs::write(&list, serde_json::to_string(&mutants)?).with_context(|| list.display().to_string())?;
    let root = run::root();
    let [root, list, tree, path] = [&root, &list, &tree, &verdicts].map(|path| path.display().to_string());
    let mut arguments = vec!["run", "--package", "nearfield-mutation", "--", "--jobs", jobs];
    arguments.extend(["--root", &root, "--tree", &tree, "--list", &list, "--verdicts", &path]);
    arguments.extend(["--processor-seconds", PROCESSOR_SECONDS]);
    arguments.extend(slow.iter().flat_map(|test| ["--slow", test.as_str()]));
    Step::cargo(&arguments).run()?;
    let mut found = verdicts_in(&verdicts)?;
    found.retain(|_, verdict| verdict != "missed");
    for group in groups {
        add_verdicts(&group.output(), found.clone())?;
    }
    Ok(())
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
    fn of(output: &Path, mutants: &BTreeSet<String>) -> Result<Self> {
        // A run that was interrupted has left its lists where cargo-mutants puts them.
        keep_verdicts(output)?;
        let kept = verdicts_in(&verdict_file(output))?;
        let mut verdicts = Self { total: mutants.len(), ..Self::default() };
        for mutant in mutants {
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

/// The later verdict wins.
fn add_verdicts(output: &Path, found: BTreeMap<String, String>) -> Result<()> {
    let path = verdict_file(output);
    let mut kept = verdicts_in(&path)?;
    kept.extend(found);
    std::fs::write(&path, serde_json::to_string_pretty(&kept)?).with_context(|| path.display().to_string())
}

/// Runs the groups and prints what became of their mutants; survivors fail.
pub fn check(rest: &[String]) -> Result<()> {
    tools::MUTANTS.ensure()?;
    let (wanted, only) = (option(rest, "--group")?, option(rest, "--file")?);
    let jobs = option(rest, "--jobs")?.unwrap_or("2");
    let resume = rest.iter().any(|argument| argument == "--resume");
    let groups: Vec<_> = GROUPS
        .iter()
        .filter(|group| wanted.is_none_or(|wanted| wanted == group.name))
        .filter(|group| only.is_none_or(|only| group.files.contains(&only)))
        .collect();
    if groups.is_empty() {
        let names = GROUPS.map(|group| group.name).join(", ");
        bail!("no such group or file; groups: {names}; files are named like `supervisor/mod`");
    }
    let mut rows = Vec::new();
    let mut open = 0;
    for group in &groups {
        group.begin(resume)?;
        open += group.verdicts(only)?.open().len();
    }
    if open > FEW {
        switched(&groups, only, jobs)?;
    }
    for group in groups {
        rows.push((group.name, group.finish(only, jobs)?));
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

    /// A new module of the safety core belongs to a group, or it is never mutated.
    #[test]
    fn every_module_of_the_safety_core_is_in_one_group() {
        let mut listed: Vec<String> =
            GROUPS.iter().flat_map(|group| group.files.iter().map(|name| group.file(name))).collect();
        listed.sort();
        let mut found = Vec::new();
        for room in ["shared/src", "firmware/src"] {
            collect(&run::root().join(room), &mut found);
        }
        found.sort();
        assert_eq!(listed, found);
    }

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

    fn collect(folder: &std::path::Path, found: &mut Vec<String>) {
        const NO_DECISIONS: [&str; 4] = ["lib.rs", "testing.rs", "model_check.rs", "flash_model.rs"];
        for entry in std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        {
            let path = entry.unwrap_or_else(|error| panic!("{}: {error}", folder.display())).path();
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            if path.is_dir() && name != "bin" {
                collect(&path, found);
            } else if name.ends_with(".rs") && !name.ends_with("tests.rs") && !NO_DECISIONS.contains(&name) {
                let relative = path.strip_prefix(run::root()).map(|path| path.display().to_string());
                found.extend(relative);
            }
        }
    }
}
