//! `cargo xtask report`: the source paper's tables made again beside ours, in one run, as Markdown and HTML.
//!
//! The README quotes `tests/REPORT.md`: its quotations are renewed with it, and a test holds them to the last report that was
//! committed.

use anyhow::{Context as _, Result, bail};
use serde_json::Value;
use std::fmt::Write as _;
use std::process::Command;
use std::time::Instant;

use crate::quotations;
use crate::run::{Step, root, target_directory};

/// Scenes of the twin that no threshold was ever looked at with.
const FIRST_SCENE: &str = "40000";
const SCENES: &str = "180";

/// Makes the report.
///
/// # Errors
/// A command that fails, or a file that cannot be read or written.
pub fn make() -> Result<()> {
    let start = Instant::now();
    Step::cargo(&["build", "--release", "--package", "nearfield-host"]).run()?;
    let mut text = String::new();
    head(&mut text);
    trials(&mut text)?;
    heights(&mut text)?;
    scenes(&mut text)?;
    tier_three(&mut text)?;
    times(&mut text)?;
    controller(&mut text)?;
    set_up(&mut text)?;
    text.push_str(OTHERS);
    let _ = writeln!(text, "\nMade in {:.0} minutes.", (start.elapsed().as_secs_f64() / 60.0).ceil());
    let (markdown, page) = (root().join("tests/REPORT.md"), target_directory().join("report.html"));
    std::fs::write(&markdown, &text).with_context(|| format!("{}: cannot write", markdown.display()))?;
    std::fs::write(&page, html(&text)).with_context(|| format!("{}: cannot write", page.display()))?;
    let readme = root().join("README.md");
    let quoting = std::fs::read_to_string(&readme).with_context(|| format!("{}", readme.display()))?;
    std::fs::write(&readme, quotations::renewed(&quoting, &text)?)
        .with_context(|| format!("{}: cannot write", readme.display()))?;
    println!("\n{}\n{}\n{} quotes it", markdown.display(), page.display(), readme.display());
    Ok(())
}

/// What the built `nearfield` prints; these exit codes are no failure.
fn nearfield(arguments: &str, codes: &[i32]) -> Result<String> {
    eprintln!("== nearfield {arguments}");
    let program = target_directory().join("release").join("nearfield");
    let output = Command::new(&program)
        .args(arguments.split_whitespace())
        .current_dir(root())
        .stderr(std::process::Stdio::inherit())
        .output()
        .with_context(|| format!("cannot start {}", program.display()))?;
    if !output.status.code().is_some_and(|code| codes.contains(&code)) {
        bail!("`nearfield {arguments}` failed ({})", output.status);
    }
    String::from_utf8(output.stdout).context("output that is no text")
}

/// One line of a file such as /proc/cpuinfo; "unknown" where there is none.
fn fact(path: &str, key: &str) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let line = text.lines().find(|line| line.starts_with(key));
    line.and_then(|line| line.split(':').nth(1))
        .map_or_else(|| "unknown".to_owned(), |value| value.trim().to_owned())
}

/// First line of what a program prints.
fn said(program: &str, arguments: &[&str]) -> String {
    Command::new(program).args(arguments).current_dir(root()).output().ok().map_or_else(
        || "unknown".to_owned(),
        |output| String::from_utf8_lossy(&output.stdout).lines().next().unwrap_or("unknown").to_owned(),
    )
}

// Writing to a String cannot fail: results of `writeln!` are dropped below.

fn head(text: &mut String) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let _ = writeln!(
        text,
        "# Report\n\nMade by `cargo xtask report` on {}, {cores} cores, {}, from commit {}. Everything is simulated or rendered; \
         **nothing was run on a board, a Pi or in a hall.** The source paper: \"Near-Field Perception for Safety Enhancement of Autonomous Mobile Robots \
         in Manufacturing Environments\" (NAMRC 54, 2026).",
        fact("/proc/cpuinfo", "model name"),
        said("rustc", &["--version"]),
        said("git", &["rev-parse", "--short", "HEAD"]),
    );
}

