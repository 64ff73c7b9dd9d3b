//! The answers of DVS-Voltmeter to what is asked of any sensor.

use super::{
    BetweenFrames, DriftGain, SamplerKind, VoltmeterModel, VoltmeterPreset, bridge, drift, thresholds, tree,
};
use crate::bandwidth::PixelBandwidth;
use crate::noise::{NoiseFloor, PhotoreceptorNoise, RefractoryPeriod};
use crate::parameters::{QuietCells, SensorFacts, SensorParameters, SensorSettings};
use crate::screening::{ConstantLightNoise, ScreenError, ScreeningWarning, SensorScreening, array_mean};
use crate::{SensorChoice, SensorModel, SimulationAccount, WHITE};
use gs2e_image::Size;
use gs2e_num::units::Hertz;
use serde_json::{Value, json};

pub(crate) static FACTS: SensorFacts = SensorFacts {
    name: "voltmeter",
    title: "DVS-Voltmeter",
    publication: "Lin et al., ECCV 2022",
    ranges: None,
};

impl From<VoltmeterModel> for SensorChoice {
    fn from(model: VoltmeterModel) -> Self {
        Self::Voltmeter(model)
    }
}

impl SensorParameters for VoltmeterModel {
    fn facts(&self) -> &'static SensorFacts {
        &FACTS
    }

    fn settings(&self) -> SensorSettings {
        self.settings
    }

    fn between(&self) -> BetweenFrames {
        self.between
    }

    fn with_contrast(&self, on: f64, off: f64) -> SensorChoice {
        // The voltage moves by k1 for a change of 1 in the logarithm.
        let [k1, ..] = self.k;
        Self { threshold_on: on * k1, threshold_off: off * k1, ..self.clone() }.into()
    }

    fn without_noise(&self) -> SensorChoice {
        let [k1, k2, ..] = self.k;
        // `k3` and `k6` are the noise, `k4` and `k5` the leak, which makes events without
        // brightness.
        let (floor, photoreceptor_noise) = (NoiseFloor::default(), PhotoreceptorNoise::default());
        Self { k: [k1, k2, 0.0, 0.0, 0.0, 0.0], floor, photoreceptor_noise, ..self.clone() }.into()
    }

    fn without_idle(&self) -> SensorChoice {
        let mut own = self.clone();
        if own.settings.refractory.period_us == 0.0 {
            own.settings.refractory = RefractoryPeriod::default();
        }
        if own.bandwidth.is_absent() {
            own.bandwidth = PixelBandwidth::default();
        }
        own.into()
    }

    fn validate(&self) -> Result<(), ScreenError> {
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
        if self.gain == DriftGain::Midpoint && self.between != BetweenFrames::Linear {
            return Err(ScreenError::Combination("`gain: midpoint` requires `between: linear`"));
        }
        self.validate_options()
    }

    fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        let contrast = <[f64; 2]>::from(self.contrast());
        let mut screening = SensorScreening::new("ln(L + k2)", contrast, rate, self)?;
        // Compared as bits: a set that differs in the last digit is no longer the printed one.
        let as_printed =
            self.k.iter().zip(VoltmeterPreset::Gs2eSi.k()).all(|(a, b)| a.to_bits() == b.to_bits());
        screening.warnings.extend(as_printed.then_some(ScreeningWarning::UncertainUnits));
        Ok(screening)
    }

    fn brightness(&self, grey: f64) -> f64 {
        libm::log(grey + self.k[1])
    }

    fn contrast_spread(&self) -> f64 {
        self.threshold_spread / self.k[0]
    }

    fn settling_seconds(&self, grey: f64) -> f64 {
        self.bandwidth.delay_seconds(self.settings.front_end.white_lux() * grey / WHITE)
    }

    /// The dead time is left out: it hides less than one event in a thousand of noise below 10 Hz.
    fn array_noise(&self, grey: f64) -> ConstantLightNoise {
        let sides = [self.threshold_on, self.threshold_off];
        let least = sides.map(|threshold| thresholds::FLOOR * threshold);
        let of_law = array_mean(sides, self.threshold_spread, least, |sides| self.noise_of(sides, grey));
        let [on, off] = self.floor.rates_at_grey(grey, self.settings.front_end.white_lux());
        let [receptor_on, receptor_off] = self.receptor_hz(grey);
        of_law.plus([on + self.settings.hot_pixels.mean_hz() + receptor_on, off + receptor_off])
    }

    fn released(&self) -> Value {
        let mut out = json!({
            "law": self.law, "gain": self.gain, "k": self.k, "units": { "time": "us", "brightness": 255 },
            "theta_on": self.threshold_on, "theta_off": self.threshold_off,
        });
        if self.threshold_spread > 0.0 {
            out["theta_spread"] = json!(self.threshold_spread);
        }
        if !self.settings.hot_pixels.is_absent() {
            out["hot_pixels"] = json!(self.settings.hot_pixels);
        }
        self.add_options(&mut out);
        out
    }

    fn written(&self) -> Value {
        let mut out = json!({
            "threshold": { "on": self.threshold_on, "off": self.threshold_off },
            "law": self.law,
            "gain": self.gain,
            "initial": self.initial,
            "max_events_per_pixel_frame": self.settings.max_events_per_pixel_frame,
        });
        // A preset in units of light has values of its own for these keys.
        let anchored = self.settings.front_end.lux.is_some();
        if anchored || self.threshold_spread > 0.0 {
            out["threshold"]["spread"] = json!(self.threshold_spread);
        }
        let preset = VoltmeterPreset::with_constants_of(self).map(VoltmeterPreset::model);
        let preset_has = |has: fn(&VoltmeterModel) -> bool| preset.as_ref().is_some_and(has);
        if self.settings.hot_pixels != Default::default()
            || preset_has(|preset| !preset.settings.hot_pixels.is_absent())
        {
            out["hot_pixels"] = json!(self.settings.hot_pixels);
        }
        if self.settings.allow_cap {
            out["allow_cap"] = json!(true);
        }
        if anchored {
            out["floor"] = json!(self.floor);
            out["refractory"] = json!(self.settings.refractory);
            if preset_has(|preset| !preset.photoreceptor_noise.is_absent()) {
                out["photoreceptor_noise"] = json!(self.photoreceptor_noise);
            }
        }
        self.add_options(&mut out);
        out
    }

    fn takes_tolerance(&self) -> bool {
        self.law == SamplerKind::Exact
    }

    /// Cells are as long as the longest leaf. The first number is a lower bound: where leaves are
    /// shorter, more than one is counted per cell.
    fn quiet_cells(&self, account: &SimulationAccount, size: Size, span_us: i64) -> Option<QuietCells> {
        let cells = u64::try_from(span_us).ok()? * 1000 / u64::from(tree::LEAF);
        let all = cells * size.pixels() as u64;
        let has_clock = self.law == SamplerKind::Exact && !drift::DriftProcess::new(self).is_noiseless();
        let quiet = all.saturating_sub(account.leaves);
        has_clock.then_some(QuietCells { quiet, all, missed_ln: bridge::NEGLIGIBLE })
    }
}

