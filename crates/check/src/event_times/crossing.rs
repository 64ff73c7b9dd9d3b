//! Times of events as the frames and the sensor's law predict them.
//!
//! At an event, the drift of its pixel since the first frame equals the voltage of its events so
//! far, up to the sensor's noise and the rounding of the frames. With a drift that is linear between
//! two frames, events that come `d` late, on a clock that runs `1 + e` times as fast, leave the
//! residual `rate (d + e (t - m))`, `m` the middle of the clip. The regression of the residual on
//! `rate` and on `rate (t - m)` over all events gives both. A first passage of a noisy voltage is
//! on average on time where the drift is steady (Wald's identity), so noise widens the error and
//! does not move the result. Noise that returns does, and the size of that bias is known, see `pairs.rs`.
//!
//! For sensors of unequal pixels, of a noise floor, of hot pixels or of a dead time, residuals are
//! those of pairs of events, see `pairs.rs`; for the others those of single events, see `levels.rs`.
//! Pixels whose colours are cut off at black or white have an unknown drift, and are left out: for
//! the interval at its ends, and for good at the first frame, from which drifts are counted. Errors
//! are those of a jackknife over 64 blocks of the picture, because the events of an object share its
//! errors.
//!
//! Residuals above a bound are left out, since a lost event leaves a whole threshold. A fault moves
//! some residuals over the bound, and the estimate shows only a part of it: with `f` the density of
//! residuals at the bound `c`, weighted by the square of the regressor, a small fault is shown
//! `1 - c (f(c) + f(-c))` times as large. That share is measured, from the residuals near the bound,
//! and so is its standard error; the stated power depends on both.
//!
//! A few blocks of the picture may have most of the information. The standard error then varies much from one
//! stream to the next, and with it the limit. If the errors of events are independent, the part of the error
//! that comes from a block of the picture has a variance in proportion to its share `h` of the sum of
//! squares. The standard error has the spread of one with `1 / sum h^2` degrees of freedom (Satterthwaite,
//! Biometrics Bulletin 2, 1946).

mod frame_drifts;
mod levels;
mod line_sums;
mod pairs;

pub use frame_drifts::BrightnessFrame;

use crate::ahead::{AHEAD, load_ahead};
use crate::drift::DriftLaw;
use frame_drifts::{Crossing, FrameDrifts};
use gs2e_event::{Event, Polarity};
use gs2e_image::Size;
use levels::LevelResiduals;
use line_sums::LineSums;
use pairs::PairResiduals;
use rayon::prelude::*;

/// Blocks of the picture in each direction.
const BLOCKS: usize = 8;
/// Largest residual that is used, thresholds. A lost or an added event leaves a whole one.
const SMALL: f64 = 0.4;
/// Largest residual that is used for an offset of a frame or more, thresholds. Fast pixels then have
/// large residuals.
const LARGE: f64 = 4.0;
/// Offset from which on large residuals count, us: there, small ones are only those of slow pixels.
pub(crate) const FAR_US: f64 = 50.0;
/// Width of the band of residuals around the largest that is used, as a share of it, on either side.
const BAND: f64 = 0.25;
/// [`StreamClock::reach`] of single events.
const REACH: f64 = 0.5;
/// [`StreamClock::reach`] of pairs of events, either of which may meet another interval.
const REACH_OF_PAIRS: f64 = 0.25;
/// Number of events that are enough: their standard error is far below [`super::OFFSET_US`]. Of a longer
/// stream, the events on some lines of the picture are compared.
const ENOUGH: u64 = 1 << 20;
/// Minimum number of compared lines in a row of blocks.
const LINES: u64 = 4;
/// Minimum number of blocks with events for a jackknife.
const MIN_BLOCKS: usize = 8;

/// A value with its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorBar {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub deviation: f64,
}

/// The clock of the events against that of the frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossingFit {
    /// Delay of the events, us.
    pub offset_us: ErrorBar,
    /// Relative excess of the clock's speed over 1.
    pub scale: ErrorBar,
    /// Shares of a small offset and of a small change of the scale that the estimates show.
    pub responses: [ErrorBar; 2],
    /// Degrees of freedom of the standard errors of offset and scale.
    pub freedom: [f64; 2],
    /// Sizes of the expected biases of offset and scale by noise that returns, us and 1.
    pub biases: [f64; 2],
    /// Number of events used.
    pub events: u64,
}

