//! Event rate over time as bars: ON upwards in red, OFF downwards in blue, with one labelled scale.
//!
//! # Examples
//! ```
//! use gs2e_event::picture::rate::RateBars;
//! use gs2e_event::{EventSink as _, EventSource as _, text};
//!
//! let mut reader = text::Reader::new("# t x y p in us; sensor 2x1\n5 0 0 1\n".as_bytes(), None, None)?;
//! let mut events = Vec::new();
//! reader.next_chunk(&mut events)?;
//! let mut bars = RateBars::new(0..1_000_000);
//! bars.append(&events)?;
//! // One ON event and no OFF event in all bars together.
//! let seconds = bars.bar_us() as f64 * 1e-6;
//! let counts = bars.per_second().iter().fold([0.0, 0.0], |sum, bar| [sum[0] + bar[0], sum[1] + bar[1]]);
//! assert!((counts[0] * seconds - 1.0).abs() < 1e-9 && counts[1] == 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::text;
use crate::{Event, EventSink};
use gs2e_image::{Image, Size};
use gs2e_num::units::format_amount;
use std::ops::Range;

/// Maximum number of bars. For longer streams, neighbours are merged.
const MAX_BARS: usize = 1024;
/// Minimum width of the plot.
const MIN_WIDTH: usize = 640;
/// Height of the ON half and of the OFF half.
const HALF: usize = 120;
/// Margins of the plot: space for the labels above and below.
const MARGIN: usize = 14;

const WHITE: [u8; 3] = [255; 3];
const GRID: [u8; 3] = [224; 3];
const AXIS: [u8; 3] = [96; 3];
const ON: [u8; 3] = [214, 39, 40];
const OFF: [u8; 3] = [31, 87, 180];

/// Counts the events of bars of equal length.
#[derive(Debug, Clone)]
pub struct RateBars {
    window_us: Range<i64>,
    /// Start of the first bar.
    begin_us: Option<i64>,
    /// Length of a bar; a power of two.
    bar_us: i64,
    /// OFF and ON.
    bars: Vec<[u64; 2]>,
}

impl RateBars {
    /// An empty plot for the events with `window_us.start <= t < window_us.end`. With `i64::MIN`
    /// and `i64::MAX`, the window is from the first event to the last.
    #[must_use]
    pub fn new(window_us: Range<i64>) -> Self {
        let begin_us = (window_us.start != i64::MIN).then_some(window_us.start);
        let mut rate = Self { window_us, begin_us, bar_us: 1, bars: Vec::new() };
        if let (Some(begin), true) = (begin_us, rate.window_us.end != i64::MAX) {
            // The whole window is drawn, with or without events.
            // The end is not part of the window, so the last bar holds the microsecond before it.
            rate.reach(rate.window_us.end.saturating_sub(begin).saturating_sub(1));
        }
        rate
    }

    /// Events per second in each bar: ON and OFF.
    #[must_use]
    pub fn per_second(&self) -> Vec<[f64; 2]> {
        let hz = |count: u64| count as f64 * 1e6 / self.bar_us as f64;
        self.bars.iter().map(|&[off, on]| [hz(on), hz(off)]).collect()
    }

    /// Length of a bar.
    #[must_use]
    pub fn bar_us(&self) -> i64 {
        self.bar_us
    }

    /// The plot of the events so far.
    #[must_use]
    pub fn image(&self) -> Image<[u8; 3]> {
        // Few bars are drawn wider, so that the labels have room.
        let wide = MIN_WIDTH.div_ceil(self.bars.len().max(1)).max(1);
        let width = (wide * self.bars.len()).max(MIN_WIDTH);
        let height = 2 * (HALF + MARGIN) + 1;
        let side = |n: usize| u32::try_from(n).expect("bars are few");
        let mut image = Image::filled(Size { width: side(width), height: side(height) }, WHITE);
        let zero = MARGIN + HALF;
        for quarter in 1..=4 {
            let away = quarter * HALF / 4;
            for row in [zero - away, zero + away] {
                fill_rectangle(&mut image, 0..width, row..row + 1, GRID);
            }
        }
        // At least 1, because a stream without events has no highest bar to divide by.
        let most = self.bars.iter().flatten().copied().max().unwrap_or(0).max(1);
        for (number, &[off, on]) in self.bars.iter().enumerate() {
            let columns = number * wide..(number + 1) * wide;
            let [up, down] = [on, off].map(|count| bar_rows(count, most));
            fill_rectangle(&mut image, columns.clone(), zero - up..zero, ON);
            fill_rectangle(&mut image, columns, zero + 1..zero + 1 + down, OFF);
        }
        fill_rectangle(&mut image, 0..width, zero..zero + 1, AXIS);
        self.label(&mut image, most);
        image
    }

