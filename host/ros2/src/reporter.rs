//! From what happens in a running host to the messages that tell it. Time comes in as an argument.

use nearfield_fields::{FIELD_CAUSES, Finding, Report, Role};
use nearfield_recording::messages::action_name;
use nearfield_recording::{Decision, Event};
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::condition::{StateCode, Warnings};
use nearfield_shared::linescan::{LINE_SCAN_LENGTH, LineScan};
use nearfield_shared::rig::Rig;
use nearfield_shared::status::Status;

use crate::floor::FloorError;
use crate::messages::{
    DiagnosticArray, DiagnosticStatus, Header, KeyValue, LaserScan, ModuleStatus, PointCloud2, Time,
};
use crate::observer::Observer;

/// What a reporter is told once.
#[derive(Debug, Clone, PartialEq)]
pub struct About {
    /// The module's name.
    pub module: String,
    /// Frame of reference of all messages: see [`crate::floor`].
    pub frame_id: String,
    /// From picture to picture, seconds.
    pub scan_time: f32,
    /// May heights be told?
    pub tells_heights: bool,
}

/// Messages about one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// The stripe.
    pub scan: LaserScan,
    /// Its heights; `None` = they are not told.
    pub cloud: Option<PointCloud2>,
    /// The controller's status.
    pub status: ModuleStatus,
}

/// See the module's documentation.
pub struct Reporter {
    about: About,
    observer: Observer,
    /// A line-scan that came since the last decision.
    fresh: Option<Box<[u8; LINE_SCAN_LENGTH]>>,
    status: Option<Status>,
    relay_closed: Option<bool>,
    fields: Report,
    advice: &'static str,
}

impl Reporter {
    /// For a rig.
    ///
    /// # Errors
    /// The rig has no scan: see [`FloorError`].
    pub fn new(rig: &Rig, about: About) -> Result<Self, FloorError> {
        let observer = Observer::new(rig, about.scan_time)?;
        Ok(Self {
            about,
            observer,
            fresh: None,
            status: None,
            relay_closed: None,
            fields: Report::NOTHING_SEEN,
            advice: "",
        })
    }

    /// Takes an event; a decision is to be told, and is given back.
    pub fn take(&mut self, event: &Event) -> Option<Decision> {
        match event {
            Event::Exchange { line_scan, status, .. } => {
                self.status = Status::parse(status).ok();
                if let Some(bytes) = line_scan {
                    self.fresh = Some(Box::new(*bytes));
                }
                None
            }
            Event::Decision(decision) => {
                let scan = self.fresh.take();
                match scan.as_ref().and_then(|bytes| LineScan::parse(&bytes[..]).ok()) {
                    Some(scan) => self.observer.see(&scan),
                    None => self.observer.miss(),
                }
                self.relay_closed = Some(decision.relay_closed);
                self.fields = decision.fields;
                self.advice = decision.advice.map_or("", action_name);
                Some(*decision)
            }
            _ => None,
        }
    }

    /// Nothing was heard for so long that nothing is known any more.
    pub fn forget(&mut self) {
        self.observer.forget();
        (self.status, self.relay_closed, self.fresh) = (None, None, None);
        (self.fields, self.advice) = (Report::NOTHING_SEEN, "stop_and_warn");
    }

    /// The messages about the newest picture.
    #[must_use]
    pub fn round(&self, stamp: Time) -> Round {
        let header = Header { stamp, frame_id: self.about.frame_id.clone() };
        let cloud = self.about.tells_heights.then(|| self.observer.point_cloud(header.clone()));
        Round { scan: self.observer.laser_scan(header.clone()), cloud, status: self.module_status(header) }
    }

    fn relay(&self) -> u8 {
        match (&self.status, self.relay_closed) {
            (Some(_), Some(true)) => ModuleStatus::CLOSED,
            (Some(_), Some(false)) => ModuleStatus::OPEN,
            _ => ModuleStatus::UNKNOWN,
        }
    }

