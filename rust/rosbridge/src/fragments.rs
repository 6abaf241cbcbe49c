//! Long messages in pieces: `{"op":"fragment","id":..,"data":..,"num":..,"total":..}`, both ways.

use serde_json::{Value as Json, json};
use std::{
    collections::HashMap,
    time::{Duration, Instant},
};

/// Messages that one client may send in pieces at the same time.
const MAX_PARTIAL_MESSAGES: usize = 32;
/// Most pieces of a message.
const MAX_FRAGMENTS: usize = 65_536;
/// Most bytes of all unfinished messages of one client.
const MAX_BYTES: usize = 8 * 1024 * 1024;
/// A message whose next piece does not come for so long is given up.
const MAX_AGE: Duration = Duration::from_secs(30);

/// The pieces that a client has sent so far, in any order and of several messages at a time.
#[derive(Default)]
pub(crate) struct FragmentedMessages {
    partial: HashMap<String, PartialMessage>,
    bytes: usize,
}

struct PartialMessage {
    fragments: Vec<Option<String>>,
    missing: usize,
    bytes: usize,
    last_received: Instant,
}

impl FragmentedMessages {
    /// Takes one piece; the whole message once nothing is missing.
    ///
    /// # Errors
    /// One sentence. The message that the piece belongs to is given up.
    pub(crate) fn add(
        &mut self,
        id: &str,
        number: usize,
        total: usize,
        data: String,
        now: Instant,
    ) -> Result<Option<String>, String> {
        self.expire(now);
        if total == 0 || total > MAX_FRAGMENTS || number >= total {
            self.remove(id);
            return Err(format!(
                "piece {number} of {total}, expected a number below a total of 1 to {MAX_FRAGMENTS}"
            ));
        }
        if self.partial.get(id).is_some_and(|open| open.fragments.len() != total) {
            self.remove(id);
            return Err(format!("the pieces of message {id:?} do not agree on their total, got {total} now"));
        }
        if self.bytes + data.len() > MAX_BYTES {
            self.remove(id);
            return Err(format!("unfinished messages hold more than {MAX_BYTES} bytes; finish some first"));
        }
        if !self.partial.contains_key(id) && self.partial.len() == MAX_PARTIAL_MESSAGES {
            return Err(format!("{MAX_PARTIAL_MESSAGES} messages are unfinished; finish some first"));
        }
        let open = self.partial.entry(id.to_owned()).or_insert_with(|| PartialMessage {
            fragments: vec![None; total],
            missing: total,
            bytes: 0,
            last_received: now,
        });
        open.last_received = now;
        // A piece that comes twice replaces the first.
        self.bytes += data.len();
        open.bytes += data.len();
        match open.fragments[number].replace(data) {
            Some(old) => {
                self.bytes -= old.len();
                open.bytes -= old.len();
            }
            None => open.missing -= 1,
        }
        if open.missing > 0 {
            return Ok(None);
        }
        Ok(self.remove(id).map(|open| open.fragments.into_iter().flatten().collect()))
    }

    fn remove(&mut self, id: &str) -> Option<PartialMessage> {
        let open = self.partial.remove(id)?;
        self.bytes -= open.bytes;
        Some(open)
    }

    /// Gives up what has stood still for too long.
    fn expire(&mut self, now: Instant) {
        let stale: Vec<String> = self
            .partial
            .iter()
            .filter(|(_, open)| now.duration_since(open.last_received) > MAX_AGE)
            .map(|(id, _)| id.clone())
            .collect();
        for id in stale {
            self.remove(&id);
        }
    }
}

