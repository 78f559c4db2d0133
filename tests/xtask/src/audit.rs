//! Licences, sources and bans of all dependencies, by cargo-deny and `deny.toml`.

use crate::run::Step;
use crate::tools;
use anyhow::Result;
use clap::Args;

/// What is asked.
#[derive(Debug, Args)]
#[command(after_help = "\
What is allowed, and what is excepted with its reason, stands in deny.toml. cargo-deny is installed from crates.io where it is
missing, which takes some minutes. RustSec's database comes from GitHub by git; where that cannot be reached, name a mirror:
git config --global url.MIRROR.insteadOf https://github.com/RustSec/advisory-db")]
pub struct Options {
    /// Also known vulnerabilities: RustSec's database, which is downloaded
    #[arg(long)]
    advisories: bool,
}

/// Checks what can be checked offline, and known vulnerabilities where that is asked for.
pub fn check(options: &Options) -> Result<()> {
    tools::AUDIT.ensure()?;
    let mut arguments = vec!["deny", "--all-features", "check", "licenses", "bans", "sources"];
    if options.advisories {
        arguments.push("advisories");
    }
    Step::cargo(&arguments).run()
}
