//! Answers to the host's service requests: who may ask for what, and when.
//!
//! Reading is always allowed. A change of the stored rig needs all of these, each with its own refusal, and none of
//! them can be given by the host:
//!
//! | needed | refusal |
//! |---|---|
//! | the service key is held | `ServiceKeyOpen` |
//! | the controller neither runs nor is about to (arming) | `Running` |
//! | both relays are proven open by their mirror contacts | `RelaysNotOpen` |
//! | to acknowledge: the candidate was read back since it was stored | `NotReadBack`, `OtherCandidate` |
//!
//! A request has no way to the relays: [`Service`] knows the permissions and yields pages. A message that is a request
//! is kept from the link's receiver, so it neither proves nor disturbs anything there; the link's time-out goes on.
//!
//! The flash is slow, so its part is a [`FlashJob`] for the task below the safety task; until its outcome is
//! [taken](Service::finish) the page says `Working`, and other requests are told `Busy`.
//!
//! ```text
//!  request --answer--> page                                  (black box, fault log, refusals)
//!                 +--> page "working", FlashJob --Store::run--> JobOutcome --finish--> page
//! ```
//!
//! A request that comes again byte by byte is not carried out again: the page that answers it stands until another
//! request arrives.

use crate::black_box::{BlackBox, PageContent};
use crate::fault_log::FaultLog;
use crate::store::StoreError;
use nearfield_shared::rig::COMPACT_LENGTH;
use nearfield_shared::service::{
    Demand, NO_PAGE, PAGE_DATA_LENGTH, PageBytes, PageHeader, Request, ResultCode, encode_page,
};
use nearfield_shared::status::StateCode;
use nearfield_shared::units::{CalibrationId, SourceId};
use nearfield_shared::wire::seal_of;

/// What decides whether a change is allowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Permissions {
    /// The service key is held, by the input pin.
    pub service_key: bool,
    /// Both relays are proven open, by their mirror contacts.
    pub relays_proven_open: bool,
    /// The supervisor's state.
    pub state: StateCode,
}

impl Permissions {
    /// May what is stored be changed now?
    ///
    /// # Errors
    /// What is missing.
    pub fn check_change(&self) -> Result<(), ResultCode> {
        if !self.service_key {
            return Err(ResultCode::ServiceKeyOpen);
        }
        match self.state {
            // Arming: somebody has pressed the reset button to run.
            StateCode::Running | StateCode::Arming => return Err(ResultCode::Running),
            StateCode::SelfTest | StateCode::Interlocked | StateCode::Stopped | StateCode::Lockout => {}
        }
        if !self.relays_proven_open {
            return Err(ResultCode::RelaysNotOpen);
        }
        Ok(())
    }
}

/// What a request needs of the flash; see [`crate::store::Store::run`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlashJob {
    /// Read the rig in force at the next start.
    ReadRig,
    /// Read the candidate back.
    ReadCandidate,
    /// Keep a candidate.
    StoreRig([u8; COMPACT_LENGTH]),
    /// Put the candidate in force.
    AcknowledgeRig(CalibrationId),
}

/// What came of a job: the compact form that was read, if it was a reading.
pub type JobOutcome = Result<Option<[u8; COMPACT_LENGTH]>, StoreError>;

/// What a request can be answered from.
#[derive(Debug, Clone, Copy)]
pub struct Records<'a> {
    /// The stop black box.
    pub black_box: &'a BlackBox,
    /// The fault log.
    pub fault_log: &'a FaultLog,
}

/// The service's memory, about 1.4 KB: the page that is sent, and how far a change has come.
#[derive(Debug, Clone)]
pub struct Service {
    source: SourceId,
    page: PageBytes,
    /// The seal of the request that `page` answers.
    answered: Option<u32>,
    /// The job that is worked on, and the page that will tell its outcome.
    job: Option<(FlashJob, PageHeader)>,
    /// The candidate as the host has read it back.
    read_back: Option<CalibrationId>,
}

impl Service {
    /// For the module of this source id; no page yet.
    #[must_use]
    pub const fn new(source: SourceId) -> Self {
        Self { source, page: NO_PAGE, answered: None, job: None, read_back: None }
    }

    /// What the transaction carries at [`nearfield_shared::service::PAGE_OFFSET`]; zeros = no page.
    #[must_use]
    pub const fn page(&self) -> &PageBytes {
        &self.page
    }

