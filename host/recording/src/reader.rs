//! Reads recordings, whole ones and those that end anywhere.

use std::path::{Path, PathBuf};

use enumset::enum_set;
use mcap::read::Options;
use serde::de::DeserializeOwned;

use crate::RecordingError;
use crate::event::LockStep;
use crate::messages::{
    self, ConfigurationMessage, DecisionMessage, DetectionsMessage, LineScanMessage, LockStepMessage, Log,
    StatusMessage,
};

/// A message, read back.
#[derive(Debug, Clone)]
pub enum Record {
    /// What ran.
    Configuration(ConfigurationMessage),
    /// A line-scan's bytes.
    LineScan(Vec<u8>),
    /// A status's bytes.
    Status(Vec<u8>),
    /// The host's verdict and the relays.
    Decision(DecisionMessage),
    /// Tier 3.
    Detections(DetectionsMessage),
    /// A simulated controller's step.
    LockStep {
        /// Request and reply.
        step: LockStep,
        /// Payload of `power_up`.
        payload: Option<Vec<u8>>,
        /// `exchange`: the last line-scan was its payload.
        with_line_scan: bool,
    },
    /// A JPEG, base64.
    Picture(messages::CompressedImage),
    /// Told in words.
    Log(Log),
}

/// A recording in memory.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    /// Nanoseconds since 1970, and what.
    records: Vec<(u64, Record)>,
    complete: bool,
}

impl Recording {
    /// Reads a file. One that breaks off is read up to there.
    ///
    /// # Errors
    /// It cannot be read, is no recording, or a message in it makes no sense.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let bytes =
            std::fs::read(path).map_err(|source| RecordingError::file(path, "read the recording", source))?;
        let content = |problem: String| RecordingError::Content { path: path.to_path_buf(), problem };
        let (messages, complete) = messages_of(&bytes).map_err(|problem| content(problem.to_string()))?;
        let mut records = Vec::with_capacity(messages.len());
        for message in messages {
            if let Some(record) = record_of(&message).map_err(content)? {
                records.push((message.log_time, record));
            }
        }
        Ok(Self { path: path.to_path_buf(), records, complete })
    }

    /// Of records that come from elsewhere; it has no file.
    #[must_use]
    pub fn of(records: impl IntoIterator<Item = (u64, Record)>) -> Self {
        Self { path: PathBuf::new(), records: records.into_iter().collect(), complete: true }
    }

    /// The file; empty = there is none.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Everything in it, in the order of writing; times in nanoseconds since 1970.
    #[must_use]
    pub fn records(&self) -> &[(u64, Record)] {
        &self.records
    }

    /// Was it ended as it should be?
    #[must_use]
    pub const fn is_complete(&self) -> bool {
        self.complete
    }

    /// What ran; `None` if the file breaks off before that.
    #[must_use]
    pub fn configuration(&self) -> Option<&ConfigurationMessage> {
        self.records.iter().find_map(|(_, record)| match record {
            Record::Configuration(configuration) => Some(configuration),
            _ => None,
        })
    }
}

/// Length of what every MCAP file begins with.
const MAGIC_LENGTH: usize = 8;

/// All whole messages, and whether the file was ended as it should be.
pub(crate) fn messages_of(bytes: &[u8]) -> mcap::McapResult<(Vec<mcap::Message<'static>>, bool)> {
    // Killed before the first bytes were out: nothing was lost that had been written.
    if bytes.len() < MAGIC_LENGTH && mcap::MAGIC.starts_with(bytes) {
        return Ok((Vec::new(), false));
    }
    if !bytes.starts_with(mcap::MAGIC) {
        return Err(mcap::McapError::BadMagic);
    }
    let options = enum_set!(Options::IgnoreEndMagic | Options::ValidateChunkCrcs);
    let mut messages = Vec::new();
    let mut broken = false;
    for message in mcap::MessageStream::new_with_options(bytes, options)? {
        match message {
            Ok(message) => messages.push(message),
            Err(_) => {
                broken = true;
                break;
            }
        }
    }
    let ended = !broken && mcap::Summary::read(bytes).is_ok_and(|summary| summary.is_some());
    Ok((messages, ended))
}

fn json<T: DeserializeOwned>(message: &mcap::Message<'_>) -> Result<T, String> {
    serde_json::from_slice(&message.data)
        .map_err(|problem| format!("a message on {} makes no sense: {problem}", message.channel.topic))
}

fn bytes_of(text: &str, topic: &str) -> Result<Vec<u8>, String> {
    messages::from_text(text).ok_or_else(|| format!("a message on {topic} carries damaged base64"))
}

/// `None` = a topic of somebody else.
fn record_of(message: &mcap::Message<'_>) -> Result<Option<Record>, String> {
    let topic = message.channel.topic.as_str();
    let record = if topic == messages::CONFIGURATION.name {
        Record::Configuration(json(message)?)
    } else if topic == messages::LINE_SCAN.name {
        Record::LineScan(bytes_of(&json::<LineScanMessage>(message)?.wire, topic)?)
    } else if topic == messages::STATUS.name {
        Record::Status(bytes_of(&json::<StatusMessage>(message)?.wire, topic)?)
    } else if topic == messages::DECISION.name {
        Record::Decision(json(message)?)
    } else if topic == messages::DETECTIONS.name {
        Record::Detections(json(message)?)
    } else if topic == messages::CONTROLLER.name {
        let step: LockStepMessage = json(message)?;
        let payload = step.payload.as_deref().map(|text| bytes_of(text, topic)).transpose()?;
        let with_line_scan = step.with_line_scan;
        let step = step.step().ok_or_else(|| format!("a message on {topic} has the wrong length"))?;
        Record::LockStep { step, payload, with_line_scan }
    } else if topic == messages::CAMERA.name {
        Record::Picture(json(message)?)
    } else if topic == messages::LOG.name {
        Record::Log(json(message)?)
    } else {
        return Ok(None);
    };
    Ok(Some(record))
}
