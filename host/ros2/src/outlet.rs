//! Publishes over DDS, in a thread of its own that steps back behind everybody else. The stripe's path only ever drops events
//! into the queue; however slow the network is, it does not notice.

use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use nearfield_recording::queue::Next;
use nearfield_recording::{Decision, Drain, Listener};
use nearfield_shared::units::Micros;
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher};
use serde::Serialize;

use crate::messages::{DiagnosticArray, LaserScan, ModuleStatus, PointCloud2, Time};
use crate::reporter::Reporter;

/// What the time stamps say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamp {
    /// The middle of the picture's exposure.
    Exposure,
    /// When the message was sent.
    Sending,
}

/// Where and how it publishes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// `ROS_DOMAIN_ID`.
    pub domain: u16,
    /// This computer's own addresses to talk on; none = all of them.
    pub networks: Vec<IpAddr>,
    /// Topics begin with it: `/nearfield/front`.
    pub namespace: String,
    /// What the time stamps say.
    pub stamp: Stamp,
}

/// Why nothing is published. Everything else goes on.
#[derive(Debug, thiserror::Error)]
pub enum OutletError {
    /// No thread.
    #[error("ROS 2: no thread: {0}")]
    Thread(#[from] std::io::Error),
    /// The participant, the node or a topic.
    #[error("ROS 2: cannot {doing}: {problem}; check [ros2] in the configuration and the network")]
    Dds {
        /// What was tried.
        doing: &'static str,
        /// What was said.
        problem: String,
    },
}

fn dds<E: std::fmt::Display>(doing: &'static str) -> impl FnOnce(E) -> OutletError {
    move |error| OutletError::Dds { doing, problem: error.to_string() }
}

/// The publisher at work; dropping it ends it.
pub struct Outlet {
    published: Arc<AtomicU64>,
    _thread: Listener,
}

/// Behind the stripe's path; the participant's own threads inherit it.
const NICENESS: i32 = 10;
/// The queue is looked at so often.
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Without an event for so long nothing is known any more.
pub const SILENCE: Duration = Duration::from_millis(250);
/// The participant sends from threads of its own, which end with it: what was said last needs so long to go out.
const LAST_WORDS: Duration = Duration::from_millis(200);
const LAST_TRIES: u32 = 10;
/// The status is told so often, and at once where it says something else.
const STATUS_INTERVAL: Duration = Duration::from_millis(100);
/// Diagnostics are told so often, and at once where their level changes.
const DIAGNOSTICS_INTERVAL: Duration = Duration::from_secs(1);

impl Outlet {
    /// Joins the domain and begins.
    ///
    /// # Errors
    /// See [`OutletError`].
    pub fn start(settings: Settings, reporter: Reporter, drain: Drain) -> Result<Self, OutletError> {
        let published = Arc::new(AtomicU64::new(0));
        let tell = Arc::clone(&published);
        let (outcome, started) = sync_channel(1);
        let thread = Listener::start("ros2", NICENESS, move |ending| match Topics::open(&settings) {
            Ok(topics) => {
                let _ = outcome.send(Ok(()));
                Work { topics, reporter, drain, stamp: settings.stamp, published: tell, told: None }
                    .run(ending);
            }
            Err(error) => {
                let _ = outcome.send(Err(error));
            }
        })?;
        let started = started.recv().unwrap_or_else(|_| {
            Err(OutletError::Dds { doing: "join the domain", problem: "the thread has ended".to_owned() })
        });
        let outlet = Self { published, _thread: thread };
        started.map(|()| outlet)
    }

    /// Messages published so far.
    #[must_use]
    pub fn published(&self) -> u64 {
        self.published.load(Ordering::Relaxed)
    }
}

/// What sensors publish with (`rclcpp::SensorDataQoS`): best effort, volatile, the last five.
#[must_use]
pub fn sensor_data() -> QosProfile {
    QosProfile::subscription_default()
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 5 })
}

/// Reliable, and the last ones for who comes later. Never waits: while ten are not acknowledged, none is sent.
#[must_use]
pub fn latched() -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .durability(Durability::TransientLocal)
        .history(History::KeepLast { depth: 10 })
}

/// What `diagnostic_aggregator` asks for: reliable, volatile.
#[must_use]
pub fn diagnostics() -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 10 })
}

/// The node and its publishers.
struct Topics {
    scan: Publisher<LaserScan>,
    heights: Publisher<PointCloud2>,
    status: Publisher<ModuleStatus>,
    diagnostics: Publisher<DiagnosticArray>,
    _node: Node,
}

impl Topics {
    fn open(settings: &Settings) -> Result<Self, OutletError> {
        let mut participant = DomainParticipantBuilder::new(settings.domain);
        if !settings.networks.is_empty() {
            participant = participant.with_only_networks(settings.networks.iter().copied());
        }
        let participant = participant.build().map_err(dds("join the domain"))?;
        let context = Context::from_domain_participant(participant).map_err(dds("open the context"))?;
        let name = NodeName::new(&settings.namespace, "nearfield").map_err(dds("name the node"))?;
        let options = NodeOptions::new().enable_rosout(false);
        let mut node = context.new_node(name, options).map_err(dds("create the node"))?;
        let here = &settings.namespace;
        Ok(Self {
            scan: publisher(&mut node, here, "scan", ("sensor_msgs", "LaserScan"), &sensor_data())?,
            heights: publisher(&mut node, here, "heights", ("sensor_msgs", "PointCloud2"), &sensor_data())?,
            status: publisher(&mut node, here, "status", ("nearfield_msgs", "ModuleStatus"), &latched())?,
            diagnostics: publisher(
                &mut node,
                "/",
                "diagnostics",
                ("diagnostic_msgs", "DiagnosticArray"),
                &diagnostics(),
            )?,
            _node: node,
        })
    }
}

