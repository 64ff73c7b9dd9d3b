//! Frames kept from a passing sequence, so that checks can compare its events with what the sensor
//! saw.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::frames::anchors::AnchorChoice;
//!
//! // 101 frames, a millisecond apart, in two intervals: the ends and the middle. At each quarter, a span of
//! // three neighbours.
//! let stamps_us: Vec<i64> = (0..=100).map(|i| 1000 * i).collect();
//! let choice = AnchorChoice::in_intervals(&stamps_us, 1, 2);
//! assert_eq!(choice.frames, [0, 25, 26, 27, 50, 51, 52, 75, 76, 77, 100]);
//! // Spans name places in that list.
//! assert_eq!(choice.spans[0].map(|place| choice.frames[place]), [25, 26, 27]);
//! ```

use super::DenseFrame;
use gs2e_image::{Image, npy};
use std::io::{self, Read, Write};

/// Luminance of some frames: the first, the last, and some between.
#[derive(Debug, Clone, PartialEq)]
pub struct AnchorFrames {
    /// Stamps of the kept frames in microseconds.
    pub stamps_us: Vec<i64>,
    /// Luminance on the grey scale 0..255.
    pub images: Vec<Image<f32>>,
    /// As [`AnchorChoice::spans`].
    pub spans: Vec<[usize; 3]>,
}

/// Time between anchors, if the sequence has room for at least two of these intervals.
const SPACING_US: i64 = 100_000;
/// Number of equal intervals of a sequence. Spans begin at the inner borders.
const QUARTERS: i64 = 4;
/// Maximum length of a span, as a divisor of the sequence's length.
const SPANS_IN: usize = 8;

/// The frames of a sequence that are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AnchorChoice {
    /// Indices of the frames, ascending.
    pub frames: Vec<usize>,
    /// Index triples of closely spaced, evenly spaced images, one per span: the image moves little
    /// within a span.
    pub spans: Vec<[usize; 3]>,
}

impl AnchorChoice {
    /// The ends of a sequence, and between them the frames nearest to equal intervals of 0.1 s or
    /// slightly more (two intervals if the sequence is shorter). At each quarter of the sequence, a
    /// span of twice `apart` frames, shortened to an eighth of the sequence if necessary.
    #[must_use]
    pub fn from_stamps(stamps_us: &[i64], apart: usize) -> Self {
        let span = stamps_us.last().zip(stamps_us.first()).map_or(0, |(last, first)| last - first);
        Self::in_intervals(stamps_us, apart, (span / SPACING_US).max(2))
    }

    /// As [`AnchorChoice::from_stamps`], with this number of equal intervals.
    ///
    /// # Panics
    /// There are no intervals.
    #[must_use]
    pub fn in_intervals(stamps_us: &[i64], apart: usize, intervals: i64) -> Self {
        let (Some(first), Some(last)) = (stamps_us.first(), stamps_us.last()) else {
            return Self { frames: Vec::new(), spans: Vec::new() };
        };
        let span = last - first;
        let nearest = |i: i64, intervals: i64| {
            let wanted = first + span * i / intervals;
            let after = stamps_us.partition_point(|t| *t < wanted).min(stamps_us.len() - 1);
            let before = after.saturating_sub(1);
            if wanted - stamps_us[before] < stamps_us[after] - wanted { before } else { after }
        };
        let mut frames: Vec<usize> = (0..=intervals).map(|i| nearest(i, intervals)).collect();
        // A span is twice `apart` long, hence the 2.
        let apart = apart.clamp(1, (stamps_us.len() / (2 * SPANS_IN)).max(1));
        let starts = (1..QUARTERS).map(|i| nearest(i, QUARTERS));
        let threes = starts.map(|start| [start, start + apart, start + 2 * apart]);
        // Where stamps are uneven, the last quarter may begin too close to the end.
        let threes: Vec<[usize; 3]> = threes.filter(|[.., end]| *end < stamps_us.len()).collect();
        frames.extend(threes.as_flattened());
        frames.sort_unstable();
        frames.dedup();
        let place = |frame| frames.binary_search(&frame).expect("it is one of them");
        let mut spans: Vec<[usize; 3]> = threes.iter().map(|three| three.map(place)).collect();
        // In a very short sequence several quarters begin at the same frame.
        spans.dedup();
        Self { frames, spans }
    }
}

