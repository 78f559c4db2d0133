//! The controller over a byte stream, on the host's time: the emulated controller answers record by record, so that
//! its run can be compared byte by byte with the in-process one.
//!
//! A request is [`REQUEST_HEADER_LENGTH`] bytes and a payload; little-endian:
//!
//! | offset | field |
//! |---|---|
//! | 0 | kind u8: 1 start, 2 tick, 3 exchange, 4 hang, 5 page |
//! | 1 | pins u8: bits 0, 1 mirror contacts A, B, bit 2 reset button, bit 3 service key, bits 4, 5 coils A, B read back |
//! | 2 | length of the payload u16 |
//! | 4 | pulse u8: bit 0 there was one, bit 1 it was channel B's, bits 2, 3 coils A, B during it |
//! | 5 | self-tests u8: 0 passed, 1 pending, else the code of the one that failed |
//! | 6 | zero u16 |
//! | 8 | the host's time, microseconds u64 |
//! | 16 | payload: the secret (16 bytes) and the stored rig (start), or a line-scan (exchange; empty = none) |
//!
//! `page` is answered by the service page that the next transaction would carry (zeros = none), nothing else. Every
//! other request but `hang` has one reply of [`REPLY_LENGTH`] bytes:
//!
//! | offset | field |
//! |---|---|
//! | 0 | the request's kind u8 |
//! | 1 | outputs u8: bits 0, 1 coils A, B, bit 2 warning, bits 3, 4 pulse test on A, B |
//! | 2 | laser level u8 |
//! | 3 | indicator u8 |
//! | 4 | a watchdog was fed u8 (0 or 1), zero u8, zero u16 |
//! | 8 | status: after a tick the one that would be sent next; after an exchange the one that it carried |
//!
//! `hang` makes the controller loop for ever without feeding its watchdog. Only the emulator's binary obeys it; on
//! the board there is no such record.

use crate::output_test::{Channel, PulseReadback};
use crate::relay::MirrorContacts;
use crate::safety::{Indicator, Outputs, PinInputs, TickInputs};
use crate::selftest::{SelfTestKind, SelfTestReport};
use nearfield_shared::limits::LARGEST_TRANSFER;
use nearfield_shared::status::{Channels, STATUS_LENGTH};
use nearfield_shared::units::Micros;

/// Bytes of a request before its payload.
pub const REQUEST_HEADER_LENGTH: usize = 16;
/// Bytes of every reply.
pub const REPLY_LENGTH: usize = REPLY_HEADER_LENGTH + STATUS_LENGTH;
const REPLY_HEADER_LENGTH: usize = 8;

/// What the simulated hardware's self-tests say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SimulatedSelfTest {
    /// All has just passed.
    #[default]
    Passed,
    /// The start is not through yet.
    Pending,
    /// This one has failed.
    Failed(SelfTestKind),
}

impl SimulatedSelfTest {
    /// As the controller takes it.
    #[must_use]
    pub const fn report(self, now: Micros) -> SelfTestReport {
        match self {
            Self::Passed => SelfTestReport::passed(now),
            Self::Pending => SelfTestReport::PENDING,
            Self::Failed(kind) => SelfTestReport { failed: Some(kind), ..SelfTestReport::passed(now) },
        }
    }

    const fn code(self) -> u8 {
        match self {
            Self::Passed => 0,
            Self::Pending => 1,
            Self::Failed(kind) => kind.code(),
        }
    }

    fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Passed),
            1 => Some(Self::Pending),
            _ => SelfTestKind::from_code(code).map(Self::Failed),
        }
    }
}

/// What a simulated tick takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SimulatedTick {
    /// The pins.
    pub pins: PinInputs,
    /// The self-tests.
    pub self_test: SimulatedSelfTest,
}

impl SimulatedTick {
    /// As the controller takes it.
    #[must_use]
    pub const fn inputs(self, now: Micros) -> TickInputs {
        TickInputs { pins: self.pins, self_test: self.self_test.report(now) }
    }
}

