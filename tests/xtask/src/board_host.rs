//! The Raspberry Pi's part for the register-level model of the board: an honest host on a small rig, line by line over
//! standard input and output. It encodes line-scans as the real one does and knows nothing of the board but its status.
//!
//! | request | answer |
//! |---|---|
//! | `rig` | the rig's compact form, in hex |
//! | `scan SEQUENCE AGE EXPOSURE LIGHT HEIGHT VERDICT STATUS` | what the status says (see below) and the line-scan, in hex |
//! | `status STATUS` | what the status says |
//! | `store NUMBER`, `candidate NUMBER`, `acknowledge NUMBER`, `faults NUMBER` | the service request, in hex |
//! | `page TRANSACTION` | `NUMBER RESULT DATA` of the page in it, or `-` |
//!
//! SEQUENCE = number of the line-scan; AGE and EXPOSURE in microseconds; LIGHT = the laser's brightness during the exposure, 0 to 255; HEIGHT = millimetres
//! over the floor everywhere, or `none` for a stripe that is not there; VERDICT = `clear` or `stop`; STATUS = the last
//! status received, in hex, or `-`.
//!
//! What a status says: `STATE FAILED_SELF_TEST FAULT LIVE LATCHED RESET_CAUSE NUMBER`, `-` for none, causes with commas.

use anyhow::{Context as _, Result, bail};
use nearfield_firmware::selftest::SelfTestKind;
use nearfield_shared::audit::first_row_for;
use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::laser::Laser;
use nearfield_shared::light::BrightnessProfile;
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::linescan::{
    AUDIT_PIXELS, AuditWindow, HostVerdict, LINE_SCAN_LENGTH, LineScanColumn, LineScanHeader, encode,
};
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use nearfield_shared::run_over::NO_CLAIMS;
use nearfield_shared::service::{Demand, Page, encode_request};
use nearfield_shared::status::{Challenge, FaultCode, STATUS_LENGTH, Status};
use nearfield_shared::units::{Micros, SequenceNumber, SignalQuality, SourceId, SubpixelRow};
use std::io::{BufRead as _, Write as _};

/// The module that the board's firmware is built as.
const SOURCE: SourceId = SourceId::new(1);

/// A small picture, so that the board's start does not take minutes on the model.
const IMAGE: ImageSize = ImageSize { width: 320, height: 240 };

/// Answers until standard input ends.
pub fn run() -> Result<()> {
    let host = Host::new()?;
    let (input, mut output) = (std::io::stdin().lock(), std::io::stdout().lock());
    for line in input.lines() {
        let line = line?;
        let answer = host.answer(&line).with_context(|| format!("request {:.80}", line))?;
        writeln!(output, "{answer}")?;
        output.flush()?;
    }
    Ok(())
}

struct Host {
    rig: Rig,
    geometry: Box<StripeGeometry<LARGEST_COLUMN_COUNT>>,
}

/// A camera over a laser at the robot's edge.
fn rig() -> Result<Rig> {
    let (sine, cosine) = 50.0_f64.to_radians().sin_cos();
    let rotation =
        [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, -sine, -cosine), Vector::new(0.0, cosine, -sine)];
    let unmoved = Pose { rotation, translation: Vector::default() };
    let translation = unmoved.to_camera(Vector::new(0.0, 0.0, 400.0)).scaled(-1.0);
    let intrinsics = Intrinsics { fx: 250.0, fy: 250.0, cx: 160.0, cy: 120.0, distortion: [0.0; 5] };
    let (origin, point) = (Vector::new(0.0, 0.0, 200.0), Vector::new(0.0, 500.0, 0.0));
    let direction = Vector::new(1.0, 0.0, 0.0);
    let across = direction.cross(origin.minus(point));
    let normal = across.scaled(1.0 / across.dot(across).sqrt());
    let camera = Camera { intrinsics, pose: Pose { rotation, translation } };
    let laser = Laser { origin, normal, offset: normal.dot(origin) };
    let stripe = Stripe { point, direction, start: -300.0, end: 300.0 };
    Rig::new(IMAGE, camera, laser, stripe).context("the host's rig")
}

impl Host {
    fn new() -> Result<Self> {
        let rig = rig()?;
        let mut geometry = Box::new(StripeGeometry::empty());
        geometry.fill(&rig, Decimation::for_line_scan(IMAGE.width)).context("the host's column maps")?;
        Ok(Self { rig, geometry })
    }

