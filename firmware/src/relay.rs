//! Two relay channels: what they are told, whether that memory is intact, and whether their contacts follow.
//!
//! Each channel drives one force-guided relay; the machine runs only while both are closed. A force-guided relay's
//! mirror contact (normally closed) cannot be closed while a main contact is: it is wired from the supply to an input
//! with a pull-down, so **level high = mirror contact closed = main contacts proven open**. A broken wire reads low,
//! "not proven open", and is found at the next opening at the latest (external device monitoring, EDM).
//!
//! A contact may differ from its command for [`FEEDBACK_DISCREPANCY`], on both edges; beyond that a contact is welded
//! or a coil is dead, and only service leads out of the lockout that follows.
//!
//! The command is kept twice, as a word and as its complement. Memory that says anything but an exact "closed" opens.

use nearfield_shared::limits::FEEDBACK_DISCREPANCY;
use nearfield_shared::status::Channels;
use nearfield_shared::units::Micros;

/// The mirror contacts' inputs; `true` = level high = mirror contact closed = this channel's main contacts are open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MirrorContacts {
    /// Channel A.
    pub a: bool,
    /// Channel B.
    pub b: bool,
}

impl MirrorContacts {
    /// Both relays dropped out.
    pub const BOTH_OPEN: Self = Self { a: true, b: true };
    /// Both relays picked up.
    pub const BOTH_CLOSED: Self = Self { a: false, b: false };

    /// The main contacts as far as the mirror contacts tell: not proven open counts as closed.
    #[must_use]
    pub const fn main_contacts(self) -> Channels {
        Channels { a: !self.a, b: !self.b }
    }
}

/// How the contacts stand to their commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feedback {
    /// Both channels do what they are told.
    Agrees,
    /// A channel has not followed yet, within its time.
    Settling,
    /// A channel does not follow.
    Failed,
}

/// "Closed" in memory; far from all zeros, all ones and its own complement.
const CLOSED_WORD: u32 = 0x5A3C_96E1;
/// "Open" in memory.
const OPEN_WORD: u32 = 0xA50F_3C78;

/// Whether the relays may be closed, as a word that is far from zero, from all ones and from its opposite: a flipped
/// bit makes no permission.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Permission(u32);

impl Permission {
    /// The relays may be closed.
    pub const GRANTED: Self = Self(0x69A5_3CC3);
    /// They may not. Whatever is not exactly [`Self::GRANTED`] means the same.
    pub const DENIED: Self = Self(0x965A_C33C);

    /// May the relays be closed?
    #[must_use]
    pub const fn is_granted(self) -> bool {
        self.0 == Self::GRANTED.0
    }
}

impl core::fmt::Debug for Permission {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(if self.is_granted() { "Granted" } else { "Denied" })
    }
}

/// The command, stored twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct StoredCommand {
    word: u32,
    complement: u32,
}

impl StoredCommand {
    const OPEN: Self = Self { word: OPEN_WORD, complement: !OPEN_WORD };
    const CLOSED: Self = Self { word: CLOSED_WORD, complement: !CLOSED_WORD };

    const fn is_closed(self) -> bool {
        self.word == CLOSED_WORD && self.complement == !CLOSED_WORD
    }

    const fn is_intact(self) -> bool {
        self.is_closed() || (self.word == OPEN_WORD && self.complement == !OPEN_WORD)
    }
}

/// Both channels; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Relays {
    command: StoredCommand,
    /// Since when channel A and channel B differ from their command.
    differs_since: [Option<Micros>; 2],
}

impl Relays {
    /// Commanded open, nothing known about the contacts.
    #[must_use]
    pub const fn new() -> Self {
        Self { command: StoredCommand::OPEN, differs_since: [None; 2] }
    }

    /// Closes both channels with a permission, opens them without.
    pub const fn follow(&mut self, permission: Permission) {
        self.command = if permission.is_granted() { StoredCommand::CLOSED } else { StoredCommand::OPEN };
    }

    /// Opens both channels.
    pub const fn open(&mut self) {
        self.command = StoredCommand::OPEN;
    }

    /// What the channels are told: closed only if both copies say exactly that.
    #[must_use]
    pub const fn command(&self) -> Channels {
        if self.command.is_closed() { Channels::CLOSED } else { Channels::OPEN }
    }

    /// Do both copies of the command agree, and do they hold a command?
    #[must_use]
    pub const fn is_memory_intact(&self) -> bool {
        self.command.is_intact()
    }

    /// With its times changed, for the model check.
    #[cfg(test)]
    pub(crate) fn aged(mut self, older: impl Fn(Micros) -> Micros) -> Self {
        self.differs_since = self.differs_since.map(|since| since.map(&older));
        self
    }

    /// All of it, for the check of the controller's memory.
    pub(crate) fn words(&self) -> [u64; 3] {
        let [a, b] = self.differs_since.map(|since| since.map_or(u64::MAX, Micros::get));
        [u64::from(self.command.word) << 32 | u64::from(self.command.complement), a, b]
    }

    /// Compares contacts and command.
    pub fn check(&mut self, now: Micros, mirror: MirrorContacts) -> Feedback {
        let command = self.command();
        let contacts = mirror.main_contacts();
        let differs = [contacts.a != command.a, contacts.b != command.b];
        let mut feedback = Feedback::Agrees;
        for (since, differs) in self.differs_since.iter_mut().zip(differs) {
            if !differs {
                *since = None;
                continue;
            }
            let start = *since.get_or_insert(now);
            if now.since(start) > FEEDBACK_DISCREPANCY {
                feedback = Feedback::Failed;
            } else if feedback == Feedback::Agrees {
                feedback = Feedback::Settling;
            }
        }
        feedback
    }
}

