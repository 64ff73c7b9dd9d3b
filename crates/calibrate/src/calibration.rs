//! All estimates of a recording.

use crate::anchor::AnchorFilter;
use crate::dead_time::dead_time;
use crate::delay::{BestDelay, DeadTime, Trials};
use crate::estimate::{Estimate, together};
use crate::flicker::{EventSpectrum, FlickerLine, event_spectrum};
use crate::ladder::{BLACK, COARSE, FINE, LAG, LEAK, OFF, ON, Rung};
use crate::read_out::{ReadOut, is_at_read_out, read_out_bursts};
use crate::recording::{PixelTrains, Recording};
use crate::still::{HOT_HZ, StillPixels, constant_light, still_pixels};
use serde::Serialize;

/// Fewest events of the pixels whose light changes.
const FEWEST_EVENTS: usize = 1000;
/// Largest share of samples at black or white.
const CLIPPED: f64 = 0.5;
/// Largest share of hot pixels in constant light.
const MOST_HOT: f64 = 0.1;
/// Parts of a contrast that the form of the path leaves open: found with planted recordings.
const FINE_TRUST: Trust = Trust { form: 0.014, compares_halves: false, largest_spread: 0.09 };
/// The same where counts do not add up: by the two halves of recordings of cameras.
const COARSE_TRUST: Trust = Trust { form: 0.05, compares_halves: true, largest_spread: 0.1 };
/// Largest error of a contrast that is determined, by the contrast.
const LARGEST_ERROR: f64 = 0.0175;
/// The misfit of most recordings.
const TYPICAL_MISFIT: f64 = 0.9;
/// The same of the offset, in grey, of the delay and of the time constant, us, and of the spread.
const OFFSET_FORM: f64 = 1.0;
const DELAY_FORM_US: f64 = 700.0;
const LAG_FORM_US: f64 = 400.0;
const SPREAD_FORM: f64 = 0.016;
/// Smallest spread that differs from the errors of the anchors.
const SMALLEST_SPREAD: f64 = 0.045;
/// Largest misfit of a fit that has found the camera, and not something else.
const LARGEST_MISFIT: f64 = 1.6;
/// Largest lag that differs from a delay, us.
const LARGEST_LAG_US: f64 = 6000.0;
/// Largest error, by the contrast, of one that is not determined and still better than a preset's.
const ROUGH: f64 = 0.2;
/// Error of a contrast that is not known, by the contrast.
const UNKNOWN_CONTRAST: f64 = 0.2;
/// The leak of the ladder is uncertain by this rate and this share of itself.
const LEAK_FORM: [f64; 2] = [0.02, 0.15];
/// A bandwidth is determined if the error of its time constant is below this share.
const LAG_ERROR: f64 = 0.12;

/// How far the contrasts of a fit are trusted.
#[derive(Debug)]
struct Trust {
    /// Error that the form of the model leaves open, by the contrast.
    form: f64,
    /// True if the halves of the recording are compared.
    compares_halves: bool,
    /// Largest spread of a fit that has found the camera, and not something else.
    largest_spread: f64,
}

/// The reason why a recording cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// No events between the frames.
    #[error(
        "events from {} to {} us and frames from {} to {} us, wanted the same clock",
        events.0, events.1, frames.0, frames.1
    )]
    Clocks {
        /// First and last event.
        events: (i64, i64),
        /// First and last frame.
        frames: (i64, i64),
    },
    /// Too few events.
    #[error("{found} events where the light changes, wanted at least {FEWEST_EVENTS}")]
    Few {
        /// Events of pixels whose frames are not still.
        found: usize,
    },
    /// Light that is not constant.
    #[error(
        "{:.0} % of the pixels have more than {HOT_HZ} events per second, wanted constant light where there are no frames",
        100.0 * share
    )]
    Moving {
        /// Share of these pixels.
        share: f64,
    },
    /// Frames at the ends of their range.
    #[error("{:.0} % of the samples of the frames are at black or white, wanted at most {:.0} %", 100.0 * share, 100.0 * CLIPPED)]
    Clipped {
        /// Share of samples of 0, or of 255.
        share: f64,
    },
}

