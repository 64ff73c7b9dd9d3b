//! The sensor of v2e (Hu, Liu, Delbruck, CVPRW 2021; SensorsINI/v2e, `emulator.py`, `emulator_utils.py`).
//!
//! A pixel maps the grey `L` by `f(L) = L ln(20)/20` up to 20 and `ln L` above, and sees it through a first-order low-pass
//! filter whose rate is `2 pi cutoff (L + 20)/275`: slower in the dark. It remembers a level of what it sees; an ON event
//! is a rise by its `C+` from there, an OFF event a fall by its `C-`. Leak lowers that level by `rate rho (1 - jitter z)
//! C+` a second, `rho = 10^(cov z0)` for the pixel and `z` normal for the pixel and frame, which makes ON events. Shot
//! noise is ON with rate `q C+nominal/C+` and OFF with `q C-nominal/C-`, `q = rate/2 (1 - 0.75 (L + 20)/275)`; the pixel
//! then remembers what it sees. Within the refractory period after an event there is no other.
//!
//! What differs from that program:
//! - events lie where the pixel's own brightness crosses its threshold, not on the grid of as many instants as the
//!   frame's busiest pixel has events;
//! - `filter: exact` (the default) is the filter's true answer to an input that is straight between two frames, with the
//!   rate of their mean; `filter: euler` is the program's step `min(1, 2 pi cutoff dt (L + 20)/275)` towards the later
//!   frame, straight in between, without the frame of delay that some of its versions have;
//! - shot noise is a Poisson process with exponential gaps, not a trial per step; its rate does not fall below that of
//!   white for brighter greys;
//! - thresholds of ON and OFF are drawn apart; `f` is not rounded, and kept to 64 bits;
//! - after the refractory period, what has passed a threshold makes an event at its very end (`reference: at-event`), not at
//!   the next instant of the grid;
//! - hot pixels are stated (their share and rate) beside the tail of `rho`;
//! - the fit of photoreceptor noise and the surround of its later versions are not here.
//!
//! Crossings of a signal that is straight in `f`, shot noise of constant light and a leak without jitter do not depend on
//! the frame rate, if the filter is off; the filter depends on it by the change of its rate between two frames, `euler` by
//! more, and the jitter of the leak is drawn for each frame.

mod presets;

pub use presets::Preset;

use super::course::{Course, Filtered};
use super::detector::{Detector, Source, imbalance};
use super::front_end::FrontEnd;
use super::noise::poisson::{Rates, Train};
use super::noise::{HotPixels, Refractory, Site, Threshold};
use super::pairs::{Cap, Law, Pair, Pairs, Writer};
use super::screening::{LIMIT_PER_FRAME, Noise, ScreenError, Screening, at_least_zero};
use super::{Model, Pixels, SensorError, check_extent};
use crate::image::Size;
use crate::seed::{Seed, Space};
use crate::units::Hertz;
use serde::{Deserialize, Serialize};
use std::f64::consts::{LN_10, TAU};
use std::ops::ControlFlow;

/// Version of the law: raised when a draw or a formula changes.
const VERSION: u32 = 1;

/// Parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct V2e {
    /// `C+` and `C-`, differences of natural logarithms, and their spread.
    pub threshold: Threshold,
    /// Cutoff of the low-pass filter at white, Hz; 0 for no filter.
    pub cutoff: f64,
    /// How the filter goes from frame to frame.
    pub filter: Filter,
    /// Leak of the remembered level.
    pub leak: Leak,
    /// Shot noise of both polarities together where there is no light, Hz.
    pub shot: f64,
    /// The dead time after an event.
    pub refractory: Refractory,
    /// Pixels that fire by themselves.
    pub hot_pixels: HotPixels,
    /// More events of one pixel between two frames than this fail the step.
    pub max_events_per_pixel_frame: u32,
    /// Whether events beyond that are left out and counted instead.
    pub allow_cap: bool,
    /// What stands before the pixels.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub front_end: FrontEnd,
    /// Whether events are labelled as signal or noise.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub labels: bool,
}

/// How the filter goes from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// The answer to an input that is straight between frames.
    #[default]
    Exact,
    /// The program's step towards the later frame.
    Euler,
}

/// Leak of the remembered level, which makes ON events.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Leak {
    /// ON events per second.
    pub rate: f64,
    /// Standard deviation of the rate from frame to frame, as a share.
    pub jitter: f64,
    /// Standard deviation of the rate's decimal logarithm over the pixels.
    pub cov: f64,
}