    /// The labels: the value of the highest bar, and the times of both ends.
    fn label(&self, image: &mut Image<[u8; 3]>, most: u64) {
        let Size { width, height } = image.size();
        // In 128 bits: the product of a count and a million may exceed 64.
        let hz = u128::from(most) * 1_000_000 / u128::from(self.bar_us.unsigned_abs());
        text::draw_text(image, [3, 3], &format_amount(u64::try_from(hz).unwrap_or(u64::MAX), "ev/s"));
        let begin = self.begin_us.unwrap_or(0);
        let end =
            begin.saturating_add(self.bar_us.saturating_mul(self.bars.len().try_into().unwrap_or(i64::MAX)));
        let [begin, end] = [begin, end.min(self.window_us.end)].map(|us| format!("{} s", us as f64 / 1e6));
        let bottom = height - 10;
        text::draw_text(image, [3, bottom], &begin);
        text::draw_text(image, [width.saturating_sub(3 + text::text_width(&end)), bottom], &end);
    }

    /// Extends the bars up to a time after the start of the first.
    fn reach(&mut self, after_us: i64) -> usize {
        let number = loop {
            let number = usize::try_from(after_us / self.bar_us).unwrap_or(usize::MAX);
            if number < MAX_BARS {
                break number;
            }
            // Pairs are added from the first bar on, so the start of the plot stays where it is.
            self.bar_us *= 2;
            let sum = |pair: &[[u64; 2]]| pair.iter().fold([0, 0], |[a, b], [c, d]| [a + c, b + d]);
            self.bars = self.bars.chunks(2).map(sum).collect();
        };
        if self.bars.len() <= number {
            self.bars.resize(number + 1, [0; 2]);
        }
        number
    }
}

impl EventSink for RateBars {
    /// Never fails. Events outside the window are ignored.
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        for event in events {
            let t = event.t.floor_micros();
            if self.window_us.contains(&t) {
                let begin = *self.begin_us.get_or_insert(t);
                // The stream need not be sorted: what is earlier than its first event counts in the first
                // bar.
                let number = self.reach(t.saturating_sub(begin).max(0));
                self.bars[number][event.polarity as usize] += 1;
            }
        }
        Ok(())
    }
}

/// Number of rows of a bar; at least one if there is an event.
fn bar_rows(count: u64, most: u64) -> usize {
    // Rounded up, so that a single event shows.
    let rows = (u128::from(count) * HALF as u128).div_ceil(u128::from(most));
    usize::try_from(rows).unwrap_or(HALF)
}

fn fill_rectangle(image: &mut Image<[u8; 3]>, columns: Range<usize>, rows: Range<usize>, colour: [u8; 3]) {
    let width = image.size().width as usize;
    for row in rows {
        image.pixels_mut()[row * width..][columns.clone()].fill(colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EventLabel, Polarity};
    use gs2e_num::units::Timestamp;

    fn rate_bars(window_us: Range<i64>, events: impl Iterator<Item = (i64, Polarity)>) -> RateBars {
        let mut rate = RateBars::new(window_us);
        for (us, polarity) in events {
            rate.append(&[Event {
                t: Timestamp::from_micros(us),
                x: 0,
                y: 0,
                polarity,
                label: EventLabel::Signal,
            }])
            .unwrap();
        }
        rate
    }

    #[test]
    fn bars_hold_every_event_however_long_the_stream_is() {
        for count in [1, 1000, 1024, 1025, 100_000] {
            let polarity = |i| if i % 4 == 0 { Polarity::Off } else { Polarity::On };
            let rate = rate_bars(i64::MIN..i64::MAX, (0..count).map(|i| (500 + 3 * i, polarity(i))));
            let seconds = rate.bar_us() as f64 * 1e-6;
            let sums = rate.per_second().iter().fold([0.0, 0.0], |[a, b], [on, off]| [a + on, b + off]);
            let off = (count + 3) / 4;
            let near =
                |found: f64, wanted: i64| (found * seconds - wanted as f64).abs() < 1e-6 * count as f64;
            assert!(near(sums[0], count - off) && near(sums[1], off), "{count}: {sums:?}");
            assert!(rate.bars.len() <= MAX_BARS && rate.bar_us() * 1024 >= 3 * (count - 1));
        }
    }

    #[test]
    fn a_window_is_drawn_in_full_and_holds_what_lies_in_it() {
        let events = [(5, Polarity::On), (10, Polarity::On), (11, Polarity::Off), (20, Polarity::On)];
        let rate = rate_bars(10..20, events.into_iter());
        let mut wanted = vec![[0.0, 0.0]; 10];
        (wanted[0], wanted[1]) = ([1e6, 0.0], [0.0, 1e6]);
        assert_eq!(rate.per_second(), wanted);
        let image = rate.image();
        let at = |x: usize, y: usize| image.pixels()[y * image.size().width as usize + x];
        let zero = MARGIN + HALF;
        assert_eq!(image.size().width, 640);
        assert_eq!((at(0, zero - 1), at(0, zero - HALF), at(0, zero + 1)), (ON, ON, WHITE));
        assert_eq!((at(64, zero - 1), at(64, zero + 1), at(127, zero + HALF)), (WHITE, OFF, OFF));
        assert_eq!((at(128, zero), at(128, zero + 1)), (AXIS, WHITE));
    }

    #[test]
    fn no_event_is_a_picture_too() {
        let image = rate_bars(i64::MIN..i64::MAX, std::iter::empty()).image();
        assert!(image.pixels().iter().all(|&v| v != ON && v != OFF));
    }
}
