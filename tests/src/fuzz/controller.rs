//! The controller's sequence of inputs: one byte is one frame of a small robot, 20 ms long.
//!
//! A zero byte is a frame in which everything is as it should be: the host is honest, the contacts follow, nobody
//! touches the button. Every other byte changes something, so that a few changed bytes lead from an armed robot into
//! any fault. What must hold is written down here a second time, in other words than the controller's own:
//!
//! **After every tick, and after every exchange, the relays are open unless all of this is true:** the last line-scan
//! that a strict reader would accept came no longer than the link's time-out ago and showed a whole, live floor without
//! the host's objection; since the last stop the button was pressed and let go in its time, and the laser was dark;
//! no self-test is pending or has failed; no contact or driver has lied for longer than it may; the tick is in time.

use nearfield_firmware::output_test::PulseReadback;
use nearfield_firmware::relay::MirrorContacts;
use nearfield_firmware::safety::{
    LineScanMonitor, Outputs, PinInputs, SafetyController, StartInputs, TickInputs,
};
use nearfield_firmware::selftest::{SelfTestKind, SelfTestReport};
use nearfield_shared::audit::first_row_for;
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::laser::Laser;
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::{
    FEEDBACK_DISCREPANCY, LARGEST_COLUMN_COUNT, LINK_TIMEOUT, LONGEST_TICK_PERIOD, SHORTEST_RESET_PRESS,
    TICK_PERIOD,
};
use nearfield_shared::linescan::{
    AUDIT_PIXELS, AuditWindow, HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode,
};
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use nearfield_shared::run_over::NO_CLAIMS;
use nearfield_shared::status::{Channels, ResetCause, StateCode, Status};
use nearfield_shared::units::{Micros, SequenceNumber, SignalQuality, SourceId, SubpixelRow};

const SOURCE: SourceId = SourceId::new(7);
const COLUMNS: u16 = 128;
const SECRET: [u8; 16] = [5; 16];
const TICKS: u32 = 4;
const CAPTURE_AGE: Micros = Micros::from_millis(20);
/// Frames of one input that are played; some twenty seconds of the robot's life.
const MOST_FRAMES: usize = 1_000;

/// What a frame does otherwise than it should; the low four bits of its byte.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Host {
    Honest,
    Silent,
    Polls,
    WarnsOnly,
    Objects,
    ShowsBox,
    ShowsHole,
    ShowsCut,
    Damages,
    Repeats,
    OtherSource,
    TooOld,
    Skips,
    FreezesLight,
    ShiftsRows,
    Garbage,
}

impl Host {
    fn of(byte: u8) -> Self {
        match byte & 15 {
            0 => Self::Honest,
            1 => Self::Silent,
            2 => Self::Polls,
            3 => Self::WarnsOnly,
            4 => Self::Objects,
            5 => Self::ShowsBox,
            6 => Self::ShowsHole,
            7 => Self::ShowsCut,
            8 => Self::Damages,
            9 => Self::Repeats,
            10 => Self::OtherSource,
            11 => Self::TooOld,
            12 => Self::Skips,
            13 => Self::FreezesLight,
            14 => Self::ShiftsRows,
            _ => Self::Garbage,
        }
    }

    /// Would a reader who has not compared it with the messages before take it as proof of a free floor? What only the
    /// vote over three line-scans or the tests of light and pixels find may pass for a few frames.
    const fn may_prove_free_floor(self) -> bool {
        matches!(
            self,
            Self::Honest
                | Self::WarnsOnly
                | Self::FreezesLight
                | Self::ShiftsRows
                | Self::ShowsBox
                | Self::ShowsHole
        )
    }
}

/// What the robot does otherwise than it should; the high four bits of a frame's byte.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Robot {
    Healthy,
    ButtonHeld,
    ServiceKey,
    ContactAStuckClosed,
    ContactBStuckOpen,
    DriverAStuckHigh,
    DriversShorted,
    PulseUnread,
    SelfTestPending,
    SelfTestFailed,
    LateTick,
    ClockStands,
    ClockJumpsBack,
    MissedTicks,
    Restart,
    WatchdogRestart,
}

impl Robot {
    fn of(byte: u8) -> Self {
        match byte >> 4 {
            0 => Self::Healthy,
            1 => Self::ButtonHeld,
            2 => Self::ServiceKey,
            3 => Self::ContactAStuckClosed,
            4 => Self::ContactBStuckOpen,
            5 => Self::DriverAStuckHigh,
            6 => Self::DriversShorted,
            7 => Self::PulseUnread,
            8 => Self::SelfTestPending,
            9 => Self::SelfTestFailed,
            10 => Self::LateTick,
            11 => Self::ClockStands,
            12 => Self::ClockJumpsBack,
            13 => Self::MissedTicks,
            14 => Self::Restart,
            _ => Self::WatchdogRestart,
        }
    }
}

