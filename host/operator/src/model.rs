//! From events to what is shown: the model's thread.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nearfield_fields::Report;
use nearfield_recording::messages::{action_name, nanoseconds};
use nearfield_recording::recorder::Watch;
use nearfield_recording::{Decision, Detections, Event, Picture, Stamped};
use nearfield_shared::action::Action;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::columns::{Decimation, GeometryError, StripeGeometry};
use nearfield_shared::limits::{FLOOR_TOLERANCE, LARGEST_COLUMN_COUNT};
use nearfield_shared::linescan::LineScan;
use nearfield_shared::rig::Rig;
use nearfield_shared::status::{Status, Warnings};
use nearfield_shared::units::Micros;

use crate::board::{Board, Published};
use crate::commission::{Desk, Order, Plan};
use crate::metrics::{Histogram, Metrics};
use crate::tally::Tally;
use crate::view::{
    Counts, Latency, Live, Named, Object, PictureView, Profile, Recording, Status as StatusView, Stop,
    ZoneNow,
};

/// What the page shows as "nothing heard" when the newest status is older.
const STALE: Duration = Duration::from_secs(1);
const KEPT_LATENCIES: usize = 1000;
const KEPT_STOPS: usize = 50;
/// Points of the profile at most: a phone's screen has no more.
const PROFILE_POINTS: usize = 384;

/// See the module's documentation.
pub struct Model {
    module: String,
    begun: u64,
    geometry: Box<StripeGeometry<LARGEST_COLUMN_COUNT>>,
    decimation: Decimation,
    tally: Arc<Tally>,
    recording: Option<Watch>,
    now: Micros,
    status: Option<(Instant, Status)>,
    relay_closed: Option<bool>,
    fields: Report,
    advice: Option<Action>,
    tells_heights: bool,
    profile: Profile,
    scan: Vec<Option<f32>>,
    latencies: VecDeque<f64>,
    histogram: Histogram,
    stops: VecDeque<Stop>,
    stop_count: u64,
    stops_by_cause: [u64; StopCause::ALL.len()],
    picture: Option<Arc<Picture>>,
    picture_number: u64,
    detections: Option<Arc<Detections>>,
    missed: u64,
    desk: Option<Desk>,
    /// Did a line-scan come since the last decision?
    is_fresh: bool,
}

impl Model {
    /// For a rig; `begun` is when the host's clock stood at 0, nanoseconds since 1970.
    ///
    /// # Errors
    /// The rig's picture does not resolve the stripe.
    pub fn new(
        module: &str,
        begun: u64,
        rig: &Rig,
        tally: Arc<Tally>,
        recording: Option<Watch>,
    ) -> Result<Self, GeometryError> {
        let decimation = Decimation::for_line_scan(rig.image().width);
        let mut geometry = Box::new(StripeGeometry::empty());
        geometry.fill(rig, decimation)?;
        Ok(Self {
            module: module.to_owned(),
            begun,
            geometry,
            decimation,
            tally,
            recording,
            now: Micros::ZERO,
            status: None,
            relay_closed: None,
            fields: Report::default(),
            advice: None,
            tells_heights: true,
            profile: Profile::default(),
            scan: Vec::new(),
            latencies: VecDeque::with_capacity(KEPT_LATENCIES),
            histogram: Histogram::default(),
            stops: VecDeque::with_capacity(KEPT_STOPS),
            stop_count: 0,
            stops_by_cause: [0; StopCause::ALL.len()],
            picture: None,
            picture_number: 0,
            detections: None,
            missed: 0,
            desk: None,
            is_fresh: false,
        })
    }

    /// Profile "cutoff": where the stripe is cut is told, heights are not.
    #[must_use]
    pub fn without_heights(self) -> Self {
        Self { tells_heights: false, ..self }
    }

    /// With a commissioning that may be begun.
    #[must_use]
    pub fn with_commissioning(self, plan: Plan) -> Self {
        Self { desk: Some(Desk::new(plan)), ..self }
    }

    /// Obeys who knows the token.
    pub fn order(&mut self, order: Order) {
        let stored = self.fresh_status().and_then(|status| status.calibration);
        if let Some(desk) = &mut self.desk {
            desk.order(order, stored);
        }
    }

    /// Events that the queue had no room for so far.
    pub const fn missed(&mut self, count: u64) {
        self.missed = count;
    }

