//! The bytes on the wire are those of an independent implementation: `golden/make.py` wrote the files with the Python package
//! rosbags, from ROS 2's own message definitions and from `ModuleStatus.msg`.

#![allow(clippy::unwrap_used)]

use nearfield_ros2::messages::{
    DiagnosticArray, DiagnosticStatus, Header, KeyValue, LaserScan, ModuleStatus, PointCloud2, PointField,
    Time,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

fn header(frame_id: &str) -> Header {
    Header { stamp: Time { sec: 1_700_000_000, nanosec: 123_456_789 }, frame_id: frame_id.to_owned() }
}

fn golden(text: &str) -> Vec<u8> {
    let digits: Vec<char> = text.chars().filter(char::is_ascii_hexdigit).collect();
    let byte = |two: &[char]| u8::from_str_radix(&two.iter().collect::<String>(), 16).unwrap();
    digits.chunks(2).map(byte).collect()
}

/// Four bytes say "CDR, little-endian"; what follows is the message.
fn assert_on_the_wire<M: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(
    message: &M,
    text: &str,
) {
    let golden = golden(text);
    let (encapsulation, body) = golden.split_at(4);
    assert_eq!(encapsulation, [0, 1, 0, 0]);
    let ours = cdr_encoding::to_vec::<M, byteorder::LittleEndian>(message).unwrap();
    assert_eq!(ours, body, "{message:?}");
    let (read, _) = cdr_encoding::from_bytes::<M, byteorder::LittleEndian>(body).unwrap();
    // NaN is not equal to itself; its bytes are.
    assert_eq!(cdr_encoding::to_vec::<M, byteorder::LittleEndian>(&read).unwrap(), body);
}

#[test]
fn laser_scan() {
    let scan = LaserScan {
        header: header("nearfield_front"),
        angle_min: -0.5,
        angle_max: 0.5,
        angle_increment: 0.25,
        time_increment: 0.0,
        scan_time: 0.02,
        range_min: 0.01,
        range_max: 0.75,
        ranges: vec![f32::INFINITY, 0.5, 0.625, f32::INFINITY, 0.01],
        intensities: Vec::new(),
    };
    assert_on_the_wire(&scan, include_str!("golden/LaserScan.hex"));
}

#[test]
fn point_cloud() {
    let field = |(name, offset, datatype): (&str, u32, u8)| PointField {
        name: name.to_owned(),
        offset,
        datatype,
        count: 1,
    };
    let mut data: Vec<u8> = [0.5_f32, -0.25, 0.125].iter().flat_map(|value| value.to_le_bytes()).collect();
    data.extend([200, 0, 0, 0]);
    let cloud = PointCloud2 {
        header: header("nearfield_rear_left"),
        height: 1,
        width: 1,
        fields: vec![field(("x", 0, 7)), field(("y", 4, 7)), field(("z", 8, 7)), field(("quality", 12, 2))],
        is_bigendian: false,
        point_step: 16,
        row_step: 16,
        data,
        is_dense: true,
    };
    assert_on_the_wire(&cloud, include_str!("golden/PointCloud2.hex"));
}

#[test]
fn diagnostics() {
    let text = str::to_owned;
    let pair = |key: &str, value: &str| KeyValue { key: text(key), value: text(value) };
    let fault = DiagnosticStatus {
        level: DiagnosticStatus::ERROR,
        name: text("nearfield: front"),
        message: text("the laser is dead"),
        hardware_id: text("nearfield source 1"),
        values: vec![pair("relay", "open"), pair("a", "")],
    };
    let silent = DiagnosticStatus { level: DiagnosticStatus::STALE, ..DiagnosticStatus::default() };
    let array = DiagnosticArray { header: header(""), status: vec![fault, silent] };
    assert_on_the_wire(&array, include_str!("golden/DiagnosticArray.hex"));
}

#[test]
fn module_status() {
    let texts = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>();
    let status = ModuleStatus {
        header: header("nearfield_front"),
        module: "front".to_owned(),
        relay: ModuleStatus::OPEN,
        state: "stopped".to_owned(),
        live_causes: texts(&["stripe_cut", "host_request"]),
        latched_causes: texts(&["stripe_cut"]),
        warnings: Vec::new(),
        longest_gap: 0.1775,
        highest: 0.045,
        lowest: f32::NAN,
        permitted_speed_percent: 100,
        decision_age: 0.0321,
        protective_zones: texts(&["A"]),
        warning_zones: texts(&["B", "C"]),
        advice: "go_around".to_owned(),
    };
    assert_on_the_wire(&status, include_str!("golden/ModuleStatus.hex"));
}
