//! Two force-guided relays in series, as the controller's outputs drive them, with faults to inject.

use super::MirrorContacts;
use nearfield_shared::status::Channels;
use nearfield_shared::units::Micros;

/// What can be wrong with a relay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RelayFault {
    /// The main contact is welded: it stays where it is, and the mirror contact tells so.
    Welded,
    /// The coil is broken: the main contact opens and stays open.
    DeadCoil,
    /// The mirror contact's wire is broken: it reads "not proven open".
    BrokenFeedback,
}

/// Time from coil on to contact closed. Source: typical force-guided relay.
const PICK_UP: Micros = Micros::from_millis(10);
/// Time from coil off to contact open. Source: typical force-guided relay.
const DROP_OUT: Micros = Micros::from_millis(20);

/// One relay.
#[derive(Debug, Clone, Copy)]
struct Relay {
    coil: bool,
    coil_since: Micros,
    closed: bool,
    fault: Option<RelayFault>,
}

impl Relay {
    const fn new() -> Self {
        Self { coil: false, coil_since: Micros::ZERO, closed: false, fault: None }
    }

    fn drive(&mut self, now: Micros, coil: bool) {
        self.settle(now);
        if coil != self.coil {
            (self.coil, self.coil_since) = (coil, now);
        }
    }

    fn settle(&mut self, now: Micros) {
        match self.fault {
            Some(RelayFault::Welded) => {}
            Some(RelayFault::DeadCoil) => self.closed = false,
            Some(RelayFault::BrokenFeedback) | None => {
                let delay = if self.coil { PICK_UP } else { DROP_OUT };
                if now.since(self.coil_since) >= delay {
                    self.closed = self.coil;
                }
            }
        }
    }

    /// The mirror contact's level; high = closed = main contact proven open.
    fn mirror(&self) -> bool {
        !self.closed && self.fault != Some(RelayFault::BrokenFeedback)
    }
}

/// Both relays; the machine runs only while both main contacts are closed.
#[derive(Debug, Clone, Copy)]
pub struct RelayPlant {
    channels: [Relay; 2],
}

impl RelayPlant {
    /// Both dropped out, without fault.
    #[must_use]
    pub const fn new() -> Self {
        Self { channels: [Relay::new(); 2] }
    }

    /// The controller's outputs drive the coils like this from `now` on.
    pub fn drive(&mut self, now: Micros, coils: Channels) {
        for (relay, coil) in self.channels.iter_mut().zip([coils.a, coils.b]) {
            relay.drive(now, coil);
        }
    }

    /// Lets the contacts move up to `now`, and reads the mirror contacts.
    pub fn mirror_contacts(&mut self, now: Micros) -> MirrorContacts {
        for relay in &mut self.channels {
            relay.settle(now);
        }
        let [a, b] = &self.channels;
        MirrorContacts { a: a.mirror(), b: b.mirror() }
    }

    /// Where the main contacts are.
    #[must_use]
    pub const fn main_contacts(&self) -> Channels {
        let [a, b] = &self.channels;
        Channels { a: a.closed, b: b.closed }
    }

    /// Does the machine have permission to run (both main contacts closed)?
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.main_contacts() == Channels::CLOSED
    }

    /// Breaks (or with `None` repairs) the relay of channel A.
    pub const fn set_fault_a(&mut self, fault: Option<RelayFault>) {
        let [a, _] = &mut self.channels;
        a.fault = fault;
    }

    /// Breaks (or with `None` repairs) the relay of channel B.
    pub const fn set_fault_b(&mut self, fault: Option<RelayFault>) {
        let [_, b] = &mut self.channels;
        b.fault = fault;
    }
}

impl Default for RelayPlant {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn closed_plant() -> RelayPlant {
        let mut plant = RelayPlant::new();
        plant.drive(Micros::ZERO, Channels::CLOSED);
        plant.mirror_contacts(PICK_UP);
        assert!(plant.is_closed());
        plant
    }

    #[test]
    fn contacts_follow_their_coils_after_their_delays() {
        let mut plant = RelayPlant::new();
        let start = Micros::from_millis(100);
        assert_eq!(plant.mirror_contacts(start), MirrorContacts::BOTH_OPEN);
        plant.drive(start, Channels::CLOSED);
        assert_eq!(plant.mirror_contacts(Micros::from_millis(109)), MirrorContacts::BOTH_OPEN);
        assert_eq!(plant.mirror_contacts(Micros::from_millis(110)), MirrorContacts::BOTH_CLOSED);
        plant.drive(Micros::from_millis(120), Channels { a: true, b: false });
        assert!(plant.is_closed());
        assert_eq!(plant.mirror_contacts(Micros::from_millis(139)), MirrorContacts::BOTH_CLOSED);
        assert_eq!(plant.mirror_contacts(Micros::from_millis(140)), MirrorContacts { a: false, b: true });
        assert!(!plant.is_closed(), "one open contact opens the machine's circuit");
    }

    #[test]
    fn a_welded_contact_stays_closed_and_its_mirror_contact_tells() {
        let mut plant = closed_plant();
        plant.set_fault_a(Some(RelayFault::Welded));
        plant.drive(Micros::from_millis(50), Channels::OPEN);
        assert_eq!(plant.mirror_contacts(Micros::from_millis(500)), MirrorContacts { a: false, b: true });
        assert_eq!(plant.main_contacts(), Channels { a: true, b: false });
    }

    #[test]
    fn a_dead_coil_lets_go_and_a_broken_wire_proves_nothing() {
        let mut plant = closed_plant();
        plant.set_fault_b(Some(RelayFault::DeadCoil));
        assert_eq!(plant.mirror_contacts(Micros::from_millis(50)), MirrorContacts { a: false, b: true });
        let mut plant = RelayPlant::new();
        plant.set_fault_b(Some(RelayFault::BrokenFeedback));
        assert_eq!(plant.mirror_contacts(Micros::from_millis(50)), MirrorContacts { a: true, b: false });
        assert_eq!(plant.main_contacts(), Channels::OPEN);
    }
}
