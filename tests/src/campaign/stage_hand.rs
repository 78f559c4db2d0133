//! Plays frames to a controller while faults are active, as host, camera, laser, relays and people.

use super::Fault;
use super::claims::{DEBRIS, DEBRIS_HEIGHT, LEAD_FRAMES, claims_under};
use crate::oracle::Random;
use crate::stage::Stage;
use nearfield_host::light::LightReport;
use nearfield_host::link::{
    FrameFacts, LinkError, McuKind, McuLink, McuSession, Reply, SECRET_LENGTH, SimulatedSelfTest,
    SimulatedTick, simulated_light_report,
};
use nearfield_shared::limits::LONGEST_CAPTURE_AGE;
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH, LineScanColumn};
use nearfield_shared::service::PageBytes;
use nearfield_shared::status::{Channels, StateCode, Status};
use nearfield_shared::units::{Micros, SubpixelRow};
use nearfield_shared::wire::{SEAL_LENGTH, checksum};
use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;

/// What the camera can see, as line-scans in full light.
pub struct Scenes {
    floor: Vec<LineScanColumn>,
    cable: Vec<LineScanColumn>,
    foot: Vec<LineScanColumn>,
    drop: Vec<LineScanColumn>,
    moved: Vec<LineScanColumn>,
    debris: Vec<LineScanColumn>,
    object: Vec<LineScanColumn>,
    nothing: Vec<LineScanColumn>,
}

impl Scenes {
    /// On this stage.
    #[must_use]
    pub fn new(stage: &Stage) -> Self {
        Self {
            floor: stage.floor(),
            cable: stage.with_object(100.0, 110.0, Some(8.0)),
            foot: stage.with_object(-50.0, 50.0, Some(90.0)),
            drop: stage.with_object(50.0, 200.0, Some(-20.0)),
            moved: stage.profile(|_| Some(1.3)),
            debris: stage.with_object(f32::from(DEBRIS.0), f32::from(DEBRIS.1), Some(DEBRIS_HEIGHT)),
            object: stage.with_object(-30.0, 30.0, Some(40.0)),
            nothing: stage.profile(|_| None),
        }
    }
}

/// When the relays' command changed, as seen at the controller's outputs.
#[derive(Default)]
struct Command {
    closed: Cell<bool>,
    opened_at: Cell<Option<Micros>>,
}

/// A link that notes every change of the relays' command.
struct Noting {
    inner: Box<dyn McuLink>,
    command: Rc<Command>,
}

impl Noting {
    fn note(&self, now: Micros, reply: Result<Reply, LinkError>) -> Result<Reply, LinkError> {
        let reply = reply?;
        let closed = reply.outputs.relays != Channels::OPEN;
        if self.command.closed.replace(closed) && !closed {
            self.command.opened_at.set(Some(now));
        }
        Ok(reply)
    }
}

impl McuLink for Noting {
    fn kind(&self) -> McuKind {
        self.inner.kind()
    }

    fn start(
        &mut self,
        now: Micros,
        secret: [u8; SECRET_LENGTH],
        stored_rig: &[u8],
    ) -> Result<Reply, LinkError> {
        let reply = self.inner.start(now, secret, stored_rig);
        self.note(now, reply)
    }

    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError> {
        let reply = self.inner.tick(now, inputs);
        self.note(now, reply)
    }

    fn exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Result<Reply, LinkError> {
        let reply = self.inner.exchange(now, line_scan);
        self.note(now, reply)
    }

    fn service_page(&mut self, now: Micros) -> Result<PageBytes, LinkError> {
        self.inner.service_page(now)
    }

    fn hang(&mut self, now: Micros) -> Result<(), LinkError> {
        self.inner.hang(now)
    }
}

/// A picture: what is in it, and the laser's level that lit it.
#[derive(Clone, Copy)]
struct Shot<'a> {
    scene: &'a [LineScanColumn],
    level: u8,
}

