//! `nearfield dataset`: pictures to train and judge the detector. The work is done by the crate `nearfield-objects`.

use clap::Args;

/// Make pictures to train and judge the detector: seeded, with COCO and YOLO labels
#[derive(Debug, Args)]
pub struct Dataset {
    #[command(flatten)]
    arguments: nearfield_objects::cli::DatasetArguments,
}

impl Dataset {
    /// Runs the command.
    ///
    /// # Errors
    /// Arguments that make no sense, files that cannot be written.
    pub fn run(&self) -> anyhow::Result<u8> {
        for line in self.arguments.run()? {
            say!("{line}");
        }
        Ok(0)
    }
}