impl AnchorFrames {
    /// Anchors of this choice, with no frame yet.
    #[must_use]
    pub fn without_frames(choice: &AnchorChoice) -> Self {
        Self { stamps_us: Vec::new(), images: Vec::new(), spans: choice.spans.clone() }
    }

    /// Keeps a frame, which must be the next of the chosen ones.
    pub fn keep(&mut self, frame: &DenseFrame, stamp_us: i64) {
        self.stamps_us.push(stamp_us);
        self.images.push(frame.luminance.clone());
    }

    /// Writes the images as `.npy`, float32 `[K, H, W]`.
    ///
    /// # Errors
    /// The bytes cannot be written.
    pub fn write_images(&self, out: impl Write) -> io::Result<()> {
        npy::write_stack(&self.images, out)
    }

    /// Reads the images back.
    ///
    /// # Errors
    /// The bytes are not a float32 `.npy` with one `[H, W]` image per stamp, or a span does not
    /// have three images.
    pub fn read_images(stamps_us: Vec<i64>, spans: Vec<[usize; 3]>, input: impl Read) -> io::Result<Self> {
        if spans.as_flattened().iter().any(|place| *place >= stamps_us.len()) {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "a span has no image"));
        }
        let images = npy::read_stack(stamps_us.len(), input)?;
        Ok(Self { stamps_us, images, spans })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;
    use gs2e_num::units::Timestamp;

    #[test]
    fn a_short_clip_keeps_its_ends_and_its_middle_and_three_spans() {
        let stamps: Vec<i64> = (0..150).map(|j| j * 416).collect();
        let choice = AnchorChoice::from_stamps(&stamps, 5);
        assert_eq!(choice.frames, [0, 37, 42, 47, 75, 80, 85, 112, 117, 122, 149]);
        assert_eq!(choice.spans, [[1, 2, 3], [4, 5, 6], [7, 8, 9]]);
        let long: Vec<i64> = (0..=1000).map(|j| j * 1000).collect();
        let choice = AnchorChoice::from_stamps(&long, 20);
        let wanted =
            [0, 100, 200, 250, 270, 290, 300, 400, 500, 520, 540, 600, 700, 750, 770, 790, 800, 900, 1000];
        assert_eq!(choice.frames, wanted);
        assert_eq!(choice.spans, [[3, 4, 5], [8, 9, 10], [13, 14, 15]]);
        // Other anchors may lie between the three.
        let choice = AnchorChoice::from_stamps(&long, 1000);
        assert_eq!(choice.spans[0].map(|place| choice.frames[place]), [250, 312, 374]);
    }

    #[test]
    fn a_sequence_too_short_for_spans_has_what_it_can_have() {
        assert_eq!(AnchorChoice::from_stamps(&[], 5), AnchorChoice { frames: vec![], spans: vec![] });
        assert_eq!(AnchorChoice::from_stamps(&[0], 5), AnchorChoice { frames: vec![0], spans: vec![] });
        assert_eq!(AnchorChoice::from_stamps(&[0, 7], 5), AnchorChoice { frames: vec![0, 1], spans: vec![] });
        assert_eq!(
            AnchorChoice::from_stamps(&[0, 7, 14, 21], 5),
            AnchorChoice { frames: vec![0, 1, 2, 3], spans: vec![[1, 2, 3]] }
        );
    }

    #[test]
    fn what_was_written_is_read() {
        let size = Size { width: 3, height: 2 };
        let mut anchors =
            AnchorFrames::without_frames(&AnchorChoice { frames: vec![0, 1], spans: Vec::new() });
        for index in 0..2 {
            let luminance = Image::from_vec(size, (0u8..6).map(|v| f32::from(v) + 0.5).collect());
            anchors.keep(&DenseFrame { index, t: Timestamp(0), luminance, rate: None }, 417 * index as i64);
        }
        let mut bytes = Vec::new();
        anchors.write_images(&mut bytes).unwrap();
        assert_eq!(AnchorFrames::read_images(vec![0, 417], Vec::new(), bytes.as_slice()).unwrap(), anchors);
        assert!(AnchorFrames::read_images(vec![0], Vec::new(), bytes.as_slice()).is_err());
        assert!(AnchorFrames::read_images(vec![0, 417], vec![[0, 1, 2]], bytes.as_slice()).is_err());
    }
}
