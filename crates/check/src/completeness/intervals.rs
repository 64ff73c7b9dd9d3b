//! The change that events show between neighbouring anchors, and in parts of the sensor.

use crate::drift::DriftLaw;
use gs2e_image::Size;
use gs2e_sensor::frames::anchors::AnchorFrames;

/// Smallest change of a compared pixel, in thresholds. Much smaller ones may leave no event.
const LEAST: f64 = 1.25;
/// Median image motion in a short interval, px. A pixel that an edge passes changes in one direction for
/// about as long.
const SHORT_PX: f64 = 2.0;
/// Parts of the sensor in each direction.
const TILES: usize = 4;

/// The events of one interval at the pixels that changed by more than `LEAST` thresholds in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeInterval {
    /// Its ends, us.
    pub span_us: [i64; 2],
    /// Sums over the pixels.
    pub sums: TileSums,
    /// True if the image moves by about a pixel: then a pixel that changes does so steadily.
    pub short: bool,
}

/// Sums over pixels that changed by more than `LEAST` thresholds. `pixels`, `asked` and `stated` leave out
/// those that began so close to an event of the other direction that the change need not end in one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TileSums {
    /// Number of pixels.
    pub pixels: u64,
    /// Sum of the drift's size.
    pub asked: f64,
    /// Sum of the drift according to the events, in the direction of the drift.
    pub stated: f64,
    /// Number of events in the direction of the drift, and against it.
    pub events: [u64; 2],
    /// Expected number of events of the noise floor against the direction of the drift.
    pub floor: f64,
}

impl TileSums {
    fn add(&mut self, other: Self) {
        self.pixels += other.pixels;
        self.asked += other.asked;
        self.stated += other.stated;
        self.events[0] += other.events[0];
        self.events[1] += other.events[1];
        self.floor += other.floor;
    }

    /// Share of the change that events show; NaN without pixels.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.stated / self.asked
    }
}

/// Follows the drift and the events of all pixels from anchor to anchor.
#[derive(Debug)]
pub(crate) struct IntervalWatch {
    size: Size,
    law: DriftLaw,
    stamps_us: Vec<i64>,
    /// Longest interval that counts as short, us.
    short_us: i64,
    /// Drift at the last anchor; NaN if it is unknown.
    drift: Vec<f64>,
    counts: Vec<[u32; 2]>,
    sums: TileSums,
    intervals: Vec<ChangeInterval>,
    tiles: Vec<TileSums>,
}

/// A pixel at an anchor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AnchoredPixel {
    /// Its drift since the first anchor, if it is known.
    pub(crate) drift: Option<f64>,
    /// Its ON and OFF events until now.
    pub(crate) counts: [u32; 2],
    /// Error of their difference.
    pub(crate) error: f64,
    /// Events of the noise floor that are expected since the last anchor.
    pub(crate) floor: [f64; 2],
}

impl IntervalWatch {
    pub(crate) fn new(size: Size, law: DriftLaw, anchors: &AnchorFrames) -> Self {
        let stamps_us = anchors.stamps_us.clone();
        // Within half of a span the image moves by about a pixel.
        let halves = anchors.spans.iter().map(|[from, middle, _]| stamps_us[*middle] - stamps_us[*from]);
        let short_us = halves.max().map_or(0, |half| half + half / 2);
        // Unknown at the first anchor is unknown at all of them.
        let drift = vec![0.0; size.pixels()];
        let counts = vec![[0; 2]; size.pixels()];
        let (sums, intervals, tiles) =
            (TileSums::default(), Vec::new(), vec![TileSums::default(); TILES * TILES]);
        Self { size, law, stamps_us, short_us, drift, counts, sums, intervals, tiles }
    }

    /// Counts no interval as short in which an image of this speed, px/s, moves too far. Frames may be too
    /// far apart for any short interval.
    pub(crate) fn moves_at(&mut self, px_s: f64) {
        let most_us = 1e6 * SHORT_PX / px_s;
        if (self.short_us as f64) > most_us {
            self.short_us = 0;
        }
    }

