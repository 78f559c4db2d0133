//! What a sensor has seen, said and decided, kept in [MCAP](https://mcap.dev) files that Foxglove opens.
//!
//! ```text
//! stripe path --Tap (never waits)--> queue --> recorder's thread --> segments NAME-RUN-NNNN.mcap, oldest deleted first
//! ```
//!
//! * **Never in the way:** the stripe's path copies plain values into a queue of fixed length ([`mod@queue`]); what does not fit is
//!   dropped, counted, and told in the recording itself.
//! * **Bounded:** all recordings together keep to a limit ([`folder`]); the oldest file gives way. A full disk stops the
//!   recording, which says so and tries again later; nothing else stops.
//! * **Crash-safe:** whole chunks are written at least once a second; who is killed loses at most the last one. The reader
//!   ([`reader`]) takes files that end anywhere, and the next start of the recorder completes them ([`recovery`]).
//! * **Pictures around stops only:** line-scans, statuses and decisions are kept always, pictures from some seconds before
//!   to some seconds after a stop or a remark ([`recorder::Options`]).
//!
//! The topics are listed in [`messages`]. Line-scans and statuses are there bit for bit, so that a controller can decide again.

pub mod event;
pub mod folder;
pub mod listener;
pub mod messages;
pub mod queue;
pub mod reader;
pub mod recorder;
pub mod recovery;
mod segment;

pub use event::{Decision, Detections, Event, LockStep, Picture, Sighting, Stamped};
pub use listener::Listener;
pub use queue::{Drain, QUEUE_LENGTH, Tap, Taps, queue};
pub use reader::Recording;
pub use recorder::{Options, Recorder, State};

/// Why recording or reading failed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The system refuses.
    #[error("{}: cannot {action}: {source}", path.display())]
    File {
        /// The file or folder.
        path: std::path::PathBuf,
        /// What was to be done.
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not an MCAP file of this program.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file.
        path: std::path::PathBuf,
        /// What is wrong with it.
        problem: String,
    },
}

impl RecordingError {
    pub(crate) fn file(path: &std::path::Path, action: &'static str, source: std::io::Error) -> Self {
        Self::File { path: path.to_path_buf(), action, source }
    }
}
