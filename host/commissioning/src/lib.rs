//! A commissioning: the trials on the floor ([`Walk`] is told what is seen, and says what a person is to do next), and the protocol
//! for people to read, print and sign: Markdown, and HTML that needs nothing else.
//!
//! ```
//! use nearfield_commissioning::{Check, Protocol, Section};
//!
//! let rod = Check::new("Rod at 0 mm", "relays open within 87 ms", "62 ms", true);
//! let protocol = Protocol {
//!     module: "front".to_owned(),
//!     sections: vec![Section { title: "On the floor".to_owned(), checks: vec![rod] }],
//!     ..Protocol::default()
//! };
//! assert!(protocol.is_passed() && protocol.markdown().contains("Rod at 0 mm"));
//! ```

mod trial;
mod walk;

pub use trial::{FROM_END_MM, LAID_WITHIN_MM, PIECE_MM, STILL, Trial};
pub use walk::{Ask, Observation, Walk};

use std::fmt::Write as _;

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// What.
    pub name: String,
    /// What it must be.
    pub demanded: String,
    /// What it is.
    pub found: String,
    /// Is it so?
    pub passed: bool,
}

impl Check {
    /// All of it.
    pub fn new(
        name: impl Into<String>,
        demanded: impl Into<String>,
        found: impl Into<String>,
        passed: bool,
    ) -> Self {
        Self { name: name.into(), demanded: demanded.into(), found: found.into(), passed }
    }
}

/// Checks that belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// Its title.
    pub title: String,
    /// In the order in which they were made.
    pub checks: Vec<Check>,
}

/// See the crate's documentation.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Protocol {
    /// The module's name.
    pub module: String,
    /// The program's version.
    pub version: String,
    /// When it was made.
    pub made: String,
    /// Who has made it; empty = to be filled in by hand.
    pub person: String,
    /// Which camera and controller: a simulated one proves nothing about a robot, and the protocol says so.
    pub equipment: String,
    /// Was there a real camera and a real controller?
    pub on_hardware: bool,
    /// The rig's identity, as the controller has it stored.
    pub calibration: String,
    /// What was looked at.
    pub sections: Vec<Section>,
    /// The configuration's text.
    pub configuration: String,
}

/// A line to write on.
const LINE: &str = "______________________________";
const SIMULATED: &str =
    "Made with simulated equipment: this shows how a commissioning goes, and releases no robot.";

impl Protocol {
    /// Was everything as demanded? A protocol without checks is not passed.
    #[must_use]
    pub fn is_passed(&self) -> bool {
        let mut checks = self.sections.iter().flat_map(|section| &section.checks).peekable();
        checks.peek().is_some() && checks.all(|check| check.passed)
    }

    fn verdict(&self) -> &'static str {
        match (self.is_passed(), self.on_hardware) {
            (true, true) => "Passed. To be signed.",
            (true, false) => "Passed, in simulation.",
            (false, _) => "NOT passed. The robot must not be released.",
        }
    }

    fn facts(&self) -> [(&'static str, &str); 6] {
        [
            ("Module", &self.module),
            ("Made", &self.made),
            ("By", if self.person.is_empty() { LINE } else { &self.person }),
            ("Equipment", &self.equipment),
            ("Calibration", &self.calibration),
            ("Program", &self.version),
        ]
    }

    /// For archives and for people with a text editor.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = format!("# Commissioning of the near-field sensor\n\n**{}**\n\n", self.verdict());
        if !self.on_hardware {
            let _ = write!(text, "{SIMULATED}\n\n");
        }
        text.push_str("| | |\n|---|---|\n");
        for (name, value) in self.facts() {
            let _ = writeln!(text, "| {name} | {} |", cell(value));
        }
        for section in &self.sections {
            let _ = write!(text, "\n## {}\n\n", cell(&section.title));
            text.push_str("| | demanded | found | |\n|---|---|---|---|\n");
            for Check { name, demanded, found, passed } in &section.checks {
                let [name, demanded, found] = [name, demanded, found].map(|words| cell(words));
                let verdict = if *passed { "passed" } else { "**NOT passed**" };
                let _ = writeln!(text, "| {name} | {demanded} | {found} | {verdict} |");
            }
        }
        let _ = write!(text, "\n## Release\n\nDate, name, signature: {LINE}\n\n## Configuration\n\n");
        for line in self.configuration.lines() {
            let _ = writeln!(text, "    {line}");
        }
        text
    }

    /// For printing; nothing is fetched from anywhere.
    #[must_use]
    pub fn html(&self) -> String {
        let verdict = if self.is_passed() { "passed" } else { "failed" };
        let mut text = format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <title>Commissioning: {}</title><style>{STYLE}</style></head><body><main>\n\
             <h1>Commissioning of the near-field sensor</h1>\n<p class=\"{verdict}\">{}</p>\n",
            escaped(&self.module),
            self.verdict()
        );
        if !self.on_hardware {
            let _ = writeln!(text, "<p>{SIMULATED}</p>");
        }
        text.push_str("<table>\n");
        for (name, value) in self.facts() {
            let _ = writeln!(text, "<tr><th scope=\"row\">{name}</th><td>{}</td></tr>", escaped(value));
        }
        text.push_str("</table>\n");
        for section in &self.sections {
            let _ = write!(text, "<h2>{}</h2>\n<table>\n", escaped(&section.title));
            text.push_str(
                "<tr><th scope=\"col\">Check</th><th scope=\"col\">Demanded</th><th scope=\"col\">Found</th>\
                 <th scope=\"col\">Verdict</th></tr>\n",
            );
            for Check { name, demanded, found, passed } in &section.checks {
                let [name, demanded, found] = [name, demanded, found].map(|words| escaped(words));
                let (class, words) = if *passed { ("passed", "passed") } else { ("failed", "NOT passed") };
                let _ = writeln!(
                    text,
                    "<tr><td>{name}</td><td>{demanded}</td><td>{found}</td><td class=\"{class}\">{words}</td></tr>"
                );
            }
            text.push_str("</table>\n");
        }
        let _ = write!(
            text,
            "<h2>Release</h2>\n<p>Date, name, signature:</p><p class=\"line\"></p>\n\
             <h2>Configuration</h2>\n<pre>{}</pre>\n</main></body></html>\n",
            escaped(&self.configuration)
        );
        text
    }
}

