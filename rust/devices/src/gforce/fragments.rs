use super::protocol::FRAGMENT;

/// Longest message that fragments may make; the protocol's packets are at most 257 bytes.
const MAX_MESSAGE_BYTES: usize = 512;

/// Joins fragments `[FF, index, bytes]`, whose index counts down to 0, to messages. Messages that came whole pass.
///
/// A message with a missing fragment is dropped, and joining begins anew at the next index that is higher than the
/// last: there a new message begins, unless its own first fragments are missing too. Then the message is too short,
/// which the length check after this must find. Losses that cut out exactly one message's worth from the middle of
/// one message to the middle of the next leave a message of the right length: whoever needs certainty waits for the
/// next message's number, as [`super::GForceParser`] does.
#[derive(Clone, Debug, Default)]
pub struct FragmentAssembler {
    message: Vec<u8>,
    /// Index of the fragment that came last; none when a message has just ended.
    last_index: Option<u8>,
    /// The message under way lacks a fragment.
    incomplete: bool,
    /// Length of the newest fragment within `message`.
    newest_length: usize,
    dropped: u64,
}

/// What became of a notification.
#[derive(Debug, PartialEq, Eq)]
pub enum AssemblyOutcome<'a> {
    /// A message that came in one piece.
    Unfragmented(&'a [u8]),
    /// A message joined from fragments.
    Reassembled(&'a [u8]),
    /// None yet.
    Incomplete,
}

impl FragmentAssembler {
    /// Takes a notification.
    pub fn push<'a>(&'a mut self, notification: &'a [u8]) -> AssemblyOutcome<'a> {
        let &[FRAGMENT, index, ref bytes @ ..] = notification else {
            // A whole message within another: the other is incomplete.
            self.drop_message();
            self.last_index = None;
            return AssemblyOutcome::Unfragmented(notification);
        };
        let begins = match self.last_index {
            None => true,
            // The same fragment twice.
            Some(last)
                if index == last
                    && !self.incomplete
                    && self.message.ends_with(bytes)
                    && bytes.len() == self.newest_length =>
            {
                return AssemblyOutcome::Incomplete;
            }
            Some(last) => {
                if index >= last || last - index != 1 {
                    self.drop_message();
                }
                index > last
            }
        };
        if begins {
            self.message.clear();
            self.incomplete = false;
        }
        self.last_index = Some(index);
        if self.message.len() + bytes.len() > MAX_MESSAGE_BYTES {
            self.drop_message();
        }
        if !self.incomplete {
            self.message.extend_from_slice(bytes);
            self.newest_length = bytes.len();
        }
        if index > 0 {
            return AssemblyOutcome::Incomplete;
        }
        self.last_index = None;
        if self.incomplete {
            self.incomplete = false;
            return AssemblyOutcome::Incomplete;
        }
        AssemblyOutcome::Reassembled(&self.message)
    }

    /// Messages dropped because a fragment was missing.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Forgets a message under way, as after a lost link.
    pub fn clear(&mut self) {
        self.drop_message();
        self.last_index = None;
        self.incomplete = false;
    }

    fn drop_message(&mut self) {
        if self.last_index.is_some() && !self.incomplete {
            self.dropped += 1;
            self.incomplete = true;
        }
        self.message.clear();
    }
}

/// Cuts a message longer than `max_bytes` bytes into notifications of at most that, index counting down.
/// `max_bytes` is what the connection carries: its MTU less 3.
///
/// # Panics
/// If `max_bytes` leaves no room for bytes, or a message needs more than 256 fragments.
pub fn split_into_fragments(message: &[u8], max_bytes: usize) -> Vec<Vec<u8>> {
    assert!(max_bytes > 2, "a notification of {max_bytes} bytes has no room for a fragment");
    if message.len() <= max_bytes {
        return vec![message.to_vec()];
    }
    let pieces: Vec<&[u8]> = message.chunks(max_bytes - 2).collect();
    assert!(pieces.len() <= 256, "{} fragments, at most 256 can be numbered", pieces.len());
    let numbered = pieces.iter().zip((0..pieces.len()).rev());
    numbered.map(|(piece, index)| [&[FRAGMENT, index as u8], *piece].concat()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn message(number: u8) -> Vec<u8> {
        (0..130_u8).map(|k| if k == 0 { 0x08 } else { k.wrapping_mul(3).wrapping_add(number) }).collect()
    }

    /// MTU 23: twenty bytes a notification.
    fn pieces(number: u8) -> Vec<Vec<u8>> {
        split_into_fragments(&message(number), 20)
    }

    fn joined(fragments: &mut FragmentAssembler, notifications: &[Vec<u8>]) -> Vec<Vec<u8>> {
        let mut messages = Vec::new();
        for notification in notifications {
            if let AssemblyOutcome::Reassembled(message) | AssemblyOutcome::Unfragmented(message) =
                fragments.push(notification)
            {
                messages.push(message.to_vec());
            }
        }
        messages
    }

    #[test]
    fn a_packet_at_the_smallest_mtu_is_eight_fragments_counted_down() {
        let indices: Vec<u8> = pieces(1).iter().map(|p| p[1]).collect();
        assert_eq!(indices, [7, 6, 5, 4, 3, 2, 1, 0]);
        assert!(pieces(1).iter().all(|p| p[0] == 0xFF && p.len() <= 20));
        assert_eq!(joined(&mut FragmentAssembler::default(), &pieces(1)), [message(1)]);
    }

    #[test]
    fn a_missing_fragment_drops_its_message_only() {
        for missing in 0..8 {
            let mut stream = pieces(1);
            stream.remove(missing);
            stream.extend(pieces(2));
            let mut fragments = FragmentAssembler::default();
            let messages = joined(&mut fragments, &stream);
            assert_eq!(messages.last(), Some(&message(2)), "fragment {missing}");
            // Without its first fragment a message is too short, which the length tells.
            let whole: Vec<_> = messages.iter().filter(|m| m.len() == 130).collect();
            assert_eq!(whole, [&message(2)], "fragment {missing}");
        }
    }

    #[test]
    fn a_fragment_that_comes_twice_is_taken_once() {
        let mut stream = pieces(1);
        stream.insert(3, stream[3].clone());
        assert_eq!(joined(&mut FragmentAssembler::default(), &stream), [message(1)]);
    }

    #[test]
    fn fragments_in_the_wrong_order_make_no_message_of_that_length() {
        for k in 0..7 {
            let mut stream = pieces(1);
            stream.swap(k, k + 1);
            stream.extend(pieces(2));
            let messages = joined(&mut FragmentAssembler::default(), &stream);
            let whole: Vec<_> = messages.iter().filter(|m| m.len() == 130).collect();
            assert_eq!(whole, [&message(2)], "swapped {k}");
        }
    }

    #[test]
    fn endless_fragments_do_not_fill_the_memory() {
        let mut fragments = FragmentAssembler::default();
        for index in (0..=255).rev() {
            fragments.push(&[&[0xFF, index], &[1; 100][..]].concat());
        }
        assert!(fragments.message.capacity() <= 2 * MAX_MESSAGE_BYTES);
        assert_eq!(fragments.dropped(), 1);
    }

    proptest! {
        #[test]
        fn cut_and_joined_is_the_same(bytes in prop::collection::vec(0_u8..0xFF, 1..400), most in 5_usize..247) {
            let messages = joined(&mut FragmentAssembler::default(), &split_into_fragments(&bytes, most));
            prop_assert_eq!(messages, [bytes]);
        }

        #[test]
        fn no_bytes_make_it_panic(stream in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..60)) {
            let mut fragments = FragmentAssembler::default();
            for notification in &stream {
                let _ = fragments.push(notification);
            }
        }
    }
}
