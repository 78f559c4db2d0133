//! One MCAP file that is being written.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{WriteOptions, Writer};
use serde::Serialize;

use crate::folder::Output;
use crate::messages::{TOPICS, Topic};

/// The output, shared with the MCAP writer so that it can be synced.
#[derive(Clone)]
struct Shared(Arc<Mutex<Box<dyn Output>>>);

impl Shared {
    fn lock(&self) -> std::sync::MutexGuard<'_, Box<dyn Output>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.lock().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.lock().flush()
    }
}

/// See the module's documentation.
pub struct Segment {
    writer: Writer<NoSeek<Shared>>,
    output: Shared,
    /// By topic's name.
    channels: BTreeMap<&'static str, u16>,
    sequence: u32,
    /// Bytes of messages so far.
    bytes: u64,
}

/// Larger ones are closed before a second is over: what a crash loses is never much.
const CHUNK_BYTES: u64 = 512 * 1024;
/// Bytes that a message costs beside its content.
const MESSAGE_OVERHEAD: u64 = 31;

impl Segment {
    /// Begins a file: header, schemas, channels.
    ///
    /// # Errors
    /// The output refuses.
    pub fn begin(output: Box<dyn Output>) -> mcap::McapResult<Self> {
        let output = Shared(Arc::new(Mutex::new(output)));
        let compression = cfg!(feature = "compression").then(compression).flatten();
        // Without seeking a chunk is put together in memory and written whole.
        let options = WriteOptions::new()
            .library(concat!("nearfield ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            .disable_seeking(true)
            .chunk_size(Some(CHUNK_BYTES));
        let mut writer = options.create(NoSeek::new(output.clone()))?;
        let mut channels = BTreeMap::new();
        for topic in TOPICS {
            let schema = writer.add_schema(topic.schema, "jsonschema", topic.text.as_bytes())?;
            channels.insert(topic.name, writer.add_channel(schema, topic.name, "json", &BTreeMap::new())?);
        }
        Ok(Self { writer, output, channels, sequence: 0, bytes: 0 })
    }

    /// One message; `time` in nanoseconds since 1970.
    ///
    /// # Errors
    /// The output refuses.
    pub fn write(&mut self, topic: &Topic, time: u64, message: &impl Serialize) -> mcap::McapResult<()> {
        let data = serde_json::to_vec(message).map_err(std::io::Error::from)?;
        self.write_bytes(topic, time, &data)
    }

    /// As [`Self::write`], with a message that is JSON already.
    pub fn write_bytes(&mut self, topic: &Topic, time: u64, data: &[u8]) -> mcap::McapResult<()> {
        let Some(channel_id) = self.channels.get(topic.name).copied() else { return Ok(()) };
        self.sequence = self.sequence.wrapping_add(1);
        let header =
            MessageHeader { channel_id, sequence: self.sequence, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, data)?;
        self.bytes += data.len() as u64 + MESSAGE_OVERHEAD;
        Ok(())
    }

    /// Bytes of messages so far.
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Closes the chunk: a reader sees everything up to here, whatever happens.
    ///
    /// # Errors
    /// The output refuses.
    pub fn flush(&mut self) -> mcap::McapResult<()> {
        self.writer.flush()
    }

    /// ... and onto the disk: it survives a power cut, too.
    ///
    /// # Errors
    /// The output refuses.
    pub fn sync(&mut self) -> mcap::McapResult<()> {
        self.flush()?;
        Ok(self.output.lock().sync()?)
    }

    /// Index and end.
    ///
    /// # Errors
    /// The output refuses.
    pub fn finish(mut self) -> mcap::McapResult<()> {
        self.writer.finish()?;
        Ok(self.output.lock().sync()?)
    }
}

#[cfg(feature = "compression")]
fn compression() -> Option<mcap::Compression> {
    Some(mcap::Compression::Lz4)
}

#[cfg(not(feature = "compression"))]
const fn compression() -> Option<mcap::Compression> {
    None
}
