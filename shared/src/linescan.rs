//! The line-scan: what the host sends to the MCU for every camera frame.
//!
//! Little-endian, always [`LINE_SCAN_LENGTH`] bytes (one SPI transaction with a fixed DMA length):
//!
//! | offset | field |
//! |---|---|
//! | 0 | magic `NFLS` |
//! | 4 | version u16 (3) |
//! | 6 | source id u16 |
//! | 8 | calibration id u32 |
//! | 12 | sequence number u32 |
//! | 16 | age of the picture at sending, by the host's clock, microseconds u32 |
//! | 20 | exposure, microseconds u32 |
//! | 24 | number of the last status received u32 (proves on the MCU's clock that the message is not older) |
//! | 28 | host verdict u16 |
//! | 30 | columns u16 |
//! | 32 | audit windows u16 |
//! | 34 | ambient light u8: mean brightness beside the stripe |
//! | 35 | saturated u8: share of the columns whose stripe is clipped, 255 = all |
//! | 36 | 4 run-over claims, 8 bytes each, see [`crate::run_over`]; zeros = none |
//! | 68 | 1152 rows, Q12.4 u16 each, 0xFFFF = no stripe |
//! | 2372 | 1152 signal qualities u8 |
//! | 3524 | 64 brightnesses u16, 1/256 of a step of [the light signal](crate::light): the stripe over its background, one for each 64th of the columns; 0 = no stripe there |
//! | 3652 | 8 audit windows: column u16, first row u16, 32 pixels u8 of the light signal |
//! | 3940 | CRC-32 (see [`crate::wire`]) of all before |
//!
//! Unused columns and windows are zero. Raw bytes become a checked [`LineScan`] or an error that says which rule was
//! broken; nothing of a refused message is used.

use crate::light::{BrightnessProfile, LIGHT_BLOCKS};
use crate::limits::{LARGEST_COLUMN_COUNT, LARGEST_TRANSFER};
use crate::monitor::ColumnReading;
use crate::run_over::{CLAIM_LENGTH, Claim, Claims, LARGEST_CLAIM_COUNT, NO_CLAIMS};
use crate::units::{CalibrationId, Micros, SequenceNumber, SignalQuality, SourceId, SubpixelRow};
use crate::wire::{self, Reader, SEAL_LENGTH, Writer};

/// `NFLS`, little-endian.
pub const LINE_SCAN_MAGIC: u32 = 0x534C_464E;
/// Version of the format.
pub const LINE_SCAN_VERSION: u16 = 3;
/// Audit windows that fit.
pub const LARGEST_AUDIT_COUNT: usize = 8;
/// Pixels of an audit window.
pub const AUDIT_PIXELS: usize = 32;
const HEADER_LENGTH: usize = 36 + LARGEST_CLAIM_COUNT * CLAIM_LENGTH;
const ROWS_LENGTH: usize = 2 * LARGEST_COLUMN_COUNT;
const BRIGHTNESS_LENGTH: usize = 2 * LIGHT_BLOCKS;
const AUDIT_LENGTH: usize = 4 + AUDIT_PIXELS;
/// Length of every line-scan in bytes.
pub const LINE_SCAN_LENGTH: usize = HEADER_LENGTH
    + ROWS_LENGTH
    + LARGEST_COLUMN_COUNT
    + BRIGHTNESS_LENGTH
    + LARGEST_AUDIT_COUNT * AUDIT_LENGTH
    + SEAL_LENGTH;
const _: () = assert!(LINE_SCAN_LENGTH <= LARGEST_TRANSFER, "a line-scan must fit one SPI transaction");

/// What the host makes of the scene. It can only make the MCU more careful. The codes differ in at least seven bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostVerdict {
    /// The host sees no reason to stop.
    Clear,
    /// The host asks for a warning, not for a stop.
    Warn,
    /// The host asks for a stop.
    Stop,
}

impl HostVerdict {
    const fn code(self) -> u16 {
        match self {
            Self::Clear => 0x3C5A,
            Self::Warn => 0x5AA5,
            Self::Stop => 0xA5C3,
        }
    }

    fn from_code(code: u16) -> Option<Self> {
        [Self::Clear, Self::Warn, Self::Stop].into_iter().find(|verdict| verdict.code() == code)
    }
}

