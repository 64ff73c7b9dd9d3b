//! Prediction of a sensor's behaviour before anything runs: contrast, leak and noise at a few
//! greys. Sensors that make no usable stream are refused.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::units::Hertz;
//! use gs2e_sensor::SensorParameters;
//! use gs2e_sensor::esim::EsimModel;
//! use gs2e_sensor::screening::ScreenError;
//!
//! let rate = Hertz("100".parse()?);
//! let screening = EsimModel::trainable().screen(rate)?;
//! assert_eq!(screening.contrast, [0.2, 0.2]);
//! // The ideal sensor makes no event in constant light.
//! assert!(screening.noise.iter().all(|noise| noise.total_hz == 0.0) && screening.warnings.is_empty());
//! let wrong = EsimModel { eps: 0.0, ..EsimModel::trainable() };
//! assert!(matches!(wrong.screen(rate), Err(ScreenError::Parameter { name: "eps", .. })));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::SensorParameters;
use gs2e_num::units::Hertz;
use serde::Serialize;
use std::fmt;

/// The grey at which noise may cause a warning.
const MIDDLE: f64 = 128.0;
/// Greys of the table.
const GREYS: [f64; 5] = [0.0, 16.0, 64.0, 128.0, 255.0];
/// The darkest grey above black, where noise proportional to `1/sqrt(L)` is largest.
const DARKEST: f64 = 1.0;
/// Events a pixel may make from noise alone in one frame interval.
pub(super) const LIMIT_PER_FRAME: f64 = 50.0;
/// Noise at grey 128, in Hz, above which there is a warning.
const NOISY_HZ: f64 = 20.0;
/// Rate of noise events, in Hz, below which a polarity counts as absent.
const RARE_HZ: f64 = 1e-3;
/// Contrasts of one event, as differences of logarithms, outside which there is a warning.
const TYPICAL_CONTRAST: [f64; 2] = [0.05, 2.0];

/// Noise at constant brightness: of one pixel, or the mean of all pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ConstantLightNoise {
    /// Grey, 0..255.
    pub grey: f64,
    /// Events per second from drift alone; negative for OFF.
    pub leak_hz: f64,
    /// Events per second from drift and noise together.
    pub total_hz: f64,
    /// Share of ON events; `None` without events.
    pub on_share: Option<f64>,
}

impl ConstantLightNoise {
    /// The noise with additional ON and OFF events, Hz.
    pub(super) fn plus(self, [on, off]: [f64; 2]) -> Self {
        let own = self.total_hz * self.on_share.unwrap_or(0.0);
        let total_hz = self.total_hz + on + off;
        let on_share = (total_hz > 0.0).then(|| ((own + on) / total_hz).min(1.0));
        // Unchanged to the last bit where there is nothing to add.
        if on + off == 0.0 { self } else { Self { total_hz, on_share, ..self } }
    }
}

/// Half of the range of the normal distribution that a mean covers, and its step, in standard
/// deviations. The trapezoid rule is exact to 1e-9 here, because a Gaussian is smooth and ends flat.
const REACH: i32 = 10;
const STEP: f64 = 0.5;

/// The mean noise of pixels with normal thresholds of ON and OFF, of at least `least`.
pub(super) fn array_mean(
    nominal: [f64; 2],
    spread: f64,
    least: [f64; 2],
    noise: impl Fn([f64; 2]) -> ConstantLightNoise,
) -> ConstantLightNoise {
    if spread == 0.0 {
        return noise(nominal);
    }
    let threshold = |side: usize, z: f64| (nominal[side] + spread * z).max(least[side]);
    normal_mean(|up| normal_mean(|down| noise([threshold(0, up), threshold(1, down)])))
}

/// The mean noise over a standard normal variable.
pub(super) fn normal_mean(noise: impl Fn(f64) -> ConstantLightNoise) -> ConstantLightNoise {
    let [mut weights, mut leak, mut on, mut total] = [0.0; 4];
    for z in (-REACH..=REACH).map(|i| STEP * f64::from(i)) {
        let (weight, found) = (libm::exp(-0.5 * z * z), noise(z));
        weights += weight;
        leak += weight * found.leak_hz;
        on += weight * found.total_hz * found.on_share.unwrap_or(0.0);
        total += weight * found.total_hz;
    }
    let on_share = (total > 0.0).then(|| on / total);
    ConstantLightNoise { leak_hz: leak / weights, total_hz: total / weights, on_share, ..noise(0.0) }
}

