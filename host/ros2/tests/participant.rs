//! A second participant of the same domain hears what a sensor publishes, with the quality of service that nav2 asks for. Over
//! this computer's loopback only; needs the feature `dds`.

#![cfg(feature = "dds")]
#![allow(clippy::unwrap_used)]

mod scene;

use std::time::{Duration, Instant};

use nearfield_recording::{Tap, queue};
use nearfield_ros2::messages::{DiagnosticArray, LaserScan, ModuleStatus, PointCloud2};
use nearfield_ros2::outlet::{diagnostics, latched, sensor_data};
use nearfield_ros2::{About, Outlet, Reporter, Settings, Stamp};
use nearfield_shared::units::Micros;
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::QosProfile;
use ros2_client::{Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Subscription};
use scene::{decision, exchange, line_scan, rig, status};
use serde::de::DeserializeOwned;

/// Far from the usual ones: no stranger's robot is to hear a test.
const DOMAIN: u16 = 201;
const LOOPBACK: std::net::IpAddr = std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);
/// Discovery takes seconds at most; who waits longer waits in vain.
const PATIENCE: Duration = Duration::from_secs(60);

struct Listener {
    node: Node,
}

impl Listener {
    fn join() -> Self {
        let participant =
            DomainParticipantBuilder::new(DOMAIN).with_only_networks([LOOPBACK]).build().unwrap();
        let context = Context::from_domain_participant(participant).unwrap();
        let name = NodeName::new("/", "listener").unwrap();
        Self { node: context.new_node(name, NodeOptions::new().enable_rosout(false)).unwrap() }
    }

    fn listen<M: DeserializeOwned + 'static>(
        &mut self,
        (namespace, name): (&str, &str),
        (package, kind): (&str, &str),
        qos: &QosProfile,
    ) -> Subscription<M> {
        let name = Name::new(namespace, name).unwrap();
        let topic = self.node.create_topic(&name, MessageTypeName::new(package, kind), qos).unwrap();
        self.node.create_subscription(&topic, None).unwrap()
    }
}

/// A sensor that sees the same picture again and again, until `heard` says that it was understood.
fn until<T>(what: &str, tap: Option<&Tap>, cut: bool, mut heard: impl FnMut() -> Option<T>) -> T {
    let (begun, rig) = (Instant::now(), rig());
    let bytes = line_scan(&rig, |place| (!cut || place < 0.0).then_some(0.0));
    while begun.elapsed() < PATIENCE {
        if let Some(tap) = tap {
            tap.tell(Micros::from_millis(1000), exchange(Some(bytes), status().to_bytes()));
            tap.tell(Micros::from_millis(1000), decision(!cut));
        }
        std::thread::sleep(Duration::from_millis(20));
        if let Some(heard) = heard() {
            return heard;
        }
    }
    panic!("{what}: not heard in {PATIENCE:?}");
}

fn newest<M: DeserializeOwned + 'static>(subscription: &Subscription<M>) -> Option<M> {
    let mut newest = None;
    while let Ok(Some((message, _))) = subscription.take() {
        newest = Some(message);
    }
    newest
}

#[test]
fn a_second_participant_hears_scan_heights_status_and_diagnostics_and_the_end() {
    let (tap, drain) = queue(64);
    let about = About {
        module: "front".to_owned(),
        frame_id: "nearfield_front".to_owned(),
        scan_time: 0.02,
        tells_heights: true,
    };
    let settings = Settings {
        domain: DOMAIN,
        networks: vec![LOOPBACK],
        namespace: "/nearfield/front".to_owned(),
        stamp: Stamp::Exposure,
    };
    let outlet = Outlet::start(settings, Reporter::new(&rig(), about).unwrap(), drain).unwrap();
    let mut listener = Listener::join();
    let here = "/nearfield/front";
    // As rclcpp::SensorDataQoS, with which nav2's collision monitor and costmaps subscribe.
    let scans = listener.listen::<LaserScan>((here, "scan"), ("sensor_msgs", "LaserScan"), &sensor_data());
    let clouds =
        listener.listen::<PointCloud2>((here, "heights"), ("sensor_msgs", "PointCloud2"), &sensor_data());

    let free = until("a free floor", Some(&tap), false, || {
        newest(&scans).filter(|scan| scan.ranges.iter().all(|range| range.is_infinite()))
    });
    assert_eq!(free.header.frame_id, "nearfield_front");
    let cut = until("a cut floor", Some(&tap), true, || {
        newest(&scans).filter(|scan| scan.ranges.iter().any(|range| range.is_finite()))
    });
    let blocked = cut.ranges.iter().filter(|range| range.is_finite()).count();
    assert!(
        blocked * 10 > cut.ranges.len() * 4,
        "half of the stripe is cut: {blocked} of {}",
        cut.ranges.len()
    );
    let cloud = until("a cloud", Some(&tap), true, || newest(&clouds));
    assert_eq!(cloud.data.len(), (cloud.width * cloud.point_step) as usize);

    // Who comes later hears the last status at once, without anything new.
    let statuses =
        listener.listen::<ModuleStatus>((here, "status"), ("nearfield_msgs", "ModuleStatus"), &latched());
    let diagnoses = listener.listen::<DiagnosticArray>(
        ("/", "diagnostics"),
        ("diagnostic_msgs", "DiagnosticArray"),
        &diagnostics(),
    );
    let late = until("the latched status", None, true, || newest(&statuses));
    assert_eq!(late.module, "front");
    let diagnosis = until("diagnostics", Some(&tap), true, || newest(&diagnoses));
    assert_eq!(diagnosis.status[0].name, "nearfield: front");

    // The publisher's end leaves nobody with a free floor.
    until("a free floor again", Some(&tap), false, || {
        newest(&scans).filter(|scan| scan.ranges.iter().all(|range| range.is_infinite()))
    });
    assert!(outlet.published() > 0);
    let ending = std::thread::spawn(move || drop(outlet));
    let last = until("the end", None, true, || {
        newest(&statuses).filter(|status| status.relay == ModuleStatus::UNKNOWN)
    });
    assert_eq!(last.advice, "stop_and_warn");
    ending.join().unwrap();
}
