//! For this module's tests: the firmware's black box, service and store behind a link, fed with scans of a small rig.

use embassy_futures::block_on;
use nearfield_firmware::black_box::BlackBox;
use nearfield_firmware::fault_log::{FaultLog, Occurrence};
use nearfield_firmware::service::{FlashJob, Permissions, Records, Service};
use nearfield_firmware::store::Store;
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::columns::Decimation;
use nearfield_shared::condition::{ResetCause, StateCode};
use nearfield_shared::laser::Laser;
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::linescan::{
    HostVerdict, LINE_SCAN_LENGTH, LineScan, LineScanColumn, LineScanHeader, encode,
};
use nearfield_shared::monitor::StripeMonitor;
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use nearfield_shared::run_over::NO_CLAIMS;
use nearfield_shared::service::{ExchangeKind, FaultEvent, PAGE_OFFSET, Request, Summary};
use nearfield_shared::units::{Micros, SequenceNumber, SignalQuality, SourceId, SubpixelRow};

use super::client::{ServiceClient, ServiceLink, Transaction};
use super::recording::Recording;
use super::simulated_flash::SimulatedFlash;

pub(super) const SOURCE: SourceId = SourceId::new(1);
/// When the test's stop happens.
pub(super) const STOP_TIME: Micros = Micros::from_millis(5_000);
const FRAME: Micros = Micros::from_millis(20);

/// A camera over a laser at the robot's edge; stripe from -350 to 350 mm, about 1.1 mm a column.
pub(super) fn rig() -> Rig {
    let pitch = 50.0_f64.to_radians();
    let forward = Vector::new(0.0, pitch.cos(), -pitch.sin());
    let right = Vector::new(1.0, 0.0, 0.0);
    let rotation = [right, forward.cross(right), forward];
    let position = Vector::new(0.0, 0.0, 400.0);
    let translation = Pose { rotation, translation: Vector::default() }.to_camera(position).scaled(-1.0);
    let intrinsics = Intrinsics { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, distortion: [0.0; 5] };
    let origin = Vector::new(0.0, 0.0, 200.0);
    let (point, direction) = (Vector::new(0.0, 500.0, 0.0), Vector::new(1.0, 0.0, 0.0));
    let normal = direction.cross(origin.minus(point));
    let normal = normal.scaled(1.0 / normal.dot(normal).sqrt());
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    let laser = Laser { origin, normal, offset: normal.dot(origin) };
    let stripe = Stripe { point, direction, start: -350.0, end: 350.0 };
    Rig::new(ImageSize { width: 640, height: 480 }, camera, laser, stripe).unwrap()
}

/// A rig that differs from [`rig`] by its picture's height.
pub(super) fn other_rig() -> Rig {
    let rig = rig();
    let image = ImageSize { height: 481, ..rig.image() };
    Rig::new(image, *rig.camera(), *rig.laser(), *rig.stripe()).unwrap()
}

/// Height over the floor at each place of the stripe; `None` = no stripe.
pub(super) type Profile = fn(f32) -> Option<f32>;

pub(super) const CLEAN: Profile = |_| Some(0.0);
pub(super) const BOX: Profile = |s| Some(if (100.0..160.0).contains(&s) { 30.0 } else { 0.0 });
pub(super) const WIRE: Profile = |s| Some(if (-4.0..3.5).contains(&s) { 6.0 } else { 0.0 });

/// One exchange of a test.
#[derive(Clone, Copy)]
pub(super) struct Step {
    pub(super) profile: Profile,
    pub(super) verdict: HostVerdict,
    pub(super) kind: ExchangeKind,
}

impl Step {
    pub(super) const fn accepted(profile: Profile) -> Self {
        Self { profile, verdict: HostVerdict::Clear, kind: ExchangeKind::Accepted }
    }
}

/// A controller's records behind a link, without the controller.
pub(super) struct Desk {
    pub(super) service: Service,
    pub(super) black_box: BlackBox,
    pub(super) fault_log: FaultLog,
    pub(super) store: Store<SimulatedFlash>,
    pub(super) permissions: Permissions,
    /// Transactions that the flash still needs for the job at hand.
    pub(super) working: u32,
    job: Option<FlashJob>,
    monitor: Box<StripeMonitor<LARGEST_COLUMN_COUNT>>,
    sequence: SequenceNumber,
    /// Called before every transaction.
    pub(super) disturb: fn(&mut Desk, u32),
    pub(super) transactions: u32,
}

/// The test link never breaks.
#[derive(Debug, thiserror::Error)]
#[error("cannot happen")]
pub(super) struct NeverBreaks;

impl Desk {
    pub(super) fn new() -> Self {
        let mut store = Store::new(SimulatedFlash::new(), 0);
        let rig = rig();
        block_on(store.stage_rig(&rig.to_bytes())).unwrap();
        block_on(store.acknowledge_rig(rig.calibration_id())).unwrap();
        let mut monitor = Box::new(StripeMonitor::new());
        monitor.configure(&rig, Decimation::for_line_scan(640)).unwrap();
        let mut fault_log = FaultLog::new();
        fault_log.started(ResetCause::PowerOn, StopCauses::NONE);
        Self {
            service: Service::new(SOURCE),
            black_box: BlackBox::new(),
            fault_log,
            store,
            permissions: Permissions {
                service_key: true,
                relays_proven_open: true,
                state: StateCode::Stopped,
            },
            working: 0,
            job: None,
            monitor,
            sequence: SequenceNumber::new(99),
            disturb: |_, _| (),
            transactions: 0,
        }
    }

