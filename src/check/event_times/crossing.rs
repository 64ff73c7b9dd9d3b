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
//! Where the voltages start anywhere, each pixel has an unknown level, and its means are removed.
//! Pixels whose colours are cut off at black or white have an unknown drift, and are left out:
//! for the interval at its ends, and for good at the first frame, from which drifts are counted.
//! Errors are those of a jackknife over 64 parts of the picture, because the events of an object
//! share its errors.
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

use crate::check::drift::DriftLaw;
use crate::event::{Event, Polarity};
use crate::image::{Image, Size};

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
    /// Voltage of the events of each pixel.
    levels: Vec<f64>,
    /// Sums over events with small residuals, and over those that a lag of some frames explains: of
    /// each pixel where its level is unknown, and otherwise of each part of the picture.
    sums: Vec<[LineSums; 2]>,
}

/// Sums over the events of a pixel: of `x = rate`, `y = rate (t - m)` and the residual `r`.
#[derive(Debug, Clone, Copy, Default)]
struct LineSums {
    n: f64,
    x: f64,
    y: f64,
    r: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    xr: f64,
    yr: f64,
    /// `x^2` and `y^2` of the same events, without a subtraction of means.
    squares: [f64; 2],
    /// `squares` of the events with a residual near the bound, on either side of it.
    near_bound: [f64; 2],
}

impl LineSums {
    fn add(&mut self, [x, y]: [f64; 2], r: f64) {
        self.n += 1.0;
        (self.x, self.y, self.r) = (self.x + x, self.y + y, self.r + r);
        (self.xx, self.xy, self.yy) = (self.xx + x * x, self.xy + x * y, self.yy + y * y);
        (self.xr, self.yr) = (self.xr + x * r, self.yr + y * r);
        self.squares = [self.squares[0] + x * x, self.squares[1] + y * y];
    }

    /// Adds an event whose residual is near the bound.
    fn add_near_bound(&mut self, [x, y]: [f64; 2]) {
        self.near_bound = [self.near_bound[0] + x * x, self.near_bound[1] + y * y];
    }

    /// Shares of a small fault that the coefficients show. The band has a width of twice [`BAND`].
    fn responses(self) -> [f64; 2] {
        [0, 1].map(|i| 1.0 - self.near_bound[i] / (2.0 * BAND * self.squares[i]))
    }

    /// Degrees of freedom of the standard errors of both coefficients, from the shares of the parts.
    fn freedom(self, parts: &[Self]) -> [f64; 2] {
        let of = |square: fn(&Self) -> f64| {
            let shares = parts.iter().map(|part| square(part) / square(&self));
            1.0 / shares.map(|share| share * share).sum::<f64>()
        };
        [of(|sums| sums.xx), of(|sums| sums.yy)]
    }

    /// The sums of the deviations from the means.
    fn centred(self) -> Self {
        let Self { n, x, y, r, xx, xy, yy, xr, yr, squares, near_bound } = self;
        if n < 2.0 {
            return Self::default();
        }
        let (xx, xy, yy) = (xx - x * x / n, xy - x * y / n, yy - y * y / n);
        let (xr, yr) = (xr - x * r / n, yr - y * r / n);
        Self { n, x: 0.0, y: 0.0, r: 0.0, xx, xy, yy, xr, yr, squares, near_bound }
    }

    fn plus(self, o: Self, sign: f64) -> Self {
        let of = |a: f64, b: f64| a + sign * b;
        Self {
            n: of(self.n, o.n),
            x: of(self.x, o.x),
            y: of(self.y, o.y),
            r: of(self.r, o.r),
            xx: of(self.xx, o.xx),
            xy: of(self.xy, o.xy),
            yy: of(self.yy, o.yy),
            xr: of(self.xr, o.xr),
            yr: of(self.yr, o.yr),
            squares: [0, 1].map(|i| of(self.squares[i], o.squares[i])),
            near_bound: [0, 1].map(|i| of(self.near_bound[i], o.near_bound[i])),
        }
    }

    /// Coefficients of `x` and `y`; `None` if they cannot be separated.
    fn solve(self) -> Option<[f64; 2]> {
        let determinant = self.xx * self.yy - self.xy * self.xy;
        // Rounding leaves about 1e-16 of the product where both columns are parallel.
        (determinant > 1e-9 * self.xx * self.yy).then(|| {
            [
                (self.yy * self.xr - self.xy * self.yr) / determinant,
                (self.xx * self.yr - self.xy * self.xr) / determinant,
            ]
        })
    }
}

impl CrossingFit {
    /// Returns true for an offset that leaves large residuals, and is certain.
    fn is_far(&self) -> bool {
        self.offset_us.value.abs() > FAR_US.max(5.0 * self.offset_us.deviation)
    }
}

