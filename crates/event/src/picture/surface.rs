//! A time surface: the age of the last event of each pixel, red for ON, blue for OFF, on white.
//!
//! An event of age `a` at the end of the window has `exp(-a/tau)` of the full colour, as in the
//! surfaces of Lagorce et al. (HOTS, PAMI 2017). Pixels without an event in the window are white.
//!
//! # Examples
//! ```
//! use gs2e_event::picture::surface::TimeSurface;
//! use gs2e_event::{EventSink as _, EventSource as _, text};
//!
//! let text = "# t x y p in us; sensor 3x1\n0 0 0 1\n900 1 0 1\n";
//! let mut reader = text::Reader::new(text.as_bytes(), None, None)?;
//! let mut events = Vec::new();
//! reader.next_chunk(&mut events)?;
//! let mut surface = TimeSurface::new(reader.header().size, 0..1000)?;
//! surface.append(&events)?;
//! let picture = surface.image(300.0);
//! // The younger event has more colour, so less blue; the last pixel is white.
//! assert!(picture.pixels()[1][2] < picture.pixels()[0][2]);
//! assert_eq!(picture.pixels()[2], [255; 3]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::{Event, EventSink, Polarity};
use gs2e_image::{Image, Size};
use std::collections::TryReserveError;
use std::ops::Range;

/// For a window without end: length that is kept, in time constants.
const REACH: i64 = 4;

/// Stores the last event of each pixel in a window.
#[derive(Debug, Clone)]
pub struct TimeSurface {
    window_us: Range<i64>,
    first_us: Option<i64>,
    last_us: i64,
    /// Time of the last event of each pixel. 0 before the first, because zeros take no memory until
    /// an event is stored.
    latest_us: Image<i64>,
    /// Polarity of the last event of each pixel, from [`POLARITY_CODES`]; 0 before the first.
    polarities: Image<u8>,
}

/// OFF and ON in `polarities`.
const POLARITY_CODES: [u8; 2] = [1, 2];

impl TimeSurface {
    /// A white picture of a sensor of `size`, for the events with
    /// `window_us.start <= t < window_us.end`. With `i64::MIN` and `i64::MAX`, the window is from
    /// the first event to the last.
    ///
    /// # Errors
    /// There is no memory for its pixels.
    pub fn new(size: Size, window_us: Range<i64>) -> Result<Self, TryReserveError> {
        let (latest_us, polarities) = (Image::try_filled(size, 0)?, Image::try_filled(size, 0)?);
        Ok(Self { window_us, first_us: None, last_us: 0, latest_us, polarities })
    }

    /// The default time constant: a quarter of the window, or of the stream if the window has no
    /// bounds.
    #[must_use]
    pub fn default_tau_us(&self) -> f64 {
        let begin =
            if self.window_us.start == i64::MIN { self.first_us.unwrap_or(0) } else { self.window_us.start };
        // Events of one instant make a window of no length, and the age is divided by this.
        (self.end_us().saturating_sub(begin) / REACH).max(1) as f64
    }

    /// The picture of the events so far, with a time constant in microseconds.
    #[must_use]
    pub fn image(&self, tau_us: f64) -> Image<[u8; 3]> {
        let end = self.end_us();
        let colour = |(&t, &code): (&i64, &u8)| {
            let Some(polarity) = POLARITY_CODES.iter().position(|known| *known == code) else {
                return [255; 3];
            };
            let fresh = libm::exp(-(end.saturating_sub(t) as f64) / tau_us);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within 0 to 255")]
            let rest = (255.0 * (1.0 - fresh) + 0.5) as u8;
            if polarity == Polarity::On as usize { [255, rest, rest] } else { [rest, rest, 255] }
        };
        let pixels = self.latest_us.pixels().iter().zip(self.polarities.pixels());
        Image::from_vec(self.polarities.size(), pixels.map(colour).collect())
    }

    fn end_us(&self) -> i64 {
        if self.window_us.end == i64::MAX { self.last_us } else { self.window_us.end }
    }
}

impl EventSink for TimeSurface {
    /// Never fails. Events outside the window or the picture are ignored.
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        let Size { width, height } = self.polarities.size();
        for event in events {
            let (x, y, t) = (u32::from(event.x), u32::from(event.y), event.t.floor_micros());
            if x < width && y < height && self.window_us.contains(&t) {
                self.first_us.get_or_insert(t);
                self.last_us = t;
                let pixel = (y * width + x) as usize;
                self.latest_us.pixels_mut()[pixel] = t;
                self.polarities.pixels_mut()[pixel] = POLARITY_CODES[event.polarity as usize];
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EventLabel;
    use gs2e_num::units::Timestamp;

    fn surface(window_us: Range<i64>) -> TimeSurface {
        let mut surface = TimeSurface::new(Size { width: 4, height: 1 }, window_us).unwrap();
        let events = [
            (5, 0, Polarity::On),
            (10, 1, Polarity::Off),
            (90, 1, Polarity::On),
            (100, 2, Polarity::Off),
            (300, 3, Polarity::On),
        ];
        for (us, x, polarity) in events {
            surface
                .append(&[Event {
                    t: Timestamp::from_micros(us),
                    x,
                    y: 0,
                    polarity,
                    label: EventLabel::Signal,
                }])
                .unwrap();
        }
        surface
    }

    #[test]
    fn the_last_event_fades_by_its_age() {
        let image = surface(0..101).image(100.0);
        // Of ages 96, 11 and 1 of 100: exp(-0.96) = 0.38289, exp(-0.11) = 0.89583, exp(-0.01) =
        // 0.99005.
        let wanted = [[255, 157, 157], [255, 27, 27], [3, 3, 255], [255; 3]];
        assert_eq!(image.pixels(), wanted);
    }

    #[test]
    fn a_window_without_bounds_is_the_streams() {
        let whole = surface(i64::MIN..i64::MAX);
        assert!((whole.default_tau_us() - 73.0).abs() < 1e-9, "a quarter of 295 us");
        assert_eq!(whole.image(50.0).pixels()[3], [255, 0, 0], "the last event is fresh");
        assert!((surface(0..200).default_tau_us() - 50.0).abs() < 1e-9);
    }
}
