//! A thread that listens to a queue, behind everybody else.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// A thread at work; dropping this ends it, and waits until it has ended.
pub struct Listener {
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Listener {
    /// Starts it under this name, `lower` steps of niceness below its parent, as are all threads that it starts. The work looks
    /// at the flag now and then, and returns once it is set.
    ///
    /// # Errors
    /// The operating system gives no thread.
    pub fn start(
        name: &str,
        lower: i32,
        work: impl FnOnce(&AtomicBool) + Send + 'static,
    ) -> std::io::Result<Self> {
        let ending = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&ending);
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            // Where it is refused, nothing is lost but politeness.
            let _ = rustix::process::nice(lower);
            work(&told);
        })?;
        Ok(Self { ending, thread: Some(thread) })
    }

    /// Ends it; a second time does nothing.
    pub fn end(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic was told on standard error. What the thread listened for stays undone, as after a crash.
            let _ = thread.join();
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use std::sync::atomic::AtomicU32;

    #[test]
    fn who_drops_it_waits_for_its_last_words() {
        let words = Arc::new(AtomicU32::new(0));
        let told = Arc::clone(&words);
        let listener = Listener::start("test", 0, move |ending| {
            while !ending.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            told.store(7, Ordering::Relaxed);
        });
        drop(listener.unwrap());
        assert_eq!(words.load(Ordering::Relaxed), 7);
    }

    #[test]
    fn a_panic_of_the_thread_stays_its_own() {
        let mut listener = Listener::start("test", 0, |_| panic!("this panic belongs to the test")).unwrap();
        listener.end();
        listener.end();
    }
}
