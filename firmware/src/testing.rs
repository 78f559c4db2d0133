//! For this crate's unit tests: a small rig's messages, and a controller that is led through its states.

use crate::output_test::PulseReadback;
use crate::relay::MirrorContacts;
use crate::safety::{
    LineScanMonitor, Outputs, PinInputs, SafetyController, StartInputs, TickInputs, TickOutput,
};
use crate::selftest::SelfTestReport;
use nearfield_shared::audit::first_row_for;
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::laser::Laser;
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::linescan::{
    AUDIT_PIXELS, AuditWindow, HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode,
};
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use nearfield_shared::run_over::{Claims, NO_CLAIMS};
use nearfield_shared::status::{Challenge, Channels, ResetCause, Status};
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
        ambient: 90,
        saturated: 10,
        claims: NO_CLAIMS,
    }
}

/// A sealed message of these columns, without any light.
pub(crate) fn message(header: &LineScanHeader, columns: &[LineScanColumn]) -> Vec<u8> {
    message_with(header, columns, &[])
}

/// As [`message`], with audit windows.
pub(crate) fn message_with(
    header: &LineScanHeader,
    columns: &[LineScanColumn],
    windows: &[AuditWindow],
) -> Vec<u8> {
    lit_message(header, columns, &BrightnessProfile::DARK, windows)
}

fn lit_message(
    header: &LineScanHeader,
    columns: &[LineScanColumn],
    brightness: &BrightnessProfile,
    windows: &[AuditWindow],
) -> Vec<u8> {
    let mut bytes = [0; LINE_SCAN_LENGTH];
    encode(&mut bytes, header, columns, brightness, windows).unwrap();
    bytes.to_vec()
}

/// Windows that show a stripe at these rows of these columns.
pub(crate) fn honest_windows(challenge: &Challenge, row_of: impl Fn(usize) -> f32) -> Vec<AuditWindow> {
    let window = |column: u16| {
        let row = row_of(usize::from(column));
        let first_row = first_row_for(row);
        let mut pixels = [100; AUDIT_PIXELS];
        for (offset, pixel) in pixels.iter_mut().enumerate() {
            let distance = f32::from(first_row) + offset as f32 - row;
            *pixel += (60.0 * (-distance * distance / 6.0).exp()) as u8;
        }
        AuditWindow { column, first_row, pixels }
    };
    challenge.columns.map(window).to_vec()
}

/// A controller on a test's clock, 20 ms a frame and 5 ms a tick, with ideal relays and an honest host.
pub(crate) struct Bench {
    pub(crate) controller: SafetyController<Box<LineScanMonitor>>,
    pub(crate) now: Micros,
    pub(crate) pins: PinInputs,
    pub(crate) self_test: Option<SelfTestReport>,
    /// What the relay drivers' outputs are when they are driven like this.
    pub(crate) drivers: fn(Channels) -> Channels,
    pub(crate) sequence: u32,
    /// What the host claims in every line-scan.
    pub(crate) claims: Claims,
    statuses: u32,
    challenge: Challenge,
    /// When the laser's level changed, and to what.
    levels: Vec<(Micros, u8)>,
    rig: Rig,
    geometry: Box<StripeGeometry<LARGEST_COLUMN_COUNT>>,
}

impl Bench {
    /// Out of a reset of this kind, with the rig stored.
    pub(crate) fn after(reset_cause: ResetCause) -> Self {
        Self::with_rig(reset_cause, rig())
    }

    /// As [`Self::after`], with this rig (of [`rig`]'s picture) stored.
    pub(crate) fn with_rig(reset_cause: ResetCause, rig: Rig) -> Self {
        let mut geometry = Box::new(StripeGeometry::empty());
        geometry.fill(&rig, Decimation::for_line_scan(640)).unwrap();
        let mut controller = SafetyController::new(SOURCE, Box::new(LineScanMonitor::new()));
        let stored_rig = rig.to_bytes();
        let start = StartInputs { reset_cause, stored_rig: &stored_rig, secret: [5; 16] };
        controller.start(&start).unwrap();
        let pins = PinInputs { mirror: MirrorContacts::BOTH_OPEN, ..PinInputs::default() };
        Self {
            controller,
            now: Micros::ZERO,
            pins,
            self_test: None,
            drivers: |driven| driven,
            sequence: 0,
            claims: NO_CLAIMS,
            statuses: 0,
            challenge: Challenge::default(),
            levels: Vec::new(),
            rig,
            geometry,
        }
    }

    /// The laser's level when a picture was exposed that is sent now.
    fn exposed_level(&self) -> u8 {
        let exposed = self.now.since(Micros::from_millis(20));
        self.levels.iter().rev().find(|(since, _)| *since <= exposed).map_or(0, |(_, level)| *level)
    }

