//! Completes recordings that a crash cut off: everything that is whole is kept, and the file gets its index and its end, so that
//! programs that insist on them open it, too.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::RecordingError;
use crate::folder::Folder;
use crate::messages::TOPICS;
use crate::reader::messages_of;
use crate::segment::Segment;

/// Completes every recording in the folder that has no end; tells which. One that cannot be completed stays as it is.
///
/// # Errors
/// The folder cannot be read.
pub fn complete_all(folder: &Folder) -> Result<Vec<PathBuf>, RecordingError> {
    let entries = folder
        .entries()
        .map_err(|source| RecordingError::file(folder.path(), "read the folder of recordings", source))?;
    let paths = entries.iter().map(|entry| folder.path().join(&entry.name));
    Ok(paths.filter(|path| complete(path).unwrap_or(false)).collect())
}

/// Completes one; `false` = it was whole.
///
/// # Errors
/// It cannot be read or written.
pub fn complete(path: &Path) -> Result<bool, RecordingError> {
    // The end is looked at first: most files are whole, and large.
    let bytes =
        std::fs::read(path).map_err(|source| RecordingError::file(path, "read the recording", source))?;
    if mcap::Summary::read(&bytes).is_ok_and(|summary| summary.is_some()) {
        return Ok(false);
    }
    let content = |problem: mcap::McapError| RecordingError::Content {
        path: path.to_path_buf(),
        problem: problem.to_string(),
    };
    let (messages, _) = messages_of(&bytes).map_err(content)?;
    let beside = path.with_extension("completing");
    let output = File::create(&beside)
        .map_err(|source| RecordingError::file(&beside, "write the completed recording", source))?;
    let mut segment = Segment::begin(Box::new(output)).map_err(content)?;
    for message in &messages {
        if let Some(topic) = TOPICS.iter().find(|topic| topic.name == message.channel.topic) {
            segment.write_bytes(topic, message.log_time, &message.data).map_err(content)?;
        }
    }
    segment.finish().map_err(content)?;
    // Either the old file or the new one is there, never a half of each.
    std::fs::rename(&beside, path)
        .map_err(|source| RecordingError::file(path, "replace the recording", source))?;
    Ok(true)
}
