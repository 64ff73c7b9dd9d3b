//! What a parameter set will do, said before anything runs: contrast, leak and noise at a few greys; and the refusal of
//! sets that make no usable stream (numerics.md 1.1).

use super::{Between, Gain, Preset, Voltmeter};
use crate::sensor::statistics::Renewal;
use crate::units::Hertz;
use serde::Serialize;
use std::fmt;

/// Greys of the table.
const GREYS: [f64; 5] = [0.0, 16.0, 64.0, 128.0, 255.0];
/// The darkest grey above black, where noise that goes as `1/sqrt(L)` is worst.
const DARKEST: f64 = 1.0;
/// Events a pixel may make from noise alone in one frame interval.
const LIMIT_PER_FRAME: f64 = 50.0;
/// Noise at grey 128 above this many Hz is worth a word.
const NOISY_HZ: f64 = 20.0;
/// A brightness change by more than this factor's logarithm for one event is worth a word.
const INSENSITIVE: f64 = 1.0;

/// What a pixel of constant brightness does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Noise {
    /// Grey, 0..255.
    pub grey: f64,
    /// Events per second that the drift alone would make; negative where they are OFF.
    pub leak_hz: f64,
    /// Events per second, of drift and noise together.
    pub total_hz: f64,
    /// Share of ON events; `None` where there are no events.
    pub on_share: Option<f64>,
}

/// The table that every build prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Screening {
    /// Change of `ln(L + k2)` for one ON and one OFF event.
    pub contrast: [f64; 2],
    /// Noise at greys 0, 16, 64, 128 and 255.
    pub noise: [Noise; 5],
    /// What a user should know.
    pub warnings: Vec<Warning>,
}

/// Something unusual that stops nothing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Warning {
    /// One event takes a large change of brightness.
    Insensitive {
        /// Change of `ln(L + k2)` for one event, the larger of the two.
        contrast: f64,
    },
    /// A grey pixel makes many events by itself.
    Noisy {
        /// Events per second at grey 128.
        hz: f64,
    },
    /// The set printed in the GS2E paper, whose units are a guess.
    UncertainUnits,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Insensitive { contrast } => {
                let factor = libm::exp(*contrast);
                write!(f, "one event takes a change of brightness by a factor of {factor:.3} (C = {contrast:.3})")
            }
            Self::Noisy { hz } => {
                write!(f, "a static pixel of grey 128 makes {hz:.4} events per second, more than {NOISY_HZ}")
            }
            Self::UncertainUnits => f.write_str(
                "the set printed in the GS2E paper has no units; read as seconds and brightness 0..1 it makes a far \
                 sparser stream than a real sensor",
            ),
        }
    }
}

/// Why a parameter set cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScreenError {
    /// A parameter outside its range.
    #[error("{name} is {found}, not {wanted}")]
    Parameter {
        /// Which.
        name: &'static str,
        /// Its value.
        found: f64,
        /// What it may be.
        wanted: &'static str,
    },
    /// The published program's gain has no meaning for curves.
    #[error("`gain: midpoint` goes with `between: linear` only")]
    MidpointOfCurve,
    /// More noise than any stream can use.
    #[error(
        "a static pixel of grey {grey} would make {hz:.4} events per second from noise alone, {per_frame:.4} in a \
         frame interval at {frames_per_second} Hz, where {LIMIT_PER_FRAME} is the most that is accepted: are the units \
         of k right?"
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

impl Voltmeter {
    /// What a pixel of this constant grey does.
    #[must_use]
    pub fn noise(&self, grey: f64) -> Noise {
        let [_, k2, k3, k4, k5, k6] = self.k;
        let sigma = k3 * grey.sqrt() / (grey + k2) + k6;
        let drift = k4 + k5 * grey;
        let renewal =
            Renewal { drift, variance: sigma * sigma, up: self.threshold_on, down: self.threshold_off };
        let leak = drift / if drift < 0.0 { self.threshold_off } else { self.threshold_on };
        let share = renewal.on_share();
        Noise {
            grey,
            leak_hz: PER_SECOND * leak,
            total_hz: PER_SECOND * renewal.rate(),
            on_share: (!share.is_nan()).then_some(share),
        }
    }