    /// A line-scan of this height everywhere (`None` = no stripe), in the light that the laser gives.
    pub(crate) fn scan(&mut self, height: Option<f32>, verdict: HostVerdict) -> Vec<u8> {
        let level = self.exposed_level();
        self.scan_in_light(height.filter(|_| level > 0), verdict, level)
    }

    /// A line-scan of this height everywhere in this light.
    pub(crate) fn scan_in_light(&mut self, height: Option<f32>, verdict: HostVerdict, level: u8) -> Vec<u8> {
        self.scan_of(|_| height, verdict, level)
    }

    /// A line-scan of this profile, stripe coordinate to height, in the light that the laser gives.
    pub(crate) fn profile(&mut self, height: impl Fn(f32) -> Option<f32>, verdict: HostVerdict) -> Vec<u8> {
        let level = self.exposed_level();
        self.scan_of(|s| height(s).filter(|_| level > 0), verdict, level)
    }

    fn scan_of(&mut self, height: impl Fn(f32) -> Option<f32>, verdict: HostVerdict, level: u8) -> Vec<u8> {
        self.sequence += 1;
        let header = LineScanHeader {
            verdict,
            claims: self.claims,
            ..header(self.sequence, self.statuses, self.rig.calibration_id())
        };
        let row = |column: usize| {
            let map = self.geometry.map(column)?;
            Some(map.row(height(map.floor_place)?))
        };
        let columns: Vec<_> = (0..COLUMNS)
            .map(|column| {
                let row = SubpixelRow::from_pixels(row(column)?)?;
                Some(LineScanColumn { row, quality: SignalQuality::BEST })
            })
            .map(|column| column.unwrap_or(LineScanColumn::MISSING))
            .collect();
        let brightness = BrightnessProfile { blocks: [u16::from(level) * 60; 64] };
        let windows = honest_windows(&self.challenge, |column| row(column).unwrap_or(200.0));
        lit_message(&header, &columns, &brightness, &windows)
    }

    /// An exchange with this message.
    pub(crate) fn exchange(&mut self, message: Option<&[u8]>) -> Outputs {
        let status = Status::parse(&self.controller.status(self.now)).unwrap();
        (self.statuses, self.challenge) = (status.number, status.challenge);
        self.controller.on_exchange(self.now, message)
    }

    /// A tick, 5 ms after the last one; contacts and coils follow at once.
    pub(crate) fn tick(&mut self) -> TickOutput {
        let self_test = self.self_test.unwrap_or(SelfTestReport::passed(self.now));
        let output = self.controller.tick(self.now, TickInputs { pins: self.pins, self_test });
        let outputs = output.outputs;
        if self.levels.last().is_none_or(|(_, level)| *level != outputs.laser_level) {
            self.levels.push((self.now, outputs.laser_level));
        }
        self.now = self.now.plus(Micros::from_millis(5));
        self.follow(outputs);
        output
    }

    /// Contacts and coils follow their commands.
    pub(crate) fn follow(&mut self, outputs: Outputs) {
        let Channels { a, b } = outputs.relays;
        self.pins.mirror = MirrorContacts { a: !a, b: !b };
        self.pins.coils = (self.drivers)(outputs.relays);
        self.pins.pulse = outputs.pulse.map(|channel| PulseReadback {
            channel,
            coils: (self.drivers)(channel.inverted_in(outputs.relays)),
        });
    }

    /// A frame: exchange and four ticks.
    pub(crate) fn frame(&mut self, message: Option<&[u8]>) -> TickOutput {
        let outputs = self.exchange(message);
        self.pins.coils = (self.drivers)(outputs.relays);
        for _ in 0..3 {
            self.tick();
        }
        self.tick()
    }

    /// A frame of clean floor.
    pub(crate) fn clean_frame(&mut self) -> TickOutput {
        let scan = self.scan(Some(0.0), HostVerdict::Clear);
        self.frame(Some(&scan))
    }

    /// Runs clean frames and presses the reset button until the relays are closed.
    pub(crate) fn arm(&mut self) {
        self.exchange(None);
        for _ in 0..25 {
            self.clean_frame();
        }
        for frame in 0..40 {
            self.pins.reset_pressed = frame < 6;
            self.clean_frame();
        }
        let status = Status::parse(&self.controller.status(self.now)).unwrap();
        assert_eq!(self.controller.outputs().relays, Channels::CLOSED, "not armed: {status:?}");
    }
}

/// Holds the words that the check of the controller's memory sees to their rule: what differs has other words.
pub(crate) fn all_differ<W: Ord + core::fmt::Debug>(words: impl IntoIterator<Item = W>) {
    let mut words: Vec<W> = words.into_iter().collect();
    words.sort();
    assert!(words.windows(2).all(|pair| pair[0] != pair[1]), "alike: {words:?}");
}
