//! The robot's speed as an input: datagrams with one number, mm/s, as text. The newest one counts, for a while.
//!
//! `printf 300 | nc -u -w0 127.0.0.1 8034` tells 300 mm/s. Nobody is answered. Whoever sends can select a case, and so the fields
//! that the host adds; the controller's own field does not listen.

use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nearfield_configuration::{SpeedInput, SpeedSource};
use nearfield_machine::real_time::step_back;

/// No vehicle that this sensor is for is faster, mm/s: such a number is a mistake, and is not used.
pub const GREATEST_SPEED_MM_S: f32 = 20_000.0;
/// Bytes of a datagram that are looked at.
const LONGEST_DATAGRAM: usize = 32;
/// Between two looks at whether it is to end.
const PATIENCE: Duration = Duration::from_millis(200);

/// Why there is no speed input.
#[derive(Debug, thiserror::Error)]
pub enum SpeedError {
    /// The address is taken, or is not this computer's.
    #[error("cannot listen for the robot's speed on {address}: {source}; change speed.listen")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// No thread.
    #[error("cannot start the speed input's thread: {0}")]
    Thread(std::io::Error),
}

/// Bits of a word for the time; the others are for the speed, in whole mm/s.
const TIME_BITS: u32 = 48;
/// Nothing came yet: no speed has this code.
const NOTHING: u64 = 0;

/// The newest speed and when it came, in one word: whoever reads it waits for nobody, and never sees halves of two.
#[derive(Debug, Default)]
struct Newest(AtomicU64);

impl Newest {
    /// Speed code 1 is standstill, rounded up: to be a little faster is never less strict. 48 bits of milliseconds last for
    /// nine thousand years.
    fn set(&self, millis: u64, speed: f32) {
        let code = speed.abs().min(GREATEST_SPEED_MM_S).ceil() as u64 + 1;
        self.0.store(code << TIME_BITS | (millis & ((1 << TIME_BITS) - 1)), Ordering::Relaxed);
    }

    fn get(&self, now: u64, longest_age: u32) -> Option<f32> {
        let word = self.0.load(Ordering::Relaxed);
        let (code, stamp) = (word >> TIME_BITS, word & ((1 << TIME_BITS) - 1));
        let fresh = code != NOTHING && now.saturating_sub(stamp) <= u64::from(longest_age);
        fresh.then(|| (code - 1) as f32)
    }
}

/// The input at work; dropping it ends it.
#[derive(Debug)]
pub struct SpeedListener {
    newest: Arc<Newest>,
    begun: Instant,
    longest_age_ms: u32,
    address: SocketAddr,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl SpeedListener {
    /// Listens, if the configuration wants it.
    ///
    /// # Errors
    /// See [`SpeedError`].
    pub fn start(settings: &SpeedInput) -> Result<Option<Self>, SpeedError> {
        if settings.source == SpeedSource::None {
            return Ok(None);
        }
        let address = settings.listen;
        let failed = |source| SpeedError::Listen { address, source };
        let socket = UdpSocket::bind(address).map_err(failed)?;
        socket.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
        let address = socket.local_addr().map_err(failed)?;
        let (newest, ending) = (Arc::new(Newest::default()), Arc::new(AtomicBool::new(false)));
        let begun = Instant::now();
        let (of_thread, end) = (Arc::clone(&newest), Arc::clone(&ending));
        let thread = std::thread::Builder::new()
            .name("speed".to_owned())
            .spawn(move || {
                step_back();
                listen(&socket, &of_thread, begun, &end);
            })
            .map_err(SpeedError::Thread)?;
        let longest_age_ms = settings.longest_age_ms;
        Ok(Some(Self { newest, begun, longest_age_ms, address, ending, thread: Some(thread) }))
    }

    /// The robot's speed without its sign, rounded up to whole mm/s; `None` = nothing came lately.
    #[must_use]
    pub fn speed_mm_s(&self) -> Option<f32> {
        self.newest.get(millis(self.begun), self.longest_age_ms)
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for SpeedListener {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic was told on standard error.
            let _ = thread.join();
        }
    }
}

fn millis(begun: Instant) -> u64 {
    u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX)
}