    /// Whether every parameter is within its range.
    ///
    /// # Errors
    /// Naming the first that is not.
    pub fn validate(&self) -> Result<(), ScreenError> {
        let k_names = ["k1", "k2", "k3", "k4", "k5", "k6"];
        let thresholds = [("threshold.on", self.threshold_on), ("threshold.off", self.threshold_off)];
        for (name, found) in k_names.into_iter().zip(self.k).chain(thresholds) {
            let (holds, wanted) = match name {
                "k3" | "k6" => (found >= 0.0, "a finite number of at least 0"),
                "k4" | "k5" => (true, "a finite number"),
                _ => (found > 0.0, "a finite number above 0"),
            };
            if !(holds && found.is_finite()) {
                return Err(ScreenError::Parameter { name, found, wanted });
            }
        }
        if self.gain == Gain::Midpoint && self.between != Between::Linear {
            return Err(ScreenError::MidpointOfCurve);
        }
        if self.max_events_per_pixel_frame == 0 {
            let name = "max_events_per_pixel_frame";
            return Err(ScreenError::Parameter { name, found: 0.0, wanted: "at least 1" });
        }
        Ok(())
    }

    /// What this sensor will do with frames at this rate.
    ///
    /// # Errors
    /// When a parameter is outside its range, or noise alone would make more than 50 events per pixel and frame
    /// interval at grey 0, 1, 16, 64, 128 or 255.
    pub fn screen(&self, rate: Hertz) -> Result<Screening, ScreenError> {
        self.validate()?;
        let frames_per_second = rate.to_f64();
        let noise = GREYS.map(|grey| self.noise(grey));
        let worst = noise.into_iter().fold(self.noise(DARKEST), |worst, noise| {
            if noise.total_hz > worst.total_hz { noise } else { worst }
        });
        let per_frame = worst.total_hz / frames_per_second;
        if per_frame > LIMIT_PER_FRAME {
            let Noise { grey, total_hz: hz, .. } = worst;
            return Err(ScreenError::Impossible { grey, hz, per_frame, frames_per_second });
        }
        let contrast = [self.threshold_on / self.k[0], self.threshold_off / self.k[0]];
        Ok(Screening { contrast, noise, warnings: self.warnings(contrast) })
    }

