//! Line and region coverage of the safety core by its own unit tests: everything, or an exception with its reason.
//!
//! Only the code that is shipped counts: a file's `#[cfg(test)] mod tests` and the files that are tests altogether are
//! left out, so that their own unused failure messages neither lower nor raise the figure.

use crate::run::{self, Step};
use crate::tools;
use anyhow::{Context as _, Result, bail};
use clap::Args;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::Path;

/// Below these folders stands what counts.
const ROOMS: [&str; 2] = ["shared/src/", "firmware/src/"];
/// Files that are compiled for tests only, and the binaries, which no unit test runs.
const NOT_COUNTED: [&str; 6] =
    ["/bin/", "/tests.rs", "_tests.rs", "/testing.rs", "/model_check.rs", "/flash_model.rs"];

#[derive(Deserialize)]
struct Export {
    data: Vec<ExportData>,
}

#[derive(Deserialize)]
struct ExportData {
    files: Vec<ExportFile>,
}

#[derive(Deserialize)]
struct ExportFile {
    filename: String,
    segments: Vec<Segment>,
}

/// Line, column, count, has a count, begins a region, is a gap: llvm-cov's own export format.
#[derive(Deserialize, Clone, Copy)]
struct Segment(usize, usize, u64, bool, bool, bool);

impl Segment {
    const fn begins_region(self) -> bool {
        self.3 && self.4 && !self.5
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Exceptions {
    #[serde(default)]
    exception: Vec<Exception>,
}

/// One place that no test reaches, and why none can.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Exception {
    /// The file, from the repository's root.
    file: String,
    /// Text that the line contains.
    text: String,
    /// Whole lines are never reached, not only regions of lines that are.
    #[serde(default)]
    whole_line: bool,
    /// Why.
    #[allow(dead_code, reason = "for people; the format demands it")]
    reason: String,
}

impl Exception {
    fn excuses(&self, file: &str, code: &str, place: Place) -> bool {
        self.file == file && code.contains(&self.text) && (self.whole_line || !place.whole_line)
    }
}

/// Something that no test reaches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    line: usize,
    column: usize,
    whole_line: bool,
}

/// What a file's tests leave out.
struct FileCoverage {
    lines: usize,
    regions: usize,
    missed_lines: BTreeSet<usize>,
    missed_regions: Vec<(usize, usize)>,
}

impl FileCoverage {
    /// Missed lines, and the missed regions on other lines.
    fn places(&self) -> impl Iterator<Item = Place> + '_ {
        let lines = self.missed_lines.iter().map(|line| Place { line: *line, column: 1, whole_line: true });
        let regions = self.missed_regions.iter().filter(|(line, _)| !self.missed_lines.contains(line));
        lines.chain(regions.map(|(line, column)| Place { line: *line, column: *column, whole_line: false }))
    }
}

/// What is made of it.
#[derive(Debug, Args)]
pub struct Options {
    /// Also a report for a browser, in target/llvm-cov/html
    #[arg(long)]
    html: bool,
}

/// Measures, prints the figures and what is left out, and fails on what is no exception.
pub fn check(options: &Options) -> Result<()> {
    tools::COVERAGE.ensure()?;
    let export = run::target_directory().join("coverage.json");
    let path = export.display().to_string();
    let command = ["llvm-cov", "--package", "nearfield-shared", "--package", "nearfield-firmware", "--lib"];
    let output = ["--json", "--output-path", &path];
    Step::cargo(&[&command[..], &output].concat()).run()?;
    if options.html {
        Step::cargo(&["llvm-cov", "report", "--html"]).run()?;
    }
    let text = std::fs::read_to_string(&export).with_context(|| path.clone())?;
    let export: Export = serde_json::from_str(&text).with_context(|| path.clone())?;
    let list = run::root().join("tests").join("coverage.toml");
    let text = std::fs::read_to_string(&list).with_context(|| list.display().to_string())?;
    let exceptions: Exceptions = toml::from_str(&text).with_context(|| list.display().to_string())?;
    judge(&export, &exceptions.exception)
}

