//! The host at work: pictures in, line-scans out, tier 3 beside it and never in its way.
//!
//! ```text
//!  source --> stripe path: vision -> line-scan -> controller -> status
//!        \                     ^ answers (newest, never waited for)
//!         \--> mailbox (newest picture) --> semantics thread: detector
//! ```
//!
//! The two meet in [`mailbox::Mailbox`] only, whose writer never waits: a detector that takes ten seconds delays nothing.

pub mod controller;
pub mod detector_eye;
pub mod latency;
pub mod mailbox;
pub mod semantics;
pub mod source;
pub mod stripe_path;

pub use controller::Controller;
pub use latency::Latency;
pub use mailbox::Mailbox;
pub use semantics::{Eye, Semantics};
pub use stripe_path::{Step, StripePath};