impl Default for Relays {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Micros = Micros::new(7_000);

    fn at(change: i64) -> Micros {
        Micros::new(START.plus(FEEDBACK_DISCREPANCY).get().saturating_add_signed(change))
    }

    /// The four ways in which one of two contacts can fail to follow an edge.
    fn edges() -> [(bool, MirrorContacts); 4] {
        [
            (true, MirrorContacts { a: true, b: false }),
            (true, MirrorContacts { a: false, b: true }),
            (false, MirrorContacts { a: true, b: false }),
            (false, MirrorContacts { a: false, b: true }),
        ]
    }

    #[test]
    fn each_contact_must_follow_each_edge_within_the_discrepancy_time() {
        for (close, late) in edges() {
            for (change, expected) in
                [(-1, Feedback::Settling), (0, Feedback::Settling), (1, Feedback::Failed)]
            {
                let mut relays = Relays::new();
                if close {
                    relays.follow(Permission::GRANTED);
                }
                assert_eq!(relays.check(START, late), Feedback::Settling);
                assert_eq!(relays.check(at(change), late), expected, "close {close}, {late:?}, {change}");
            }
        }
    }

    #[test]
    fn contacts_that_follow_agree() {
        let mut relays = Relays::new();
        assert_eq!(relays.check(START, MirrorContacts::BOTH_OPEN), Feedback::Agrees);
        relays.follow(Permission::GRANTED);
        assert_eq!(relays.check(START, MirrorContacts::BOTH_OPEN), Feedback::Settling);
        assert_eq!(relays.check(at(0), MirrorContacts::BOTH_CLOSED), Feedback::Agrees);
        relays.open();
        assert_eq!(relays.check(at(1), MirrorContacts::BOTH_CLOSED), Feedback::Settling);
        assert_eq!(relays.check(at(2), MirrorContacts::BOTH_OPEN), Feedback::Agrees);
    }

    #[test]
    fn one_failed_channel_is_not_hidden_by_the_other_one_settling() {
        let mut relays = Relays::new();
        assert_eq!(relays.check(START, MirrorContacts { a: false, b: true }), Feedback::Settling);
        assert_eq!(relays.check(at(1), MirrorContacts::BOTH_CLOSED), Feedback::Failed);
        let mut relays = Relays::new();
        assert_eq!(relays.check(START, MirrorContacts { a: true, b: false }), Feedback::Settling);
        assert_eq!(relays.check(at(1), MirrorContacts::BOTH_CLOSED), Feedback::Failed);
    }

    #[test]
    fn a_clock_that_runs_backwards_fails_a_settling_contact() {
        let mut relays = Relays::new();
        assert_eq!(relays.check(START, MirrorContacts::BOTH_CLOSED), Feedback::Settling);
        assert_eq!(relays.check(Micros::ZERO, MirrorContacts::BOTH_CLOSED), Feedback::Failed);
    }

    #[test]
    fn every_flipped_bit_of_the_stored_command_opens_and_is_noticed() {
        for closed in [false, true] {
            for bit in 0..64 {
                let mut relays = Relays::new();
                if closed {
                    relays.follow(Permission::GRANTED);
                }
                assert!(relays.is_memory_intact());
                assert_eq!(relays.command() == Channels::CLOSED, closed);
                if bit < 32 {
                    relays.command.word ^= 1 << bit;
                } else {
                    relays.command.complement ^= 1 << (bit - 32);
                }
                assert!(!relays.is_memory_intact(), "bit {bit}");
                assert_eq!(relays.command(), Channels::OPEN, "bit {bit}");
            }
        }
    }

    #[test]
    fn erased_and_stuck_memory_is_no_command() {
        for (word, complement) in [(0, 0), (u32::MAX, u32::MAX), (0, u32::MAX), (u32::MAX, 0)] {
            let relays = Relays { command: StoredCommand { word, complement }, differs_since: [None; 2] };
            assert!(!relays.is_memory_intact());
            assert_eq!(relays.command(), Channels::OPEN);
        }
        assert!((CLOSED_WORD ^ OPEN_WORD).count_ones() >= 12, "open and closed are far apart");
        assert!((CLOSED_WORD ^ !OPEN_WORD).count_ones() >= 12, "and not each other's complement");
    }

    #[test]
    fn what_differs_has_other_words_for_the_memory_check() {
        let closed = Relays { command: StoredCommand::CLOSED, ..Relays::new() };
        let damaged = StoredCommand { word: OPEN_WORD, complement: !CLOSED_WORD };
        crate::testing::all_differ(
            [
                Relays::new(),
                closed,
                Relays { command: damaged, ..Relays::new() },
                Relays { differs_since: [Some(START), None], ..Relays::new() },
                Relays { differs_since: [None, Some(START)], ..Relays::new() },
                Relays { differs_since: [Some(START), Some(Micros::ZERO)], ..Relays::new() },
            ]
            .map(|relays| relays.words()),
        );
    }

    #[test]
    fn a_permission_is_shown_by_its_meaning() {
        let shown = [Permission::GRANTED, Permission::DENIED, Permission(0)].map(|word| format!("{word:?}"));
        assert_eq!(shown, ["Granted", "Denied", "Denied"]);
    }
}
