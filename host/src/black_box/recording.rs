//! A fetched stop, and the file that keeps it.
//!
//! The file (`.nfbb`), little-endian:
//!
//! | offset | field |
//! |---|---|
//! | 0 | magic `NFBB` |
//! | 4 | version u16 (1), zero u16 |
//! | 8 | number of summaries u16, of line-scans u16, of fault entries u16, zero u16 |
//! | 16 | length of one line-scan u32, zero u32 |
//! | 24 | the rig's compact form, 160 bytes; zeros = none was stored |
//! | 184 | the stop's index, 40 bytes ([`StopIndex`]) |
//! | 224 | summaries, 64 bytes each ([`Summary`]), oldest first |
//! | ... | line-scans as the controller received them, oldest first |
//! | ... | fault entries, 32 bytes each ([`FaultEntry`]), oldest first |
//! | end | CRC-32 (see [`nearfield_shared::wire`]) of all before |

use std::path::{Path, PathBuf};

use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::rig::{COMPACT_LENGTH, CompactRigError, Rig};
use nearfield_shared::service::{
    FAULT_ENTRY_LENGTH, FaultEntry, STOP_INDEX_LENGTH, SUMMARY_LENGTH, StopIndex, Summary,
};
use nearfield_shared::wire::{checksum, is_sealed};

use super::client::Transaction;

const MAGIC: [u8; 4] = *b"NFBB";
/// Version of the file.
pub const RECORDING_VERSION: u16 = 1;
const HEADER_LENGTH: usize = 24;
const SEAL_LENGTH: usize = 4;

/// Everything about one stop.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The compact form of the rig that the controller has stored.
    pub rig: Option<[u8; COMPACT_LENGTH]>,
    /// What the controller says about the stop.
    pub index: StopIndex,
    /// Exchange by exchange, oldest first; the first `index.summaries_before` up to the stop.
    pub summaries: Vec<Summary>,
    /// Line-scans as they came, oldest first; the first `index.scans_before` up to the stop.
    pub scans: Vec<Box<Transaction>>,
    /// The fault log, oldest first.
    pub faults: Vec<FaultEntry>,
}

/// Why a file is no recording, or could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The system refuses.
    #[error("{}: cannot {action} the recording: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What was to be done.
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The content.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: ContentError,
    },
}

/// What is wrong with a recording's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ContentError {
    /// Another kind of file.
    #[error("no recording of a stop (`nearfield blackbox fetch` writes them)")]
    NotARecording,
    /// Another version.
    #[error("a recording of version {0}; this program reads version {RECORDING_VERSION}")]
    Version(u16),
    /// Cut short or with something appended.
    #[error("{found} bytes long where its head says {expected}; it was cut short or changed")]
    Length {
        /// As its head says.
        expected: usize,
        /// As it is.
        found: usize,
    },
    /// The CRC does not match.
    #[error("damaged (CRC)")]
    Damaged,
    /// Line-scans of another length than this program knows.
    #[error("line-scans of {0} bytes; this program knows those of {LINE_SCAN_LENGTH}")]
    LineScans(u32),
    /// A part that is not what it should be.
    #[error("intact, but its {0} makes no sense")]
    Part(&'static str),
}

impl Recording {
    /// The rig, checked.
    ///
    /// # Errors
    /// Why the stored bytes are no rig.
    pub fn rig(&self) -> Result<Rig, CompactRigError> {
        Rig::from_bytes(self.rig.as_ref().map_or(&[], |rig| rig.as_slice()))
    }

