//! Both safety controllers at once, the firmware library in this process and the Arm binary in QEMU: every answer must
//! be the same, to the bit.

use nearfield_host::link::{
    Emulated, InProcess, LinkError, McuKind, McuLink, Reply, SECRET_LENGTH, SimulatedTick,
};
use nearfield_shared::service::PageBytes;
use nearfield_shared::status::Status;
use nearfield_shared::units::Micros;

const FNV_OFFSET: u64 = 0xCBF2_9CE4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01B3;

/// A link to both; it panics at the first answer that differs.
pub struct Pair {
    in_process: InProcess,
    emulated: Emulated,
    digest: u64,
    closed_replies: u32,
}

impl Pair {
    /// Neither is started yet.
    #[must_use]
    pub fn new(emulated: Emulated) -> Self {
        Self { in_process: InProcess::new(), emulated, digest: FNV_OFFSET, closed_replies: 0 }
    }

    /// FNV-1a (64 bits) over all replies so far. Not the messages' own CRC: a sealed message leaves that in a state that
    /// does not depend on what the message says.
    #[must_use]
    pub const fn digest(&self) -> u64 {
        self.digest
    }

    /// In how many of them the relays were closed.
    #[must_use]
    pub const fn closed_replies(&self) -> u32 {
        self.closed_replies
    }

    fn both(
        &mut self,
        what: impl Fn(&mut dyn McuLink) -> Result<Reply, LinkError>,
    ) -> Result<Reply, LinkError> {
        let one = what(&mut self.in_process)?;
        let other = what(&mut self.emulated)?;
        assert_eq!(
            one,
            other,
            "in-process: {:?}\nemulated: {:?}",
            Status::parse(&one.status),
            Status::parse(&other.status)
        );
        let outputs = [u8::from(one.outputs.relays.a), one.outputs.laser_level, u8::from(one.fed)];
        for byte in outputs.into_iter().chain(one.status) {
            self.digest = (self.digest ^ u64::from(byte)).wrapping_mul(FNV_PRIME);
        }
        self.closed_replies += u32::from(one.outputs.relays.a);
        Ok(one)
    }
}

/// A pair that can still be asked for its digest while a session drives it.
#[derive(Clone)]
pub struct SharedPair(std::rc::Rc<std::cell::RefCell<Pair>>);

impl SharedPair {
    /// Around a pair.
    #[must_use]
    pub fn new(pair: Pair) -> Self {
        Self(std::rc::Rc::new(std::cell::RefCell::new(pair)))
    }

    /// See [`Pair::digest`].
    #[must_use]
    pub fn digest(&self) -> u64 {
        self.0.borrow().digest()
    }

    /// See [`Pair::closed_replies`].
    #[must_use]
    pub fn closed_replies(&self) -> u32 {
        self.0.borrow().closed_replies()
    }
}

impl McuLink for SharedPair {
    fn kind(&self) -> McuKind {
        self.0.borrow().kind()
    }

    fn start(
        &mut self,
        now: Micros,
        secret: [u8; SECRET_LENGTH],
        stored_rig: &[u8],
    ) -> Result<Reply, LinkError> {
        self.0.borrow_mut().start(now, secret, stored_rig)
    }

    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError> {
        self.0.borrow_mut().tick(now, inputs)
    }

    fn exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Result<Reply, LinkError> {
        self.0.borrow_mut().exchange(now, line_scan)
    }

    fn service_page(&mut self, now: Micros) -> Result<PageBytes, LinkError> {
        self.0.borrow_mut().service_page(now)
    }

    fn hang(&mut self, now: Micros) -> Result<(), LinkError> {
        self.0.borrow_mut().hang(now)
    }
}

impl McuLink for Pair {
    fn kind(&self) -> McuKind {
        self.emulated.kind()
    }

    fn start(
        &mut self,
        now: Micros,
        secret: [u8; SECRET_LENGTH],
        stored_rig: &[u8],
    ) -> Result<Reply, LinkError> {
        self.both(|link| link.start(now, secret, stored_rig))
    }

    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError> {
        self.both(|link| link.tick(now, inputs))
    }

    fn exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Result<Reply, LinkError> {
        self.both(|link| link.exchange(now, line_scan))
    }

    fn service_page(&mut self, now: Micros) -> Result<PageBytes, LinkError> {
        let one = self.in_process.service_page(now)?;
        assert_eq!(one, self.emulated.service_page(now)?, "the service page");
        Ok(one)
    }

    fn hang(&mut self, now: Micros) -> Result<(), LinkError> {
        self.in_process.hang(now)?;
        self.emulated.hang(now)
    }
}