/// The line-scan's fixed fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineScanHeader {
    /// The module that sends.
    pub source: SourceId,
    /// The rig that the host uses.
    pub calibration: CalibrationId,
    /// Counts the messages.
    pub sequence: SequenceNumber,
    /// Age of the picture when the message was sent, by the host's clock: from the middle of the exposure.
    pub capture_age: Micros,
    /// Exposure time.
    pub exposure: Micros,
    /// Number of the last status that the host had received when it sent this.
    pub last_status: u32,
    /// What the host makes of the scene.
    pub verdict: HostVerdict,
    /// Mean brightness beside the stripe, 255 = white.
    pub ambient: u8,
    /// Share of the columns whose stripe is clipped, 255 = all.
    pub saturated: u8,
    /// What tier 3 says lies on the stripe. Alone it permits nothing.
    pub claims: Claims,
}

/// One column on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineScanColumn {
    /// Row of the stripe.
    pub row: SubpixelRow,
    /// How well it is seen.
    pub quality: SignalQuality,
}

impl LineScanColumn {
    /// No stripe in this column.
    pub const MISSING: Self = Self { row: SubpixelRow::NONE, quality: SignalQuality::NONE };
}

/// Raw pixels around the stripe in one column, pooled over the column's image columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AuditWindow {
    /// Column of the line-scan.
    pub column: u16,
    /// Image row of the first pixel.
    pub first_row: u16,
    /// The light signal (see [`crate::light`]), row by row.
    pub pixels: [u8; AUDIT_PIXELS],
}

/// Why a line-scan was refused; the first broken rule, in the order of checks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineScanError {
    /// Not [`LINE_SCAN_LENGTH`] bytes.
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

impl core::fmt::Display for LineScanError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Length => "line-scan of the wrong length",
            Self::Corrupted => "line-scan damaged (CRC)",
            Self::Magic => "not a line-scan",
            Self::Version => "line-scan of another version",
            Self::Field => "line-scan with an impossible field",
        })
    }
}

impl core::error::Error for LineScanError {}

/// A checked line-scan over the bytes that arrived.
#[derive(Debug, Clone, Copy)]
pub struct LineScan<'a> {
    header: LineScanHeader,
    rows: &'a [u8],
    qualities: &'a [u8],
    brightness: &'a [u8],
    audit: &'a [u8],
}

impl<'a> LineScan<'a> {
    /// Checks length, CRC, magic, version and fields, in this order.
    ///
    /// # Errors
    /// The first rule that is broken.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, LineScanError> {
        if bytes.len() != LINE_SCAN_LENGTH {
            return Err(LineScanError::Length);
        }
        if !wire::is_sealed(bytes) {
            return Err(LineScanError::Corrupted);
        }
        let mut reader = Reader::new(bytes);
        if reader.u32() != Some(LINE_SCAN_MAGIC) {
            return Err(LineScanError::Magic);
        }
        if reader.u16() != Some(LINE_SCAN_VERSION) {
            return Err(LineScanError::Version);
        }
        Self::parse_fields(&mut reader).ok_or(LineScanError::Field)
    }

    fn parse_fields(reader: &mut Reader<'a>) -> Option<Self> {
        let source = SourceId::new(reader.u16()?);
        let calibration = CalibrationId::new(reader.u32()?);
        let sequence = SequenceNumber::new(reader.u32()?);
        let capture_age = Micros::new(u64::from(reader.u32()?));
        let exposure = Micros::new(u64::from(reader.u32()?));
        let last_status = reader.u32()?;
        let verdict = HostVerdict::from_code(reader.u16()?)?;
        let columns = usize::from(reader.u16()?);
        let audits = usize::from(reader.u16()?);
        let (ambient, saturated) = (reader.u8()?, reader.u8()?);
        let mut claims = NO_CLAIMS;
        for claim in &mut claims {
            *claim = Claim::read(reader)?;
        }
        if columns == 0 || columns > LARGEST_COLUMN_COUNT || audits > LARGEST_AUDIT_COUNT {
            return None;
        }
        let rows = reader.slice(ROWS_LENGTH)?.get(..columns.saturating_mul(2))?;
        let qualities = reader.slice(LARGEST_COLUMN_COUNT)?.get(..columns)?;
        let brightness = reader.slice(BRIGHTNESS_LENGTH)?;
        let audit = reader
            .slice(LARGEST_AUDIT_COUNT.saturating_mul(AUDIT_LENGTH))?
            .get(..audits.saturating_mul(AUDIT_LENGTH))?;
        let header = LineScanHeader {
            source,
            calibration,
            sequence,
            capture_age,
            exposure,
            last_status,
            verdict,
            ambient,
            saturated,
            claims,
        };
        Some(Self { header, rows, qualities, brightness, audit })
    }

    /// The fixed fields.
    #[must_use]
    pub const fn header(&self) -> &LineScanHeader {
        &self.header
    }

    /// How many columns it has.
    #[must_use]
    pub const fn column_count(&self) -> usize {
        self.qualities.len()
    }

    /// Its columns as readings for the monitor.
    pub fn readings(&self) -> impl Iterator<Item = ColumnReading> + use<'a> {
        self.columns().map(|column| ColumnReading {
            row: column.row.to_pixels().unwrap_or(f32::NAN),
            quality: column.quality,
        })
    }

    /// Its columns as they are on the wire.
    pub fn columns(&self) -> impl Iterator<Item = LineScanColumn> + use<'a> {
        let (rows, _) = self.rows.as_chunks::<2>();
        rows.iter().zip(self.qualities).map(|(row, quality)| LineScanColumn {
            row: SubpixelRow::from_raw(u16::from_le_bytes(*row)),
            quality: SignalQuality::new(*quality),
        })
    }

    /// One of its columns as it is on the wire; [`LineScanColumn::MISSING`] beyond the last.
    #[must_use]
    pub fn column(&self, column: u16) -> LineScanColumn {
        let index = usize::from(column);
        let (rows, _) = self.rows.as_chunks::<2>();
        match (rows.get(index), self.qualities.get(index)) {
            (Some(row), Some(quality)) => LineScanColumn {
                row: SubpixelRow::from_raw(u16::from_le_bytes(*row)),
                quality: SignalQuality::new(*quality),
            },
            _ => LineScanColumn::MISSING,
        }
    }

    /// How bright the stripe is along its length.
    #[must_use]
    pub fn brightness(&self) -> BrightnessProfile {
        let (values, _) = self.brightness.as_chunks::<2>();
        let mut profile = BrightnessProfile::DARK;
        for (block, value) in profile.blocks.iter_mut().zip(values) {
            *block = u16::from_le_bytes(*value);
        }
        profile
    }

    /// Its audit windows.
    pub fn audit_windows(&self) -> impl Iterator<Item = AuditWindow> + use<'a> {
        let (windows, _) = self.audit.as_chunks::<AUDIT_LENGTH>();
        windows.iter().filter_map(|window| {
            let mut reader = Reader::new(window);
            let (column, first_row) = (reader.u16()?, reader.u16()?);
            let pixels = *reader.slice(AUDIT_PIXELS)?.first_chunk::<AUDIT_PIXELS>()?;
            Some(AuditWindow { column, first_row, pixels })
        })
    }
}

