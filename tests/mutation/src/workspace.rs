//! A copy of the safety core with all mutants in it, and the test programs built from it.

use crate::mutant::Mutant;
use crate::rewrite::{self, Region};
use anyhow::{Context as _, Result, bail};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What the copy needs of the repository.
const COPIED: [&str; 4] = ["shared", "firmware", "Cargo.lock", "rust-toolchain.toml"];
/// Their members.
const PACKAGES: [(&str, &str); 2] = [("nearfield-shared", "shared"), ("nearfield-firmware", "firmware")];

/// The copy.
pub struct Workspace {
    /// Its root.
    tree: PathBuf,
    /// The originals, by path from the root.
    sources: BTreeMap<String, String>,
    /// The rewritten files' regions, by path from the root.
    regions: BTreeMap<String, Vec<Region>>,
}

/// What became of the mutants when they were put in.
#[derive(Debug, Default)]
pub struct PutIn {
    /// Can be switched on.
    pub switched: BTreeSet<u32>,
    /// What they put in the original's place does not compile.
    pub unviable: BTreeSet<u32>,
}

impl Workspace {
    /// Copies the safety core from the repository's root.
    ///
    /// # Errors
    /// A file cannot be read or written.
    pub fn copy(root: &Path, tree: &Path) -> Result<Self> {
        if tree.exists() {
            std::fs::remove_dir_all(tree).with_context(|| tree.display().to_string())?;
        }
        std::fs::create_dir_all(tree).with_context(|| tree.display().to_string())?;
        for name in COPIED {
            run(Command::new("cp").arg("-R").arg(root.join(name)).arg(tree))?;
        }
        run(Command::new("cp").arg("-R").arg(root.join("tests/mutation/switch")).arg(tree))?;
        edit(&root.join("Cargo.toml"), &tree.join("Cargo.toml"), |line| match line.split_once(" = ") {
            Some(("members", _)) => r#"members = ["shared", "firmware", "switch"]"#.to_owned(),
            Some(("default-members" | "exclude", _)) => String::new(),
            _ => line.to_owned(),
        })?;
        for (_, folder) in PACKAGES {
            let manifest = tree.join(folder).join("Cargo.toml");
            edit(&manifest, &manifest, |line| match line {
                "[dependencies]" => format!("{line}\nmutation-switch = {{ path = \"../switch\" }}"),
                _ => line.to_owned(),
            })?;
        }
        Ok(Self { tree: tree.to_owned(), sources: BTreeMap::new(), regions: BTreeMap::new() })
    }

    /// Puts all mutants in that can be switched on and compile.
    ///
    /// # Errors
    /// The copy does not compile for another reason than a mutant.
    pub fn put_in(&mut self, mutants: &BTreeMap<u32, Mutant>) -> Result<PutIn> {
        let mut refused = BTreeSet::new();
        let mut unviable = BTreeSet::new();
        loop {
            let switched = self.write(mutants, &refused)?;
            let faults = self.faults()?;
            if faults.is_empty() {
                return Ok(PutIn { switched, unviable });
            }
            let before = refused.len();
            for fault in &faults {
                let Some(region) = self.innermost(fault) else {
                    bail!("{}: byte {}: {}", fault.file, fault.start, fault.message);
                };
                if region.is_replacement {
                    unviable.extend(&region.numbers);
                }
                refused.extend(&region.numbers);
            }
            eprintln!("{} mutants left out that do not compile", refused.len());
            if refused.len() == before {
                bail!("does not compile, for no mutant's reason: {}", faults[0].message);
            }
        }
    }

    fn write(&mut self, mutants: &BTreeMap<u32, Mutant>, refused: &BTreeSet<u32>) -> Result<BTreeSet<u32>> {
        let mut files: BTreeMap<&str, BTreeMap<u32, &Mutant>> = BTreeMap::new();
        for (number, mutant) in mutants {
            let of_file = files.entry(&mutant.file).or_default();
            if !refused.contains(number) {
                of_file.insert(*number, mutant);
            }
        }
        let mut switched = BTreeSet::new();
        for (name, mutants) in files {
            let path = self.tree.join(name);
            let source = match self.sources.get(name) {
                Some(source) => source,
                None => {
                    let source =
                        std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
                    self.sources.entry(name.to_owned()).or_insert(source)
                }
            };
            let rewritten = rewrite::rewrite(source, &mutants).with_context(|| name.to_owned())?;
            std::fs::write(&path, &rewritten.text).with_context(|| path.display().to_string())?;
            self.regions.insert(name.to_owned(), rewritten.regions);
            switched.extend(rewritten.switched);
        }
        Ok(switched)
    }

