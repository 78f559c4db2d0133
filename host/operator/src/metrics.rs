//! Prometheus' text format, version 0.0.4.

use std::fmt::Write as _;

use nearfield_shared::causes::StopCause;

use crate::view::Status;

/// Upper ends of the latency's buckets, milliseconds.
const BUCKETS: [f64; 11] = [0.5, 1.0, 2.0, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0, 50.0, 100.0];

/// How long pictures took, since the program began.
#[derive(Debug, Clone, Default)]
pub struct Histogram {
    counts: [u64; BUCKETS.len()],
    count: u64,
    sum_ms: f64,
}

impl Histogram {
    /// One more.
    pub fn add(&mut self, milliseconds: f64) {
        for (count, bucket) in self.counts.iter_mut().zip(BUCKETS) {
            *count += u64::from(milliseconds <= bucket);
        }
        self.count += 1;
        self.sum_ms += milliseconds;
    }
}

/// Everything that is measured.
pub struct Metrics<'a> {
    /// The short state.
    pub status: &'a Status,
    /// Latency.
    pub histogram: &'a Histogram,
    /// Stops by cause.
    pub stops: &'a [u64; StopCause::ALL.len()],
    /// Events that the page's queue had no room for.
    pub missed: u64,
}

/// Text under construction. Label values are names of this program or escaped.
struct Text(String);

impl Text {
    fn head(&mut self, name: &str, kind: &str, help: &str) {
        // Writing into a String cannot fail.
        let _ = write!(self.0, "# HELP nearfield_{name} {help}\n# TYPE nearfield_{name} {kind}\n");
    }

    fn sample(&mut self, name: &str, labels: &str, value: f64) {
        let _ = writeln!(self.0, "nearfield_{name}{labels} {value}");
    }

    fn one(&mut self, name: &str, kind: &str, help: &str, value: f64) {
        self.head(name, kind, help);
        self.sample(name, "", value);
    }
}

fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

impl Metrics<'_> {
    /// The whole text.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = Text(String::with_capacity(8192));
        text.head("build_info", "gauge", "Which program this is; always 1.");
        let module = escaped(&self.status.module);
        let labels = format!("{{module=\"{module}\",version=\"{}\"}}", env!("CARGO_PKG_VERSION"));
        text.sample("build_info", &labels, 1.0);
        self.relays(&mut text);
        self.counts(&mut text);
        self.fields(&mut text);
        self.measured(&mut text);
        self.latency(&mut text);
        text.0
    }

    fn relays(&self, text: &mut Text) {
        let closed = f64::from(u8::from(self.status.relay == "closed"));
        text.one("relay_closed", "gauge", "1 = both relay contacts are closed: the robot may move.", closed);
        text.head(
            "controller_state",
            "gauge",
            "1 for the safety controller's state; none = it is not heard.",
        );
        if !self.status.state.is_empty() {
            text.sample("controller_state", &format!("{{state=\"{}\"}}", self.status.state), 1.0);
        }
        text.head("cause_live", "gauge", "1 = this cause to stop holds now.");
        for cause in StopCause::ALL {
            let holds = self.status.live.iter().any(|live| live.name == cause.name());
            let labels = format!("{{cause=\"{}\"}}", cause.name());
            text.sample("cause_live", &labels, f64::from(u8::from(holds)));
        }
        text.head("stops_by_cause_total", "counter", "Stops with this cause; one stop may have several.");
        for (cause, count) in StopCause::ALL.iter().zip(self.stops) {
            text.sample("stops_by_cause_total", &format!("{{cause=\"{}\"}}", cause.name()), *count as f64);
        }
    }

    fn fields(&self, text: &mut Text) {
        text.head(
            "zone_infringed",
            "gauge",
            "1 = a cut, or something ahead, is in this zone; 0.5 = suspect.",
        );
        for zone in &self.status.zones {
            let labels = format!("{{zone=\"{}\",field=\"{}\"}}", zone.name, zone.role);
            let value = match zone.finding {
                "free" => 0.0,
                "suspect" => 0.5,
                _ => 1.0,
            };
            text.sample("zone_infringed", &labels, value);
        }
        let case = f64::from(self.status.case.unwrap_or(0));
        text.one("case", "gauge", "The case in force, from 1; 0 = there are none, or all are.", case);
        text.head("robot_speed_millimetres_per_second", "gauge", "As the robot tells it; none = not known.");
        if let Some(speed) = self.status.speed_mm_s {
            text.sample("robot_speed_millimetres_per_second", "", f64::from(speed));
        }
    }

    fn counts(&self, text: &mut Text) {
        let counts = &self.status.counts;
        let recording = &self.status.recording;
        for (name, help, count) in [
            ("stops_total", "Times that the relays opened.", counts.stops),
            ("pictures_total", "Pictures asked for.", counts.pictures),
            (
                "pictures_missing_total",
                "Pictures that did not come in time, or could not be used.",
                counts.missing,
            ),
            ("line_scans_lost_total", "Line-scans that the controller did not take.", counts.lost),
            ("source_restarts_total", "Times that the source of pictures was opened again.", counts.restarts),
            (
                "line_scans_accepted_total",
                "Line-scans accepted since the controller's start.",
                counts.accepted.into(),
            ),
            (
                "line_scans_refused_total",
                "Line-scans refused since the controller's start.",
                counts.refused.into(),
            ),
            ("recorded_bytes_total", "Bytes of messages recorded.", recording.written),
            (
                "recording_dropped_events_total",
                "Events that the recorder's queue had no room for.",
                recording.dropped,
            ),
            ("page_dropped_events_total", "Events that the page's queue had no room for.", self.missed),
        ] {
            text.one(name, "counter", help, count as f64);
        }
        let recorded = recording.wanted && recording.problem.is_none();
        text.one("recording", "gauge", "1 = it is being recorded.", f64::from(u8::from(recorded)));
    }

    fn measured(&self, text: &mut Text) {
        let status = self.status;
        let highest = f64::from(status.highest_mm.unwrap_or(0.0));
        let [age, longest, bound] = status.decision_age_ms;
        for (name, help, value) in [
            ("uptime_seconds", "Since the program began.", status.uptime_s),
            (
                "longest_gap_millimetres",
                "Longest gap in the stripe; 0 = whole.",
                f64::from(status.longest_gap_mm),
            ),
            ("highest_point_millimetres", "Highest point over the floor; 0 = nothing raised.", highest),
            (
                "permitted_speed_ratio",
                "Permitted speed, 0 to 1.",
                f64::from(status.permitted_speed_percent) / 100.0,
            ),
            ("decision_age_seconds", "From the exposure to the decision, last picture.", age / 1e3),
            ("longest_decision_age_seconds", "The longest since the controller's start.", longest / 1e3),
            ("decision_age_bound_seconds", "The bound that it must keep.", bound / 1e3),
        ] {
            text.one(name, "gauge", help, value);
        }
    }

    fn latency(&self, text: &mut Text) {
        const NAME: &str = "host_latency_seconds";
        text.head(NAME, "histogram", "From the picture in memory to the status received.");
        let bucket = format!("{NAME}_bucket");
        for (end, count) in BUCKETS.iter().zip(self.histogram.counts) {
            text.sample(&bucket, &format!("{{le=\"{}\"}}", end / 1e3), count as f64);
        }
        text.sample(&bucket, "{le=\"+Inf\"}", self.histogram.count as f64);
        text.sample(&format!("{NAME}_sum"), "", self.histogram.sum_ms / 1e3);
        text.sample(&format!("{NAME}_count"), "", self.histogram.count as f64);
    }
}
