//! Recordings decide again.
//!
//! * **Simulated controllers** were recorded request by request from power-up on: the firmware's library is asked the same, and
//!   every reply must be the same, bit for bit: relays, laser, state, causes, challenge, everything.
//! * **Any controller**, also the board, and recordings that begin later: the line-scans go through the controller's own stripe
//!   monitor, and every status must tell the same gap, heights and size, bit for bit. What depends on the controller's secret,
//!   its pins and its clock cannot be decided again from outside.

use std::collections::VecDeque;

use nearfield_firmware::lockstep::{Request, RequestHeader};
use nearfield_recording::messages::from_text;
use nearfield_recording::reader::Record;
use nearfield_recording::{LockStep, Recording};
use nearfield_shared::columns::{Decimation, GeometryError};
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, VOTE_FRAMES};
use nearfield_shared::linescan::LineScan;
use nearfield_shared::monitor::{StripeMonitor, StripeReport};
use nearfield_shared::rig::{CompactRigError, Rig};
use nearfield_shared::status::{REFUSAL_KINDS, Status};
use serde::Serialize;

use crate::link::{InProcess, LinkError, McuLink, SECRET_LENGTH};

/// Why recordings cannot decide again.
#[derive(Debug, thiserror::Error)]
pub enum RedecideError {
    /// The rig in the recording.
    #[error("the recording's rig cannot be used: {0}")]
    Rig(#[from] CompactRigError),
    /// The rig in the recording.
    #[error("the recording's rig cannot be used: {0}")]
    Geometry(#[from] GeometryError),
    /// A request that is none.
    #[error("request {number} of the recording makes no sense")]
    Request {
        /// Its number.
        number: u64,
    },
    /// The controller in this process.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// How the recordings of one run decided again.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Redecided {
    /// Replies of a simulated controller that were asked for again.
    pub replies: u64,
    /// Of them: not the same.
    pub different_replies: u64,
    /// Requests before the first power-up, or behind a hole: they could not be asked again.
    pub unasked: u64,
    /// Statuses whose line-scan and vote are in the recording.
    pub statuses: u64,
    /// Of them: another gap, height or size.
    pub different_statuses: u64,
    /// Stops told in the recording.
    pub stops: u64,
    /// Recordings that were cut off.
    pub cut_off: u64,
    /// The first differences, in words.
    pub differences: Vec<String>,
}

impl Redecided {
    /// Was everything that could be decided again decided as before, and was there something?
    #[must_use]
    pub const fn is_same(&self) -> bool {
        self.different_replies == 0 && self.different_statuses == 0 && self.replies + self.statuses > 0
    }

    fn differ(&mut self, words: String) {
        const TOLD: usize = 10;
        if self.differences.len() < TOLD {
            self.differences.push(words);
        }
    }
}

/// The recordings of one run, in their order.
///
/// # Errors
/// See [`RedecideError`].
pub fn redecide<'a>(recordings: impl IntoIterator<Item = &'a Recording>) -> Result<Redecided, RedecideError> {
    let mut told = Redecided::default();
    let mut controller: Option<Controller> = None;
    let mut votes: Option<Votes> = None;
    let mut line_scan: Option<&[u8]> = None;
    for recording in recordings {
        told.cut_off += u64::from(!recording.is_complete());
        for (_, record) in recording.records() {
            match record {
                Record::Configuration(configuration) if votes.is_none() => {
                    let rig = from_text(&configuration.rig).unwrap_or_default();
                    votes = Some(Votes::new(&Rig::from_bytes(&rig)?)?);
                }
                Record::LineScan(bytes) => {
                    line_scan = Some(bytes);
                    if let Some(votes) = &mut votes {
                        votes.line_scan(bytes);
                    }
                }
                Record::Status(bytes) => {
                    if let Some(votes) = &mut votes {
                        votes.status(bytes, &mut told);
                    }
                }
                Record::LockStep { step, payload, with_line_scan } => {
                    let payload = payload.as_deref().or(line_scan.filter(|_| *with_line_scan));
                    ask(&mut controller, step, payload, &mut told)?;
                }
                Record::Log(log) => told.stops += u64::from(log.message.starts_with("stop:")),
                Record::Configuration(_)
                | Record::Decision(_)
                | Record::Detections(_)
                | Record::Picture(_) => {}
            }
        }
    }
    Ok(told)
}

/// A controller that has been asked all requests up to this number.
struct Controller {
    link: InProcess,
    number: u64,
}

fn ask(
    controller: &mut Option<Controller>,
    step: &LockStep,
    payload: Option<&[u8]>,
    told: &mut Redecided,
) -> Result<(), RedecideError> {
    let nonsense = || RedecideError::Request { number: step.number };
    let header = RequestHeader::parse(&step.request).map_err(|_| nonsense())?;
    let reply = match header.request {
        Request::Start => {
            let payload = payload.ok_or_else(nonsense)?;
            let (secret, rig) = payload.split_first_chunk::<SECRET_LENGTH>().ok_or_else(nonsense)?;
            let mut link = InProcess::new();
            let reply = link.start(header.now, *secret, rig)?;
            *controller = Some(Controller { link, number: step.number });
            reply
        }
        Request::Tick(_) | Request::Exchange | Request::Hang | Request::Page => {
            // Behind a hole nothing is certain.
            let Some(known) = controller.as_mut().filter(|known| known.number + 1 == step.number) else {
                *controller = None;
                told.unasked += 1;
                return Ok(());
            };
            known.number = step.number;
            match header.request {
                Request::Tick(tick) => known.link.tick(header.now, tick)?,
                Request::Exchange => known.link.exchange(header.now, payload)?,
                Request::Start | Request::Hang | Request::Page => return Err(nonsense()),
            }
        }
    };
    told.replies += 1;
    if reply.to_bytes(header.request) != step.reply {
        told.different_replies += 1;
        told.differ(format!("request {} at {} us is answered otherwise", step.number, header.now.get()));
    }
    Ok(())
}

/// The stripe monitor over the recorded line-scans.
struct Votes {
    monitor: Box<StripeMonitor<LARGEST_COLUMN_COUNT>>,
    /// What the controller has refused, and its time-outs, as far as statuses have told.
    refused: Option<[u32; REFUSAL_KINDS]>,
    /// Line-scans without a hole before them.
    unbroken: usize,
    last: Option<u32>,
    /// By sequence number, the last few: a status tells of the one before it.
    reports: VecDeque<(u32, StripeReport)>,
}

/// A status answers one of the last line-scans.
const KEPT_REPORTS: usize = 4;

impl Votes {
    fn new(rig: &Rig) -> Result<Self, GeometryError> {
        let mut monitor = Box::new(StripeMonitor::new());
        monitor.configure(rig, Decimation::for_line_scan(rig.image().width))?;
        Ok(Self { monitor, refused: None, unbroken: 0, last: None, reports: VecDeque::new() })
    }

