//! `nearfield service`: the rig in the safety controller's flash.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use embassy_futures::block_on;
use nearfield_firmware::store::Store;
use nearfield_shared::rig::{COMPACT_LENGTH, Rig};
use nearfield_shared::units::CalibrationId;

use super::blackbox::first_number;
use crate::black_box::ServiceClient;
use crate::black_box::replay::calibration_of;
use crate::black_box::simulated::SessionLink;
use crate::black_box::simulated_flash::SimulatedFlash;
use crate::link::{InProcess, McuSession};
use crate::rig_file;

/// Read or change the rig in the safety controller's flash.
///
/// A change goes as on the robot: candidate, read back, compared, acknowledged by its calibration id; it needs the
/// service key, open relays and a controller that does not run, and it is in force from the next start on. This version
/// reaches a controller in this process, whose flash is kept in a file.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield service --flash flash.bin store-rig robot.toml
  nearfield service --flash flash.bin read-rig > stored.toml
  nearfield service --flash flash.bin store-rig robot.toml --key-open   refused: nobody holds the service key")]
pub struct ServiceArguments {
    /// The simulated controller's flash (8 KiB); a new one is made if the file is not there.
    #[arg(long, value_name = "FILE", default_value = "flash.bin")]
    flash: PathBuf,
    /// What happened as JSON on standard output.
    #[arg(long)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Store a rig, restart the controller, and see that it is in use.
    StoreRig {
        /// The rig file.
        #[arg(value_name = "RIG.toml")]
        rig: PathBuf,
        /// Leave the service key open, to see the refusal.
        #[arg(long)]
        key_open: bool,
    },
    /// Print the stored rig as a rig file.
    ReadRig,
}

impl ServiceArguments {
    /// Runs the command.
    ///
    /// # Errors
    /// A file that cannot be used, a refusal by the controller, or no rig to read.
    pub fn run(&self) -> anyhow::Result<u8> {
        match &self.command {
            Command::StoreRig { rig, key_open } => {
                let calibration = self.store(&rig_file::load(rig)?, !key_open)?;
                if self.json {
                    let id = format!("{:08x}", calibration.get());
                    say!("{}", serde_json::json!({ "calibration": id, "in_use": true }));
                } else {
                    say!(
                        "calibration {:08x} is stored, read back, acknowledged and in use",
                        calibration.get()
                    );
                }
            }
            Command::ReadRig => {
                let rig = self.read()?;
                if self.json {
                    let id = format!("{:08x}", rig.calibration_id().get());
                    say!("{}", serde_json::json!({ "calibration": id, "rig": rig_file::to_toml(&rig) }));
                } else {
                    say!("{}", rig_file::to_toml(&rig).trim_end());
                }
            }
        }
        Ok(0)
    }

    fn store(&self, rig: &Rig, service_key: bool) -> anyhow::Result<CalibrationId> {
        let flash = self.load_flash()?;
        let mut session = power_up(&flash)?;
        session.service_key = service_key;
        // The key's pin and the contacts are read at ticks.
        session.run_frame(None)?;
        let calibration = {
            let mut link = SessionLink::new(&mut session);
            ServiceClient::new(&mut link, InProcess::SOURCE, first_number()).store_rig(&rig.to_bytes())?
        };
        drop(session);
        let restarted = power_up(&flash)?;
        if restarted.status().calibration != Some(calibration) {
            bail!("the controller does not use the new rig after its restart; its flash is left as it was");
        }
        std::fs::write(&self.flash, flash.to_bytes())
            .with_context(|| format!("{}: cannot write the flash's content", self.flash.display()))?;
        Ok(calibration)
    }

    fn read(&self) -> anyhow::Result<Rig> {
        let mut session = power_up(&self.load_flash()?)?;
        let mut link = SessionLink::new(&mut session);
        let stored = ServiceClient::new(&mut link, InProcess::SOURCE, first_number())
            .read_rig()?
            .with_context(|| format!("{}: no rig is stored in this flash", self.flash.display()))?;
        Rig::from_bytes(&stored).map_err(|error| anyhow::anyhow!("{}: {error}", self.flash.display()))
    }

    fn load_flash(&self) -> anyhow::Result<SimulatedFlash> {
        match std::fs::read(&self.flash) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(SimulatedFlash::new()),
            Err(error) => Err(error).with_context(|| format!("{}: cannot read it", self.flash.display())),
            Ok(bytes) => SimulatedFlash::from_bytes(&bytes).with_context(|| {
                format!(
                    "{}: {} bytes long; a simulated flash has {}",
                    self.flash.display(),
                    bytes.len(),
                    SimulatedFlash::new().to_bytes().len()
                )
            }),
        }
    }
}

/// A controller with this flash, out of a power-on reset.
fn power_up(flash: &SimulatedFlash) -> anyhow::Result<McuSession> {
    let stored = block_on(Store::new(flash.clone(), 0).active_rig());
    let stored: &[u8] = stored.as_ref().map_or(&[], <[u8; COMPACT_LENGTH]>::as_slice);
    let controller = InProcess::with_flash(flash.clone());
    Ok(McuSession::start_with_stored(Box::new(controller), stored, calibration_of(stored))?)
}
