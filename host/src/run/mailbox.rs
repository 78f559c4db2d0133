//! Hands the newest of something from one thread to another. The writer never waits and, once its buffers have grown,
//! allocates nothing; the reader gets the newest or waits for a next one; what nobody fetched in time is lost.

use std::sync::{Arc, Condvar, Mutex, PoisonError, TryLockError};
use std::time::Duration;

struct Slot<T> {
    value: T,
    fresh: bool,
    closed: bool,
}

struct Shared<T> {
    slot: Mutex<Slot<T>>,
    filled: Condvar,
}

/// The writer's end.
pub struct Writer<T> {
    shared: Arc<Shared<T>>,
    back: T,
}

/// The reader's end.
pub struct Reader<T> {
    shared: Arc<Shared<T>>,
    front: T,
}

/// Makes both ends.
pub struct Mailbox;

impl Mailbox {
    /// A mailbox whose three buffers begin as defaults.
    #[must_use]
    pub fn pair<T: Default>() -> (Writer<T>, Reader<T>) {
        Self::pair_of(T::default)
    }

    /// As [`Self::pair`], with buffers that begin as `empty` makes them.
    pub fn pair_of<T>(empty: impl Fn() -> T) -> (Writer<T>, Reader<T>) {
        let slot = Mutex::new(Slot { value: empty(), fresh: false, closed: false });
        let shared = Arc::new(Shared { slot, filled: Condvar::new() });
        (Writer { shared: Arc::clone(&shared), back: empty() }, Reader { shared, front: empty() })
    }
}

impl<T> Writer<T> {
    /// Fills a buffer and offers it. If the reader is fetching at this very moment, this one is lost and `false` comes back.
    pub fn offer(&mut self, fill: impl FnOnce(&mut T)) -> bool {
        fill(&mut self.back);
        let mut slot = match self.shared.slot.try_lock() {
            Ok(slot) => slot,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return false,
        };
        std::mem::swap(&mut slot.value, &mut self.back);
        slot.fresh = true;
        drop(slot);
        self.shared.filled.notify_one();
        true
    }
}

impl<T> Drop for Writer<T> {
    fn drop(&mut self) {
        self.shared.slot.lock().unwrap_or_else(PoisonError::into_inner).closed = true;
        self.shared.filled.notify_one();
    }
}

/// What a wait for the newest has brought.
#[derive(Debug, PartialEq, Eq)]
pub enum Fetched<'a, T> {
    /// A new one.
    New(&'a mut T),
    /// Nothing new in time.
    Nothing,
    /// The writer is gone.
    Closed,
}

impl<T> Reader<T> {
    /// The newest, if there is one that was not fetched yet. Never waits longer than the writer needs to swap two buffers.
    pub fn newest(&mut self) -> Option<&mut T> {
        let mut slot = self.shared.slot.lock().unwrap_or_else(PoisonError::into_inner);
        if !slot.fresh {
            return None;
        }
        slot.fresh = false;
        std::mem::swap(&mut slot.value, &mut self.front);
        drop(slot);
        Some(&mut self.front)
    }

    /// What was fetched last; a default before the first.
    pub const fn last(&self) -> &T {
        &self.front
    }

    /// Waits for a new one.
    pub fn wait(&mut self, longest: Duration) -> Fetched<'_, T> {
        let slot = self.shared.slot.lock().unwrap_or_else(PoisonError::into_inner);
        let (mut slot, _) = self
            .shared
            .filled
            .wait_timeout_while(slot, longest, |slot| !slot.fresh && !slot.closed)
            .unwrap_or_else(PoisonError::into_inner);
        if !slot.fresh {
            return if slot.closed { Fetched::Closed } else { Fetched::Nothing };
        }
        slot.fresh = false;
        std::mem::swap(&mut slot.value, &mut self.front);
        drop(slot);
        Fetched::New(&mut self.front)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_wins_and_is_fetched_once() {
        let (mut writer, mut reader) = Mailbox::pair::<u32>();
        assert_eq!(reader.newest(), None);
        for value in 1..=5 {
            assert!(writer.offer(|buffer| *buffer = value));
        }
        assert_eq!(reader.newest().copied(), Some(5));
        assert_eq!(reader.newest(), None);
        assert_eq!(reader.wait(Duration::ZERO), Fetched::Nothing);
        writer.offer(|buffer| *buffer = 6);
        assert_eq!(reader.wait(Duration::ZERO), Fetched::New(&mut 6));
        drop(writer);
        assert_eq!(reader.wait(Duration::from_secs(3600)), Fetched::Closed);
    }

    #[test]
    fn a_reader_that_holds_the_slot_delays_no_writer() {
        let (mut writer, reader) = Mailbox::pair::<u32>();
        let held = reader.shared.slot.lock().unwrap();
        assert!(!writer.offer(|buffer| *buffer = 1), "lost, not waited for");
        drop(held);
        assert!(writer.offer(|buffer| *buffer = 2));
    }

    #[test]
    fn buffers_go_round() {
        let (mut writer, mut reader) = Mailbox::pair::<Vec<u8>>();
        for _ in 0..6 {
            writer.offer(|buffer| {
                buffer.clear();
                buffer.extend_from_slice(&[7; 1000]);
            });
            assert_eq!(reader.newest().map(|buffer| buffer.len()), Some(1000));
        }
        let grown = |buffer: &Vec<u8>| buffer.capacity() >= 1000;
        assert!(grown(&writer.back) && grown(&reader.front), "no buffer is thrown away");
    }

    #[test]
    fn what_is_written_in_one_thread_arrives_whole_in_another() {
        let (mut writer, mut reader) = Mailbox::pair::<Vec<u32>>();
        let reading = std::thread::spawn(move || {
            let (mut seen, mut last) = (0, 0);
            loop {
                match reader.wait(Duration::from_secs(60)) {
                    Fetched::New(values) => {
                        assert!(values.iter().all(|value| *value == values[0]), "torn");
                        assert!(values[0] > last, "older than the one before");
                        (seen, last) = (seen + 1, values[0]);
                    }
                    Fetched::Closed => return (seen, last),
                    Fetched::Nothing => panic!("nothing for a minute"),
                }
            }
        });
        for value in 1..=10_000 {
            writer.offer(|buffer| {
                buffer.clear();
                buffer.resize(100, value);
            });
        }
        drop(writer);
        let (seen, last) = reading.join().unwrap();
        assert!(seen >= 1 && last > 0, "{seen} {last}");
    }
}