/// A recording of constant light.
#[derive(Debug, Clone)]
pub struct StaticRecording {
    /// Its events.
    pub trains: PixelTrains,
    /// First and last time that it covers.
    pub span_us: (i64, i64),
    /// Light on the sensor, if it is known.
    pub lux: Option<f64>,
}

/// What a recording of constant light shows.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct LightLevel {
    /// Light on the sensor, if it is known.
    pub lux: Option<f64>,
    /// ON events of a calm pixel per second.
    pub noise_on_hz: Estimate,
    /// OFF events of a calm pixel per second.
    pub noise_off_hz: Estimate,
    /// Share of neighbouring events of a calm pixel that have the other sign.
    pub alternate: Estimate,
    /// Fano factor of the numbers of events of calm pixels.
    pub fano: Estimate,
    /// ON events per pixel and second from the leak.
    pub leak_hz: Estimate,
    /// Share of pixels with more than 5 events per second.
    pub hot_pixels: Estimate,
}

/// The estimates, in natural logarithms, microseconds, greys and hertz.
#[derive(Debug, Clone, Serialize)]
pub struct Calibration {
    /// Change of the logarithm of the light that makes an ON event: mean over the pixels.
    pub contrast_on: Estimate,
    /// The same of an OFF event.
    pub contrast_off: Estimate,
    /// Standard deviation of the contrasts over the pixels, by their mean.
    pub spread: Estimate,
    /// Time after an event without another one.
    pub dead_time_us: Estimate,
    /// True if changes during the dead time are lost, null without a dead time.
    pub dead_time_loses: Option<bool>,
    /// Bandwidth at the mean light of the moving pixels.
    pub cutoff_hz: Estimate,
    /// Delay of the events behind the stamps of the frames, without the lag of the bandwidth.
    pub delay_us: Estimate,
    /// Delay and lag of the bandwidth together.
    pub lag_us: Estimate,
    /// Number to add to the greys of the frames under the logarithm.
    pub offset: Estimate,
    /// Grey of a frame without light: frames and events know its difference to the offset only.
    pub black_level: Estimate,
    /// ON events per pixel and second from the leak.
    pub leak_hz: Estimate,
    /// Deviation of the noise voltage as a contrast.
    pub noise: Estimate,
    /// ON events of a calm pixel per second in constant light.
    pub noise_on_hz: Estimate,
    /// OFF events of a calm pixel per second in constant light.
    pub noise_off_hz: Estimate,
    /// Share of neighbouring events of a calm pixel in constant light that have the other sign.
    pub alternate: Estimate,
    /// Fano factor of the numbers of events of calm pixels in constant light.
    pub fano: Estimate,
    /// Each recording of constant light, in the order given.
    pub by_light: Vec<LightLevel>,
    /// Lines in the spectrum of the events in constant light.
    pub flicker: Vec<FlickerLine>,
    /// Power of this spectrum at 0, 1, 2, … Hz by that of independent events; empty if there is none.
    #[serde(skip)]
    pub spectrum: Vec<f64>,
    /// Share of pixels with more than 5 events per second in constant light.
    pub hot_pixels: Estimate,
    /// Median rate of hot pixels, and its deviation in decades.
    pub hot_rate: [f64; 2],
    /// Bursts of events at the read-out of frames.
    pub read_out: Vec<ReadOut>,
    /// Number of frames next to events that the contrasts rest on, and their mean grey.
    pub anchors: usize,
    /// Their mean grey above black.
    pub anchor_grey: f64,
    /// Mean squared error of these greys by what is expected of it, each at most 9.
    pub misfit: f64,
    /// Number of pixels in constant light.
    pub still_pixels: usize,
    /// The ladder of changes.
    pub ladder: Vec<Rung>,
}

