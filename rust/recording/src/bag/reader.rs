use super::{
    messages::RosMessage,
    records::{
        BagRecord, BagRecordError, BagRecordHeader, MAX_RECORD_BYTES, OP_BAG_HEADER, OP_CHUNK, OP_CHUNK_INFO,
        OP_CONNECTION, OP_INDEX, OP_MESSAGE, VERSION_LINE,
    },
};
use crate::{RecordingError, files};
use proact_messages::{MessageType, builtin_type};
use std::{
    collections::{HashMap, hash_map::Entry},
    fmt,
    fs::File,
    io::{BufReader, Read},
    path::Path,
    sync::Arc,
};

/// A message in a bag.
#[derive(Clone, Copy, Debug)]
pub struct BagMessage<'a> {
    /// Its topic, as recorded.
    pub topic: &'a str,
    /// Its type, such as `std_msgs/String`.
    pub type_name: &'a str,
    /// When it was recorded, nanoseconds on the recorder's clock.
    pub time_ns: u64,
    /// The type's definition in the bag, or why it cannot be read: many a bag has topics that nobody asks for.
    message_type: &'a Result<Arc<MessageType>, String>,
    bytes: &'a [u8],
}

impl BagMessage<'_> {
    /// Whether the message has `text` among its bytes: much less work than to decode it.
    pub fn contains_text(&self, text: &str) -> bool {
        self.bytes.windows(text.len()).any(|bytes| bytes == text.as_bytes())
    }

    /// The message; none if it is of another type. The definition in the bag may have fields beyond those of `M`.
    ///
    /// # Errors
    /// [`RecordingError::Encode`] if its bytes are not one message of the type, or it lacks fields.
    pub fn decode<M: RosMessage>(&self) -> Result<Option<M>, RecordingError> {
        if self.type_name != M::TYPE {
            return Ok(None);
        }
        let kind = self.message_type.as_ref().map_err(RecordingError::encode(M::TYPE))?;
        let value = kind.from_bytes(self.bytes).map_err(RecordingError::encode(M::TYPE))?;
        value.into_struct().map(Some).map_err(RecordingError::encode(M::TYPE))
    }
}

/// How a bag ended.
#[derive(Clone, Debug, PartialEq, Eq)]
#[must_use = "a bag that is cut off lacks messages"]
pub enum BagEnd {
    /// As its recorder finished it.
    Complete,
    /// Its recorder was killed, or the file was cut: all whole chunks before were read.
    Truncated {
        /// Byte behind the last whole chunk.
        byte_offset: u64,
        /// Messages before.
        messages: u64,
    },
}

impl fmt::Display for BagEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            BagEnd::Complete => f.write_str("the bag is whole"),
            BagEnd::Truncated { byte_offset: at, messages } => write!(
                f,
                "the bag is cut off at byte {at}, so its recorder was killed or the file was cut; the {messages} messages \
                 before were read. For ROS's own tools mend it with `rosbag reindex`"
            ),
        }
    }
}

/// What is known of a topic in a bag.
struct BagTopic {
    name: String,
    type_name: String,
    message_type: Result<Arc<MessageType>, String>,
}

impl BagTopic {
    /// A connection by its record: the topic's name in the header, the rest in the data.
    fn new(record: &BagRecord) -> Result<Self, String> {
        let header = BagRecordHeader::parse(&record.data)?;
        let type_name = header.text("type")?.to_owned();
        let kind =
            resolve_message_type(&type_name, header.text("md5sum")?, header.text("message_definition")?);
        Ok(BagTopic { name: record.header.text("topic")?.to_owned(), type_name, message_type: kind })
    }
}

/// The type by the definition in the bag, whose checksum tells whether it is one that is known anyway.
fn resolve_message_type(type_name: &str, sum: &str, definition: &str) -> Result<Arc<MessageType>, String> {
    if let Some(known) = builtin_type(type_name).filter(|known| known.md5() == sum) {
        return Ok(known);
    }
    let found = MessageType::from_text(type_name, definition).map_err(|error| error.to_string())?;
    match found.md5() == sum {
        true => Ok(found),
        false => {
            Err(format!("the bag's definition of {} has not the checksum {sum} that it gives", found.name))
        }
    }
}

