//! The images of a SOG as pixels.

use super::meta::PaletteMeta;
use crate::cursor::ByteCursor;
use crate::{SceneError, sh};
use gs2e_files::budget::{ByteBudget, try_filled};
use image_webp::{DecodingError, WebPDecoder};
use std::io;

/// Maximum number of pixels of an image per wanted pixel: writers pad to squares, some of them to
/// powers of two.
const MAX_PADDING: usize = 4;
/// Number of pixels that an image may have in addition, however few are wanted.
const FREE_PIXELS: usize = 1 << 16;

/// Limits on the number of pixels of an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelRoom {
    least: usize,
    most: usize,
}

impl PixelRoom {
    /// An image of one pixel per Gaussian.
    pub(super) fn of_scene(count: usize) -> Self {
        Self { least: count, ..Self::up_to(count) }
    }

    /// The sets of a palette: writers round the stated count up.
    pub(super) fn of_palette(palette: &PaletteMeta) -> Self {
        Self::up_to(palette.count.saturating_mul(sh::function_count(palette.bands)))
    }

    fn up_to(pixels: usize) -> Self {
        Self { least: 0, most: pixels.saturating_mul(MAX_PADDING).saturating_add(FREE_PIXELS) }
    }
}

/// A decoded image.
pub(super) struct DecodedPixels {
    part: &'static str,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Bytes per pixel: 3, or 4 with alpha.
    channels: usize,
    bytes: Vec<u8>,
}

impl DecodedPixels {
    /// Decodes a lossless WebP image. Its memory is taken from `budget`.
    pub(super) fn decode_webp(
        file: &[u8],
        part: &'static str,
        room: PixelRoom,
        budget: &mut ByteBudget,
    ) -> Result<Self, SceneError> {
        let at = ByteCursor::new(part, file);
        let broken = |e: DecodingError| at.malformed(format!("a broken image ({e})"), "a WebP image");
        let mut decoder = WebPDecoder::new(io::Cursor::new(file)).map_err(broken)?;
        if decoder.is_animated() || decoder.is_lossy() {
            return Err(at.unsupported("a lossy or animated image", "write it as lossless WebP"));
        }
        let (width, height) = decoder.dimensions();
        let (width, height) = (width as usize, height as usize);
        let refuse = |wanted: String| at.malformed(format!("an image of {width}x{height} pixels"), wanted);
        // By the header, before anything is decoded.
        let PixelRoom { least, most } = room;
        if !(least..=most).contains(&(width * height)) {
            return Err(refuse(format!("{least} to {most} pixels")));
        }
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        budget.take(width * height, channels).map_err(|e| refuse(format!("fewer: all images take {e}")))?;
        let mut bytes = try_filled(0, width * height * channels)?;
        decoder.read_image(&mut bytes).map_err(broken)?;
        Ok(Self { part, width, height, channels, bytes })
    }

    /// Returns a cursor at pixel `i`, for errors.
    pub(super) fn at(&self, i: usize) -> ByteCursor<'_> {
        ByteCursor::new(self.part, &self.bytes).at(self.channels * i)
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
