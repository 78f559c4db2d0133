//! Reports over [zenoh](https://zenoh.io): peers that find each other, or a router of the site; no broker of our own.
//!
//! Each module puts its reports at `nearfield/ROBOT/MODULE`; a listener subscribes to `nearfield/*/*`.

use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session, Wait as _};

use std::time::Duration;

use crate::carrier::{Carrier, CarrierError, Channel, ChannelInbox, Inbox};
use crate::report::Report;

/// All modules of all robots.
const EVERYBODY: &str = "nearfield/*/*";
/// Reports that wait for a listener: two seconds of a thousand modules.
const WAITING: usize = 10_000;

fn failed<E: std::fmt::Display>(problem: E) -> CarrierError {
    CarrierError::Engine { engine: "zenoh", problem: problem.to_string() }
}

/// How this end finds the others.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Settings {
    /// Where it listens, for instance `tcp/0.0.0.0:7447`; none = any free port.
    pub listen: Vec<String>,
    /// Whom it connects to, for instance `tcp/192.168.1.2:7447`.
    pub connect: Vec<String>,
    /// Look for neighbours by multicast?
    pub scout: bool,
}

impl Settings {
    fn open(&self) -> Result<Session, CarrierError> {
        let mut config = Config::default();
        let list = |list: &[String]| serde_json::to_string(list).map_err(failed);
        config.insert_json5("mode", "\"peer\"").map_err(failed)?;
        config
            .insert_json5("scouting/multicast/enabled", if self.scout { "true" } else { "false" })
            .map_err(failed)?;
        if !self.listen.is_empty() {
            config.insert_json5("listen/endpoints", &list(&self.listen)?).map_err(failed)?;
        }
        if !self.connect.is_empty() {
            config.insert_json5("connect/endpoints", &list(&self.connect)?).map_err(failed)?;
        }
        zenoh::open(config).wait().map_err(failed)
    }
}

/// A module's end.
pub struct ZenohCarrier(Session);

impl ZenohCarrier {
    /// For one module, or for several.
    ///
    /// # Errors
    /// zenoh cannot be started so.
    pub fn new(settings: &Settings) -> Result<Self, CarrierError> {
        settings.open().map(Self)
    }
}

impl Carrier for ZenohCarrier {
    fn send(&mut self, report: &Report) -> Result<(), CarrierError> {
        let key = format!("nearfield/{}/{}", report.robot, report.module);
        // A newer report follows: none is worth waiting for.
        let put = self.0.put(key, report.to_bytes()).congestion_control(CongestionControl::Drop);
        put.wait().map_err(failed)
    }
}

/// A listener's end.
pub struct ZenohInbox {
    inbox: ChannelInbox,
    _subscriber: Subscriber<()>,
    _session: Session,
}

impl ZenohInbox {
    /// To all modules.
    ///
    /// # Errors
    /// zenoh cannot be started so.
    pub fn new(settings: &Settings) -> Result<Self, CarrierError> {
        let session = settings.open()?;
        let (channel, inbox) = Channel::new(WAITING);
        let subscriber = session
            .declare_subscriber(EVERYBODY)
            .callback(move |sample| {
                // What finds no room is lost, as on any network; the module sends again.
                channel.offer(sample.payload().to_bytes().into_owned());
            })
            .wait()
            .map_err(failed)?;
        Ok(Self { inbox, _subscriber: subscriber, _session: session })
    }
}

impl Inbox for ZenohInbox {
    fn receive(&mut self, wait: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), CarrierError> {
        self.inbox.receive(wait, take)
    }
}
