/// A number for a sentence: as people write it, with an exponent where that would take many digits.
pub fn number_text(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || !size.is_finite() || (1e-6..1e16).contains(&size) {
        return value.to_string();
    }
    format!("{value:e}")
}

#[cfg(test)]
mod tests {
    use super::*;

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
            assert_eq!(number_text(value), text);
        }
    }
}