/// Writes a line-scan; columns and windows beyond what fits are refused.
///
/// # Errors
/// [`LineScanError::Field`] if there are no columns, or too many columns or windows; `message` is then left unsealed.
pub fn encode(
    message: &mut [u8; LINE_SCAN_LENGTH],
    header: &LineScanHeader,
    columns: &[LineScanColumn],
    brightness: &BrightnessProfile,
    audit: &[AuditWindow],
) -> Result<(), LineScanError> {
    message.fill(0);
    let (Ok(column_count), Ok(audit_count)) = (u16::try_from(columns.len()), u16::try_from(audit.len()))
    else {
        return Err(LineScanError::Field);
    };
    if columns.is_empty() || columns.len() > LARGEST_COLUMN_COUNT || audit.len() > LARGEST_AUDIT_COUNT {
        return Err(LineScanError::Field);
    }
    let mut writer = Writer::new(message);
    writer.u32(LINE_SCAN_MAGIC);
    writer.u16(LINE_SCAN_VERSION);
    writer.u16(header.source.get());
    writer.u32(header.calibration.get());
    writer.u32(header.sequence.get());
    writer.u32(header.capture_age.to_wire());
    writer.u32(header.exposure.to_wire());
    writer.u32(header.last_status);
    writer.u16(header.verdict.code());
    writer.u16(column_count);
    writer.u16(audit_count);
    writer.u8(header.ambient);
    writer.u8(header.saturated);
    for claim in &header.claims {
        Claim::write(claim.as_ref(), &mut writer);
    }
    for column in columns {
        writer.u16(column.row.raw());
    }
    writer.skip(ROWS_LENGTH.saturating_sub(columns.len().saturating_mul(2)));
    for column in columns {
        writer.u8(column.quality.get());
    }
    writer.skip(LARGEST_COLUMN_COUNT.saturating_sub(columns.len()));
    for block in brightness.blocks {
        writer.u16(block);
    }
    for window in audit {
        writer.u16(window.column);
        writer.u16(window.first_row);
        writer.bytes(&window.pixels);
    }
    wire::seal(message);
    Ok(())
}

#[cfg(test)]
mod tests;
