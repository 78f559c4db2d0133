//! What the documents promise about the repository must be so.
#![allow(clippy::unwrap_used)]

use nearfield_shared::causes::StopCause;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// All Markdown files below `directory`, without what is built or hidden.
fn documents(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if name == ".github" || !(name.starts_with('.') || name == "target" || name == "node_modules") {
                documents(&path, found);
            }
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
}

/// The targets of `[text](target)`, without those on the web and those within the same page.
fn links(text: &str) -> Vec<&str> {
    text.split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
        .map(|target| target.split('#').next().unwrap_or(""))
        .filter(|target| !target.is_empty() && !target.contains("://") && !target.contains(' '))
        .collect()
}

#[test]
fn links_are_found_and_those_to_the_web_are_left_alone() {
    assert_eq!(links("a [b](c.md) ![d](e/f.png#g) [h](https://i.j) [k](#l) x"), ["c.md", "e/f.png"]);
}

#[test]
fn every_link_of_every_document_leads_somewhere() {
    let mut all = Vec::new();
    documents(&root(), &mut all);
    assert!(all.len() > 8, "only {} documents found", all.len());
    let mut dead = Vec::new();
    let mut checked = 0;
    for document in &all {
        let text = std::fs::read_to_string(document).unwrap();
        for target in links(&text) {
            checked += 1;
            if !document.parent().unwrap().join(target).exists() {
                dead.push(format!("{}: {target}", document.display()));
            }
        }
    }
    assert!(dead.is_empty(), "dead links:\n{}", dead.join("\n"));
    assert!(checked > 20, "only {checked} links found");
}

/// The rule: what the README quotes between `<!-- quoted from tests/REPORT.md -->` and `<!-- end of quotation -->` stands in the last
/// report that was committed, line by line.
#[test]
fn the_readme_quotes_the_last_report() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let report = std::fs::read_to_string(root().join("tests/REPORT.md")).unwrap();
    let known: std::collections::HashSet<&str> = report.lines().map(str::trim_end).collect();
    let quotations: Vec<&str> = readme
        .split("<!-- quoted from tests/REPORT.md -->")
        .skip(1)
        .map(|rest| rest.split_once("<!-- end of quotation -->").expect("every quotation ends").0)
        .collect();
    assert!(!quotations.is_empty());
    for line in
        quotations.iter().flat_map(|quotation| quotation.lines()).filter(|line| !line.trim().is_empty())
    {
        assert!(
            known.contains(line.trim_end()),
            "README.md quotes what tests/REPORT.md does not say: {line}"
        );
    }
}

#[test]
fn the_operators_guide_has_a_row_for_every_cause_in_the_order_of_their_bits() {
    let guide = std::fs::read_to_string(root().join("host/README.md")).unwrap();
    let table = guide.split("| cause | says | what to do |").nth(1).unwrap();
    let rows: Vec<Vec<&str>> = table
        .lines()
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect();
    assert_eq!(rows.len(), StopCause::ALL.len());
    for (row, cause) in rows.iter().zip(StopCause::ALL) {
        assert_eq!(row[0], format!("`{}`", cause.name()));
        assert_eq!(row[1], cause.words());
        assert!(row[2].len() > 10, "{}: no remedy", cause.name());
    }
}
