//! The README's quotations from the report, renewed with it: the same lines, with the figures of now.

use anyhow::{Result, bail};

const BEGIN: &str = "<!-- quoted from tests/REPORT.md -->";
const END: &str = "<!-- end of quotation -->";

/// The README with every quoted line as the report has it now.
///
/// # Errors
/// A quoted line of which the report says nothing any more, or more than one thing; a quotation without an end.
pub fn renewed(readme: &str, report: &str) -> Result<String> {
    let mut parts = readme.split(BEGIN);
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let Some((quoted, rest)) = part.split_once(END) else {
            bail!("README.md: a quotation has no `{END}`")
        };
        let lines: Vec<String> = quoted.split('\n').map(|line| renew(line, report)).collect::<Result<_>>()?;
        text = [&text, BEGIN, &lines.join("\n"), END, rest].concat();
    }
    Ok(text)
}

/// The report's line about the same thing.
fn renew(line: &str, report: &str) -> Result<String> {
    if line.trim().is_empty() || report.lines().any(|known| known == line) {
        return Ok(line.to_owned());
    }
    let about_the_same: Vec<&str> = report.lines().filter(|known| subject(known) == subject(line)).collect();
    match about_the_same[..] {
        [one] => Ok(one.to_owned()),
        [] => bail!("README.md quotes `{line}`; the report says nothing of the kind: change the quotation"),
        _ => bail!("README.md quotes `{line}`; the report has several such lines: change the quotation"),
    }
}

/// What a line is about: a table's row by its first cell and its number of cells, other text by what stands before its colon.
fn subject(line: &str) -> (&str, usize) {
    match line.strip_prefix('|') {
        Some(row) => (row.split('|').next().unwrap_or_default().trim(), row.matches('|').count()),
        None => (line.split(':').next().unwrap_or_default(), 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REPORT: &str =
        "| object | found |\n|---|---|\n| cable | 7 (5 to 8) |\n\nOf 34: ours 1\n| cable | 4 | 5 |\n";

    #[test]
    fn quoted_lines_get_the_reports_figures_and_nothing_else_changes() {
        let readme = format!(
            "a\n{BEGIN}\n| object | found |\n|---|---|\n| cable | 6 |\n\nOf 34: ours 0\n{END}\n| cable | 6 |\n"
        );
        let wanted = format!(
            "a\n{BEGIN}\n| object | found |\n|---|---|\n| cable | 7 (5 to 8) |\n\nOf 34: ours 1\n{END}\n| cable | 6 |\n"
        );
        assert_eq!(renewed(&readme, REPORT).ok(), Some(wanted));
    }

    #[test]
    fn a_line_that_the_report_does_not_have_is_refused_by_name() {
        let quoting = |line: &str| {
            renewed(&format!("{BEGIN}\n{line}\n{END}"), REPORT).map_err(|error| error.to_string())
        };
        assert!(quoting("| rope | 6 |").is_err_and(|error| error.contains("rope")));
        let twice = format!("{REPORT}| cable | 8 |\n");
        assert!(renewed(&format!("{BEGIN}\n| cable | 6 |\n{END}"), &twice).is_err(), "which of the two?");
        assert!(renewed(&format!("{BEGIN}\n| cable | 6 |\n"), REPORT).is_err(), "no end");
    }
}