    /// Takes a pixel at the next anchor.
    pub(crate) fn see(&mut self, pixel: usize, anchored: AnchoredPixel) {
        let AnchoredPixel { drift, counts, error, floor } = anchored;
        let change = drift.unwrap_or(f64::NAN) - self.drift[pixel];
        let before = std::mem::replace(&mut self.counts[pixel], counts);
        let [a, b] = self.law.thresholds;
        // The voltage at the last anchor, within the thresholds whatever the events are.
        let begin = (self.drift[pixel] - a * f64::from(before[0]) + b * f64::from(before[1])).clamp(-b, a);
        self.drift[pixel] = drift.unwrap_or(f64::NAN);
        // Unknown changes fail the comparison.
        let least = LEAST * 0.5 * (a + b) + error;
        if change.abs() > least {
            let [on, off] = [0, 1].map(|side| u64::from(counts[side] - before[side]));
            let stated = a * on as f64 - b * off as f64;
            let (events, floor) = if change > 0.0 { ([on, off], floor[1]) } else { ([off, on], floor[0]) };
            let own = if change.abs() + begin * change.signum() > least {
                let (asked, stated) = (change.abs(), stated * change.signum());
                TileSums { pixels: 1, asked, stated, events, floor }
            } else {
                TileSums { events, floor, ..TileSums::default() }
            };
            self.sums.add(own);
            let tile = self.tile(pixel);
            self.tiles[tile].add(own);
        }
    }

    /// Ends the interval at the anchor of this number.
    pub(crate) fn settle(&mut self, number: usize) {
        let span_us = [self.stamps_us[number - 1], self.stamps_us[number]];
        let short = span_us[1] - span_us[0] <= self.short_us;
        self.intervals.push(ChangeInterval { span_us, sums: std::mem::take(&mut self.sums), short });
    }

    pub(crate) fn finish(self) -> (Vec<ChangeInterval>, Vec<TileSums>) {
        (self.intervals, self.tiles)
    }

    fn tile(&self, pixel: usize) -> usize {
        let (width, height) = (self.size.width as usize, self.size.height as usize);
        let (column, row) = (pixel % width * TILES / width, pixel / width * TILES / height);
        row * TILES + column
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::PlantedWorld;

    /// Sums of the two intervals of a pixel with thresholds of 1, by its drift and events until each anchor.
    fn sums(anchors: [(f64, [u32; 2]); 2]) -> [TileSums; 2] {
        let world = PlantedWorld::default_world();
        let law = DriftLaw::for_crossings(&world.sensor.into()).expect("a voltmeter has a drift");
        let frames = AnchorFrames { stamps_us: vec![0, 1000, 2000], images: Vec::new(), spans: Vec::new() };
        let mut watch = IntervalWatch::new(Size { width: 1, height: 1 }, law, &frames);
        for (i, (drift, counts)) in anchors.into_iter().enumerate() {
            watch.see(0, AnchoredPixel { drift: Some(drift), counts, error: 0.0, floor: [0.0; 2] });
            watch.settle(i + 1);
        }
        let (intervals, _) = watch.finish();
        [intervals[0].sums, intervals[1].sums]
    }

    #[test]
    fn a_pixel_that_turns_back_need_not_fire() {
        // It rises by 1.9, with one event, and falls by 1.8 to 0.9 below the level of that event.
        let [rise, fall] = sums([(1.9, [1, 0]), (0.1, [1, 0])]);
        assert_eq!((rise.pixels, rise.share()), (1, 1.0 / 1.9));
        assert_eq!(fall.pixels, 0);
        // A fall by 2.2 ends in an event.
        let [_, fall] = sums([(1.9, [1, 0]), (-0.3, [1, 1])]);
        assert_eq!((fall.pixels, fall.stated), (1, 1.0));
    }

    #[test]
    fn lost_events_are_missed_in_the_next_interval_too() {
        let [first, second] = sums([(1.9, [0, 0]), (3.8, [0, 0])]);
        assert_eq!([first, second].map(|sums| (sums.pixels, sums.stated)), [(1, 0.0); 2]);
    }
}
