//! A recording in memory: frames, and the events of each pixel.
//!
//! A sample of a frame takes 4 bytes, and an event 9.

use gs2e_event::{Event, Polarity};
use gs2e_image::Size;

/// Events of each pixel, in order of time.
#[derive(Debug, Clone)]
pub struct PixelTrains {
    /// Index of the first event of each pixel, and the number of all events.
    starts: Vec<usize>,
    us: Vec<i64>,
    on: Vec<bool>,
}

impl PixelTrains {
    /// Sorts events by pixel. Those of one pixel keep their order, which is that of time. Events outside of
    /// the picture are left out.
    #[must_use]
    pub fn new(size: Size, events: &[Event]) -> Self {
        let pixel_of = |event: &Event| {
            let (x, y) = (u32::from(event.x), u32::from(event.y));
            (x < size.width && y < size.height).then(|| (y * size.width + x) as usize)
        };
        let mut starts = vec![0; size.pixels() + 1];
        events.iter().filter_map(pixel_of).for_each(|pixel| starts[pixel + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        let mut next = starts.clone();
        let count = starts[size.pixels()];
        let (mut us, mut on) = (vec![0; count], vec![false; count]);
        for event in events {
            let Some(pixel) = pixel_of(event) else { continue };
            us[next[pixel]] = event.t.floor_micros();
            on[next[pixel]] = event.polarity == Polarity::On;
            next[pixel] += 1;
        }
        Self { starts, us, on }
    }

    /// Number of pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of events.
    #[must_use]
    pub fn events(&self) -> usize {
        self.us.len()
    }

    /// Times and signs of the events of a pixel.
    #[must_use]
    pub fn of(&self, pixel: usize) -> (&[i64], &[bool]) {
        let range = self.starts[pixel]..self.starts[pixel + 1];
        (&self.us[range.clone()], &self.on[range])
    }

    /// Times and signs of all events, pixel after pixel.
    pub(crate) fn all(&self) -> impl Iterator<Item = (i64, bool)> {
        self.us.iter().copied().zip(self.on.iter().copied())
    }

    /// First and last time.
    #[must_use]
    pub fn span_us(&self) -> Option<(i64, i64)> {
        Some((*self.us.iter().min()?, *self.us.iter().max()?))
    }
}

/// Frames, and the events of the same pixels on the same clock.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Size of the frames.
    pub size: Size,
    /// Stamps of the frames, strictly increasing.
    pub stamps_us: Vec<i64>,
    /// Greys from 0 to 255, frame after frame.
    pub frames: Vec<f32>,
    /// The events.
    pub trains: PixelTrains,
}

impl Recording {
    /// The grey of a pixel in a frame.
    pub(crate) fn grey(&self, frame: usize, pixel: usize) -> f64 {
        f64::from(self.frames[frame * self.size.pixels() + pixel])
    }

    /// The greys of a pixel in all frames.
    pub(crate) fn course(&self, pixel: usize) -> impl Iterator<Item = f64> {
        (0..self.stamps_us.len()).map(move |frame| self.grey(frame, pixel))
    }

    /// Length from the first to the last frame, seconds.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        let [first, last] = [self.stamps_us[0], self.stamps_us[self.stamps_us.len() - 1]];
        (last - first) as f64 * 1e-6
    }
}