/// The mean of a number over a standard normal variable.
pub(super) fn standard_normal_mean(value: impl Fn(f64) -> f64) -> f64 {
    let [mut weights, mut sum] = [0.0; 2];
    for z in (-REACH..=REACH).map(|i| STEP * f64::from(i)) {
        let weight = libm::exp(-0.5 * z * z);
        weights += weight;
        sum += weight * value(z);
    }
    sum / weights
}

/// The table that every build prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SensorScreening {
    /// The quantity that the sensor compares, as a function of the grey `L`.
    pub quantity: &'static str,
    /// Change of that quantity for one ON and one OFF event.
    pub contrast: [f64; 2],
    /// Noise at greys 0, 16, 64, 128 and 255.
    pub noise: [ConstantLightNoise; 5],
    /// Warnings for the user.
    pub warnings: Vec<ScreeningWarning>,
}

/// A remark that does not stop the build.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ScreeningWarning {
    /// One event needs a large change of brightness.
    Insensitive {
        /// Change of the logarithm for one event, the larger of ON and OFF.
        contrast: f64,
    },
    /// Hardly a change of brightness is needed for an event.
    Sensitive {
        /// Change of the logarithm for one event, the smaller of ON and OFF.
        contrast: f64,
    },
    /// A pixel of constant grey makes many events.
    Noisy {
        /// Events per second at grey 128.
        hz: f64,
    },
    /// All noise events at the greys of the table are of one polarity.
    OnePolarity {
        /// True if there are no OFF events, false if there are no ON events.
        lacks_off: bool,
    },
    /// The set printed in the GS2E paper, with units that are a guess.
    UncertainUnits,
}

impl ScreeningWarning {
    /// Returns true if it is about the contrast of an event.
    #[must_use]
    pub fn is_of_contrast(&self) -> bool {
        matches!(self, Self::Insensitive { .. } | Self::Sensitive { .. })
    }
}

impl fmt::Display for ScreeningWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Insensitive { contrast } => {
                write!(
                    f,
                    "one event needs a contrast of {contrast:.4} in ln, which is above {most}: cameras have 0.1 to \
                     0.5; write contrast: 0.2",
                    most = TYPICAL_CONTRAST[1]
                )
            }
            Self::Sensitive { contrast } => write!(
                f,
                "one event needs a contrast of {contrast:.4} in ln only, which is below {least}: cameras have 0.1 to \
                 0.5; write contrast: 0.2",
                least = TYPICAL_CONTRAST[0]
            ),
            Self::Noisy { hz } => {
                write!(f, "a static pixel of grey 128 makes {hz:.4} events per second, more than {NOISY_HZ}")
            }
            Self::OnePolarity { lacks_off } => {
                let made = if *lacks_off { "ON" } else { "OFF" };
                write!(
                    f,
                    "its noise makes {made} events only; real cameras make both. For realistic noise use preset: \
                     davis346 or evk4"
                )
            }
            Self::UncertainUnits => f.write_str(
                "the parameters printed in the GS2E paper have no units; read as seconds and brightness 0..1, they make a far \
                 sparser stream than a real sensor",
            ),
        }
    }
}

/// The reason why a parameter set is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScreenError {
    /// A parameter is outside its range.
    #[error("{name} is {found}, not {wanted}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        found: f64,
        /// Values that it may have.
        wanted: &'static str,
    },
    /// Settings that exclude each other.
    #[error("{0}")]
    Combination(&'static str),
    /// More events of a hot pixel than any stream can use.
    #[error(
        "a hot pixel would make {hz:.4} events per second, or {per_frame:.4} per frame interval at {frames_per_second} Hz, \
         above the limit of {LIMIT_PER_FRAME}: lower hot_pixels.rate"
    )]
    HotPixels {
        /// Events per second of one.
        hz: f64,
        /// Events per frame interval.
        per_frame: f64,
        /// Frame rate.
        frames_per_second: f64,
    },
    /// More leak events of a pixel, on average over the pixels, than any stream can use.
    #[error(
        "leak would make {hz:.4} events per second and pixel on average, or {per_frame:.4} per frame interval at \
         {frames_per_second} Hz, above the limit of {LIMIT_PER_FRAME}: lower leak.rate, leak.jitter or \
         leak.cov"
    )]
    Leak {
        /// Events per second, the mean over the pixels.
        hz: f64,
        /// Events per frame interval.
        per_frame: f64,
        /// Frame rate.
        frames_per_second: f64,
    },
    /// More noise than any stream can use.
    #[error(
        "a static pixel of grey {grey} would make {hz:.4} events per second from noise only, or {per_frame:.4} per \
         frame interval at {frames_per_second} Hz, above the limit of {LIMIT_PER_FRAME}: are the units \
         right?"
    )]
    Impossible {
        /// Grey, 0..255.
        grey: f64,
        /// Events per second.
        hz: f64,
        /// Events per frame interval.
        per_frame: f64,
        /// Frame rate.
        frames_per_second: f64,
    },
}

