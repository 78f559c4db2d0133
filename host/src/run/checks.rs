//! What a commissioning looks at before anybody goes to the robot: rig, size and fields. For the command and for the page.

use std::time::SystemTime;

use nearfield_commissioning::{Check, PIECE_MM, Protocol, Section};
use nearfield_configuration::budget::{HostTimes, ResponseTime, permitted_speed, stopping_distance};
use nearfield_configuration::{Configuration, LinkKind, Source as SourceKind};
use nearfield_fields::Fields;
use nearfield_operator::commission::Plan;
use nearfield_shared::rig::Rig;

use super::outlets::distance_of;
use super::rig;
use crate::capability::Capability;

/// The protocol before the trials; `text` is the configuration's.
#[must_use]
pub fn protocol(
    configuration: &Configuration,
    text: &str,
    rig: &Rig,
    capability: &Capability,
    piece_mm: f64,
) -> Protocol {
    Protocol {
        module: configuration.module.name.clone(),
        version: format!("nearfield {}", env!("CARGO_PKG_VERSION")),
        made: now(),
        person: String::new(),
        equipment: equipment(configuration),
        on_hardware: is_on_hardware(configuration),
        calibration: format!("{:08x}, {}", rig.calibration_id().get(), rig::name(configuration)),
        sections: vec![
            Section { title: "Rig".to_owned(), checks: rig_checks(rig, capability, piece_mm) },
            Section { title: "Size and fields".to_owned(), checks: field_checks(configuration, rig) },
        ],
        configuration: text.to_owned(),
    }
}

/// For the page.
#[must_use]
pub fn plan(configuration: &Configuration, text: &str, rig: &Rig, capability: &Capability) -> Plan {
    let stripe = rig.stripe();
    Plan {
        protocol: protocol(configuration, text, rig, capability, PIECE_MM),
        stripe_mm: [stripe.start, stripe.end],
        piece_mm: PIECE_MM,
        worst_ms: ResponseTime::of(configuration, &HostTimes::ASSUMED).by_vote().1,
        calibration: rig.calibration_id(),
        now,
        hands: None,
    }
}

fn now() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}

/// Are there a real camera and a real controller?
#[must_use]
pub fn is_on_hardware(configuration: &Configuration) -> bool {
    let camera = matches!(
        configuration.camera.source,
        SourceKind::RpicamVid | SourceKind::Libcamera | SourceKind::Command
    );
    camera && configuration.link.kind == LinkKind::Spi
}

/// Which camera and controller.
#[must_use]
pub fn equipment(configuration: &Configuration) -> String {
    let camera = configuration.camera.source.name();
    let controller = match configuration.link.kind {
        LinkKind::InProcess => "simulated, in process".to_owned(),
        LinkKind::Emulated => "firmware in an emulator".to_owned(),
        LinkKind::Spi => format!("board on {}", configuration.link.device.display()),
    };
    format!("pictures: {camera}; controller: {controller}")
}

/// What the rig sees, as it was measured in `capability`.
#[must_use]
pub fn rig_checks(rig: &Rig, capability: &Capability, piece_mm: f64) -> Vec<Check> {
    let blind = capability.places.iter().find(|place| place.smallest_width_mm.is_none());
    let widest = capability
        .places
        .iter()
        .filter_map(|place| Some((place.smallest_width_mm?, place.place_mm)))
        .max_by(|one, other| one.0.total_cmp(&other.0));
    let found = match (blind, widest) {
        (Some(blind), _) => format!("nothing is surely seen at {:.0} mm", blind.place_mm),
        (None, Some((width, place))) => format!("at worst {width:.1} mm, at {place:.0} mm"),
        (None, None) => "no places".to_owned(),
    };
    let passed = blind.is_none() && widest.is_some_and(|(width, _)| width <= piece_mm);
    let stripe = rig.stripe();
    vec![
        Check::new(
            "Smallest thing that is surely seen",
            format!("{piece_mm} mm, everywhere from {:.0} to {:.0} mm", stripe.start, stripe.end),
            found,
            passed,
        ),
        Check::new(
            "Clean floor",
            "does not trip by itself",
            if capability.floor_trips { "trips" } else { "does not" },
            !capability.floor_trips,
        ),
    ]
}

/// Stopping distance, speed and zones.
#[must_use]
pub fn field_checks(configuration: &Configuration, rig: &Rig) -> Vec<Check> {
    let worst = ResponseTime::of(configuration, &HostTimes::ASSUMED).by_vote().1;
    let robot = &configuration.robot;
    let distance = robot.distance_mm.unwrap_or_else(|| distance_of(rig));
    let needed = stopping_distance(robot, robot.speed_mm_s, worst);
    let permitted = permitted_speed(robot, distance, worst);
    let zones = Fields::check(configuration, rig.stripe());
    vec![
        Check::new(
            "Stopping distance",
            format!("at most {distance:.0} mm, the stripe's distance"),
            format!("{needed:.0} mm, with a response time of {worst:.0} ms"),
            needed <= distance,
        ),
        Check::new(
            "Speed",
            format!("at most {permitted:.0} mm/s"),
            format!("{:.0} mm/s", robot.speed_mm_s),
            robot.speed_mm_s <= permitted,
        ),
        Check::new(
            "Zones",
            "within the watched stripe",
            zones.as_ref().map_or_else(ToString::to_string, |()| {
                format!("{} zones, all within", configuration.zones.len())
            }),
            zones.is_ok(),
        ),
    ]
}
