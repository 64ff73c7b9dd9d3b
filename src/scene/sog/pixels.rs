//! The images of a SOG as pixels.

use crate::scene::SceneError;
use crate::scene::cursor::Cursor;
use image_webp::{DecodingError, WebPDecoder};
use std::io;

/// Maximum ratio of decoded to compressed bytes, beyond the free size.
const MAX_RATIO: usize = 1024;
/// Decoded size in bytes that an image may always have, because a constant image compresses to
/// almost nothing.
const FREE: usize = 1 << 20;

/// Returns the maximum decoded size of an image in bytes, if all images of the file have
/// `files_len` bytes.
pub(super) fn limit(files_len: usize) -> usize {
    files_len.saturating_mul(MAX_RATIO).saturating_add(FREE)
}

/// A decoded image.
pub(super) struct Pixels {
    part: &'static str,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Bytes per pixel: 3, or 4 with alpha.
    channels: usize,
    bytes: Vec<u8>,
}

impl Pixels {
    /// Decodes a lossless WebP image to at most `limit` bytes.
    pub(super) fn decode(file: &[u8], part: &'static str, limit: usize) -> Result<Self, SceneError> {
        let at = Cursor::new(part, file);
        let broken = |e: DecodingError| at.malformed(format!("a broken image ({e})"), "a WebP image");
        let mut decoder = WebPDecoder::new(io::Cursor::new(file)).map_err(broken)?;
        if decoder.is_animated() || decoder.is_lossy() {
            return Err(at.unsupported("an image that is lossy or moves", "write it as lossless WebP"));
        }
        let (width, height) = decoder.dimensions();
        let len = decoder.output_buffer_size().filter(|&len| len <= limit);
        let Some(len) = len else {
            let found = format!("an image of {width}x{height} pixels in {} bytes", file.len());
            return Err(at.malformed(found, format!("at most {limit} bytes of pixels")));
        };
        let mut bytes = vec![0; len];
        decoder.read_image(&mut bytes).map_err(broken)?;
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        Ok(Self { part, width: width as usize, height: height as usize, channels, bytes })
    }

    /// Returns the image if it has at least `count` pixels.
    pub(super) fn hold(self, count: usize) -> Result<Self, SceneError> {
        let Self { width, height, .. } = self;
        if width * height >= count {
            return Ok(self);
        }
        let found = format!("an image of {width}x{height} pixels");
        Err(self.at(0).malformed(found, format!("{count} pixels or more")))
    }

    /// Returns a cursor at pixel `i`, for errors.
    pub(super) fn at(&self, i: usize) -> Cursor<'_> {
        Cursor::new(self.part, &self.bytes).at(self.channels * i)
    }

    /// Returns red, green and blue of pixel `i`, counted row by row.
    pub(super) fn rgb(&self, i: usize) -> [u8; 3] {
        let [r, g, b, _] = self.rgba(i);
        [r, g, b]
    }

    /// Returns red, green, blue and alpha of pixel `i`. Alpha is 255 if the image has no alpha
    /// channel.
    pub(super) fn rgba(&self, i: usize) -> [u8; 4] {
        match self.bytes[self.channels * i..self.channels * (i + 1)] {
            [r, g, b] => [r, g, b, 255],
            [r, g, b, a] => [r, g, b, a],
            _ => unreachable!("an image has three or four channels"),
        }
    }
}