/// What the host asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// The chip comes out of reset; the payload is the secret and the stored rig.
    Start,
    /// A tick of the safety task with these pins and self-tests.
    Tick(SimulatedTick),
    /// An exchange; the payload is the line-scan, empty = none.
    Exchange,
    /// Loop for ever.
    Hang,
    /// The service page, [`nearfield_shared::service::PAGE_LENGTH`] bytes; not a [`Reply`].
    Page,
}

/// A request without its payload.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RequestHeader {
    /// What is asked for.
    pub request: Request,
    /// The host's time.
    pub now: Micros,
    /// Length of the payload that follows, at most [`LARGEST_TRANSFER`].
    pub payload_length: u16,
}

/// Why the stream cannot be followed any further.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MalformedRecord;

impl core::fmt::Display for MalformedRecord {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("malformed lock-step record")
    }
}

impl core::error::Error for MalformedRecord {}

impl RequestHeader {
    /// The bytes to send.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; REQUEST_HEADER_LENGTH] {
        let (kind, pins, pulse, self_test) = match self.request {
            Request::Start => (1, 0, 0, 0),
            Request::Tick(tick) => {
                (2, pins_to_bits(tick.pins), pulse_to_bits(tick.pins.pulse), tick.self_test.code())
            }
            Request::Exchange => (3, 0, 0, 0),
            Request::Hang => (4, 0, 0, 0),
            Request::Page => (5, 0, 0, 0),
        };
        let [low, high] = self.payload_length.to_le_bytes();
        let [t0, t1, t2, t3, t4, t5, t6, t7] = self.now.get().to_le_bytes();
        [kind, pins, low, high, pulse, self_test, 0, 0, t0, t1, t2, t3, t4, t5, t6, t7]
    }

    /// Reads a header.
    ///
    /// # Errors
    /// An unknown kind, a payload that is too long or stands where none belongs, or set bits that mean nothing.
    pub fn parse(bytes: &[u8; REQUEST_HEADER_LENGTH]) -> Result<Self, MalformedRecord> {
        let [kind, pins, low, high, pulse, self_test, z0, z1, time @ ..] = *bytes;
        let payload_length = u16::from_le_bytes([low, high]);
        let request = match (kind, [pins, pulse, self_test], payload_length) {
            (1, [0, 0, 0], _) => Request::Start,
            (2, [0..=63, _, _], 0) => {
                let pulse = pulse_from_bits(pulse).ok_or(MalformedRecord)?;
                let self_test = SimulatedSelfTest::from_code(self_test).ok_or(MalformedRecord)?;
                Request::Tick(SimulatedTick { pins: PinInputs { pulse, ..pins_from_bits(pins) }, self_test })
            }
            (3, [0, 0, 0], _) => Request::Exchange,
            (4, [0, 0, 0], 0) => Request::Hang,
            (5, [0, 0, 0], 0) => Request::Page,
            _ => return Err(MalformedRecord),
        };
        if usize::from(payload_length) > LARGEST_TRANSFER || [z0, z1] != [0; 2] {
            return Err(MalformedRecord);
        }
        Ok(Self { request, now: Micros::new(u64::from_le_bytes(time)), payload_length })
    }
}

fn pins_to_bits(pins: PinInputs) -> u8 {
    u8::from(pins.mirror.a)
        | (u8::from(pins.mirror.b) << 1)
        | (u8::from(pins.reset_pressed) << 2)
        | (u8::from(pins.service_key) << 3)
        | (u8::from(pins.coils.a) << 4)
        | (u8::from(pins.coils.b) << 5)
}

const fn pins_from_bits(bits: u8) -> PinInputs {
    PinInputs {
        mirror: MirrorContacts { a: bits & 1 != 0, b: bits & 2 != 0 },
        reset_pressed: bits & 4 != 0,
        service_key: bits & 8 != 0,
        coils: Channels { a: bits & 16 != 0, b: bits & 32 != 0 },
        pulse: None,
    }
}

