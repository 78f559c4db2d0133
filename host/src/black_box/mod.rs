//! The controller's stop black box, from the host's side: fetched over the link, kept in a file, shown and replayed.
//!
//! | part | what it does |
//! |---|---|
//! | [`client`] | asks the controller, transaction by transaction, over any [`client::ServiceLink`] |
//! | [`recording`] | what was fetched, and the file that keeps it (`.nfbb`) |
//! | [`replay`] | the line-scans through the controller's own stripe monitor: which limit decided? |
//! | [`simulated`], [`simulated_flash`] | the same towards a controller in this process |
//! | [`plot`] | the stripe's heights around the stop, as an SVG picture and in the terminal |
//!
//! Nothing here can influence the controller's decision; asking is all that it can do.

pub mod client;
pub mod plot;
pub mod recording;
pub mod replay;
pub mod simulated;
pub mod simulated_flash;

pub use client::{ServiceClient, ServiceError, ServiceLink};
pub use recording::{Recording, RecordingError};
pub use replay::{Replay, ReplayError};

#[cfg(test)]
mod testing;