/// Estimates all that the recording determines. Of recordings of constant light, the first decides about leak
/// and hot pixels.
///
/// # Errors
/// The recording cannot be used.
pub fn calibrate(recording: &Recording, noise: &[StaticRecording]) -> Result<Calibration, CalibrateError> {
    let still = still_pixels(recording);
    screen(recording, &still)?;
    let (dead, longest_us) = dead_time(&recording.trains);
    let hot = hot_mask(recording, &still, noise);
    let mut found = Calibration::unknown();
    found.dead_time_us = dead;
    found.still_pixels = still.pixels.len();
    found.read_out = read_out_bursts(recording);
    let is_disturbed = |us| is_at_read_out(us, &recording.stamps_us, &found.read_out);
    let at_read_out: Vec<bool> = recording.trains.all().map(|(us, _)| is_disturbed(us)).collect();
    let filter = AnchorFilter { hot: &hot, at_read_out: &at_read_out };
    let known = DeadTime { found: dead.determined.then_some(dead.value), longest_us };
    let mut trials = Trials { recording, filter, dead: known, noise: still.noise, form: FINE };
    if let Some(best) = trials.best().filter(|best| best.fit.misfit < LARGEST_MISFIT) {
        found.take_ladder(&best, dead.determined, &FINE_TRUST);
    } else {
        // Counts that do not add up: shorter sums, and less of them to trust.
        trials.form = COARSE;
        if let Some(best) = trials.best() {
            found.take_ladder(&best, dead.determined, &COARSE_TRUST);
        }
    }
    let [on, off] = [found.contrast_on, found.contrast_off];
    let share = |contrast: Estimate| contrast.se.map_or(UNKNOWN_CONTRAST, |se| se / contrast.value);
    let ratio = off.value / on.value;
    let ratio = Estimate::found(ratio, ratio * together(&[share(on), share(off)]));
    if noise.is_empty() {
        let span = (recording.stamps_us[0], recording.stamps_us[recording.stamps_us.len() - 1]);
        found.take_light(&recording.trains, &still.pixels, span, ratio);
    } else {
        found.take_levels(noise, ratio);
    }
    Ok(found)
}

/// Estimates what events of constant light determine without frames: noise, hot pixels, dead time, flicker.
/// The contrasts are those of a typical camera.
///
/// # Errors
/// The light is not constant.
pub fn calibrate_static(recording: &StaticRecording) -> Result<Calibration, CalibrateError> {
    let mut found = Calibration::unknown();
    found.dead_time_us = dead_time(&recording.trains).0;
    found.still_pixels = recording.trains.pixels();
    found.take_levels(std::slice::from_ref(recording), Estimate::found(1.0, UNKNOWN_CONTRAST));
    let hot = found.hot_pixels.value;
    if hot > MOST_HOT { Err(CalibrateError::Moving { share: hot }) } else { Ok(found) }
}

fn screen(recording: &Recording, still: &StillPixels) -> Result<(), CalibrateError> {
    let frames = (recording.stamps_us[0], recording.stamps_us[recording.stamps_us.len() - 1]);
    let within = recording.trains.all().filter(|(us, _)| (frames.0..=frames.1).contains(us)).count();
    if let Some(events) = recording.trains.span_us().filter(|_| within == 0) {
        return Err(CalibrateError::Clocks { events, frames });
    }
    let clipped = recording.frames.iter().filter(|v| **v <= 0.0 || **v >= 255.0).count();
    let share = clipped as f64 / recording.frames.len() as f64;
    if share > CLIPPED {
        return Err(CalibrateError::Clipped { share });
    }
    let calm: usize = still.pixels.iter().map(|pixel| recording.trains.of(*pixel).0.len()).sum();
    let found = recording.trains.events() - calm;
    if found < FEWEST_EVENTS { Err(CalibrateError::Few { found }) } else { Ok(()) }
}