fn judge(export: &Export, exceptions: &[Exception]) -> Result<()> {
    let mut used = vec![false; exceptions.len()];
    let mut unexplained = Vec::new();
    let (mut lines, mut regions, mut missed_lines, mut missed_regions) = (0, 0, 0, 0);
    for file in export.data.iter().flat_map(|data| &data.files) {
        let Some(name) = counted(&file.filename) else { continue };
        let source = std::fs::read_to_string(&file.filename).with_context(|| file.filename.clone())?;
        let coverage = coverage_of(&file.segments, first_test_line(&source));
        lines += coverage.lines;
        regions += coverage.regions;
        missed_lines += coverage.missed_lines.len();
        missed_regions += coverage.missed_regions.len();
        for place in coverage.places() {
            let code = code_at(&source, place.line);
            match exceptions
                .iter()
                .zip(&mut used)
                .find(|(exception, _)| exception.excuses(&name, &code, place))
            {
                Some((_, used)) => *used = true,
                None => unexplained.push(format!("{name}:{}:{}: {}", place.line, place.column, code.trim())),
            }
        }
    }
    if lines == 0 {
        bail!("the export names no counted file; is it from this checkout?");
    }
    println!("lines    {:>6} of {lines} covered", lines - missed_lines);
    println!("regions  {:>6} of {regions} covered", regions - missed_regions);
    println!("exceptions with a reason: {} (tests/coverage.toml)", exceptions.len());
    let stale: Vec<_> =
        exceptions.iter().zip(&used).filter(|(_, used)| !**used).map(|(exception, _)| exception).collect();
    for exception in &stale {
        println!("stale exception, covered by now: {} `{}`", exception.file, exception.text);
    }
    for place in &unexplained {
        println!("not covered: {place}");
    }
    if !stale.is_empty() || !unexplained.is_empty() {
        bail!(
            "{} places are not covered and {} exceptions are stale: add a test that states the rule, or the reason \
             to tests/coverage.toml",
            unexplained.len(),
            stale.len()
        );
    }
    Ok(())
}

/// The line's text; for a closing brace (there llvm-cov counts the way past a block) that of the line which opens it.
fn code_at(source: &str, line: usize) -> String {
    let lines: Vec<&str> = source.lines().collect();
    let here = lines.get(line.saturating_sub(1)).copied().unwrap_or_default();
    if here.trim() != "}" {
        return here.to_owned();
    }
    let depth = |text: &str| text.len() - text.trim_start().len();
    let before = lines.iter().take(line.saturating_sub(1)).rev();
    let mut same_depth = before.filter(|text| !text.trim().is_empty() && depth(text) <= depth(here));
    same_depth.next().map_or_else(|| here.to_owned(), |opening| format!("{} .. }}", opening.trim()))
}

/// The file's name from the repository's root, if its code counts.
fn counted(path: &str) -> Option<String> {
    let name = Path::new(path).strip_prefix(run::root()).ok()?.to_str()?.to_owned();
    let ours = ROOMS.iter().any(|room| name.starts_with(room));
    (ours && !NOT_COUNTED.iter().any(|part| name.contains(part))).then_some(name)
}

/// Where the file's own tests begin; beyond its end if it has none.
fn first_test_line(source: &str) -> usize {
    let mut lines = source.lines().zip(1..).peekable();
    while let Some((line, number)) = lines.next() {
        let tests = line == "#[cfg(test)]"
            && lines.peek().is_some_and(|(next, _)| next.starts_with("mod ") && next.ends_with('{'));
        if tests {
            return number;
        }
    }
    usize::MAX
}

