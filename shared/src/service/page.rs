//! The pages that answer requests; the format stands in the module above.

use super::SERVICE_VERSION;
use crate::linescan::LINE_SCAN_LENGTH;
use crate::status::STATUS_LENGTH;
use crate::units::SourceId;
use crate::wire::{self, Reader, SEAL_LENGTH, Writer};

/// `NFPG`, little-endian.
pub const PAGE_MAGIC: u32 = 0x4750_464E;
/// Where a page begins in what a transaction brings.
pub const PAGE_OFFSET: usize = 256;
/// Bytes of data that a page holds.
pub const PAGE_DATA_LENGTH: usize = 1024;
/// Bytes of a page.
pub const PAGE_LENGTH: usize = 28 + PAGE_DATA_LENGTH + SEAL_LENGTH;
const _: () = assert!(STATUS_LENGTH <= PAGE_OFFSET, "the page must stand behind the status");
const _: () = assert!(PAGE_OFFSET + PAGE_LENGTH <= LINE_SCAN_LENGTH, "the page must fit the transaction");

/// How a request ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResultCode {
    /// Done; the data is what was asked for.
    Done,
    /// The flash is being read or written; the page will follow under the same number.
    Working,
    /// No such kind of request.
    UnknownKind,
    /// A request of another version.
    OtherVersion,
    /// Length, argument or unused bytes are not what the kind demands.
    Malformed,
    /// Meant for another module.
    OtherModule,
    /// There are not that many pages.
    NoSuchPage,
    /// There is nothing of the kind: no stop kept, no rig stored, no candidate.
    Nothing,
    /// Not while the service key is not held.
    ServiceKeyOpen,
    /// Not while the relays are not proven open.
    RelaysNotOpen,
    /// Not while the controller runs.
    Running,
    /// The bytes are no valid rig.
    InvalidRig,
    /// The candidate must be read back before it can be acknowledged.
    NotReadBack,
    /// The candidate has another calibration id.
    OtherCandidate,
    /// The flash refuses, or does not hold what was written.
    Flash,
    /// An earlier request is still worked on.
    Busy,
}

impl ResultCode {
    /// All codes.
    pub const ALL: [Self; 16] = [
        Self::Done,
        Self::Working,
        Self::UnknownKind,
        Self::OtherVersion,
        Self::Malformed,
        Self::OtherModule,
        Self::NoSuchPage,
        Self::Nothing,
        Self::ServiceKeyOpen,
        Self::RelaysNotOpen,
        Self::Running,
        Self::InvalidRig,
        Self::NotReadBack,
        Self::OtherCandidate,
        Self::Flash,
        Self::Busy,
    ];

    /// Its code on the wire.
    #[must_use]
    pub const fn code(self) -> u16 {
        match self {
            Self::Done => 1,
            Self::Working => 2,
            Self::UnknownKind => 3,
            Self::OtherVersion => 4,
            Self::Malformed => 5,
            Self::OtherModule => 6,
            Self::NoSuchPage => 7,
            Self::Nothing => 8,
            Self::ServiceKeyOpen => 9,
            Self::RelaysNotOpen => 10,
            Self::Running => 11,
            Self::InvalidRig => 12,
            Self::NotReadBack => 13,
            Self::OtherCandidate => 14,
            Self::Flash => 15,
            Self::Busy => 16,
        }
    }

    /// What a person at the robot reads.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Working => "the controller is still working on it",
            Self::UnknownKind => "the controller does not know this kind of request",
            Self::OtherVersion => "the controller speaks another version of the service protocol",
            Self::Malformed => "the request is malformed",
            Self::OtherModule => "the request is meant for another module",
            Self::NoSuchPage => "there is no such page",
            Self::Nothing => "there is nothing of the kind",
            Self::ServiceKeyOpen => "the service key is not held",
            Self::RelaysNotOpen => "the relays are not proven open",
            Self::Running => "the controller is running",
            Self::InvalidRig => "the rig is not valid",
            Self::NotReadBack => "the candidate has not been read back",
            Self::OtherCandidate => "the candidate has another calibration id",
            Self::Flash => "the controller's flash refuses",
            Self::Busy => "the controller is still working on an earlier request",
        }
    }
}

