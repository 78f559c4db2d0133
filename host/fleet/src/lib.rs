//! Four modules joined to one robot, robots joined to a fleet: who may drive, who stands and why, who is lost.
//!
//! ```text
//! nearfield run --Tap--> queue --> thread "fleet": Report, 5 a second and at every change --> Carrier: UDP or zenoh
//!                                                                                                  |
//! nearfield fleet <-- Roster: the worst verdict wins, silence is "lost" <-- Report, checked <------+
//! ```
//!
//! **None of this is a safety function.** The modules' relays stand in series in each robot's stop circuit and stop it, whether
//! anybody listens here or not; and nothing here is ever sent to a module. What is shown errs to the careful side:
//!
//! * The worst verdict of a robot's modules is the robot's. A module that is expected and was never heard is lost.
//! * A module that was silent for [`LOST_AFTER`] is lost, by the listener's own clock: no sender's clock is trusted.
//! * Reports are checked before they are believed: lengths, characters, version, order ([`Report::parse`], [`Roster::take`]).
//!   A stranger on the network can still claim to be a module: choose the network accordingly.
//! * The roster is bounded ([`MOST_MODULES`]): what does not fit is counted, not kept.

pub mod carrier;
pub mod outlet;
pub mod report;
pub mod roster;
pub mod simulated;
pub mod view;
#[cfg(feature = "zenoh")]
pub mod zenoh_carrier;

pub use carrier::{Carrier, CarrierError, Inbox};
pub use outlet::{Outlet, REPORT_INTERVAL};
pub use report::{Relay, Report, ReportError, Verdict};
pub use roster::{LOST_AFTER, MOST_MODULES, Roster};
pub use view::{Filter, Row, View};
