//! The recorder's thread: from the queue into segments, with pictures kept around stops only.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::status::Status;
use nearfield_shared::units::Micros;

use crate::event::{Decision, Event, LockStep, Picture, Stamped};
use crate::folder::{Store, segment_name};
use crate::listener::Listener;
use crate::messages::{
    self, CompressedImage, ConfigurationMessage, DecisionMessage, DetectionsMessage, LineScanMessage,
    LockStepMessage, Log, StatusMessage, Time, nanoseconds,
};
use crate::queue::{Drain, Next};
use crate::segment::Segment;

/// What is recorded, and how much of it is kept.
#[derive(Debug, Clone)]
pub struct Options {
    /// When the host's clock stood at 0, nanoseconds since 1970.
    pub begun: u64,
    /// The module's name, a-z, 0-9 and _.
    pub module: String,
    /// The configuration file's text.
    pub configuration: String,
    /// The rig's compact form.
    pub rig: Vec<u8>,
    /// All recordings in the folder together, bytes.
    pub limit: u64,
    /// Pictures are kept from so long before a stop or a remark ...
    pub before: Duration,
    /// ... to so long after it.
    pub after: Duration,
}

/// How the recording stands.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct State {
    /// The file that is written; empty = none.
    pub file: String,
    /// Bytes of messages written since the program began.
    pub written: u64,
    /// Events that did not fit into the queue.
    pub dropped: u64,
    /// Why nothing is written; it is tried again later.
    pub problem: Option<String>,
    /// How often it had to stop.
    pub stops: u64,
}

/// A recorder at work. Dropping it ends the recording as it should be.
pub struct Recorder {
    state: Arc<Mutex<State>>,
    thread: Listener,
}

/// A chunk is closed at least so often: what a crash loses.
const FLUSH_INTERVAL: Duration = Duration::from_millis(500);
/// ... and is on the disk: what a power cut loses.
const SYNC_INTERVAL: Duration = Duration::from_secs(5);
/// After the stripe's path, before those who only show.
const NICENESS: i32 = 5;
/// The queue is looked at so often; it holds many times more.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// After a problem.
const RETRY_INTERVAL: Duration = Duration::from_secs(30);
/// Left free for everybody else on the disk.
const RESERVE: u64 = 32 << 20;
/// A segment is a share of the limit, so that deleting one loses little.
const SEGMENTS: u64 = 8;
const LARGEST_SEGMENT: u64 = 64 << 20;
/// Pictures that wait for a stop, bytes.
const LARGEST_RING: usize = 64 << 20;

impl Recorder {
    /// Starts the thread.
    ///
    /// # Errors
    /// The operating system gives no thread.
    pub fn start(options: Options, store: Box<dyn Store>, drain: Drain) -> std::io::Result<Self> {
        let state = Arc::new(Mutex::new(State::default()));
        let mut worker = Worker::new(options, store, Arc::clone(&state));
        let thread = Listener::start("recorder", NICENESS, move |ending| worker.run(&drain, ending))?;
        Ok(Self { state, thread })
    }

    /// How it stands.
    #[must_use]
    pub fn state(&self) -> State {
        self.watch().state()
    }

    /// For others who want to know.
    #[must_use]
    pub fn watch(&self) -> Watch {
        Watch(Arc::clone(&self.state))
    }

    /// Writes what is in the queue, ends the file, and tells how it went.
    #[must_use]
    pub fn finish(mut self) -> State {
        self.thread.end();
        self.state()
    }
}

/// How a recorder stands, for others.
#[derive(Debug, Clone)]
pub struct Watch(Arc<Mutex<State>>);

