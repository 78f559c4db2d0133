//! From the stripe's path to whoever listens: a queue of fixed length whose sender never waits. What does not fit is dropped
//! and counted; the listener polls, so that sending never has to wake anybody up.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};

use nearfield_shared::units::Micros;

use crate::event::{Event, Stamped};

/// Events that a queue holds: about a second and a half at 50 pictures a second with a simulated controller (7 MB).
pub const QUEUE_LENGTH: usize = 1536;

/// The sending end; clones feed the same queue.
#[derive(Debug, Clone)]
pub struct Tap {
    sender: SyncSender<Stamped>,
    dropped: Arc<AtomicU64>,
}

/// The listening end.
#[derive(Debug)]
pub struct Drain {
    receiver: Receiver<Stamped>,
    dropped: Arc<AtomicU64>,
}

/// What a look into the queue brings.
#[derive(Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "moved out of the queue once, never stored")]
pub enum Next {
    /// The oldest event.
    Event(Stamped),
    /// None at the moment.
    Empty,
    /// None ever again: all taps are gone.
    Ended,
}

/// Both ends of a queue for `length` events.
#[must_use]
pub fn queue(length: usize) -> (Tap, Drain) {
    let (sender, receiver) = sync_channel(length);
    let dropped = Arc::new(AtomicU64::new(0));
    (Tap { sender, dropped: Arc::clone(&dropped) }, Drain { receiver, dropped })
}

impl Tap {
    /// Tells; never waits. `false` = the queue is full (or nobody listens any more), and the event is lost and counted.
    pub fn tell(&self, at: Micros, event: Event) -> bool {
        match self.sender.try_send(Stamped { at, event }) {
            Ok(()) => true,
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {
                self.dropped.fetch_add(1, Ordering::Relaxed);
                false
            }
        }
    }
}

impl Drain {
    /// The next event, without waiting.
    pub fn next(&self) -> Next {
        match self.receiver.try_recv() {
            Ok(stamped) => Next::Event(stamped),
            Err(TryRecvError::Empty) => Next::Empty,
            Err(TryRecvError::Disconnected) => Next::Ended,
        }
    }

    /// How many events did not fit so far.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

/// Several queues told at once; none of them is a sink that costs nothing.
#[derive(Debug, Clone, Default)]
pub struct Taps(Vec<Tap>);

impl Taps {
    /// One more listener.
    pub fn add(&mut self, tap: Tap) {
        self.0.push(tap);
    }

    /// Does anybody listen?
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Tells all of them; never waits.
    pub fn tell(&self, at: Micros, event: Event) {
        if let Some((last, others)) = self.0.split_last() {
            for tap in others {
                tap.tell(at, event.clone());
            }
            last.tell(at, event);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mark(text: &str) -> Event {
        Event::Mark(text.into())
    }

    #[test]
    fn a_full_queue_drops_the_new_and_counts_it() {
        let (tap, drain) = queue(2);
        assert!(tap.tell(Micros::new(1), mark("one")) && tap.tell(Micros::new(2), mark("two")));
        assert!(!tap.tell(Micros::new(3), mark("three")));
        assert_eq!(drain.dropped(), 1);
        assert_eq!(drain.next(), Next::Event(Stamped { at: Micros::new(1), event: mark("one") }));
        assert!(tap.tell(Micros::new(4), mark("four")), "there is room again");
        assert!(matches!(drain.next(), Next::Event(_)) && matches!(drain.next(), Next::Event(_)));
        assert_eq!(drain.next(), Next::Empty);
        drop(tap);
        assert_eq!(drain.next(), Next::Ended);
    }

    #[test]
    fn a_listener_that_died_disturbs_neither_the_teller_nor_the_others() {
        let (dead, gone) = queue(4);
        let (alive, drain) = queue(4);
        drop(gone);
        let mut taps = Taps::default();
        assert!(taps.is_empty());
        taps.add(dead);
        taps.add(alive);
        for _ in 0..3 {
            taps.tell(Micros::ZERO, mark("still here"));
        }
        assert_eq!((0..3).filter(|_| matches!(drain.next(), Next::Event(_))).count(), 3);
    }
}