    fn warnings(&self, contrast: [f64; 2]) -> Vec<Warning> {
        let contrast = contrast[0].max(contrast[1]);
        let hz = self.noise(128.0).total_hz;
        let as_printed = self.k.iter().zip(Preset::Gs2eSi.k()).all(|(a, b)| a.to_bits() == b.to_bits());
        [
            (contrast > INSENSITIVE).then_some(Warning::Insensitive { contrast }),
            (hz > NOISY_HZ).then_some(Warning::Noisy { hz }),
            as_printed.then_some(Warning::UncertainUnits),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// From microseconds, the program's unit of rates.
const PER_SECOND: f64 = 1e6;

/// One line of contrast, then a table of leak, noise and ON share by grey.
impl fmt::Display for Screening {
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
        for Noise { grey, leak_hz, total_hz, on_share } in self.noise {
            let share = on_share.map_or_else(|| "-".to_owned(), |share| format!("{share:.3}"));
            write!(f, "\n{grey:>5} {leak_hz:>10.4} {total_hz:>10.4} {share:>8}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::units::{Brightness, TimeUnit, Units};
    use super::*;

    const PRINTED: [f64; 6] = [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5];

    fn rate() -> Hertz {
        Hertz("2400".parse().unwrap())
    }

    fn reading(time: TimeUnit, brightness: Brightness) -> Voltmeter {
        Voltmeter::new(Units { time, brightness }.to_official(PRINTED))
    }

    /// Relative tolerance of a figure given to two digits or more: half of its last.
    fn near(found: f64, wanted: f64, relative: f64) {
        assert!((found - wanted).abs() <= relative * wanted, "{found:e}, wanted {wanted:e}");
    }

    #[test]
    fn contrast_and_leak_of_the_presets() {
        // numerics.md 1.1, the table of presets, to the digits given there.
        let t = |preset: Preset, contrast: f64, leaks: [f64; 5]| {
            let screening = Voltmeter::new(preset.k()).screen(rate()).unwrap();
            near(screening.contrast[0], contrast, 3e-3);
            for (noise, leak) in screening.noise.iter().zip(leaks) {
                near(noise.leak_hz, leak, 0.05);
            }
        };
        t(Preset::Dvs346, 0.190, [0.10, 0.18, 0.42, 0.74, 1.375]);
        t(Preset::Dvs240, 0.226, [0.10, 0.90, 3.3, 6.5, 12.85]);
        t(Preset::Gs2eSi, 2.0, [0.010, 0.016, 0.035, 0.060, 0.11]);
    }

    #[test]
    fn noise_of_gs2e_si() {
        // numerics.md 8.1, last line.
        let sensor = Voltmeter::new(Preset::Gs2eSi.k());
        let t = |grey, hz, share: f64| {
            let noise = sensor.noise(grey);
            near(noise.total_hz, hz, 0.02);
            near(noise.on_share.unwrap(), share, 0.01);
        };
        t(1.0, 1.62, 0.503);
        t(2.0, 1.00, 0.505);
        t(8.0, 0.30, 0.52);
        t(32.0, 0.081, 0.64);
        t(64.0, 0.049, 0.855);
        t(128.0, 0.0605, 0.998);
        t(255.0, 0.11, 1.0);
    }

    #[test]
    fn readings_of_the_printed_set() {
        // numerics.md 1.1, the table of readings: noise at greys 1, 16 and 128 and whether a sensor can be that.
        let t = |time, brightness, hz: [f64; 3], usable: bool| {
            let sensor = reading(time, brightness);
            for (grey, hz) in [1.0, 16.0, 128.0].into_iter().zip(hz) {
                near(sensor.noise(grey).total_hz, hz, 0.04);
            }
            assert_eq!(sensor.screen(rate()).is_ok(), usable, "{time:?} {brightness:?}");
        };
        t(TimeUnit::Us, Brightness::Grey255, [1.1e5, 1.6e6, 1.28e7], false);
        t(TimeUnit::Us, Brightness::Unit, [1.6e6, 1.6e5, 6.0e4], false);
        t(TimeUnit::Ms, Brightness::Grey255, [110.0, 1610.0, 12810.0], true);
        t(TimeUnit::Ms, Brightness::Unit, [1619.0, 155.0, 60.0], true);
        t(TimeUnit::S, Brightness::Grey255, [0.11, 1.6, 12.8], true);
        t(TimeUnit::S, Brightness::Unit, [1.62, 0.155, 0.060], true);
    }

    #[test]
    fn the_refusal_names_grey_and_rate() {
        let error = reading(TimeUnit::Us, Brightness::Grey255).screen(rate()).unwrap_err();
        assert!(error.to_string().starts_with("a static pixel of grey 255 would make 255100"), "{error}");
        // 25.5 kHz at grey 255 are 10.6 events in a frame interval of 1/2400 s and 510 in one of 1/50 s.
        let slow = reading(TimeUnit::Ms, Brightness::Grey255).screen(Hertz("50".parse().unwrap()));
        assert!(
            matches!(slow, Err(ScreenError::Impossible { per_frame, .. }) if (509.0..511.0).contains(&per_frame))
        );
    }

    #[test]
    fn warnings() {
        let codes = |sensor: Voltmeter| sensor.screen(rate()).unwrap().warnings;
        assert_eq!(codes(Voltmeter::new(Preset::Dvs346.k())), []);
        assert_eq!(
            codes(Voltmeter::new(Preset::Gs2eSi.k())),
            [Warning::Insensitive { contrast: 2.0 }, Warning::UncertainUnits]
        );
        let noisy = codes(reading(TimeUnit::Ms, Brightness::Unit));
        assert!(matches!(noisy[..], [Warning::Insensitive { .. }, Warning::Noisy { hz }] if hz > 59.0));
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let t = |change: fn(&mut Voltmeter), message: &str| {
            let mut sensor = Voltmeter::new(Preset::Dvs346.k());
            change(&mut sensor);
            assert_eq!(sensor.validate().unwrap_err().to_string(), message);
        };
        t(|s| s.k[0] = 0.0, "k1 is 0, not a finite number above 0");
        t(|s| s.k[1] = f64::NAN, "k2 is NaN, not a finite number above 0");
        t(|s| s.k[2] = -1.0, "k3 is -1, not a finite number of at least 0");
        t(|s| s.k[4] = f64::INFINITY, "k5 is inf, not a finite number");
        t(|s| s.threshold_off = -0.5, "threshold.off is -0.5, not a finite number above 0");
        t(|s| s.max_events_per_pixel_frame = 0, "max_events_per_pixel_frame is 0, not at least 1");
    }

    #[test]
    fn the_table_is_for_people() {
        let table = Voltmeter::new(Preset::Dvs346.k()).screen(rate()).unwrap().to_string();
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "contrast C: ON 0.1899 (brightness x1.209), OFF 0.1899 (x0.827)");
        assert_eq!(lines[2], "    0     0.1000     0.1000    1.000");
        assert_eq!(lines.len(), 7);
    }
}
