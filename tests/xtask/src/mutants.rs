//! Mutation tests of the safety core: every changed line must be noticed by a unit test, or be listed as equivalent.
//!
//! Each group is one run of cargo-mutants over some files, against the unit tests of their own package. Mutants that
//! no test can tell from the original are named in `.cargo/mutants.toml`, each with its reason.

use crate::run::{self, Step};
use crate::tools::{self, option};
use anyhow::{Context as _, Result, bail};
use serde::Deserialize;
use std::path::PathBuf;

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
            "safety/mod",
            "safety/findings",
            "safety/io",
        ],
    },
    Group {
        name: "judgement",
        package: "nearfield-shared",
        files: &["cutoff", "height", "monitor", "light", "audit", "linescan", "status", "wire"],
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

impl Group {
    fn output(&self) -> PathBuf {
        run::target_directory().join("mutants").join(self.name)
    }

    fn file(&self, name: &str) -> String {
        format!("{}/src/{name}.rs", self.package.trim_start_matches("nearfield-"))
    }

    /// Runs what is not yet known to be caught, or everything.
    fn run(&self, resume: bool, only: Option<&str>, jobs: &str) -> Result<()> {
        let output = self.output();
        std::fs::create_dir_all(&output).with_context(|| output.display().to_string())?;
        let output = output.display().to_string();
        let mut arguments = vec!["mutants", "--package", self.package, "--test-package", self.package];
        arguments.extend(["--jobs", jobs, "--output", &output, "--no-shuffle", "--colors", "never"]);
        arguments.extend(["--timeout-multiplier", "5", "--minimum-test-timeout", "60"]);
        if resume {
            arguments.push("--iterate");
        }
        let files: Vec<String> = self
            .files
            .iter()
            .filter(|name| only.is_none_or(|only| only == **name))
            .map(|name| self.file(name))
            .collect();
        for file in &files {
            arguments.extend(["--file", file]);
        }
        // Only the package's own unit tests judge: a mutant must be caught beside the code, not by chance elsewhere.
        arguments.extend(["--", "--lib"]);
        // Exit code 2 = survivors, 3 = time-outs: told from the outcomes below.
        let step = Step::cargo(&arguments)
            .env("CARGO_PROFILE_TEST_OPT_LEVEL", "1")
            .env("CARGO_PROFILE_TEST_DEBUG", "0")
            .env("CARGO_INCREMENTAL", "1")
            .without("CARGO_TARGET_DIR");
        step.run_with_codes(&[0, 2, 3])
    }

    fn outcomes(&self) -> Result<Outcomes> {
        let path = self.output().join("mutants.out").join("outcomes.json");
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        serde_json::from_str(&text).with_context(|| path.display().to_string())
    }
}

#[derive(Deserialize, Clone, Copy, Default)]
struct Outcomes {
    total_mutants: usize,
    caught: usize,
    unviable: usize,
    timeout: usize,
    missed: usize,
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
    for group in groups {
        group.run(resume, only, jobs)?;
        rows.push((group.name, group.outcomes()?));
    }
    println!(
        "\n{:<12} {:>7} {:>7} {:>9} {:>9} {:>9}",
        "group", "mutants", "caught", "unviable", "timed out", "survived"
    );
    for (name, row) in &rows {
        println!(
            "{name:<12} {:>7} {:>7} {:>9} {:>9} {:>9}",
            row.total_mutants, row.caught, row.unviable, row.timeout, row.missed
        );
    }
    let missed: usize = rows.iter().map(|(_, row)| row.missed).sum();
    if missed > 0 {
        bail!(
            "{missed} mutants survive (target/mutants/*/mutants.out/missed.txt): add a test that states the rule, or \
             name the mutant in .cargo/mutants.toml with the reason why it is equivalent"
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