fn publisher<M: Serialize + 'static>(
    node: &mut Node,
    namespace: &str,
    name: &str,
    (package, kind): (&str, &str),
    qos: &QosProfile,
) -> Result<Publisher<M>, OutletError> {
    let name = Name::new(namespace, name).map_err(dds("name a topic"))?;
    let topic =
        node.create_topic(&name, MessageTypeName::new(package, kind), qos).map_err(dds("create a topic"))?;
    node.create_publisher(&topic, None).map_err(dds("create a publisher"))
}

/// The thread's work.
struct Work {
    topics: Topics,
    reporter: Reporter,
    drain: Drain,
    stamp: Stamp,
    published: Arc<AtomicU64>,
    /// The last status.
    told: Option<Told>,
}

/// When a status was told, and what it said.
struct Told {
    at: Instant,
    relay: u8,
    state: String,
    causes: Vec<String>,
}

impl Told {
    fn of(status: &ModuleStatus) -> Self {
        Self {
            at: Instant::now(),
            relay: status.relay,
            state: status.state.clone(),
            causes: status.live_causes.clone(),
        }
    }

    /// Does it say what this one says, too?
    fn says(&self, status: &ModuleStatus) -> bool {
        self.relay == status.relay && self.state == status.state && self.causes == status.live_causes
    }
}

impl Work {
    fn run(mut self, ending: &AtomicBool) {
        let mut heard = Instant::now();
        let mut diagnosed: Option<(Instant, u8)> = None;
        while !ending.load(Ordering::Relaxed) {
            let mut any = false;
            while let Next::Event(stamped) = self.drain.next() {
                if let Some(decision) = self.reporter.take(&stamped.event) {
                    any = true;
                    self.tell(self.time(&decision, stamped.at));
                }
            }
            let now = Instant::now();
            if any {
                heard = now;
            } else if now.duration_since(heard) >= SILENCE {
                heard = now;
                self.reporter.forget();
                self.tell(sending());
            }
            self.diagnose(now, &mut diagnosed);
            std::thread::sleep(POLL_INTERVAL);
        }
        // Who listens on shall not take the last picture for the present.
        self.reporter.forget();
        let round = self.reporter.round(sending());
        self.count(self.topics.scan.publish(round.scan).is_ok());
        self.count(self.topics.diagnostics.publish(self.reporter.diagnostics(sending())).is_ok());
        // Earlier ones may not be acknowledged yet.
        let is_sent = (0..LAST_TRIES).any(|_| {
            std::thread::sleep(LAST_WORDS / LAST_TRIES);
            self.topics.status.publish(round.status.clone()).is_ok()
        });
        self.count(is_sent);
        std::thread::sleep(LAST_WORDS);
    }

    /// A picture's time: now, less what has passed since its exposure on the host's clock.
    fn time(&self, decision: &Decision, at: Micros) -> Time {
        match self.stamp {
            Stamp::Sending => sending(),
            Stamp::Exposure => {
                let age = Duration::from_micros(at.since(decision.exposed).get());
                since_1970(SystemTime::now().checked_sub(age).unwrap_or(UNIX_EPOCH))
            }
        }
    }

    /// A message that cannot be sent is not kept: the next one says more.
    fn tell(&mut self, stamp: Time) {
        let round = self.reporter.round(stamp);
        self.count(self.topics.scan.publish(round.scan).is_ok());
        if let Some(cloud) = round.cloud {
            self.count(self.topics.heights.publish(cloud).is_ok());
        }
        let now = Told::of(&round.status);
        let is_due = self
            .told
            .as_ref()
            .is_none_or(|told| !told.says(&round.status) || told.at.elapsed() >= STATUS_INTERVAL);
        if is_due && self.topics.status.publish(round.status).is_ok() {
            self.told = Some(now);
            self.count(true);
        }
    }

    fn diagnose(&self, now: Instant, diagnosed: &mut Option<(Instant, u8)>) {
        let (level, _) = self.reporter.verdict();
        let is_due = diagnosed
            .is_none_or(|(at, told)| told != level || now.duration_since(at) >= DIAGNOSTICS_INTERVAL);
        if is_due {
            *diagnosed = Some((now, level));
            let message = self.reporter.diagnostics(sending());
            self.count(self.topics.diagnostics.publish(message).is_ok());
        }
    }

    fn count(&self, is_sent: bool) {
        self.published.fetch_add(u64::from(is_sent), Ordering::Relaxed);
    }
}

fn sending() -> Time {
    since_1970(SystemTime::now())
}

fn since_1970(time: SystemTime) -> Time {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    Time::of(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}
