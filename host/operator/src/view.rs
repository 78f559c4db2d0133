//! What the page and programs are shown, as JSON.

use serde::Serialize;

/// Something with a name for programs and words for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Named {
    /// For programs.
    pub name: &'static str,
    /// For people.
    pub words: &'static str,
}

/// The short state, for programs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Status {
    /// The module's name.
    pub module: String,
    /// Seconds since the program began, the host's clock.
    pub uptime_s: f64,
    /// May the robot move, as far as the contacts tell: `open` (it may not), `closed`, or `unknown`.
    pub relay: &'static str,
    /// The controller's state; empty = nothing was heard of it lately.
    pub state: &'static str,
    /// Causes that hold now.
    pub live: Vec<Named>,
    /// Causes since the last reset.
    pub latched: Vec<Named>,
    /// The controller's warnings.
    pub warnings: Vec<Named>,
    /// Longest gap in the stripe, millimetres; 0 = whole.
    pub longest_gap_mm: f32,
    /// Highest point over the floor, millimetres.
    pub highest_mm: Option<f32>,
    /// Lowest point, millimetres.
    pub lowest_mm: Option<f32>,
    /// Permitted speed, per cent.
    pub permitted_speed_percent: u8,
    /// The robot's speed as it is told, mm/s; none = not known.
    pub speed_mm_s: Option<f32>,
    /// The case in force, from 1; none = there are none, or all are in force together.
    pub case: Option<u8>,
    /// The zones of this module; none of them while no picture comes.
    pub zones: Vec<ZoneNow>,
    /// For the robot's planner: `run_over`, `go_around` or `stop_and_warn`; none = drive on.
    pub advice: Option<&'static str>,
    /// From the exposure to the decision, milliseconds: the last one, the longest, and the bound.
    pub decision_age_ms: [f64; 3],
    /// From the picture in memory to the status received, milliseconds, over the last thousand pictures.
    pub latency: Latency,
    /// Counted since the program began.
    pub counts: Counts,
    /// The recording.
    pub recording: Recording,
}

/// A zone at the moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ZoneNow {
    /// A to H.
    pub name: char,
    /// `named`, `warning` or `protective`.
    pub role: &'static str,
    /// `free`, `suspect` or `infringed`.
    pub finding: &'static str,
}

/// Milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Latency {
    /// Half of the pictures are faster.
    pub p50_ms: f64,
    /// All but one in a hundred.
    pub p99_ms: f64,
    /// The slowest.
    pub longest_ms: f64,
}

/// Counted since the program began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counts {
    /// Pictures asked for.
    pub pictures: u64,
    /// Of them: did not come in time, or could not be used.
    pub missing: u64,
    /// Line-scans that the controller did not take.
    pub lost: u64,
    /// Times that the source of pictures was opened again.
    pub restarts: u64,
    /// Times that the relays opened.
    pub stops: u64,
    /// Line-scans that the controller accepted since its start.
    pub accepted: u32,
    /// ... and refused.
    pub refused: u32,
}

/// How the recording stands.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Recording {
    /// Is there to be one?
    pub wanted: bool,
    /// The file that is written.
    pub file: String,
    /// Bytes since the program began.
    pub written: u64,
    /// Events that were lost on the way.
    pub dropped: u64,
    /// Why nothing is recorded.
    pub problem: Option<String>,
}

/// A stop.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stop {
    /// Counts the stops since the program began.
    pub number: u64,
    /// Milliseconds since 1970.
    pub unix_ms: u64,
    /// Why.
    pub causes: Vec<Named>,
    /// Longest gap then, millimetres.
    pub longest_gap_mm: f32,
    /// Highest point then, millimetres.
    pub highest_mm: Option<f32>,
    /// The recording that holds it; empty = none.
    pub recording: String,
}

/// An object of tier 3, in the picture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Object {
    /// Category of the action table.
    pub category: String,
    /// 0 to 1.
    pub confidence: f64,
    /// Left, top, right, bottom; pixels of the full picture.
    pub pixels: [f64; 4],
}

/// The stripe, thinned out for people: of neighbouring columns the one that is farthest from the floor is shown.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Profile {
    /// Place along the stripe, millimetres.
    pub place_mm: Vec<f32>,
    /// Height over the floor, millimetres; none = no stripe is seen.
    pub height_mm: Vec<Option<f32>>,
    /// The same columns in the full picture, pixels.
    pub column: Vec<f32>,
    /// Rows in the full picture.
    pub row: Vec<Option<f32>>,
}

/// The picture for people.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct PictureView {
    /// Counts the pictures; 0 = there is none.
    pub number: u64,
    /// Columns and rows of the full picture, in which places are given.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

/// Everything that the page shows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Live {
    /// The short state.
    pub status: Status,
    /// The stripe.
    pub profile: Profile,
    /// The picture.
    pub picture: PictureView,
    /// Does tier 3 run, and did it answer last time?
    pub tier_three: Option<bool>,
    /// What it saw.
    pub objects: Vec<Object>,
    /// The last stops, newest first.
    pub stops: Vec<Stop>,
}
