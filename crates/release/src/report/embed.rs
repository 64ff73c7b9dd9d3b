//! Pictures inside the page: made small on the CPU, and written as `data:` addresses.

use gs2e_files::html::encode_base64;
use gs2e_image::{Image, jpeg, png, shrink};
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

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;

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
