//! The threshold of an event in the brightness formula of a consumer.
//!
//! Each method has one formula for the meaning of an event. A sensor of this program has another,
//! so a threshold `c` of the sensor is `c * factor` in the formula, and the factor depends on the
//! grey. The median over greys is written to the consumer's config; the 5th and the 95th percentile
//! say how far it is from true.

use gs2e_image::srgb;
use gs2e_sensor::front_end::ChannelDecode;
use gs2e_sensor::{SensorChoice, SensorModel, WHITE};

/// A formula of a consumer, of a display-encoded grey `g` from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum BrightnessFormula {
    /// `ln(255 g)`, linear below 20: E-NeRF, E2NeRF, IncEventGS.
    LinLog,
    /// `ln(g + offset)`: Robust e-NeRF, Deblur e-NeRF.
    Log {
        /// The offset.
        offset: f64,
    },
    /// `ln(g^2.2 + offset)`: EventNeRF, E-3DGS.
    Gamma {
        /// The offset.
        offset: f64,
    },
}

/// Change of a formula per change of the sensor's brightness, over greys from 0.02 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BrightnessFactor {
    /// Median.
    pub(super) median: f64,
    /// 5th percentile.
    pub(super) p5: f64,
    /// 95th percentile.
    pub(super) p95: f64,
}

/// Range of greys.
const GREYS: [f64; 2] = [0.02, 1.0];
/// Number of greys. The percentiles of a smooth function move by a thousandth of the range.
const COUNT: u32 = 2000;
/// Half of the step of the differences: an error of 1e-6 of a slope at the darkest grey.
const STEP: f64 = 1e-5;
/// Width of the lin-log formula's linear part, grey of 255.
const LINEAR_BELOW: f64 = 20.0;
/// Exponent of the gamma formula.
const GAMMA: f64 = 2.2;
/// Spread up to which a factor counts as exact.
const EXACT: f64 = 0.01;

impl BrightnessFormula {
    /// The value at an encoded grey.
    fn of(self, grey: f64) -> f64 {
        match self {
            Self::LinLog => {
                let level = grey * WHITE;
                let slope = libm::log(LINEAR_BELOW) / LINEAR_BELOW;
                if level <= LINEAR_BELOW { level * slope } else { libm::log(level) }
            }
            Self::Log { offset } => libm::log(grey + offset),
            Self::Gamma { offset } => libm::log(libm::pow(grey, GAMMA) + offset),
        }
    }
}

impl BrightnessFactor {
    /// Compares a formula with a sensor.
    pub(super) fn between(sensor: &SensorChoice, formula: BrightnessFormula) -> Self {
        let own = |grey: f64| sensor_brightness(sensor.as_model(), grey);
        let slope = |of: &dyn Fn(f64) -> f64, grey: f64| of(grey + STEP) - of(grey - STEP);
        let mut ratios: Vec<f64> = (0..=COUNT)
            .map(|i| GREYS[0] + (GREYS[1] - GREYS[0]) * f64::from(i) / f64::from(COUNT))
            .map(|grey| slope(&|g| formula.of(g), grey) / slope(&own, grey))
            // A sensor with bounds does not change at all beyond them.
            .filter(|ratio| ratio.is_finite())
            .collect();
        ratios.sort_by(f64::total_cmp);
        let at = |share: usize| ratios.get((ratios.len() - 1) * share / 100).copied().unwrap_or(f64::NAN);
        Self { median: at(50), p5: at(5), p95: at(95) }
    }

    /// Spread of the factor relative to its median.
    pub(super) fn spread(&self) -> f64 {
        (self.p95 - self.p5) / self.median
    }

    /// Returns true if one threshold serves all greys.
    pub(super) fn is_exact(&self) -> bool {
        self.spread() <= EXACT
    }
}

/// The thresholds of a sensor in a formula, ON and OFF.
pub(super) fn thresholds_in(sensor: &SensorChoice, formula: BrightnessFormula) -> [f64; 2] {
    let factor = BrightnessFactor::between(sensor, formula).median;
    let (on, off) = sensor.as_model().contrast();
    [on * factor, off * factor]
}

