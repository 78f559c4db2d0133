//! A rig, line-scans of given heights, and a status, for the tests of this crate.

#![allow(clippy::unwrap_used, dead_code, reason = "each test program uses its own share")]

use std::time::Duration;

use nearfield_fields::Report;
use nearfield_recording::{Decision, Event};
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::causes::StopCauses;
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::laser::Laser;
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode};
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use nearfield_shared::run_over::NO_CLAIMS;
use nearfield_shared::status::{
    Challenge, Channels, HealthFigures, LaserMode, ResetCause, STATUS_LENGTH, StateCode, Status,
    TrustFigures, Warnings,
};
use nearfield_shared::units::{
    CalibrationId, Micros, Millimetres, SequenceNumber, SignalQuality, SourceId, SubpixelRow,
};

/// The stripe 500 mm before the robot, from -300 to 300 mm; camera 400 mm high, laser 200 mm.
pub fn rig() -> Rig {
    rig_with(Vector::new(0.0, 0.0, 200.0), 500.0)
}

/// The same with the laser elsewhere and the stripe at another distance.
pub fn rig_with(origin: Vector, distance: f64) -> Rig {
    let (sin, cos) = 40_f64.to_radians().sin_cos();
    let rotation = [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, -cos, -sin), Vector::new(0.0, sin, -cos)];
    let camera_at = Vector::new(0.0, distance - 500.0, 400.0);
    let translation = Pose { rotation, translation: Vector::default() }.to_camera(camera_at).scaled(-1.0);
    let intrinsics = Intrinsics { fx: 1792.0, fy: 1792.0, cx: 1151.5, cy: 647.5, distortion: [0.0; 5] };
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    let (point, direction) = (Vector::new(0.0, distance, 0.0), Vector::new(1.0, 0.0, 0.0));
    let normal = direction.cross(origin.minus(point));
    let normal = normal.scaled(1.0 / normal.dot(normal).sqrt());
    let laser = Laser { origin, normal, offset: normal.dot(origin) };
    let stripe = Stripe { point, direction, start: -300.0, end: 300.0 };
    Rig::new(ImageSize { width: 2304, height: 1296 }, camera, laser, stripe).unwrap()
}

/// A line-scan; `height` tells the height, millimetres, by the place on the stripe that a column looks at (none = no stripe).
pub fn line_scan(rig: &Rig, height: impl Fn(f32) -> Option<f32>) -> [u8; LINE_SCAN_LENGTH] {
    let decimation = Decimation::for_line_scan(rig.image().width);
    let mut geometry = Box::new(StripeGeometry::<LARGEST_COLUMN_COUNT>::empty());
    geometry.fill(rig, decimation).unwrap();
    let columns: Vec<LineScanColumn> = (0..usize::from(decimation.count()))
        .map(|column| {
            let row = geometry.map(column).and_then(|map| Some(map.row(height(map.floor_place)?)));
            row.and_then(SubpixelRow::from_pixels).map_or(LineScanColumn::MISSING, |row| LineScanColumn {
                row,
                quality: SignalQuality::new(200),
            })
        })
        .collect();
    let header = LineScanHeader {
        source: SourceId::new(1),
        calibration: CalibrationId::new(1),
        sequence: SequenceNumber::new(1),
        capture_age: Micros::from_millis(20),
        exposure: Micros::from_millis(4),
        last_status: 0,
        verdict: HostVerdict::Clear,
        ambient: 0,
        saturated: 0,
        claims: NO_CLAIMS,
    };
    let mut bytes = [0; LINE_SCAN_LENGTH];
    encode(&mut bytes, &header, &columns, &BrightnessProfile::DARK, &[]).unwrap();
    bytes
}

/// Everything as it should be.
pub fn status() -> Status {
    Status {
        source: SourceId::new(7),
        calibration: None,
        firmware: 0xBEEF,
        number: 1,
        echoed_sequence: SequenceNumber::new(1),
        now: Micros::from_millis(1000),
        state: StateCode::Running,
        relay_command: Channels::CLOSED,
        relay_readback: Channels::CLOSED,
        reset_cause: ResetCause::PowerOn,
        live_causes: StopCauses::NONE,
        latched_causes: StopCauses::NONE,
        longest_gap: None,
        highest: None,
        lowest: None,
        longest_unknown: Millimetres::new(0.0),
        size: None,
        laser_mode: LaserMode::Coded,
        warnings: Warnings::NONE,
        decision_age: Micros::new(32_100),
        longest_decision_age: Micros::new(40_000),
        response_bound: Micros::from_millis(60),
        accepted: 12,
        refused: [0; 8],
        challenge: Challenge::default(),
        fault: None,
        failed_self_test: 0,
        trust: TrustFigures::default(),
        health: HealthFigures {
            floor_offset: Millimetres::new(0.0),
            floor_rise: Millimetres::new(0.0),
            smallest_object: Millimetres::new(3.0),
            smallest_object_place: Millimetres::new(0.0),
            permitted_speed_percent: 100,
        },
        run_over: None,
    }
}

/// A transaction.
pub fn exchange(line_scan: Option<[u8; LINE_SCAN_LENGTH]>, status: [u8; STATUS_LENGTH]) -> Event {
    Event::Exchange { step: None, line_scan, status }
}

/// A picture that was dealt with.
pub fn decision(relay_closed: bool) -> Event {
    Event::Decision(Decision {
        picture: 1,
        exposed: Micros::from_millis(980),
        verdict: HostVerdict::Clear,
        relay_closed,
        fields: Report::default(),
        advice: None,
        latency: Duration::from_millis(1),
    })
}
