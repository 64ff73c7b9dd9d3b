//! Events as a picture: red where a pixel grew brighter, blue where it grew darker, on white.
//!
//! A pixel's colour is its balance of ON and OFF events within the window: one event is half the full colour, each
//! further one halves what is left. Pixels whose events cancel are grey.

pub mod rate;
pub mod surface;
mod text;

use super::{Event, EventSink, Polarity};
use crate::image::{Image, Size};
use std::ops::Range;

/// Grey of a pixel whose events cancel.
const CANCELLED: [u8; 3] = [208; 3];

/// Counts the events of a time window, whatever else the stream holds.
#[derive(Debug, Clone)]
pub struct Picture {
    window_us: Range<i64>,
    balance: Image<Balance>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Balance {
    on: u32,
    off: u32,
}

impl Picture {
    /// A white picture of a sensor of `size`, for the events with `window_us.start <= t < window_us.end`.
    #[must_use]
    pub fn new(size: Size, window_us: Range<i64>) -> Self {
        Self { window_us, balance: Image::filled(size, Balance::default()) }
    }

    /// The picture of what was seen so far.
    #[must_use]
    pub fn image(&self) -> Image<[u8; 3]> {
        Image::from_vec(self.balance.size(), self.balance.pixels().iter().map(|b| b.colour()).collect())
    }

    fn count(&mut self, event: &Event) {
        let Size { width, height } = self.balance.size();
        let (x, y) = (u32::from(event.x), u32::from(event.y));
        if x < width && y < height && self.window_us.contains(&event.t.floor_micros()) {
            let pixel = &mut self.balance.pixels_mut()[(y * width + x) as usize];
            match event.polarity {
                Polarity::On => pixel.on += 1,
                Polarity::Off => pixel.off += 1,
            }
        }
    }
}

impl EventSink for Picture {
    /// Never fails; events outside the window or the picture are left out.
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        events.iter().for_each(|event| self.count(event));
        Ok(())
    }
}

impl Balance {
    fn colour(self) -> [u8; 3] {
        let rest = 255u8.checked_shr(self.on.abs_diff(self.off)).unwrap_or(0);
        match self.on.cmp(&self.off) {
            std::cmp::Ordering::Greater => [255, rest, rest],
            std::cmp::Ordering::Less => [rest, rest, 255],
            std::cmp::Ordering::Equal if self.on > 0 => CANCELLED,
            std::cmp::Ordering::Equal => [255; 3],
        }
    }
}

/// Pictures side by side, top edges in line, `gap` white columns between them.
#[must_use]
pub fn beside(pictures: &[&Image<[u8; 3]>], gap: u32) -> Image<[u8; 3]> {
    let sizes = || pictures.iter().map(|p| p.size());
    let gaps: u32 = pictures.iter().skip(1).map(|_| gap).sum();
    let size = Size {
        width: sizes().map(|s| s.width).sum::<u32>() + gaps,
        height: sizes().map(|s| s.height).max().unwrap_or(0),
    };
    let mut whole = Image::filled(size, [255; 3]);
    let mut left = 0;
    for picture in pictures {
        let Size { width, height } = picture.size();
        for row in 0..height as usize {
            let from = &picture.pixels()[row * width as usize..][..width as usize];
            whole.pixels_mut()[row * size.width as usize + left..][..width as usize].copy_from_slice(from);
        }
        left += (width + gap) as usize;
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Timestamp;

    #[test]
    fn colours_show_the_balance_within_the_window() {
        let mut picture = Picture::new(Size { width: 5, height: 1 }, 10..20);
        let mut see = |x, us, polarity| {
            picture.append(&[Event { t: Timestamp::from_micros(us), x, y: 0, polarity }]).unwrap();
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
        let both = beside(&[&a, &b], 1);
        assert_eq!(both.size(), Size { width: 4, height: 2 });
        let greys: Vec<u8> = both.pixels().iter().map(|p| p[0]).collect();
        assert_eq!(greys, [1, 1, 255, 2, 1, 1, 255, 255]);
        assert_eq!(beside(&[], 3).size().pixels(), 0);
    }
}
