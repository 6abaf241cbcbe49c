use super::{
    messages::RosMessage,
    records::{
        OP_BAG_HEADER, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION, OP_INDEX, VERSION_LINE, encode_time,
        encode_u32, put_field, put_message_header, put_record, to_u32,
    },
};
use crate::RecordingError;
use lz4_flex::frame::{BlockMode, BlockSize, FrameEncoder, FrameInfo};
use proact_messages::{MessageType, Time, builtin_type};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::Arc,
};

/// Size of the bag header's fields and padding together. It is written again in place at the end, and not only
/// here: `rosbag reindex` and appending write it anew with this size, over what follows if ours were smaller.
const BAG_HEADER_BYTES: usize = 4096;
/// A chunk is closed when it has grown to this size: rosbag's default, and the bound on memory.
const CHUNK_BYTES: usize = 768 * 1024;

/// One topic of the bag.
#[derive(Debug)]
struct BagConnection {
    /// The record, which is repeated in the index section.
    record: Vec<u8>,
    message_type: Arc<MessageType>,
    /// Time and offset of each message in the open chunk.
    index: Vec<(Time, u32)>,
}

/// What the index section says of a chunk.
#[derive(Debug)]
struct ChunkInfo {
    position: u64,
    start: Time,
    end: Time,
    /// Connection and number of its messages.
    counts: Vec<(u32, u32)>,
}

/// Writes a ROS 1 bag, format 2.0, chunks not compressed unless [`BagWriter::enable_compression`] says so.
///
/// Until [`BagWriter::finish`] the file has `.active` after its name, as with `rosbag record`. If the process
/// ends before, [`read_bag`](super::read_bag) reads what came before the last [`BagWriter::flush`], and `rosbag reindex`
/// recovers it. Memory: one chunk, plus some bytes for each chunk written.
#[derive(Debug)]
pub struct BagWriter {
    file: File,
    path: PathBuf,
    active: PathBuf,
    position: u64,
    chunk: Vec<u8>,
    compression_enabled: bool,
    connections: Vec<BagConnection>,
    by_topic: BTreeMap<String, usize>,
    chunks: Vec<ChunkInfo>,
}

impl BagWriter {
    /// Starts the bag `path`, under the name `path.active`.
    ///
    /// # Errors
    /// [`RecordingError::Io`] if one of the two names is taken or cannot be written.
    pub fn create(path: &Path) -> Result<Self, RecordingError> {
        let mut active = path.as_os_str().to_owned();
        active.push(".active");
        let active = PathBuf::from(active);
        if path.exists() {
            let taken = std::io::ErrorKind::AlreadyExists.into();
            return Err(RecordingError::io("create", path)(taken));
        }
        let file = File::create_new(&active).map_err(RecordingError::io("create", &active))?;
        let mut bag = BagWriter {
            file,
            path: path.to_owned(),
            active,
            position: 0,
            chunk: Vec::new(),
            compression_enabled: false,
            connections: Vec::new(),
            by_topic: BTreeMap::new(),
            chunks: Vec::new(),
        };
        bag.write_bytes(VERSION_LINE)?;
        bag.write_bytes(&bag_header(0, 0, 0))?;
        Ok(bag)
    }

    /// Compresses the chunks that are closed from now on by LZ4, as `rosbag compress --lz4` does.
    pub fn enable_compression(&mut self) {
        self.compression_enabled = true;
    }

