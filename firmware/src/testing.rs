//! For this crate's unit tests: a small rig's messages, and a controller that is led through its states.

use crate::relay::MirrorContacts;
use crate::safety::{LineScanMonitor, PinInputs, SafetyController, TickOutput};
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::laser::Laser;
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode};
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use nearfield_shared::status::ResetCause;
use nearfield_shared::units::{CalibrationId, Micros, SequenceNumber, SignalQuality, SourceId, SubpixelRow};

/// The module that the tests' controllers are.
pub(crate) const SOURCE: SourceId = SourceId::new(7);

/// A camera over a laser at the robot's edge.
pub(crate) fn rig() -> Rig {
    let (yaw, pitch) = (0.0_f64, 50.0_f64.to_radians());
    let forward = Vector::new(yaw.sin() * pitch.cos(), yaw.cos() * pitch.cos(), -pitch.sin());
    let right = Vector::new(yaw.cos(), -yaw.sin(), 0.0);
    let rotation = [right, forward.cross(right), forward];
    let position = Vector::new(0.0, 0.0, 400.0);
    let translation = Pose { rotation, translation: Vector::default() }.to_camera(position).scaled(-1.0);
    let intrinsics = Intrinsics { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, distortion: [0.0; 5] };
    let origin = Vector::new(0.0, 0.0, 200.0);
    let (point, direction) = (Vector::new(0.0, 500.0, 0.0), Vector::new(1.0, 0.0, 0.0));
    let normal = direction.cross(origin.minus(point));
    let normal = normal.scaled(1.0 / normal.dot(normal).sqrt());
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    let laser = Laser { origin, normal, offset: normal.dot(origin) };
    let stripe = Stripe { point, direction, start: -350.0, end: 350.0 };
    Rig::new(ImageSize { width: 640, height: 480 }, camera, laser, stripe).unwrap()
}

/// Columns of a line-scan of this rig.
pub(crate) const COLUMNS: usize = 640;

/// A good header: the next numbers are the test's to fill in.
pub(crate) fn header(sequence: u32, last_status: u32, calibration: CalibrationId) -> LineScanHeader {
    LineScanHeader {
        source: SOURCE,
        calibration,
        sequence: SequenceNumber::new(sequence),
        capture_age: Micros::from_millis(20),
        exposure: Micros::from_millis(4),
        last_status,
        verdict: HostVerdict::Clear,
    }
}

/// A sealed message of these columns.
pub(crate) fn message(header: &LineScanHeader, columns: &[LineScanColumn]) -> Vec<u8> {
    let mut bytes = [0; LINE_SCAN_LENGTH];
    encode(&mut bytes, header, columns, &[]).unwrap();
    bytes.to_vec()
}

/// A controller on a test's clock, 20 ms a frame and 5 ms a tick, with ideal relays.
pub(crate) struct Bench {
    pub(crate) controller: SafetyController<Box<LineScanMonitor>>,
    pub(crate) now: Micros,
    pub(crate) pins: PinInputs,
    pub(crate) sequence: u32,
    statuses: u32,
    rig: Rig,
    geometry: Box<StripeGeometry<LARGEST_COLUMN_COUNT>>,
}

impl Bench {
    /// Out of a reset of this kind, with the rig stored.
    pub(crate) fn after(reset: ResetCause) -> Self {
        let rig = rig();
        let mut geometry = Box::new(StripeGeometry::empty());
        geometry.fill(&rig, Decimation::for_line_scan(640)).unwrap();
        let mut controller = SafetyController::new(SOURCE, Box::new(LineScanMonitor::new()));
        controller.start(reset, &rig.to_bytes()).unwrap();
        let pins = PinInputs { mirror: MirrorContacts::BOTH_OPEN, reset_pressed: false };
        Self { controller, now: Micros::ZERO, pins, sequence: 0, statuses: 0, rig, geometry }
    }

    /// A line-scan of this height everywhere (`None` = no stripe).
    pub(crate) fn scan(&mut self, height: Option<f32>, verdict: HostVerdict) -> Vec<u8> {
        self.sequence += 1;
        let header =
            LineScanHeader { verdict, ..header(self.sequence, self.statuses, self.rig.calibration_id()) };
        let columns: Vec<_> = (0..COLUMNS)
            .map(|column| {
                let map = self.geometry.map(column)?;
                let row = SubpixelRow::from_pixels(map.row(height?))?;
                Some(LineScanColumn { row, quality: SignalQuality::BEST })
            })
            .map(|column| column.unwrap_or(LineScanColumn::MISSING))
            .collect();
        message(&header, &columns)
    }

    /// An exchange with this message.
    pub(crate) fn exchange(&mut self, message: Option<&[u8]>) {
        self.statuses += 1;
        self.controller.on_exchange(self.now, message);
    }

    /// A tick, 5 ms after the last one; the contacts follow at once.
    pub(crate) fn tick(&mut self) -> TickOutput {
        let output = self.controller.tick(self.now, self.pins);
        self.now = self.now.plus(Micros::from_millis(5));
        let relays = output.outputs.relays;
        self.pins.mirror = MirrorContacts { a: !relays.a, b: !relays.b };
        output
    }

    /// A frame of clean floor: exchange and four ticks.
    pub(crate) fn clean_frame(&mut self) -> TickOutput {
        let scan = self.scan(Some(0.0), HostVerdict::Clear);
        self.exchange(Some(&scan));
        for _ in 0..3 {
            self.tick();
        }
        self.tick()
    }

    /// Runs clean frames and presses the reset button until the relays are closed.
    pub(crate) fn arm(&mut self) {
        self.exchange(None);
        for frame in 0..16 {
            self.pins.reset_pressed = (6..12).contains(&frame);
            self.clean_frame();
        }
        assert!(self.controller.outputs().relays.a && self.controller.outputs().relays.b);
    }
}
