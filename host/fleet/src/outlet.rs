//! A running module's reports, from a thread of its own that steps back behind everybody else.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use nearfield_recording::queue::Next;
use nearfield_recording::{Drain, Event, Listener};
use nearfield_shared::condition::Warnings;
use nearfield_shared::status::Status;

use crate::carrier::Carrier;
use crate::report::{MOST_NAMES, Relay, Report, VERSION};

/// A report goes out so often, and at once where relay, state or causes change.
pub const REPORT_INTERVAL: Duration = Duration::from_millis(200);
/// The stripe's path decides many times a second: silent for so long, nothing is known of the controller.
pub const SILENCE: Duration = Duration::from_millis(250);
/// The queue is looked at so often.
const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Behind everybody else.
const NICENESS: i32 = 10;

/// From events to reports; time comes in as an argument.
pub struct Reporter {
    report: Report,
    heard: Option<Instant>,
    sent: Option<Instant>,
    changed: bool,
}

impl Reporter {
    /// For a module of a robot; `run` is greater than that of any earlier run.
    #[must_use]
    pub fn new(robot: &str, module: &str, modules: &[String], run: u64) -> Self {
        let report = Report {
            version: VERSION,
            robot: robot.to_owned(),
            module: module.to_owned(),
            modules: modules.to_vec(),
            run,
            number: 0,
            relay: Relay::Unknown,
            state: String::new(),
            causes: Vec::new(),
            warnings: Vec::new(),
            longest_gap_mm: 0.0,
            pictures: 0,
        };
        Self { report, heard: None, sent: None, changed: true }
    }

    /// Takes an event.
    pub fn take(&mut self, event: &Event, now: Instant) {
        match event {
            Event::Exchange { status, .. } => match Status::parse(status) {
                Ok(status) => self.status(&status),
                Err(_) => self.unknown(),
            },
            Event::Decision(decision) => {
                self.heard = Some(now);
                self.report.pictures = decision.picture;
                let relay = match (self.report.state.is_empty(), decision.relay_closed) {
                    (true, _) => Relay::Unknown,
                    (false, true) => Relay::Closed,
                    (false, false) => Relay::Open,
                };
                self.changed |= relay != self.report.relay;
                self.report.relay = relay;
            }
            _ => {}
        }
    }

    fn status(&mut self, status: &Status) {
        let causes: Vec<String> =
            status.live_causes.iter().take(MOST_NAMES).map(|cause| cause.name().to_owned()).collect();
        self.changed |= causes != self.report.causes || status.state.name() != self.report.state;
        status.state.name().clone_into(&mut self.report.state);
        self.report.causes = causes;
        let named = Warnings::NAMED.iter().filter(|(warning, ..)| status.warnings.has_any(*warning));
        self.report.warnings = named.map(|(_, name, _)| (*name).to_owned()).collect();
        self.report.longest_gap_mm = status.longest_gap.map_or(0.0, |gap| gap.length().get());
    }

    fn unknown(&mut self) {
        self.changed |= self.report.relay != Relay::Unknown;
        self.report.relay = Relay::Unknown;
        self.report.state.clear();
        self.report.causes.clear();
        self.report.warnings.clear();
    }

    /// The report to send now, if one is due.
    pub fn due(&mut self, now: Instant) -> Option<&Report> {
        if self.heard.is_none_or(|heard| now.duration_since(heard) >= SILENCE) {
            self.unknown();
        }
        let waited = self.sent.is_none_or(|sent| now.duration_since(sent) >= REPORT_INTERVAL);
        if !(waited || self.changed) {
            return None;
        }
        (self.sent, self.changed) = (Some(now), false);
        self.report.number += 1;
        Some(&self.report)
    }
}

/// The thread; dropping it ends it.
pub struct Outlet {
    _thread: Listener,
}

impl Outlet {
    /// Begins.
    ///
    /// # Errors
    /// No thread.
    pub fn start(
        mut reporter: Reporter,
        mut carrier: Box<dyn Carrier>,
        drain: Drain,
    ) -> std::io::Result<Self> {
        let thread = Listener::start("fleet", NICENESS, move |ending| {
            while !ending.load(Ordering::Relaxed) {
                while let Next::Event(stamped) = drain.next() {
                    reporter.take(&stamped.event, Instant::now());
                }
                if let Some(report) = reporter.due(Instant::now()) {
                    // A newer one follows; a network that is down shows as "lost" where it matters.
                    let _ = carrier.send(report);
                }
                std::thread::sleep(POLL_INTERVAL);
            }
        })?;
        Ok(Self { _thread: thread })
    }
}

/// Names a run by when it began: nanoseconds since 1970.
#[must_use]
pub fn run_of_now() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}
