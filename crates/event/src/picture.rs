//! Events as a picture: red where a pixel grew brighter, blue where it grew darker, on white.
//!
//! The colour of a pixel shows its balance of ON and OFF events in the window: one event gives half
//! of the full colour, and each further event halves the rest. Pixels whose events cancel are grey.
//!
//! # Examples
//! ```
//! use gs2e_event::picture::WindowCounts;
//! use gs2e_event::{EventSink as _, EventSource as _, text};
//!
//! let mut reader = text::Reader::new("# t x y p in us; sensor 2x1\n5 0 0 1\n".as_bytes(), None, None)?;
//! let mut events = Vec::new();
//! reader.next_chunk(&mut events)?;
//! let mut counts = WindowCounts::new(reader.header().size, 0..10)?;
//! counts.append(&events)?;
//! let picture = counts.image();
//! // Red where it grew brighter, white where nothing happened.
//! assert!(picture.pixels()[0][0] > picture.pixels()[0][2]);
//! assert_eq!(picture.pixels()[1], [255; 3]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod rate;
pub mod surface;
mod text;

use super::{Event, EventSink};
use gs2e_image::{Image, Size};
use std::collections::TryReserveError;
use std::ops::Range;

/// Grey of a pixel whose events cancel.
const CANCELLED: [u8; 3] = [208; 3];

/// Counts the events of a time window, for any number of events in the stream.
#[derive(Debug, Clone)]
pub struct WindowCounts {
    window_us: Range<i64>,
    /// OFF and ON events of each pixel: arrays of zeros take no memory until an event is counted.
    balance: Image<[u32; 2]>,
}

impl WindowCounts {
    /// A white picture of a sensor of `size`, for the events with
    /// `window_us.start <= t < window_us.end`.
    ///
    /// # Errors
    /// There is no memory for its pixels.
    pub fn new(size: Size, window_us: Range<i64>) -> Result<Self, TryReserveError> {
        Ok(Self { window_us, balance: Image::try_filled(size, [0; 2])? })
    }

    /// The picture of the events so far.
    #[must_use]
    pub fn image(&self) -> Image<[u8; 3]> {
        Image::from_vec(self.balance.size(), self.balance.pixels().iter().map(|b| colour(*b)).collect())
    }

    fn count(&mut self, event: &Event) {
        let Size { width, height } = self.balance.size();
        let (x, y) = (u32::from(event.x), u32::from(event.y));
        if x < width && y < height && self.window_us.contains(&event.t.floor_micros()) {
            let pixel = &mut self.balance.pixels_mut()[(y * width + x) as usize];
            let count = &mut pixel[event.polarity as usize];
            // A count that overflowed would turn a busy pixel white.
            *count = count.saturating_add(1);
        }
    }
}

impl EventSink for WindowCounts {
    /// Never fails. Events outside the window or the picture are ignored.
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        events.iter().for_each(|event| self.count(event));
        Ok(())
    }
}

/// The colour of a pixel with these numbers of OFF and ON events.
fn colour([off, on]: [u32; 2]) -> [u8; 3] {
    // A shift by 8 or more leaves no white.
    let rest = 255u8.checked_shr(on.abs_diff(off)).unwrap_or(0);
    match on.cmp(&off) {
        std::cmp::Ordering::Greater => [255, rest, rest],
        std::cmp::Ordering::Less => [rest, rest, 255],
        std::cmp::Ordering::Equal if on > 0 => CANCELLED,
        std::cmp::Ordering::Equal => [255; 3],
    }
}

/// Joins pictures horizontally, with their top edges aligned and `gap` white columns between them.
#[must_use]
pub fn join_pictures(pictures: &[&Image<[u8; 3]>], gap: u32) -> Image<[u8; 3]> {
    let sizes = || pictures.iter().map(|p| p.size());
    let gaps: u32 = pictures.iter().skip(1).map(|_| gap).sum();
    let size = Size {
        width: sizes().map(|s| s.width).sum::<u32>() + gaps,
        height: sizes().map(|s| s.height).max().unwrap_or(0),
    };
    let mut whole = Image::filled(size, [255; 3]);
    let mut left = 0;
    for picture in pictures {
        copy_into(&mut whole, picture, [left, 0]);
        left += picture.size().width + gap;
    }
    whole
}

