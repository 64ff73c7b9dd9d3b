//! Frames of a dataset at some pixels: the frames that the estimates need, and no others.

use super::bursts::FrameBursts;
use super::places::{PixelPlaces, quadrant};
use gs2e_image::{Image, Size, srgb};
use gs2e_sensor::WHITE;
use std::collections::BTreeMap;

/// Number of spans for the correlation and the thresholds, evenly spread over the frames.
const SPANS: usize = 8;
/// A span is this part of the whole time, unless that exceeds [`MAX_SPAN_US`] or is below a frame
/// interval.
const SPANS_PER_RECORDING: i64 = 16;
/// Longest span, us, where frames are closer together.
const MAX_SPAN_US: i64 = 100_000;
/// Number of instants for the offset.
const INSTANTS: usize = 6;
/// Distances of the frames around an instant, in frames.
pub(super) const LADDER: [usize; 6] = [1, 2, 4, 8, 16, 32];
/// Maximum number of pixels.
const MAX_PIXELS: usize = 1 << 14;
/// Greys between which a logarithm is known: below, a step of 8 bits exceeds 5 %; above, a camera may
/// saturate.
pub(super) const KNOWN: std::ops::RangeInclusive<f32> = 20.0..=250.0;
/// Change of the logarithm above which a pixel counts as changed.
const CHANGED: f64 = 0.05;
/// Minimum number of changes.
const MIN_CHANGED: usize = 500;

/// Decoding of a grey before its logarithm is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleDecode {
    /// None: brightness is the grey itself.
    Encoded,
    /// The sRGB curve: brightness is linear light.
    Linear,
}

impl SampleDecode {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Encoded, Self::Linear];

    /// The name in sentences.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Encoded => "the grey of the frames",
            Self::Linear => "linear light, by the sRGB curve",
        }
    }

    fn log(self, grey: f32) -> f64 {
        let share = f64::from(grey) / WHITE;
        libm::log(match self {
            Self::Encoded => share,
            Self::Linear => srgb::decode(share),
        })
    }
}

/// Frames of the sensor's size, at some pixels.
#[derive(Debug, Clone)]
pub struct DatasetFrames {
    /// Size of the frames.
    pub size: Size,
    /// Stamps of all frames, us, strictly increasing.
    pub stamps_us: Vec<i64>,
    /// Indices of the pixels. With a pixel, its mirror images are among them, so that mirrored frames
    /// can be tried.
    pub(super) pixels: Vec<usize>,
    /// Greys of these pixels in the frames that were kept, by the index of the frame.
    kept: BTreeMap<usize, Vec<f32>>,
    /// Runs of consecutive frames at fewer pixels.
    pub(super) bursts: FrameBursts,
    /// Stamp and picture of the frame in the middle.
    pub middle: Option<(i64, Image<f32>)>,
}

impl DatasetFrames {
    /// Frames of this size at these stamps, none of them kept yet.
    #[must_use]
    pub fn new(size: Size, stamps_us: Vec<i64>) -> Self {
        let pixels = mirrored_lattice(size);
        let bursts = FrameBursts::new(size, &stamps_us, &pixels);
        Self { size, stamps_us, pixels, kept: BTreeMap::new(), bursts, middle: None }
    }

    /// Indices of the frames to keep, ascending.
    #[must_use]
    pub fn needed(&self) -> Vec<usize> {
        let near = self.instants().into_iter().flat_map(|instant| self.frames_near(instant));
        let mut needed: Vec<usize> =
            self.spans().into_iter().flatten().chain(near).chain(self.bursts.needed()).collect();
        needed.push(self.stamps_us.len() / 2);
        needed.sort_unstable();
        needed.dedup();
        needed.retain(|index| *index < self.stamps_us.len());
        needed
    }

    /// Keeps a frame, with grey from 0 to 255.
    ///
    /// # Panics
    /// It has another size.
    pub fn keep(&mut self, index: usize, frame: Image<f32>) {
        assert_eq!(frame.size(), self.size, "frames of one sequence have one size");
        if self.is_compared(index) {
            self.kept.insert(index, self.pixels.iter().map(|pixel| frame.pixels()[*pixel]).collect());
        }
        self.bursts.keep(index, &frame);
        if index == self.stamps_us.len() / 2 {
            self.middle = Some((self.stamps_us[index], frame));
        }
    }

