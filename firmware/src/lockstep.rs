//! The controller over a byte stream, on the host's time: the emulated controller answers record by record, so that
//! its run can be compared byte by byte with the in-process one.
//!
//! A request is [`REQUEST_HEADER_LENGTH`] bytes and a payload; little-endian:
//!
//! | offset | field |
//! |---|---|
//! | 0 | kind u8: 1 start, 2 tick, 3 exchange, 4 hang |
//! | 1 | pins u8: bit 0 mirror contact A, bit 1 mirror contact B, bit 2 reset button |
//! | 2 | length of the payload u16 |
//! | 4 | zero u32 |
//! | 8 | the host's time, microseconds u64 |
//! | 16 | payload: the stored rig (start) or a line-scan (exchange; empty = none) |
//!
//! Every request but `hang` has one reply of [`REPLY_LENGTH`] bytes:
//!
//! | offset | field |
//! |---|---|
//! | 0 | the request's kind u8 |
//! | 1 | coils u8: bit 0 channel A, bit 1 channel B |
//! | 2 | laser level u8 |
//! | 3 | indicator u8 |
//! | 4 | a watchdog was fed u8 (0 or 1), zero u8, zero u16 |
//! | 8 | status: after a tick the one that would be sent next; after an exchange the one that it carried |
//!
//! `hang` makes the controller loop for ever without feeding its watchdog. Only the emulator's binary obeys it; on
//! the board there is no such record.

use crate::relay::MirrorContacts;
use crate::safety::{Indicator, Outputs, PinInputs};
use nearfield_shared::limits::LARGEST_TRANSFER;
use nearfield_shared::status::{Channels, STATUS_LENGTH};
use nearfield_shared::units::Micros;

/// Bytes of a request before its payload.
pub const REQUEST_HEADER_LENGTH: usize = 16;
/// Bytes of every reply.
pub const REPLY_LENGTH: usize = REPLY_HEADER_LENGTH + STATUS_LENGTH;
const REPLY_HEADER_LENGTH: usize = 8;

/// What the host asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// The chip comes out of reset; the payload is the stored rig.
    Start,
    /// A tick of the safety task with these pins.
    Tick(PinInputs),
    /// An exchange; the payload is the line-scan, empty = none.
    Exchange,
    /// Loop for ever.
    Hang,
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
        let (kind, pins) = match self.request {
            Request::Start => (1, 0),
            Request::Tick(pins) => (2, pins_to_bits(pins)),
            Request::Exchange => (3, 0),
            Request::Hang => (4, 0),
        };
        let [low, high] = self.payload_length.to_le_bytes();
        let [t0, t1, t2, t3, t4, t5, t6, t7] = self.now.get().to_le_bytes();
        [kind, pins, low, high, 0, 0, 0, 0, t0, t1, t2, t3, t4, t5, t6, t7]
    }

    /// Reads a header.
    ///
    /// # Errors
    /// An unknown kind, a payload that is too long or stands where none belongs, or set bits that mean nothing.
    pub fn parse(bytes: &[u8; REQUEST_HEADER_LENGTH]) -> Result<Self, MalformedRecord> {
        let [kind, pins, low, high, z0, z1, z2, z3, time @ ..] = *bytes;
        let payload_length = u16::from_le_bytes([low, high]);
        let request = match (kind, pins, payload_length) {
            (1, 0, _) => Request::Start,
            (2, 0..=7, 0) => Request::Tick(pins_from_bits(pins)),
            (3, 0, _) => Request::Exchange,
            (4, 0, 0) => Request::Hang,
            _ => return Err(MalformedRecord),
        };
        if usize::from(payload_length) > LARGEST_TRANSFER || [z0, z1, z2, z3] != [0; 4] {
            return Err(MalformedRecord);
        }
        Ok(Self { request, now: Micros::new(u64::from_le_bytes(time)), payload_length })
    }
}

fn pins_to_bits(pins: PinInputs) -> u8 {
    u8::from(pins.mirror.a) | (u8::from(pins.mirror.b) << 1) | (u8::from(pins.reset_pressed) << 2)
}

