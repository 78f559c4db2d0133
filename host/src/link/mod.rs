//! The host's side of the safety controller: links to it, its relays, and a whole robot's worth of simulation.
//!
//! [`McuLink`] is what any controller offers: ticks on given time and pins, exchanges of a line-scan against a status.
//! [`InProcess`] runs the firmware library in this process, [`Emulated`] the firmware's binary in QEMU, record by
//! record on the same time; both answer the same bytes. [`McuSession`] puts a link together with a [`RelayPlant`], a
//! reset button and a virtual clock, and is what commands and tests use:
//!
//! ```
//! use nearfield_host::link::{FrameFacts, InProcess, LinkError, McuSession};
//! use nearfield_shared::{linescan::LineScanColumn, rig::Rig};
//!
//! /// Powers up, arms with the reset button, and tells whether the relays have closed over a clean floor.
//! fn arm(rig: &Rig, floor: &[LineScanColumn]) -> Result<bool, LinkError> {
//!     let mut session = McuSession::start(Box::new(InProcess::new()), rig)?;
//!     for frame in 0..80 {
//!         if frame == 30 {
//!             session.press_reset(); // pressed now, released 150 ms later
//!         }
//!         session.run_columns(floor, FrameFacts::default())?;
//!     }
//!     Ok(session.relay_closed() && session.status().live_causes.is_empty())
//! }
//! ```

pub mod board;
mod emulated;
mod emulator;
mod in_process;
mod plant;
mod session;
mod simulated_light;
#[cfg(target_os = "linux")]
pub mod spi_bus;

pub use emulated::Emulated;
pub use emulator::emulator_firmware;
pub use in_process::InProcess;
pub use plant::{DriverFault, RelayFault, RelayPlant};
pub use session::{FRAME_PERIOD, FrameFacts, McuSession};
pub use simulated_light::report as simulated_light_report;

pub use nearfield_firmware::lockstep::{Reply, SimulatedSelfTest, SimulatedTick};
pub use nearfield_firmware::output_test::{Channel, PulseReadback};
pub use nearfield_firmware::relay::MirrorContacts;
pub use nearfield_firmware::safety::{Indicator, Outputs, PinInputs};
pub use nearfield_firmware::secret::SECRET_LENGTH;
use nearfield_shared::limits::WATCHDOG_TIMEOUT;
use nearfield_shared::linescan::LineScanError;
use nearfield_shared::service::PageBytes;
use nearfield_shared::status::StatusError;
use nearfield_shared::units::Micros;
use std::path::PathBuf;

/// Which controller stands at the other end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum McuKind {
    /// The firmware library in this process.
    InProcess,
    /// The firmware's binary in QEMU.
    Emulated,
}

impl McuKind {
    /// The name on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::InProcess => "in-process",
            Self::Emulated => "emulated",
        }
    }
}

/// Why a controller cannot be reached any more, or could not be started.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// There is no emulator.
    #[error(
        "cannot start {program}: {source}; `cargo xtask setup` installs it, `--mcu in-process` needs none"
    )]
    NoEmulator {
        /// The program that was tried.
        program: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// There is no firmware for the emulator.
    #[error(
        "no emulator firmware at {path}; `cargo xtask firmware` builds it, or set NEARFIELD_FIRMWARE_ELF to another"
    )]
    NoFirmware {
        /// Where it was looked for.
        path: PathBuf,
    },
    /// A system call failed.
    #[error("emulated controller: cannot {action}: {source}")]
    System {
        /// What was to be done.
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The emulator has ended or does not answer.
    #[error("emulated controller: no answer to {waiting_for}; the emulator said: {said}")]
    Silent {
        /// What should have come.
        waiting_for: &'static str,
        /// The emulator's own words.
        said: String,
    },
    /// An answer that is none.
    #[error("emulated controller: {0}")]
    Malformed(#[from] nearfield_firmware::lockstep::MalformedRecord),
    /// The relays, as the emulator shows them, are not what the controller says.
    #[error("emulated controller: its relay outputs are {seen:#04b} but it says {said:#04b}")]
    RelaysDisagree {
        /// Seen on the emulated board, bit 0 = channel A, bit 1 = channel B.
        seen: u8,
        /// Said by the controller.
        said: u8,
    },
    /// The status of a healthy controller is damaged.
    #[error("the controller's status is unreadable: {0}")]
    Status(#[from] StatusError),
    /// Columns that fit no line-scan.
    #[error("cannot encode the line-scan: {0}")]
    LineScan(#[from] LineScanError),
    /// A message that is longer than any transfer.
    #[error("a message of {length} bytes does not fit one transfer")]
    TooLong {
        /// Its length.
        length: usize,
    },
}

/// A safety controller. The caller owns the time: every call says what time it is, and time never runs backwards.
pub trait McuLink {
    /// Which kind it is.
    fn kind(&self) -> McuKind;

    /// Power comes on; `stored_rig` is what its flash holds (a rig's compact form, or anything else), `secret` what its
    /// random number generator gives, now and after every reset.
    ///
    /// # Errors
    /// The controller cannot be reached. This is never the controller's verdict on the rig: see its status.
    fn start(
        &mut self,
        now: Micros,
        secret: [u8; SECRET_LENGTH],
        stored_rig: &[u8],
    ) -> Result<Reply, LinkError>;

    /// A tick of the safety task, every 5 ms, with what its pins and self-tests say. The reply's status is the one that the next exchange would carry.
    ///
    /// # Errors
    /// The controller cannot be reached.
    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError>;

    /// A full-duplex exchange, with a line-scan or (`None`) just for the status. The reply's status is the one that
    /// was sent, put together before the line-scan was looked at; a hung controller sends zeros.
    ///
    /// # Errors
    /// The controller cannot be reached, or the message is longer than any transfer.
    fn exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Result<Reply, LinkError>;

    /// The service page that the next transaction carries behind its status; zeros = none, also of a hung controller.
    ///
    /// # Errors
    /// The controller cannot be reached.
    fn service_page(&mut self, now: Micros) -> Result<PageBytes, LinkError>;

    /// Injects a fault: the controller's program loops for ever from now on. Its pins stay as they are until its
    /// watchdog bites; then it starts again by itself with its stored rig.
    ///
    /// # Errors
    /// The controller cannot be reached.
    fn hang(&mut self, now: Micros) -> Result<(), LinkError>;
}

/// When a watchdog bites, and what a hung controller shows until then. Both links use this one.
#[derive(Debug, Clone)]
struct Watchdog {
    last_fed: Micros,
    hung: bool,
    last_reply: Option<Reply>,
}

impl Watchdog {
    const fn new() -> Self {
        Self { last_fed: Micros::ZERO, hung: false, last_reply: None }
    }

    fn started(&mut self, now: Micros, reply: &Reply) {
        *self = Self { last_fed: now, hung: false, last_reply: Some(*reply) };
    }

    fn ticked(&mut self, now: Micros, reply: &Reply) {
        if reply.fed {
            self.last_fed = now;
        }
        self.last_reply = Some(*reply);
    }

    fn bites(&self, now: Micros) -> bool {
        self.last_reply.is_some() && now.since(self.last_fed) > WATCHDOG_TIMEOUT
    }

    /// What a hung controller's pins and transmit register show; `None` while it is alive.
    fn frozen(&self) -> Option<Reply> {
        let reply = self.last_reply.filter(|_| self.hung)?;
        Some(Reply { fed: false, ..reply })
    }
}
