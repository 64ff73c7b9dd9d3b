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
const FAR_US: f64 = 50.0;
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
    /// Number of events used.
    pub events: u64,
}

/// A frame as the sensor sees it.
#[derive(Debug)]
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
    /// Integral of brightness since the first frame, at the later frame.
    exposure: Vec<f64>,
    /// Drifts at the two frames around the present; NaN where they are unknown.
    drifts: [Vec<f64>; 2],
    stamps_us: [i64; 2],
    brightness: Vec<f32>,
    /// Voltage of the events of each pixel.
    levels: Vec<f64>,
    /// Sums over the events of each pixel: with small residuals, and with all that a lag of some
    /// frames explains.
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
}

impl LineSums {
    fn add(&mut self, [x, y]: [f64; 2], r: f64) {
        self.n += 1.0;
        (self.x, self.y, self.r) = (self.x + x, self.y + y, self.r + r);
        (self.xx, self.xy, self.yy) = (self.xx + x * x, self.xy + x * y, self.yy + y * y);
        (self.xr, self.yr) = (self.xr + x * r, self.yr + y * r);
    }

    /// The sums of the deviations from the means.
    fn centred(self) -> Self {
        let Self { n, x, y, r, xx, xy, yy, xr, yr } = self;
        if n < 2.0 {
            return Self::default();
        }
        let (xx, xy, yy) = (xx - x * x / n, xy - x * y / n, yy - y * y / n);
        Self { n, x: 0.0, y: 0.0, r: 0.0, xx, xy, yy, xr: xr - x * r / n, yr: yr - y * r / n }
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
        let SeenFrame { t_us, brightness, cut } = first;
        let log = |(l, cut): (&f32, &bool)| if *cut { f64::NAN } else { law.brightness(*l) };
        let first_logs: Vec<f64> = brightness.pixels().iter().zip(&cut).map(log).collect();
        let (width, pixels) = (brightness.size().width as usize, first_logs.len());
        let start: Vec<f64> = first_logs.iter().map(|log| 0.0 * log).collect();
        Self {
            law,
            width,
            middle_us: f64::midpoint(t_us as f64, end_us as f64),
            first_logs,
            first_us: t_us,
            exposure: vec![0.0; pixels],
            drifts: [start.clone(), start],
            stamps_us: [t_us; 2],
            brightness: brightness.into_pixels(),
            levels: vec![0.0; pixels],
            sums: vec![[LineSums::default(); 2]; pixels],
        }
    }

    /// Size of the frames.
    #[must_use]
    pub fn size(&self) -> Size {
        let height = self.levels.len() / self.width.max(1);
        let side = |n: usize| u32::try_from(n).expect("an image side has 32 bits");
        Size { width: side(self.width), height: side(height) }
    }

    /// Stamp of the latest frame.
    #[must_use]
    pub fn latest_us(&self) -> i64 {
        self.stamps_us[1]
    }

    /// Takes the next frame. All events up to the latest one have been seen.
    ///
    /// # Panics
    /// The frame has another size than the first.
    pub fn take_frame(&mut self, frame: &SeenFrame) {
        let step = (frame.t_us - self.stamps_us[1]) as f64;
        let total = (frame.t_us - self.first_us) as f64;
        let pixels = frame.brightness.pixels();
        assert_eq!(pixels.len(), self.levels.len(), "frames of one size");
        self.drifts.swap(0, 1);
        self.stamps_us = [self.stamps_us[1], frame.t_us];
        for (i, l) in pixels.iter().enumerate() {
            let mean = 0.5 * (f64::from(self.brightness[i].max(0.0)) + f64::from(l.max(0.0)));
            self.exposure[i] += step * mean;
            let logs = if frame.cut[i] { f64::NAN } else { self.law.brightness(*l) };
            self.drifts[1][i] = self.law.drift(logs - self.first_logs[i], total, self.exposure[i]);
        }
        self.brightness.copy_from_slice(pixels);
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
        let [from, to] = [self.drifts[0][pixel], self.drifts[1][pixel]];
        let [start, end] = self.stamps_us.map(|t| t as f64);
        let rate = (to - from) / (end - start);
        // A file holds the microsecond that contains the event: half of one later on average.
        let t = event.t.floor_micros() as f64 + 0.5;
        let left = from + rate * (t - start) - self.levels[pixel];
        // An event against the drift is noise, or comes from another interval. NaN is left out.
        if rate * jump > 0.0 {
            // Where voltages start anywhere, a pixel's own level is up to a threshold off, and only
            // the noise around it counts.
            let own = if self.law.from_zero { 0.0 } else { self.law.most_residual() };
            for (sums, most) in self.sums[pixel].iter_mut().zip([SMALL, LARGE]) {
                if left.abs() < own + most * threshold {
                    sums.add([rate, rate * (t - self.middle_us)], left);
                }
            }
        }
    }

    /// The clock over all events.
    ///
    /// # Errors
    /// The events do not determine it; the text is the reason.
    pub fn finish(self) -> Result<CrossingFit, String> {
        match (self.fit(0), self.fit(1)) {
            (_, Ok(far)) if far.is_far() => Ok(far),
            (near, _) => near,
        }
    }

    fn fit(&self, width: usize) -> Result<CrossingFit, String> {
        let height = (self.levels.len() / self.width.max(1)).max(1);
        let mut parts = [LineSums::default(); PARTS * PARTS];
        for (pixel, sums) in self.sums.iter().enumerate() {
            let (x, y) = (pixel % self.width, pixel / self.width);
            let part = y * PARTS / height * PARTS + x * PARTS / self.width;
            let sums = if self.law.from_zero { sums[width] } else { sums[width].centred() };
            parts[part] = parts[part].plus(sums, 1.0);
        }
        let filled: Vec<LineSums> = parts.into_iter().filter(|part| part.n > 0.0).collect();
        let all = filled.iter().fold(LineSums::default(), |sum, part| sum.plus(*part, 1.0));
        let too_few = || {
            format!("{} events in {} parts of the picture do not determine the clock", all.n, filled.len())
        };
        if filled.len() < MIN_PARTS {
            return Err(too_few());
        }
        let found = all.solve().ok_or_else(too_few)?;
        let without: Option<Vec<[f64; 2]>> =
            filled.iter().map(|part| all.plus(*part, -1.0).solve()).collect();
        let without = without.ok_or_else(too_few)?;
        let n = filled.len() as f64;
        let deviation = |i: usize| {
            let squares = without.iter().map(|w| (w[i] - found[i]) * (w[i] - found[i])).sum::<f64>();
            (squares * (n - 1.0) / n).sqrt()
        };
        let [offset_us, scale] = [0, 1].map(|i| ErrorBar { value: found[i], deviation: deviation(i) });
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of events")]
        let events = all.n as u64;
        Ok(CrossingFit { offset_us, scale, events })
    }
}