/// The clock of a stream.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamClock {
    /// The clock from events with small residuals, or from all if the offset is large.
    pub found: CrossingFit,
    /// The clock from events with large residuals too, which is found if the offset is large.
    pub far: Option<CrossingFit>,
    /// Time from the first frame to the middle of the clip, us.
    pub half_us: f64,
    /// Largest fault of an event for which the response is known, in steps between poses. Beyond it,
    /// many events meet the rates of other intervals.
    pub reach: f64,
}

/// Compares events with frames, which come in turn.
#[derive(Debug)]
pub struct CrossingObserver {
    drifts: FrameDrifts,
    rows: Vec<BlockRow>,
}

/// A row of blocks of the picture, over its whole width. No state is shared between rows, so that they are
/// counted in parallel, and each sum has one order of its terms.
#[derive(Debug)]
struct BlockRow {
    /// Its first pixel in the picture, at the left border.
    first: usize,
    pixels: usize,
    residuals: EventResiduals,
}

/// The residuals of events, by what is known of a pixel.
#[derive(Debug)]
enum EventResiduals {
    Levels(LevelResiduals),
    Pairs(PairResiduals),
}

impl CrossingFit {
    /// Returns true for an offset that leaves large residuals, and is certain.
    fn is_far(&self) -> bool {
        self.offset_us.value.abs() > FAR_US.max(5.0 * self.offset_us.deviation)
    }
}

impl CrossingObserver {
    /// Starts at the first frame of a clip that ends at `end_us`, with about `events` events.
    #[must_use]
    pub fn new(law: DriftLaw, first: BrightnessFrame, end_us: i64, events: u64) -> Self {
        let apart = lines_apart(events, first.brightness.size());
        Self::of_lines(law, first, end_us, apart)
    }

    /// Compares the events on every `apart`-th line.
    fn of_lines(law: DriftLaw, first: BrightnessFrame, end_us: i64, apart: u64) -> Self {
        let Size { width, height } = first.brightness.size();
        let (width, height) = (width as usize, height as usize);
        let start_us = first.t_us as f64;
        // A line `y` is in row `y * BLOCKS / height`.
        let first_line = |row: usize| (row * height).div_ceil(BLOCKS);
        let row = |row: usize| {
            let pixels = (first_line(row + 1) - first_line(row)) * width;
            let residuals = if law.keeps_levels() {
                EventResiduals::Levels(LevelResiduals::new(law, pixels, BLOCKS))
            } else {
                EventResiduals::Pairs(PairResiduals::new(law, start_us, pixels, BLOCKS))
            };
            BlockRow { first: first_line(row) * width, pixels, residuals }
        };
        Self { rows: (0..BLOCKS).map(row).collect(), drifts: FrameDrifts::new(law, first, end_us, apart) }
    }

    /// Size of the frames.
    #[must_use]
    pub fn size(&self) -> Size {
        self.drifts.size()
    }

    /// Takes the next frame. All events up to the latest one have been seen.
    ///
    /// # Panics
    /// The frame has another size than the first.
    pub fn take_frame(&mut self, frame: BrightnessFrame) {
        self.drifts.take_frame(frame);
    }

    /// Sees events between the two latest frames, in the order of the stream. Events off the sensor, and on
    /// lines that are not compared, are left out.
    pub fn see(&mut self, events: &[Event]) {
        let Self { drifts, rows } = self;
        // Once for all rows: of a long stream, most events are on lines that are not compared.
        let compared = events.iter().filter_map(|event| Some((drifts.pixel(event)?, event)));
        let compared: Vec<(usize, &Event)> = compared.collect();
        rows.par_iter_mut().for_each(|row| row.see(drifts, &compared));
    }

    /// The clock over all events.
    ///
    /// # Errors
    /// The events do not determine it; the text is the reason.
    pub fn finish(self) -> Result<StreamClock, String> {
        let half_us = self.drifts.half_us();
        let noisy: u64 = self.rows.iter().map(|row| row.residuals.noisy()).sum();
        let small = CrossingFit::of_blocks(&self.blocks(Residuals::Small));
        if self.rows.iter().all(|row| matches!(row.residuals, EventResiduals::Pairs(_))) {
            // A pair is short, so that even a lag of some frames leaves most residuals small.
            let noisy = |e| format!("{e}; {noisy} more may be noise");
            let reach = REACH_OF_PAIRS;
            return small.map(|found| StreamClock { found, far: None, half_us, reach }).map_err(noisy);
        }
        let far = CrossingFit::of_blocks(&self.blocks(Residuals::Large)).ok();
        let found = match far {
            Some(far) if far.is_far() => far,
            _ => small?,
        };
        Ok(StreamClock { found, far, half_us, reach: REACH })
    }