    /// Returns true if a frame belongs to a span or to an instant.
    fn is_compared(&self, index: usize) -> bool {
        let of_instant = |instant: &usize| self.frames_near(*instant).binary_search(&index).is_ok();
        self.spans().as_flattened().contains(&index) || self.instants().iter().any(of_instant)
    }

    /// First and last frame of each span. Spans may overlap if there are few frames.
    pub(super) fn spans(&self) -> Vec<[usize; 2]> {
        choose_spans(&self.stamps_us)
    }

    /// Frames at which the offset is measured.
    pub(super) fn instants(&self) -> Vec<usize> {
        let count = self.stamps_us.len();
        let mut instants: Vec<usize> = (1..=INSTANTS).map(|k| k * count / (INSTANTS + 1)).collect();
        instants.dedup();
        // An instant needs a frame on either side.
        instants.retain(|instant| *instant > 0 && instant + 1 < count);
        instants
    }

    /// An instant and the frames around it that exist, ascending.
    pub(super) fn frames_near(&self, instant: usize) -> Vec<usize> {
        let before = LADDER.iter().rev().filter_map(|step| instant.checked_sub(*step));
        let after = LADDER.iter().map(|step| instant + step).filter(|index| *index < self.stamps_us.len());
        before.chain([instant]).chain(after).collect()
    }

    /// Logarithm of brightness in a kept frame, at the pixel of this place in [`Self::pixels`];
    /// `None` if it is not known.
    pub(super) fn log(&self, frame: usize, place: usize, decode: SampleDecode) -> Option<f64> {
        let grey = *self.kept.get(&frame)?.get(place)?;
        // NaN is in no range.
        KNOWN.contains(&grey).then(|| decode.log(grey))
    }

    /// Change of the logarithm from one kept frame to another.
    pub(super) fn change(&self, [from, to]: [usize; 2], place: usize, decode: SampleDecode) -> Option<f64> {
        Some(self.log(to, place, decode)? - self.log(from, place, decode)?)
    }

    /// Grey in a kept frame.
    pub(super) fn grey(&self, frame: usize, place: usize) -> f32 {
        self.kept.get(&frame).and_then(|greys| greys.get(place)).copied().unwrap_or(f32::NAN)
    }

    /// The places in [`Self::pixels`].
    pub(super) fn places(&self) -> PixelPlaces {
        PixelPlaces::new(self.size, &self.pixels)
    }

    /// The quadrant of a pixel, 0 to 3.
    pub(super) fn quadrant(&self, place: usize) -> usize {
        quadrant(self.size, self.pixels[place])
    }

    /// Median interval of two frames, us.
    pub(super) fn interval_us(&self) -> i64 {
        let mut intervals: Vec<i64> = self.stamps_us.windows(2).map(|pair| pair[1] - pair[0]).collect();
        intervals.sort_unstable();
        intervals.get(intervals.len() / 2).copied().unwrap_or(0)
    }

    /// Number of samples that change by more than this in a span; a pixel counts in each span.
    pub(super) fn count_changes(&self, least: f64) -> usize {
        let changed = |span: &[usize; 2]| {
            let changes =
                (0..self.pixels.len()).filter_map(|place| self.change(*span, place, SampleDecode::Encoded));
            changes.filter(|change| change.abs() > least).count()
        };
        self.spans().iter().map(changed).sum()
    }

    /// Checks that the frames show a change that events can be compared with. The error says what is
    /// missing.
    pub(super) fn require_change(&self, sensor: Size) -> Result<(), String> {
        // With x and y swapped, the comparison says so.
        let swapped = Size { width: sensor.height, height: sensor.width };
        if self.size != sensor && self.size != swapped {
            return Err(format!("frames of {} are not those of a sensor of {sensor}", self.size));
        }
        let spans = self.spans();
        if spans.is_empty() {
            return Err("there are fewer than two frames".to_owned());
        }
        let changed = self.count_changes(CHANGED);
        if changed < MIN_CHANGED {
            let all = self.pixels.len() * spans.len();
            return Err(format!("only {changed} of {all} samples of the frames change by 5 %"));
        }
        Ok(())
    }
}

