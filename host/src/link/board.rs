//! The real controller, over SPI: one transaction a picture, while its READY line is high.
//!
//! [`Board`] numbers and sends line-scans and keeps the newest status; the bus is behind [`Bus`], so that everything but the
//! system calls is tested without hardware. **Built, not run on hardware.**
//!
//! What is known to go wrong on a Raspberry Pi is survived: a transfer that fails (SPI DMA error -110) or a device that
//! vanishes closes the bus, which is opened again with a growing pause. In the meantime nothing is sent, and **no line-scan
//! is ever sent a second time**: the controller stops by its own time-out, and the next message is a new picture's.

use std::io;
use std::time::{Duration, Instant};

use nearfield_shared::linescan::{LINE_SCAN_LENGTH, LineScanColumn, LineScanError, LineScanHeader, encode};
use nearfield_shared::status::{Challenge, Status, StatusError};
use nearfield_shared::units::{CalibrationId, Micros, SequenceNumber, SourceId};

use super::FrameFacts;
use crate::light::LightReport;

/// One transaction's bytes.
pub type Transaction = [u8; LINE_SCAN_LENGTH];

/// An SPI bus with the controller's READY line.
pub trait Bus {
    /// Waits until READY is high, at most so long; `false` = it stayed low.
    ///
    /// # Errors
    /// The line cannot be read.
    fn wait_until_ready(&mut self, longest: Duration) -> io::Result<bool>;

    /// One full-duplex transfer.
    ///
    /// # Errors
    /// The transfer failed; how much of it took place is unknown.
    fn transfer(&mut self, out: &Transaction, back: &mut Transaction) -> io::Result<()>;
}

/// Opens a bus, again and again.
pub type Open<B> = Box<dyn FnMut() -> io::Result<B> + Send>;

