//! A link to a simulated controller that writes everything down: what it was asked and what it answered, byte for byte, so that
//! it can decide again (see [`super::redecide`]).

use nearfield_firmware::lockstep::{Request, RequestHeader};
use nearfield_recording::event::{REPLY_LENGTH, REQUEST_LENGTH};
use nearfield_recording::{Event, LockStep, Taps};
use nearfield_shared::service::PageBytes;
use nearfield_shared::units::Micros;

use crate::link::{LinkError, McuKind, McuLink, Reply, SECRET_LENGTH, SimulatedTick};

// The recorder's lengths are the firmware's.
const _: () = assert!(REPLY_LENGTH == nearfield_firmware::lockstep::REPLY_LENGTH);
const _: () = assert!(REQUEST_LENGTH == nearfield_firmware::lockstep::REQUEST_HEADER_LENGTH);

/// See the module's documentation.
pub struct Journal {
    link: Box<dyn McuLink>,
    taps: Taps,
    number: u64,
}

impl Journal {
    /// Around a link that is not powered up yet.
    #[must_use]
    pub const fn new(link: Box<dyn McuLink>, taps: Taps) -> Self {
        Self { link, taps, number: 0 }
    }

    fn step(&mut self, request: Request, now: Micros, payload_length: usize, reply: &Reply) -> LockStep {
        self.number += 1;
        // Longer payloads than fit are refused by every link.
        let payload_length = u16::try_from(payload_length).unwrap_or(u16::MAX);
        let header = RequestHeader { request, now, payload_length };
        LockStep { number: self.number, request: header.to_bytes(), reply: reply.to_bytes(request) }
    }
}

impl McuLink for Journal {
    fn kind(&self) -> McuKind {
        self.link.kind()
    }

    fn start(
        &mut self,
        now: Micros,
        secret: [u8; SECRET_LENGTH],
        stored_rig: &[u8],
    ) -> Result<Reply, LinkError> {
        let reply = self.link.start(now, secret, stored_rig)?;
        let payload = [&secret[..], stored_rig].concat();
        let step = self.step(Request::Start, now, payload.len(), &reply);
        self.taps.tell(now, Event::PowerUp { step, payload: payload.into() });
        Ok(reply)
    }

    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError> {
        let reply = self.link.tick(now, inputs)?;
        let step = self.step(Request::Tick(inputs), now, 0, &reply);
        self.taps.tell(now, Event::Tick(step));
        Ok(reply)
    }

    fn exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Result<Reply, LinkError> {
        let reply = self.link.exchange(now, line_scan)?;
        let step = self.step(Request::Exchange, now, line_scan.map_or(0, <[u8]>::len), &reply);
        let line_scan = line_scan.and_then(|bytes| bytes.try_into().ok());
        self.taps.tell(now, Event::Exchange { step: Some(step), line_scan, status: reply.status });
        Ok(reply)
    }

    fn service_page(&mut self, now: Micros) -> Result<PageBytes, LinkError> {
        self.link.service_page(now)
    }

    fn hang(&mut self, now: Micros) -> Result<(), LinkError> {
        self.link.hang(now)
    }
}