/// Lines and regions as llvm-cov itself counts them, up to the tests.
fn coverage_of(segments: &[Segment], end: usize) -> FileCoverage {
    let mut coverage =
        FileCoverage { lines: 0, regions: 0, missed_lines: BTreeSet::new(), missed_regions: Vec::new() };
    let last = segments.iter().map(|segment| segment.0).max().unwrap_or(0);
    let mut wrapped: Option<Segment> = None;
    let mut rest = segments;
    for line in 1..=last.min(end.saturating_sub(1)) {
        let here = rest.iter().take_while(|segment| segment.0 == line).count();
        let (on_line, later) = rest.split_at(here);
        rest = later;
        let regions = on_line.iter().filter(|segment| segment.begins_region());
        let counts = regions.clone().map(|segment| segment.2);
        let skipped = on_line.first().is_some_and(|first| !first.3 && first.4);
        let inherited = wrapped.filter(|wrapped| wrapped.3);
        coverage.regions += regions.clone().count();
        let missed = regions.filter(|segment| segment.2 == 0).map(|segment| (segment.0, segment.1));
        coverage.missed_regions.extend(missed);
        if !skipped && (inherited.is_some() || counts.clone().count() > 0) {
            coverage.lines += 1;
            if counts.chain(inherited.map(|wrapped| wrapped.2)).max() == Some(0) {
                coverage.missed_lines.insert(line);
            }
        }
        wrapped = on_line.last().copied().or(wrapped);
    }
    coverage
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A function of four lines whose third was never reached.
    const SEGMENTS: [Segment; 4] = [
        Segment(1, 1, 5, true, true, false),
        Segment(3, 5, 0, true, true, false),
        Segment(3, 20, 5, true, false, false),
        Segment(4, 2, 0, false, false, false),
    ];

    #[test]
    fn a_region_that_is_never_reached_is_told_by_its_place() {
        let coverage = coverage_of(&SEGMENTS, usize::MAX);
        assert_eq!((coverage.lines, coverage.regions), (4, 2));
        assert_eq!(coverage.missed_regions, [(3, 5)]);
        assert!(coverage.missed_lines.is_empty(), "the line was entered before the region");
    }

    #[test]
    fn a_line_wholly_inside_a_missed_region_is_missed() {
        let segments = [Segment(1, 1, 0, true, true, false), Segment(3, 2, 0, false, false, false)];
        let coverage = coverage_of(&segments, usize::MAX);
        assert_eq!(coverage.missed_lines, BTreeSet::from([1, 2, 3]));
    }

    #[test]
    fn a_closing_brace_is_told_by_what_opens_it() {
        let source = "fn a() {\n    if b {\n        c();\n\n    }\n}\n";
        assert_eq!(code_at(source, 5), "if b { .. }");
        assert_eq!(code_at(source, 6), "fn a() { .. }");
        assert_eq!(code_at(source, 3), "        c();");
    }

    /// A reason for a region is none for a whole line; and it is for one file.
    #[test]
    fn an_exception_excuses_what_it_names_and_nothing_else() {
        let exception = |whole_line| Exception {
            file: "a.rs".to_owned(),
            text: "reader.u8()?".to_owned(),
            whole_line,
            reason: String::new(),
        };
        let place = |whole_line| Place { line: 1, column: 1, whole_line };
        let code = "let x = reader.u8()?;";
        assert!(exception(false).excuses("a.rs", code, place(false)));
        assert!(!exception(false).excuses("a.rs", code, place(true)));
        assert!(exception(true).excuses("a.rs", code, place(true)));
        assert!(!exception(true).excuses("b.rs", code, place(true)));
        assert!(!exception(true).excuses("a.rs", "let y = 1;", place(true)));
    }

    #[test]
    fn tests_are_left_out() {
        let source = "fn a() {}\n#[cfg(test)]\nfn aid() {}\n#[cfg(test)]\nmod tests {\n}\n";
        assert_eq!(first_test_line(source), 4);
        assert_eq!(coverage_of(&SEGMENTS, 3).regions, 1);
        assert_eq!(first_test_line("fn a() {}\n"), usize::MAX);
    }

    #[test]
    fn only_the_safety_core_counts() {
        let path = |name: &str| run::root().join(name).display().to_string();
        assert_eq!(counted(&path("firmware/src/relay.rs")).as_deref(), Some("firmware/src/relay.rs"));
        assert_eq!(counted(&path("firmware/src/bin/stm32g474/main.rs")), None);
        assert_eq!(counted(&path("firmware/src/store/tests.rs")), None);
        assert_eq!(counted(&path("host/src/lib.rs")), None);
    }
}
