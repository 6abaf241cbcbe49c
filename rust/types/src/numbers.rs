//! Numbers as people and programs read them: no output shows a negative zero.
//!
//! Records do not go through here: they keep every bit.

use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter, PrettyFormatter};
use std::{fmt, io};

/// A number for a text or a table. `{:.2}` of -0.001 is `0.00`, and width and sign are those of the format.
#[derive(Clone, Copy, Debug)]
pub struct Number(pub f64);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match f.precision() {
            Some(digits) => format!("{:.digits$}", self.0),
            None => self.0.to_string(),
        };
        let size = text.trim_start_matches('-');
        let zero = size.chars().all(|c| c == '0' || c == '.');
        f.pad_integral(zero || size.len() == text.len(), "", size)
    }
}

/// `value` as JSON in one line.
///
/// # Errors
/// A map with keys that are no text.
pub fn to_json<T: Serialize + ?Sized>(value: &T) -> serde_json::Result<String> {
    write(value, CompactFormatter)
}

/// `value` as JSON in lines, two spaces a level.
///
/// # Errors
/// As [`to_json`].
pub fn to_json_pretty<T: Serialize + ?Sized>(value: &T) -> serde_json::Result<String> {
    write(value, PrettyFormatter::new())
}

fn write<T: Serialize + ?Sized>(value: &T, formatter: impl Formatter) -> serde_json::Result<String> {
    let mut text = Vec::new();
    value.serialize(&mut serde_json::Serializer::with_formatter(&mut text, NoNegativeZero(formatter)))?;
    Ok(String::from_utf8(text).expect("serde_json writes UTF-8"))
}

/// Adding zero makes a negative zero positive, and changes no other number.
struct NoNegativeZero<F>(F);

/// What `F` overrides passes on.
macro_rules! forward_to_inner {
    ($($name:ident($($argument:ident: $kind:ty),*);)*) => {$(
        fn $name<W: ?Sized + io::Write>(&mut self, to: &mut W $(, $argument: $kind)*) -> io::Result<()> {
            self.0.$name(to $(, $argument)*)
        }
    )*};
}

impl<F: Formatter> Formatter for NoNegativeZero<F> {
    fn write_f32<W: ?Sized + io::Write>(&mut self, to: &mut W, value: f32) -> io::Result<()> {
        self.0.write_f32(to, value + 0.0)
    }

    fn write_f64<W: ?Sized + io::Write>(&mut self, to: &mut W, value: f64) -> io::Result<()> {
        self.0.write_f64(to, value + 0.0)
    }

    forward_to_inner! {
        begin_array();
        end_array();
        begin_array_value(first: bool);
        end_array_value();
        begin_object();
        end_object();
        begin_object_key(first: bool);
        end_object_key();
        begin_object_value();
        end_object_value();
    }
}

/// A number for a sentence: as people write it, with an exponent where that would take many digits.
pub fn format_number(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || !size.is_finite() || (1e-6..1e16).contains(&size) {
        return value.to_string();
    }
    format!("{value:e}")
}

/// A number in a text of more characters than this is written anew.
const MAX_NUMBER_CHARS: usize = 24;

/// `text` with its numbers of many digits as [`format_number`] writes them: a parser says of 1e-310 all its digits.
pub fn shorten_numbers(text: &str) -> String {
    let is_digit = |c: char| c.is_ascii_digit() || c == '.';
    let mut short = String::new();
    let mut rest = text;
    while let Some(start) = rest.find(is_digit) {
        let (before, number) = rest.split_at(start);
        let (number, after) = number.split_at(number.find(|c: char| !is_digit(c)).unwrap_or(number.len()));
        short += before;
        match number.parse() {
            Ok(value) if number.len() > MAX_NUMBER_CHARS => short += &format_number(value),
            _ => short += number,
        }
        rest = after;
    }
    short + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_rounds_to_zero_has_no_sign() {
        let of = |value| {
            format!("{:.2}|{:6.1}|{:+.0}|{}", Number(value), Number(value), Number(value), Number(value))
        };
        assert_eq!(of(-0.001), "0.00|   0.0|+0|-0.001");
        assert_eq!(of(-0.0), "0.00|   0.0|+0|0");
        assert_eq!(of(-1.25), "-1.25|  -1.2|-1|-1.25");
        assert_eq!(of(1.25), "1.25|   1.2|+1|1.25");
        assert_eq!(format!("{:.1} {}", Number(f64::NAN), Number(f64::NEG_INFINITY)), "NaN -inf");
    }

    #[test]
    fn json_has_no_negative_zero_and_is_else_that_of_serde() {
        let value = serde_json::json!({"a": [-0.0, -0.5, 1e300], "b": {"c": null, "d": "-0.0"}, "e": u64::MAX, "f": []});
        let plain = serde_json::to_string(&value).expect("plain");
        assert!(plain.contains("[-0.0,"), "{plain}");
        assert_eq!(to_json(&value).expect("plain"), plain.replace("[-0.0,", "[0.0,"));
        let pretty = serde_json::to_string_pretty(&value).expect("plain");
        assert_eq!(to_json_pretty(&value).expect("plain"), pretty.replacen("-0.0,", "0.0,", 1));
    }

    #[test]
    fn long_numbers_in_a_text_are_shortened_and_others_stay() {
        let text = |number: f64| format!("invalid type: floating point {number}, expected u64 at 12.5 s.");
        for (number, short) in [(1e-310, "1e-310"), (-1e300, "-1e300"), (0.25, "0.25"), (5e-324, "5e-324")] {
            let expected = format!("invalid type: floating point {short}, expected u64 at 12.5 s.");
            assert_eq!(shorten_numbers(&text(number)), expected);
        }
        assert_eq!(shorten_numbers(""), "");
        assert_eq!(shorten_numbers("version 1.2.3 ..."), "version 1.2.3 ...");
    }

    #[test]
    fn numbers_of_many_digits_are_written_with_an_exponent() {
        for (value, text) in [
            (0.0, "0"),
            (2.5, "2.5"),
            (1e-6, "0.000001"),
            (5e-324, "5e-324"),
            (-1e300, "-1e300"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(format_number(value), text);
        }
    }
}