/// A camera over a laser, 128 columns of about a millimetre.
fn rig() -> Rig {
    let pitch = 50.0_f64.to_radians();
    let forward = Vector::new(0.0, pitch.cos(), -pitch.sin());
    let right = Vector::new(1.0, 0.0, 0.0);
    let rotation = [right, forward.cross(right), forward];
    let position = Vector::new(0.0, 0.0, 400.0);
    let translation = Pose { rotation, translation: Vector::default() }.to_camera(position).scaled(-1.0);
    let intrinsics = Intrinsics { fx: 640.0, fy: 640.0, cx: 64.0, cy: 240.0, distortion: [0.0; 5] };
    let origin = Vector::new(0.0, 0.0, 200.0);
    let (point, direction) = (Vector::new(0.0, 500.0, 0.0), right);
    let normal = direction.cross(origin.minus(point));
    let normal = normal.scaled(1.0 / normal.dot(normal).sqrt());
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    let laser = Laser { origin, normal, offset: normal.dot(origin) };
    let stripe = Stripe { point, direction, start: -55.0, end: 55.0 };
    Rig::new(ImageSize { width: COLUMNS, height: 480 }, camera, laser, stripe).expect("a sound rig")
}

/// The rule's own memory: why the relays may be closed.
#[derive(Default)]
struct Grounds {
    /// When the last line-scan came that a strict reader believes, and whether its floor was free.
    proof: Option<(Micros, bool)>,
    /// Since the relays were last commanded open: was the button pressed and let go in time? was the laser dark?
    pressed_since: Option<Micros>,
    released: bool,
    dark: bool,
    /// The button has been seen up since the start.
    seen_up: bool,
    was_closed: bool,
    last_tick: Option<Micros>,
    /// Since when a contact has differed from the command.
    contact_lies_since: Option<Micros>,
    self_test_failed: bool,
}

struct Bench {
    rig: Rig,
    geometry: Box<StripeGeometry<LARGEST_COLUMN_COUNT>>,
    controller: SafetyController<Box<LineScanMonitor>>,
    now: Micros,
    pins: PinInputs,
    last: Outputs,
    levels: Vec<(Micros, u8)>,
    sequence: u32,
    sent: Vec<u8>,
    grounds: Grounds,
    closed_once: bool,
}

impl Bench {
    fn new() -> Self {
        let rig = rig();
        let mut geometry = Box::new(StripeGeometry::empty());
        geometry.fill(&rig, Decimation::for_line_scan(COLUMNS)).expect("a sound rig");
        let controller = SafetyController::new(SOURCE, Box::new(LineScanMonitor::new()));
        let mut bench = Self {
            rig,
            geometry,
            controller,
            now: Micros::from_millis(1_000),
            pins: PinInputs::default(),
            last: Outputs::SAFE,
            levels: Vec::new(),
            sequence: 0,
            sent: Vec::new(),
            grounds: Grounds::default(),
            closed_once: false,
        };
        bench.start(ResetCause::PowerOn);
        bench
    }

    fn start(&mut self, reset_cause: ResetCause) {
        let stored_rig = self.rig.to_bytes();
        let inputs = StartInputs { reset_cause, stored_rig: &stored_rig, secret: SECRET };
        self.controller.start(&inputs).expect("a sound rig");
        self.grounds = Grounds::default();
        self.levels.clear();
        self.pins = PinInputs { mirror: MirrorContacts::BOTH_OPEN, ..PinInputs::default() };
        self.last = self.controller.outputs();
        self.judge(self.last, "start");
    }

    fn frame(&mut self, byte: u8) {
        let (host, robot) = (Host::of(byte), Robot::of(byte));
        match robot {
            Robot::Restart => self.start(ResetCause::PowerOn),
            Robot::WatchdogRestart => self.start(ResetCause::Watchdog),
            Robot::ClockJumpsBack => self.now = Micros::new(self.now.get().saturating_sub(100_000)),
            Robot::LateTick => self.now = self.now.plus(LONGEST_TICK_PERIOD),
            _ => {}
        }
        self.exchange(host, byte);
        let ticks = if robot == Robot::MissedTicks { 0 } else { TICKS };
        for _ in 0..ticks {
            self.tick(robot);
            if robot != Robot::ClockStands {
                self.now = self.now.plus(TICK_PERIOD);
            }
        }
        if robot == Robot::MissedTicks {
            self.now = self.now.plus(Micros::from_millis(20));
        }
    }