/// Pictures in rows of `columns`, each under its caption. Captions may contain the letters of
/// numbers and units.
#[must_use]
pub fn picture_grid(pictures: &[(Image<[u8; 3]>, String)], columns: usize, gap: u32) -> Image<[u8; 3]> {
    const CAPTION: u32 = 11;
    let captioned = |(picture, caption): &(Image<[u8; 3]>, String)| {
        let Size { width, height } = picture.size();
        // A caption wider than its picture widens the cell.
        let width = width.max(text::text_width(caption));
        let mut whole = Image::filled(Size { width, height: height + CAPTION }, [255; 3]);
        text::draw_text(&mut whole, [1, 2], caption);
        copy_into(&mut whole, picture, [0, CAPTION]);
        whole
    };
    let pictures: Vec<Image<[u8; 3]>> = pictures.iter().map(captioned).collect();
    let row = |row: &[Image<[u8; 3]>]| join_pictures(&row.iter().collect::<Vec<_>>(), gap);
    let rows: Vec<Image<[u8; 3]>> = pictures.chunks(columns.max(1)).map(row).collect();
    let gaps: u32 = rows.iter().skip(1).map(|_| gap).sum();
    let size = Size {
        width: rows.iter().map(|row| row.size().width).max().unwrap_or(0),
        height: rows.iter().map(|row| row.size().height).sum::<u32>() + gaps,
    };
    let mut whole = Image::filled(size, [255; 3]);
    let mut top = 0;
    for row in &rows {
        copy_into(&mut whole, row, [0, top]);
        top += row.size().height + gap;
    }
    whole
}

/// Copies a picture into a larger one.
fn copy_into(whole: &mut Image<[u8; 3]>, picture: &Image<[u8; 3]>, [left, top]: [u32; 2]) {
    let (width, stride) = (picture.size().width as usize, whole.size().width as usize);
    for (row, from) in picture.pixels().chunks(width.max(1)).enumerate() {
        let at = (top as usize + row) * stride + left as usize;
        whole.pixels_mut()[at..][..width].copy_from_slice(from);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EventLabel, Polarity};
    use gs2e_num::units::Timestamp;

    #[test]
    fn colours_show_the_balance_within_the_window() {
        let mut picture = WindowCounts::new(Size { width: 5, height: 1 }, 10..20).unwrap();
        let mut see = |x, us, polarity| {
            picture
                .append(&[Event {
                    t: Timestamp::from_micros(us),
                    x,
                    y: 0,
                    polarity,
                    label: EventLabel::Signal,
                }])
                .unwrap();
        };
        see(0, 10, Polarity::On);
        see(1, 12, Polarity::Off);
        see(1, 19, Polarity::Off);
        see(2, 13, Polarity::On);
        see(2, 14, Polarity::Off);
        see(3, 9, Polarity::On);
        see(3, 20, Polarity::On);
        (0..40).for_each(|_| see(4, 15, Polarity::Off));
        see(9, 15, Polarity::Off);
        let wanted = [[255, 127, 127], [63, 63, 255], CANCELLED, [255; 3], [0, 0, 255]];
        assert_eq!(picture.image().pixels(), wanted);
    }

    #[test]
    fn pictures_stand_side_by_side() {
        let a = Image::filled(Size { width: 2, height: 2 }, [1u8; 3]);
        let b = Image::filled(Size { width: 1, height: 1 }, [2u8; 3]);
        let both = join_pictures(&[&a, &b], 1);
        assert_eq!(both.size(), Size { width: 4, height: 2 });
        let greys: Vec<u8> = both.pixels().iter().map(|p| p[0]).collect();
        assert_eq!(greys, [1, 1, 255, 2, 1, 1, 255, 255]);
        assert_eq!(join_pictures(&[], 3).size().pixels(), 0);
    }

    #[test]
    fn a_grid_has_rows_and_captions() {
        let dot = || (Image::filled(Size { width: 1, height: 1 }, [7u8; 3]), "1.5".to_owned());
        let whole = picture_grid(&[dot(), dot(), dot()], 2, 3);
        // Three letters of 6 columns, and a caption of 11 rows above each dot.
        assert_eq!(whole.size(), Size { width: 2 * 18 + 3, height: 2 * 12 + 3 });
        let dots: Vec<usize> = (0..whole.pixels().len()).filter(|i| whole.pixels()[*i] == [7; 3]).collect();
        assert_eq!(dots, [11 * 39, 11 * 39 + 21, 26 * 39]);
        assert!(whole.pixels().iter().filter(|p| **p == [64; 3]).count() > 60, "captions are drawn");
    }
}
