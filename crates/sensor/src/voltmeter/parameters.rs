//! The answers of DVS-Voltmeter to what is asked of any sensor.

use super::{BetweenFrames, SamplerKind, VoltmeterModel, bridge, drift, tree};
use crate::noise::{NoiseFloor, RefractoryPeriod};
use crate::parameters::{QuietCells, SensorFacts, SensorParameters, SensorSettings};
use crate::screening::{ConstantLightNoise, ScreenError, SensorScreening};
use crate::{SensorChoice, SimulationAccount};
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
        let Self { front_end, hot_pixels, allow_cap, labels, latency, readout, .. } = *self;
        SensorSettings { front_end, hot_pixels, allow_cap, labels, latency, readout }
    }

    fn with_settings(&self, settings: SensorSettings) -> SensorChoice {
        let SensorSettings { front_end, hot_pixels, allow_cap, labels, latency, readout } = settings;
        Self { front_end, hot_pixels, allow_cap, labels, latency, readout, ..self.clone() }.into()
    }

    fn between(&self) -> BetweenFrames {
        self.between
    }

    fn with_between(&self, between: BetweenFrames) -> SensorChoice {
        Self { between, ..self.clone() }.into()
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
        let floor = NoiseFloor::default();
        Self { k: [k1, k2, 0.0, 0.0, 0.0, 0.0], floor, ..self.clone() }.into()
    }

    fn without_idle(&self) -> SensorChoice {
        let mut own = self.clone();
        if own.refractory.period_us == 0.0 {
            own.refractory = RefractoryPeriod::default();
        }
        own.into()
    }

    fn dead_us(&self) -> i64 {
        self.refractory.whole_us()
    }

    fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        Self::screen(self, rate)
    }

    fn brightness(&self, grey: f64) -> f64 {
        libm::log(grey + self.k[1])
    }

    fn contrast_spread(&self) -> f64 {
        self.threshold_spread / self.k[0]
    }

    fn noise_at(&self, grey: f64) -> ConstantLightNoise {
        self.array_noise(grey)
    }

    fn released(&self) -> Value {
        let mut out = json!({
            "law": self.law, "gain": self.gain, "k": self.k, "units": { "time": "us", "brightness": 255 },
            "theta_on": self.threshold_on, "theta_off": self.threshold_off,
        });
        if self.threshold_spread > 0.0 {
            out["theta_spread"] = json!(self.threshold_spread);
        }
        if !self.hot_pixels.is_absent() {
            out["hot_pixels"] = json!(self.hot_pixels);
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
            "max_events_per_pixel_frame": self.max_events_per_pixel_frame,
        });
        // A preset in units of light has values of its own for these keys.
        let anchored = self.front_end.lux.is_some();
        if anchored || self.threshold_spread > 0.0 {
            out["threshold"]["spread"] = json!(self.threshold_spread);
        }
        if self.hot_pixels != Default::default() {
            out["hot_pixels"] = json!(self.hot_pixels);
        }
        if self.allow_cap {
            out["allow_cap"] = json!(true);
        }
        if anchored {
            out["floor"] = json!(self.floor);
            out["refractory"] = json!(self.refractory);
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
        if self.refractory.period_us > 0.0 {
            out["refractory"] = json!(self.refractory);
        }
        if !self.front_end.is_usual() {
            out["front_end"] = json!(self.front_end);
        }
        if self.labels {
            out["labels"] = json!(true);
        }
        if let Some(latency) = self.latency {
            out["latency"] = json!(latency);
        }
        if let Some(bus) = self.readout {
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
