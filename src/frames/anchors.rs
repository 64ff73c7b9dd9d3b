//! Frames that are kept while a sequence passes by, so that its events can later be held against what the sensor saw.

use super::Frame;
use crate::image::{Image, Size};
use npyz::WriterBuilder;
use std::io::{self, Read, Write};

/// Luminance at a few frames: the first, the last, and some between.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchors {
    /// Stamps of the kept frames in microseconds.
    pub stamps_us: Vec<i64>,
    /// Luminance on the grey scale 0..255.
    pub images: Vec<Image<f32>>,
}

/// Time between anchors, where the sequence is long enough for at least two such intervals.
const SPACING_US: i64 = 100_000;

impl Anchors {
    /// Which frames of a sequence are kept: its ends, and between them those nearest to equal parts of 0.1 s or a
    /// little more; two parts where the sequence is shorter.
    #[must_use]
    pub fn choose(stamps_us: &[i64]) -> Vec<usize> {
        let (Some(first), Some(last)) = (stamps_us.first(), stamps_us.last()) else { return Vec::new() };
        let span = last - first;
        let parts = (span / SPACING_US).max(2);
        let nearest = |i: i64| {
            let wanted = first + span * i / parts;
            let after = stamps_us.partition_point(|t| *t < wanted).min(stamps_us.len() - 1);
            let before = after.saturating_sub(1);
            if wanted - stamps_us[before] < stamps_us[after] - wanted { before } else { after }
        };
        let mut chosen: Vec<usize> = (0..=parts).map(nearest).collect();
        chosen.dedup();
        chosen
    }

    /// No frame yet.
    #[must_use]
    pub fn empty() -> Self {
        Self { stamps_us: Vec::new(), images: Vec::new() }
    }

    /// Keeps a frame.
    pub fn keep(&mut self, frame: &Frame, stamp_us: i64) {
        self.stamps_us.push(stamp_us);
        self.images.push(frame.luminance.clone());
    }

    /// Writes the images as `.npy`, float32 `[K, H, W]`.
    ///
    /// # Errors
    /// When the bytes cannot be written.
    pub fn write_images(&self, out: impl Write) -> io::Result<()> {
        let size = self.images.first().map_or(Size { width: 0, height: 0 }, Image::size);
        let shape = [self.images.len() as u64, size.height.into(), size.width.into()];
        let options = npyz::WriteOptions::new().default_dtype().shape(&shape);
        let mut writer = options.writer(out).begin_nd()?;
        for image in &self.images {
            writer.extend(image.pixels().iter().copied())?;
        }
        writer.finish()
    }

    /// Reads the images back.
    ///
    /// # Errors
    /// When the bytes are no float32 `.npy` with one `[H, W]` a stamp.
    pub fn read(stamps_us: Vec<i64>, input: impl Read) -> io::Result<Self> {
        let file = npyz::NpyFile::new(input)?;
        let invalid = |found: &[u64]| {
            let wanted = format!("shape {found:?}, wanted [{}, H, W]", stamps_us.len());
            io::Error::new(io::ErrorKind::InvalidData, wanted)
        };
        let size = match *file.shape() {
            [k, h, w] if k == stamps_us.len() as u64 => u32::try_from(w).ok().zip(u32::try_from(h).ok()),
            _ => None,
        };
        let Some((width, height)) = size else { return Err(invalid(file.shape())) };
        let size = Size { width, height };
        let values = file.into_vec::<f32>()?;
        let images = values.chunks(size.pixels().max(1)).map(|v| Image::from_vec(size, v.to_vec())).collect();
        Ok(Self { stamps_us, images })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Timestamp;

    #[test]
    fn a_short_clip_keeps_its_ends_and_its_middle() {
        let stamps: Vec<i64> = (0..150).map(|j| j * 416).collect();
        assert_eq!(Anchors::choose(&stamps), [0, 75, 149]);
        assert_eq!(Anchors::choose(&[0]), [0]);
        assert_eq!(Anchors::choose(&[0, 7]), [0, 1]);
        let long: Vec<i64> = (0..=1000).map(|j| j * 1000).collect();
        assert_eq!(Anchors::choose(&long), [0, 100, 200, 300, 400, 500, 600, 700, 800, 900, 1000]);
    }

    #[test]
    fn what_was_written_is_read() {
        let size = Size { width: 3, height: 2 };
        let mut anchors = Anchors::empty();
        for index in 0..2 {
            let luminance = Image::from_vec(size, (0u8..6).map(|v| f32::from(v) + 0.5).collect());
            anchors.keep(&Frame { index, t: Timestamp(0), luminance, rate: None }, 417 * index as i64);
        }
        let mut bytes = Vec::new();
        anchors.write_images(&mut bytes).unwrap();
        assert_eq!(Anchors::read(vec![0, 417], bytes.as_slice()).unwrap(), anchors);
        assert!(Anchors::read(vec![0], bytes.as_slice()).is_err());
    }
}