/// Everything around the controller; see the module's documentation.
pub struct Stagehand<'a> {
    stage: &'a Stage,
    scenes: &'a Scenes,
    link: &'a dyn Fn() -> Result<Box<dyn McuLink>, LinkError>,
    session: McuSession,
    command: Rc<Command>,
    random: Random,
    active: Vec<Fault>,
    recorded: VecDeque<Shot<'a>>,
    frozen: Option<Shot<'a>>,
    last_message: Option<Vec<u8>>,
    /// Frames until the debris lies on the stripe.
    debris_lead: usize,
    frames: u64,
    seed: u64,
    lives: u64,
}

/// Pictures that a replaying host has: half a second.
const RECORDED: usize = 25;
/// The brightness of each block scatters by this share.
const BRIGHTNESS_NOISE: f64 = 0.04;
/// Frames within which a healthy controller must be armed, recovering from whatever was before.
const ARMING_PATIENCE: u32 = 700;

impl<'a> Stagehand<'a> {
    /// With a controller that has just got power.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn new(
        stage: &'a Stage,
        scenes: &'a Scenes,
        seed: u64,
        link: &'a dyn Fn() -> Result<Box<dyn McuLink>, LinkError>,
    ) -> Result<Self, LinkError> {
        let command = Rc::new(Command::default());
        let session = power_up(stage, link, &command, seed)?;
        Ok(Self {
            stage,
            scenes,
            link,
            session,
            command,
            random: Random::new(seed ^ 0x5354_4147),
            active: Vec::new(),
            recorded: VecDeque::new(),
            frozen: None,
            last_message: None,
            debris_lead: 0,
            frames: 0,
            seed,
            lives: 1,
        })
    }

    /// Frames played, in all lives.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.frames
    }

    /// The controller's time.
    #[must_use]
    pub const fn now(&self) -> Micros {
        self.session.now()
    }

    /// The newest status.
    #[must_use]
    pub const fn status(&self) -> &Status {
        self.session.status()
    }

    /// A random number in `0..limit`.
    pub fn below(&mut self, limit: u64) -> u64 {
        self.random.bits() % limit
    }

    /// Is any relay commanded closed now?
    #[must_use]
    pub fn is_commanded_closed(&self) -> bool {
        self.command.closed.get()
    }

    /// Are both main contacts closed: may the robot move?
    #[must_use]
    pub fn is_circuit_closed(&self) -> bool {
        self.session.relay_closed()
    }

    /// When the relays were commanded open since the last fault began.
    #[must_use]
    pub fn opened_at(&self) -> Option<Micros> {
        self.command.opened_at.get()
    }

    /// Presses the reset button.
    pub fn press(&mut self) {
        if !self.active.contains(&Fault::StuckButton) {
            self.session.press_reset();
        }
    }

    /// Power off and on again.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn power_cycle(&mut self) -> Result<(), LinkError> {
        self.lives += 1;
        self.command = Rc::new(Command::default());
        self.session = power_up(self.stage, self.link, &self.command, self.seed.wrapping_add(self.lives))?;
        self.recorded.clear();
        self.end_all();
        Ok(())
    }

    /// Clean frames and the reset button until the relays are closed; `false` if that takes too long.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn arm(&mut self) -> Result<bool, LinkError> {
        let mut wait = 0;
        for _ in 0..ARMING_PATIENCE {
            if self.session.relay_closed() && self.session.relay_commanded_closed() {
                return Ok(true);
            }
            match self.session.status().state {
                StateCode::Lockout => self.power_cycle()?,
                StateCode::Interlocked if wait == 0 => {
                    self.session.press_reset();
                    wait = 40;
                }
                _ => {}
            }
            wait = u32::saturating_sub(wait, 1);
            self.frame()?;
        }
        Ok(false)
    }

    /// A fault begins; tells when. The clock of its stated time runs from then.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn begin(&mut self, fault: Fault) -> Result<Micros, LinkError> {
        let begun = self.session.now();
        if self.command.closed.get() {
            self.command.opened_at.set(None);
        }
        self.active.push(fault);
        let [a, b] = fault.relays();
        if a.is_some() {
            self.session.plant.set_fault_a(a);
        }
        if b.is_some() {
            self.session.plant.set_fault_b(b);
        }
        match fault {
            Fault::Driver(driver) => self.session.plant.set_driver_fault(Some(driver)),
            Fault::SelfTest(kind) => self.session.self_test = SimulatedSelfTest::Failed(kind),
            Fault::StuckButton => self.session.hold_reset(Micros::from_millis(1 << 40)),
            Fault::Hang => self.session.hang()?,
            Fault::LateTick => self.session.stall(Micros::from_millis(16)),
            Fault::StayingDebris => self.debris_lead = LEAD_FRAMES,
            Fault::FrozenPicture => self.frozen = self.recorded.back().copied(),
            _ => {}
        }
        Ok(begun)
    }

    /// All faults end; what they have broken is repaired.
    pub fn end_all(&mut self) {
        self.active.clear();
        self.frozen = None;
        self.last_message = None;
        self.session.plant.set_fault_a(None);
        self.session.plant.set_fault_b(None);
        self.session.plant.set_driver_fault(None);
        self.session.self_test = SimulatedSelfTest::Passed;
        self.session.hold_reset(Micros::ZERO);
    }

    fn is_on(&self, fault: Fault) -> bool {
        self.active.contains(&fault)
    }

    /// One frame period.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn frame(&mut self) -> Result<(), LinkError> {
        self.frames += 1;
        if self.is_on(Fault::Silence) {
            return self.session.run_frame(None);
        }
        if self.is_on(Fault::Polls) {
            return self.session.run_poll();
        }
        let mut facts = FrameFacts {
            capture_age: Micros::new(22_000 + self.below(6_000)),
            exposure: Micros::new(1_000 + self.below(6_000)),
            verdict: HostVerdict::Clear,
            claims: claims_under(&self.active),
        };
        let shot = self.shoot(facts);
        if self.is_on(Fault::HostStop) {
            facts.verdict = HostVerdict::Stop;
        }
        if self.is_on(Fault::OldPicture) {
            facts.capture_age = LONGEST_CAPTURE_AGE.plus(Micros::new(1));
        }
        let message = self.message(shot, facts)?;
        let message = match &self.last_message {
            Some(first) if self.is_on(Fault::Repetition) => first.clone(),
            _ => message,
        };
        self.last_message = Some(message.clone());
        self.session.run_frame(Some(&message))
    }

    /// What the camera delivers.
    fn shoot(&mut self, facts: FrameFacts) -> Shot<'a> {
        let scenes = self.scenes;
        let lead = self.debris_lead;
        self.debris_lead = lead.saturating_sub(1);
        let with_foot = [Fault::Foot, Fault::FalseClaims, Fault::WeldedA, Fault::WeldedB];
        let scene = if with_foot.into_iter().any(|fault| self.is_on(fault)) {
            &scenes.foot
        } else if self.is_on(Fault::InventedFloor) {
            &scenes.object
        } else if self.is_on(Fault::Cable) {
            &scenes.cable
        } else if self.is_on(Fault::Drop) {
            &scenes.drop
        } else if self.is_on(Fault::MovedMount) {
            &scenes.moved
        } else if self.is_on(Fault::StayingDebris) && lead == 0 {
            &scenes.debris
        } else {
            &scenes.floor
        };
        let age = if self.is_on(Fault::LyingAge) {
            facts.capture_age.plus(Micros::from_millis(200))
        } else {
            facts.capture_age
        };
        let exposed = Micros::new(self.session.now().get().saturating_sub(age.get()));
        let level = if self.is_on(Fault::DeadLaser) || self.is_on(Fault::CoveredLens) {
            0
        } else if self.is_on(Fault::StuckLaserDrive) {
            255
        } else if self.is_on(Fault::NeighbourLaser) {
            // Symbols of the same length, by another robot's secret.
            let symbol = Random::new((exposed.get() / 40_000) ^ 0xA5A5).bits();
            if symbol.is_multiple_of(2) { 255 } else { 153 }
        } else {
            (255.0 * self.session.mean_laser_drive(exposed, facts.exposure)).round() as u8
        };
        let mut shot = Shot { scene, level };
        if self.is_on(Fault::SyntheticFloor) {
            shot = Shot { scene: &scenes.floor, level: 255 };
        }
        if self.is_on(Fault::Replay)
            && let Some(oldest) = self.recorded.front()
        {
            shot = *oldest;
        }
        if let Some(frozen) = self.frozen {
            shot = frozen;
        }
        self.recorded.push_back(shot);
        if self.recorded.len() > RECORDED {
            self.recorded.pop_front();
        }
        shot
    }

    /// The host's message about a picture.
    fn message(&mut self, shot: Shot<'_>, facts: FrameFacts) -> Result<Vec<u8>, LinkError> {
        let shown = if shot.level < 20 { &self.scenes.nothing[..] } else { shot.scene };
        let mut claimed = shown.to_vec();
        if self.is_on(Fault::InventedFloor) && shot.level >= 20 {
            claimed.clone_from(&self.scenes.floor);
        }
        if self.is_on(Fault::ShiftedRows) {
            for column in &mut claimed {
                column.row = SubpixelRow::from_raw(column.row.raw().saturating_add(5 * 16));
            }
        }
        let mut light = simulated_light_report(&claimed, shown, shot.level, self.session.challenge());
        self.disturb(&mut light);
        if self.is_on(Fault::NoAudit) {
            light.windows.clear();
        }
        if self.is_on(Fault::SequenceJump) {
            for _ in 0..3 {
                self.session.next_header(facts);
            }
        }
        let mut message = self.session.next_lit_line_scan(&claimed, &light, facts)?.to_vec();
        self.spoil(&mut message);
        Ok(message)
    }

    /// Texture, speckle and noise: no block is as bright as it was.
    fn disturb(&mut self, light: &mut LightReport) {
        for block in &mut light.brightness.blocks {
            let factor = self.random.within(1.0 - BRIGHTNESS_NOISE, 1.0 + BRIGHTNESS_NOISE);
            *block = (f64::from(*block) * factor) as u16;
        }
    }

    fn spoil(&mut self, message: &mut Vec<u8>) {
        if self.is_on(Fault::WrongSource) {
            message[6] ^= 2;
        }
        if self.is_on(Fault::WrongCalibration) {
            message[8] ^= 1;
        }
        if self.is_on(Fault::StaleMessage) {
            let status = u32::from_le_bytes([message[24], message[25], message[26], message[27]]);
            message[24..28].copy_from_slice(&status.wrapping_sub(20).to_le_bytes());
        }
        let body = LINE_SCAN_LENGTH - SEAL_LENGTH;
        let seal = checksum(&message[..body]).to_le_bytes();
        message[body..].copy_from_slice(&seal);
        if self.is_on(Fault::BitFlips) {
            // Up to five wrong bits are found for sure (Hamming distance 6).
            for _ in 0..3 {
                let bit = self.below(8 * LINE_SCAN_LENGTH as u64) as usize;
                message[bit / 8] ^= 1 << (bit % 8);
            }
        }
        if self.is_on(Fault::Garbage) {
            let length = 1 + self.below(LINE_SCAN_LENGTH as u64) as usize;
            message.clear();
            message.extend((0..length).map(|_| self.random.bits() as u8));
        }
        if self.is_on(Fault::Truncation) {
            let length = 1 + self.below(message.len() as u64 - 1) as usize;
            message.truncate(length.min(message.len() - 1));
        }
    }
}

fn power_up(
    stage: &Stage,
    link: &dyn Fn() -> Result<Box<dyn McuLink>, LinkError>,
    command: &Rc<Command>,
    seed: u64,
) -> Result<McuSession, LinkError> {
    let inner = link()?;
    let mut random = Random::new(seed);
    let mut secret = [0; SECRET_LENGTH];
    secret.fill_with(|| random.bits() as u8);
    let noting = Noting { inner, command: Rc::clone(command) };
    // The most permissive configuration: run-over is allowed.
    let rig = stage.rig.with_run_over(true);
    McuSession::start_with_secret(Box::new(noting), &rig.to_bytes(), rig.calibration_id(), secret)
}
