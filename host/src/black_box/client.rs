//! Asks the controller: requests out, pages back, over any link.

use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::rig::COMPACT_LENGTH;
use nearfield_shared::service::{
    Demand, FAULT_ENTRY_LENGTH, FaultEntry, PAGES_PER_SCAN, Page, PageError, PageHeader, ResultCode,
    SUMMARY_LENGTH, SUMMARY_PAGES, StopIndex, Summary, encode_request,
};
use nearfield_shared::units::{CalibrationId, SourceId};

use super::recording::Recording;

/// One transaction's bytes.
pub type Transaction = [u8; LINE_SCAN_LENGTH];

/// A link to a controller, as service sees it: SPI on the robot, a simulated controller elsewhere.
pub trait ServiceLink {
    /// Why the controller cannot be reached.
    type Error: std::error::Error + Send + Sync + 'static;

    /// One full-duplex transaction, and time for the controller to work before the next one (a frame's period).
    /// `message` of `None` asks for the status only.
    ///
    /// # Errors
    /// The controller cannot be reached.
    fn transact(&mut self, message: Option<&Transaction>) -> Result<Box<Transaction>, Self::Error>;
}

/// Why the controller did not give what it was asked for.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError<E: std::error::Error + 'static> {
    /// The link.
    #[error(transparent)]
    Link(E),
    /// The controller refuses.
    #[error("the controller refuses to {asked}: {}{}", .result.words(), remedy(*.result))]
    Refused {
        /// What it was asked to do.
        asked: &'static str,
        /// Its reason.
        result: ResultCode,
    },
    /// No page answers the request.
    #[error("the controller does not answer a request to {asked} within {transactions} transactions")]
    NoAnswer {
        /// What it was asked to do.
        asked: &'static str,
        /// How long it had.
        transactions: u32,
    },
    /// A page that is none.
    #[error("the controller's answer is unreadable: {0}")]
    Page(#[from] PageError),
    /// Pages that do not fit together.
    #[error("the controller's answer makes no sense: {0}")]
    Contradiction(&'static str),
    /// Another stop came between the pages, again and again.
    #[error("the kept stop changed {0} times while it was being read; try again when the robot stands still")]
    Changing(u32),
    /// The candidate that was read back is not the rig that was sent.
    #[error("the controller holds another rig than the one sent; nothing was changed, try again")]
    NotKept,
}

/// What to do about a refusal.
const fn remedy(result: ResultCode) -> &'static str {
    match result {
        ResultCode::ServiceKeyOpen => "; turn the service key and hold it",
        ResultCode::RelaysNotOpen => {
            "; wait until both relays have dropped out, or have their contacts looked at"
        }
        ResultCode::Running => "; stop the robot first",
        ResultCode::Flash => "; try again, and replace the controller if it stays so",
        ResultCode::Busy => "; try again",
        ResultCode::OtherVersion | ResultCode::UnknownKind => "; update the host or the firmware",
        ResultCode::OtherModule => "; check which module this host is wired to",
        _ => "",
    }
}

/// Transactions that an answer may take: an erased page of flash takes 22 ms, and a frame may be lost.
const ANSWER_TRANSACTIONS: u32 = 50;
/// Times that reading starts over because another stop came between.
const READING_TRIES: u32 = 3;

/// An answer's page, copied.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer {
    /// The fixed fields.
    pub header: PageHeader,
    /// The data.
    pub data: Vec<u8>,
}

/// Asks one controller.
#[derive(Debug)]
pub struct ServiceClient<'a, L> {
    link: &'a mut L,
    source: SourceId,
    number: u32,
}

impl<'a, L: ServiceLink> ServiceClient<'a, L> {
    /// Over `link` to the module `source`. `first_number` should differ from run to run (a clock's reading): the
    /// controller does not carry out a request again whose bytes it has just seen.
    pub const fn new(link: &'a mut L, source: SourceId, first_number: u32) -> Self {
        Self { link, source, number: first_number }
    }