impl VoltmeterModel {
    /// Adds the options that recipe and `scene.json` write in one way, if they are in use.
    fn add_options(&self, out: &mut Value) {
        if !self.floor.is_absent() {
            out["floor"] = json!(self.floor);
        }
        if !self.photoreceptor_noise.is_absent() {
            out["photoreceptor_noise"] = json!(self.photoreceptor_noise);
        }
        if !self.bandwidth.is_absent() {
            out["bandwidth"] = json!(self.bandwidth);
        }
        if self.settings.refractory.period_us > 0.0 {
            out["refractory"] = json!(self.settings.refractory);
        }
        if !self.settings.front_end.is_default() {
            out["front_end"] = json!(self.settings.front_end);
        }
        if self.settings.labels {
            out["labels"] = json!(true);
        }
        if let Some(latency) = self.settings.latency {
            out["latency"] = json!(latency);
        }
        if let Some(bus) = self.settings.readout {
            out["readout"] = json!(bus);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voltmeter::VoltmeterPreset;

    /// 6 pixels for 1000 times the longest leaf of 8.192 us.
    #[test]
    fn cells_that_were_not_looked_into_are_what_the_leaves_leave_of_all() {
        let size = Size { width: 3, height: 2 };
        let account = SimulationAccount { leaves: 100, ..SimulationAccount::default() };
        let counted = |sensor: &VoltmeterModel| sensor.quiet_cells(&account, size, 8192);
        let noisy = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
        assert_eq!(counted(&noisy).map(|cells| (cells.quiet, cells.all)), Some((5900, 6000)));
        let official = VoltmeterModel { law: SamplerKind::Official, ..noisy };
        assert_eq!(counted(&official), None);
        let quiet = VoltmeterModel::new([1.0, 2.0, 0.0, 4.0, 5.0, 0.0]);
        assert_eq!(counted(&quiet), None);
    }
}