    /// Appends a message. A topic is declared by its first message; `latched` is then noted with it.
    ///
    /// Times need not ascend, but readers are quickest when they do.
    ///
    /// # Errors
    /// [`RecordingError::WrongType`] if the topic carries another type; [`RecordingError::Encode`] if the struct is not
    /// what its definition says; [`RecordingError::Io`].
    pub fn write<M: RosMessage>(
        &mut self,
        topic: &str,
        time: Time,
        message: &M,
        latched: bool,
    ) -> Result<(), RecordingError> {
        let id = match self.by_topic.get(topic) {
            Some(id) => *id,
            None => {
                let kind = builtin_type(M::TYPE).ok_or("it is not in the codec's table");
                self.connect(topic, kind.map_err(RecordingError::encode(M::TYPE))?, latched)
            }
        };
        let connection = &mut self.connections[id];
        if connection.message_type.name != M::TYPE {
            return Err(RecordingError::WrongType {
                topic: topic.to_owned(),
                got: M::TYPE,
                expected: connection.message_type.name.clone(),
            });
        }
        // Straight into the chunk, where the message's length comes to stand before it.
        let offset = self.chunk.len();
        put_message_header(&mut self.chunk, to_u32(id), time);
        let start = self.chunk.len();
        if let Err(error) = connection.message_type.write(message, &mut self.chunk) {
            self.chunk.truncate(offset);
            return Err(RecordingError::encode(M::TYPE)(error));
        }
        let length = to_u32(self.chunk.len() - start);
        self.chunk[start - 4..start].copy_from_slice(&length.to_le_bytes());
        connection.index.push((time, to_u32(offset)));
        if self.chunk.len() >= CHUNK_BYTES {
            self.close_chunk()?;
        }
        Ok(())
    }

    /// Closes the open chunk, so that all messages so far are in the file, whole.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.close_chunk()
    }

    /// The file, for whoever hands it to the disk from time to time.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn file(&self) -> Result<File, RecordingError> {
        self.file.try_clone().map_err(RecordingError::io("open once more", &self.active))
    }

    /// Completes the bag and gives it its name.
    ///
    /// # Errors
    /// [`RecordingError::Io`]; the file then keeps its `.active` name.
    pub fn finish(mut self) -> Result<PathBuf, RecordingError> {
        self.close_chunk()?;
        let index_position = self.position;
        let mut index = Vec::new();
        for connection in &self.connections {
            index.extend_from_slice(&connection.record);
        }
        for chunk in &self.chunks {
            chunk.put_record(&mut index);
        }
        self.write_bytes(&index)?;
        let header = bag_header(index_position, to_u32(self.connections.len()), to_u32(self.chunks.len()));
        self.file
            .seek(SeekFrom::Start(VERSION_LINE.len() as u64))
            .and_then(|_| self.file.write_all(&header))
            .and_then(|()| self.file.sync_all())
            .map_err(RecordingError::io("write to", &self.active))?;
        fs::rename(&self.active, &self.path).map_err(RecordingError::io("create", &self.path))?;
        Ok(self.path)
    }

    /// Declares a topic, in the open chunk.
    fn connect(&mut self, topic: &str, kind: Arc<MessageType>, latched: bool) -> usize {
        let id = self.connections.len();
        let mut header = Vec::new();
        put_field(&mut header, "topic", topic.as_bytes());
        put_field(&mut header, "type", kind.name.as_bytes());
        put_field(&mut header, "md5sum", kind.md5().as_bytes());
        put_field(&mut header, "message_definition", kind.full_text().as_bytes());
        put_field(&mut header, "callerid", b"/proact");
        put_field(&mut header, "latching", if latched { b"1" } else { b"0" });
        let fields = [
            ("op", vec![OP_CONNECTION]),
            ("conn", encode_u32(to_u32(id))),
            ("topic", topic.as_bytes().to_vec()),
        ];
        let mut record = Vec::new();
        put_record(&mut record, &fields, &header);
        self.chunk.extend_from_slice(&record);
        self.connections.push(BagConnection { record, message_type: kind, index: Vec::new() });
        self.by_topic.insert(topic.to_owned(), id);
        id
    }

    /// Writes the open chunk and its index records to the file.
    fn close_chunk(&mut self) -> Result<(), RecordingError> {
        let mut index = Vec::new();
        let mut info = ChunkInfo {
            position: self.position,
            start: Time::default(),
            end: Time::default(),
            counts: Vec::new(),
        };
        let times = || self.connections.iter().flat_map(|c| c.index.iter().map(|(time, _)| *time));
        let (Some(start), Some(end)) = (times().min(), times().max()) else {
            return Ok(());
        };
        (info.start, info.end) = (start, end);
        for (id, connection) in self.connections.iter_mut().enumerate().filter(|(_, c)| !c.index.is_empty()) {
            // Readers look times up by bisection. The sort is stable: equal times keep their order.
            connection.index.sort_by_key(|(time, _)| *time);
            let mut entries = Vec::with_capacity(12 * connection.index.len());
            for (time, offset) in &connection.index {
                entries.extend_from_slice(&encode_time(*time));
                entries.extend_from_slice(&offset.to_le_bytes());
            }
            let (id, messages) = (to_u32(id), to_u32(connection.index.len()));
            let fields = [
                ("op", vec![OP_INDEX]),
                ("ver", encode_u32(1)),
                ("conn", encode_u32(id)),
                ("count", encode_u32(messages)),
            ];
            put_record(&mut index, &fields, &entries);
            info.counts.push((id, messages));
            connection.index.clear();
        }
        let packed = if self.compression_enabled { Some(self.compress_chunk()?) } else { None };
        let (compression, data) = packed.as_ref().map_or((&b"none"[..], &self.chunk), |data| (b"lz4", data));
        let mut chunk = Vec::with_capacity(data.len() + 64 + index.len());
        let fields = [
            ("op", vec![OP_CHUNK]),
            ("compression", compression.to_vec()),
            ("size", encode_u32(to_u32(self.chunk.len()))),
        ];
        put_record(&mut chunk, &fields, data);
        self.chunk.clear();
        self.chunks.push(info);
        chunk.extend_from_slice(&index);
        self.write_bytes(&chunk)
    }

    /// The open chunk as an LZ4 frame. ROS reads frames of independent blocks alone.
    fn compress_chunk(&self) -> Result<Vec<u8>, RecordingError> {
        let frame = FrameInfo::new()
            .block_size(BlockSize::Max1MB)
            .block_mode(BlockMode::Independent)
            .content_checksum(true);
        let failed = |error: std::io::Error| RecordingError::io("compress", &self.active)(error);
        let mut encoder = FrameEncoder::with_frame_info(frame, Vec::new());
        encoder.write_all(&self.chunk).map_err(failed)?;
        encoder.finish().map_err(|error| failed(error.into()))
    }

    fn write_bytes(&mut self, bytes: &[u8]) -> Result<(), RecordingError> {
        self.file.write_all(bytes).map_err(RecordingError::io("write to", &self.active))?;
        self.position += bytes.len() as u64;
        Ok(())
    }
}