    /// The file's bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::from(MAGIC);
        for field in
            [RECORDING_VERSION, 0, count(&self.summaries), count(&self.scans), count(&self.faults), 0]
        {
            bytes.extend(field.to_le_bytes());
        }
        bytes.extend((LINE_SCAN_LENGTH as u32).to_le_bytes());
        bytes.extend([0; 4]);
        bytes.extend(self.rig.unwrap_or([0; COMPACT_LENGTH]));
        bytes.extend(self.index.to_bytes());
        bytes.extend(self.summaries.iter().flat_map(Summary::to_bytes));
        bytes.extend(self.scans.iter().flat_map(|scan| scan.iter()));
        bytes.extend(self.faults.iter().flat_map(FaultEntry::to_bytes));
        let seal = checksum(&bytes);
        bytes.extend(seal.to_le_bytes());
        bytes
    }

    /// Reads a file's bytes.
    ///
    /// # Errors
    /// The first thing that is wrong: magic, version, length, CRC, then the parts.
    pub fn parse(bytes: &[u8]) -> Result<Self, ContentError> {
        let (head, _) = bytes.split_first_chunk::<HEADER_LENGTH>().ok_or(ContentError::NotARecording)?;
        if !head.starts_with(&MAGIC) {
            return Err(ContentError::NotARecording);
        }
        let field = |at: usize| u16::from_le_bytes([head[at], head[at + 1]]);
        if field(4) != RECORDING_VERSION {
            return Err(ContentError::Version(field(4)));
        }
        let scan_length = u32::from_le_bytes([head[16], head[17], head[18], head[19]]);
        if scan_length as usize != LINE_SCAN_LENGTH {
            return Err(ContentError::LineScans(scan_length));
        }
        let [summaries, scans, faults] = [8, 10, 12].map(|at| usize::from(field(at)));
        let lengths = [
            HEADER_LENGTH,
            COMPACT_LENGTH,
            STOP_INDEX_LENGTH,
            summaries * SUMMARY_LENGTH,
            scans * LINE_SCAN_LENGTH,
            faults * FAULT_ENTRY_LENGTH,
        ];
        let expected = lengths.iter().sum::<usize>() + SEAL_LENGTH;
        if bytes.len() != expected {
            return Err(ContentError::Length { expected, found: bytes.len() });
        }
        if !is_sealed(bytes) {
            return Err(ContentError::Damaged);
        }
        if [field(6), field(14), field(20), field(22)] != [0; 4] {
            return Err(ContentError::Part("head"));
        }
        let mut rest = bytes;
        Self::parse_parts(lengths.map(|length| {
            let (part, after) = rest.split_at(length);
            rest = after;
            part
        }))
    }

    fn parse_parts([_, rig, index, summaries, scans, faults]: [&[u8]; 6]) -> Result<Self, ContentError> {
        let rig = <[u8; COMPACT_LENGTH]>::try_from(rig).map_err(|_| ContentError::Part("rig"))?;
        let index = StopIndex::parse(index).ok_or(ContentError::Part("index"))?;
        let (records, _) = summaries.as_chunks::<SUMMARY_LENGTH>();
        let summaries: Vec<_> = records
            .iter()
            .map(Summary::parse)
            .collect::<Option<_>>()
            .ok_or(ContentError::Part("list of summaries"))?;
        let (scans, _) = scans.as_chunks::<LINE_SCAN_LENGTH>();
        let scans: Vec<_> = scans.iter().map(|scan| Box::new(*scan)).collect();
        let faults = faults
            .chunks(FAULT_ENTRY_LENGTH)
            .map(FaultEntry::parse)
            .collect::<Option<_>>()
            .ok_or(ContentError::Part("fault log"))?;
        if summaries.len() != usize::from(index.summaries) || scans.len() != usize::from(index.scans) {
            return Err(ContentError::Part("number of records"));
        }
        let rig = Some(rig).filter(|rig| *rig != [0; COMPACT_LENGTH]);
        Ok(Self { rig, index, summaries, scans, faults })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// See [`RecordingError`]; the message names the file.
    pub fn load(path: &Path) -> Result<Self, RecordingError> {
        let bytes = std::fs::read(path).map_err(|source| RecordingError::File {
            path: path.to_path_buf(),
            action: "read",
            source,
        })?;
        Self::parse(&bytes).map_err(|problem| RecordingError::Content { path: path.to_path_buf(), problem })
    }

    /// Writes a file.
    ///
    /// # Errors
    /// See [`RecordingError`]; the message names the file.
    pub fn save(&self, path: &Path) -> Result<(), RecordingError> {
        std::fs::write(path, self.to_bytes()).map_err(|source| RecordingError::File {
            path: path.to_path_buf(),
            action: "write",
            source,
        })
    }
}

/// A controller keeps at most 64 of anything.
fn count<T>(records: &[T]) -> u16 {
    u16::try_from(records.len()).unwrap_or(u16::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::black_box::testing::{recording_of_a_box, rig};

    fn resealed(mut bytes: Vec<u8>) -> Vec<u8> {
        let end = bytes.len() - SEAL_LENGTH;
        let seal = checksum(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&seal);
        bytes
    }

    #[test]
    fn what_is_written_is_read_back() {
        let recording = recording_of_a_box();
        assert_eq!(recording.rig().unwrap(), Rig::from_bytes(&rig().to_bytes()).unwrap());
        assert_eq!(Recording::parse(&recording.to_bytes()), Ok(recording.clone()));
        let bare = Recording { rig: None, faults: Vec::new(), ..recording };
        assert_eq!(Recording::parse(&bare.to_bytes()), Ok(bare.clone()));
        assert!(bare.rig().is_err());
    }

    #[test]
    fn every_damage_is_refused_with_its_reason() {
        let good = recording_of_a_box().to_bytes();
        assert_eq!(Recording::parse(b""), Err(ContentError::NotARecording));
        assert_eq!(
            Recording::parse(b"\x89PNG and so on, for more than 24 bytes"),
            Err(ContentError::NotARecording)
        );
        let length = good.len();
        for cut in [24, 100, length - 1] {
            let expected = ContentError::Length { expected: length, found: cut };
            assert_eq!(Recording::parse(&good[..cut]), Err(expected));
        }
        for at in (0..length).step_by(97) {
            let mut bad = good.clone();
            bad[at] ^= 4;
            assert!(Recording::parse(&bad).is_err(), "byte {at}");
        }
        let with = |at: usize, value: u8| {
            let mut bad = good.clone();
            bad[at] = value;
            Recording::parse(&resealed(bad)).unwrap_err()
        };
        assert_eq!(with(4, 2), ContentError::Version(2));
        assert!(matches!(with(16, 1), ContentError::LineScans(_)));
        for at in [6, 14, 20, 22] {
            assert_eq!(with(at, 1), ContentError::Part("head"), "byte {at}");
        }
        assert_eq!(with(184 + 39, 1), ContentError::Part("index"));
        assert_eq!(with(224 + 21, 9), ContentError::Part("list of summaries"));
        assert_eq!(with(184 + 28, 2), ContentError::Part("index"), "fewer line-scans than before the stop");
        assert_eq!(with(length - 4 - 8, 0), ContentError::Part("fault log"));
    }

    #[test]
    fn a_files_errors_name_the_file() {
        let missing = Recording::load(Path::new("/nonexistent/stop.nfbb")).unwrap_err().to_string();
        assert!(missing.contains("/nonexistent/stop.nfbb") && missing.contains("read"), "{missing}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stop.nfbb");
        let recording = recording_of_a_box();
        recording.save(&path).unwrap();
        assert_eq!(Recording::load(&path).unwrap(), recording);
        std::fs::write(&path, b"hello, this is a text of more than 24 bytes").unwrap();
        let wrong = Recording::load(&path).unwrap_err().to_string();
        assert!(wrong.contains("stop.nfbb") && wrong.contains("no recording"), "{wrong}");
        assert!(recording.save(folder.path()).unwrap_err().to_string().contains("cannot write"));
    }
}
