//! Two force-guided relays in series and the drivers of their coils, as the controller's outputs drive them, with
//! faults to inject.

use super::{Channel, MirrorContacts, PulseReadback};
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

/// What can be wrong with the drivers of the coils.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriverFault {
    /// This channel's coil is always driven.
    StuckOn(Channel),
    /// This channel's coil is never driven.
    StuckOff(Channel),
    /// The channels' outputs are connected: one drives both.
    Shorted,
    /// The pulses' readings never come.
    NoReadback,
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
    drivers: Option<DriverFault>,
    /// What the controller's outputs say.
    driven: Channels,
    pulse: Option<PulseReadback>,
}

impl RelayPlant {
    /// Both dropped out, without fault.
    #[must_use]
    pub const fn new() -> Self {
        Self { channels: [Relay::new(); 2], drivers: None, driven: Channels::OPEN, pulse: None }
    }

    /// The controller's outputs drive the coils like this from `now` on.
    pub fn drive(&mut self, now: Micros, coils: Channels) {
        self.driven = coils;
        let coils = self.through_drivers(coils);
        for (relay, coil) in self.channels.iter_mut().zip([coils.a, coils.b]) {
            relay.drive(now, coil);
        }
    }

    /// Applies a test pulse to the outputs as they are; [`Self::take_pulse`] gives what was read back. The relays are too
    /// slow to notice.
    pub fn apply_pulse(&mut self, channel: Channel) {
        let coils = self.through_drivers(channel.inverted_in(self.driven));
        self.pulse =
            (self.drivers != Some(DriverFault::NoReadback)).then_some(PulseReadback { channel, coils });
    }

    /// The last pulse's reading, once.
    pub const fn take_pulse(&mut self) -> Option<PulseReadback> {
        self.pulse.take()
    }

    /// The coils as they are read back.
    #[must_use]
    pub fn coils(&self) -> Channels {
        self.through_drivers(self.driven)
    }

    /// Breaks (or with `None` repairs) the drivers.
    pub const fn set_driver_fault(&mut self, fault: Option<DriverFault>) {
        self.drivers = fault;
    }

    fn through_drivers(&self, driven: Channels) -> Channels {
        match self.drivers {
            None | Some(DriverFault::NoReadback) => driven,
            Some(DriverFault::StuckOn(Channel::A)) => Channels { a: true, ..driven },
            Some(DriverFault::StuckOn(Channel::B)) => Channels { b: true, ..driven },
            Some(DriverFault::StuckOff(Channel::A)) => Channels { a: false, ..driven },
            Some(DriverFault::StuckOff(Channel::B)) => Channels { b: false, ..driven },
            Some(DriverFault::Shorted) => {
                let any = driven.a || driven.b;
                Channels { a: any, b: any }
            }
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

    #[test]
    fn drivers_read_back_what_their_faults_make_of_the_command() {
        let read = |fault, driven, channel| {
            let mut plant = RelayPlant::new();
            plant.set_driver_fault(fault);
            plant.drive(Micros::ZERO, driven);
            plant.apply_pulse(channel);
            let coils = plant.coils();
            (coils, plant.take_pulse().map(|pulse| pulse.coils), plant.take_pulse())
        };
        let both = |a, b| Channels { a, b };
        let (open, closed) = (Channels::OPEN, Channels::CLOSED);
        assert_eq!(read(None, closed, Channel::A), (closed, Some(both(false, true)), None));
        assert_eq!(read(None, open, Channel::B), (open, Some(both(false, true)), None));
        let stuck = Some(DriverFault::StuckOn(Channel::A));
        assert_eq!(read(stuck, open, Channel::A), (both(true, false), Some(both(true, false)), None));
        let stuck = Some(DriverFault::StuckOff(Channel::B));
        assert_eq!(read(stuck, closed, Channel::B), (both(true, false), Some(both(true, false)), None));
        assert_eq!(read(Some(DriverFault::Shorted), closed, Channel::A), (closed, Some(closed), None));
        assert_eq!(read(Some(DriverFault::NoReadback), closed, Channel::A), (closed, None, None));
    }
}
