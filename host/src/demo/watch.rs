//! Looks over a controller's shoulder: when exactly did its relay outputs and the relays' contacts change?

use std::cell::RefCell;
use std::rc::Rc;

use nearfield_shared::service::PageBytes;
use nearfield_shared::status::Channels;
use nearfield_shared::units::Micros;

use crate::link::{LinkError, McuKind, McuLink, MirrorContacts, Reply, SECRET_LENGTH, SimulatedTick};

/// A value and the times at which it changed; false at first.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Trace {
    changes: Vec<(Micros, bool)>,
}

impl Trace {
    /// The value is this from `now` on.
    pub fn note(&mut self, now: Micros, value: bool) {
        if self.changes.last().is_some_and(|(_, last)| *last) != value {
            self.changes.push((now, value));
        }
    }

    /// The value at a time.
    #[must_use]
    pub fn at(&self, time: Micros) -> bool {
        self.changes.iter().take_while(|(when, _)| *when <= time).last().is_some_and(|(_, value)| *value)
    }

    /// When it first becomes `value`, from `from` on (which is the answer if it has that value already).
    #[must_use]
    pub fn first(&self, value: bool, from: Micros) -> Option<Micros> {
        if self.at(from) == value {
            return Some(from);
        }
        self.changes.iter().find(|(when, now)| *when > from && *now == value).map(|(when, _)| *when)
    }

    /// When it changed, and to what.
    #[must_use]
    pub fn changes(&self) -> &[(Micros, bool)] {
        &self.changes
    }
}

/// What was seen.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Traces {
    /// Both relays commanded closed.
    pub commanded_closed: Trace,
    /// Not both contacts proven open, as the mirror contacts tell at each tick.
    pub contacts_closed: Trace,
}

/// A link that keeps [`Traces`] of what passes through it, and changes nothing.
pub struct WatchedLink {
    inner: Box<dyn McuLink>,
    traces: Rc<RefCell<Traces>>,
}

impl WatchedLink {
    /// Around another link; the traces can be read while the link is in use elsewhere.
    #[must_use]
    pub fn new(inner: Box<dyn McuLink>) -> (Self, Rc<RefCell<Traces>>) {
        let traces = Rc::new(RefCell::new(Traces::default()));
        (Self { inner, traces: Rc::clone(&traces) }, traces)
    }

    fn note(&self, now: Micros, reply: Result<Reply, LinkError>) -> Result<Reply, LinkError> {
        let reply = reply?;
        self.traces.borrow_mut().commanded_closed.note(now, reply.outputs.relays == Channels::CLOSED);
        Ok(reply)
    }
}

impl McuLink for WatchedLink {
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
        let proven_open = inputs.pins.mirror == MirrorContacts::BOTH_OPEN;
        self.traces.borrow_mut().contacts_closed.note(now, !proven_open);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trace_tells_values_and_first_times() {
        let mut trace = Trace::default();
        for (time, value) in [(10, false), (20, true), (30, true), (40, false)] {
            trace.note(Micros::new(time), value);
        }
        assert_eq!(trace.changes(), [(Micros::new(20), true), (Micros::new(40), false)]);
        assert_eq!(
            [0, 19, 20, 39, 40].map(|time| trace.at(Micros::new(time))),
            [false, false, true, true, false]
        );
        assert_eq!(trace.first(true, Micros::new(5)), Some(Micros::new(20)));
        assert_eq!(trace.first(true, Micros::new(25)), Some(Micros::new(25)));
        assert_eq!(trace.first(false, Micros::new(25)), Some(Micros::new(40)));
        assert_eq!(trace.first(true, Micros::new(45)), None);
    }
}