fn pulse_to_bits(pulse: Option<PulseReadback>) -> u8 {
    pulse.map_or(0, |pulse| {
        1 | (u8::from(pulse.channel == Channel::B) << 1)
            | (u8::from(pulse.coils.a) << 2)
            | (u8::from(pulse.coils.b) << 3)
    })
}

const fn pulse_from_bits(bits: u8) -> Option<Option<PulseReadback>> {
    let channel = if bits & 2 == 0 { Channel::A } else { Channel::B };
    match bits {
        0 => Some(None),
        1..=15 if bits & 1 != 0 => {
            Some(Some(PulseReadback { channel, coils: Channels { a: bits & 4 != 0, b: bits & 8 != 0 } }))
        }
        _ => None,
    }
}

/// What the controller answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply {
    /// The pins.
    pub outputs: Outputs,
    /// Was a watchdog fed?
    pub fed: bool,
    /// The status; see the module's documentation.
    pub status: [u8; STATUS_LENGTH],
}

impl Reply {
    /// The bytes to send in answer to `request`.
    #[must_use]
    pub fn to_bytes(&self, request: Request) -> [u8; REPLY_LENGTH] {
        let kind = match request {
            Request::Start => 1,
            Request::Tick(_) => 2,
            Request::Exchange => 3,
            Request::Hang => 4,
            Request::Page => 5,
        };
        let pulse = match self.outputs.pulse {
            None => 0,
            Some(Channel::A) => 8,
            Some(Channel::B) => 16,
        };
        let outputs = u8::from(self.outputs.relays.a)
            | (u8::from(self.outputs.relays.b) << 1)
            | (u8::from(self.outputs.warning) << 2)
            | pulse;
        let mut bytes = [0; REPLY_LENGTH];
        let (head, status) = bytes.split_at_mut(REPLY_HEADER_LENGTH);
        let fields = [
            kind,
            outputs,
            self.outputs.laser_level,
            indicator_code(self.outputs.indicator),
            u8::from(self.fed),
        ];
        for (byte, field) in head.iter_mut().zip(fields).chain(status.iter_mut().zip(self.status)) {
            *byte = field;
        }
        bytes
    }

    /// Reads the answer to `request`.
    ///
    /// # Errors
    /// An answer to something else, or a field with an impossible value.
    pub fn parse(bytes: &[u8; REPLY_LENGTH], request: Request) -> Result<Self, MalformedRecord> {
        let [kind, outputs, laser_level, indicator, fed, 0, 0, 0, status @ ..] = *bytes else {
            return Err(MalformedRecord);
        };
        let indicator = INDICATORS
            .into_iter()
            .find(|candidate| indicator_code(*candidate) == indicator)
            .ok_or(MalformedRecord)?;
        let pulse = match outputs >> 3 {
            0 => None,
            1 => Some(Channel::A),
            2 => Some(Channel::B),
            _ => return Err(MalformedRecord),
        };
        if fed > 1 {
            return Err(MalformedRecord);
        }
        let relays = Channels { a: outputs & 1 != 0, b: outputs & 2 != 0 };
        let outputs = Outputs { relays, laser_level, indicator, warning: outputs & 4 != 0, pulse };
        let reply = Self { outputs, fed: fed == 1, status };
        // The kind is the only thing that names the request.
        match (kind, request) {
            (1, Request::Start) | (2, Request::Tick(_)) | (3, Request::Exchange) => Ok(reply),
            _ => Err(MalformedRecord),
        }
    }
}

const INDICATORS: [Indicator; 5] = [
    Indicator::Testing,
    Indicator::WaitingForReset,
    Indicator::Permitted,
    Indicator::Stopped,
    Indicator::Service,
];

const fn indicator_code(indicator: Indicator) -> u8 {
    match indicator {
        Indicator::Testing => 0,
        Indicator::WaitingForReset => 1,
        Indicator::Permitted => 2,
        Indicator::Stopped => 3,
        Indicator::Service => 4,
    }
}

#[cfg(test)]
mod tests;
