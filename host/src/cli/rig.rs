//! `nearfield rig`: look after rig files.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use nearfield_shared::columns::Decimation;
use nearfield_shared::rig::Rig;

use crate::rig_file;
use crate::vision::grid::picture_geometry;

/// Check rig files, or write them in the standard form.
#[derive(Debug, Args)]
pub struct RigArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Check rig files and say what each one resolves.
    Check {
        /// The rig files.
        #[arg(required = true, value_name = "RIG.toml")]
        files: Vec<PathBuf>,
    },
    /// Write a rig file in the standard form on standard output.
    Print {
        /// The rig file.
        #[arg(value_name = "RIG.toml")]
        file: PathBuf,
    },
}

impl RigArguments {
    /// Runs the command; the exit code is 2 if a file is refused.
    ///
    /// # Errors
    /// `print`: the file is refused.
    pub fn run(&self) -> anyhow::Result<u8> {
        match &self.command {
            Command::Check { files } => {
                let mut code = 0;
                for file in files {
                    let checked = rig_file::load(file).map_err(anyhow::Error::from).and_then(|rig| {
                        describe(&rig).map_err(|error| anyhow::anyhow!("{}: {error}", file.display()))
                    });
                    match checked {
                        Ok(text) => say!("{}: good\n{text}", file.display()),
                        Err(error) => {
                            eprintln!("error: {error:#}");
                            code = 2;
                        }
                    }
                }
                Ok(code)
            }
            Command::Print { file } => {
                say!("{}", rig_file::to_toml(&rig_file::load(file)?).trim_end());
                Ok(0)
            }
        }
    }
}

fn describe(rig: &Rig) -> Result<String, nearfield_shared::columns::GeometryError> {
    let geometry = picture_geometry(rig)?;
    let maps = geometry.maps();
    let rows_per_mm = maps.iter().map(|map| 1.0 / map.height_per_row.abs());
    let pitches = maps.windows(2).map(|pair| (pair[1].floor_place - pair[0].floor_place).abs());
    let range = |values: &mut dyn Iterator<Item = f32>| {
        values.fold((f32::INFINITY, 0.0_f32), |(low, high), value| (low.min(value), high.max(value)))
    };
    let (least_rows, most_rows) = range(&mut rows_per_mm.into_iter());
    let (finest, coarsest) = range(&mut pitches.into_iter());
    let decimation = Decimation::for_line_scan(rig.image().width);
    Ok(format!(
        "  calibration id      {:08x}\n  picture             {} x {}, {} columns watch the stripe\n  \
         stripe              {:.0} to {:.0} mm, {finest:.2} to {coarsest:.2} mm a column\n  \
         heights             {least_rows:.2} to {most_rows:.2} rows a millimetre at the floor\n  \
         line-scan           {} columns of {} image column(s) each",
        rig.calibration_id().get(),
        rig.image().width,
        rig.image().height,
        maps.len(),
        rig.stripe().start,
        rig.stripe().end,
        decimation.count(),
        decimation.image_columns(),
    ))
}
