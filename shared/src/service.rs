//! Service over the link: what the host may ask the MCU besides its line-scans, and the pages that answer.
//!
//! # A request, host to MCU
//!
//! It takes the place of a line-scan in one transaction. It is never a line-scan: it proves nothing about the stripe,
//! so a host that only asks runs into the link's time-out. Little-endian, [`REQUEST_LENGTH`] bytes, then zeros up to
//! the transaction's length:
//!
//! | offset | field |
//! |---|---|
//! | 0 | magic `NFSQ` |
//! | 4 | version u16 (1) |
//! | 6 | source id u16 |
//! | 8 | number of the request u32, the host's choice, another one for every request |
//! | 12 | kind u16, see [`Demand`] |
//! | 14 | length of the payload u16: 160 for "store rig", else 0 |
//! | 16 | argument u32: a page's index, a calibration id, or 0 |
//! | 20 | payload, 160 bytes; zeros beyond its length |
//! | 180 | CRC-32 (see [`crate::wire`]) of all before |
//!
//! | kind | code | argument | payload | answer's data |
//! |---|---|---|---|---|
//! | read black box | 0x5555 | page | | see below |
//! | read fault log | 0x3333 | page | | [`FaultEntry`]s, oldest first |
//! | read rig | 0x6666 | | | the compact form in force at the next start |
//! | read candidate | 0x0F0F | | | the compact form that waits for its acknowledgement |
//! | store rig | 0x5A5A | | a rig's compact form | |
//! | acknowledge rig | 0x3C3C | its calibration id | | |
//!
//! What is not whole (length, magic, seal, zeros) is no request at all, and the link judges it as the line-scan that it
//! should have been. What is whole but not understood is answered with a [`ResultCode`] and has no other effect.
//!
//! A rig is changed in four steps: store it, read the candidate back, compare, acknowledge it by its calibration id.
//! Until the last one the old rig stays; the new one is in force from the next start of the MCU on. The first and the
//! last step need the service key, proven open relays, and a controller that does not run.
//!
//! # A page, MCU to host
//!
//! It stands [`PAGE_OFFSET`] bytes into a transaction, behind the status; zeros there = no page. The same page is sent
//! again until another request arrives. [`PAGE_LENGTH`] bytes:
//!
//! | offset | field |
//! |---|---|
//! | 0 | magic `NFPG` |
//! | 4 | version u16 (1) |
//! | 6 | source id u16 |
//! | 8 | number of the request that it answers u32 |
//! | 12 | the request's kind u16 |
//! | 14 | result u16, see [`ResultCode`] |
//! | 16 | index of the page u16, number of pages u16 |
//! | 20 | revision u32: pages of one revision belong together |
//! | 24 | length of the data u16, zero u16 |
//! | 28 | data, 1024 bytes; zeros beyond its length |
//! | 1052 | CRC-32 (see [`crate::wire`]) of all before |
//!
//! The black box's page 0 holds the [`StopIndex`]; then come [`SUMMARY_PAGES`] pages of [`Summary`]s, oldest first, 16
//! a page; then [`PAGES_PER_SCAN`] pages for every kept line-scan, oldest first.

mod fault_entry;
mod page;
mod summary;
#[cfg(test)]
mod tests;

pub use fault_entry::{FAULT_ENTRY_LENGTH, FaultEntry, FaultEvent, PowerCycle};
pub use page::{
    NO_PAGE, PAGE_DATA_LENGTH, PAGE_LENGTH, PAGE_MAGIC, PAGE_OFFSET, Page, PageBytes, PageError, PageHeader,
    ResultCode, encode_page,
};
pub use summary::{ExchangeKind, STOP_INDEX_LENGTH, SUMMARY_LENGTH, StopIndex, Summary};

use crate::linescan::LINE_SCAN_LENGTH;
use crate::rig::COMPACT_LENGTH;
use crate::units::{CalibrationId, SourceId};
use crate::wire::{self, Reader, SEAL_LENGTH, Writer};

/// `NFSQ`, little-endian.
pub const REQUEST_MAGIC: u32 = 0x5153_464E;
/// Version of requests and pages.
pub const SERVICE_VERSION: u16 = 1;
/// Bytes of a request before the zeros.
pub const REQUEST_LENGTH: usize = 20 + COMPACT_LENGTH + SEAL_LENGTH;

/// Summaries that the black box keeps.
pub const SUMMARY_COUNT: usize = 64;
/// Pages of summaries.
pub const SUMMARY_PAGES: usize = (SUMMARY_COUNT * SUMMARY_LENGTH).div_ceil(PAGE_DATA_LENGTH);
/// Pages of one line-scan; the last one is not full.
pub const PAGES_PER_SCAN: usize = LINE_SCAN_LENGTH.div_ceil(PAGE_DATA_LENGTH);

/// What the host asks for. The codes on the wire differ in eight bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Demand<'a> {
    /// A page of the black box's kept stop.
    ReadBlackBox {
        /// Index of the page.
        page: u16,
    },
    /// A page of the fault log.
    ReadFaultLog {
        /// Index of the page.
        page: u16,
    },
    /// The rig that is in force at the next start.
    ReadRig,
    /// The rig that waits for its acknowledgement.
    ReadCandidate,
    /// Keep this rig's compact form as the candidate.
    StoreRig {
        /// The compact form; nothing about it has been checked.
        rig: &'a [u8; COMPACT_LENGTH],
    },
    /// Put the candidate in force.
    AcknowledgeRig {
        /// The calibration id that the host has read back.
        calibration: CalibrationId,
    },
}

