//! Light that changes with time: lamps that flicker, and a level that rises and falls.
//!
//! ```text
//! f(t) = 2^s(t) (1 + d w(nu t + phi)),   c' = encode(f decode(c))
//! ```
//!
//! The whole scene is lit alike, so its light is multiplied by one factor `f`, in linear light. `c` are the
//! display-encoded colours of a rendering, and the curve is that of sRGB. `w` has a mean of 0, so `f` has a
//! mean of 1 without a level. `d` is the depth of modulation after Michelson, `(max - min) / (max + min)` for
//! a sine or a square wave. `s` is the level in stops.
//!
//! # Examples
//!
//! ```
//! use gs2e_render::lights::{Flicker, LevelMoment, SceneLights, Waveform};
//!
//! // The light doubles within a second, one stop, and a lamp flickers with a period of 0.1 s.
//! let level = vec![LevelMoment { t: 0.0, stops: 0.0 }, LevelMoment { t: 1.0, stops: 1.0 }];
//! let flicker = Flicker { hz: 10.0, depth: 0.5, waveform: Waveform::Square, phase: 0.0 };
//! let mut lights = SceneLights { flicker: None, level };
//! assert_eq!(lights.at(1.0).factor, 2.0);
//! lights.flicker = Some(flicker);
//! // The bright half of a period after 1 s, and then the dark one.
//! assert_eq!([1.02, 1.07].map(|seconds| lights.at(seconds).factor), [3.0, 1.0]);
//! ```

mod lit;

use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, LN_2, PI, TAU};
use std::fmt;

/// Part of a period by which a jump of a square wave comes early, so that a stamp at the jump, whose product
/// with the frequency may be rounded down, is after it.
const EARLY: f64 = 1e-9;
/// Equivalent of a period of flicker in px of motion, for the choice of frames by a tolerance: the longest
/// step of its pilot is 9 px, or 4.4 frames in a period.
const PERIOD_PX: f64 = 40.0;
/// Equivalent of a stop, px.
const STOP_PX: f64 = 8.0;
/// Least factor that is undone: the rounding of a picture to bytes grows with its inverse.
const LEAST_UNDONE: f64 = 0.2;
/// Minimum sub-frames of an exposure in a period.
const SUBFRAMES: f64 = 16.0;

/// The light of a scene over time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneLights {
    /// Flicker, if there is any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flicker: Option<Flicker>,
    /// The level at moments, in order of time; constant before the first and after the last, and linear in
    /// stops between them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub level: Vec<LevelMoment>,
}

/// A periodic change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Flicker {
    /// Frequency of the light, Hz.
    pub hz: f64,
    /// Depth of modulation, above 0 and at most 1.
    pub depth: f64,
    /// Form of a period.
    pub waveform: Waveform,
    /// Part of a period that is over at the first pose, 0 to 1.
    pub phase: f64,
}

/// The form of a period of light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Waveform {
    /// A sine, from the mean upwards.
    #[default]
    Sine,
    /// Bright in the first half of the period and dark in the second, as a lamp with pulse-width modulation.
    Square,
    /// The size of a sine, from the dark upwards, as a lamp on the mains: `hz` is twice the frequency of the
    /// mains.
    Rectified,
}

/// The level at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LevelMoment {
    /// Time after the first pose, s.
    pub t: f64,
    /// Level in stops: each doubles the light.
    pub stops: f64,
}

/// The factor on the light at a moment, and its change per second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightAt {
    /// Factor, at least 0.
    pub factor: f64,
    /// Its derivative, 1/s; from the right where the light jumps or bends.
    pub rate: f64,
}

impl Waveform {
    /// The form and its derivative by the phase, in 1 per period, at this part of a period, 0 to 1.
    fn at(self, phase: f64) -> [f64; 2] {
        match self {
            Self::Sine => [libm::sin(TAU * phase), TAU * libm::cos(TAU * phase)],
            Self::Square if phase < 0.5 => [1.0, 0.0],
            Self::Square => [-1.0, 0.0],
            // The mean of a rectified sine is 2/pi.
            Self::Rectified => {
                [FRAC_PI_2 * libm::sin(PI * phase) - 1.0, FRAC_PI_2 * PI * libm::cos(PI * phase)]
            }
        }
    }

    /// Returns true if the light jumps.
    #[must_use]
    pub fn jumps(self) -> bool {
        self == Self::Square
    }

    /// The name in recipes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sine => "sine",
            Self::Square => "square",
            Self::Rectified => "rectified",
        }
    }
}

impl Flicker {
    /// The factor at this time after the first pose.
    fn at(&self, seconds: f64) -> LightAt {
        let turns = self.hz * seconds + self.phase + EARLY;
        let [form, slope] = self.waveform.at(turns - libm::floor(turns));
        LightAt { factor: 1.0 + self.depth * form, rate: self.depth * slope * self.hz }
    }
}