/// First and last frame of each span.
fn choose_spans(stamps_us: &[i64]) -> Vec<[usize; 2]> {
    let (Some(first), Some(last)) = (stamps_us.first(), stamps_us.last()) else { return Vec::new() };
    let whole = last - first;
    // A part of the recording, so that the spans of a short one differ; and short enough that a
    // pixel's noise does not outweigh its change.
    let length = (whole / SPANS_PER_RECORDING).min(MAX_SPAN_US);
    let mut spans: Vec<[usize; 2]> = (0..SPANS as i64)
        .filter_map(|number| {
            let start = first + (whole - length) * number / (SPANS as i64 - 1);
            let from = stamps_us.partition_point(|t| *t < start);
            let to = stamps_us.partition_point(|t| *t < stamps_us[from] + length).max(from + 1);
            // Stamps are whole microseconds: the last span may end one beyond the last frame.
            let to = to.min(stamps_us.len() - 1);
            (to > from).then_some([from, to])
        })
        .collect();
    spans.dedup();
    spans
}

/// Pixels spread over the upper left quadrant by steps of the golden ratio, so that no column or row
/// is preferred, with their mirror images.
fn mirrored_lattice(size: Size) -> Vec<usize> {
    let (width, height) = (size.width as usize, size.height as usize);
    let (columns, rows) = (width.div_ceil(2), height.div_ceil(2));
    let all = columns * rows;
    let count = all.min(MAX_PIXELS / 4);
    let mut pixels: Vec<usize> = (0..count)
        .flat_map(|number| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a share of the pixels"
            )]
            let spread = ((number as f64 * 0.618_033_988_749_895).fract() * all as f64) as usize;
            let at = if count == all { number } else { spread.min(all - 1) };
            let (x, y) = (at % columns, at / columns);
            let (right, below) = (width - 1 - x, height - 1 - y);
            [y * width + x, y * width + right, below * width + x, below * width + right]
        })
        .collect();
    pixels.sort_unstable();
    pixels.dedup();
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_spread_over_all_frames() {
        // 151 frames at 2,400 Hz: spans of a sixteenth, 3.9 ms.
        let stamps: Vec<i64> = (0..151).map(|i| i * 10_000 / 24).collect();
        let spans = choose_spans(&stamps);
        assert_eq!((spans.len(), spans[0][0], spans[7][1]), (8, 0, 150));
        assert!(spans.iter().all(|[from, to]| (9..=11).contains(&(to - from))), "{spans:?}");
        // Five frames: each interval is a span.
        assert_eq!(choose_spans(&[0, 40_000, 80_000, 120_000, 160_000]), [[0, 1], [1, 2], [2, 3], [3, 4]]);
        assert_eq!(choose_spans(&[7]), [[0; 2]; 0]);
        assert_eq!(choose_spans(&[]), [[0; 2]; 0]);
    }

    #[test]
    fn pixels_come_with_their_mirror_images() {
        for size in [Size { width: 1280, height: 720 }, Size { width: 7, height: 5 }] {
            let pixels = mirrored_lattice(size);
            let (width, height) = (size.width as usize, size.height as usize);
            for pixel in &pixels {
                let (x, y) = (pixel % width, pixel / width);
                for mirrored in [y * width + width - 1 - x, (height - 1 - y) * width + x] {
                    assert!(pixels.binary_search(&mirrored).is_ok(), "{size}: {pixel}");
                }
            }
            assert!(pixels.len() <= MAX_PIXELS);
        }
        assert_eq!(mirrored_lattice(Size { width: 7, height: 5 }).len(), 35);
        assert!(mirrored_lattice(Size { width: 1280, height: 720 }).len() > 15_000);
    }
}