/// Up to this grey the mapping is linear.
const LINEAR: f64 = 20.0;
/// White.
const WHITE: f64 = 255.0;
/// How much rarer shot noise is at full intensity than at none.
const SHOT_FALL: f64 = 0.75;
/// Nanoseconds in a second.
const NS: f64 = 1e9;

/// The mapping of a grey.
fn lin_log(luminance: f64) -> f64 {
    if luminance <= LINEAR { luminance * (libm::log(LINEAR) / LINEAR) } else { libm::log(luminance) }
}

/// Intensity that rates go by, never 0.
fn intensity(luminance: f64) -> f64 {
    (luminance + LINEAR) / (WHITE + LINEAR)
}

impl V2e {
    /// Whether the balance of a pixel's events must be the change of what it sees, to less than a threshold.
    #[must_use]
    pub fn keeps_balance(&self) -> bool {
        let quiet = self.leak.rate == 0.0 && self.shot == 0.0 && self.hot_pixels.is_absent();
        quiet && self.refractory.period_us == 0.0 && !self.allow_cap
    }

    /// What a pixel of nominal thresholds does at this constant grey. Leak needs the whole time from one shot to the
    /// next, so with shots at rate `s` every leak of period `T` that counts comes at rate `s/(e^(sT) - 1)`.
    #[must_use]
    pub fn noise(&self, grey: f64) -> Noise {
        let shots = self.shots_per_second(grey);
        let leak = self.leak.rate;
        let leaks = if shots == 0.0 || leak == 0.0 { leak } else { shots / libm::expm1(shots / leak) };
        let total = shots + leaks;
        let share = (leaks + 0.5 * shots) / total;
        Noise { grey, leak_hz: leak, total_hz: total, on_share: (total > 0.0).then_some(share) }
    }

    /// What this sensor will do with frames at this rate, hot pixels apart.
    ///
    /// # Errors
    /// When a parameter is outside its range, or noise alone would make more than 50 events per pixel and frame
    /// interval.
    pub fn screen(&self, rate: Hertz) -> Result<Screening, ScreenError> {
        self.validate()?;
        let sides = self.threshold.sides();
        let screened =
            Screening::new("ln L (above grey 20)", sides, (rate, self.hot_pixels), |grey| self.noise(grey))?;
        // The table is of a nominal pixel; the leak of the others is spread, and their mean is what a stream holds.
        let Leak { rate: leak, jitter, cov } = self.leak;
        let (frames_per_second, share) = (rate.to_f64(), jitter.max(1.0));
        let hz = leak * share * libm::exp(0.5 * (cov * LN_10) * (cov * LN_10));
        let per_frame = hz / frames_per_second;
        if per_frame > LIMIT_PER_FRAME {
            return Err(ScreenError::Leak { hz, per_frame, frames_per_second });
        }
        Ok(screened)
    }

    fn validate(&self) -> Result<(), ScreenError> {
        self.threshold.validate()?;
        self.refractory.validate()?;
        self.hot_pixels.validate()?;
        let Leak { rate, jitter, cov } = self.leak;
        at_least_zero("cutoff", self.cutoff)?;
        at_least_zero("leak.rate", rate)?;
        at_least_zero("leak.jitter", jitter)?;
        at_least_zero("leak.cov", cov)?;
        at_least_zero("shot", self.shot)?;
        if self.max_events_per_pixel_frame == 0 {
            let name = "max_events_per_pixel_frame";
            return Err(ScreenError::Parameter { name, found: 0.0, wanted: "at least 1" });
        }
        Ok(())
    }

    /// Shot noise of a pixel with nominal thresholds.
    fn shots_per_second(&self, luminance: f64) -> f64 {
        self.shot * (1.0 - SHOT_FALL * intensity(luminance.min(WHITE)))
    }

    /// What a pixel sees from frame to frame, without leak.
    fn course(&self, pixel: &Pixel, input: f64, pair: &Pair) -> Course {
        let Pair { length, luminance: [before, after], .. } = *pair;
        if self.cutoff == 0.0 {
            return Course::straight(pixel.seen, input, length);
        }
        let rate = |luminance| TAU * self.cutoff / NS * intensity(luminance);
        match self.filter {
            Filter::Exact => {
                let rate = rate(0.5 * (before + after));
                let filter = Filtered { output: pixel.seen, input: [pixel.input, input], rate };
                Course::filtered(&filter, length)
            }
            Filter::Euler => {
                let step = (rate(after) * length).min(1.0);
                Course::straight(pixel.seen, pixel.seen + step * (input - pixel.seen), length)
            }
        }
    }

