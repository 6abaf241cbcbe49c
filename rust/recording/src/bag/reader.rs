use super::message::Message;
use crate::RecordingError;
use rosbag::{ChunkRecord, MessageRecord, RosBag};
use std::{collections::HashMap, io, path::Path};

/// A message in a bag.
#[derive(Clone, Copy, Debug)]
pub struct BagMessage<'a> {
    /// Its topic, as recorded.
    pub topic: &'a str,
    /// Its type, such as `std_msgs/String`.
    pub type_name: &'a str,
    /// When it was recorded, nanoseconds on the recorder's clock.
    pub time_ns: u64,
    bytes: &'a [u8],
}

impl BagMessage<'_> {
    /// The message; none if it is of another type.
    ///
    /// # Errors
    /// [`RecordingError::Encode`] if its bytes are not one message of the type.
    pub fn decode<M: Message>(&self) -> Result<Option<M>, RecordingError> {
        (self.type_name == M::TYPE).then(|| M::from_bytes(self.bytes)).transpose()
    }
}

/// Hands each message of the bag at `path` to `take`, in the order of the file: that of recording. Ends with the first
/// error of `take`. Chunks may be compressed by bz2 or lz4.
///
/// # Errors
/// [`RecordingError::Bag`] for a file that is no bag of format 2.0, or is damaged, or has not been finished;
/// [`RecordingError::Io`]; what `take` says.
pub fn read_bag<E: From<RecordingError>>(
    path: &Path,
    mut take: impl FnMut(&BagMessage<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let io = |source| RecordingError::Io { action: "open", path: path.to_owned(), source };
    let damaged = |reason: &dyn std::fmt::Display| RecordingError::Bag {
        file: path.to_owned(),
        reason: reason.to_string(),
    };
    let bag = RosBag::new(path).map_err(|error| match error.kind() {
        io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => damaged(&error),
        _ => io(error),
    })?;
    let mut connections: HashMap<u32, (String, String)> = HashMap::new();
    for record in bag.chunk_records() {
        let ChunkRecord::Chunk(chunk) = record.map_err(|error| damaged(&error))? else { continue };
        for message in chunk.messages() {
            match message.map_err(|error| damaged(&error))? {
                MessageRecord::Connection(connection) => {
                    let names = (connection.topic.to_owned(), connection.tp.to_owned());
                    connections.insert(connection.id, names);
                }
                MessageRecord::MessageData(data) => {
                    let (topic, type_name) = connections
                        .get(&data.conn_id)
                        .ok_or_else(|| damaged(&format!("no connection has the number {}", data.conn_id)))?;
                    take(&BagMessage { topic, type_name, time_ns: data.time, bytes: data.data })?;
                }
            }
        }
    }
    Ok(())
}