/// Hands each message of the bag at `path` to `take`, in the order of the file: that of recording. Ends with the first
/// error of `take`. Chunks may be compressed by bz2 or lz4.
///
/// A bag without an index, as a killed recorder leaves it, or one that is cut anywhere is read up to its last whole
/// chunk. Memory: one chunk.
///
/// # Errors
/// [`RecordingError::Bag`] for a file that is no bag of format 2.0, or is damaged; [`RecordingError::Io`]; what `take`
/// says.
pub fn read_bag<E: From<RecordingError>>(
    path: &Path,
    take: impl FnMut(&BagMessage<'_>) -> Result<(), E>,
) -> Result<BagEnd, E> {
    BagReader::open(path)?.read(take)
}

/// As [`read_bag`], in the order of the messages' times. A recorder writes in that order; who copies topic after topic, or sorts otherwise,
/// does not. Of a bag in another order the messages of topics that are `wanted` are in memory at once.
///
/// # Errors
/// As [`read_bag`].
pub fn read_bag_by_time<E: From<RecordingError>>(
    path: &Path,
    wanted: impl Fn(&str) -> bool,
    mut take: impl FnMut(&BagMessage<'_>) -> Result<(), E>,
) -> Result<BagEnd, E> {
    let (mut last, mut in_order) = (0, true);
    let end = read_bag::<E>(path, |message| {
        in_order &= message.time_ns >= last;
        last = message.time_ns;
        Ok(())
    })?;
    if in_order {
        return read_bag(path, take);
    }
    let mut kept = Vec::new();
    let _ = read_bag::<E>(path, |message| {
        if wanted(message.topic) {
            let BagMessage { topic, type_name, time_ns, message_type: kind, bytes } = *message;
            kept.push((time_ns, topic.to_owned(), type_name.to_owned(), kind.clone(), bytes.to_owned()));
        }
        Ok(())
    })?;
    // Messages of one time stay in the order of the file.
    kept.sort_by_key(|(time_ns, ..)| *time_ns);
    for (time_ns, topic, type_name, kind, bytes) in &kept {
        take(&BagMessage { topic, type_name, time_ns: *time_ns, message_type: kind, bytes })?;
    }
    Ok(end)
}

/// A bag that is being read.
struct BagReader<'a> {
    path: &'a Path,
    file: BufReader<File>,
    length: u64,
    remaining_bytes: u64,
    /// Where the index is, and how many connections and chunks it tells of; none if the bag was not finished.
    index: Option<(u64, u32)>,
    topics: HashMap<u32, BagTopic>,
    messages: u64,
}

impl<'a> BagReader<'a> {
    fn open(path: &'a Path) -> Result<Self, RecordingError> {
        let io = |source| RecordingError::Io { action: "open", path: path.to_owned(), source };
        let file = files::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let topics = HashMap::new();
        let mut reader = BagReader {
            path,
            file: BufReader::new(file),
            length,
            remaining_bytes: length,
            index: None,
            topics,
            messages: 0,
        };
        let mut line = [0; VERSION_LINE.len()];
        if length < line.len() as u64 || reader.file.read_exact(&mut line).is_err() || line != VERSION_LINE {
            return Err(reader.damaged(0, "it does not begin as a bag does"));
        }
        reader.remaining_bytes -= line.len() as u64;
        Ok(reader)
    }

    /// The byte that is read next.
    fn position(&self) -> u64 {
        self.length - self.remaining_bytes
    }

    fn damaged(&self, offset: u64, reason: &str) -> RecordingError {
        RecordingError::Bag { file: self.path.to_owned(), reason: format!("at byte {offset}, {reason}") }
    }

    fn read<E: From<RecordingError>>(
        mut self,
        mut take: impl FnMut(&BagMessage<'_>) -> Result<(), E>,
    ) -> Result<BagEnd, E> {
        let mut whole = self.position();
        let (mut chunks, mut chunk_info_count) = (0, 0);
        loop {
            let start = self.position();
            let record = match BagRecord::read(&mut self.file, &mut self.remaining_bytes) {
                Ok(Some(record)) => record,
                Ok(None) | Err(BagRecordError::Truncated) => break,
                Err(BagRecordError::Malformed(reason)) => match self.index {
                    Some(_) => return Err(self.damaged(start, &reason).into()),
                    // What a killed recorder had begun to write.
                    None => break,
                },
                Err(BagRecordError::Io(error)) => {
                    return Err(RecordingError::io("read", self.path)(error).into());
                }
            };
            match self.record(&record, &mut take) {
                Ok(BagRecordKind::BagHeader) => whole = self.position(),
                Ok(BagRecordKind::Chunk) => {
                    chunks += 1;
                    whole = self.position();
                }
                Ok(BagRecordKind::ChunkInfo) => chunk_info_count += 1,
                Ok(BagRecordKind::Other) => {}
                // A recorder writes the size of its chunk when it closes it; until then its messages seem to lie bare.
                Err(RecordFailure::Malformed(_))
                    if self.index.is_none() && start > VERSION_LINE.len() as u64 =>
                {
                    break;
                }
                Err(RecordFailure::Malformed(reason)) => return Err(self.damaged(start, &reason).into()),
                Err(RecordFailure::Callback(error)) => return Err(error),
            }
        }
        let finished = self.index.is_some_and(|(at, expected)| {
            at <= self.length
                && (chunks, chunk_info_count) == (expected, expected)
                && self.remaining_bytes == 0
        });
        Ok(if finished {
            BagEnd::Complete
        } else {
            BagEnd::Truncated { byte_offset: whole, messages: self.messages }
        })
    }

    fn record<E>(
        &mut self,
        record: &BagRecord,
        take: &mut impl FnMut(&BagMessage<'_>) -> Result<(), E>,
    ) -> Result<BagRecordKind, RecordFailure<E>> {
        let op = record.header.op()?;
        match op {
            OP_BAG_HEADER => {
                let (at, chunks) = (record.header.u64("index_pos")?, record.header.u32("chunk_count")?);
                self.index = (at > 0).then_some((at, chunks));
                Ok(BagRecordKind::BagHeader)
            }
            OP_CHUNK => {
                self.chunk(&decompress_chunk(record)?, take)?;
                Ok(BagRecordKind::Chunk)
            }
            OP_INDEX => Ok(BagRecordKind::Other),
            OP_CHUNK_INFO => Ok(BagRecordKind::ChunkInfo),
            OP_CONNECTION if self.index.is_some() => Ok(BagRecordKind::Other),
            _ => Err(RecordFailure::Malformed(format!(
                "there is a record of kind {op}, which has no place there"
            ))),
        }
    }

    fn chunk<E>(
        &mut self,
        mut bytes: &[u8],
        take: &mut impl FnMut(&BagMessage<'_>) -> Result<(), E>,
    ) -> Result<(), RecordFailure<E>> {
        let mut left = bytes.len() as u64;
        let mut records = Vec::new();
        // The whole chunk first: of one that is damaged no message is handed on.
        loop {
            match BagRecord::read(&mut bytes, &mut left) {
                Ok(Some(record)) => records.push(record),
                Ok(None) => break,
                Err(BagRecordError::Malformed(reason)) => return Err(RecordFailure::Malformed(reason)),
                Err(BagRecordError::Truncated | BagRecordError::Io(_)) => {
                    return Err(RecordFailure::Malformed("a chunk ends within a record".to_owned()));
                }
            }
        }
        for record in records {
            let id = record.header.u32("conn")?;
            match record.header.op()? {
                OP_CONNECTION => {
                    if let Entry::Vacant(entry) = self.topics.entry(id) {
                        entry.insert(BagTopic::new(&record)?);
                    }
                }
                OP_MESSAGE => {
                    let BagTopic { name: topic, type_name, message_type: kind } =
                        self.topics.get(&id).ok_or_else(|| format!("no connection has the number {id}"))?;
                    let time_ns = record.header.time_ns("time")?;
                    self.messages += 1;
                    take(&BagMessage { topic, type_name, time_ns, message_type: kind, bytes: &record.data })
                        .map_err(RecordFailure::Callback)?;
                }
                op => return Err(RecordFailure::Malformed(format!("a chunk holds a record of kind {op}"))),
            }
        }
        Ok(())
    }
}

/// What a record was.
enum BagRecordKind {
    BagHeader,
    Chunk,
    ChunkInfo,
    Other,
}

/// Why a record was not taken.
enum RecordFailure<E> {
    Malformed(String),
    Callback(E),
}

impl<E> From<String> for RecordFailure<E> {
    fn from(reason: String) -> Self {
        RecordFailure::Malformed(reason)
    }
}

/// The content of a chunk.
fn decompress_chunk(record: &BagRecord) -> Result<Vec<u8>, String> {
    let size = u64::from(record.header.u32("size")?);
    if size > u64::from(MAX_RECORD_BYTES) {
        return Err(format!("a chunk has {size} bytes, expected at most {MAX_RECORD_BYTES}"));
    }
    let kind = record.header.text("compression")?;
    let data = record.data.as_slice();
    let mut content = Vec::new();
    // One byte more than announced tells that there is more.
    let read = match kind {
        "none" => data.take(size + 1).read_to_end(&mut content),
        "bz2" => bzip2::read::BzDecoder::new(data).take(size + 1).read_to_end(&mut content),
        "lz4" => lz4_flex::frame::FrameDecoder::new(data).take(size + 1).read_to_end(&mut content),
        other => return Err(format!("a chunk is compressed by {other:?}, expected none, bz2 or lz4")),
    };
    read.map_err(|error| format!("a chunk cannot be decompressed by {kind}: {error}"))?;
    match content.len() as u64 == size {
        true => Ok(content),
        false => Err(format!("a chunk has {} bytes, its header says {size}", content.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bag::messages::Bool;

    fn decode((sum, definition): (&str, &str), bytes: &[u8]) -> Result<Option<Bool>, RecordingError> {
        let kind = resolve_message_type("std_msgs/Bool", sum, definition);
        BagMessage { topic: "/a", type_name: "std_msgs/Bool", time_ns: 0, message_type: &kind, bytes }
            .decode()
    }

    #[test]
    fn a_message_is_read_by_the_definition_in_its_bag() {
        let usual = builtin_type("std_msgs/Bool").unwrap();
        let definition = (usual.md5(), "");
        assert_eq!(decode(definition, &[1]).unwrap(), Some(Bool { data: true }));
        assert!(decode(definition, &[1, 0]).unwrap_err().to_string().contains("left over"));
        assert!(decode(definition, &[]).unwrap_err().to_string().contains("missing"));

        let text = "uint8 sure # a lab's own\nbool data\n";
        let labs = MessageType::from_text("std_msgs/Bool", text).unwrap();
        assert_eq!(decode((labs.md5(), text), &[7, 1]).unwrap(), Some(Bool { data: true }));
        let other = MessageType::from_text("std_msgs/Bool", "bool value").unwrap();
        let error = decode((other.md5(), "bool value"), &[1]).unwrap_err().to_string();
        assert!(error.contains("`data`"), "{error}");
    }

    #[test]
    fn a_definition_that_is_damaged_is_an_error_only_where_somebody_asks() {
        let usual = builtin_type("std_msgs/Bool").unwrap();
        for (sum, definition, part) in [
            (usual.md5().replace('8', "9"), "bool data", "checksum"),
            ("0".repeat(32), "Nothing data", "std_msgs/Nothing"),
        ] {
            let kind = resolve_message_type("std_msgs/Bool", &sum, definition);
            let message =
                BagMessage { topic: "/a", type_name: "a/B", time_ns: 0, message_type: &kind, bytes: &[] };
            assert_eq!(message.decode::<Bool>().unwrap(), None, "of another type");
            let error = decode((&sum, definition), &[1]).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