const READ_BLACK_BOX: u16 = 0x5555;
const READ_FAULT_LOG: u16 = 0x3333;
const READ_RIG: u16 = 0x6666;
const READ_CANDIDATE: u16 = 0x0F0F;
const STORE_RIG: u16 = 0x5A5A;
const ACKNOWLEDGE_RIG: u16 = 0x3C3C;

impl Demand<'_> {
    /// Its kind's code on the wire.
    #[must_use]
    pub const fn code(&self) -> u16 {
        match self {
            Self::ReadBlackBox { .. } => READ_BLACK_BOX,
            Self::ReadFaultLog { .. } => READ_FAULT_LOG,
            Self::ReadRig => READ_RIG,
            Self::ReadCandidate => READ_CANDIDATE,
            Self::StoreRig { .. } => STORE_RIG,
            Self::AcknowledgeRig { .. } => ACKNOWLEDGE_RIG,
        }
    }

    /// Does it change what the MCU has stored? Everything else only reads.
    #[must_use]
    pub const fn is_change(&self) -> bool {
        match self {
            Self::StoreRig { .. } | Self::AcknowledgeRig { .. } => true,
            Self::ReadBlackBox { .. } | Self::ReadFaultLog { .. } | Self::ReadRig | Self::ReadCandidate => {
                false
            }
        }
    }

    fn argument(&self) -> u32 {
        match self {
            Self::ReadBlackBox { page } | Self::ReadFaultLog { page } => u32::from(*page),
            Self::AcknowledgeRig { calibration } => calibration.get(),
            Self::ReadRig | Self::ReadCandidate | Self::StoreRig { .. } => 0,
        }
    }
}

/// A whole request from the host; see the module's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request<'a> {
    /// The module that it is meant for.
    pub source: SourceId,
    /// Its number.
    pub number: u32,
    /// Its kind's code, understood or not.
    pub code: u16,
    /// Its CRC: the same for a request that is sent again byte by byte.
    pub seal: u32,
    /// What it asks for, or why that is not understood.
    pub demand: Result<Demand<'a>, ResultCode>,
}

impl<'a> Request<'a> {
    /// Reads a transaction's bytes as a request; `None` if they are no whole one: then they are to be judged as the
    /// line-scan that they should have been.
    #[must_use]
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        if bytes.len() != LINE_SCAN_LENGTH {
            return None;
        }
        let (request, padding) = bytes.split_at_checked(REQUEST_LENGTH)?;
        let mut reader = Reader::new(request);
        if reader.u32()? != REQUEST_MAGIC || !wire::is_sealed(request) || padding.iter().any(|b| *b != 0) {
            return None;
        }
        let version = reader.u16()?;
        let source = SourceId::new(reader.u16()?);
        let (number, code) = (reader.u32()?, reader.u16()?);
        let (length, argument) = (reader.u16()?, reader.u32()?);
        let payload = reader.slice(COMPACT_LENGTH)?.first_chunk::<COMPACT_LENGTH>()?;
        let demand = if version == SERVICE_VERSION {
            Self::read_demand(code, length, argument, payload)
        } else {
            Err(ResultCode::OtherVersion)
        };
        Some(Self { source, number, code, seal: wire::seal_of(request), demand })
    }

    fn read_demand(
        code: u16,
        length: u16,
        argument: u32,
        payload: &'a [u8; COMPACT_LENGTH],
    ) -> Result<Demand<'a>, ResultCode> {
        let page = || u16::try_from(argument).map_err(|_| ResultCode::NoSuchPage);
        let demand = match code {
            READ_BLACK_BOX => Demand::ReadBlackBox { page: page()? },
            READ_FAULT_LOG => Demand::ReadFaultLog { page: page()? },
            READ_RIG => Demand::ReadRig,
            READ_CANDIDATE => Demand::ReadCandidate,
            STORE_RIG => Demand::StoreRig { rig: payload },
            ACKNOWLEDGE_RIG => Demand::AcknowledgeRig { calibration: CalibrationId::new(argument) },
            _ => return Err(ResultCode::UnknownKind),
        };
        let has_rig = code == STORE_RIG;
        let length_fits = usize::from(length) == if has_rig { COMPACT_LENGTH } else { 0 };
        let rest_is_zero = has_rig || payload.iter().all(|byte| *byte == 0);
        if length_fits && rest_is_zero && argument == demand.argument() {
            Ok(demand)
        } else {
            Err(ResultCode::Malformed)
        }
    }
}

/// Writes a request into a transaction's bytes.
pub fn encode_request(
    message: &mut [u8; LINE_SCAN_LENGTH],
    source: SourceId,
    number: u32,
    demand: &Demand<'_>,
) {
    message.fill(0);
    let Some(request) = message.first_chunk_mut::<REQUEST_LENGTH>() else { return };
    let mut writer = Writer::new(request);
    writer.u32(REQUEST_MAGIC);
    writer.u16(SERVICE_VERSION);
    writer.u16(source.get());
    writer.u32(number);
    writer.u16(demand.code());
    let rig = if let Demand::StoreRig { rig } = demand { Some(*rig) } else { None };
    writer.u16(rig.map_or(0, |_| COMPACT_LENGTH_ON_WIRE));
    writer.u32(demand.argument());
    if let Some(rig) = rig {
        writer.bytes(rig);
    }
    wire::seal(request);
}

/// The compact form's length where it is told on the wire.
const COMPACT_LENGTH_ON_WIRE: u16 = 160;
const _: () = assert!(COMPACT_LENGTH == 160);