    /// How far the remembered level of a pixel falls between two frames.
    fn leaked(&self, pixel: &Pixel, pair: &Pair) -> f64 {
        let Leak { rate, jitter, .. } = self.leak;
        if rate == 0.0 {
            return 0.0;
        }
        let z = if jitter == 0.0 { 0.0 } else { pair.site.draws(Space::Leak, pair.frame).normal() };
        rate * pixel.leakiness * (1.0 - jitter * z) * pixel.detector.thresholds[0] * (pair.length / NS)
    }
}

impl Model for V2e {
    fn law_version(&self) -> u32 {
        VERSION
    }

    fn front_end(&self) -> FrontEnd {
        self.front_end
    }

    fn labels(&self) -> bool {
        self.labels
    }

    /// The thresholds, above grey 20.
    fn contrast(&self) -> (f64, f64) {
        (self.threshold.on, self.threshold.off)
    }

    fn start(&self, size: Size, origin: [u16; 2], seed: Seed) -> Result<Box<dyn Pixels>, SensorError> {
        self.validate().map_err(|error| SensorError::Setup(error.to_string()))?;
        check_extent(size, origin)?;
        let cap = Cap { most: self.max_events_per_pixel_frame, leave_out: self.allow_cap };
        Ok(Box::new(Pairs::new(self.clone(), cap, size, origin, seed)))
    }
}

/// State of one pixel.
#[derive(Debug)]
pub(super) struct Pixel {
    detector: Detector,
    /// What it saw at the first frame.
    first: f64,
    /// What it sees: the filter's output.
    seen: f64,
    /// The filter's input at the frame before.
    input: f64,
    /// Its leak, as a share of the nominal one.
    leakiness: f64,
    shot: Train,
    own: Train,
}

impl Law for V2e {
    type Pixel = Pixel;

    fn begin(&self, site: Site, luminance: f64) -> Pixel {
        let seen = lin_log(luminance);
        let leakiness = if self.leak.cov == 0.0 {
            1.0
        } else {
            libm::exp(LN_10 * self.leak.cov * site.draws(Space::Initial, 0).normal())
        };
        Pixel {
            detector: Detector::new(self.threshold.at(site, 0), seen),
            first: seen,
            seen,
            input: seen,
            leakiness,
            shot: if self.shot == 0.0 { Train::silent() } else { Train::new(site, Space::Shot) },
            own: self.hot_pixels.train(site),
        }
    }

    fn cross(&self, pixel: &mut Pixel, pair: &Pair, writer: &mut Writer<'_>) -> ControlFlow<()> {
        let Pair { site, length, luminance, .. } = *pair;
        let input = lin_log(luminance[1]);
        let (plain, leaked) = (self.course(pixel, input, pair), self.leaked(pixel, pair));
        let [on, off] = pixel.detector.thresholds;
        let [on, off] = [self.threshold.on / on, self.threshold.off / off];
        let shots = luminance.map(|l| 0.5 * (on + off) * self.shots_per_second(l) / NS);
        let own = [self.hot_pixels.per_ns(); 2];
        let mut sources = [
            Source {
                train: &mut pixel.shot,
                rates: Rates { ends: shots, length },
                site,
                space: Space::Shot,
                on_share: on / (on + off),
                resets: true,
            },
            Source {
                train: &mut pixel.own,
                rates: Rates { ends: own, length },
                site,
                space: Space::Hot,
                on_share: 1.0,
                resets: false,
            },
        ];
        let course = plain.tilted(leaked);
        let flow = pixel.detector.cross(&course, &self.refractory, &mut sources, writer);
        // The brightness was tilted in the level's stead.
        pixel.detector.reference -= leaked;
        (pixel.seen, pixel.input) = (plain.at(length), input);
        flow
    }

    fn labels(&self) -> bool {
        self.labels
    }

    fn imbalance(&self, pixel: &Pixel, on: u32, off: u32) -> Option<f64> {
        self.keeps_balance().then(|| imbalance(&pixel.detector, pixel.seen - pixel.first, on, off))
    }
}