    fn answer(&self, line: &str) -> Result<String> {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["rig"] => Ok(hex(&self.rig.to_bytes())),
            ["status", status] => told(&parse(status)?.context("no status")?),
            ["store", number] => request(number, &Demand::StoreRig { rig: &self.rig.to_bytes() }),
            ["candidate", number] => request(number, &Demand::ReadCandidate),
            ["acknowledge", number] => {
                request(number, &Demand::AcknowledgeRig { calibration: self.rig.calibration_id() })
            }
            ["faults", number] => request(number, &Demand::ReadFaultLog { page: 0 }),
            ["page", transaction] => page(&bytes(transaction)?),
            ["scan", sequence, age, exposure, light, height, verdict, status] => {
                let status = parse(status)?;
                let facts = Picture {
                    sequence: SequenceNumber::new(sequence.parse()?),
                    age: Micros::new(age.parse()?),
                    exposure: Micros::new(exposure.parse()?),
                    light: light.parse()?,
                    height: if *height == "none" { None } else { Some(height.parse()?) },
                    verdict: match *verdict {
                        "clear" => HostVerdict::Clear,
                        "stop" => HostVerdict::Stop,
                        other => bail!("verdict {other:?}"),
                    },
                };
                let scan = hex(&self.scan(&facts, status.as_ref())?);
                let told = status.as_ref().map_or(Ok("- - - - - - 0".to_owned()), told)?;
                Ok(format!("{told} {scan}"))
            }
            _ => bail!("there is no such request"),
        }
    }

    /// The line-scan that an honest host makes of this picture.
    fn scan(&self, picture: &Picture, status: Option<&Status>) -> Result<[u8; LINE_SCAN_LENGTH]> {
        let header = LineScanHeader {
            source: SOURCE,
            calibration: self.rig.calibration_id(),
            sequence: picture.sequence,
            capture_age: picture.age,
            exposure: picture.exposure,
            last_status: status.map_or(0, |status| status.number),
            verdict: picture.verdict,
            ambient: 90,
            saturated: 10,
            claims: NO_CLAIMS,
        };
        // A laser that is off draws no stripe.
        let height = picture.height.filter(|_| picture.light > 0);
        let row = |column: usize| Some(self.geometry.map(column)?.row(height?));
        let columns: Vec<_> = (0..self.geometry.column_count())
            .map(|column| {
                let row = SubpixelRow::from_pixels(row(column)?)?;
                Some(LineScanColumn { row, quality: SignalQuality::new(220) })
            })
            .map(|column| column.unwrap_or(LineScanColumn::MISSING))
            .collect();
        let light = if height.is_some() { picture.light } else { 0 };
        let brightness = BrightnessProfile { blocks: [u16::from(light) * 60; 64] };
        let challenge = status.map_or(Challenge::default(), |status| status.challenge);
        let windows = windows(&challenge, light, |column| row(column).unwrap_or(0.0));
        let mut bytes = [0; LINE_SCAN_LENGTH];
        encode(&mut bytes, &header, &columns, &brightness, &windows).context("the line-scan")?;
        Ok(bytes)
    }
}

struct Picture {
    sequence: SequenceNumber,
    age: Micros,
    exposure: Micros,
    light: u8,
    height: Option<f32>,
    verdict: HostVerdict,
}

/// The raw pixels that the status asks for, with a stripe of this brightness at these rows.
fn windows(challenge: &Challenge, light: u8, row_of: impl Fn(usize) -> f32) -> Vec<AuditWindow> {
    let window = |column: &u16| {
        let row = row_of(usize::from(*column));
        let first_row = first_row_for(row);
        let mut pixels = [100; AUDIT_PIXELS];
        for (place, pixel) in (0_u16..).zip(pixels.iter_mut()) {
            let distance = f32::from(first_row) + f32::from(place) - row;
            *pixel += (f32::from(light) * 0.3 * (-distance * distance / 6.0).exp()) as u8;
        }
        AuditWindow { column: *column, first_row, pixels }
    };
    challenge.columns.iter().take(usize::from(challenge.count)).map(window).collect()
}

fn request(number: &str, demand: &Demand<'_>) -> Result<String> {
    let mut message = [0; LINE_SCAN_LENGTH];
    encode_request(&mut message, SOURCE, number.parse()?, demand);
    Ok(hex(&message))
}

/// What the page in a transaction says.
fn page(transaction: &[u8]) -> Result<String> {
    let Some(page) = Page::find(transaction)? else { return Ok("-".to_owned()) };
    let data = if page.data.is_empty() { "-".to_owned() } else { hex(page.data) };
    Ok(format!("{} {:?} {data}", page.header.request, page.header.result))
}

fn told(status: &Status) -> Result<String> {
    let self_test = SelfTestKind::from_code(status.failed_self_test).map_or("-", SelfTestKind::name);
    let fault = status.fault.map_or("-", FaultCode::name);
    let cause = format!("{:?}", status.reset_cause);
    let (live, latched) = (names(status.live_causes), names(status.latched_causes));
    let state = status.state.name();
    Ok(format!("{state} {self_test} {fault} {live} {latched} {cause} {}", status.number))
}

fn names(causes: StopCauses) -> String {
    let names: Vec<_> = causes.iter().map(StopCause::name).collect();
    if names.is_empty() { "-".to_owned() } else { names.join(",") }
}

fn parse(status: &str) -> Result<Option<Status>> {
    if status == "-" {
        return Ok(None);
    }
    let bytes = bytes(status)?;
    let status = bytes.get(..STATUS_LENGTH).context("too short for a status")?;
    Ok(Some(Status::parse(status).context("a status that is none")?))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(hex: &str) -> Result<Vec<u8>> {
    (0..hex.len() / 2)
        .map(|place| {
            let digits = hex.get(2 * place..2 * place + 2).context("hex digits")?;
            Ok(u8::from_str_radix(digits, 16)?)
        })
        .collect()
}