    /// Sends one request and waits for its page.
    ///
    /// # Errors
    /// The link; no answer, an unreadable one, or a refusal.
    pub fn ask(&mut self, demand: &Demand<'_>) -> Result<Answer, ServiceError<L::Error>> {
        let asked = words(demand);
        self.number = self.number.wrapping_add(1);
        let mut message = [0; LINE_SCAN_LENGTH];
        encode_request(&mut message, self.source, self.number, demand);
        let mut message = Some(&message);
        for _ in 0..ANSWER_TRANSACTIONS {
            // The answer comes with a later transaction: this one's was put together before the request was seen.
            let reply = self.link.transact(message.take()).map_err(ServiceError::Link)?;
            let Some(page) = Page::find(&reply[..])? else { continue };
            let PageHeader { request, code, result, .. } = page.header;
            if request != self.number || code != demand.code() || result == ResultCode::Working {
                continue;
            }
            if result != ResultCode::Done {
                return Err(ServiceError::Refused { asked, result });
            }
            return Ok(Answer { header: page.header, data: page.data.to_vec() });
        }
        Err(ServiceError::NoAnswer { asked, transactions: ANSWER_TRANSACTIONS })
    }

    /// As [`Self::ask`], where "there is nothing of the kind" is an answer.
    fn ask_if_any(&mut self, demand: &Demand<'_>) -> Result<Option<Answer>, ServiceError<L::Error>> {
        match self.ask(demand) {
            Err(ServiceError::Refused { result: ResultCode::Nothing, .. }) => Ok(None),
            answer => answer.map(Some),
        }
    }

    /// The rig that is in force at the controller's next start: its compact form; `None` if none is stored.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub fn read_rig(&mut self) -> Result<Option<[u8; COMPACT_LENGTH]>, ServiceError<L::Error>> {
        self.ask_if_any(&Demand::ReadRig)?.map(|answer| compact(&answer)).transpose()
    }

    /// Stores a rig: candidate, read back, compared, acknowledged. It is in force from the controller's next start on.
    ///
    /// # Errors
    /// See [`ServiceError`]; then the old rig stays in force.
    pub fn store_rig(&mut self, rig: &[u8; COMPACT_LENGTH]) -> Result<CalibrationId, ServiceError<L::Error>> {
        self.ask(&Demand::StoreRig { rig })?;
        let kept = self.ask(&Demand::ReadCandidate)?;
        if compact(&kept)? != *rig {
            return Err(ServiceError::NotKept);
        }
        let calibration = CalibrationId::new(nearfield_shared::wire::seal_of(rig));
        self.ask(&Demand::AcknowledgeRig { calibration })?;
        Ok(calibration)
    }

    /// The fault log, oldest entry first.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub fn read_fault_log(&mut self) -> Result<Vec<FaultEntry>, ServiceError<L::Error>> {
        let mut entries = Vec::new();
        let first = self.ask(&Demand::ReadFaultLog { page: 0 })?;
        let mut answers = vec![first];
        for page in 1..answers[0].header.count {
            answers.push(self.ask(&Demand::ReadFaultLog { page })?);
        }
        for bytes in answers.iter().flat_map(|answer| answer.data.chunks(FAULT_ENTRY_LENGTH)) {
            entries.push(
                FaultEntry::parse(bytes).ok_or(ServiceError::Contradiction("an impossible fault entry"))?,
            );
        }
        Ok(entries)
    }

    /// The kept stop with the rig and the fault log; `None` if no stop is kept. `progress` is told pages read and
    /// pages in all.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub fn fetch(
        &mut self,
        mut progress: impl FnMut(u16, u16),
    ) -> Result<Option<Recording>, ServiceError<L::Error>> {
        for _ in 0..READING_TRIES {
            let Some(first) = self.ask_if_any(&Demand::ReadBlackBox { page: 0 })? else { return Ok(None) };
            if let Some(recording) = self.fetch_revision(&first, &mut progress)? {
                return Ok(Some(recording));
            }
        }
        Err(ServiceError::Changing(READING_TRIES))
    }

    /// The pages behind the first one; `None` if another stop has taken its place meanwhile.
    fn fetch_revision(
        &mut self,
        first: &Answer,
        progress: &mut impl FnMut(u16, u16),
    ) -> Result<Option<Recording>, ServiceError<L::Error>> {
        let index = StopIndex::parse(&first.data)
            .ok_or(ServiceError::Contradiction("an impossible index of the black box"))?;
        let mut pages = Vec::new();
        for page in 1..first.header.count {
            progress(page, first.header.count);
            let answer = match self.ask_if_any(&Demand::ReadBlackBox { page }) {
                Ok(Some(answer)) => answer,
                // The stop that has taken its place has fewer pages.
                Ok(None) | Err(ServiceError::Refused { result: ResultCode::NoSuchPage, .. }) => {
                    return Ok(None);
                }
                Err(error) => return Err(error),
            };
            if answer.header.revision != first.header.revision || answer.header.count != first.header.count {
                return Ok(None);
            }
            pages.push(answer.data);
        }
        // The time after the stop may have gone on being recorded between the pages.
        let last = self.ask_if_any(&Demand::ReadBlackBox { page: 0 })?;
        if last.is_none_or(|last| last.data != first.data) {
            return Ok(None);
        }
        progress(first.header.count, first.header.count);
        let (summaries, scans) = assemble(&index, &pages).map_err(ServiceError::Contradiction)?;
        let rig = self.read_rig()?;
        let faults = self.read_fault_log()?;
        Ok(Some(Recording { rig, index, summaries, scans, faults }))
    }
}