    fn module_status(&self, header: Header) -> ModuleStatus {
        let names =
            |causes: StopCauses| causes.iter().map(|cause| cause.name().to_owned()).collect::<Vec<_>>();
        let status = self.status.as_ref();
        let metres = |millimetres: f32| millimetres / 1000.0;
        let height =
            |height: Option<f32>| height.filter(|_| self.about.tells_heights).map_or(f32::NAN, metres);
        let zones = |role: Role| {
            let infringed = self
                .fields
                .named()
                .filter(|(_, zone)| zone.role == role && zone.finding == Finding::Infringed);
            infringed.map(|(name, _)| name.to_string()).collect()
        };
        ModuleStatus {
            header,
            module: self.about.module.clone(),
            relay: self.relay(),
            state: status.map_or(String::new(), |status| status.state.name().to_owned()),
            live_causes: status.map_or_else(Vec::new, |status| names(status.live_causes)),
            latched_causes: status.map_or_else(Vec::new, |status| names(status.latched_causes)),
            warnings: status.map_or_else(Vec::new, |status| {
                warned(status.warnings).map(|(name, _)| name.to_owned()).collect()
            }),
            longest_gap: status
                .and_then(|status| status.longest_gap)
                .map_or(0.0, |gap| metres(gap.length().get())),
            highest: height(status.and_then(|status| status.highest).map(|highest| highest.height.get())),
            lowest: height(status.and_then(|status| status.lowest).map(|lowest| lowest.get())),
            permitted_speed_percent: status.map_or(0, |status| status.health.permitted_speed_percent),
            decision_age: status.map_or(f32::NAN, |status| status.decision_age.get() as f32 / 1e6),
            protective_zones: zones(Role::Protective),
            warning_zones: zones(Role::Warning),
            advice: self.advice.to_owned(),
        }
    }

    /// For `/diagnostics`.
    #[must_use]
    pub fn diagnostics(&self, stamp: Time) -> DiagnosticArray {
        let (level, message) = self.verdict();
        let mut values = Vec::new();
        let mut value = |key: &str, value: String| values.push(KeyValue { key: key.to_owned(), value });
        if let Some(status) = &self.status {
            value("relay", if self.relay() == ModuleStatus::CLOSED { "closed" } else { "open" }.to_owned());
            value("state", status.state.name().to_owned());
            for cause in status.live_causes.iter() {
                value(cause.name(), cause.words().to_owned());
            }
            for (name, words) in warned(status.warnings) {
                value(name, words.to_owned());
            }
            value("decision_age_ms", format!("{:.1}", status.decision_age.get() as f64 / 1e3));
            value("response_bound_ms", format!("{:.1}", status.response_bound.get() as f64 / 1e3));
            value("permitted_speed_percent", status.health.permitted_speed_percent.to_string());
            value("smallest_object_mm", format!("{:.1}", status.health.smallest_object.get()));
            value("floor_offset_mm", format!("{:.2}", status.health.floor_offset.get()));
            value("line_scans_accepted", status.accepted.to_string());
            value(
                "line_scans_refused",
                status.refused.iter().map(|count| u64::from(*count)).sum::<u64>().to_string(),
            );
            value("firmware", format!("{:08x}", status.firmware));
        }
        let hardware_id = self
            .status
            .map_or_else(String::new, |status| format!("nearfield source {}", status.source.get()));
        DiagnosticArray {
            header: Header { stamp, frame_id: String::new() },
            status: vec![DiagnosticStatus {
                level,
                name: format!("nearfield: {}", self.about.module),
                message: message.to_owned(),
                hardware_id,
                values,
            }],
        }
    }

    /// Level and words of the diagnosis. Something in the field, or a button that waits to be pressed, is no fault of the sensor.
    #[must_use]
    pub fn verdict(&self) -> (u8, &'static str) {
        let Some(status) = &self.status else {
            return (DiagnosticStatus::STALE, "the safety controller is not heard");
        };
        if status.state == StateCode::Lockout {
            return (DiagnosticStatus::ERROR, "the safety controller has locked itself; service is needed");
        }
        let normal = |cause: &StopCause| FIELD_CAUSES.contains(cause) || *cause == StopCause::Interlock;
        if let Some(fault) = status.live_causes.iter().find(|cause| !normal(cause)) {
            return (DiagnosticStatus::ERROR, fault.words());
        }
        if let Some(cause) = status.live_causes.iter().next() {
            return (DiagnosticStatus::WARN, cause.words());
        }
        if self.relay() != ModuleStatus::CLOSED {
            return (DiagnosticStatus::WARN, "the relays are open");
        }
        match warned(status.warnings).next() {
            Some((_, words)) => (DiagnosticStatus::WARN, words),
            None => (DiagnosticStatus::OK, "the stripe is whole"),
        }
    }
}

fn warned(warnings: Warnings) -> impl Iterator<Item = (&'static str, &'static str)> {
    Warnings::NAMED
        .iter()
        .filter(move |(warning, ..)| warnings.has_any(*warning))
        .map(|(_, name, words)| (*name, *words))
}
