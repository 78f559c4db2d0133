//! The ROS 2 messages, field by field in the order of their definitions: on the wire (CDR) the order is all that counts.
//!
//! The standard ones are those of `builtin_interfaces`, `std_msgs`, `sensor_msgs` and `diagnostic_msgs` (unchanged since ROS 2
//! Foxy); [`ModuleStatus`] is defined in `nearfield_msgs/msg/ModuleStatus.msg` beside this crate's sources.

use serde::{Deserialize, Serialize};

/// `builtin_interfaces/Time`: since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// The rest.
    pub nanosec: u32,
}

impl Time {
    /// Of nanoseconds since 1970. What ROS cannot express (from the year 2038 on) stays at its end.
    #[must_use]
    pub fn of(nanoseconds: u64) -> Self {
        let sec = i32::try_from(nanoseconds / 1_000_000_000);
        sec.map_or(Self { sec: i32::MAX, nanosec: 999_999_999 }, |sec| Self {
            sec,
            nanosec: (nanoseconds % 1_000_000_000) as u32,
        })
    }
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Header {
    /// When it was seen.
    pub stamp: Time,
    /// In which frame of reference.
    pub frame_id: String,
}

/// `sensor_msgs/LaserScan`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LaserScan {
    /// When and where.
    pub header: Header,
    /// First beam, radians, counter-clockwise from the frame's x.
    pub angle_min: f32,
    /// Last beam.
    pub angle_max: f32,
    /// From beam to beam.
    pub angle_increment: f32,
    /// From beam to beam, seconds: 0, all are seen at once.
    pub time_increment: f32,
    /// From scan to scan, seconds.
    pub scan_time: f32,
    /// A shorter range is none, metres.
    pub range_min: f32,
    /// A longer range is none, metres.
    pub range_max: f32,
    /// Metres; infinite = the floor is seen, nothing stands on it.
    pub ranges: Vec<f32>,
    /// Empty.
    pub intensities: Vec<f32>,
}

/// `sensor_msgs/PointField`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PointField {
    /// Its name.
    pub name: String,
    /// Bytes from the beginning of a point.
    pub offset: u32,
    /// Its type, as [`PointField::UINT8`].
    pub datatype: u8,
    /// How many.
    pub count: u32,
}

impl PointField {
    /// An unsigned byte.
    pub const UINT8: u8 = 2;
    /// A float of four bytes.
    pub const FLOAT32: u8 = 7;
}

/// `sensor_msgs/PointCloud2`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PointCloud2 {
    /// When and where.
    pub header: Header,
    /// Rows: 1.
    pub height: u32,
    /// Points of a row.
    pub width: u32,
    /// What a point consists of.
    pub fields: Vec<PointField>,
    /// Byte order.
    pub is_bigendian: bool,
    /// Bytes of a point.
    pub point_step: u32,
    /// Bytes of a row.
    pub row_step: u32,
    /// The points.
    pub data: Vec<u8>,
    /// No point is without a place.
    pub is_dense: bool,
}

/// `diagnostic_msgs/KeyValue`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct KeyValue {
    /// What.
    pub key: String,
    /// How much.
    pub value: String,
}

/// `diagnostic_msgs/DiagnosticStatus`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    /// As [`DiagnosticStatus::OK`].
    pub level: u8,
    /// What is diagnosed.
    pub name: String,
    /// In words.
    pub message: String,
    /// Which device.
    pub hardware_id: String,
    /// Figures.
    pub values: Vec<KeyValue>,
}

impl DiagnosticStatus {
    /// In order.
    pub const OK: u8 = 0;
    /// Works, somebody should look.
    pub const WARN: u8 = 1;
    /// Does not work.
    pub const ERROR: u8 = 2;
    /// Not heard of.
    pub const STALE: u8 = 3;
}

/// `diagnostic_msgs/DiagnosticArray`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// When.
    pub header: Header,
    /// What is diagnosed.
    pub status: Vec<DiagnosticStatus>,
}

/// `nearfield_msgs/ModuleStatus`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ModuleStatus {
    /// When and where.
    pub header: Header,
    /// The module's name.
    pub module: String,
    /// As [`ModuleStatus::UNKNOWN`].
    pub relay: u8,
    /// The controller's state; empty = nothing was heard of it.
    pub state: String,
    /// Causes that hold now.
    pub live_causes: Vec<String>,
    /// Causes since the last reset.
    pub latched_causes: Vec<String>,
    /// The controller's warnings.
    pub warnings: Vec<String>,
    /// Longest gap in the stripe, metres; 0 = whole.
    pub longest_gap: f32,
    /// Highest point over the floor, metres; NaN = nothing raised, or not known.
    pub highest: f32,
    /// Lowest point, metres; NaN = nothing below the floor, or not known.
    pub lowest: f32,
    /// Per cent of the robot's speed.
    pub permitted_speed_percent: u8,
    /// From the exposure to the controller's decision, seconds.
    pub decision_age: f32,
    /// Protective zones in which something is.
    pub protective_zones: Vec<String>,
    /// Warning zones in which something is.
    pub warning_zones: Vec<String>,
    /// For the planner: `run_over`, `go_around`, `stop_and_warn`; empty = drive on.
    pub advice: String,
}

impl ModuleStatus {
    /// Nothing is known: the same as open to whoever drives.
    pub const UNKNOWN: u8 = 0;
    /// The robot must stand.
    pub const OPEN: u8 = 1;
    /// It may move.
    pub const CLOSED: u8 = 2;
}
