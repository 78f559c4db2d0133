//! Whom the host tells: ROS 2, and who keeps watch over a fleet.

use std::net::{IpAddr, SocketAddr};

use crate::reader::Section;
use crate::sections::Module;

/// What the time stamps of ROS 2 messages say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ros2Stamp {
    /// The middle of the picture's exposure.
    Exposure,
    /// When the message was sent.
    Sending,
}

/// The module as ROS 2 sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ros2 {
    /// Is anything published? Needs the feature `ros2`.
    pub publish: bool,
    /// `ROS_DOMAIN_ID`.
    pub domain: u32,
    /// This computer's own addresses to talk on; none = all of them.
    pub networks: Vec<IpAddr>,
    /// Topics begin with it.
    pub namespace: String,
    /// Frame of reference of the messages.
    pub frame_id: String,
    /// What the time stamps say.
    pub stamp: Ros2Stamp,
}

/// How a module's reports travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FleetCarrier {
    /// It makes none.
    None,
    /// Datagrams to one listener.
    Udp,
    /// zenoh; needs the feature `zenoh`.
    Zenoh,
}

/// The module as one of a robot's, and the robot as one of a fleet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fleet {
    /// How reports travel.
    pub carrier: FleetCarrier,
    /// The robot's name.
    pub robot: String,
    /// All modules of this robot.
    pub modules: Vec<String>,
    /// UDP: where the listener is.
    pub to: SocketAddr,
    /// zenoh: whom to connect to; none = neighbours are looked for.
    pub connect: Vec<String>,
}

pub(crate) fn ros2(section: &Section<'_>, module: &Module) -> Ros2 {
    let address = |text: &String| match text.parse::<IpAddr>() {
        Ok(address) => Some(address),
        Err(_) => {
            section.object("networks", format!("\"{text}\" is no address, for instance \"192.168.1.20\""));
            None
        }
    };
    let frame_id = section.text("frame_id", &format!("nearfield_{}", module.name));
    let namespace = section.text("namespace", &format!("/nearfield/{}", module.name));
    let publish = section.flag("publish", false);
    // One that follows from the module's name matters only where it is used.
    if (publish || section.has("namespace")) && !is_ros_name(&namespace) {
        section.object(
            "namespace",
            "must begin with / and consist of names: a-z, 0-9, _, none of them beginning with a digit",
        );
    }
    let ros2 = Ros2 {
        publish,
        // Beyond this the ports of DDS are above 65535.
        domain: section.whole("domain", 0, 0..=232, ""),
        networks: section.names("networks").iter().filter_map(address).collect(),
        namespace,
        frame_id,
        stamp: section.choice(
            "stamp",
            Ros2Stamp::Exposure,
            &[("exposure", Ros2Stamp::Exposure), ("sending", Ros2Stamp::Sending)],
        ),
    };
    section.finish();
    ros2
}

/// Names of robots and modules, as reports carry them.
fn is_fleet_name(name: &str) -> bool {
    (1..=48).contains(&name.len())
        && name.bytes().all(|one| one.is_ascii_alphanumeric() || matches!(one, b'_' | b'-' | b'.'))
}

pub(crate) fn fleet(section: &Section<'_>) -> Fleet {
    let carriers = [("none", FleetCarrier::None), ("udp", FleetCarrier::Udp), ("zenoh", FleetCarrier::Zenoh)];
    let fleet = Fleet {
        carrier: section.choice("carrier", FleetCarrier::None, &carriers),
        robot: section.text("robot", "robot"),
        modules: section.names("modules"),
        to: section.address("to", 8035),
        connect: section.names("connect"),
    };
    let rule = "names have 1 to 48 characters, a-z, A-Z, 0-9, _, - and .";
    if !is_fleet_name(&fleet.robot) {
        section.object("robot", rule);
    }
    if fleet.modules.len() > 8 || !fleet.modules.iter().all(|name| is_fleet_name(name)) {
        section.object("modules", format!("at most 8 of them, and {rule}"));
    }
    section.finish();
    fleet
}

/// An absolute name as ROS 2 has them.
fn is_ros_name(name: &str) -> bool {
    let is_token = |token: &str| {
        token.starts_with(|first: char| first.is_ascii_lowercase() || first == '_')
            && token.chars().all(|one| one.is_ascii_lowercase() || one.is_ascii_digit() || one == '_')
            && !token.contains("__")
    };
    name.strip_prefix('/').is_some_and(|rest| rest.split('/').all(is_token))
}
