//! Pictures inside the page: made small on the CPU, and written as `data:` addresses.

use crate::image::{Image, jpeg, png, shrink};
use std::io::Cursor;

/// Quality of pictures in the page, 1 to 100.
const QUALITY: u8 = 72;

/// Maximum length of a PNG that is embedded as it stands, if its picture is no wider than asked
/// for. Drawings are smaller in this form, and exact.
const SMALL_PNG: usize = 12 << 10;

/// A picture of the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct EmbeddedPicture {
    /// Its bytes as an address.
    pub(super) address: String,
    pub(super) width: u32,
    pub(super) height: u32,
}

impl EmbeddedPicture {
    /// The picture, at most `width` columns wide; `None` if it has no pixels.
    pub(super) fn from_image(image: &Image<[u8; 3]>, width: u32) -> Option<Self> {
        let small = shrink::to_width(image, width);
        let bytes = jpeg::encode(&small, QUALITY)?;
        Some(Self::new("image/jpeg", &bytes, &small))
    }

    /// The picture of a PNG file; `None` if it cannot be read.
    pub(super) fn of_png(bytes: &[u8], width: u32) -> Option<Self> {
        let image = png::read_rgb(Cursor::new(bytes)).ok()?;
        if image.size().width <= width && bytes.len() <= SMALL_PNG {
            return Some(Self::new("image/png", bytes, &image));
        }
        Self::from_image(&image, width)
    }

    fn new(media: &str, bytes: &[u8], image: &Image<[u8; 3]>) -> Self {
        let address = format!("data:{media};base64,{}", encode_base64(bytes));
        Self { address, width: image.size().width, height: image.size().height }
    }
}

/// Base 64 with padding (RFC 4648, section 4).
pub(super) fn encode_base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        // A short last group fills the upper part of its 24 bits.
        let word =
            group.iter().fold(0u32, |word, byte| word << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        for place in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * place) & 63) as usize];
            out.push(if place <= group.len() { char::from(digit) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;

    #[test]
    fn base64_is_that_of_the_standard() {
        // RFC 4648, section 10.
        for (bytes, wanted) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(encode_base64(bytes.as_bytes()), wanted);
        }
        assert_eq!(encode_base64(&[0xfb, 0xff, 0xfe]), "+//+");
    }

    #[test]
    fn drawings_stay_exact_and_views_become_small() {
        let size = Size { width: 300, height: 100 };
        let shade = |i: u32| u8::try_from(i.wrapping_mul(0x9e37_79b1) >> 24).expect("8 bits");
        let noise =
            Image::from_vec(size, (0..30_000).map(|i| [shade(i), shade(i + 1), shade(i + 2)]).collect());
        let written = |image: &Image<[u8; 3]>| {
            let mut bytes = Vec::new();
            png::write_image(image, &mut bytes).unwrap();
            bytes
        };
        let drawing = written(&Image::filled(size, [255; 3]));
        let picture = EmbeddedPicture::of_png(&drawing, 320).unwrap();
        assert_eq!(picture.address, format!("data:image/png;base64,{}", encode_base64(&drawing)));
        let picture = EmbeddedPicture::of_png(&written(&noise), 320).unwrap();
        assert!(picture.address.starts_with("data:image/jpeg;base64,/9j/"));
        assert_eq!((picture.width, picture.height), (300, 100));
        let picture = EmbeddedPicture::of_png(&drawing, 150).unwrap();
        assert_eq!((picture.width, picture.height), (150, 50));
        assert_eq!(EmbeddedPicture::of_png(b"no picture", 320), None);
    }
}