    /// The smallest region around a fault.
    fn innermost(&self, fault: &Fault) -> Option<&Region> {
        let regions = self.regions.get(&fault.file)?;
        let around = regions
            .iter()
            .filter(|region| region.bytes.start <= fault.start && fault.end <= region.bytes.end);
        around.min_by_key(|region| (region.bytes.len(), !region.is_replacement))
    }

    fn cargo(&self, verb: &str) -> Command {
        let mut command = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned()));
        command.arg(verb).args(["--message-format", "json", "--lib"]).current_dir(&self.tree);
        for (package, _) in PACKAGES {
            command.args(["--package", package]);
        }
        // The switch asks the compiler whether it is evaluated at compile time, which is not stable yet.
        command.env("RUSTC_BOOTSTRAP", "1").env("RUSTFLAGS", "--cap-lints=allow");
        command.env("CARGO_TARGET_DIR", self.tree.with_extension("target")).env("CARGO_INCREMENTAL", "1");
        command.stdin(Stdio::null());
        command
    }

    /// The first errors of the compiler.
    fn faults(&self) -> Result<Vec<Fault>> {
        let output = self.cargo("check").args(["--profile", "test"]).output().context("cargo check")?;
        if output.status.success() {
            return Ok(Vec::new());
        }
        let mut faults = Vec::new();
        for line in String::from_utf8_lossy(&output.stdout).lines() {
            let Ok(Message { reason, message: Some(message), .. }) = serde_json::from_str(line) else {
                continue;
            };
            let Some(place) = message.spans.iter().find(|span| span.is_primary) else { continue };
            if reason == "compiler-message" && message.level == "error" {
                faults.push(Fault {
                    file: place.file_name.clone(),
                    start: place.byte_start,
                    end: place.byte_end,
                    message: message.message,
                });
            }
        }
        if faults.is_empty() {
            bail!("cargo check failed:\n{}", String::from_utf8_lossy(&output.stderr));
        }
        Ok(faults)
    }

    /// Builds the unit tests; gives the test program of each package.
    ///
    /// # Errors
    /// They do not build.
    pub fn build(&self) -> Result<BTreeMap<String, PathBuf>> {
        let mut command = self.cargo("test");
        let output =
            command.arg("--no-run").stderr(Stdio::inherit()).output().context("cargo test --no-run")?;
        if !output.status.success() {
            bail!("the tests of {} do not build", self.tree.display());
        }
        let mut programs = BTreeMap::new();
        for line in String::from_utf8_lossy(&output.stdout).lines() {
            let Ok(Message { executable: Some(executable), target: Some(target), .. }) =
                serde_json::from_str(line)
            else {
                continue;
            };
            programs.insert(target.name.replace('_', "-"), executable);
        }
        Ok(programs)
    }

    /// Where a package's sources are; its tests run there.
    #[must_use]
    pub fn folder(&self, package: &str) -> PathBuf {
        self.tree.join(package.trim_start_matches("nearfield-"))
    }
}

/// A place that does not compile.
#[derive(Debug)]
struct Fault {
    file: String,
    start: usize,
    end: usize,
    message: String,
}

/// One line of cargo's messages.
#[derive(Deserialize)]
struct Message {
    reason: String,
    message: Option<Diagnostic>,
    executable: Option<PathBuf>,
    target: Option<Target>,
}

#[derive(Deserialize)]
struct Target {
    name: String,
}

#[derive(Deserialize)]
struct Diagnostic {
    level: String,
    message: String,
    spans: Vec<DiagnosticSpan>,
}

#[derive(Deserialize)]
struct DiagnosticSpan {
    file_name: String,
    byte_start: usize,
    byte_end: usize,
    is_primary: bool,
}

fn run(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("{command:?}"))?;
    if !status.success() {
        bail!("{command:?} failed ({status})");
    }
    Ok(())
}

/// Copies a file line by line.
fn edit(from: &Path, to: &Path, change: impl Fn(&str) -> String) -> Result<()> {
    let text = std::fs::read_to_string(from).with_context(|| from.display().to_string())?;
    let lines: Vec<_> = text.lines().map(change).collect();
    std::fs::write(to, lines.join("\n")).with_context(|| to.display().to_string())
}
