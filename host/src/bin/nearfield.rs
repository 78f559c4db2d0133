//! The command `nearfield`.

use clap::Parser as _;
use nearfield_host::cli::CommandLine;

fn main() -> std::process::ExitCode {
    CommandLine::parse().run()
}