    /// Answers a request. A job that it yields is to be carried out, and its outcome brought to [`Self::finish`].
    #[must_use]
    pub fn answer(
        &mut self,
        request: &Request<'_>,
        permissions: &Permissions,
        records: &Records<'_>,
    ) -> Option<FlashJob> {
        if self.answered == Some(request.seal) {
            return None;
        }
        self.answered = Some(request.seal);
        let header = PageHeader {
            source: self.source,
            request: request.number,
            code: request.code,
            result: ResultCode::Done,
            index: 0,
            count: 1,
            revision: 0,
        };
        match self.decide(request, permissions) {
            Ok(Answer::Page(page)) => {
                self.turn_page(header, &page, records);
                None
            }
            Ok(Answer::Job(job)) => {
                self.tell(header, ResultCode::Working);
                self.job = Some((job, header));
                Some(job)
            }
            Err(refusal) => {
                self.tell(header, refusal);
                None
            }
        }
    }

    fn decide(&self, request: &Request<'_>, permissions: &Permissions) -> Result<Answer, ResultCode> {
        if request.source != self.source {
            return Err(ResultCode::OtherModule);
        }
        let demand = request.demand?;
        if demand.is_change() {
            permissions.check_change()?;
        }
        let job = match demand {
            Demand::ReadBlackBox { page } => return Ok(Answer::Page(Book::BlackBox(page))),
            Demand::ReadFaultLog { page } => return Ok(Answer::Page(Book::FaultLog(page))),
            Demand::ReadRig => FlashJob::ReadRig,
            Demand::ReadCandidate => FlashJob::ReadCandidate,
            Demand::StoreRig { rig } => FlashJob::StoreRig(*rig),
            Demand::AcknowledgeRig { calibration } => match self.read_back {
                None => return Err(ResultCode::NotReadBack),
                Some(candidate) if candidate != calibration => return Err(ResultCode::OtherCandidate),
                Some(_) => FlashJob::AcknowledgeRig(calibration),
            },
        };
        if self.job.is_some() { Err(ResultCode::Busy) } else { Ok(Answer::Job(job)) }
    }

    fn turn_page(&mut self, header: PageHeader, book: &Book, records: &Records<'_>) {
        let mut data = [0; PAGE_DATA_LENGTH];
        let (index, content) = match *book {
            Book::BlackBox(page) => (page, records.black_box.page(page, &mut data)),
            Book::FaultLog(page) => (page, records.fault_log.page(page, &mut data)),
        };
        match content {
            Some(PageContent { length, count, revision }) => {
                let header = PageHeader { index, count, revision, ..header };
                encode_page(&mut self.page, &header, data.get(..length).unwrap_or(&[]));
            }
            // Page 0 is missing only where nothing is kept.
            None if index == 0 => self.tell(header, ResultCode::Nothing),
            None => self.tell(header, ResultCode::NoSuchPage),
        }
    }

    /// A page without data.
    fn tell(&mut self, header: PageHeader, result: ResultCode) {
        encode_page(&mut self.page, &PageHeader { result, ..header }, &[]);
    }

    /// Takes the outcome of the job that [`Self::answer`] gave last. Returns the rig that has come into force (for the
    /// next start), if one has. An outcome that no job was given for is left out.
    pub fn finish(&mut self, outcome: &JobOutcome) -> Option<CalibrationId> {
        let (job, header) = self.job.take()?;
        match (job, outcome) {
            (FlashJob::ReadRig | FlashJob::ReadCandidate, Ok(None)) => {
                self.tell(header, ResultCode::Nothing);
            }
            (FlashJob::ReadRig, Ok(Some(rig))) => encode_page(&mut self.page, &header, rig),
            (FlashJob::ReadCandidate, Ok(Some(rig))) => {
                self.read_back = Some(CalibrationId::new(seal_of(rig)));
                encode_page(&mut self.page, &header, rig);
            }
            (FlashJob::StoreRig(_), Ok(_)) => {
                self.read_back = None;
                self.tell(header, ResultCode::Done);
            }
            (FlashJob::AcknowledgeRig(calibration), Ok(_)) => {
                self.read_back = None;
                self.tell(header, ResultCode::Done);
                return Some(calibration);
            }
            (FlashJob::StoreRig(_) | FlashJob::AcknowledgeRig(_), Err(error)) => {
                // Whatever stands in the flash now, it is not what was read back.
                self.read_back = None;
                self.tell(header, result_of(*error));
            }
            (FlashJob::ReadRig | FlashJob::ReadCandidate, Err(error)) => self.tell(header, result_of(*error)),
        }
        None
    }
}

const fn result_of(error: StoreError) -> ResultCode {
    match error {
        StoreError::Invalid(_) => ResultCode::InvalidRig,
        StoreError::Nothing => ResultCode::Nothing,
        StoreError::OtherCandidate(_) => ResultCode::OtherCandidate,
        StoreError::Flash => ResultCode::Flash,
    }
}

/// How a request is answered.
enum Answer {
    /// At once.
    Page(Book),
    /// By the flash.
    Job(FlashJob),
}

/// What is read page by page.
enum Book {
    BlackBox(u16),
    FaultLog(u16),
}

#[cfg(test)]
mod tests;
