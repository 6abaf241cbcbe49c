use super::messages::Message;
use crate::RecordingError;
use proact_messages::{MessageType, known_type};
use rosbag::{ChunkRecord, MessageRecord, RosBag, record_types::Connection};
use std::{collections::HashMap, io, path::Path, sync::Arc};

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
    kind: &'a Result<Arc<MessageType>, String>,
    bytes: &'a [u8],
}

impl BagMessage<'_> {
    /// The message; none if it is of another type. The definition in the bag may have fields beyond those of `M`.
    ///
    /// # Errors
    /// [`RecordingError::Encode`] if its bytes are not one message of the type, or it lacks fields.
    pub fn decode<M: Message>(&self) -> Result<Option<M>, RecordingError> {
        if self.type_name != M::TYPE {
            return Ok(None);
        }
        let kind = self.kind.as_ref().map_err(RecordingError::encode(M::TYPE))?;
        let value = kind.from_bytes(self.bytes).map_err(RecordingError::encode(M::TYPE))?;
        value.into_struct().map(Some).map_err(RecordingError::encode(M::TYPE))
    }
}

/// What is known of a topic in a bag.
struct Topic {
    name: String,
    type_name: String,
    kind: Result<Arc<MessageType>, String>,
}

impl Topic {
    fn new(connection: &Connection<'_>) -> Self {
        let (name, type_name) = (connection.topic.to_owned(), connection.tp.to_owned());
        Topic { name, type_name, kind: kind_of(connection) }
    }
}

/// The type by the definition in the bag, whose checksum tells whether it is one that is known anyway.
fn kind_of(connection: &Connection<'_>) -> Result<Arc<MessageType>, String> {
    let sum: String = connection.md5sum.iter().map(|byte| format!("{byte:02x}")).collect();
    if let Some(known) = known_type(connection.tp).filter(|known| known.md5() == sum) {
        return Ok(known);
    }
    let text = MessageType::from_text(connection.tp, connection.message_definition);
    let found = text.map_err(|error| error.to_string())?;
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
    let mut topics: HashMap<u32, Topic> = HashMap::new();
    for record in bag.chunk_records() {
        let ChunkRecord::Chunk(chunk) = record.map_err(|error| damaged(&error))? else { continue };
        for message in chunk.messages() {
            match message.map_err(|error| damaged(&error))? {
                MessageRecord::Connection(connection) => {
                    topics.entry(connection.id).or_insert_with(|| Topic::new(&connection));
                }
                MessageRecord::MessageData(data) => {
                    let Topic { name: topic, type_name, kind } = topics
                        .get(&data.conn_id)
                        .ok_or_else(|| damaged(&format!("no connection has the number {}", data.conn_id)))?;
                    take(&BagMessage { topic, type_name, time_ns: data.time, kind, bytes: data.data })?;
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bag::messages::Bool;

    fn connection<'a>(sum: &str, definition: &'a str) -> Connection<'a> {
        let byte = |at: usize| u8::from_str_radix(&sum[2 * at..2 * at + 2], 16).unwrap();
        Connection {
            id: 0,
            storage_topic: "/a",
            topic: "/a",
            tp: "std_msgs/Bool",
            md5sum: std::array::from_fn(byte),
            message_definition: definition,
            caller_id: "",
            latching: false,
        }
    }

    fn decode(connection: &Connection<'_>, bytes: &[u8]) -> Result<Option<Bool>, RecordingError> {
        let kind = kind_of(connection);
        BagMessage { topic: "/a", type_name: "std_msgs/Bool", time_ns: 0, kind: &kind, bytes }.decode()
    }

    #[test]
    fn a_message_is_read_by_the_definition_in_its_bag() {
        let usual = known_type("std_msgs/Bool").unwrap();
        let told = connection(usual.md5(), "");
        assert_eq!(decode(&told, &[1]).unwrap(), Some(Bool { data: true }));
        assert!(decode(&told, &[1, 0]).unwrap_err().to_string().contains("left over"));
        assert!(decode(&told, &[]).unwrap_err().to_string().contains("missing"));

        let text = "uint8 sure # a lab's own\nbool data\n";
        let labs = MessageType::from_text("std_msgs/Bool", text).unwrap();
        assert_eq!(decode(&connection(labs.md5(), text), &[7, 1]).unwrap(), Some(Bool { data: true }));
        let other = MessageType::from_text("std_msgs/Bool", "bool value").unwrap();
        let error = decode(&connection(other.md5(), "bool value"), &[1]).unwrap_err().to_string();
        assert!(error.contains("`data`"), "{error}");
    }

    #[test]
    fn a_definition_that_is_damaged_is_an_error_only_where_somebody_asks() {
        let usual = known_type("std_msgs/Bool").unwrap();
        for (sum, definition, part) in [
            (usual.md5().replace('8', "9"), "bool data", "checksum"),
            ("0".repeat(32), "Nothing data", "std_msgs/Nothing"),
        ] {
            let kind = kind_of(&connection(&sum, definition));
            let message = BagMessage { topic: "/a", type_name: "a/B", time_ns: 0, kind: &kind, bytes: &[] };
            assert_eq!(message.decode::<Bool>().unwrap(), None, "of another type");
            let error = decode(&connection(&sum, definition), &[1]).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
