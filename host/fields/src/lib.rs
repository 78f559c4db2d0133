//! Zones, fields and cases in force: what the host adds to the safety controller's own field, and names to people.
//!
//! ```text
//!  robot --UDP--> [`speed`]: newest speed, or none --+
//!  configuration: zones, cases ----------------------+--> [`Fields`] --> case in force, each zone's state, verdict
//!  vision: gaps; tier 3: what lies ahead ------------+
//! ```
//!
//! **The controller decides alone, and its field is always the whole stripe.** What is found here can add a stop or a warning to
//! what the host tells it; nothing can take one away. That makes the rules simple:
//!
//! * Zones are named stretches of the stripe: two on a module, A to H on a robot with four. A zone is a *protective* field, a
//!   *warning* field, or only a name.
//! * A cut as the controller counts one, or something ahead that tier 3 sees, infringes a zone: in a protective field the host
//!   asks for a stop, in a warning field for a warning. Half as long a gap is suspect: in both the host asks for a warning.
//! * Cases say which zones are which field up to which speed. Where the speed is not known, is too old, or is greater than every
//!   case's, **all cases are in force together**: ignorance is never less strict than knowledge.

use nearfield_shared::causes::StopCause;

mod fields;
pub mod speed;

pub use fields::{
    Evidence, Fields, Finding, Report, Role, Stretch, ZONES, ZoneState, ZonesError, more_careful,
};

/// Causes that are what the sensor is for: something is there. All others tell of the sensor itself, its mounting or its host.
pub const FIELD_CAUSES: [StopCause; 4] =
    [StopCause::StripeCut, StopCause::LargeObject, StopCause::Drop, StopCause::HostRequest];