/// Checks that a parameter is a finite number of at least 0.
pub(super) fn at_least_zero(name: &'static str, found: f64) -> Result<(), ScreenError> {
    if found >= 0.0 && found.is_finite() {
        return Ok(());
    }
    Err(ScreenError::Parameter { name, found, wanted: "a finite number of at least 0" })
}

impl SensorScreening {
    /// The table of a sensor. Frames come at `rate`.
    ///
    /// # Errors
    /// A parameter is outside its range, or noise alone would make more than 50 events per pixel and
    /// frame interval at grey 0, 1, 16, 64, 128 or 255, or a hot pixel would do so by itself.
    pub(super) fn new(
        quantity: &'static str,
        contrast: [f64; 2],
        rate: Hertz,
        sensor: &dyn SensorParameters,
    ) -> Result<Self, ScreenError> {
        sensor.validate()?;
        let (frames_per_second, hot_pixels) = (rate.to_f64(), sensor.settings().hot_pixels);
        let noise = |grey| sensor.array_noise(grey);
        // `noise` describes a pixel that is not hot, so hot pixels are checked apart.
        let per_frame = hot_pixels.rate / frames_per_second;
        if !hot_pixels.is_absent() && per_frame > LIMIT_PER_FRAME {
            return Err(ScreenError::HotPixels { hz: hot_pixels.rate, per_frame, frames_per_second });
        }
        let at_greys = GREYS.map(noise);
        let worst = at_greys
            // The fold starts at grey 1, which the table does not show.
            .into_iter()
            .fold(noise(DARKEST), |worst, noise| if noise.total_hz > worst.total_hz { noise } else { worst });
        let per_frame = worst.total_hz / frames_per_second;
        if per_frame > LIMIT_PER_FRAME {
            let ConstantLightNoise { grey, total_hz: hz, .. } = worst;
            return Err(ScreenError::Impossible { grey, hz, per_frame, frames_per_second });
        }
        let hz = noise(MIDDLE).total_hz;
        let noisy = (hz > NOISY_HZ).then_some(ScreeningWarning::Noisy { hz });
        let warnings = unusual(contrast).chain(noisy).chain(one_polarity(&at_greys)).collect();
        Ok(Self { quantity, contrast, noise: at_greys, warnings })
    }
}

/// The warnings for contrasts that no camera has.
fn unusual([on, off]: [f64; 2]) -> impl Iterator<Item = ScreeningWarning> {
    let ([smallest, largest], [least, most]) = ([on.min(off), on.max(off)], TYPICAL_CONTRAST);
    let sensitive = (smallest < least).then_some(ScreeningWarning::Sensitive { contrast: smallest });
    let insensitive = (largest > most).then_some(ScreeningWarning::Insensitive { contrast: largest });
    sensitive.into_iter().chain(insensitive)
}

/// The warning for noise of one polarity. A sensor without noise has none.
fn one_polarity(noise: &[ConstantLightNoise]) -> Option<ScreeningWarning> {
    let most = |rate: fn(&ConstantLightNoise, f64) -> f64| {
        noise.iter().filter_map(|n| Some(rate(n, n.on_share?))).fold(0.0, f64::max)
    };
    let (on, off) = (most(|n, share| n.total_hz * share), most(|n, share| n.total_hz * (1.0 - share)));
    let least = on.min(off);
    // A real pixel makes an event of either polarity in a few minutes at some light.
    (least < RARE_HZ && on.max(off) >= RARE_HZ)
        .then_some(ScreeningWarning::OnePolarity { lacks_off: off < on })
}

/// One line on contrast, then a table of leak, noise and ON share by grey.
impl fmt::Display for SensorScreening {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let factor = self.contrast.map(libm::exp);
        writeln!(
            f,
            "contrast C: ON {:.4} (brightness x{:.3}), OFF {:.4} (x{:.3})",
            self.contrast[0],
            factor[0],
            self.contrast[1],
            1.0 / factor[1]
        )?;
        write!(f, "{:>5} {:>10} {:>10} {:>8}", "grey", "leak Hz", "noise Hz", "ON share")?;
        for ConstantLightNoise { grey, leak_hz, total_hz, on_share } in self.noise {
            let share = on_share.map_or_else(|| "-".to_owned(), |share| format!("{share:.3}"));
            write!(f, "\n{grey:>5} {leak_hz:>10.4} {total_hz:>10.4} {share:>8}")?;
        }
        Ok(())
    }
}