impl Watch {
    /// How it stands.
    #[must_use]
    pub fn state(&self) -> State {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

struct Worker {
    options: Options,
    run: String,
    store: Box<dyn Store>,
    state: Arc<Mutex<State>>,
    open: Option<Segment>,
    next_segment: u32,
    retry: Instant,
    flushed: Instant,
    synced: Instant,
    told_dropped: u64,
    waiting: VecDeque<Arc<Picture>>,
    waiting_bytes: usize,
    /// Pictures are written until then.
    keep_until: Option<Micros>,
    was_closed: bool,
    causes: StopCauses,
}

impl Worker {
    fn new(options: Options, store: Box<dyn Store>, state: Arc<Mutex<State>>) -> Self {
        let now = Instant::now();
        let begun = std::time::UNIX_EPOCH + Duration::from_nanos(options.begun);
        Self {
            run: humantime::format_rfc3339_millis(begun).to_string(),
            options,
            store,
            state,
            open: None,
            next_segment: 0,
            retry: now,
            flushed: now,
            synced: now,
            told_dropped: 0,
            waiting: VecDeque::new(),
            waiting_bytes: 0,
            keep_until: None,
            was_closed: false,
            causes: StopCauses::NONE,
        }
    }

    fn run(&mut self, drain: &Drain, ending: &AtomicBool) {
        loop {
            match drain.next() {
                Next::Event(stamped) => self.take(&stamped),
                Next::Empty if ending.load(Ordering::Relaxed) => break,
                Next::Ended => break,
                Next::Empty => std::thread::sleep(POLL_INTERVAL),
            }
            self.keep_house(drain.dropped());
        }
        if let Some(segment) = self.open.take()
            && let Err(problem) = segment.finish()
        {
            self.stop(&words(&problem));
        }
        self.tell(|state| state.file.clear());
    }

    fn tell(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Recording stops; everything else goes on.
    fn stop(&mut self, problem: &str) {
        self.open = None;
        self.retry = Instant::now() + RETRY_INTERVAL;
        self.tell(|state| {
            state.problem = Some(problem.to_owned());
            state.stops += 1;
            state.file.clear();
        });
    }

    /// Runs what writes; a failure stops the recording.
    fn write(&mut self, work: impl FnOnce(&mut Segment) -> mcap::McapResult<()>) {
        if self.open.is_none() && Instant::now() >= self.retry {
            self.begin();
        }
        let Some(segment) = &mut self.open else { return };
        let before = segment.bytes();
        if let Err(problem) = work(segment) {
            self.stop(&words(&problem));
            return;
        }
        let (written, full) = (segment.bytes() - before, segment.bytes() >= self.largest_segment());
        self.tell(|state| state.written += written);
        if full {
            self.turn_over();
        }
    }

    fn largest_segment(&self) -> u64 {
        (self.options.limit / SEGMENTS).min(LARGEST_SEGMENT)
    }

    fn turn_over(&mut self) {
        if let Some(segment) = self.open.take()
            && let Err(problem) = segment.finish()
        {
            self.stop(&words(&problem));
        }
    }

    /// A new file, which begins with what runs.
    fn begin(&mut self) {
        if let Some(free) = self.store.free().filter(|free| *free < RESERVE) {
            self.stop(&format!("the disk is nearly full: {} MiB are left; make room", free >> 20));
            return;
        }
        let name = segment_name(&self.options.module, &self.run, self.next_segment);
        let message = ConfigurationMessage {
            module: self.options.module.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            run: self.run.clone(),
            segment: self.next_segment,
            configuration: self.options.configuration.clone(),
            rig: messages::to_text(&self.options.rig),
        };
        let begun = self.store.create(&name).map_err(mcap::McapError::from).and_then(|output| {
            let mut segment = Segment::begin(output)?;
            segment.write(&messages::CONFIGURATION, self.options.begun, &message)?;
            // However short the rest is, it can be told what ran.
            segment.flush()?;
            Ok(segment)
        });
        match begun {
            Ok(segment) => {
                self.open = Some(segment);
                self.next_segment += 1;
                self.tell(|state| {
                    state.file = name;
                    state.problem = None;
                });
            }
            Err(problem) => self.stop(&problem.to_string()),
        }
    }

    fn keep_house(&mut self, dropped: u64) {
        if self.flushed.elapsed() < FLUSH_INTERVAL {
            return;
        }
        self.flushed = Instant::now();
        if dropped > self.told_dropped {
            let lost = dropped - self.told_dropped;
            self.told_dropped = dropped;
            self.tell(|state| state.dropped = dropped);
            // Without a time of its own it stands where it was noticed.
            self.log(Micros::ZERO, 3, format!("{lost} events are missing here: the recorder was too slow"));
        }
        let sync = self.synced.elapsed() >= SYNC_INTERVAL;
        if sync {
            self.synced = Instant::now();
        }
        let Some(segment) = &mut self.open else { return };
        let done = if sync { segment.sync() } else { segment.flush() };
        let keep = self.state.lock().unwrap_or_else(PoisonError::into_inner).file.clone();
        let limit = self.options.limit.saturating_sub(self.largest_segment() / 4);
        let done = done.and_then(|()| Ok(self.store.make_room(limit, &keep)?));
        if let Err(problem) = done {
            self.stop(&words(&problem));
        }
    }

    fn take(&mut self, stamped: &Stamped) {
        let (at, time) = (stamped.at, nanoseconds(self.options.begun, stamped.at));
        match &stamped.event {
            Event::PowerUp { step, payload } => {
                let message = LockStepMessage::of("power_up", step, Some(payload), false);
                self.write(|segment| segment.write(&messages::CONTROLLER, time, &message));
            }
            Event::Tick(step) => {
                let message = LockStepMessage::of("tick", step, None, false);
                self.write(|segment| segment.write(&messages::CONTROLLER, time, &message));
            }
            Event::Exchange { step, line_scan, status } => {
                self.exchange(time, step.as_ref(), line_scan.as_ref().map(|bytes| &bytes[..]), status);
            }
            Event::Decision(decision) => self.decision(at, decision),
            Event::Detections(detections) => {
                let message = DetectionsMessage::of(detections);
                self.write(|segment| segment.write(&messages::DETECTIONS, time, &message));
            }
            Event::Picture(picture) => self.picture(picture),
            Event::Mark(text) => {
                self.log(at, 2, text.to_string());
                self.keep_pictures(at);
            }
            Event::Warning(text) => self.log(at, 3, text.to_string()),
        }
    }

    fn exchange(&mut self, time: u64, step: Option<&LockStep>, line_scan: Option<&[u8]>, status: &[u8]) {
        if let Some(bytes) = line_scan {
            let message = LineScanMessage::of(bytes);
            self.write(|segment| segment.write(&messages::LINE_SCAN, time, &message));
        }
        if let Ok(status) = Status::parse(status) {
            self.causes = status.live_causes.union(status.latched_causes);
        }
        let message = StatusMessage::of(status);
        let step = step.map(|step| LockStepMessage::of("exchange", step, None, line_scan.is_some()));
        self.write(|segment| {
            segment.write(&messages::STATUS, time, &message)?;
            step.map_or(Ok(()), |step| segment.write(&messages::CONTROLLER, time, &step))
        });
    }

    fn decision(&mut self, at: Micros, decision: &Decision) {
        let time = nanoseconds(self.options.begun, at);
        let message = DecisionMessage::of(decision);
        self.write(|segment| segment.write(&messages::DECISION, time, &message));
        if self.was_closed && !decision.relay_closed {
            let words: Vec<&str> =
                self.causes.without(StopCause::Interlock).iter().map(StopCause::words).collect();
            self.log(at, 4, format!("stop: {}", words.join("; ")));
            self.keep_pictures(at);
        }
        self.was_closed = decision.relay_closed;
    }

    fn log(&mut self, at: Micros, level: u8, message: String) {
        let time = nanoseconds(self.options.begun, at);
        let name = "nearfield".to_owned();
        let log = Log { timestamp: Time::of(time), level, message, name, file: String::new(), line: 0 };
        self.write(|segment| segment.write(&messages::LOG, time, &log));
    }

    /// Those that wait are written, and the next ones.
    fn keep_pictures(&mut self, at: Micros) {
        self.keep_until = Some(at.plus(micros(self.options.after)));
        let earliest = at.since(micros(self.options.before));
        self.waiting_bytes = 0;
        for picture in std::mem::take(&mut self.waiting) {
            if picture.exposed >= earliest {
                self.write_picture(&picture);
            }
        }
    }

    fn picture(&mut self, picture: &Arc<Picture>) {
        if self.keep_until.is_some_and(|until| picture.exposed <= until) {
            self.write_picture(picture);
            return;
        }
        self.waiting_bytes += picture.jpeg.len();
        self.waiting.push_back(Arc::clone(picture));
        let earliest = picture.exposed.since(micros(self.options.before));
        while let Some(oldest) = self.waiting.front() {
            if oldest.exposed >= earliest && self.waiting_bytes <= LARGEST_RING {
                break;
            }
            self.waiting_bytes -= oldest.jpeg.len();
            self.waiting.pop_front();
        }
    }

    fn write_picture(&mut self, picture: &Picture) {
        let time = nanoseconds(self.options.begun, picture.exposed);
        let message = CompressedImage::of(picture, time);
        self.write(|segment| segment.write(&messages::CAMERA, time, &message));
    }
}

/// An error with what is behind it: the disk's own word is what helps.
fn words(problem: &mcap::McapError) -> String {
    let mut words = problem.to_string();
    let mut source = std::error::Error::source(problem);
    while let Some(behind) = source {
        words = format!("{words}: {behind}");
        source = behind.source();
    }
    words
}

fn micros(duration: Duration) -> Micros {
    Micros::new(u64::try_from(duration.as_micros()).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests;