impl ChunkInfo {
    fn put_record(&self, out: &mut Vec<u8>) {
        let mut counts = Vec::new();
        for (connection, messages) in &self.counts {
            counts.extend(connection.to_le_bytes());
            counts.extend(messages.to_le_bytes());
        }
        let fields = [
            ("op", vec![OP_CHUNK_INFO]),
            ("ver", encode_u32(1)),
            ("chunk_pos", self.position.to_le_bytes().to_vec()),
            ("start_time", encode_time(self.start).to_vec()),
            ("end_time", encode_time(self.end).to_vec()),
            ("count", encode_u32(to_u32(self.counts.len()))),
        ];
        put_record(out, &fields, &counts);
    }
}

/// The first record: where the index is, padded with blanks to its fixed size.
fn bag_header(index_position: u64, connections: u32, chunks: u32) -> Vec<u8> {
    let fields = [
        ("op", vec![OP_BAG_HEADER]),
        ("index_pos", index_position.to_le_bytes().to_vec()),
        ("conn_count", encode_u32(connections)),
        ("chunk_count", encode_u32(chunks)),
    ];
    let mut bare = Vec::new();
    put_record(&mut bare, &fields, &[]);
    let mut record = Vec::new();
    // The two lengths of a record, four bytes each, do not count.
    let field_bytes = bare.len() - 8;
    put_record(&mut record, &fields, &vec![b' '; BAG_HEADER_BYTES - field_bytes]);
    record
}