fn trials(text: &mut String) -> Result<()> {
    let _ = writeln!(
        text,
        "\n## Tier 1: is something there?\n\nThe paper reports less than 5 % of its trials missed, thin objects at the far end. Its trials made again in \
         the twin (`nearfield paper trials`): the same pictures for this project's vision and for the paper's own pipeline, camera 500 mm over the \
         floor at one end of the stripe, seeds 7001 to 9023.\n\n{}",
        with_intervals(nearfield("paper trials", &[0])?.trim_end())
    );
    Ok(())
}

/// A table of trials and successes, with the 95 % interval after Wilson behind each count.
fn with_intervals(table: &str) -> String {
    let line = |line: &str| -> String {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let trials = cells.get(2).and_then(|cell| cell.parse::<u32>().ok());
        let Some(trials) = trials.filter(|trials| *trials > 0 && line.starts_with('|')) else {
            return line.to_owned();
        };
        let counted = |(index, cell): (usize, &&str)| match cell.parse::<u32>() {
            Ok(count) if index > 2 && count <= trials => {
                let [low, high] = wilson(count, trials).map(|share| 100.0 * share);
                format!("{count} ({low:.0} to {high:.0} %)")
            }
            _ => (*cell).to_owned(),
        };
        cells.iter().enumerate().map(counted).collect::<Vec<_>>().join(" | ").trim().to_owned()
    };
    table.lines().map(line).collect::<Vec<_>>().join("\n")
}

/// The 95 % interval of a share (E. B. Wilson, "Probable inference, the law of succession, and statistical inference",
/// Journal of the American Statistical Association 22, 1927).
fn wilson(count: u32, of: u32) -> [f64; 2] {
    const Z: f64 = 1.959_964;
    let (n, share) = (f64::from(of), f64::from(count) / f64::from(of));
    let middle = share + Z * Z / (2.0 * n);
    let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    [middle - half, middle + half].map(|edge| (edge / (1.0 + Z * Z / n)).clamp(0.0, 1.0))
}

fn heights(text: &mut String) -> Result<()> {
    let _ = writeln!(
        text,
        "\n## Tier 2: how high is it?\n\nThe paper's table of seven objects, made again in the twin with its rig (`nearfield paper table`; camera 400 mm, laser \
         200 mm, 2304 x 1296, seed 54), millimetres. \"Closed form\" is the paper's own mask and formula.\n\n{}\n\n### Pictures with known truth\n\nRendered with Blender/Cycles and \
         a sensor model, truth from ray casting (`nearfield evaluate-scenes tests/pictures`).\n\n```\n{}\n```",
        nearfield("paper table", &[0])?.trim_end(),
        nearfield("evaluate-scenes tests/pictures", &[0])?.trim_end()
    );
    Ok(())
}

fn scenes(text: &mut String) -> Result<()> {
    let command = format!("evaluate-twin --first {FIRST_SCENE} --scenes {SCENES}");
    // 1: something was missed or stopped falsely; the figures say what.
    let _ = writeln!(
        text,
        "\n### Harsh scenes that nothing was tuned on\n\nAny floor, light, paint, object and material, three rigs (`nearfield {command}`), 95 % intervals after \
         Wilson.\n\n```\n{}\n```",
        nearfield(&command, &[0, 1])?.trim_end()
    );
    Ok(())
}

