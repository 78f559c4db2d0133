//! A rig that nobody has built yet, from the study of its mount over its calibration to stops in the twin: chapter 9 of the
//! operator's guide, typed as it stands there, must give what it shows.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

mod program;

use std::path::Path;
use std::process::Output;

fn nearfield(directory: &Path, arguments: &str) -> Output {
    program::nearfield().current_dir(directory).args(words(directory, arguments)).output().unwrap()
}

/// A command line as a shell takes it apart, as far as the guide needs: double quotes, and one `*` in a file's name.
fn words(directory: &Path, line: &str) -> Vec<String> {
    let mut words = Vec::new();
    for (index, part) in line.split('"').enumerate() {
        if index % 2 == 1 {
            words.push(part.to_owned());
            continue;
        }
        for word in part.split_whitespace() {
            match word.rsplit_once('/').and_then(|(folder, name)| Some((folder, name.split_once('*')?))) {
                Some((folder, (before, after))) => {
                    words.extend(files(directory, folder, before, after));
                }
                None => words.push(word.to_owned()),
            }
        }
    }
    words
}

fn files(directory: &Path, folder: &str, before: &str, after: &str) -> Vec<String> {
    let entries = std::fs::read_dir(directory.join(folder)).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut found: Vec<String> = names
        .filter(|name| name.starts_with(before) && name.ends_with(after))
        .map(|name| format!("{folder}/{name}"))
        .collect();
    found.sort();
    found
}

/// Is the line what the guide shows? Figures may differ a little (other processors round otherwise), calibration ids
/// altogether; what follows "..." is not looked at.
fn is_as_shown(shown: &str, found: &str) -> bool {
    let words = |line: &str| -> Vec<String> {
        let parts = line.split(|c: char| c.is_whitespace() || "(),:;|".contains(c));
        parts.filter(|part| !part.is_empty()).map(str::to_owned).collect()
    };
    let (shown, found) = (words(shown), words(found));
    let until = shown.iter().position(|word| word == "...");
    if until.map_or(shown.len() != found.len(), |until| found.len() < until) {
        return false;
    }
    let is_id = |word: &str| word.len() == 8 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
    shown.iter().zip(&found).take(until.unwrap_or(shown.len())).all(|(shown, found)| {
        match (shown.parse::<f64>(), found.parse::<f64>()) {
            (Ok(one), Ok(other)) => (one - other).abs() <= 0.3_f64.max(0.05 * one.abs()),
            _ => shown == found || (is_id(shown) && is_id(found)),
        }
    })
}

/// Holds a command's output to the guide's lines, of which "..." alone stands for any number.
fn compare(command: &str, shown: &[&str], found: &str) {
    let found: Vec<&str> = found.lines().map(str::trim_end).collect();
    let mut at = 0;
    for (index, line) in shown.iter().enumerate() {
        if line.trim() == "..." {
            at = found.len().saturating_sub(shown.len() - index - 1);
            continue;
        }
        let told = found.get(at).copied().unwrap_or("(nothing more)");
        assert!(
            is_as_shown(line, told),
            "nearfield {command}\nthe guide shows: {line}\nthere came:      {told}"
        );
        at += 1;
    }
    assert!(at == found.len(), "nearfield {command}\nthe guide leaves out: {}", found[at..].join("\n"));
}

/// The fenced blocks of the guide's chapter: kind and lines.
fn blocks() -> Vec<(String, Vec<String>)> {
    let guide = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    // It is the last one; headings within it are what commands print.
    let chapter = guide.split_once("\n## 9. ").unwrap().1;
    let fenced = chapter.split("\n```").skip(1).step_by(2);
    fenced
        .map(|block| {
            let mut lines = block.lines().map(str::to_owned);
            (lines.next().unwrap(), lines.collect())
        })
        .collect()
}

#[test]
fn a_new_rig_goes_from_study_to_work_by_the_guide_alone() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let mut commands = 0;
    for (kind, lines) in blocks() {
        if kind == "toml" {
            let name = lines[0].trim_start_matches("# ").split(':').next().unwrap();
            std::fs::write(at.join(name), lines.join("\n")).unwrap();
            continue;
        }
        let text = lines.join("\n").replace("\\\n", " ");
        for step in text.split("$ nearfield ").skip(1) {
            let mut shown: Vec<&str> = step.lines().collect();
            let command = shown.remove(0);
            let output = nearfield(at, command);
            assert!(output.status.success(), "nearfield {command}: {output:?}");
            compare(command, &shown, &String::from_utf8(output.stdout).unwrap());
            commands += 1;
        }
    }
    assert!(commands >= 13, "only {commands} commands were found in the guide");
}

/// The comparison itself must be able to say no.
#[test]
fn another_output_than_the_guides_is_noticed() {
    assert!(is_as_shown("fx  509.59 +- 0.16", "fx  509.70 +- 0.17"));
    assert!(is_as_shown("calibration 3639f26e is stored", "calibration 00000001 is stored"));
    assert!(is_as_shown("recorded ...", "recorded 1.4 MiB"));
    for other in ["fx  590.59 +- 0.16", "fy  509.59 +- 0.16", "fx  509.59", "fx  509.59 +- 0.16 px"] {
        assert!(!is_as_shown("fx  509.59 +- 0.16", other), "{other}");
    }
}

#[test]
fn a_demand_that_no_mount_meets_is_told_with_what_is_missing() {
    let directory = tempfile::tempdir().unwrap();
    let output = nearfield(directory.path(), "twin study --zone 2900 --distance 400 --out study");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stdout).unwrap().contains("of 2900 mm of the zone"));
    let output = nearfield(directory.path(), "twin study --object 3 --out study");
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(String::from_utf8(output.stderr).unwrap().contains("5 to 200 mm"));
}