    /// Takes an event.
    pub fn take(&mut self, stamped: Stamped) {
        self.now = stamped.at;
        match stamped.event {
            Event::Exchange { line_scan, status, .. } => {
                if let Ok(status) = Status::parse(&status) {
                    self.status = Some((Instant::now(), status));
                }
                if let Some(bytes) = line_scan
                    && let Ok(scan) = LineScan::parse(&bytes)
                {
                    self.scan.clear();
                    self.scan.extend(scan.columns().map(|column| column.row.to_pixels()));
                    self.is_fresh = true;
                }
            }
            Event::Decision(decision) => self.decision(&decision),
            Event::Picture(picture) => {
                self.picture = Some(picture);
                self.picture_number += 1;
            }
            Event::Detections(detections) => self.detections = Some(detections),
            Event::PowerUp { .. } | Event::Tick(_) | Event::Mark(_) | Event::Warning(_) => {}
        }
    }

    fn decision(&mut self, decision: &Decision) {
        let rows = std::mem::take(&mut self.is_fresh).then_some(&self.scan[..]);
        if let Some(desk) = &mut self.desk {
            desk.watch(decision, self.now, &self.geometry, rows);
        }
        let latency = decision.latency.as_secs_f64() * 1e3;
        self.histogram.add(latency);
        if self.latencies.len() == KEPT_LATENCIES {
            self.latencies.pop_front();
        }
        self.latencies.push_back(latency);
        if self.relay_closed == Some(true) && !decision.relay_closed {
            self.stop();
        }
        self.relay_closed = Some(decision.relay_closed);
        (self.fields, self.advice) = (decision.fields, decision.advice);
    }

    fn stop(&mut self) {
        self.stop_count += 1;
        let status = self.status.map(|(_, status)| status);
        let causes =
            status.map_or(StopCauses::NONE, |status| status.live_causes.union(status.latched_causes));
        let causes = causes.without(StopCause::Interlock);
        for (count, cause) in self.stops_by_cause.iter_mut().zip(StopCause::ALL) {
            *count += u64::from(causes.contains(cause));
        }
        if self.stops.len() == KEPT_STOPS {
            self.stops.pop_back();
        }
        self.stops.push_front(Stop {
            number: self.stop_count,
            unix_ms: nanoseconds(self.begun, self.now) / 1_000_000,
            causes: named(causes),
            longest_gap_mm: status
                .and_then(|status| status.longest_gap)
                .map_or(0.0, |gap| gap.length().get()),
            highest_mm: self.highest(status.as_ref()),
            recording: self.recording.as_ref().map(|watch| watch.state().file).unwrap_or_default(),
        });
    }

    /// Writes everything down and publishes it.
    pub fn publish(&mut self, board: &Board) {
        self.thin_out();
        let live = Live {
            status: self.status_view(),
            profile: self.profile.clone(),
            picture: self.picture_view(),
            tier_three: self.detections.as_ref().map(|detections| detections.seen.is_ok()),
            objects: self.objects(),
            stops: self.stops.iter().cloned().collect(),
        };
        let bytes = |value: Result<Vec<u8>, serde_json::Error>| value.unwrap_or_default();
        let metrics = Metrics {
            status: &live.status,
            histogram: &self.histogram,
            stops: &self.stops_by_cause,
            missed: self.missed,
        };
        let view = self.desk.as_ref().map(|desk| bytes(serde_json::to_vec(&desk.view())));
        let protocol = self.desk.as_ref().and_then(Desk::protocol);
        board.publish(Published {
            commission: view.unwrap_or_default(),
            protocol: protocol.map(|protocol| protocol.html().into_bytes()).unwrap_or_default(),
            status: bytes(serde_json::to_vec(&live.status)),
            vda5050: bytes(serde_json::to_vec(&crate::vda5050::payload(&live.status))),
            metrics: metrics.text().into_bytes(),
            live: bytes(serde_json::to_vec(&live)),
            picture: self.picture.clone(),
        });
    }

    /// The newest status, unless it is too old to be shown as one.
    fn fresh_status(&self) -> Option<&Status> {
        self.status.as_ref().filter(|(heard, _)| heard.elapsed() < STALE).map(|(_, status)| status)
    }

    fn status_view(&self) -> StatusView {
        let status = self.fresh_status();
        let relay = match (status, self.relay_closed) {
            (Some(_), Some(true)) => "closed",
            (Some(_), Some(false)) => "open",
            _ => "unknown",
        };
        let warnings = status.map_or(Warnings::NONE, |status| status.warnings);
        let millis = |age: Micros| age.get() as f64 / 1000.0;
        StatusView {
            module: self.module.clone(),
            uptime_s: self.now.get() as f64 / 1e6,
            relay,
            state: status.map_or("", |status| status.state.name()),
            live: status.map_or_else(Vec::new, |status| named(status.live_causes)),
            latched: status.map_or_else(Vec::new, |status| named(status.latched_causes)),
            warnings: Warnings::NAMED
                .iter()
                .filter(|(warning, ..)| warnings.has_any(*warning))
                .map(|(_, name, words)| Named { name, words })
                .collect(),
            longest_gap_mm: status
                .and_then(|status| status.longest_gap)
                .map_or(0.0, |gap| gap.length().get()),
            highest_mm: self.highest(status),
            lowest_mm: status
                .filter(|_| self.tells_heights)
                .and_then(|status| status.lowest)
                .map(|lowest| lowest.get()),
            permitted_speed_percent: status.map_or(0, |status| status.health.permitted_speed_percent),
            speed_mm_s: self.fields.speed_mm_s,
            case: self.fields.case,
            zones: self.zones(),
            advice: self.advice.map(action_name),
            decision_age_ms: status.map_or([0.0; 3], |status| {
                [status.decision_age, status.longest_decision_age, status.response_bound].map(millis)
            }),
            latency: self.latency(),
            counts: self.counts(status),
            recording: self.recording_view(),
        }
    }

