//! Messages as PNG pictures, rosbridge's compression: the text's bytes are the colours, line feeds fill it up.

use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use proact_camera::png;

/// A text as `{"op":"png","data":..}`.
pub(crate) fn envelope(text: &str) -> String {
    format!(r#"{{"op":"png","data":"{}"}}"#, BASE64.encode(picture(text.as_bytes())))
}

/// An 8-bit RGB picture, nearly square, that holds `bytes`.
fn picture(bytes: &[u8]) -> Vec<u8> {
    let pixels = bytes.len().div_ceil(3).max(1);
    let width = pixels.isqrt().max(1);
    let height = pixels.div_ceil(width);
    let mut data = bytes.to_vec();
    data.resize(width * height * 3, b'\n');
    // Sizes are below 2^32 because messages are limited to a few megabytes.
    png(width as u32, height as u32, &data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_of_any_length_comes_back_out_of_its_picture() {
        for length in [0, 1, 2, 3, 4, 100, 1000, 4096, 70_001] {
            let text: String = (0..length).map(|n| char::from(b' ' + (n % 90) as u8)).collect();
            let bytes = picture(text.as_bytes());
            let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
            let mut data = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut data).unwrap();
            assert_eq!(String::from_utf8(data).unwrap().trim_end_matches('\n'), text);
        }
    }
}
