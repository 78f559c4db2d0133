//! A controller with its relays, its reset button and its host, on a virtual clock.

use super::in_process::SIMULATED_SOURCE;
use super::simulated_light::{self, SimulatedLight};
use super::{
    LinkError, McuKind, McuLink, Outputs, PinInputs, RelayPlant, SECRET_LENGTH, SimulatedSelfTest,
    SimulatedTick,
};
use crate::light::LightReport;
use nearfield_shared::limits::{SHORTEST_RESET_PRESS, TICK_PERIOD};
use nearfield_shared::linescan::{HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode};
use nearfield_shared::rig::Rig;
use nearfield_shared::run_over::{Claims, NO_CLAIMS};
use nearfield_shared::service::PageBytes;
use nearfield_shared::status::{Challenge, Status};
use nearfield_shared::units::{CalibrationId, Micros, SequenceNumber};

/// The camera's frame period at 50 frames per second.
pub const FRAME_PERIOD: Micros = Micros::from_millis(20);
/// A person's press of the reset button in the simulation: half as long again as the shortest valid one.
const RESET_PRESS: Micros = Micros::new(SHORTEST_RESET_PRESS.get() * 3 / 2);

/// The secret of simulated controllers, for runs that can be repeated.
const SIMULATED_SECRET: [u8; SECRET_LENGTH] = *b"a simulated chip";

/// What goes into a line-scan's header for one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameFacts {
    /// Age of the picture when its line-scan is sent, from the middle of the exposure.
    pub capture_age: Micros,
    /// Exposure time.
    pub exposure: Micros,
    /// What the host makes of the scene.
    pub verdict: HostVerdict,
    /// What tier 3 says lies on the stripe.
    pub claims: Claims,
}

impl Default for FrameFacts {
    /// 2304x1296 at 50 frames per second: 17.3 ms of read-out, a few for the host; 4 ms of exposure; no objection.
    fn default() -> Self {
        Self {
            capture_age: Micros::from_millis(25),
            exposure: Micros::from_millis(4),
            verdict: HostVerdict::Clear,
            claims: NO_CLAIMS,
        }
    }
}

/// A link, a relay plant, a reset button and a virtual clock that ticks every 5 ms; see the module [`super`].
pub struct McuSession {
    link: Box<dyn McuLink>,
    /// The relays; open to faults.
    pub plant: RelayPlant,
    calibration: CalibrationId,
    now: Micros,
    next_tick: Micros,
    frame_period: Micros,
    button_until: Option<Micros>,
    sequence: SequenceNumber,
    last_status_number: u32,
    challenge: Challenge,
    light: SimulatedLight,
    /// The service key is turned.
    pub service_key: bool,
    /// What the self-tests say; open to faults.
    pub self_test: SimulatedSelfTest,
    outputs: Outputs,
    status: Status,
}

