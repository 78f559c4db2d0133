//! The controller's sequence of inputs: one byte is one frame of a small robot, 20 ms long.
//!
//! A zero byte is a frame in which everything is as it should be: the host is honest, the contacts follow, nobody
//! touches the button. Every other byte changes something, so that a few changed bytes lead from an armed robot into
//! any fault. What must hold is written down here a second time, in other words than the controller's own:
//!
//! **After every tick the relays are open unless all of this is true:** the last line-scan
//! that a strict reader would accept came no longer than the link's time-out ago and showed a whole, live floor without
//! the host's objection; since the last stop the button was pressed and let go in its time, and the laser was dark;
//! no self-test is pending or has failed; no contact or driver has lied for longer than it may; the tick is in time.
//! **An exchange never closes them**, and opens them if its own message demands it. The rule is tested in turn, with
//! controllers that break it sentence by sentence.

mod inputs;
mod rule;
mod sensor;
#[cfg(test)]
mod tests;

use inputs::{Host, Robot};
use nearfield_firmware::output_test::PulseReadback;
use nearfield_firmware::relay::MirrorContacts;
use nearfield_firmware::safety::{
    LineScanMonitor, Outputs, PinInputs, SafetyController, StartInputs, TickInputs,
};
use nearfield_firmware::selftest::{SelfTestKind, SelfTestReport};
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, LONGEST_TICK_PERIOD, TICK_PERIOD};
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode};
use nearfield_shared::rig::Rig;
use nearfield_shared::run_over::NO_CLAIMS;
use nearfield_shared::status::{Channels, ResetCause, Status};
use nearfield_shared::units::{Micros, SequenceNumber, SignalQuality, SourceId, SubpixelRow};
use rule::{After, Grounds};
use sensor::{COLUMNS, rig, window};

const SOURCE: SourceId = SourceId::new(7);
const SECRET: [u8; 16] = [5; 16];
const TICKS: u32 = 4;
const CAPTURE_AGE: Micros = Micros::from_millis(20);
/// Frames of one input that are played; some twenty seconds of the robot's life.
const MOST_FRAMES: usize = 1_000;

/// What the pins show, from what they showed before and what the controller commands now: the command, except where the
/// rule itself is tested.
type Tampering = fn(Outputs, Outputs, After) -> Outputs;

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
    tampering: Tampering,
}

impl Bench {
    fn new(tampering: Tampering) -> Self {
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
            tampering,
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
        self.last = Outputs::SAFE;
        self.show(self.controller.outputs(), After::Start);
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
        self.grounds.note_message(self.now, host);
        self.sent = message.clone().unwrap_or_default();
        let outputs = self.controller.on_exchange(self.now, message.as_deref());
        self.show(outputs, After::Exchange);
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
        self.grounds.note_pins(self.now, robot, &self.pins, self.last);
        let output = self.controller.tick(self.now, TickInputs { pins: self.pins, self_test });
        self.show(output.outputs, After::Tick);
        if self.levels.last().is_none_or(|(_, level)| *level != self.last.laser_level) {
            self.levels.push((self.now, self.last.laser_level));
        }
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

    /// What the pins show of the controller's outputs, and whether the rule allows it.
    fn show(&mut self, outputs: Outputs, after: After) {
        self.last = (self.tampering)(self.last, outputs, after);
        let state = self.controller.findings().state;
        self.closed_once |= self.grounds.judge(self.now, after, self.last, state);
    }
}

fn coils(robot: Robot, driven: Channels) -> Channels {
    match robot {
        Robot::DriverAStuckHigh => Channels { a: true, ..driven },
        Robot::DriversShorted => Channels { a: driven.a || driven.b, b: driven.a || driven.b },
        _ => driven,
    }
}

/// Plays the bytes, one a frame, and holds the relays to their rule after every step. Were they closed at any time?
#[must_use]
pub fn controller(data: &[u8]) -> bool {
    play(data, |_, commanded, _| commanded)
}

fn play(data: &[u8], tampering: Tampering) -> bool {
    let mut bench = Bench::new(tampering);
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