/// Pixels that are hot in constant light.
fn hot_mask(recording: &Recording, still: &StillPixels, noise: &[StaticRecording]) -> Vec<bool> {
    let mut hot = vec![false; recording.size.pixels()];
    for pixel in &still.pixels {
        hot[*pixel] = recording.trains.of(*pixel).0.len() as f64 > HOT_HZ * recording.seconds();
    }
    for noise in noise {
        let seconds = (noise.span_us.1 - noise.span_us.0) as f64 * 1e-6;
        for (pixel, hot) in hot.iter_mut().enumerate().take(noise.trains.pixels()) {
            *hot |= noise.trains.of(pixel).0.len() as f64 > HOT_HZ * seconds;
        }
    }
    hot
}

impl Calibration {
    /// Nothing is determined: the values are those of a typical camera.
    fn unknown() -> Self {
        let none = Estimate::unknown(0.0);
        Self {
            contrast_on: Estimate::unknown(0.2),
            contrast_off: Estimate::unknown(0.2),
            spread: Estimate::unknown(0.03),
            dead_time_us: none,
            dead_time_loses: None,
            cutoff_hz: none,
            delay_us: none,
            lag_us: none,
            offset: Estimate::unknown(1.0),
            black_level: none,
            leak_hz: none,
            noise: none,
            noise_on_hz: none,
            noise_off_hz: none,
            alternate: none,
            fano: none,
            by_light: Vec::new(),
            flicker: Vec::new(),
            spectrum: Vec::new(),
            hot_pixels: none,
            hot_rate: [0.0; 2],
            read_out: Vec::new(),
            anchors: 0,
            anchor_grey: 0.0,
            misfit: 0.0,
            still_pixels: 0,
            ladder: Vec::new(),
        }
    }

    fn take_ladder(&mut self, best: &BestDelay, has_dead_time: bool, trust: &Trust) {
        let BestDelay { rule, fit, open, halves, is_sharp } = best;
        // Where anchors miss by more than the model expects, its form is less certain.
        let form = (fit.misfit / TYPICAL_MISFIT).max(1.0);
        let spread = (0.5 * (fit.spread[0] * fit.spread[0] + fit.spread[1] * fit.spread[1])).sqrt();
        let leak = 1e6 * fit.value[LEAK] / fit.value[ON];
        let leak_se = together(&[1e6 * fit.se[LEAK] / fit.value[ON], LEAK_FORM[0], LEAK_FORM[1] * leak]);
        // A leak makes ON events only.
        let is_sound = spread < trust.largest_spread && fit.misfit < LARGEST_MISFIT && leak > -3.0 * leak_se;
        let contrast = |side: usize, preset: Estimate| {
            let [low, high] = open[side];
            let (value, open) = (0.5 * (low + high), 0.5 * (high - low));
            let apart = if trust.compares_halves {
                halves.map_or(value, |halves| apart(value, halves.map(|half| half[side])))
            } else {
                0.0
            };
            let se = together(&[fit.se[side], trust.form * form * value, open, apart]);
            let found = Estimate::found(value, se);
            if is_sound && se < LARGEST_ERROR * value {
                found
            } else if fit.misfit < LARGEST_MISFIT && se < ROUGH * value {
                found.rough()
            } else {
                preset
            }
        };
        self.contrast_on = contrast(ON, self.contrast_on);
        self.contrast_off = contrast(OFF, self.contrast_off);
        let is_known = self.contrast_on.determined && self.contrast_off.determined;
        let se = together(&[spread / (2.0 * fit.stretches as f64).sqrt(), SPREAD_FORM]);
        let is_rough = [self.contrast_on, self.contrast_off].iter().all(|contrast| contrast.se.is_some());
        let found = Estimate::found(spread, se);
        self.spread = match (is_known && spread > SMALLEST_SPREAD, is_rough) {
            (true, _) => found,
            (false, true) => found.rough(),
            (false, false) => self.spread,
        };
        let offset = Estimate::found(-fit.value[BLACK], together(&[fit.se[BLACK], OFFSET_FORM]));
        let graded = |found: Estimate, preset: f64| match (is_known, is_rough) {
            (true, _) => found,
            (false, true) => found.rough(),
            (false, false) => Estimate::unknown(preset),
        };
        self.offset = graded(offset, 1.0);
        let lag = fit.value[LAG].max(0.0);
        let is_apart = *is_sharp && lag < LARGEST_LAG_US;
        let lag_se = together(&[fit.se[LAG], LAG_FORM_US]);
        self.lag_us = graded(Estimate::found(rule.delay_us + fit.value[LAG], lag_se), 0.0);
        let delay = Estimate::found(rule.delay_us, together(&[fit.se[LAG], DELAY_FORM_US]));
        self.delay_us = graded(delay.only_if(is_apart, 0.0), 0.0);
        let se = lag_se / lag.max(1.0);
        let cutoff = 1e6 / (std::f64::consts::TAU * lag.max(1.0));
        self.cutoff_hz =
            Estimate::found(cutoff, se * cutoff).only_if(is_known && is_apart && se < LAG_ERROR, 0.0);
        self.leak_hz = Estimate::found(leak, leak_se).only_if(is_known && leak_se < 0.1, 0.0);
        self.dead_time_loses = (has_dead_time && open[ON][0] >= open[ON][1]).then_some(rule.loses);
        self.anchors = fit.anchors;
        self.misfit = fit.misfit;
        self.anchor_grey = fit.grey;
        self.ladder.clone_from(&fit.rungs);
    }

