//! Facts of a stream that no sensor states: the grid of its stamps, the shortest pause of its pixels,
//! and its isolated events.
//!
//! - **Grid**: the coarsest of some steps of time to which all stamps are multiples. A camera stamps
//!   each microsecond; a program that simulates from frames may stamp each frame.
//! - **Pause**: the interval between two events of one pixel that one interval in a thousand is
//!   shorter than. No interval is shorter than the dead time.
//! - **Isolated events**: events without another in their 3x3 pixels in the 5 ms before them (Delbruck,
//!   "Frame-free dynamic digital vision", 2008: the background activity filter). Their rate is an upper
//!   bound of the noise, because a slow edge makes some as well.

use super::EventDataset;
use gs2e_check::{Finding, Judgement, JudgementResult, Verdict};
use gs2e_event::Event;
use gs2e_image::Size;

/// Steps of time that stamps may be multiples of, us, the coarsest first.
const GRIDS: [i64; 5] = [10_000, 1000, 100, 10, 1];
/// Share of stamps on a grid above which it is the stream's. A few exceptions do not hide it.
const ON_GRID: f64 = 0.999;
/// Grid that no camera and no careful simulation has, us.
const COARSE_US: i64 = 1000;
/// Share of isolated events, without those that have a neighbour by chance, that warns.
const MAX_ISOLATED: f64 = 0.4;
/// Minimum number of events for a statement on the grid: by chance, one stamp in ten is a multiple
/// of 10.
const MIN_EVENTS: u64 = 100;
/// Time within which a neighbour supports an event, us.
const SUPPORT_US: i64 = 5000;
/// Upper ends of the bins of the pauses, us: a quarter of an octave each.
const PAUSE_BINS: usize = 80;
/// Share of the pauses below the stated one.
const SHORTEST: f64 = 0.001;

/// The facts, counted in one pass.
#[derive(Debug, Clone)]
pub struct StreamFacts {
    size: Size,
    events: u64,
    first_us: i64,
    last_us: i64,
    /// Number of stamps that are multiples of each of [`GRIDS`], relative to the first.
    on_grid: [u64; GRIDS.len()],
    /// Time of the last event of each pixel, us.
    last: Vec<i64>,
    pauses: Vec<u64>,
    isolated: u64,
}

impl StreamFacts {
    /// Starts before the first event.
    #[must_use]
    pub fn new(size: Size) -> Self {
        Self {
            size,
            events: 0,
            first_us: 0,
            last_us: 0,
            on_grid: [0; GRIDS.len()],
            // Half of the smallest number, so that a difference does not overflow.
            last: vec![i64::MIN / 2; size.pixels()],
            pauses: vec![0; PAUSE_BINS],
            isolated: 0,
        }
    }

    /// Counts an event with its time. Events outside the sensor count for the grid only.
    pub fn see(&mut self, event: &Event, t_us: i64) {
        if self.events == 0 {
            self.first_us = t_us;
        }
        self.events += 1;
        // Stamps of a damaged stream may go back; its length must not become negative.
        self.last_us = self.last_us.max(t_us);
        for (count, grid) in self.on_grid.iter_mut().zip(GRIDS) {
            // Relative to the first stamp: many recordings begin at an odd microsecond.
            *count += u64::from((t_us - self.first_us).rem_euclid(grid) == 0);
        }
        let (x, y) = (u32::from(event.x), u32::from(event.y));
        if x >= self.size.width || y >= self.size.height {
            return;
        }
        let at = y as usize * self.size.width as usize + x as usize;
        let pause = t_us.saturating_sub(self.last[at]);
        // The first event of a pixel has no pause, and shows as a difference of 2^62.
        if (1..1 << 40).contains(&pause) {
            self.pauses[pause_bin(pause)] += 1;
        }
        self.isolated += u64::from(!self.is_supported(x, y, t_us));
        self.last[at] = t_us;
    }

    /// Returns true if a pixel of the 3x3 around this one, or the pixel itself, had an event shortly
    /// before.
    fn is_supported(&self, x: u32, y: u32, t_us: i64) -> bool {
        let (columns, rows) = (
            x.saturating_sub(1)..(x + 2).min(self.size.width),
            y.saturating_sub(1)..(y + 2).min(self.size.height),
        );
        let width = self.size.width as usize;
        rows.into_iter().any(|row| {
            let line = row as usize * width;
            let near = &self.last[line + columns.start as usize..line + columns.end as usize];
            near.iter().any(|last| t_us - last <= SUPPORT_US)
        })
    }

    fn seconds(&self) -> f64 {
        (self.last_us - self.first_us).max(1) as f64 * 1e-6
    }

    /// The coarsest grid of the stamps, us.
    #[must_use]
    pub(crate) fn grid_us(&self) -> i64 {
        let enough = |count: &u64| *count as f64 >= ON_GRID * self.events as f64;
        let found = self.on_grid.iter().zip(GRIDS).find(|(count, _)| enough(count));
        found.map_or(1, |(_, grid)| grid)
    }

    /// The upper end of the bin below which one pause in a thousand lies, us; `None` with fewer than
    /// a thousand pauses.
    #[must_use]
    pub(crate) fn shortest_pause_us(&self) -> Option<f64> {
        let all: u64 = self.pauses.iter().sum();
        let rank = SHORTEST * all as f64;
        let mut below = 0;
        let found = self.pauses.iter().position(|count| {
            below += count;
            below as f64 >= rank
        });
        found.filter(|_| all >= 1000).map(bin_end)
    }

    /// Isolated events per pixel and second.
    #[must_use]
    pub(crate) fn isolated_rate(&self) -> f64 {
        self.isolated as f64 / self.size.pixels() as f64 / self.seconds()
    }