    fn exchange(&mut self, host: Host, byte: u8) {
        let status = Status::parse(&self.controller.status(self.now)).expect("the controller's own status");
        let message = match host {
            Host::Silent => return,
            Host::Polls => None,
            Host::Repeats if !self.sent.is_empty() => Some(self.sent.clone()),
            Host::Garbage => Some(vec![byte; LINE_SCAN_LENGTH]),
            _ => Some(self.message(host, &status)),
        };
        if host.may_prove_free_floor() {
            self.grounds.proof = Some((self.now, true));
        } else if matches!(host, Host::Objects | Host::ShowsCut) {
            // One such line-scan stops at once.
            self.grounds.proof = Some((self.now, false));
        }
        self.sent = message.clone().unwrap_or_default();
        let outputs = self.controller.on_exchange(self.now, message.as_deref());
        assert!(
            self.last.relays == Channels::CLOSED || outputs.relays == Channels::OPEN,
            "an exchange has closed the relays"
        );
        self.last = outputs;
        self.follow(Robot::Healthy, false);
    }

    /// A line-scan of this host in the light that the laser gives.
    fn message(&mut self, host: Host, status: &Status) -> Vec<u8> {
        self.sequence = self.sequence.wrapping_add(if host == Host::Skips { 9 } else { 1 });
        let exposed = self.now.since(CAPTURE_AGE);
        let level =
            self.levels.iter().rev().find(|(since, _)| *since <= exposed).map_or(0, |(_, level)| *level);
        let header = LineScanHeader {
            source: if host == Host::OtherSource { SourceId::new(8) } else { SOURCE },
            calibration: self.rig.calibration_id(),
            sequence: SequenceNumber::new(self.sequence),
            capture_age: if host == Host::TooOld { Micros::from_millis(61) } else { CAPTURE_AGE },
            exposure: Micros::from_millis(4),
            last_status: status.number,
            verdict: match host {
                Host::WarnsOnly => HostVerdict::Warn,
                Host::Objects => HostVerdict::Stop,
                _ => HostVerdict::Clear,
            },
            ambient: 90,
            saturated: 10,
            claims: NO_CLAIMS,
        };
        let row = |column: u16| {
            let map = self.geometry.map(usize::from(column))?;
            let object = (30..60).contains(&column);
            match host {
                Host::ShowsCut if object => None,
                Host::ShowsBox if object => Some(map.row(60.0)),
                Host::ShowsHole if object => Some(map.row(-20.0)),
                _ => Some(map.row(0.0)),
            }
            .filter(|_| level > 0)
        };
        let shift = if host == Host::ShiftsRows { 9.0 } else { 0.0 };
        let columns: Vec<_> = (0..COLUMNS)
            .map(|column| row(column).and_then(SubpixelRow::from_pixels))
            .map(|row| row.map(|row| LineScanColumn { row, quality: SignalQuality::BEST }))
            .map(|column| column.unwrap_or(LineScanColumn::MISSING))
            .collect();
        let light = if host == Host::FreezesLight { 255 } else { level };
        let brightness = BrightnessProfile { blocks: [u16::from(light) * 60; 64] };
        let windows: Vec<_> = status
            .challenge
            .columns
            .map(|column| window(column, row(column).unwrap_or(200.0) + shift))
            .to_vec();
        let mut bytes = [0; LINE_SCAN_LENGTH];
        encode(&mut bytes, &header, &columns, &brightness, &windows).expect("a sound line-scan");
        if host == Host::Damages {
            bytes[700] ^= 4;
        }
        bytes.to_vec()
    }

    fn tick(&mut self, robot: Robot) {
        self.pins.reset_pressed = robot == Robot::ButtonHeld;
        self.pins.service_key = robot == Robot::ServiceKey;
        self.follow(robot, true);
        let passed = SelfTestReport::passed(self.now);
        let self_test = match robot {
            Robot::SelfTestPending => SelfTestReport::PENDING,
            Robot::SelfTestFailed => SelfTestReport { failed: Some(SelfTestKind::Clock), ..passed },
            _ => passed,
        };
        self.note(robot);
        let output = self.controller.tick(self.now, TickInputs { pins: self.pins, self_test });
        self.last = output.outputs;
        if self.levels.last().is_none_or(|(_, level)| *level != self.last.laser_level) {
            self.levels.push((self.now, self.last.laser_level));
        }
        self.judge(self.last, "tick");
        if robot == Robot::SelfTestPending {
            assert_eq!(self.last.relays, Channels::OPEN, "closed before the self-tests were through");
        }
        self.pins.pulse = match (robot, self.last.pulse) {
            (Robot::PulseUnread, _) | (_, None) => None,
            (_, Some(channel)) => {
                let driven = channel.inverted_in(self.last.relays);
                Some(PulseReadback { channel, coils: coils(robot, driven) })
            }
        };
    }

