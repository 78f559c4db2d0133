//! How reports travel. Bare UDP is always there; zenoh (feature `zenoh`) where modules and listeners are not neighbours.

use std::net::{SocketAddr, UdpSocket};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use crate::report::{LARGEST_REPORT, Report};

/// Why reports do not travel.
#[derive(Debug, thiserror::Error)]
pub enum CarrierError {
    /// No socket.
    #[error("the fleet's reports cannot {doing} {address}: {source}; change the address")]
    Socket {
        /// What was tried.
        doing: &'static str,
        /// Where.
        address: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// What another engine said.
    #[error("the fleet's reports over {engine}: {problem}")]
    Engine {
        /// Its name.
        engine: &'static str,
        /// In its words.
        problem: String,
    },
}

/// Takes reports away. Must not wait long: a report that cannot be sent is followed by a newer one.
pub trait Carrier: Send {
    /// Sends one.
    ///
    /// # Errors
    /// It could not be sent; later ones may.
    fn send(&mut self, report: &Report) -> Result<(), CarrierError>;
}

/// Brings reports, unchecked.
pub trait Inbox: Send {
    /// Waits so long for the first one, then takes all that are there.
    ///
    /// # Errors
    /// Nothing will come any more, or not now.
    fn receive(&mut self, wait: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), CarrierError>;
}

/// Taken at once at most: between two looks at a flood there is time for the view.
const MOST_AT_ONCE: usize = 4096;

/// A datagram for each report, to one listener.
pub struct UdpCarrier {
    socket: UdpSocket,
    to: SocketAddr,
}

impl UdpCarrier {
    /// To a listener.
    ///
    /// # Errors
    /// No socket.
    pub fn new(to: SocketAddr) -> Result<Self, CarrierError> {
        let any: SocketAddr = if to.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0_u16; 8], 0).into() };
        let socket = UdpSocket::bind(any)
            .and_then(|socket| socket.set_nonblocking(true).map(|()| socket))
            .map_err(|source| CarrierError::Socket { doing: "be sent to", address: to, source })?;
        Ok(Self { socket, to })
    }
}

impl Carrier for UdpCarrier {
    fn send(&mut self, report: &Report) -> Result<(), CarrierError> {
        match self.socket.send_to(&report.to_bytes(), self.to) {
            Ok(_) => Ok(()),
            Err(source) => Err(CarrierError::Socket { doing: "be sent to", address: self.to, source }),
        }
    }
}

/// Takes datagrams.
pub struct UdpInbox {
    socket: UdpSocket,
    address: SocketAddr,
    buffer: Box<[u8; LARGEST_REPORT + 1]>,
}

