//! What does not change while the program runs.

use serde::Serialize;

/// A part of the response time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Part {
    /// What takes the time.
    pub name: String,
    /// In the middle, milliseconds.
    pub typical_ms: f64,
    /// At most, milliseconds.
    pub worst_ms: f64,
}

/// The smallest object that trips at a place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Smallest {
    /// Along the stripe, millimetres.
    pub place_mm: f64,
    /// Width, millimetres; none = nothing is surely seen here.
    pub width_mm: Option<f64>,
}

/// A named stretch of the stripe.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ZoneView {
    /// A to H.
    pub name: String,
    /// First place, millimetres.
    pub start_mm: f64,
    /// Last place, millimetres.
    pub end_mm: f64,
    /// `protective` or `warning`.
    pub field: &'static str,
}

/// What does not change while the program runs.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct About {
    /// The module's name.
    pub module: String,
    /// The program's version.
    pub version: String,
    /// Ends of the watched stripe, millimetres.
    pub stripe_mm: [f64; 2],
    /// The response time, part by part.
    pub response: Vec<Part>,
    /// The vote over several pictures adds this for narrow things, milliseconds.
    pub vote_ms: f64,
    /// At most, for narrow things, milliseconds.
    pub response_worst_ms: f64,
    /// Where the stripe must lie at least, millimetres before the robot.
    pub stopping_distance_mm: f64,
    /// Where it lies.
    pub distance_mm: f64,
    /// The speed that this permits, mm/s.
    pub permitted_speed_mm_s: f64,
    /// The smallest object at each place.
    pub capability: Vec<Smallest>,
    /// Named stretches.
    pub zones: Vec<ZoneView>,
    /// How many cases there are.
    pub cases: usize,
    /// Does somebody hold a token for remarks?
    pub takes_remarks: bool,
    /// Does somebody hold a token, to begin a commissioning?
    pub takes_orders: bool,
}