fn tier_three(text: &mut String) -> Result<()> {
    let path = root().join("host/detection/model/detector.json");
    let card: Value = serde_json::from_str(
        &std::fs::read_to_string(&path).with_context(|| format!("{}", path.display()))?,
    )?;
    let _ = writeln!(
        text,
        "\n## Tier 3: what is it?\n\nThe built-in network's figures by part, as `nearfield evaluate` found them when it was made \
         ([its story and all classes](../host/detection/model/MODEL.md)). The paper: mAP50 1.00, mAP50:95 0.99 by picture, no people among its classes, \
         25 pictures a second on an accelerator.\n\n| part | mAP50 | mAP50:95 | people found |\n|---|---|---|---|"
    );
    let metrics = card["about"]["metrics"].as_object().context("detector.json: about.metrics is missing")?;
    for (part, figures) in metrics {
        let people = &figures["people_found_as_a_person"];
        let _ = writeln!(
            text,
            "| {part} | {} | {} | {} of {} |",
            figures["ap50"], figures["ap"], people[0], people[1]
        );
    }
    let story = root().join("host/detection/model/MODEL.md");
    let story = std::fs::read_to_string(&story).with_context(|| format!("{}", story.display()))?;
    let classes: Vec<&str> = story
        .lines()
        .skip_while(|line| !line.starts_with("| class |"))
        .take_while(|line| line.starts_with('|'))
        .collect();
    if classes.is_empty() {
        bail!("host/detection/model/MODEL.md has no table of classes (`| class | ...`)");
    }
    let _ =
        writeln!(text, "\nBy class, with the paper's precision, recall and F1:\n\n{}", classes.join("\n"));
    Ok(())
}

fn times(text: &mut String) -> Result<()> {
    let _ = writeln!(
        text,
        "\n## How fast?\n\nThe paper: tier 1 40 ms, tier 2 45 ms, tier 3 40 ms, end points not defined. Ours, from the first interrupted light to open \
         contacts (`nearfield budget`; what a frame costs on this machine: `cargo xtask bench`):\n\n```\n{}\n```",
        nearfield("budget", &[0, 1])?.trim_end()
    );
    picture_times(text)
}

/// What a picture takes on this machine, tier by tier.
fn picture_times(text: &mut String) -> Result<()> {
    let judged = nearfield("evaluate-scenes --json tests/pictures", &[0])?;
    let stripe = median(judged.lines().flat_map(|line| figures(line, "time_us")).collect());
    let picture = "host/detection/tests/goldens/square.png";
    // The first pictures warm the processor's caches.
    let looked = nearfield(&format!("detect --json {}", [picture; 20].join(" ")), &[0])?;
    let detector = median(looked.lines().skip(5).flat_map(|line| figures(line, "milliseconds")).collect());
    let (Some(stripe), Some(detector)) = (stripe, detector) else {
        bail!("`evaluate-scenes --json` told no time_us, or `detect --json` no milliseconds");
    };
    let rate = |milliseconds: f64| 1000.0 / milliseconds;
    let _ = writeln!(
        text,
        "\nA picture on this machine, medians of what the commands above and `nearfield detect` tell (tier 3 with reading the file); other programs \
         that run make them longer:\n\n| tier | the paper, ms | here, ms | pictures a second |\n|---|---|---|---|\n\
         | 1 and 2, cut and heights together | 40 and 45 | {:.2} | {:.0} |\n| 3, what it is | 40 | {detector:.1} | {:.0} |",
        stripe / 1000.0,
        rate(stripe / 1000.0),
        rate(detector)
    );
    Ok(())
}