/// The fixed fields of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageHeader {
    /// The module that answers.
    pub source: SourceId,
    /// Number of the request.
    pub request: u32,
    /// Kind of the request, by its code.
    pub code: u16,
    /// How it ended.
    pub result: ResultCode,
    /// Which page this is.
    pub index: u16,
    /// How many there are.
    pub count: u16,
    /// Pages with one revision belong together: the stop's number, the newest fault's number, or 0.
    pub revision: u32,
}

/// A page's bytes. All zeros = no page.
pub type PageBytes = [u8; PAGE_LENGTH];

/// No page.
pub const NO_PAGE: PageBytes = [0; PAGE_LENGTH];

/// Writes a page; data beyond [`PAGE_DATA_LENGTH`] is dropped (every page's content is built to fit).
pub fn encode_page(page: &mut PageBytes, header: &PageHeader, data: &[u8]) {
    page.fill(0);
    let data = data.get(..PAGE_DATA_LENGTH).unwrap_or(data);
    let mut writer = Writer::new(page);
    writer.u32(PAGE_MAGIC);
    writer.u16(SERVICE_VERSION);
    writer.u16(header.source.get());
    writer.u32(header.request);
    writer.u16(header.code);
    writer.u16(header.result.code());
    writer.u16(header.index);
    writer.u16(header.count);
    writer.u32(header.revision);
    writer.u16(u16::try_from(data.len()).unwrap_or(0));
    writer.u16(0);
    for byte in data {
        writer.u8(*byte);
    }
    wire::seal(page);
}

/// Why what stands behind the status is no page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PageError {
    /// Fewer bytes than a status and a page.
    Length,
    /// The CRC does not match.
    Corrupted,
    /// Another kind of message.
    Magic,
    /// Another version.
    Version,
    /// A field has a value that the format does not allow.
    Field,
}

impl core::fmt::Display for PageError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Length => "the answer is too short for a service page",
            Self::Corrupted => "service page damaged (CRC)",
            Self::Magic => "not a service page",
            Self::Version => "service page of another version",
            Self::Field => "service page with an impossible field",
        })
    }
}

impl core::error::Error for PageError {}

/// A checked page over the bytes that arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Page<'a> {
    /// The fixed fields.
    pub header: PageHeader,
    /// The data.
    pub data: &'a [u8],
}

impl<'a> Page<'a> {
    /// Reads the page in what a transaction brought; `None` if it carries none.
    ///
    /// # Errors
    /// The first rule that is broken, in the order length, CRC, magic, version, fields.
    pub fn find(transaction: &'a [u8]) -> Result<Option<Self>, PageError> {
        let bytes = transaction
            .get(PAGE_OFFSET..)
            .and_then(<[u8]>::first_chunk::<PAGE_LENGTH>)
            .ok_or(PageError::Length)?;
        if *bytes == NO_PAGE { Ok(None) } else { Self::parse(bytes).map(Some) }
    }

    /// Reads a page.
    ///
    /// # Errors
    /// The first rule that is broken, in the order CRC, magic, version, fields.
    pub fn parse(bytes: &'a PageBytes) -> Result<Self, PageError> {
        if !wire::is_sealed(bytes) {
            return Err(PageError::Corrupted);
        }
        let mut reader = Reader::new(bytes);
        if reader.u32() != Some(PAGE_MAGIC) {
            return Err(PageError::Magic);
        }
        if reader.u16() != Some(SERVICE_VERSION) {
            return Err(PageError::Version);
        }
        Self::parse_fields(&mut reader).ok_or(PageError::Field)
    }

    fn parse_fields(reader: &mut Reader<'a>) -> Option<Self> {
        let source = SourceId::new(reader.u16()?);
        let (request, code, result_code) = (reader.u32()?, reader.u16()?, reader.u16()?);
        let result = ResultCode::ALL.into_iter().find(|result| result.code() == result_code)?;
        let (index, count, revision) = (reader.u16()?, reader.u16()?, reader.u32()?);
        let (length, zero) = (usize::from(reader.u16()?), reader.u16()?);
        let (data, rest) = reader.slice(PAGE_DATA_LENGTH)?.split_at_checked(length)?;
        if zero != 0 || rest.iter().any(|byte| *byte != 0) {
            return None;
        }
        Some(Self { header: PageHeader { source, request, code, result, index, count, revision }, data })
    }
}