    fn line_scan(&mut self, bytes: &[u8]) {
        // The controller refuses what it cannot read, and so is its answer.
        let Ok(scan) = LineScan::parse(bytes) else { return };
        let sequence = scan.header().sequence.get();
        let follows = self.last.is_some_and(|last| last.wrapping_add(1) == sequence);
        self.unbroken = if follows { self.unbroken + 1 } else { 1 };
        self.last = Some(sequence);
        let report = self.monitor.update(scan.readings());
        if self.unbroken >= VOTE_FRAMES {
            self.reports.push_back((sequence, report));
        } else {
            self.reports.clear();
        }
        if self.reports.len() > KEPT_REPORTS {
            self.reports.pop_front();
        }
    }

    fn status(&mut self, bytes: &[u8], told: &mut Redecided) {
        let Ok(status) = Status::parse(bytes) else { return };
        if self.refused.replace(status.refused).is_some_and(|before| before != status.refused) {
            // A line-scan did not reach the vote, or the vote began anew after a silence: it is the same again after a full
            // vote of accepted ones.
            self.unbroken = 0;
            self.reports.clear();
            return;
        }
        let echoed = status.echoed_sequence.get();
        let Some((_, report)) = self.reports.iter().find(|(sequence, _)| *sequence == echoed) else { return };
        // Under a run-over permit columns pass as floor.
        if status.run_over.is_some() || report.passed.is_some() {
            return;
        }
        told.statuses += 1;
        let again = Status {
            longest_gap: report.longest_gap(),
            highest: report.heights.highest,
            lowest: report.heights.lowest.map(|lowest| lowest.height),
            longest_unknown: report.heights.longest_unknown,
            size: report.size(),
            ..status
        };
        if again.to_bytes()[..] != *bytes {
            told.different_statuses += 1;
            let gap = |status: &Status| status.longest_gap.map_or(0.0, |gap| gap.length().get());
            told.differ(format!(
                "status {}: line-scan {echoed} was told with a gap of {} mm and has {} mm",
                status.number,
                gap(&status),
                gap(&again)
            ));
        }
    }
}
