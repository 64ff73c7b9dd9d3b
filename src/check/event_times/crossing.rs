//! Times of events as the frames and the sensor's law predict them.
//!
//! At an event, the drift of its pixel since the first frame equals the voltage of its events so
//! far, up to the sensor's noise and the rounding of the frames. With a drift that is linear between
//! two frames, events that come `d` late, on a clock that runs `1 + e` times as fast, leave the
//! residual `rate (d + e (t - m))`, `m` the middle of the clip. The regression of the residual on
//! `rate` and on `rate (t - m)` over all events gives both. A first passage of a noisy voltage is
//! on average on time where the drift is steady (Wald's identity), so noise widens the error and
//! does not move the result.
//!
//! For sensors of unequal pixels, of a noise floor, of hot pixels or of a dead time, residuals are
//! those of pairs of events, see `pairs.rs`; for the others those of single events, see `levels.rs`.
//! Pixels whose colours are cut off at black or white have an unknown drift, and are left out: for
//! the interval at its ends, and for good at the first frame, from which drifts are counted. Errors
//! are those of a jackknife over 64 parts of the picture, because the events of an object share its
//! errors.
//!
//! Residuals above a bound are left out, since a lost event leaves a whole threshold. A fault moves
//! some residuals over the bound, and the estimate shows only a part of it: with `f` the density of
//! residuals at the bound `c`, weighted by the square of the regressor, a small fault is shown
//! `1 - c (f(c) + f(-c))` times as large. That share is measured, from the residuals near the bound,
//! and so is its standard error; the stated power depends on both.
//!
//! A few parts of the picture may have most of the information. The standard error then varies much from one
//! stream to the next, and with it the limit. If the errors of events are independent, the part of the error
//! that comes from a part of the picture has a variance in proportion to its share `h` of the sum of squares.
//! The standard error has the spread of one with `1 / sum h^2` degrees of freedom (Satterthwaite, Biometrics
//! Bulletin 2, 1946).

mod levels;
mod line_sums;
mod pairs;

use crate::check::drift::DriftLaw;
use crate::event::{Event, Polarity};
use crate::image::{Image, Size};
use levels::LevelResiduals;
use line_sums::LineSums;
use pairs::PairResiduals;

/// Parts of the picture in each direction.
const PARTS: usize = 8;
/// Largest residual that is used, thresholds. A lost or an added event leaves a whole one.
const SMALL: f64 = 0.4;
/// Largest residual that is used for an offset of a frame or more, thresholds. Fast pixels then have
/// large residuals.
const LARGE: f64 = 4.0;
/// Offset from which on large residuals count, us: there, small ones are only those of slow pixels.
pub const FAR_US: f64 = 50.0;
/// Width of the band of residuals around the largest that is used, as a share of it, on either side.
const BAND: f64 = 0.25;
/// [`StreamClock::reach`] of single events.
const REACH: f64 = 0.5;
/// [`StreamClock::reach`] of pairs of events, either of which may meet another interval.
const REACH_OF_PAIRS: f64 = 0.25;
/// Minimum number of parts with events for a jackknife.
const MIN_PARTS: usize = 8;

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

/// A frame as the sensor sees it.
#[derive(Debug, Clone)]
pub struct SeenFrame {
    /// Stamp, us.
    pub t_us: i64,
    /// Brightness on the grey scale.
    pub brightness: Image<f32>,
    /// Pixels with a colour at the end of its scale, whose brightness is a bound only.
    pub cut: Vec<bool>,
}

/// Compares events with frames, which come in turn.
#[derive(Debug)]
pub struct CrossingObserver {
    law: DriftLaw,
    width: usize,
    middle_us: f64,
    /// `ln(L + k2)` of the first frame; NaN where it is cut off.
    first_logs: Vec<f64>,
    first_us: i64,
    /// Integral of brightness since the first frame, at the earlier of both frames.
    exposure: Vec<f64>,
    /// The two frames around the present. Drifts are computed for the pixels with events only: most
    /// pixels have none between two frames, and a logarithm costs more than an event.
    frames: [SeenFrame; 2],
    residuals: EventResiduals,
}

/// The residuals of events, by what is known of a pixel.
#[derive(Debug)]
enum EventResiduals {
    Levels(LevelResiduals),
    Pairs(PairResiduals),
}