impl SceneLights {
    /// The light at this time after the first pose, s.
    #[must_use]
    pub fn at(&self, seconds: f64) -> LightAt {
        let level = self.level_at(seconds);
        let Some(flicker) = &self.flicker else { return level };
        let LightAt { factor, rate } = flicker.at(seconds);
        // A depth of 1 leaves rounding below 0.
        let factor = factor.max(0.0);
        LightAt { factor: level.factor * factor, rate: level.rate * factor + level.factor * rate }
    }

    /// The light that undoes the one at a stamp. `None` where so little was left that a picture cannot be
    /// undone.
    #[must_use]
    pub fn undone_at_us(&self, stamp_us: i64) -> Option<LightAt> {
        let factor = self.at_us(stamp_us).factor;
        (factor >= LEAST_UNDONE).then(|| LightAt { factor: 1.0 / factor, rate: 0.0 })
    }

    /// As [`SceneLights::at`], for a stamp.
    #[must_use]
    pub fn at_us(&self, stamp_us: i64) -> LightAt {
        self.at(stamp_us as f64 * 1e-6)
    }

    fn level_at(&self, seconds: f64) -> LightAt {
        let after = self.level.partition_point(|moment| moment.t <= seconds);
        let (stops, slope) = match (after.checked_sub(1).map(|at| self.level[at]), self.level.get(after)) {
            (Some(from), Some(to)) => {
                let slope = (to.stops - from.stops) / (to.t - from.t);
                (from.stops + slope * (seconds - from.t), slope)
            }
            (Some(only), None) => (only.stops, 0.0),
            (None, Some(only)) => (only.stops, 0.0),
            (None, None) => return LightAt { factor: 1.0, rate: 0.0 },
        };
        let factor = libm::exp2(stops);
        LightAt { factor, rate: factor * LN_2 * slope }
    }

    /// Motion of the image at which a step of equal motion follows this light, px/s, between two moments, s.
    #[must_use]
    pub fn equivalent_px_s(&self, [from, to]: [f64; 2]) -> f64 {
        let flicker = self.flicker.map_or(0.0, |flicker| flicker.hz * PERIOD_PX);
        let ramps = self.level.windows(2).filter(|pair| pair[0].t < to && pair[1].t > from);
        let steepest = ramps.map(|pair| ((pair[1].stops - pair[0].stops) / (pair[1].t - pair[0].t)).abs());
        flicker + STOP_PX * steepest.fold(0.0, f64::max)
    }

    /// Sub-frames that a dense frame of this length needs, so that its exposure sees the flicker.
    #[must_use]
    pub fn subframes(&self, frame_s: f64) -> f64 {
        self.flicker.map_or(0.0, |flicker| SUBFRAMES * flicker.hz * frame_s)
    }
}

/// Frames in a period below which brightness between frames misses that of the light: a line through 20
/// frames misses a sine by `(pi / 20)^2 / 2`, or 1.2 %, of its amplitude.
const FRAMES_A_PERIOD: f64 = 20.0;

/// A warning for light that changes too fast for frames with these stamps.
#[must_use]
pub fn sampling_warning(lights: &SceneLights, stamps_us: &[i64]) -> Option<String> {
    let Flicker { hz, waveform, .. } = lights.flicker?;
    let steps = stamps_us.len().checked_sub(1).filter(|steps| *steps > 0)?;
    let frames = steps as f64 / (1e-6 * (stamps_us[steps] - stamps_us[0]) as f64) / hz;
    if waveform.jumps() {
        return Some(format!(
            "the light jumps between two frames: the numbers of events follow it, but their times only to {:.0} us",
            1e6 / (frames * hz)
        ));
    }
    (frames < FRAMES_A_PERIOD).then(|| {
        format!(
            "the sensor sees {frames:.0} frames in a period of the flicker of {hz} Hz: with fewer than 20, brightness \
             between two frames misses more than 1 % of the change; raise sampling.rate, or write a tolerance"
        )
    })
}

impl fmt::Display for SceneLights {
    /// The light in words, for example `flicker of 100 Hz (sine, depth 0.5)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(Flicker { hz, depth, waveform, .. }) = self.flicker {
            write!(f, "flicker of {hz} Hz ({}, depth {depth})", waveform.name())?;
        }
        let (Some(first), Some(last)) = (self.level.first(), self.level.last()) else { return Ok(()) };
        let and = if self.flicker.is_some() { ", " } else { "" };
        write!(f, "{and}level from {} to {} stops in {} moments", first.stops, last.stops, self.level.len())
    }
}

#[cfg(test)]
mod tests;
