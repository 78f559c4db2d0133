//! The commands `nearfield detect` and `nearfield evaluate`, to be put into any program's command line.

/// Writes a line to standard output; a reader that has gone away (`| head`) is an error like any other.
macro_rules! say {
    ($($part:tt)*) => {{
        use std::io::Write as _;
        writeln!(std::io::stdout().lock(), $($part)*)?
    }};
}

pub mod detect;
pub mod evaluate;

use std::path::PathBuf;

use clap::Args;

use crate::model::{Backend, Choice};
use crate::network::Settings;
use crate::tiles::Tiling;

/// Bad input: exit code.
pub const BAD_INPUT: u8 = 2;

/// Which detector, and how it looks; shared by both commands.
#[derive(Debug, Clone, Args)]
pub struct DetectorArguments {
    /// Network (ONNX, or HEF for Hailo) with its card (.json) beside it; default: the built-in one.
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// What runs the network.
    #[arg(long, value_enum, default_value_t)]
    pub backend: Backend,
    /// Look at most at so many windows of a picture: the whole, then ever finer overlapping tiles; 1: no tiles.
    #[arg(long, value_name = "NUMBER", default_value_t = 30, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub windows: u16,
    /// Do not name what was found once more by the classifier that the network's card names: quicker, names more things wrongly.
    #[arg(long)]
    pub no_second_look: bool,
    /// Threads on the processor.
    #[arg(long, value_name = "NUMBER", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub threads: u16,
}

impl DetectorArguments {
    /// With a least score, or with the card's operating points.
    #[must_use]
    pub fn choice(&self, least_score: Option<f32>) -> Choice {
        let tiling = if self.windows == 1 { Tiling::Off } else { Tiling::Windows(self.windows.into()) };
        Choice {
            model: self.model.clone(),
            backend: self.backend,
            settings: Settings { tiling, least_score },
            second_look: !self.no_second_look,
            threads: self.threads.into(),
        }
    }
}

/// A number between 0 and 1.
fn parse_share(text: &str) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|_| "a number from 0 to 1 is expected".to_owned())?;
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err("a number from 0 to 1 is expected".to_owned()) }
}
