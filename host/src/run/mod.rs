//! The host at work: pictures in, line-scans out, tier 3 beside it and never in its way.
//!
//! ```text
//!  source --> stripe path: vision -> line-scan -> controller -> status
//!        \                     ^ answers (newest, never waited for)
//!         \--> mailbox (newest picture) --> semantics thread: detector
//!         \--> queues of fixed length --> recorder's thread, page's threads
//! ```
//!
//! They meet in [`mailbox::Mailbox`] and [`mod@nearfield_recording::queue`] only, whose writers never wait: a detector that takes
//! ten seconds, a full disk, two hundred visitors of the page delay nothing.
//!
//! [`runner`] is the loop, [`supervised`] opens a broken source again, [`outlets`] are those who are told, and [`redecide`] makes
//! a recorded controller decide again.

pub mod checks;
pub mod commission;
pub mod controller;
pub mod detector_eye;
pub mod journal;
pub mod latency;
#[cfg(all(feature = "libcamera", target_os = "linux"))]
pub mod libcamera_source;
pub mod mailbox;
pub mod outlets;
pub mod pictures;
pub mod redecide;
pub mod rig;
pub mod row_clock;
pub mod runner;
pub mod semantics;
pub mod source;
pub mod stripe_path;
pub mod supervised;
pub mod tier_three;
pub mod twin_hands;

pub use controller::Controller;
pub use latency::Latency;
pub use mailbox::Mailbox;
pub use semantics::{Eye, Semantics};
pub use stripe_path::{Step, StripePath};
