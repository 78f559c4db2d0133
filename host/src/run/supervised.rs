//! A source of pictures that may break: it is watched, and opened again with a growing pause.

use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use nearfield_shared::units::Micros;

use super::source::Source;
use crate::capture::Frame;

/// Opens a source, again and again.
pub type Open = Box<dyn FnMut() -> anyhow::Result<Box<dyn Source>> + Send>;

/// What a frame period has brought.
#[derive(Debug)]
pub enum Got<'a> {
    /// A picture, and how long ago the stripe was exposed, if the source tells ([`Source::age`]).
    Picture(&'a Frame, Option<Micros>),
    /// None in time, or the source is closed at the moment.
    Nothing,
    /// The source broke, has stalled, or could not be opened; it is tried again later. Told once for each time.
    Broken(anyhow::Error),
}

/// Opens in a thread of its own, that is started now. A thread and a program inherit priority and cores of who starts them: what
/// is opened again later would otherwise be as urgent as the stripe's path, and on its core.
///
/// # Errors
/// The operating system gives no thread.
pub fn elsewhere(mut open: Open) -> std::io::Result<Open> {
    let (orders, incoming) = sync_channel::<()>(0);
    let (outgoing, opened) = sync_channel(0);
    std::thread::Builder::new().name("source".to_owned()).spawn(move || {
        // Ends when nobody opens anything any more.
        while incoming.recv().is_ok() && outgoing.send(open()).is_ok() {}
    })?;
    Ok(Box::new(move || {
        let gone = "the thread that opens the source has ended; start the program again";
        orders.send(()).context(gone)?;
        opened.recv().context(gone)?
    }))
}

enum State {
    Open { source: Box<dyn Source>, since: Instant, last_picture: Instant },
    Closed { until: Instant },
}

/// See the module's documentation.
pub struct Supervised {
    open: Open,
    state: State,
    /// Before the next opening.
    pause: Duration,
    /// A wait for nothing is this long.
    period: Duration,
    restarts: u64,
}

/// Pauses before a broken source is opened again.
const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// A source that delivered for so long was sound: the next pause is the first again.
const SOUND_AFTER: Duration = Duration::from_secs(2);
/// No picture for so long: it has stalled (a camera front-end's time-out, for instance).
const STALLED_AFTER: Duration = Duration::from_secs(1);

impl Supervised {
    /// The first opening must work: a mistake in the configuration is told at once.
    ///
    /// # Errors
    /// It did not.
    pub fn open(mut open: Open, period: Duration) -> anyhow::Result<Self> {
        let now = Instant::now();
        let state = State::Open { source: open()?, since: now, last_picture: now };
        Ok(Self { open, state, pause: FIRST_PAUSE, period, restarts: 0 })
    }

    /// Times that it was opened again.
    #[must_use]
    pub const fn restarts(&self) -> u64 {
        self.restarts
    }