/// An event, and the drift of its pixel as the frames show it.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    pixel: usize,
    /// The part of the picture in which the pixel lies.
    part: usize,
    t_us: f64,
    polarity: Polarity,
    threshold: f64,
    /// Drift since the first frame; NaN if it is unknown.
    drift: f64,
    /// `rate` and `rate (t - m)`.
    moves: [f64; 2],
    /// Mean brightness between the two frames, on the grey scale.
    brightness: f64,
}

impl Crossing {
    /// Change of the voltage by which the event is explained.
    fn jump(&self) -> f64 {
        match self.polarity {
            Polarity::On => self.threshold,
            Polarity::Off => -self.threshold,
        }
    }

    /// Returns true if the drift has the direction of the event; false if it is unknown.
    fn is_along(&self) -> bool {
        self.moves[0] * self.jump() > 0.0
    }
}

impl CrossingFit {
    /// Returns true for an offset that leaves large residuals, and is certain.
    fn is_far(&self) -> bool {
        self.offset_us.value.abs() > FAR_US.max(5.0 * self.offset_us.deviation)
    }
}

/// Integral of a brightness that is linear between its ends. Negative ones count as black.
fn integral_between(step_us: f64, ends: [f32; 2]) -> f64 {
    let [a, b] = ends.map(|l| f64::from(l.max(0.0)));
    step_us * (0.5 * (a + b))
}

impl CrossingObserver {
    /// Starts at the first frame of a clip that ends at `end_us`.
    #[must_use]
    pub fn new(law: DriftLaw, first: SeenFrame, end_us: i64) -> Self {
        let SeenFrame { t_us, brightness, cut } = &first;
        let log = |(l, cut): (&f32, &bool)| if *cut { f64::NAN } else { law.brightness(*l) };
        let first_logs: Vec<f64> = brightness.pixels().iter().zip(cut).map(log).collect();
        let (width, pixels) = (brightness.size().width as usize, first_logs.len());
        let residuals = if law.keeps_levels() {
            EventResiduals::Levels(LevelResiduals::new(law, pixels, PARTS * PARTS))
        } else {
            EventResiduals::Pairs(PairResiduals::new(law, *t_us as f64, pixels, PARTS * PARTS))
        };
        Self {
            law,
            width,
            middle_us: f64::midpoint(*t_us as f64, end_us as f64),
            first_logs,
            first_us: *t_us,
            exposure: vec![0.0; pixels],
            frames: [first.clone(), first],
            residuals,
        }
    }

    /// Size of the frames.
    #[must_use]
    pub fn size(&self) -> Size {
        let height = self.exposure.len() / self.width.max(1);
        let side = |n: usize| u32::try_from(n).expect("an image side has 32 bits");
        Size { width: side(self.width), height: side(height) }
    }

    /// Takes the next frame. All events up to the latest one have been seen.
    ///
    /// # Panics
    /// The frame has another size than the first.
    pub fn take_frame(&mut self, frame: SeenFrame) {
        assert_eq!(frame.brightness.pixels().len(), self.exposure.len(), "frames of one size");
        let [from, to] = &self.frames;
        let step_us = (to.t_us - from.t_us) as f64;
        let ends = from.brightness.pixels().iter().zip(to.brightness.pixels());
        // Every pixel of every frame comes here: without indices, the sums are vectors.
        for (exposure, (a, b)) in self.exposure.iter_mut().zip(ends) {
            *exposure += integral_between(step_us, [*a, *b]);
        }
        self.frames.swap(0, 1);
        self.frames[1] = frame;
    }

    /// Integral of a pixel's brightness between the two frames.
    fn added_exposure(&self, pixel: usize) -> f64 {
        let [from, to] = &self.frames;
        let ends = [from, to].map(|frame| frame.brightness.pixels()[pixel]);
        integral_between((to.t_us - from.t_us) as f64, ends)
    }

    /// Drifts of a pixel at the two frames; NaN where they are unknown.
    fn drifts(&self, pixel: usize) -> [f64; 2] {
        let exposures = [self.exposure[pixel], self.exposure[pixel] + self.added_exposure(pixel)];
        [0, 1].map(|i| {
            let SeenFrame { t_us, brightness, cut } = &self.frames[i];
            let log = if cut[pixel] { f64::NAN } else { self.law.brightness(brightness.pixels()[pixel]) };
            self.law.drift(log - self.first_logs[pixel], (t_us - self.first_us) as f64, exposures[i])
        })
    }