    /// The sums of all blocks of the picture.
    fn blocks(&self, residuals: Residuals) -> Vec<LineSums> {
        let column = |pixel| self.drifts.column(pixel);
        let blocks = self.rows.iter().map(|row| match &row.residuals {
            EventResiduals::Levels(levels) => levels.blocks(residuals as usize, BLOCKS, column),
            EventResiduals::Pairs(pairs) => pairs.blocks(column),
        });
        blocks.flatten().collect()
    }
}

/// Lines of the picture from one that is compared to the next.
fn lines_apart(events: u64, size: Size) -> u64 {
    // Each block of the picture keeps some lines, so that the errors of the blocks are still independent.
    let most = u64::from(size.height) / (BLOCKS as u64 * LINES);
    events.div_ceil(ENOUGH).min(most).max(1)
}

/// The residuals of single events that are used.
#[derive(Debug, Clone, Copy)]
enum Residuals {
    Small,
    Large,
}

impl BlockRow {
    /// Sees those of the events that are in the row. Each comes with the number of its pixel in the picture.
    fn see(&mut self, drifts: &FrameDrifts, events: &[(usize, &Event)]) {
        let Self { first, pixels, residuals } = self;
        let within = |pixel: usize| pixel.checked_sub(*first).filter(|pixel| pixel < pixels);
        let mut own = events.iter().filter_map(|(pixel, event)| Some((within(*pixel)?, *event)));
        let mut batch = Vec::with_capacity(AHEAD);
        loop {
            batch.clear();
            batch.extend(own.by_ref().take(AHEAD));
            if batch.is_empty() {
                return;
            }
            let met = |(pixel, event): &(usize, &Event)| {
                drifts.met_at(*first + pixel) ^ residuals.met_by(*pixel, event.polarity)
            };
            load_ahead(batch.iter().map(met));
            batch.iter().for_each(|(pixel, event)| residuals.see(&drifts.crossing(event, *pixel, *first)));
        }
    }
}

impl EventResiduals {
    /// The bits of the values that an event at a pixel meets.
    fn met_by(&self, pixel: usize, polarity: Polarity) -> u64 {
        match self {
            Self::Levels(levels) => levels.met_at(pixel),
            Self::Pairs(pairs) => pairs.met_by(pixel, polarity),
        }
    }

    fn see(&mut self, crossing: &Crossing) {
        match self {
            Self::Levels(levels) => levels.see(crossing),
            Self::Pairs(pairs) => pairs.see(crossing),
        }
    }

    /// Number of pairs that are left out because noise may be their cause.
    fn noisy(&self) -> u64 {
        match self {
            Self::Levels(_) => 0,
            Self::Pairs(pairs) => pairs.noisy,
        }
    }
}

impl CrossingFit {
    /// The fit to the sums of each block of the picture.
    fn of_blocks(blocks: &[LineSums]) -> Result<Self, String> {
        let filled: Vec<LineSums> = blocks.iter().copied().filter(|block| block.n > 0.0).collect();
        let all = filled.iter().fold(LineSums::default(), |sum, block| sum.plus(*block, 1.0));
        let too_few = || {
            format!("{} events in {} parts of the picture do not determine the clock", all.n, filled.len())
        };
        if filled.len() < MIN_BLOCKS {
            return Err(too_few());
        }
        let found = all.solve().ok_or_else(too_few)?;
        let others: Vec<LineSums> = filled.iter().map(|block| all.plus(*block, -1.0)).collect();
        let without: Option<Vec<[f64; 2]>> = others.iter().map(|others| others.solve()).collect();
        let without = without.ok_or_else(too_few)?;
        let [offset_us, scale] = jackknife_bars(found, &without);
        let responses: Vec<[f64; 2]> = others.iter().map(|others| others.responses()).collect();
        let responses = jackknife_bars(all.responses(), &responses);
        let freedom = all.freedom(&filled);
        let biases = all.solve_expected().ok_or_else(too_few)?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of events")]
        let events = all.n as u64;
        Ok(Self { offset_us, scale, responses, freedom, biases, events })
    }
}

/// Two statistics with their standard errors, from their values without each block in turn.
fn jackknife_bars(found: [f64; 2], without: &[[f64; 2]]) -> [ErrorBar; 2] {
    let n = without.len() as f64;
    [0, 1].map(|i| {
        // Leaving out one of `n` parts moves a mean by only a part of its error, hence the factor `n - 1`.
        let squares: f64 = without.iter().map(|w| (w[i] - found[i]) * (w[i] - found[i])).sum();
        ErrorBar { value: found[i], deviation: (squares * (n - 1.0) / n).sqrt() }
    })
}

#[cfg(test)]
mod tests;
