//! Messages as PNG pictures, rosbridge's compression: the text's bytes are the colours, line feeds fill it up.

use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use std::io::Cursor;

/// A text as `{"op":"png","data":..}`.
pub(crate) fn encode_message(text: &str) -> String {
    format!(r#"{{"op":"png","data":"{}"}}"#, BASE64.encode(encode_rgb(text.as_bytes())))
}

/// An 8-bit RGB picture, nearly square, that holds `bytes`.
fn encode_rgb(bytes: &[u8]) -> Vec<u8> {
    let pixels = bytes.len().div_ceil(3).max(1);
    let width = pixels.isqrt().max(1);
    let height = pixels.div_ceil(width);
    let mut data = bytes.to_vec();
    data.resize(width * height * 3, b'\n');
    // Sizes are below 2^32 because messages are limited to a few megabytes.
    proact_camera::encode_png(width as u32, height as u32, &data)
}

/// The text in a client's picture, in base64: its colours, which may end in line feeds.
///
/// # Errors
/// One sentence: no base64, no picture, or one that holds more than `max_bytes` bytes.
pub(crate) fn decode_text(base64: &str, max_bytes: usize) -> Result<Vec<u8>, String> {
    let picture = BASE64.decode(base64).map_err(|error| format!("\"data\" is no base64: {error}"))?;
    // A small file may hold a huge picture.
    let limits = png::Limits { bytes: 2 * max_bytes };
    let broken = |error: png::DecodingError| format!("\"data\" is no picture: {error}");
    let mut reader =
        png::Decoder::new_with_limits(Cursor::new(picture), limits).read_info().map_err(broken)?;
    let (kind, depth) = reader.output_color_type();
    if kind != png::ColorType::Rgb || depth != png::BitDepth::Eight {
        return Err(format!("the picture is {kind:?} of {depth:?} bits, expected Rgb of Eight"));
    }
    let held = reader.output_buffer_size().filter(|held| *held <= max_bytes + 64 * 1024);
    let held = held.ok_or_else(|| format!("the picture holds more than {max_bytes} bytes"))?;
    let mut data = vec![0; held];
    reader.next_frame(&mut data).map_err(broken)?;
    let end = data.iter().rposition(|byte| *byte != b'\n').map_or(0, |last| last + 1);
    data.truncate(end);
    if data.len() > max_bytes {
        return Err(format!("the picture holds {} bytes, expected at most {max_bytes}", data.len()));
    }
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_of_any_length_comes_back_out_of_its_picture() {
        for length in [0, 1, 2, 3, 4, 100, 1000, 4096, 70_001] {
            let text: String = (0..length).map(|n| char::from(b' ' + (n % 90) as u8)).collect();
            let base64 = BASE64.encode(encode_rgb(text.as_bytes()));
            assert_eq!(String::from_utf8(super::decode_text(&base64, 100_000).unwrap()).unwrap(), text);
        }
    }

    #[test]
    fn what_is_no_picture_or_too_large_a_one_is_refused() {
        let refused = |data: &str, max_bytes| super::decode_text(data, max_bytes).unwrap_err();
        assert!(refused("no base64!", 100).contains("no base64"));
        assert!(refused(&BASE64.encode("no picture"), 100).contains("no picture"));
        // A megabyte of the same byte is a kilobyte of picture.
        let bomb = BASE64.encode(encode_rgb(&vec![b'x'; 1_000_000]));
        assert!(
            bomb.len() < 20_000 && refused(&bomb, 100_000).contains("more than 100000"),
            "{}",
            bomb.len()
        );
    }
}