    fn highest(&self, status: Option<&Status>) -> Option<f32> {
        let highest = status.filter(|_| self.tells_heights)?.highest?;
        Some(highest.height.get())
    }

    fn zones(&self) -> Vec<ZoneNow> {
        let zone = |(name, zone): (char, nearfield_fields::ZoneState)| ZoneNow {
            name,
            role: zone.role.name(),
            finding: zone.finding.name(),
        };
        self.fields.named().map(zone).collect()
    }

    fn latency(&self) -> Latency {
        let mut sorted: Vec<f64> = self.latencies.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let index = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(index.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        Latency { p50_ms: at(0.5), p99_ms: at(0.99), longest_ms: at(1.0) }
    }

    fn counts(&self, status: Option<&Status>) -> Counts {
        let refused = status.map_or([0; 8], |status| status.refused);
        Counts {
            pictures: self.tally.pictures.get(),
            missing: self.tally.missing.get(),
            lost: self.tally.lost.get(),
            restarts: self.tally.restarts.get(),
            stops: self.stop_count,
            accepted: status.map_or(0, |status| status.accepted),
            refused: refused.iter().fold(0, |sum: u32, count| sum.saturating_add(*count)),
        }
    }

    fn recording_view(&self) -> Recording {
        let Some(watch) = &self.recording else { return Recording::default() };
        let state = watch.state();
        Recording {
            wanted: true,
            file: state.file,
            written: state.written,
            dropped: state.dropped,
            problem: state.problem,
        }
    }

    fn picture_view(&self) -> PictureView {
        let (width, height) = self.picture.as_ref().map_or((0, 0), |picture| picture.full_size);
        PictureView { number: self.picture_number, width, height }
    }

    fn objects(&self) -> Vec<Object> {
        let seen = self.detections.iter().flat_map(|detections| detections.seen.iter().flatten());
        seen.map(|one| Object {
            category: one.category.clone(),
            confidence: one.confidence,
            pixels: one.pixels,
        })
        .collect()
    }

    /// Of neighbouring columns the one that is farthest from the floor, or that shows nothing, stands for all of them:
    /// what is thin stays visible.
    fn thin_out(&mut self) {
        let mut profile = std::mem::take(&mut self.profile);
        for list in [&mut profile.place_mm, &mut profile.column] {
            list.clear();
        }
        profile.height_mm.clear();
        profile.row.clear();
        let watched = self.geometry.watched();
        let group = watched.len().div_ceil(PROFILE_POINTS).max(1);
        let columns: Vec<usize> = watched.collect();
        for group in columns.chunks(group) {
            let Some(column) = group
                .iter()
                .copied()
                .max_by(|one, other| self.departure(*one).total_cmp(&self.departure(*other)))
            else {
                continue;
            };
            let Some(map) = self.geometry.map(column) else { continue };
            let row = self.scan.get(column).copied().flatten();
            let centre = self.decimation.centre(u16::try_from(column).unwrap_or(u16::MAX));
            profile.place_mm.push(rounded(map.floor_place));
            profile.column.push(rounded(centre as f32));
            profile.row.push(row.map(rounded));
            let height = row.map(|row| rounded(map.height(row)));
            profile.height_mm.push(if self.tells_heights { height } else { height.and_then(as_cut) });
        }
        self.profile = profile;
    }

    fn departure(&self, column: usize) -> f32 {
        let row = self.scan.get(column).copied().flatten();
        match (row, self.geometry.map(column)) {
            (Some(row), Some(map)) => map.height(row).abs(),
            _ => f32::INFINITY,
        }
    }
}

/// Without heights: on the floor, or not.
fn as_cut(height: f32) -> Option<f32> {
    (height.abs() <= FLOOR_TOLERANCE.get()).then_some(0.0)
}

/// To a hundredth: enough for eyes, and short.
fn rounded(value: f32) -> f32 {
    (value * 100.0).round() / 100.0
}

fn named(causes: StopCauses) -> Vec<Named> {
    causes.iter().map(|cause| Named { name: cause.name(), words: cause.words() }).collect()
}

#[cfg(test)]
mod tests;
