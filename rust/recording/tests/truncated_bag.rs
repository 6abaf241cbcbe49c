//! Bags that are cut, of recorders that were killed, and compressed ones, beside ROS's own tools.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use proact_recording::{
    RecordingError,
    bag::{BagEnd, BagWriter, Time, messages::Text, read_bag},
};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

/// Messages between two chunks.
const PER_CHUNK: u32 = 10;
const CHUNKS: u32 = 12;

fn message(number: u32) -> Text {
    Text { data: format!("message {number}") }
}

fn write(bag: &mut BagWriter) {
    for number in 0..PER_CHUNK * CHUNKS {
        let time = Time { secs: 1000 + number, nsecs: 5 };
        let topic = if number % 2 == 0 { "/even" } else { "/odd" };
        bag.write(topic, time, &message(number), false).unwrap();
        if (number + 1) % PER_CHUNK == 0 {
            bag.flush().unwrap();
        }
    }
}

fn finished(dir: &Path) -> PathBuf {
    let mut bag = BagWriter::create(&dir.join("whole.bag")).unwrap();
    write(&mut bag);
    bag.finish().unwrap()
}

/// The texts in the bag, which are checked to be the first ones, and how it ends.
fn read(path: &Path) -> Result<(u32, BagEnd), RecordingError> {
    let mut number = 0;
    let end = read_bag(path, |found| -> Result<(), RecordingError> {
        assert_eq!(found.decode::<Text>()?, Some(message(number)));
        assert_eq!(found.time_ns, u64::from(1000 + number) * 1_000_000_000 + 5);
        assert_eq!(found.topic, if number % 2 == 0 { "/even" } else { "/odd" });
        number += 1;
        Ok(())
    })?;
    Ok((number, end))
}

#[test]
fn a_bag_cut_anywhere_is_read_up_to_its_last_whole_chunk() {
    let temp_dir = tempfile::tempdir().unwrap();
    let whole = finished(temp_dir.path());
    let bytes = fs::read(&whole).unwrap();
    assert_eq!(read(&whole).unwrap(), (PER_CHUNK * CHUNKS, BagEnd::Complete));

    let cut = temp_dir.path().join("cut.bag");
    let mut last = 0;
    for length in (0..bytes.len()).step_by(7).chain(bytes.len() - 300..bytes.len()) {
        fs::write(&cut, &bytes[..length]).unwrap();
        match read(&cut) {
            Ok((messages, BagEnd::Truncated { byte_offset: at, messages: reported_count })) => {
                assert_eq!(u64::from(messages), reported_count, "cut at {length}");
                assert!(
                    messages.is_multiple_of(PER_CHUNK) && messages >= last.min(messages),
                    "cut at {length}"
                );
                assert!(at <= length as u64, "cut at {length}: {at}");
                last = messages;
            }
            Err(RecordingError::Bag { .. }) if length < 13 => {}
            other => panic!("cut at {length}: {other:?}"),
        }
    }
    assert_eq!(last, PER_CHUNK * CHUNKS);
    let (_, end) = read(&cut).unwrap();
    assert!(end.to_string().contains("rosbag reindex"), "{end}");
}

#[test]
fn the_bag_of_a_killed_recorder_is_read_and_rosbag_reindex_finds_the_same() {
    let temp_dir = tempfile::tempdir().unwrap();
    let mut bag = BagWriter::create(&temp_dir.path().join("trial.bag")).unwrap();
    write(&mut bag);
    // One more that is in memory only.
    bag.write("/even", Time { secs: 1, nsecs: 0 }, &message(0), false).unwrap();
    std::mem::forget(bag);
    let active = temp_dir.path().join("trial.bag.active");
    let length = fs::metadata(&active).unwrap().len();
    let all = PER_CHUNK * CHUNKS;
    let (messages, end) = read(&active).unwrap();
    assert_eq!(messages, all);
    assert!(
        matches!(end, BagEnd::Truncated { byte_offset, messages } if byte_offset < length && messages == u64::from(all)),
        "{end:?}"
    );

    let mut reindex = Command::new("/usr/bin/rosbag");
    match reindex.args(["reindex", "--output-dir"]).arg(temp_dir.path()).arg(&active).output() {
        Ok(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            // The original stays beside it as .orig.
            let (messages, end) = read(&active).unwrap();
            assert_eq!((messages, end), (all, BagEnd::Complete));
        }
        Err(_) => println!("skipped: python3-rosbag is not installed (sudo apt install python3-rosbag)"),
    }
}