/// Why a line-scan was not exchanged. It is lost; the next picture makes another one.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// The bus is closed and is opened again later.
    #[error("the bus is closed for another {} ms after: {reason}", .wait.as_millis())]
    Closed {
        /// Until the next try.
        wait: Duration,
        /// What closed it.
        reason: String,
    },
    /// It could not be opened, or a transfer failed.
    #[error("SPI: {0}")]
    Bus(#[from] io::Error),
    /// The controller does not take a transaction.
    #[error("the controller's READY line stays low")]
    NotReady,
    /// What came back is no status.
    #[error("the controller's status: {0}")]
    Status(#[from] StatusError),
    /// The columns fit no line-scan.
    #[error("cannot encode the line-scan: {0}")]
    LineScan(#[from] LineScanError),
}

/// READY rises within the controller's own work of an exchange, 2 ms; a frame later it is too late for this picture.
const LONGEST_WAIT: Duration = Duration::from_millis(8);
/// First pause after a failure; it doubles up to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

enum State<B> {
    Open(B),
    Closed { until: Instant, pause: Duration, reason: String },
}

/// The controller at the other end of a bus.
pub struct Board<B> {
    open: Open<B>,
    state: State<B>,
    source: SourceId,
    calibration: CalibrationId,
    sequence: SequenceNumber,
    status: Option<Status>,
    out: Box<Transaction>,
    back: Box<Transaction>,
    /// The line-scan of the last transaction that took place.
    sent: Box<Transaction>,
    took_place: bool,
    begun: Instant,
    failures: u64,
}

impl<B: Bus> Board<B> {
    /// For the module `source` with the rig of this identity. The bus is opened by the first exchange.
    #[must_use]
    pub fn new(open: Open<B>, source: SourceId, calibration: CalibrationId) -> Self {
        let begun = Instant::now();
        Self {
            open,
            state: State::Closed { until: begun, pause: FIRST_PAUSE, reason: "not opened yet".to_owned() },
            source,
            calibration,
            sequence: SequenceNumber::new(0),
            status: None,
            out: Box::new([0; LINE_SCAN_LENGTH]),
            back: Box::new([0; LINE_SCAN_LENGTH]),
            sent: Box::new([0; LINE_SCAN_LENGTH]),
            took_place: false,
            begun,
            failures: 0,
        }
    }

    /// Time since this host's program began: the clock of exposures.
    #[must_use]
    pub fn now(&self) -> Micros {
        Micros::new(u64::try_from(self.begun.elapsed().as_micros()).unwrap_or(u64::MAX))
    }

    /// The newest status; `None` before the first and while the bus is closed.
    #[must_use]
    pub const fn status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// The columns that the newest status asks for.
    #[must_use]
    pub fn challenge(&self) -> Challenge {
        self.status.map_or(Challenge::default(), |status| status.challenge)
    }

    /// What went out and what came back last time, if the transaction took place.
    #[must_use]
    pub fn last_transaction(&self) -> Option<(&Transaction, &Transaction)> {
        self.took_place.then_some((&*self.sent, &*self.back))
    }

    /// How often the bus failed.
    #[must_use]
    pub const fn failures(&self) -> u64 {
        self.failures
    }

    /// Sends a picture's line-scan and takes the status. As long as no status is known, which a line-scan has to name to be
    /// accepted, the status alone is asked for: a refused line-scan would count against the link for a minute.
    ///
    /// # Errors
    /// See [`BoardError`]; this line-scan is lost then and never sent again.
    pub fn send(
        &mut self,
        columns: &[LineScanColumn],
        light: &LightReport,
        facts: FrameFacts,
    ) -> Result<&Status, BoardError> {
        if self.status.is_none() {
            return self.poll();
        }
        self.took_place = false;
        self.sequence = self.sequence.next();
        let header = LineScanHeader {
            source: self.source,
            calibration: self.calibration,
            sequence: self.sequence,
            capture_age: facts.capture_age,
            exposure: facts.exposure,
            last_status: self.status.map_or(0, |status| status.number),
            verdict: facts.verdict,
            ambient: light.ambient,
            saturated: light.saturated,
            claims: facts.claims,
        };
        encode(&mut self.out, &header, columns, &light.brightness, &light.windows)?;
        self.exchange()
    }

    /// Asks for the status only: zeros out.
    ///
    /// # Errors
    /// See [`BoardError`].
    pub fn poll(&mut self) -> Result<&Status, BoardError> {
        self.took_place = false;
        self.out.fill(0);
        self.exchange()
    }

    fn exchange(&mut self) -> Result<&Status, BoardError> {
        let outcome = self.transact();
        self.took_place = outcome.is_ok();
        // Whatever happened, these bytes are done with: kept for the recorder, never sent again.
        std::mem::swap(&mut self.out, &mut self.sent);
        self.out.fill(0);
        if let Err(BoardError::Bus(error)) = &outcome {
            self.close(error.to_string());
        }
        outcome?;
        // A status that is damaged is none: the challenge in it would be answered wrongly.
        let status = Status::parse(&self.back[..])?;
        Ok(self.status.insert(status))
    }

    fn transact(&mut self) -> Result<(), BoardError> {
        if let State::Closed { until, reason, .. } = &self.state {
            let wait = until.saturating_duration_since(Instant::now());
            if !wait.is_zero() {
                return Err(BoardError::Closed { wait, reason: reason.clone() });
            }
            let bus = (self.open)()?;
            self.state = State::Open(bus);
        }
        let State::Open(bus) = &mut self.state else { return Err(BoardError::NotReady) };
        if !bus.wait_until_ready(LONGEST_WAIT)? {
            return Err(BoardError::NotReady);
        }
        bus.transfer(&self.out, &mut self.back)?;
        Ok(())
    }

    fn close(&mut self, reason: String) {
        self.failures += 1;
        self.status = None;
        let pause = match &self.state {
            State::Closed { pause, .. } => pause.saturating_mul(2).min(LONGEST_PAUSE),
            State::Open(_) => FIRST_PAUSE,
        };
        self.state = State::Closed { until: Instant::now() + pause, pause, reason };
    }

    /// For tests: the pause is over.
    #[cfg(test)]
    fn end_pause(&mut self) {
        if let State::Closed { until, .. } = &mut self.state {
            *until = Instant::now();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::mcu::clean_floor;
    use crate::link::{InProcess, McuLink, SimulatedTick};
    use crate::twin::gallery::CENTRE;
    use nearfield_shared::linescan::LineScan;
    use nearfield_shared::status::STATUS_LENGTH;
    use std::sync::{Arc, Mutex};

    /// What a bus does next; what it was sent.
    #[derive(Default)]
    struct Script {
        refuse_to_open: u32,
        fail: u32,
        low: u32,
        garble: u32,
        opened: u32,
        sent: Vec<Vec<u8>>,
    }

    /// A bus with the firmware's library behind it.
    struct Wire {
        script: Arc<Mutex<Script>>,
        controller: Arc<Mutex<(InProcess, Micros)>>,
    }

    impl Bus for Wire {
        fn wait_until_ready(&mut self, _: Duration) -> io::Result<bool> {
            let mut script = self.script.lock().unwrap();
            script.low = script.low.saturating_sub(1);
            Ok(script.low == 0)
        }

        fn transfer(&mut self, out: &Transaction, back: &mut Transaction) -> io::Result<()> {
            let mut script = self.script.lock().unwrap();
            if script.fail > 0 {
                script.fail -= 1;
                return Err(io::Error::from_raw_os_error(110));
            }
            script.sent.push(out.to_vec());
            let mut guard = self.controller.lock().unwrap();
            let (controller, now) = &mut *guard;
            *now = now.plus(Micros::from_millis(20));
            let (at, silent) = (*now, out.iter().all(|byte| *byte == 0));
            let reply = controller.exchange(at, (!silent).then_some(&out[..])).unwrap();
            for tick in 0..4 {
                let at = at.plus(Micros::from_millis(5 * tick));
                controller.tick(at, SimulatedTick::default()).unwrap();
            }
            back[..STATUS_LENGTH].copy_from_slice(&reply.status);
            if script.garble > 0 {
                script.garble -= 1;
                back[40] ^= 1;
            }
            Ok(())
        }
    }

    fn board() -> (Board<Wire>, Arc<Mutex<Script>>, Vec<LineScanColumn>) {
        let rig = CENTRE.rig().unwrap();
        let mut controller = InProcess::new();
        controller.start(Micros::ZERO, [3; 16], &rig.to_bytes()).unwrap();
        let script = Arc::new(Mutex::new(Script::default()));
        let controller = Arc::new(Mutex::new((controller, Micros::ZERO)));
        let (of_open, of_wire) = (Arc::clone(&script), Arc::clone(&script));
        let open: Open<Wire> = Box::new(move || {
            let mut script = of_open.lock().unwrap();
            script.opened += 1;
            if script.refuse_to_open > 0 {
                script.refuse_to_open -= 1;
                return Err(io::Error::from(io::ErrorKind::NotFound));
            }
            Ok(Wire { script: Arc::clone(&of_wire), controller: Arc::clone(&controller) })
        });
        (Board::new(open, InProcess::SOURCE, rig.calibration_id()), script, clean_floor(&rig).unwrap())
    }

    fn send(board: &mut Board<Wire>, columns: &[LineScanColumn]) -> Result<Status, BoardError> {
        board.send(columns, &LightReport::DARK, FrameFacts::default()).copied()
    }

    #[test]
    fn the_controller_accepts_line_scan_after_line_scan() {
        let (mut board, script, floor) = board();
        board.poll().unwrap();
        for _ in 0..10 {
            send(&mut board, &floor).unwrap();
        }
        let status = *board.poll().unwrap();
        assert_eq!((status.accepted, status.refused), (10, [0; 8]));
        assert!(board.challenge().count > 0);
        assert_eq!((script.lock().unwrap().opened, board.failures()), (1, 0));
    }

    /// Whoever begins with a line-scan names a status that the controller has never sent.
    #[test]
    fn from_the_first_picture_on_nothing_is_refused_also_after_the_bus_was_closed() {
        let (mut board, script, floor) = board();
        for picture in 0..30 {
            if picture == 15 {
                script.lock().unwrap().fail = 1;
            }
            let _ = send(&mut board, &floor);
            board.end_pause();
        }
        let status = *board.poll().unwrap();
        // The first one asks, the fifteenth fails, the one after it asks again.
        assert_eq!((status.accepted, status.refused), (27, [0; 8]));
    }

    #[test]
    fn no_line_scan_is_ever_sent_twice() {
        let (mut board, script, floor) = board();
        board.poll().unwrap();
        for attempt in 0..60 {
            match attempt % 6 {
                1 => script.lock().unwrap().fail = 1,
                3 => script.lock().unwrap().low = 2,
                4 => script.lock().unwrap().garble = 1,
                _ => board.end_pause(),
            }
            let _ = send(&mut board, &floor);
        }
        let sent = &script.lock().unwrap().sent;
        let mut numbers: Vec<u32> = sent
            .iter()
            .filter_map(|bytes| Some(LineScan::parse(bytes).ok()?.header().sequence.get()))
            .collect();
        assert!(numbers.len() > 20 && board.failures() >= 9, "{} {}", numbers.len(), board.failures());
        let count = numbers.len();
        numbers.dedup();
        assert!(numbers.is_sorted() && numbers.len() == count);
    }

    #[test]
    fn a_failed_bus_is_opened_again_after_a_pause_that_grows() {
        let (mut board, script, floor) = board();
        board.poll().unwrap();
        script.lock().unwrap().fail = 1;
        let failed = send(&mut board, &floor).unwrap_err();
        assert!(failed.to_string().contains("os error 110"), "{failed}");
        assert!(board.status().is_none(), "what it said before is no longer true");
        assert!(
            matches!(send(&mut board, &floor), Err(BoardError::Closed { wait, .. }) if wait <= FIRST_PAUSE)
        );
        script.lock().unwrap().refuse_to_open = 10;
        let mut pauses = Vec::new();
        for _ in 0..10 {
            board.end_pause();
            assert!(matches!(send(&mut board, &floor), Err(BoardError::Bus(_))));
            let State::Closed { pause, .. } = &board.state else { panic!("open") };
            pauses.push(*pause);
        }
        assert_eq!(pauses[..3], [200, 400, 800].map(Duration::from_millis));
        assert_eq!(pauses[9], LONGEST_PAUSE);
        board.end_pause();
        assert!(send(&mut board, &floor).is_ok());
        script.lock().unwrap().fail = 1;
        let _ = send(&mut board, &floor);
        let State::Closed { pause, .. } = &board.state else { panic!("open") };
        assert_eq!(*pause, FIRST_PAUSE, "after a success it begins anew");
    }

    #[test]
    fn a_controller_that_is_busy_or_garbled_is_told_and_nothing_is_kept_of_it() {
        let (mut board, script, floor) = board();
        let before = *board.poll().unwrap();
        script.lock().unwrap().low = 2;
        assert!(matches!(send(&mut board, &floor), Err(BoardError::NotReady)));
        script.lock().unwrap().garble = 1;
        assert!(matches!(send(&mut board, &floor), Err(BoardError::Status(_))));
        assert_eq!(board.status().unwrap().number, before.number);
    }
}
