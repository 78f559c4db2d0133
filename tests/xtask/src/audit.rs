//! Licences, sources and bans of all dependencies, by cargo-deny and `deny.toml`.

use crate::run::Step;
use crate::tools;
use anyhow::Result;

/// Checks what can be checked offline; `--advisories` also asks the RustSec database, which has to be downloaded.
pub fn check(rest: &[String]) -> Result<()> {
    tools::AUDIT.ensure()?;
    let mut arguments = vec!["deny", "--all-features", "check", "licenses", "bans", "sources"];
    if rest.iter().any(|argument| argument == "--advisories") {
        arguments.push("advisories");
    }
    Step::cargo(&arguments).run()
}
