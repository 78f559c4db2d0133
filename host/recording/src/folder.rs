//! The folder of recordings: names, total size, and who gives way.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::RecordingError;

/// Where segments are written. A folder in earnest, anything in tests.
pub trait Store: Send {
    /// A new file.
    ///
    /// # Errors
    /// The system refuses.
    fn create(&mut self, name: &str) -> std::io::Result<Box<dyn Output>>;

    /// Deletes the oldest files, but never `keep`, until all together have at most `limit` bytes.
    ///
    /// # Errors
    /// The system refuses.
    fn make_room(&mut self, limit: u64, keep: &str) -> std::io::Result<()>;

    /// Bytes that the disk still takes; `None` = unknown.
    fn free(&self) -> Option<u64>;
}

/// A file that is written.
pub trait Output: Write + Send {
    /// Onto the disk.
    ///
    /// # Errors
    /// The system refuses.
    fn sync(&mut self) -> std::io::Result<()>;
}

impl Output for File {
    fn sync(&mut self) -> std::io::Result<()> {
        self.sync_data()
    }
}

/// A recording as it lies in the folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// The file's name.
    pub name: String,
    /// Bytes.
    pub length: u64,
}

/// A folder on disk.
#[derive(Debug, Clone)]
pub struct Folder {
    path: PathBuf,
}

/// What every recording's name ends with.
pub const EXTENSION: &str = ".mcap";

impl Folder {
    /// Makes it if it is not there.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        std::fs::create_dir_all(path)
            .map_err(|source| RecordingError::file(path, "make the folder of recordings", source))?;
        Ok(Self { path: path.to_path_buf() })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// All recordings, oldest first: their names begin with the module and the time.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn entries(&self) -> std::io::Result<Vec<Entry>> {
        let mut entries = Vec::new();
        for entry in std::fs::read_dir(&self.path)? {
            let entry = entry?;
            let Ok(name) = entry.file_name().into_string() else { continue };
            // A file that somebody deletes meanwhile is none.
            let Ok(about) = entry.metadata() else { continue };
            if is_recording_name(&name) && about.is_file() {
                entries.push(Entry { name, length: about.len() });
            }
        }
        entries.sort_by(|one, other| age_key(&one.name).cmp(age_key(&other.name)));
        Ok(entries)
    }
}

/// Does a file's name look like one of ours? Nothing else is ever touched or handed out.
#[must_use]
pub fn is_recording_name(name: &str) -> bool {
    let sound = |byte: u8| byte.is_ascii_alphanumeric() || b"-_".contains(&byte);
    name.strip_suffix(EXTENSION).is_some_and(|stem| !stem.is_empty() && stem.bytes().all(sound))
}

/// Name of a run's segment: `MODULE-TIME-NNNN.mcap`.
#[must_use]
pub fn segment_name(module: &str, run: &str, segment: u32) -> String {
    let time: String = run.chars().filter(char::is_ascii_alphanumeric).collect();
    format!("{module}-{time}-{segment:04}{EXTENSION}")
}

/// Time and segment: modules that share a folder are ordered by time, not by name.
fn age_key(name: &str) -> &str {
    name.split_once('-').map_or(name, |(_, rest)| rest)
}

impl Store for Folder {
    fn create(&mut self, name: &str) -> std::io::Result<Box<dyn Output>> {
        Ok(Box::new(File::create_new(self.path.join(name))?))
    }

    fn make_room(&mut self, limit: u64, keep: &str) -> std::io::Result<()> {
        let entries = self.entries()?;
        let mut total: u64 = entries.iter().map(|entry| entry.length).sum();
        for entry in entries.iter().filter(|entry| entry.name != keep) {
            if total <= limit {
                break;
            }
            std::fs::remove_file(self.path.join(&entry.name))?;
            total = total.saturating_sub(entry.length);
        }
        Ok(())
    }

    fn free(&self) -> Option<u64> {
        let about = rustix::fs::statvfs(&self.path).ok()?;
        Some(about.f_bavail.saturating_mul(about.f_frsize))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_oldest_give_way_and_nothing_else_is_touched() {
        let place = tempfile::tempdir().unwrap();
        let mut folder = Folder::open(&place.path().join("deep/er")).unwrap();
        let runs = ["2026-01-02T00:00:00Z", "2026-01-01T00:00:00Z", "2026-01-03T00:00:00Z"];
        for (module, run) in ["alpha", "beta", "alpha"].into_iter().zip(runs) {
            folder.create(&segment_name(module, run, 0)).unwrap().write_all(&[0; 100]).unwrap();
        }
        std::fs::write(folder.path().join("diary.txt"), [0; 1000]).unwrap();
        let names = |folder: &Folder| -> Vec<String> {
            folder.entries().unwrap().into_iter().map(|entry| entry.name).collect()
        };
        let [middle, oldest, newest] = [
            "alpha-20260102T000000Z-0000.mcap",
            "beta-20260101T000000Z-0000.mcap",
            "alpha-20260103T000000Z-0000.mcap",
        ];
        assert_eq!(names(&folder), [oldest, middle, newest]);
        folder.make_room(300, newest).unwrap();
        assert_eq!(names(&folder).len(), 3, "300 bytes fit into 300");
        folder.make_room(299, newest).unwrap();
        assert_eq!(names(&folder), [middle, newest]);
        folder.make_room(0, newest).unwrap();
        assert_eq!(names(&folder), [newest], "the one that is written stays");
        assert!(folder.path().join("diary.txt").exists());
        assert!(folder.create(newest).is_err(), "a recording is never written over");
        assert!(folder.free().unwrap() > 0);
    }

    #[test]
    fn names_that_lead_elsewhere_are_no_recordings() {
        for name in [
            "../a.mcap",
            "a/b.mcap",
            ".mcap",
            "a.mcap.txt",
            "a b.mcap",
            "ä.mcap",
            "",
            "a.b.mcap",
            "a\\b.mcap",
        ] {
            assert!(!is_recording_name(name), "{name}");
        }
        assert!(is_recording_name("front-20260102T000000Z-0012.mcap"));
    }
}