const STYLE: &str = "body{font:11pt/1.4 system-ui,sans-serif;max-width:52rem;margin:2rem auto;padding:0 1rem;color:#15212a}\
table{border-collapse:collapse;width:100%}th,td{border:1px solid #9aa7b0;padding:.25rem .5rem;text-align:left;vertical-align:top;overflow-wrap:break-word}\
@media(max-width:30rem){body{font-size:9pt;padding:0 .5rem}th,td{padding:.2rem .25rem}}\
.passed{color:#0b6b3a;font-weight:600}.failed{color:#a51d13;font-weight:600}.line{border-bottom:1px solid;height:3rem}\
pre{white-space:pre-wrap;overflow-wrap:anywhere;font-size:8pt}@media print{body{margin:0}h2{break-after:avoid}tr{break-inside:avoid}}";

/// In a table of Markdown.
fn cell(words: &str) -> String {
    words.replace('\\', "\\\\").replace('|', "\\|").replace('\n', " ")
}

fn escaped(words: &str) -> String {
    words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn protocol(passed: bool, on_hardware: bool) -> Protocol {
        let checks =
            vec![Check::new("a", "at most 1 | 2", "<1>", true), Check::new("b", "yes", "no", passed)];
        let sections = vec![Section { title: "First".to_owned(), checks }];
        Protocol {
            sections,
            on_hardware,
            configuration: "x = \"<&>\"\ny = 1".to_owned(),
            ..Protocol::default()
        }
    }

    #[test]
    fn one_failure_fails_all_and_nothing_looked_at_is_not_passed() {
        assert!(protocol(true, true).is_passed());
        assert!(!protocol(false, true).is_passed());
        assert!(!Protocol::default().is_passed());
        for text in [protocol(false, true).markdown(), protocol(false, true).html()] {
            assert!(text.contains("NOT passed. The robot must not be released."), "{text}");
        }
    }

    #[test]
    fn a_simulation_never_reads_like_a_release() {
        for text in [protocol(true, false).markdown(), protocol(true, false).html()] {
            assert!(text.contains("releases no robot") && !text.contains("To be signed"), "{text}");
        }
        assert!(!protocol(true, true).markdown().contains("releases no robot"));
    }

    #[test]
    fn what_people_write_stays_text() {
        let html = protocol(true, true).html();
        assert!(html.contains("&lt;1&gt;") && html.contains("x = &quot;&lt;&amp;&gt;&quot;"), "{html}");
        let markdown = protocol(true, true).markdown();
        assert!(markdown.contains("| a | at most 1 \\| 2 | <1> | passed |"), "{markdown}");
        assert!(markdown.contains("    y = 1"));
        assert!(markdown.contains(LINE), "a place to sign");
    }
}