fn listen(socket: &UdpSocket, newest: &Newest, begun: Instant, ending: &AtomicBool) {
    let mut datagram = [0; LONGEST_DATAGRAM];
    while !ending.load(Ordering::Relaxed) {
        // Time-outs, and datagrams that could not be delivered elsewhere, are no news.
        let Ok(length) = socket.recv(&mut datagram) else { continue };
        if let Some(speed) = datagram.get(..length).and_then(parse) {
            newest.set(millis(begun), speed);
        }
    }
}

/// The number in a datagram; `None` = it is none that a robot can mean.
#[must_use]
pub fn parse(datagram: &[u8]) -> Option<f32> {
    let text = std::str::from_utf8(datagram).ok()?;
    let speed: f32 = text.trim().parse().ok()?;
    (speed.abs() <= GREATEST_SPEED_MM_S).then_some(speed)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_datagram_is_one_number_that_a_robot_can_mean() {
        for (datagram, expected) in [
            (&b"300"[..], Some(300.0)),
            (b" -12.5\n", Some(-12.5)),
            (b"20000", Some(20_000.0)),
            (b"20001", None),
            (b"NaN", None),
            (b"inf", None),
            (b"", None),
            (b"300 mm/s", None),
            (b"\xff\xfe", None),
        ] {
            assert_eq!(parse(datagram), expected, "{datagram:?}");
        }
    }

    #[test]
    fn a_speed_counts_until_it_is_too_old_and_is_rounded_up() {
        let newest = Newest::default();
        assert_eq!(newest.get(0, 500), None);
        for (told, kept) in [(0.0, 0.0), (299.2, 300.0), (-700.0, 700.0), (20_000.0, 20_000.0)] {
            newest.set(1000, told);
            assert_eq!(newest.get(1500, 500), Some(kept));
            assert_eq!(newest.get(1501, 500), None);
        }
        let in_a_century = 100 * 365 * 24 * 3600 * 1000;
        newest.set(in_a_century, 5.0);
        assert_eq!((newest.get(in_a_century, 500), newest.get(in_a_century + 501, 500)), (Some(5.0), None));
    }

    #[test]
    fn what_is_sent_is_heard_nonsense_is_not_and_silence_is_none() {
        let settings = SpeedInput {
            source: SpeedSource::Udp,
            listen: "127.0.0.1:0".parse().unwrap(),
            longest_age_ms: 5000,
        };
        let listener = SpeedListener::start(&settings).unwrap().unwrap();
        assert_eq!(listener.speed_mm_s(), None);
        let robot = UdpSocket::bind("127.0.0.1:0").unwrap();
        let tell = |text: &str| robot.send_to(text.as_bytes(), listener.address()).unwrap();
        let begun = Instant::now();
        while listener.speed_mm_s() != Some(250.0) {
            tell("250");
            assert!(begun.elapsed() < Duration::from_secs(60), "nothing is heard");
            std::thread::sleep(Duration::from_millis(5));
        }
        // Nonsense first, then a number: once that is heard the nonsense was looked at.
        tell("as fast as it can");
        tell(&"9".repeat(400));
        let begun = Instant::now();
        while listener.speed_mm_s() != Some(0.0) {
            tell("0");
            assert!(begun.elapsed() < Duration::from_secs(60), "it hears nothing any more");
            std::thread::sleep(Duration::from_millis(5));
        }
        let taken = SpeedInput { listen: listener.address(), ..settings };
        let told = SpeedListener::start(&taken).unwrap_err().to_string();
        assert!(told.contains("change speed.listen"), "{told}");
        let none = SpeedInput { source: SpeedSource::None, ..taken };
        assert!(SpeedListener::start(&none).unwrap().is_none());
    }
}