type Assembled = (Vec<Summary>, Vec<Box<Transaction>>);

/// The pages behind the index, put together.
fn assemble(index: &StopIndex, pages: &[Vec<u8>]) -> Result<Assembled, &'static str> {
    let (summary_pages, scan_pages) =
        pages.split_at_checked(SUMMARY_PAGES).ok_or("fewer pages than the index says")?;
    let (summaries, rest) = (summary_pages.concat(), scan_pages.len() % PAGES_PER_SCAN);
    let (records, odd) = summaries.as_chunks::<SUMMARY_LENGTH>();
    if records.len() != usize::from(index.summaries) || !odd.is_empty() {
        return Err("another number of summaries than the index says");
    }
    if scan_pages.len() / PAGES_PER_SCAN != usize::from(index.scans) || rest != 0 {
        return Err("another number of line-scans than the index says");
    }
    let summaries =
        records.iter().map(Summary::parse).collect::<Option<_>>().ok_or("an impossible summary")?;
    let scans = scan_pages
        .chunks(PAGES_PER_SCAN)
        .map(|pages| <Box<Transaction>>::try_from(pages.concat().into_boxed_slice()))
        .collect::<Result<_, _>>()
        .map_err(|_| "a line-scan of another length")?;
    Ok((summaries, scans))
}

fn compact<E: std::error::Error>(answer: &Answer) -> Result<[u8; COMPACT_LENGTH], ServiceError<E>> {
    <[u8; COMPACT_LENGTH]>::try_from(&answer.data[..])
        .map_err(|_| ServiceError::Contradiction("a rig of another length"))
}

const fn words(demand: &Demand<'_>) -> &'static str {
    match demand {
        Demand::ReadBlackBox { .. } => "read the black box",
        Demand::ReadFaultLog { .. } => "read the fault log",
        Demand::ReadRig => "read the stored rig",
        Demand::ReadCandidate => "read the new rig back",
        Demand::StoreRig { .. } => "store a rig",
        Demand::AcknowledgeRig { .. } => "put the new rig in force",
    }
}

#[cfg(test)]
mod tests;