    /// Plays exchanges, the last of them at [`STOP_TIME`], and then stops with these causes.
    pub(super) fn play(&mut self, steps: &[Step], causes: StopCauses) {
        self.black_box.armed();
        self.exchanges(steps, true);
        self.black_box.stop(STOP_TIME, causes, Some(rig().calibration_id()));
        self.fault_log.record(&Occurrence {
            event: FaultEvent::Stopped,
            time: STOP_TIME,
            status: 250,
            causes,
            state: StateCode::Stopped,
            reset_cause: ResetCause::PowerOn,
            fault: 0,
            detail: 0,
        });
    }

    /// As the controller does: line-scan, judgement, summary.
    fn exchanges(&mut self, steps: &[Step], until_stop: bool) {
        for (number, step) in steps.iter().enumerate() {
            self.sequence = self.sequence.next();
            let bytes = line_scan(&self.monitor, self.sequence, step);
            if step.kind == ExchangeKind::AcceptedAfterSilence {
                self.monitor.reset();
            }
            let left = if until_stop { steps.len() - 1 - number } else { 0 };
            let time = Micros::new(STOP_TIME.get() - FRAME.get() * left as u64);
            let mut summary = Summary::new(time, StateCode::Running, step.kind);
            summary.sequence = self.sequence;
            if matches!(step.kind, ExchangeKind::Accepted | ExchangeKind::AcceptedAfterSilence) {
                self.black_box.line_scan(&bytes);
                let scan = LineScan::parse(&bytes[..]).unwrap();
                summary = summary.with_report(&self.monitor.update(scan.readings()));
            }
            self.black_box.record(&summary);
        }
    }

    pub(super) fn client(&mut self) -> ServiceClient<'_, Self> {
        ServiceClient::new(self, SOURCE, 1000)
    }

    pub(super) fn recording(&mut self) -> Recording {
        self.client().fetch(|_, _| ()).unwrap().unwrap()
    }
}

fn line_scan(
    monitor: &StripeMonitor<LARGEST_COLUMN_COUNT>,
    sequence: SequenceNumber,
    step: &Step,
) -> Box<Transaction> {
    let header = LineScanHeader {
        source: SOURCE,
        calibration: rig().calibration_id(),
        sequence,
        capture_age: Micros::from_millis(20),
        exposure: Micros::from_millis(4),
        last_status: 0,
        verdict: step.verdict,
        ambient: 0,
        saturated: 0,
        claims: NO_CLAIMS,
    };
    let columns: Vec<_> = (0..640)
        .map(|column| {
            let map = monitor.geometry().map(column)?;
            let row = SubpixelRow::from_pixels(map.row((step.profile)(map.floor_place)?))?;
            Some(LineScanColumn { row, quality: SignalQuality::BEST })
        })
        .map(|column| column.unwrap_or(LineScanColumn::MISSING))
        .collect();
    let mut bytes = Box::new([0; LINE_SCAN_LENGTH]);
    encode(&mut bytes, &header, &columns, &BrightnessProfile::DARK, &[]).unwrap();
    bytes
}

impl ServiceLink for Desk {
    type Error = NeverBreaks;

    fn transact(&mut self, message: Option<&Transaction>) -> Result<Box<Transaction>, NeverBreaks> {
        self.transactions += 1;
        (self.disturb)(self, self.transactions);
        let mut reply = Box::new([0; LINE_SCAN_LENGTH]);
        for (byte, page) in reply[PAGE_OFFSET..].iter_mut().zip(self.service.page()) {
            *byte = *page;
        }
        if let Some(request) = message.and_then(|message| Request::parse(message)) {
            let records = Records { black_box: &self.black_box, fault_log: &self.fault_log };
            let job = self.service.answer(&request, &self.permissions, &records);
            self.job = job.or(self.job);
        }
        if self.working > 0 {
            self.working -= 1;
        } else if let Some(job) = self.job.take() {
            let outcome = block_on(self.store.run(&job));
            self.service.finish(&outcome);
        }
        Ok(reply)
    }
}

/// Steps that end with this one three times.
pub(super) fn ending_with(profile: Profile, times: usize) -> Vec<Step> {
    let mut steps = vec![Step::accepted(CLEAN); 5];
    steps.extend(vec![Step::accepted(profile); times]);
    steps
}

/// A recording of these exchanges and causes, fetched over the link, without anything after the stop.
pub(super) fn recording_of(steps: &[Step], causes: StopCauses) -> Recording {
    let mut desk = Desk::new();
    desk.play(steps, causes);
    desk.recording()
}

/// A box of 60 mm comes onto the stripe between one frame and the next; one more frame follows the stop.
pub(super) fn recording_of_a_box() -> Recording {
    let mut desk = Desk::new();
    desk.play(&ending_with(BOX, 1), StopCauses::NONE.with(StopCause::StripeCut));
    desk.exchanges(&[Step::accepted(BOX)], false);
    desk.recording()
}
