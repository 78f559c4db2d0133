//! What a phase has seen.

use std::fmt;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use nearfield_host::run::Latency;
use nearfield_recording::queue::Next;
use nearfield_recording::{Drain, Event};
use nearfield_shared::status::Status;

/// Counted since the last look.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    /// From the picture in memory to the status received, every picture.
    pub latency: Latency,
    pub pictures: u64,
    /// Pictures for which the relay was closed.
    pub closed: u64,
    /// Times that it opened.
    pub stops: u64,
    /// Answers of tier 3.
    pub answers: u64,
    /// Line-scans that the controller has refused since its start.
    pub refused: u64,
    was_closed: bool,
}

/// Listens beside recorder and page.
pub struct Listener {
    seen: Arc<Mutex<Seen>>,
    ending: Arc<AtomicBool>,
    thread: JoinHandle<u64>,
}

impl Listener {
    pub fn start(drain: Drain) -> Self {
        let (seen, ending) = (Arc::new(Mutex::new(Seen::default())), Arc::new(AtomicBool::new(false)));
        let (of_thread, end) = (Arc::clone(&seen), Arc::clone(&ending));
        let thread = std::thread::spawn(move || {
            while !end.load(Ordering::Relaxed) {
                {
                    let mut seen = of_thread.lock().unwrap();
                    while let Next::Event(stamped) = drain.next() {
                        seen.take(&stamped.event);
                    }
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            drain.dropped()
        });
        Self { seen, ending, thread }
    }

    /// What came since the last call.
    pub fn take(&self) -> Seen {
        let mut seen = self.seen.lock().unwrap();
        let (was_closed, refused) = (seen.was_closed, seen.refused);
        std::mem::replace(&mut *seen, Seen { was_closed, refused, ..Seen::default() })
    }

    /// Events that it missed; 0, or the figures are not of all pictures.
    pub fn end(self) -> u64 {
        self.ending.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

impl Seen {
    fn take(&mut self, event: &Event) {
        match event {
            Event::Decision(decision) => {
                self.latency.add(decision.latency);
                self.pictures += 1;
                self.closed += u64::from(decision.relay_closed);
                self.stops += u64::from(self.was_closed && !decision.relay_closed);
                self.was_closed = decision.relay_closed;
            }
            Event::Detections(_) => self.answers += 1,
            Event::Exchange { status, .. } => {
                if let Ok(status) = Status::parse(status) {
                    self.refused = status.refused.iter().map(|count| u64::from(*count)).sum();
                }
            }
            _ => {}
        }
    }
}

/// A row of the table.
#[derive(Debug)]
pub struct Phase {
    pub name: String,
    pub seconds: f64,
    pub pictures: u64,
    /// The source gave none.
    pub missing: u64,
    /// The controller did not take them.
    pub lost: u64,
    pub restarts: u64,
    /// Line-scans refused by the controller.
    pub refused: u64,
    /// Pictures for which the relay was closed.
    pub closed: u64,
    pub stops: u64,
    /// Answers of tier 3.
    pub answers: u64,
    /// p50, p99, p99.9 and the longest, milliseconds.
    pub latency_ms: [f64; 4],
    /// Resident memory at its end.
    pub memory_mib: f64,
}

impl Phase {
    pub const HEAD: &str = "\
| phase | seconds | pictures | missing | lost | relay closed | stops | tier 3's answers | p50, p99, p99.9, longest, ms | memory, MiB |
|---|---|---|---|---|---|---|---|---|---|";

    /// Nothing was lost, and the robot was let go all the time.
    pub fn assert_undisturbed(&self) {
        assert_eq!((self.missing, self.lost, self.refused, self.stops), (0, 0, 0, 0), "{self:?}");
        assert!(self.pictures > 0 && self.closed == self.pictures, "the relay was open: {self:?}");
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, seconds, pictures, missing, lost, stops, answers, memory_mib, .. } = self;
        let closed = 100.0 * self.closed as f64 / self.pictures.max(1) as f64;
        let [p50, p99, p999, longest] = self.latency_ms;
        write!(
            f,
            "| {name} | {seconds:.0} | {pictures} | {missing} | {lost} | {closed:.1} % | {stops} | {answers} | \
             {p50:.2}, {p99:.2}, {p999:.2}, {longest:.2} | {memory_mib:.1} |"
        )
    }
}