const fn pins_from_bits(bits: u8) -> PinInputs {
    let mirror = MirrorContacts { a: bits & 1 != 0, b: bits & 2 != 0 };
    PinInputs { mirror, reset_pressed: bits & 4 != 0 }
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
        };
        let coils = u8::from(self.outputs.relays.a) | (u8::from(self.outputs.relays.b) << 1);
        let mut bytes = [0; REPLY_LENGTH];
        let (head, status) = bytes.split_at_mut(REPLY_HEADER_LENGTH);
        let fields = [
            kind,
            coils,
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
        let [kind, coils, laser_level, indicator, fed, 0, 0, 0, status @ ..] = *bytes else {
            return Err(MalformedRecord);
        };
        let indicator = INDICATORS
            .into_iter()
            .find(|candidate| indicator_code(*candidate) == indicator)
            .ok_or(MalformedRecord)?;
        if coils > 3 || fed > 1 {
            return Err(MalformedRecord);
        }
        let relays = Channels { a: coils & 1 != 0, b: coils & 2 != 0 };
        let reply = Self { outputs: Outputs { relays, laser_level, indicator }, fed: fed == 1, status };
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
mod tests {
    use super::*;

    fn headers() -> Vec<RequestHeader> {
        let now = Micros::new(0x0102_0304_0506_0708);
        let mut all = vec![
            RequestHeader { request: Request::Start, now, payload_length: 160 },
            RequestHeader { request: Request::Exchange, now, payload_length: 4096 },
            RequestHeader { request: Request::Exchange, now, payload_length: 0 },
            RequestHeader { request: Request::Hang, now, payload_length: 0 },
        ];
        for bits in 0..8 {
            let request = Request::Tick(pins_from_bits(bits));
            all.push(RequestHeader { request, now, payload_length: 0 });
        }
        all
    }

    #[test]
    fn what_was_asked_is_what_is_read() {
        for header in headers() {
            assert_eq!(RequestHeader::parse(&header.to_bytes()), Ok(header));
        }
    }

    #[test]
    fn golden_bytes_of_a_tick() {
        let pins = PinInputs { mirror: MirrorContacts { a: false, b: true }, reset_pressed: true };
        let header =
            RequestHeader { request: Request::Tick(pins), now: Micros::new(0x0102), payload_length: 0 };
        assert_eq!(header.to_bytes(), [2, 6, 0, 0, 0, 0, 0, 0, 2, 1, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn malformed_requests_are_refused() {
        let with = |offset: usize, value: u8| {
            let mut bytes = headers()[2].to_bytes();
            bytes[offset] = value;
            RequestHeader::parse(&bytes)
        };
        assert!(with(2, 1).is_ok());
        for (offset, value) in [(0, 0), (0, 5), (1, 1), (3, 17), (4, 1), (7, 1)] {
            assert_eq!(with(offset, value), Err(MalformedRecord), "{offset} = {value}");
        }
        let mut tick = headers()[5].to_bytes();
        tick[1] = 8;
        assert_eq!(RequestHeader::parse(&tick), Err(MalformedRecord), "an unknown pin");
        tick[1] = 0;
        tick[2] = 1;
        assert_eq!(RequestHeader::parse(&tick), Err(MalformedRecord), "a tick has no payload");
    }

    #[test]
    fn what_was_answered_is_what_is_read() {
        let request = Request::Tick(PinInputs::default());
        for indicator in INDICATORS {
            for (a, b, fed) in [(false, false, false), (true, false, true), (false, true, true)] {
                let outputs = Outputs { relays: Channels { a, b }, laser_level: 77, indicator };
                let reply = Reply { outputs, fed, status: [9; STATUS_LENGTH] };
                assert_eq!(Reply::parse(&reply.to_bytes(request), request), Ok(reply));
                assert_eq!(Reply::parse(&reply.to_bytes(request), Request::Exchange), Err(MalformedRecord));
            }
        }
        let good = Reply { outputs: Outputs::SAFE, fed: false, status: [0; STATUS_LENGTH] }.to_bytes(request);
        for (offset, value) in [(0, 3), (1, 4), (3, 5), (4, 2), (5, 1), (6, 1), (7, 1)] {
            let mut bytes = good;
            bytes[offset] = value;
            assert_eq!(Reply::parse(&bytes, request), Err(MalformedRecord), "{offset} = {value}");
        }
        assert!(
            Reply::parse(
                &Reply { outputs: Outputs::SAFE, fed: false, status: [0; STATUS_LENGTH] }
                    .to_bytes(Request::Hang),
                Request::Hang
            )
            .is_err()
        );
    }
}