/// A recorder of ROS writes the size of a chunk when it closes it: killed before, it leaves a chunk of size zero with bare
/// messages behind.
#[test]
fn a_chunk_that_ros_had_only_begun_is_left_out() {
    let temp_dir = tempfile::tempdir().unwrap();
    let whole = finished(temp_dir.path());
    let bytes = fs::read(&whole).unwrap();
    let chunk =
        bytes.windows(4).enumerate().filter(|(_, w)| w == b"op=\x05").map(|(at, _)| at).nth(2).unwrap();
    // The record begins four bytes before its header, and "op=" is behind the field's own length.
    let start = chunk - 8;
    let header = u32::from_le_bytes(bytes[start..start + 4].try_into().unwrap()) as usize;
    let data = start + 4 + header;
    let mut open = bytes[..data + 4].to_vec();
    let size = open[start..].windows(5).position(|w| w == b"size=").unwrap() + start + 5;
    open[size..size + 4].fill(0);
    open[data..data + 4].fill(0);
    open.extend(&bytes[data + 4..data + 200]);
    // Not finished: the first record says that there is no index.
    let index = open.windows(10).position(|w| w == b"index_pos=").unwrap() + 10;
    open[index..index + 8].fill(0);
    let path = temp_dir.path().join("ros.bag.active");
    fs::write(&path, open).unwrap();
    let (messages, end) = read(&path).unwrap();
    assert_eq!(messages, 2 * PER_CHUNK);
    assert!(matches!(end, BagEnd::Truncated { .. }));
}

#[test]
fn what_is_no_bag_and_what_is_damaged_is_refused_with_the_byte() {
    let temp_dir = tempfile::tempdir().unwrap();
    let path = temp_dir.path().join("some.bag");
    fs::write(&path, "#ROSBAG V1.2\n").unwrap();
    assert!(read(&path).unwrap_err().to_string().contains("does not begin as a bag does"));
    assert!(matches!(read(Path::new("/dev/zero")), Err(RecordingError::Io { .. })));
    assert!(matches!(read(&temp_dir.path().join("none.bag")), Err(RecordingError::Io { .. })));

    let bytes = fs::read(finished(temp_dir.path())).unwrap();
    for (what, from, to, part) in [
        ("a size that is another", b"size=".as_slice(), b"size=\x01".as_slice(), "its header says"),
        ("a compression that is none", b"compression=none", b"compression=nine", "expected none, bz2 or lz4"),
        ("a bomb", b"size=", b"size=\xff\xff\xff\xff", "expected at most"),
        ("text as bz2", b"\x10\0\0\0compression=none", b"\x0f\0\0\0compression=bz2\0", ""),
    ] {
        let at = bytes.windows(from.len()).position(|w| w == from).unwrap();
        let mut bad = bytes.clone();
        bad[at..at + to.len()].copy_from_slice(to);
        fs::write(&path, bad).unwrap();
        match read(&path) {
            Err(RecordingError::Bag { reason, .. }) => {
                assert!(reason.starts_with("at byte 4117"), "{what}: {reason}");
                assert!(reason.contains(part), "{what}: {reason}");
            }
            other => panic!("{what}: {other:?}"),
        }
    }
}

#[test]
fn chunks_that_rosbag_compressed_are_read() {
    let temp_dir = tempfile::tempdir().unwrap();
    let whole = finished(temp_dir.path());
    for kind in ["bz2", "lz4"] {
        let other = temp_dir.path().join(format!("{kind}.bag"));
        fs::copy(&whole, &other).unwrap();
        let mut compress = Command::new("/usr/bin/rosbag");
        match compress.args(["compress", &format!("--{kind}"), "-q"]).arg(&other).output() {
            Ok(output) if output.status.success() => {
                let bytes = fs::read(&other).unwrap();
                let name = format!("compression={kind}");
                assert!(bytes.windows(name.len()).any(|w| w == name.as_bytes()));
                assert_eq!(read(&other).unwrap(), (PER_CHUNK * CHUNKS, BagEnd::Complete), "{kind}");
            }
            Ok(output) => panic!("{kind}: {}", String::from_utf8_lossy(&output.stderr)),
            Err(_) => println!("skipped: python3-rosbag is not installed (sudo apt install python3-rosbag)"),
        }
    }
}