    /// The next picture; `drive` as in [`Source::advance`]. Never longer than the source's own time-out or a frame period.
    pub fn next(&mut self, drive: f32) -> Got<'_> {
        if let Err(error) = self.open_if_due() {
            return Got::Broken(error);
        }
        let State::Open { source, since, last_picture } = &mut self.state else {
            std::thread::sleep(self.period);
            return Got::Nothing;
        };
        // Two looks at the source, because a picture is lent out: this one tells how it went.
        let outcome = source.advance(drive);
        let now = Instant::now();
        let broken = match outcome {
            Ok(true) => {
                *last_picture = now;
                if now.duration_since(*since) >= SOUND_AFTER {
                    self.pause = FIRST_PAUSE;
                }
                None
            }
            Ok(false) if now.duration_since(*last_picture) >= STALLED_AFTER => {
                Some(anyhow::anyhow!("no picture for {:.1} s", STALLED_AFTER.as_secs_f64()))
            }
            Ok(false) => return Got::Nothing,
            Err(error) => Some(error),
        };
        if let Some(error) = broken {
            self.close(now);
            return Got::Broken(error);
        }
        match &self.state {
            State::Open { source, .. } => Got::Picture(source.frame(), source.age()),
            State::Closed { .. } => Got::Nothing,
        }
    }

    fn close(&mut self, now: Instant) {
        self.state = State::Closed { until: now + self.pause };
        self.pause = (self.pause * 2).min(LONGEST_PAUSE);
    }

    fn open_if_due(&mut self) -> anyhow::Result<()> {
        let State::Closed { until } = self.state else { return Ok(()) };
        if Instant::now() < until {
            return Ok(());
        }
        match (self.open)() {
            Ok(source) => {
                let now = Instant::now();
                self.state = State::Open { source, since: now, last_picture: now };
                self.restarts += 1;
                Ok(())
            }
            Err(error) => {
                self.close(Instant::now());
                Err(error)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Pixels;
    use anyhow::bail;
    use nearfield_shared::rig::ImageSize;
    use std::collections::VecDeque;
    use std::sync::{Arc, Mutex};

    /// Does one thing after the other, then breaks.
    struct Scripted(VecDeque<bool>, Frame);

    impl Source for Scripted {
        fn advance(&mut self, _: f32) -> anyhow::Result<bool> {
            match self.0.pop_front() {
                Some(outcome) => Ok(outcome),
                None => bail!("the end of the script"),
            }
        }

        fn frame(&self) -> &Frame {
            &self.1
        }
    }

    fn frame() -> Frame {
        Frame::new(ImageSize { width: 2, height: 2 }, Pixels::Yuv420(vec![1; 6])).unwrap()
    }

    /// Opened with these scripts, one after the other; `None` = cannot be opened.
    fn supervised(scripts: Vec<Option<Vec<bool>>>) -> (Supervised, Arc<Mutex<Vec<Instant>>>) {
        let openings = Arc::new(Mutex::new(Vec::new()));
        let (told, mut scripts) = (Arc::clone(&openings), scripts.into_iter());
        let open: Open = Box::new(move || {
            told.lock().unwrap().push(Instant::now());
            match scripts.next() {
                Some(Some(script)) => Ok(Box::new(Scripted(script.into(), frame())) as Box<dyn Source>),
                _ => bail!("cannot be opened"),
            }
        });
        (Supervised::open(open, Duration::from_millis(1)).unwrap(), openings)
    }

    #[test]
    fn a_source_that_breaks_is_opened_again_after_a_pause_in_which_nothing_comes() {
        let (mut source, openings) = supervised(vec![Some(vec![true, false, true]), Some(vec![true])]);
        assert!(matches!(source.next(1.0), Got::Picture(..)));
        assert!(matches!(source.next(1.0), Got::Nothing));
        assert!(matches!(source.next(1.0), Got::Picture(..)));
        let Got::Broken(error) = source.next(1.0) else { panic!("not broken") };
        assert_eq!(error.to_string(), "the end of the script");
        let broken = Instant::now();
        loop {
            match source.next(1.0) {
                Got::Nothing => {}
                Got::Picture(..) => break,
                Got::Broken(error) => panic!("{error}"),
            }
        }
        let openings = openings.lock().unwrap();
        assert!(openings[1].duration_since(broken) + Duration::from_millis(10) >= FIRST_PAUSE);
        assert_eq!((openings.len(), source.restarts()), (2, 1));
    }

    #[test]
    fn the_pause_grows_with_every_failure_and_each_is_told() {
        let (mut source, openings) = supervised(vec![Some(vec![]), None, None, Some(vec![true])]);
        let mut told = Vec::new();
        loop {
            match source.next(1.0) {
                Got::Broken(error) => told.push(error.to_string()),
                Got::Nothing => {}
                Got::Picture(..) => break,
            }
        }
        assert_eq!(told, ["the end of the script", "cannot be opened", "cannot be opened"]);
        let openings = openings.lock().unwrap();
        let pauses: Vec<_> = openings.windows(2).map(|two| two[1].duration_since(two[0])).collect();
        for (pause, least) in pauses.iter().zip([200, 400, 800]) {
            assert!(*pause >= Duration::from_millis(least), "{pauses:?}");
        }
    }

    #[test]
    fn a_source_that_stalls_counts_as_broken() {
        let (mut source, _) = supervised(vec![Some(vec![false; 1_000_000])]);
        let begun = Instant::now();
        let error = loop {
            match source.next(1.0) {
                Got::Broken(error) => break error,
                Got::Nothing => std::thread::sleep(Duration::from_millis(1)),
                Got::Picture(..) => panic!("there was none"),
            }
        };
        assert!(
            begun.elapsed() >= STALLED_AFTER && error.to_string().contains("no picture for 1.0 s"),
            "{error}"
        );
    }

    /// On Linux a thread may run where the one that started it may run.
    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_opened_again_does_not_inherit_the_stripes_paths_core() {
        use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
        let count = || sched_getaffinity(None).unwrap().count();
        let whole = count();
        let (tell, told) = std::sync::mpsc::channel();
        let open: Open = Box::new(move || {
            tell.send(sched_getaffinity(None).unwrap().count()).unwrap();
            Ok(Box::new(Scripted(VecDeque::new(), frame())) as Box<dyn Source>)
        });
        let mut supervised = Supervised::open(elsewhere(open).unwrap(), Duration::from_millis(1)).unwrap();
        assert_eq!(told.recv().unwrap(), whole);
        // As real time does for the stripe's path: on one core from now on.
        let first = sched_getaffinity(None).unwrap();
        let one = (0..CpuSet::MAX_CPU).find(|core| first.is_set(*core)).unwrap();
        let mut only = CpuSet::new();
        only.set(one);
        sched_setaffinity(None, &only).unwrap();
        assert_eq!(count(), 1);
        while told.try_recv().map(|cores| assert_eq!(cores, whole)).is_err() {
            supervised.next(1.0);
        }
    }

    #[test]
    fn an_opener_whose_thread_panicked_is_an_error() {
        let mut open = elsewhere(Box::new(|| panic!("on purpose"))).unwrap();
        assert!(open().err().unwrap().to_string().contains("start the program again"));
    }

    #[test]
    fn a_source_that_cannot_be_opened_at_all_is_told_at_once() {
        let told = Supervised::open(Box::new(|| bail!("no camera")), Duration::ZERO).err().unwrap();
        assert_eq!(told.to_string(), "no camera");
    }
}