    /// Sees an event between the two latest frames. Events off the sensor are left out.
    pub fn see(&mut self, event: Event) {
        let pixel = usize::from(event.y) * self.width + usize::from(event.x);
        if usize::from(event.x) >= self.width || pixel >= self.exposure.len() {
            return;
        }
        let [from, to] = self.drifts(pixel);
        let [start, end] = [0, 1].map(|i| self.frames[i].t_us as f64);
        let rate = (to - from) / (end - start);
        // A file holds the microsecond that contains the event: half of one later on average.
        let t_us = event.t.floor_micros() as f64 + 0.5;
        let [a, b] = [0, 1].map(|i| f64::from(self.frames[i].brightness.pixels()[pixel]));
        let crossing = Crossing {
            pixel,
            part: self.part(pixel),
            t_us,
            polarity: event.polarity,
            threshold: self.law.thresholds[usize::from(event.polarity == Polarity::Off)],
            drift: from + rate * (t_us - start),
            moves: [rate, rate * (t_us - self.middle_us)],
            brightness: f64::midpoint(a, b),
        };
        match &mut self.residuals {
            EventResiduals::Levels(levels) => levels.see(&crossing),
            EventResiduals::Pairs(pairs) => pairs.see(&crossing),
        }
    }

    /// The part of the picture in which a pixel lies.
    fn part(&self, pixel: usize) -> usize {
        let height = (self.exposure.len() / self.width.max(1)).max(1);
        let (x, y) = (pixel % self.width, pixel / self.width);
        y * PARTS / height * PARTS + x * PARTS / self.width
    }

    /// The clock over all events.
    ///
    /// # Errors
    /// The events do not determine it; the text is the reason.
    pub fn finish(self) -> Result<StreamClock, String> {
        let half_us = self.middle_us - self.first_us as f64;
        let part = |pixel| self.part(pixel);
        let levels = match &self.residuals {
            EventResiduals::Levels(levels) => |width| levels.parts(width, PARTS * PARTS, part),
            // A pair is short, so that even a lag of some frames leaves most residuals small.
            EventResiduals::Pairs(pairs) => {
                let fit = CrossingFit::of_parts(&pairs.parts(part));
                let noisy = |e| format!("{e}; {} more may be noise", pairs.noisy);
                let reach = REACH_OF_PAIRS;
                return fit.map(|found| StreamClock { found, far: None, half_us, reach }).map_err(noisy);
            }
        };
        let far = CrossingFit::of_parts(&levels(1)).ok();
        let found = match far {
            Some(far) if far.is_far() => far,
            _ => CrossingFit::of_parts(&levels(0))?,
        };
        Ok(StreamClock { found, far, half_us, reach: REACH })
    }
}

impl CrossingFit {
    /// The fit to the sums of each part of the picture.
    fn of_parts(parts: &[LineSums]) -> Result<Self, String> {
        let filled: Vec<LineSums> = parts.iter().copied().filter(|part| part.n > 0.0).collect();
        let all = filled.iter().fold(LineSums::default(), |sum, part| sum.plus(*part, 1.0));
        let too_few = || {
            format!("{} events in {} parts of the picture do not determine the clock", all.n, filled.len())
        };
        if filled.len() < MIN_PARTS {
            return Err(too_few());
        }
        let found = all.solve().ok_or_else(too_few)?;
        let others: Vec<LineSums> = filled.iter().map(|part| all.plus(*part, -1.0)).collect();
        let without: Option<Vec<[f64; 2]>> = others.iter().map(|others| others.solve()).collect();
        let without = without.ok_or_else(too_few)?;
        let [offset_us, scale] = jackknife_bars(found, &without);
        let responses: Vec<[f64; 2]> = others.iter().map(|others| others.responses()).collect();
        let responses = jackknife_bars(all.responses(), &responses);
        let freedom = all.freedom(&filled);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of events")]
        let events = all.n as u64;
        Ok(Self { offset_us, scale, responses, freedom, events })
    }
}

/// Two statistics with their standard errors, from their values without each part in turn.
fn jackknife_bars(found: [f64; 2], without: &[[f64; 2]]) -> [ErrorBar; 2] {
    let n = without.len() as f64;
    [0, 1].map(|i| {
        let squares: f64 = without.iter().map(|w| (w[i] - found[i]) * (w[i] - found[i])).sum();
        ErrorBar { value: found[i], deviation: (squares * (n - 1.0) / n).sqrt() }
    })
}

#[cfg(test)]
mod tests;
