//! A test of the tests: known faults are put into a copy of the safety core one by one, and the tests must notice each.
//!
//! The faults are listed in `tests/seeded_faults.toml` as a piece of the source and what stands in its place. A piece
//! that is not there exactly once is an error: a list that no longer fits proves nothing.

use crate::run::{self, Step};
use crate::slow_tests;
use anyhow::{Context as _, Result, bail};
use clap::Args;
use serde::Deserialize;
use std::path::Path;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SeededFaults {
    fault: Vec<SeededFault>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SeededFault {
    /// What is wrong with the safety core then.
    name: String,
    /// The file, from the repository's root.
    file: String,
    /// A piece of the file, there exactly once.
    original: String,
    /// What stands in its place.
    faulty: String,
}

/// What the copy needs of the repository.
const COPIED: [&str; 4] = ["shared", "firmware", "Cargo.lock", "rust-toolchain.toml"];
/// A workspace of the safety core alone, with the root's versions.
const MEMBERS: &str = r#"members = ["shared", "firmware"]"#;

/// Which faults.
#[derive(Debug, Args)]
pub struct Options {
    /// Those only whose name has this in it
    #[arg(long, value_name = "NAME")]
    only: Option<String>,
    /// Those only from this number on in the list
    #[arg(long, value_name = "NUMBER", default_value_t = 1)]
    from: usize,
}

/// Puts every fault in, runs the unit tests, and fails if one goes unnoticed.
pub fn check(options: &Options) -> Result<()> {
    let path = run::root().join("tests").join("seeded_faults.toml");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let list: SeededFaults = toml::from_str(&text).with_context(|| path.display().to_string())?;
    let only = options.only.as_deref();
    let faults: Vec<_> = (1..)
        .zip(&list.fault)
        .filter(|(number, fault)| {
            *number >= options.from && only.is_none_or(|only| fault.name.contains(only))
        })
        .collect();
    let copy = run::target_directory().join("seeded-faults").join("tree");
    make_copy(&copy)?;
    if let Some(last) = first_failure(&copy, Tests::All)? {
        bail!("the tests fail without a fault already:\n{last}");
    }
    let mut unnoticed = Vec::new();
    for (number, fault) in &faults {
        let file = copy.join(&fault.file);
        let original = std::fs::read_to_string(&file).with_context(|| file.display().to_string())?;
        std::fs::write(&file, fault.put_into(&original)?)?;
        let noticed = fault.noticed_by(&copy);
        std::fs::write(&file, &original)?;
        let noticed = noticed.with_context(|| format!("fault {:?}", fault.name))?;
        let by = noticed.as_deref().unwrap_or("NOT NOTICED");
        println!("{number:>3} of {}  {:<58} {by}", list.fault.len(), fault.name);
        if noticed.is_none() {
            unnoticed.push(fault.name.as_str());
        }
    }
    if !unnoticed.is_empty() {
        bail!("the tests do not notice: {}", unnoticed.join("; "));
    }
    println!("all {} seeded faults make the tests fail", faults.len());
    Ok(())
}

/// Which tests are run.
#[derive(Clone, Copy)]
enum Tests<'a> {
    /// Those of one package, unoptimised and without its slow tests: most faults are noticed so.
    Quick(&'a str),
    /// All of both packages.
    All,
}

impl SeededFault {
    /// The first test that fails by this fault, which is in the copy now.
    fn noticed_by(&self, copy: &Path) -> Result<Option<String>> {
        let room = self.file.split('/').next().unwrap_or_default();
        match first_failure(copy, Tests::Quick(&format!("nearfield-{room}")))? {
            None => first_failure(copy, Tests::All),
            found => Ok(found),
        }
    }

    fn put_into(&self, source: &str) -> Result<String> {
        match source.matches(&self.original).count() {
            1 => Ok(source.replacen(&self.original, &self.faulty, 1)),
            times => bail!(
                "{}: `{}` stands in {} {times} times instead of once; the list needs an update",
                self.name,
                self.original,
                self.file
            ),
        }
    }
}

/// The safety core with a workspace of its own, so that nothing else has to build.
fn make_copy(copy: &Path) -> Result<()> {
    if copy.exists() {
        std::fs::remove_dir_all(copy).with_context(|| copy.display().to_string())?;
    }
    std::fs::create_dir_all(copy).with_context(|| copy.display().to_string())?;
    let destination = copy.display().to_string();
    let arguments = [&["-R"], &COPIED[..], &[destination.as_str()]].concat();
    Step::program("cp", &arguments).run()?;
    let manifest = std::fs::read_to_string(run::root().join("Cargo.toml"))?;
    let lines = manifest.lines().map(|line| match line.split_once(" = ") {
        Some(("members", _)) => MEMBERS,
        Some(("default-members" | "exclude" | "nearfield-host", _)) => "",
        _ => line,
    });
    std::fs::write(copy.join("Cargo.toml"), lines.collect::<Vec<_>>().join("\n"))?;
    Ok(())
}

/// The first test that fails in the copy; `None` if all pass.
fn first_failure(copy: &Path, tests: Tests<'_>) -> Result<Option<String>> {
    let manifest = copy.join("Cargo.toml").display().to_string();
    let target = run::target_directory().join("seeded-faults").join("target").display().to_string();
    let mut arguments = vec!["test", "--manifest-path", &manifest, "--lib", "--no-fail-fast"];
    let optimisation = match tests {
        Tests::Quick(package) => {
            arguments.extend(["--package", package, "--"]);
            arguments.extend(slow_tests::left_out(package));
            "0"
        }
        Tests::All => {
            arguments.extend(["--package", "nearfield-shared", "--package", "nearfield-firmware"]);
            "1"
        }
    };
    let (passed, output) = Step::cargo(&arguments)
        .env("CARGO_TARGET_DIR", &target)
        .env("CARGO_PROFILE_DEV_OPT_LEVEL", optimisation)
        .env("CARGO_PROFILE_TEST_OPT_LEVEL", optimisation)
        .env("CARGO_PROFILE_TEST_DEBUG", "0")
        .capture()?;
    if passed {
        return Ok(None);
    }
    let failed: Vec<_> =
        output.lines().filter_map(|line| line.strip_prefix("test ")?.strip_suffix(" ... FAILED")).collect();
    match failed.split_first() {
        Some((first, [])) => Ok(Some((*first).to_owned())),
        Some((first, others)) => Ok(Some(format!("{first} and {} more", others.len()))),
        // A fault that does not even build shows nothing about the tests.
        None => bail!("the tests could not be run:\n{output}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_piece_that_is_not_there_once_is_refused() {
        let fault = |original: &str| SeededFault {
            name: "a fault".to_owned(),
            file: "a.rs".to_owned(),
            original: original.to_owned(),
            faulty: "x".to_owned(),
        };
        assert_eq!(fault("b").put_into("abc").ok().as_deref(), Some("axc"));
        assert!(fault("d").put_into("abc").is_err());
        assert!(fault("a").put_into("aba").is_err());
    }

    /// Every listed piece is in the source now: the list fits without running anything.
    #[test]
    fn the_list_fits_the_source() -> Result<()> {
        let text = std::fs::read_to_string(run::root().join("tests").join("seeded_faults.toml"))?;
        let list: SeededFaults = toml::from_str(&text)?;
        for fault in &list.fault {
            let source = std::fs::read_to_string(run::root().join(&fault.file))?;
            assert_ne!(fault.put_into(&source)?, source, "{}", fault.name);
        }
        Ok(())
    }
}