    /// Takes what each recording of constant light shows, and of the first all there is.
    fn take_levels(&mut self, noise: &[StaticRecording], ratio: Estimate) {
        for (i, StaticRecording { trains, span_us, lux }) in noise.iter().enumerate() {
            let all: Vec<usize> = (0..trains.pixels()).collect();
            if i == 0 {
                self.take_light(trains, &all, *span_us, ratio);
            }
            let Some(light) = constant_light(trains, &all, *span_us, ratio) else { continue };
            let [noise_on_hz, noise_off_hz] = light.rates_hz;
            self.by_light.push(LightLevel {
                lux: *lux,
                noise_on_hz,
                noise_off_hz,
                alternate: light.alternate,
                fano: light.fano,
                leak_hz: light.leak_hz,
                hot_pixels: light.hot,
            });
        }
    }

    fn take_light(&mut self, trains: &PixelTrains, pixels: &[usize], span: (i64, i64), ratio: Estimate) {
        let Some(light) = constant_light(trains, pixels, span, ratio) else { return };
        self.hot_pixels = light.hot;
        self.hot_rate = light.hot_rate;
        [self.noise_on_hz, self.noise_off_hz] = light.rates_hz;
        [self.alternate, self.fano] = [light.alternate, light.fano];
        self.leak_hz = better(self.leak_hz, light.leak_hz);
        if let Some(EventSpectrum { power, lines }) = event_spectrum(trains, pixels, span) {
            (self.spectrum, self.flicker) = (power, lines);
        }
    }
}

/// What the halves of a recording leave open of the value of the whole.
fn apart(value: f64, halves: [f64; 2]) -> f64 {
    let [a, b] = halves.map(|half| half - value);
    0.5 * (a * a + b * b).sqrt()
}

/// The mean of two estimates by their errors.
fn better(a: Estimate, b: Estimate) -> Estimate {
    let (Some(x), Some(y)) = (a.se, b.se) else { return if a.determined { a } else { b } };
    let [p, q] = [1.0 / (x * x), 1.0 / (y * y)];
    Estimate::found((p * a.value + q * b.value) / (p + q), 1.0 / (p + q).sqrt())
}