impl CrossingObserver {
    /// Starts at the first frame of a clip that ends at `end_us`.
    #[must_use]
    pub fn new(law: DriftLaw, first: SeenFrame, end_us: i64) -> Self {
        let SeenFrame { t_us, brightness, cut } = &first;
        let log = |(l, cut): (&f32, &bool)| if *cut { f64::NAN } else { law.brightness(*l) };
        let first_logs: Vec<f64> = brightness.pixels().iter().zip(cut).map(log).collect();
        let (width, pixels) = (brightness.size().width as usize, first_logs.len());
        Self {
            law,
            width,
            middle_us: f64::midpoint(*t_us as f64, end_us as f64),
            first_logs,
            first_us: *t_us,
            exposure: vec![0.0; pixels],
            frames: [first.clone(), first],
            levels: vec![0.0; pixels],
            sums: vec![[LineSums::default(); 2]; if law.from_zero { PARTS * PARTS } else { pixels }],
        }
    }

    /// Size of the frames.
    #[must_use]
    pub fn size(&self) -> Size {
        let height = self.levels.len() / self.width.max(1);
        let side = |n: usize| u32::try_from(n).expect("an image side has 32 bits");
        Size { width: side(self.width), height: side(height) }
    }

    /// Takes the next frame. All events up to the latest one have been seen.
    ///
    /// # Panics
    /// The frame has another size than the first.
    pub fn take_frame(&mut self, frame: SeenFrame) {
        assert_eq!(frame.brightness.pixels().len(), self.levels.len(), "frames of one size");
        for pixel in 0..self.exposure.len() {
            self.exposure[pixel] += self.added_exposure(pixel);
        }
        self.frames.swap(0, 1);
        self.frames[1] = frame;
    }

    /// Integral of a pixel's brightness between the two frames.
    fn added_exposure(&self, pixel: usize) -> f64 {
        let [from, to] = &self.frames;
        let [a, b] = [from, to].map(|frame| f64::from(frame.brightness.pixels()[pixel].max(0.0)));
        (to.t_us - from.t_us) as f64 * (0.5 * (a + b))
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
        if usize::from(event.x) >= self.width || pixel >= self.levels.len() {
            return;
        }
        let [on, off] = self.law.thresholds;
        let (jump, threshold) = match event.polarity {
            Polarity::On => (on, on),
            Polarity::Off => (-off, off),
        };
        self.levels[pixel] += jump;
        let [from, to] = self.drifts(pixel);
        let [start, end] = [0, 1].map(|i| self.frames[i].t_us as f64);
        let rate = (to - from) / (end - start);
        // A file holds the microsecond that contains the event: half of one later on average.
        let t = event.t.floor_micros() as f64 + 0.5;
        let left = from + rate * (t - start) - self.levels[pixel];
        // An event against the drift is noise, or comes from another interval. NaN is left out.
        if rate * jump > 0.0 {
            // Where voltages start anywhere, a pixel's own level is up to a threshold off, and only
            // the noise around it counts.
            let own = if self.law.from_zero { 0.0 } else { self.law.most_residual() };
            let place = if self.law.from_zero { self.part(pixel) } else { pixel };
            let moves = [rate, rate * (t - self.middle_us)];
            for (sums, most) in self.sums[place].iter_mut().zip([SMALL, LARGE]) {
                let size = left.abs() / (own + most * threshold);
                if size < 1.0 {
                    sums.add(moves, left);
                }
                if (size - 1.0).abs() < BAND {
                    sums.add_near_bound(moves);
                }
            }
        }
    }

    /// The part of the picture in which a pixel lies.
    fn part(&self, pixel: usize) -> usize {
        let height = (self.levels.len() / self.width.max(1)).max(1);
        let (x, y) = (pixel % self.width, pixel / self.width);
        y * PARTS / height * PARTS + x * PARTS / self.width
    }

    /// The clock over all events.
    ///
    /// # Errors
    /// The events do not determine it; the text is the reason.
    pub fn finish(self) -> Result<StreamClock, String> {
        let far = self.fit(1).ok();
        let found = match far {
            Some(far) if far.is_far() => far,
            _ => self.fit(0)?,
        };
        Ok(StreamClock { found, far, half_us: self.middle_us - self.first_us as f64 })
    }

    /// The sums of each part of the picture.
    fn parts(&self, width: usize) -> Vec<LineSums> {
        if self.law.from_zero {
            return self.sums.iter().map(|sums| sums[width]).collect();
        }
        let mut parts = vec![LineSums::default(); PARTS * PARTS];
        for (pixel, sums) in self.sums.iter().enumerate() {
            let part = &mut parts[self.part(pixel)];
            *part = part.plus(sums[width].centred(), 1.0);
        }
        parts
    }

    fn fit(&self, width: usize) -> Result<CrossingFit, String> {
        let filled: Vec<LineSums> = self.parts(width).into_iter().filter(|part| part.n > 0.0).collect();
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
        Ok(CrossingFit { offset_us, scale, responses, freedom, events })
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