/// All numbers of this name in a line of JSON, however deep.
fn figures(line: &str, name: &str) -> Vec<f64> {
    fn collect(value: &Value, name: &str, found: &mut Vec<f64>) {
        match value {
            Value::Object(fields) => {
                found.extend(fields.get(name).and_then(Value::as_f64));
                fields.values().for_each(|value| collect(value, name, found));
            }
            Value::Array(values) => values.iter().for_each(|value| collect(value, name, found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    if let Ok(value) = serde_json::from_str(line) {
        collect(&value, name, &mut found);
    }
    found
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn controller(text: &mut String) -> Result<()> {
    let path = root().join("tests/budget.toml");
    let budget: toml::Table =
        std::fs::read_to_string(&path).with_context(|| format!("{}", path.display()))?.parse()?;
    let _ = writeln!(
        text,
        "\n## The controller\n\nCommitted bounds, enforced in every test run (`cargo xtask budget`).\n\n| what | at most |\n|---|---|"
    );
    for (name, value) in &budget {
        let _ = writeln!(text, "| {} | {value} |", name.replace('_', " "));
    }
    Ok(())
}

fn set_up(text: &mut String) -> Result<()> {
    let start = Instant::now();
    let directory = target_directory().join("report");
    std::fs::create_dir_all(&directory)
        .with_context(|| format!("{}: cannot make it", directory.display()))?;
    let out = directory.join("rig.toml");
    let told = nearfield(
        &format!(
            "calibrate rig --square 50 --view 66 --folder tests/pictures/calibration --only t2_std --out {}",
            out.display()
        ),
        &[0],
    )?;
    let seconds = start.elapsed().as_secs_f64();
    let verdict = told.lines().next().unwrap_or("no verdict");
    let _ = writeln!(
        text,
        "\n## Set-up and cost\n\n| | the paper | here |\n|---|---|---|\n\
         | set-up, tiers 1, 2, 3 | 20, 60, 10 minutes | four pictures (board, stripe, two blocks) and one command, which took {seconds:.1} s ({verdict}); no person was timed |\n\
         | parts, tiers 1, 2, 3 | 207, 207, 257 dollars | the same camera, laser and Pi, and a Nucleo-G474RE with two force-guided relays; not bought, not priced |"
    );
    Ok(())
}

/// What is sold, from the makers' own manuals.
const OTHERS: &str = "
## Beside what is sold

| | smallest object | response time | looks at | certified |
|---|---|---|---|---|
| nearfield | 5 mm gap on the stripe, everywhere it meets its capability map | see above | one line on the floor, and heights on it | no; nothing was run on hardware |
| SICK outdoorScan3 Core I/O (operating instructions 8023152/1G5N, 2022-06-28, tables 32, 33) | 50 or 70 mm | n x 40 ms + 10 ms for n scans | a plane over the floor, 3.5 or 4 m | yes |
| SICK safeVisionary2 (operating instructions 8025919/1I9E, 2023-01-09, table 4) | by body part, from a hand on | see its data sheet | a volume of 68 x 42 degrees, 2 m (4 m) | PL c, SIL 1 |

They see people far away and carry a certificate. This sees what lies on the floor right in front of the wheels, where they do not look. It replaces neither.
";

/// Markdown as a page that stands alone.
fn html(markdown: &str) -> String {
    let options = pulldown_cmark::Options::ENABLE_TABLES;
    let mut body = String::new();
    pulldown_cmark::html::push_html(&mut body, pulldown_cmark::Parser::new_ext(markdown, options));
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>nearfield: report</title>\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><style>body{{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}}\
         table{{border-collapse:collapse;display:block;overflow-x:auto}}td,th{{border:1px solid #bbb;padding:.25rem .6rem;text-align:left}}\
         pre{{background:#f4f4f4;padding:.8rem;overflow-x:auto}}</style><body>{body}</body></html>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_become_tables_and_the_page_has_a_title() {
        let page = html("# A\n\n| b | c |\n|---|---|\n| 1 | 2 |\n");
        assert!(
            page.contains("<table>") && page.contains("<td>2</td>") && page.contains("<title>"),
            "{page}"
        );
    }

    /// The reference figures are those of the usual tables: 0 of 60 and 5 of 10.
    #[test]
    fn shares_have_wilsons_interval() {
        let near = |found: [f64; 2], exact: [f64; 2]| {
            found.iter().zip(exact).all(|(found, exact)| (found - exact).abs() < 5e-4)
        };
        assert!(near(wilson(0, 60), [0.0, 0.0602]), "{:?}", wilson(0, 60));
        assert!(near(wilson(5, 10), [0.2366, 0.7634]), "{:?}", wilson(5, 10));
        assert_eq!(
            with_intervals("| object | trials | ours |\n|---|---|---|\n| bolt | 10 | 5 |\nof 34: 2"),
            "| object | trials | ours |\n|---|---|---|\n| bolt | 10 | 5 (24 to 76 %) |\nof 34: 2"
        );
    }

    #[test]
    fn a_missing_fact_is_unknown() {
        assert_eq!(fact("/no/such/file", "x"), "unknown");
        assert_eq!(said("no-such-program-here", &[]), "unknown");
    }
}