/// Brightness of an encoded grey from 0 to 1, as thresholds compare it.
pub(super) fn sensor_brightness(model: &dyn SensorModel, grey: f64) -> f64 {
    let front = model.front_end();
    // All three channels of a grey are equal, so the weights of the colours have no effect.
    let light = if front.decode == ChannelDecode::Srgb { srgb::decode(grey) } else { grey };
    let exposed = (WHITE * front.exposure * light).max(front.range.min);
    model.brightness(front.range.max.map_or(exposed, |max| exposed.min(max)))
}

/// The offset `o` of a sensor with brightness `ln(light + o)`, where the light of white is 1. For
/// other laws, the offset with the same ratio of brightness between black and white.
pub(super) fn log_offset(sensor: &SensorChoice) -> f64 {
    let [black, white] = [0.0, WHITE].map(|grey| libm::exp(sensor.as_model().brightness(grey)));
    black / (white - black)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_recipe::read_recipe_text;
    use std::path::Path;

    fn sensor(text: &str) -> SensorChoice {
        let recipe = format!(
            "version: 1\nscene: s\nsource: {{ procedural: {{ kind: still-life, gaussians: 100, views: 6, arc: 6, seed: 1 }} }}\n\
             camera: {{ width: 8, height: 8 }}\ntrajectories: [{{ name: base, refine: {{ window: 1, factor: 2 }} }}]\n\
             seed: 1\nsampling: {{ between: linear }}\nsensor: {text}\noutputs: [events]\n"
        );
        let recipe = read_recipe_text(recipe, Path::new("r.yaml")).unwrap_or_else(|e| panic!("{e}"));
        recipe.sensors_of("base").iter().next().unwrap().1.clone()
    }

    /// The figures were computed by another program, `domains.py` of the study of the consumers.
    #[test]
    fn factors_are_those_of_an_independent_table() {
        let esim = |decode: &str| {
            sensor(&format!(
                "{{ esim: {{ threshold: {{ on: 0.2, off: 0.2 }}, eps: 0.001, front_end: {{ decode: {decode} }} }} }}"
            ))
        };
        let gamma = BrightnessFormula::Gamma { offset: 1e-5 };
        let log = BrightnessFormula::Log { offset: 0.001 };
        let voltmeter = |decode: &str| {
            sensor(&format!("{{ voltmeter: {{ preset: dvs346, front_end: {{ decode: {decode} }} }} }}"))
        };
        let own = log_offset(&voltmeter("none"));
        assert!((own - 20.0 / 255.0).abs() < 1e-12, "k2 of the preset is 20: {own}");
        let cases = [
            (voltmeter("none"), BrightnessFormula::LinLog, [1.154, 1.08, 4.1]),
            (voltmeter("none"), BrightnessFormula::Log { offset: own }, [1.0, 1.0, 1.0]),
            (voltmeter("srgb"), BrightnessFormula::Gamma { offset: own }, [1.002, 0.81, 1.07]),
            (esim("none"), BrightnessFormula::LinLog, [1.002, 1.001, 1.18]),
            (esim("none"), log, [1.0, 1.0, 1.0]),
            (sensor("{ esim: { preset: trainable } }"), BrightnessFormula::LinLog, [1.002, 1.001, 1.18]),
            (sensor("{ esim: { preset: trainable } }"), log, [1.0, 1.0, 1.0]),
            (esim("none"), gamma, [2.204, 2.202, 2.22]),
            (esim("srgb"), BrightnessFormula::LinLog, [0.464, 0.44, 1.61]),
            (esim("srgb"), gamma, [1.02, 0.97, 1.92]),
        ];
        for (sensor, formula, wanted) in cases {
            let found = BrightnessFactor::between(&sensor, formula);
            // The table has three decimals in its medians. Its percentiles lie where the ratio grows by
            // up to 38 per unit of grey, so a grid of another thousand greys moves them by 0.04.
            let tolerances = [0.003, 0.04, 0.04];
            let numbers = [found.median, found.p5, found.p95].into_iter().zip(wanted);
            for ((found, wanted), tolerance) in numbers.zip(tolerances) {
                assert!(
                    (found - wanted).abs() <= tolerance * wanted.max(1.0),
                    "{formula:?}: {found}, {wanted}"
                );
            }
        }
    }
}