impl UdpInbox {
    /// Listens.
    ///
    /// # Errors
    /// The address is taken, or is not this computer's.
    pub fn new(address: SocketAddr) -> Result<Self, CarrierError> {
        let failed = |source| CarrierError::Socket { doing: "be taken at", address, source };
        let socket = UdpSocket::bind(address).map_err(failed)?;
        let address = socket.local_addr().map_err(failed)?;
        Ok(Self { socket, address, buffer: Box::new([0; LARGEST_REPORT + 1]) })
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    fn next(&mut self) -> std::io::Result<Option<usize>> {
        match self.socket.recv_from(&mut self.buffer[..]) {
            Ok((length, _)) => Ok(Some(length)),
            // A time-out; or an earlier datagram of ours met a closed port, which is no concern of a listener.
            Err(error)
                if matches!(
                    error.kind(),
                    std::io::ErrorKind::WouldBlock
                        | std::io::ErrorKind::TimedOut
                        | std::io::ErrorKind::ConnectionRefused
                        | std::io::ErrorKind::Interrupted
                ) =>
            {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }
}

impl Inbox for UdpInbox {
    fn receive(&mut self, wait: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), CarrierError> {
        let address = self.address;
        let failed = |source| CarrierError::Socket { doing: "be taken at", address, source };
        self.socket.set_nonblocking(false).map_err(failed)?;
        self.socket.set_read_timeout(Some(wait.max(Duration::from_millis(1)))).map_err(failed)?;
        let Some(length) = self.next().map_err(failed)? else { return Ok(()) };
        take(&self.buffer[..length]);
        self.socket.set_nonblocking(true).map_err(failed)?;
        for _ in 1..MOST_AT_ONCE {
            let Some(length) = self.next().map_err(failed)? else { break };
            take(&self.buffer[..length]);
        }
        Ok(())
    }
}

/// Within one process: for simulated modules, and behind engines that call back.
#[derive(Debug, Clone)]
pub struct Channel(SyncSender<Vec<u8>>);

impl Channel {
    /// Both ends; `length` reports wait at most.
    #[must_use]
    pub fn new(length: usize) -> (Self, ChannelInbox) {
        let (sender, receiver) = sync_channel(length);
        (Self(sender), ChannelInbox(receiver))
    }

    /// Never waits; `false` = there was no room, or nobody listens.
    pub fn offer(&self, bytes: Vec<u8>) -> bool {
        !matches!(self.0.try_send(bytes), Err(TrySendError::Full(_) | TrySendError::Disconnected(_)))
    }
}

impl Carrier for Channel {
    fn send(&mut self, report: &Report) -> Result<(), CarrierError> {
        if self.offer(report.to_bytes()) {
            Ok(())
        } else {
            Err(CarrierError::Engine { engine: "a channel", problem: "it is full, or closed".to_owned() })
        }
    }
}

/// The other end.
#[derive(Debug)]
pub struct ChannelInbox(Receiver<Vec<u8>>);

impl Inbox for ChannelInbox {
    fn receive(&mut self, wait: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), CarrierError> {
        match self.0.recv_timeout(wait) {
            Ok(bytes) => take(&bytes),
            Err(RecvTimeoutError::Timeout) => return Ok(()),
            Err(RecvTimeoutError::Disconnected) => {
                let problem = "all senders have ended".to_owned();
                return Err(CarrierError::Engine { engine: "a channel", problem });
            }
        }
        for bytes in self.0.try_iter().take(MOST_AT_ONCE - 1) {
            take(&bytes);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::report::tests::report;

    fn all(inbox: &mut dyn Inbox) -> Vec<Vec<u8>> {
        let mut taken = Vec::new();
        // One look may come before the last datagram.
        while taken.len() < 3 {
            inbox.receive(Duration::from_secs(10), &mut |bytes| taken.push(bytes.to_vec())).unwrap();
        }
        taken
    }

    #[test]
    fn every_carrier_brings_what_was_sent() {
        let mut udp = UdpInbox::new("127.0.0.1:0".parse().unwrap()).unwrap();
        let to = udp.address();
        let (channel, mut received) = Channel::new(8);
        let pairs: [(Box<dyn Carrier>, &mut dyn Inbox); 2] =
            [(Box::new(UdpCarrier::new(to).unwrap()), &mut udp), (Box::new(channel), &mut received)];
        for (mut carrier, inbox) in pairs {
            let sent: Vec<Report> = ["a", "b", "c"].map(|module| report("amr", module)).into();
            for report in &sent {
                carrier.send(report).unwrap();
            }
            let taken: Vec<Report> = all(inbox).iter().map(|bytes| Report::parse(bytes).unwrap()).collect();
            assert_eq!(taken, sent);
            inbox.receive(Duration::from_millis(1), &mut |_| panic!("there is no more")).unwrap();
        }
    }

    /// A datagram that is cut off must not look like a shorter, sound one.
    #[test]
    fn a_datagram_that_is_too_long_is_no_report() {
        let mut inbox = UdpInbox::new("127.0.0.1:0".parse().unwrap()).unwrap();
        let mut bytes = report("amr", "front").to_bytes();
        bytes.resize(LARGEST_REPORT + 200, b' ');
        UdpSocket::bind("127.0.0.1:0").unwrap().send_to(&bytes, inbox.address()).unwrap();
        let mut refused = None;
        while refused.is_none() {
            inbox
                .receive(Duration::from_secs(10), &mut |bytes| {
                    refused = Some(Report::parse(bytes).unwrap_err())
                })
                .unwrap();
        }
        assert_eq!(refused, Some(crate::ReportError::Length));
    }

    #[test]
    fn a_full_channel_does_not_wait() {
        let (mut channel, inbox) = Channel::new(1);
        assert!(channel.send(&report("amr", "front")).is_ok());
        assert!(channel.send(&report("amr", "front")).is_err());
        drop(inbox);
        assert!(channel.send(&report("amr", "front")).is_err());
    }

    #[test]
    fn an_address_in_use_is_named() {
        let taken = UdpInbox::new("127.0.0.1:0".parse().unwrap()).unwrap();
        let error = UdpInbox::new(taken.address()).err().unwrap().to_string();
        assert!(error.contains(&taken.address().to_string()), "{error}");
    }
}
