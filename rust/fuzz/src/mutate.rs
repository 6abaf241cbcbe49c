//! Mutations of bytes. Libraries for it mutate values of Rust types (mutatis) or need the compiler's instrumentation
//! (libFuzzer, libafl); what finds most in text formats, numbers and words of the corpus in each other's places, none of
//! them has.

use rand::{RngExt, SeedableRng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;
use std::{collections::BTreeSet, ops::Range};

/// Longest input, bytes. Long ones are slow, and bounds on lengths have tests of their own.
const MAX_INPUT_BYTES: usize = 256 << 10;
/// Most mutations of one input.
const MAX_MUTATIONS: usize = 6;
/// Longest piece that is copied, cut out or doubled, bytes.
const MAX_SLICE_BYTES: usize = 512;

/// Numbers as text that readers stumble over.
const BOUNDARY_NUMBERS: [&str; 18] = [
    "0",
    "-0.0",
    "1",
    "-1",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-320",
    "1e20",
    "4294967296",
    "255",
    "65536",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
];
/// The same as bytes.
const BOUNDARY_BYTES: [&[u8]; 12] = [
    &[0],
    &[0xff],
    &[0x7f],
    &[0x80],
    &[0xff, 0xff],
    &[0xff, 0xff, 0xff, 0x7f],
    &[0xff, 0xff, 0xff, 0xff],
    &[0, 0, 0, 0x80],
    &[0, 0, 0, 0, 0, 0, 0xf8, 0x7f],
    &[0, 0, 0, 0, 0, 0, 0xf0, 0x7f],
    &[0xff; 8],
    &[0; 8],
];
const TOKENS: [&str; 16] = [
    "",
    " ",
    "\n",
    "\0",
    "\u{feff}",
    "\"",
    "'",
    "[",
    "]",
    "{",
    "}",
    "<!--",
    "-->",
    "../",
    "\u{1f9be}",
    "null",
];

/// Makes inputs of a corpus, the same for the same seed.
pub(crate) struct Mutator {
    random: ChaCha8Rng,
    corpus: Vec<Vec<u8>>,
    tokens: Vec<Vec<u8>>,
}

impl Mutator {
    /// Without a corpus everything is made of nothing.
    pub(crate) fn new(mut corpus: Vec<Vec<u8>>, seed: u64) -> Mutator {
        if corpus.is_empty() {
            corpus.push(Vec::new());
        }
        let words: BTreeSet<&[u8]> = corpus.iter().flat_map(|file| split_tokens(file)).collect();
        let words = words.into_iter().map(<[u8]>::to_vec).collect();
        Mutator { random: ChaCha8Rng::seed_from_u64(seed), corpus, tokens: words }
    }

    /// The next input.
    pub(crate) fn next_input(&mut self) -> Vec<u8> {
        let mut input = self.random_corpus_input();
        for _ in 0..self.random.random_range(1..=MAX_MUTATIONS) {
            self.mutate(&mut input);
        }
        input.truncate(MAX_INPUT_BYTES);
        input
    }

    fn random_corpus_input(&mut self) -> Vec<u8> {
        self.corpus.choose(&mut self.random).cloned().unwrap_or_default()
    }

    /// A piece of `0..length`.
    fn random_range(&mut self, length: usize) -> Range<usize> {
        let start = self.random.random_range(0..=length);
        let max_length = (length - start).min(MAX_SLICE_BYTES);
        start..start + self.random.random_range(0..=max_length)
    }

    fn mutate(&mut self, input: &mut Vec<u8>) {
        let length = input.len();
        match self.random.random_range(0..14) {
            0 if length > 0 => {
                let at = self.random.random_range(0..length);
                input[at] ^= 1 << self.random.random_range(0..8);
            }
            1 if length > 0 => input[self.random.random_range(0..length)] = self.random.random(),
            2 => input.truncate(self.random.random_range(0..=length)),
            3 => drop(input.drain(self.random_range(length))),
            4 => {
                let doubled = input[self.random_range(length)].to_vec();
                let at = self.random.random_range(0..=length);
                let times = *[1, 1, 2, 30, 300].choose(&mut self.random).unwrap_or(&1);
                drop(input.splice(at..at, doubled.repeat(times)));
            }
            5 => {
                // From anywhere in another file to anywhere in this one.
                let other = self.random_corpus_input();
                let piece = self.random_range(other.len());
                let offset = self.random_range(length);
                drop(input.splice(offset, other[piece].iter().copied()));
            }
            6 => {
                let other = self.random_corpus_input();
                let (here, there) =
                    (self.random.random_range(0..=length), self.random.random_range(0..=other.len()));
                input.truncate(here);
                input.extend_from_slice(&other[there..]);
            }
            7 | 8 => {
                let magic = BOUNDARY_BYTES.choose(&mut self.random).copied().unwrap_or_default();
                let at = self.random.random_range(0..=length);
                let end = (at + magic.len()).min(length);
                drop(input.splice(at..end, magic.iter().copied()));
            }
            9 => {
                let token = TOKENS.choose(&mut self.random).copied().unwrap_or_default();
                let at = self.random.random_range(0..=length);
                drop(input.splice(at..at, token.bytes()));
            }
            10 => {
                let word = self.tokens.choose(&mut self.random).cloned().unwrap_or_default();
                let offset = self.random.random_range(0..=length);
                let offset =
                    split_tokens(input).into_iter().map(|w| range_in(input, w)).find(|r| r.start >= offset);
                if let Some(offset) = offset {
                    drop(input.splice(offset, word));
                }
            }
            _ => {
                let from = self.random.random_range(0..=length);
                if let Some(offset) = find_number(input, from) {
                    let number = BOUNDARY_NUMBERS.choose(&mut self.random).copied().unwrap_or_default();
                    drop(input.splice(offset, number.bytes()));
                }
            }
        }
    }
}

/// Runs of letters, digits and what else stands in names.
fn split_tokens(bytes: &[u8]) -> Vec<&[u8]> {
    bytes
        .split(|b| !(b.is_ascii_alphanumeric() || b"_-/.:".contains(b)))
        .filter(|word| (2..40).contains(&word.len()))
        .collect()
}

fn range_in(whole: &[u8], part: &[u8]) -> Range<usize> {
    let start = part.as_ptr() as usize - whole.as_ptr() as usize;
    start..start + part.len()
}

/// The first number written in digits at or behind `from`.
fn find_number(bytes: &[u8], from: usize) -> Option<Range<usize>> {
    let is_number = |b: &u8| b.is_ascii_digit() || b"+-.eE".contains(b);
    let start = from + bytes[from..].iter().position(u8::is_ascii_digit)?;
    let before = bytes[..start].iter().rev().take_while(|b| is_number(b)).count();
    let behind = bytes[start..].iter().take_while(|b| is_number(b)).count();
    Some(start - before..start + behind)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_seeds_give_equal_inputs_and_others_other_ones() {
        let corpus = vec![b"<limit lower=\"-1.5\"/>".to_vec(), b"name 7".to_vec()];
        let inputs = |seed| {
            let mut mutator = Mutator::new(corpus.clone(), seed);
            (0..500).map(|_| mutator.next_input()).collect::<Vec<_>>()
        };
        assert_eq!(inputs(1), inputs(1));
        assert_ne!(inputs(1), inputs(2));
        assert!(
            inputs(1).iter().any(|input| input.starts_with(b"<limit lower=\"nan\"")),
            "numbers are put in place"
        );
    }

    #[test]
    fn a_number_is_found_with_its_sign_and_exponent() {
        let text = b"a=\"-1.5e3\" b";
        assert_eq!(find_number(text, 0).map(|range| &text[range]), Some(&b"-1.5e3"[..]));
        assert_eq!(find_number(text, 5).map(|range| &text[range]), Some(&b"-1.5e3"[..]));
        assert_eq!(find_number(text, 11), None);
    }
}