/// A text in pieces of at most `size` bytes, cut between characters; as it is if it is short enough. A piece holds
/// at least one character, and a message has at most 65,536 pieces, whatever the size asked for.
pub(crate) fn split(text: &str, size: usize, id: u64) -> Option<Vec<String>> {
    if text.len() <= size {
        return None;
    }
    let size = size.max(text.len().div_ceil(MAX_FRAGMENTS / 2)).max(4);
    let mut pieces = Vec::new();
    let mut rest = text;
    while !rest.is_empty() {
        let max_length = size.min(rest.len());
        let end = (0..=max_length).rev().find(|end| rest.is_char_boundary(*end)).unwrap_or(rest.len());
        let (piece, after) = rest.split_at(end);
        pieces.push(piece);
        rest = after;
    }
    let total = pieces.len();
    let envelope = |(num, data): (usize, &str)| -> Json {
        json!({"op": "fragment", "id": id.to_string(), "data": data, "num": num, "total": total})
    };
    Some(pieces.into_iter().enumerate().map(|piece| envelope(piece).to_string()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn feed(fragments: &mut FragmentedMessages, piece: &str) -> Result<Option<String>, String> {
        let json: Json = serde_json::from_str(piece).unwrap();
        let number = |name: &str| json[name].as_u64().unwrap() as usize;
        let (id, data) = (json["id"].as_str().unwrap(), json["data"].as_str().unwrap().to_owned());
        fragments.add(id, number("num"), number("total"), data, Instant::now())
    }

    proptest! {
        #[test]
        fn pieces_of_several_messages_in_any_order_give_the_messages_back(
            texts in prop::collection::vec("\\PC{1,200}", 1..5),
            size in 1usize..50,
            seed in any::<u64>(),
        ) {
            let mut pieces: Vec<(usize, String)> = Vec::new();
            for (n, text) in texts.iter().enumerate() {
                match split(text, size, n as u64) {
                    Some(split) => pieces.extend(split.into_iter().map(|piece| (n, piece))),
                    None => prop_assert!(text.len() <= size),
                }
            }
            // A shuffle that depends on the seed alone.
            let key = |piece: &str| piece.bytes().fold(seed, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
            pieces.sort_by_key(|(_, piece)| key(piece));
            let mut fragments = FragmentedMessages::default();
            let mut whole = vec![None; texts.len()];
            for (n, piece) in &pieces {
                if let Some(text) = feed(&mut fragments, piece).unwrap() {
                    whole[*n] = Some(text);
                }
            }
            for (n, text) in texts.iter().enumerate().filter(|(_, text)| text.len() > size) {
                prop_assert_eq!(whole[n].as_ref(), Some(text));
            }
            prop_assert_eq!(fragments.bytes, 0);
            prop_assert!(fragments.partial.is_empty());
        }
    }

    #[test]
    fn nonsense_is_refused_and_leaves_nothing_behind() {
        let mut fragments = FragmentedMessages::default();
        let now = Instant::now();
        let mut take = |number, total, data: &str| fragments.add("a", number, total, data.to_owned(), now);
        assert!(take(0, 0, "").unwrap_err().contains("total"));
        assert!(take(3, 3, "").unwrap_err().contains("below"));
        assert!(take(0, usize::MAX, "").unwrap_err().contains("total"));
        assert_eq!(take(0, 3, "x"), Ok(None));
        assert!(take(1, 4, "x").unwrap_err().contains("agree"));
        assert_eq!(take(0, 2, "new "), Ok(None));
        assert_eq!(take(0, 2, "again "), Ok(None));
        assert_eq!(take(1, 2, "whole"), Ok(Some("again whole".to_owned())));
        assert_eq!(fragments.bytes, 0);
    }

    #[test]
    fn unfinished_messages_are_bounded_in_number_bytes_and_age() {
        let mut fragments = FragmentedMessages::default();
        let start = Instant::now();
        for n in 0..MAX_PARTIAL_MESSAGES {
            assert_eq!(fragments.add(&n.to_string(), 0, 2, "x".to_owned(), start), Ok(None));
        }
        assert!(fragments.add("one more", 0, 2, "x".to_owned(), start).is_err());
        let later = start + MAX_AGE + Duration::from_secs(1);
        assert_eq!(fragments.add("one more", 0, 2, "x".to_owned(), later), Ok(None));
        assert_eq!(fragments.partial.len(), 1);
        let error = fragments.add("big", 0, 2, "x".repeat(MAX_BYTES + 1), later).unwrap_err();
        assert!(error.contains("bytes"), "{error}");
    }
}