    /// Share of noise that leaves this share of isolated events: noise has a neighbour in 9 pixels by chance
    /// as often as its own rate says, `isolated = noise exp(-9 noise rate 5 ms)`. At most `e` times the
    /// isolated events, where the exponential is steepest.
    fn isolated_share(&self) -> f64 {
        let isolated = self.isolated as f64 / self.events.max(1) as f64;
        let mean = self.events as f64 / self.size.pixels() as f64 / self.seconds();
        let neighbours = 9.0 * mean * SUPPORT_US as f64 * 1e-6;
        let most = (isolated * std::f64::consts::E).min(1.0);
        (0..20).fold(isolated, |noise, _| (isolated * libm::exp(neighbours * noise)).min(most))
    }

    /// The findings on the stream.
    pub(super) fn findings(&self, dataset: &EventDataset<'_>) -> Vec<Finding> {
        vec![
            dataset.finding("stamps", "grid", self.judge_grid()),
            dataset.finding("refractory", "shortest", self.judge_pause()),
            dataset.finding("noise_floor", "isolated", Ok(self.judge_isolated())),
        ]
    }

    fn judge_grid(&self) -> JudgementResult {
        if self.events < MIN_EVENTS {
            return Err(format!("{} events are too few to show the grid of their stamps", self.events));
        }
        let grid = self.grid_us();
        let verdict = match grid {
            1 => Verdict::Pass,
            grid if grid < COARSE_US => Verdict::Warn,
            _ => Verdict::Fail,
        };
        let because = if grid > 1 {
            format!("all stamps are multiples of {grid} us after the first; a camera resolves 1 us")
        } else {
            "the stamps resolve 1 us".to_owned()
        };
        Ok(Judgement::new(verdict, grid as f64, 1.0, "us", because))
    }

    fn judge_pause(&self) -> JudgementResult {
        let pause = self.shortest_pause_us().ok_or("fewer than 1000 pairs of events share a pixel")?;
        let because = format!(
            "one pause of a pixel in 1000 is shorter than {pause:.0} us: an upper bound of its dead time"
        );
        Ok(Judgement::new(Verdict::Pass, pause, None, "us", because))
    }

    fn judge_isolated(&self) -> Judgement {
        let rate = self.isolated_rate();
        let share = 100.0 * self.isolated as f64 / self.events.max(1) as f64;
        let noise = self.isolated_share();
        let is_noisy = noise > MAX_ISOLATED && self.events >= MIN_EVENTS;
        let verdict = if is_noisy { Verdict::Warn } else { Verdict::Pass };
        let because = format!(
            "{share:.1} % of the events have no neighbour in the 5 ms before them: noise of at most {rate:.3} Hz per \
             pixel, or {:.0} % of the events",
            100.0 * noise
        );
        Judgement::new(verdict, noise, MAX_ISOLATED, "1", because).detecting(MAX_ISOLATED, "1")
    }
}

/// A quarter of an octave per bin.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number from 0 to PAUSE_BINS")]
fn pause_bin(pause_us: i64) -> usize {
    ((4.0 * libm::log2(pause_us as f64)) as usize).min(PAUSE_BINS - 1)
}

fn bin_end(bin: usize) -> f64 {
    libm::exp2((bin as f64 + 1.0) / 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::{EventLabel, Polarity};
    use gs2e_num::units::Timestamp;

    const SIZE: Size = Size { width: 20, height: 10 };

    fn facts(events: impl Iterator<Item = (i64, u16, u16)>) -> StreamFacts {
        let mut facts = StreamFacts::new(SIZE);
        for (t_us, x, y) in events {
            let event = Event {
                t: Timestamp::from_micros(t_us),
                x,
                y,
                polarity: Polarity::On,
                label: EventLabel::Signal,
            };
            facts.see(&event, t_us);
        }
        facts
    }

    #[test]
    fn the_grid_of_stamps_is_found() {
        for grid in GRIDS {
            // Steps of 7 and more keep finer stamps off any coarser grid.
            let found = facts((0..2000).map(|i| (5 + grid * 7 * i, 0, 0))).grid_us();
            assert_eq!(found, grid);
        }
        // One stamp in 500 off the grid is more than the exceptions that are allowed.
        let found = facts((0..2000).map(|i| (1000 * i + i64::from(i % 500 == 250), 0, 0))).grid_us();
        assert_eq!(found, 1);
    }

    #[test]
    fn a_dead_time_bounds_the_pauses() {
        // Pauses of 300 us and more in every pixel.
        let found = facts((0..5000).map(|i| (i * 300 + i % 7, 3, 3))).shortest_pause_us().unwrap();
        assert!((290.0..420.0).contains(&found), "{found}");
        assert_eq!(facts((0..500).map(|i| (i * 300, 3, 3))).shortest_pause_us(), None);
    }

    #[test]
    fn isolated_events_are_those_without_a_neighbour() {
        // Pairs of neighbours 10 ms apart: the first of each pair is alone.
        let pairs = (0..100).flat_map(|i| [(10_000 * i, 4, 4), (10_000 * i + 10, 5, 5)]);
        let found = facts(pairs);
        assert_eq!(found.isolated, 100);
        let apart = (0..100).flat_map(|i| [(10_000 * i, 4, 4), (10_000 * i + 10, 6, 4)]);
        assert_eq!(facts(apart).isolated, 200);
        // 100 isolated events in 200 pixels and 0.99 s.
        assert!((found.isolated_rate() - 100.0 / 200.0 / 0.990_01).abs() < 1e-3);
    }
}