impl McuSession {
    /// Powers up a controller that has this rig stored, and fetches its first status.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn start(link: Box<dyn McuLink>, rig: &Rig) -> Result<Self, LinkError> {
        Self::start_with_stored(link, &rig.to_bytes(), rig.calibration_id())
    }

    /// As [`Self::start`], with any bytes in the controller's flash; `calibration` is what the host will claim.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn start_with_stored(
        link: Box<dyn McuLink>,
        stored_rig: &[u8],
        calibration: CalibrationId,
    ) -> Result<Self, LinkError> {
        Self::start_with_secret(link, stored_rig, calibration, SIMULATED_SECRET)
    }

    /// As [`Self::start_with_stored`], with another secret than every other session's.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn start_with_secret(
        mut link: Box<dyn McuLink>,
        stored_rig: &[u8],
        calibration: CalibrationId,
        secret: [u8; SECRET_LENGTH],
    ) -> Result<Self, LinkError> {
        let now = Micros::ZERO;
        let reply = link.start(now, secret, stored_rig)?;
        let status = Status::parse(&reply.status)?;
        let mut session = Self {
            link,
            plant: RelayPlant::new(),
            calibration,
            now,
            next_tick: now,
            frame_period: FRAME_PERIOD,
            button_until: None,
            sequence: SequenceNumber::new(0),
            last_status_number: 0,
            challenge: Challenge::default(),
            light: SimulatedLight::default(),
            service_key: false,
            self_test: SimulatedSelfTest::Passed,
            outputs: reply.outputs,
            status,
        };
        session.exchange(None)?;
        Ok(session)
    }

    /// Another frame period than [`FRAME_PERIOD`].
    pub const fn set_frame_period(&mut self, period: Micros) {
        self.frame_period = period;
    }

    /// The header of the next line-scan; every call uses up a sequence number.
    pub fn next_header(&mut self, facts: FrameFacts) -> LineScanHeader {
        self.sequence = self.sequence.next();
        LineScanHeader {
            source: SIMULATED_SOURCE,
            calibration: self.calibration,
            sequence: self.sequence,
            capture_age: facts.capture_age,
            exposure: facts.exposure,
            last_status: self.last_status_number,
            verdict: facts.verdict,
            ambient: 0,
            saturated: 0,
            claims: facts.claims,
        }
    }

    /// The next line-scan's bytes, sealed: these columns as they are, in simulated light.
    ///
    /// # Errors
    /// No columns or more than fit.
    pub fn next_line_scan(
        &mut self,
        columns: &[LineScanColumn],
        facts: FrameFacts,
    ) -> Result<Box<[u8; LINE_SCAN_LENGTH]>, LinkError> {
        let level = self.light.level_at(self.now.since(facts.capture_age));
        let light = simulated_light::report(columns, columns, level, &self.challenge);
        self.next_lit_line_scan(columns, &light, facts)
    }

    /// The next line-scan's bytes, sealed: these columns in the light that a picture showed.
    ///
    /// # Errors
    /// No columns or more than fit.
    pub fn next_lit_line_scan(
        &mut self,
        columns: &[LineScanColumn],
        light: &LightReport,
        facts: FrameFacts,
    ) -> Result<Box<[u8; LINE_SCAN_LENGTH]>, LinkError> {
        let LightReport { brightness, windows, ambient, saturated } = light;
        let header = LineScanHeader { ambient: *ambient, saturated: *saturated, ..self.next_header(facts) };
        let mut message = Box::new([0; LINE_SCAN_LENGTH]);
        encode(&mut message, &header, columns, brightness, windows)?;
        Ok(message)
    }

    /// The next line-scan's bytes of a scene that has these columns when the laser lights it. The session stands in for
    /// an honest camera: brightness and audit pixels are simulated, and a picture that was exposed in the dark shows no
    /// stripe.
    ///
    /// # Errors
    /// No columns or more than fit.
    pub fn next_scene_line_scan(
        &mut self,
        columns: &[LineScanColumn],
        facts: FrameFacts,
    ) -> Result<Box<[u8; LINE_SCAN_LENGTH]>, LinkError> {
        let dark = vec![LineScanColumn::MISSING; columns.len()];
        let lit = self.light.level_at(self.now.since(facts.capture_age)) > 0;
        self.next_line_scan(if lit { columns } else { &dark }, facts)
    }

    /// One frame period with a scene (see [`Self::next_scene_line_scan`]): the exchange at its beginning, then the ticks
    /// in it.
    ///
    /// # Errors
    /// The controller cannot be reached, or the columns fit no line-scan.
    pub fn run_columns(&mut self, columns: &[LineScanColumn], facts: FrameFacts) -> Result<(), LinkError> {
        let message = self.next_scene_line_scan(columns, facts)?;
        self.run_frame(Some(&message[..]))
    }

    /// As [`Self::run_columns`], with light that was measured in a picture.
    ///
    /// # Errors
    /// The controller cannot be reached, or the columns fit no line-scan.
    pub fn run_lit_columns(
        &mut self,
        columns: &[LineScanColumn],
        light: &LightReport,
        facts: FrameFacts,
    ) -> Result<(), LinkError> {
        let message = self.next_lit_line_scan(columns, light, facts)?;
        self.run_frame(Some(&message[..]))
    }

    /// The columns that the newest status asks for.
    #[must_use]
    pub const fn challenge(&self) -> &Challenge {
        &self.challenge
    }

    /// The laser's mean drive over an exposure, 0 (off) to 1: what a simulated camera collects.
    #[must_use]
    pub fn mean_laser_drive(&self, middle: Micros, length: Micros) -> f32 {
        self.light.mean_level(middle, length)
    }

    /// One frame period with any message, or (`None`) without any exchange: a dropped frame.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn run_frame(&mut self, message: Option<&[u8]>) -> Result<(), LinkError> {
        if message.is_some() {
            self.exchange(message)?;
        }
        let end = self.now.plus(self.frame_period);
        while self.next_tick < end {
            self.tick()?;
        }
        self.now = end;
        Ok(())
    }

    /// Presses the reset button now; it is released after 150 ms of frames.
    pub fn press_reset(&mut self) {
        self.hold_reset(RESET_PRESS);
    }

    /// Presses the reset button now, for this long.
    pub fn hold_reset(&mut self, length: Micros) {
        self.button_until = Some(self.now.plus(length));
    }

    /// Injects a hang of the controller's program.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn hang(&mut self) -> Result<(), LinkError> {
        self.link.hang(self.now)
    }

    /// The service page that the next transaction carries behind its status; zeros = none.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn service_page(&mut self) -> Result<PageBytes, LinkError> {
        self.link.service_page(self.now)
    }

    /// One frame period in which the host asks for the status and gives no line-scan.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn run_poll(&mut self) -> Result<(), LinkError> {
        self.exchange(None)?;
        self.run_frame(None)
    }

    /// Time passes without ticks and exchanges: the controller's clock goes on, its program is held up.
    pub const fn stall(&mut self, span: Micros) {
        self.now = self.now.plus(span);
        self.next_tick = self.next_tick.plus(span);
    }

    /// Which controller this is.
    #[must_use]
    pub fn kind(&self) -> McuKind {
        self.link.kind()
    }

    /// Virtual time since power-up, at the beginning of the next frame.
    #[must_use]
    pub const fn now(&self) -> Micros {
        self.now
    }

    /// Are both main contacts closed now: may the machine run? Follows the command with the relays' delays.
    #[must_use]
    pub fn relay_closed(&self) -> bool {
        self.plant.is_closed()
    }

    /// Does the controller command both channels closed now: its verdict, without the relays' delays?
    #[must_use]
    pub fn relay_commanded_closed(&self) -> bool {
        self.outputs.relays.a && self.outputs.relays.b
    }

    /// The controller's pins after the last tick.
    #[must_use]
    pub const fn outputs(&self) -> Outputs {
        self.outputs
    }

    /// The newest status (after the last tick). A controller that hangs leaves the old one standing.
    #[must_use]
    pub const fn status(&self) -> &Status {
        &self.status
    }

    fn exchange(&mut self, message: Option<&[u8]>) -> Result<(), LinkError> {
        let reply = self.link.exchange(self.now, message)?;
        // A controller that hangs answers nothing readable; the host then keeps what it last heard.
        if let Ok(status) = Status::parse(&reply.status) {
            (self.last_status_number, self.challenge) = (status.number, status.challenge);
        }
        self.apply(self.now, reply.outputs);
        Ok(())
    }

    fn tick(&mut self) -> Result<(), LinkError> {
        let now = self.next_tick;
        let reset_pressed = self.button_until.is_some_and(|until| now < until);
        let pins = PinInputs {
            mirror: self.plant.mirror_contacts(now),
            reset_pressed,
            service_key: self.service_key,
            coils: self.plant.coils(),
            pulse: self.plant.take_pulse(),
        };
        let reply = self.link.tick(now, SimulatedTick { pins, self_test: self.self_test })?;
        self.status = Status::parse(&reply.status)?;
        self.apply(now, reply.outputs);
        if let Some(channel) = reply.outputs.pulse {
            self.plant.apply_pulse(channel);
        }
        self.next_tick = now.plus(TICK_PERIOD);
        Ok(())
    }

    fn apply(&mut self, now: Micros, outputs: Outputs) {
        self.outputs = outputs;
        self.plant.drive(now, outputs.relays);
        self.light.follow(now, outputs.laser_level);
    }
}