    /// Contacts and coils follow the command, or do not. An exchange leaves the pulse as it is.
    fn follow(&mut self, robot: Robot, contacts: bool) {
        let Channels { a, b } = self.last.relays;
        self.pins.coils = coils(robot, self.last.relays);
        if contacts {
            self.pins.mirror = MirrorContacts {
                a: !a && robot != Robot::ContactAStuckClosed,
                b: !b || robot == Robot::ContactBStuckOpen,
            };
        }
    }

    /// Takes down what speaks for closed relays, from the inputs alone, before the controller sees them.
    fn note(&mut self, robot: Robot) {
        let grounds = &mut self.grounds;
        match (self.pins.reset_pressed, grounds.pressed_since) {
            (true, None) if grounds.seen_up => grounds.pressed_since = Some(self.now),
            (false, Some(since)) => {
                grounds.released |= self.now.since(since) >= SHORTEST_RESET_PRESS;
                grounds.pressed_since = None;
            }
            _ => {}
        }
        grounds.seen_up |= !self.pins.reset_pressed;
        grounds.dark |= grounds.released && self.last.laser_level == 0;
        grounds.self_test_failed |= robot == Robot::SelfTestFailed;
        let lies = self.pins.mirror.main_contacts() != self.last.relays;
        grounds.contact_lies_since = if lies { grounds.contact_lies_since.or(Some(self.now)) } else { None };
    }

    fn judge(&mut self, outputs: Outputs, place: &str) {
        let closed = outputs.relays != Channels::OPEN;
        let grounds = &mut self.grounds;
        let late = grounds.last_tick.is_some_and(|before| {
            let period = self.now.since(before);
            period > LONGEST_TICK_PERIOD || period == Micros::ZERO
        });
        if place == "tick" {
            grounds.last_tick = Some(self.now);
        }
        if closed {
            let why = |broken: &str| panic!("closed after a {place} at {:?} {broken}", self.now);
            match grounds.proof {
                Some((at, true)) if self.now.since(at) <= LINK_TIMEOUT => {}
                found => why(&format!("without fresh proof of a free floor: {found:?}")),
            }
            if !(grounds.was_closed || grounds.released && grounds.dark) {
                why("without a press of the button and a dark test");
            }
            if late {
                why("by a tick that is late or too early");
            }
            if grounds.self_test_failed {
                why("after a failed self-test");
            }
            if grounds.contact_lies_since.is_some_and(|since| self.now.since(since) > FEEDBACK_DISCREPANCY) {
                why("while a contact lies");
            }
            assert_eq!(self.controller.findings().state, StateCode::Running);
            assert_eq!(outputs.relays, Channels::CLOSED, "one channel alone");
            self.closed_once = true;
        } else if grounds.was_closed {
            // Whatever stopped it, only a new press and a new dark test lead back.
            (grounds.released, grounds.dark) = (false, false);
        }
        grounds.was_closed = closed;
    }
}

fn coils(robot: Robot, driven: Channels) -> Channels {
    match robot {
        Robot::DriverAStuckHigh => Channels { a: true, ..driven },
        Robot::DriversShorted => Channels { a: driven.a || driven.b, b: driven.a || driven.b },
        _ => driven,
    }
}

/// A window that shows a stripe at this row.
fn window(column: u16, row: f32) -> AuditWindow {
    let first_row = first_row_for(row);
    let mut pixels = [100_u8; AUDIT_PIXELS];
    for (pixel, offset) in pixels.iter_mut().zip(0_u8..) {
        let distance = f32::from(first_row) + f32::from(offset) - row;
        // A bell of 60 grey levels; the shape does not matter, only its middle.
        #[allow(clippy::as_conversions, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let light = (60.0 * (-distance * distance / 6.0).exp()) as u8;
        *pixel += light;
    }
    AuditWindow { column, first_row, pixels }
}

/// Plays the bytes, one a frame, and holds the relays to their rule after every step. Were they closed at any time?
#[must_use]
pub fn controller(data: &[u8]) -> bool {
    let mut bench = Bench::new();
    for byte in data.iter().take(MOST_FRAMES) {
        bench.frame(*byte);
    }
    bench.closed_once
}

/// Frames that lead from power-up to closed relays: clean floor, the button for 120 ms, the dark test, light again.
#[must_use]
pub fn arming_frames() -> Vec<u8> {
    const BUTTON: u8 = 0x10;
    [vec![2], vec![0; 30], vec![BUTTON; 6], vec![0; 40]].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rule would hold for a controller that never closes: it must close, and not without the button.
    #[test]
    fn an_honest_robot_runs_after_a_press_of_the_button() {
        assert!(controller(&arming_frames()));
        assert!(!controller(&[0; 90]));
    }
}
