//! Parameter sets by name.
//!
//! The sets of the published program have constants in grey: their authors state no light. The
//! anchored sets have constants in lux, and follow the light on the sensor that a recipe states. What
//! anchors each number is in `docs/sensors.md`.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::SensorModel;
//! use gs2e_sensor::voltmeter::VoltmeterPreset;
//!
//! let preset = VoltmeterPreset::by_name("davis346").ok_or("there is no such preset")?;
//! // Half of its pixels make an ON event when the light grows by 14.3 %, and an OFF event when it falls by
//! // 22.5 %.
//! let (on, off) = preset.model().contrast();
//! assert!((on.exp() - 1.143).abs() < 1e-4 && ((-off).exp() - 0.775).abs() < 1e-4);
//! // Its constants are in lux, so they lead back to it at any light.
//! assert_eq!(VoltmeterPreset::with_constants_of(&preset.model_at(60.0)), Some(preset));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::units::{ConstantUnits, TimeUnit, WhiteBrightness};
use super::{InitialVoltage, VoltmeterModel};
use crate::SensorSettings;
use crate::front_end::{FrontEnd, WHITE_LUX};
use crate::noise::{
    FloorPoint, HotPixelNoise, NoiseFloor, PhotoreceptorNoise, ReceptorPoint, ReferenceRule, RefractoryPeriod,
};

/// A named parameter set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VoltmeterPreset {
    /// DAVIS346, as published with DVS-Voltmeter. Its constants make no OFF noise at any light.
    Dvs346,
    /// DAVIS240, as published with DVS-Voltmeter.
    Dvs240,
    /// The set printed in the GS2E paper, which gives no units, read as seconds and brightness
    /// 0..1. That is the only reading with plausible noise, and it is far too insensitive to the
    /// signal.
    Gs2eSi,
    /// Prophesee EVK4 (Sony IMX636) with factory biases, anchored in the measurement of Noise2Params
    /// (arXiv 2605.16317).
    Evk4,
    /// iniVation DAVIS346, anchored in its contrast sensitivity and in the noise rates of DND21; the
    /// default.
    Davis346,
    /// iniVation DVXplorer, with the contrast of its maker and the noise of a recording without a scene.
    Dvxplorer,
}

/// Rates of noise that a publication gives for a sensor at one light.
pub type NoiseAnchor = FloorPoint;

/// Noise of an EVK4 at eight lights: the saddle-point form of Noise2Params with its published
/// parameters (yagoiroot/Noise2Params, `configs/params_published.yaml`, MIT).
const EVK4_NOISE: [NoiseAnchor; 8] = [
    NoiseAnchor { lux: 0.15, on: 0.18, off: 0.31 },
    NoiseAnchor { lux: 0.5, on: 0.40, off: 0.48 },
    NoiseAnchor { lux: 1.0, on: 0.56, off: 0.59 },
    NoiseAnchor { lux: 2.0, on: 0.64, off: 0.67 },
    NoiseAnchor { lux: 5.0, on: 0.44, off: 0.55 },
    NoiseAnchor { lux: 10.0, on: 0.17, off: 0.31 },
    NoiseAnchor { lux: 15.0, on: 0.073, off: 0.17 },
    NoiseAnchor { lux: 25.0, on: 0.021, off: 0.075 },
];
/// Noise of the photoreceptor of an EVK4, lux, deviation and Hz. Up to 25 lux it makes the ON events of
/// [`EVK4_NOISE`] and as many OFF events; from 100 lux on, the events of a recording of a static room. All
/// pixels have the same amplitude: their thresholds make a few of them loud (`docs/sensors.md`).
const EVK4_RECEPTOR: [[f64; 3]; 9] = [
    [0.15, 0.0336, 30.0],
    [0.5, 0.0355, 30.0],
    [1.0, 0.0364, 30.0],
    [2.0, 0.0368, 30.0],
    [5.0, 0.0357, 30.0],
    [10.0, 0.0335, 30.0],
    [15.0, 0.0319, 30.0],
    [25.0, 0.0299, 30.0],
    [100.0, 0.030_67, 30.0],
];
/// The OFF events of [`EVK4_NOISE`] that no ON event goes with. The recording of a room has none.
const EVK4_FLOOR: [FloorPoint; 9] = [
    FloorPoint { lux: 0.15, on: 0.0, off: 0.13 },
    FloorPoint { lux: 0.5, on: 0.0, off: 0.08 },
    FloorPoint { lux: 1.0, on: 0.0, off: 0.03 },
    FloorPoint { lux: 2.0, on: 0.0, off: 0.03 },
    FloorPoint { lux: 5.0, on: 0.0, off: 0.11 },
    FloorPoint { lux: 10.0, on: 0.0, off: 0.14 },
    FloorPoint { lux: 15.0, on: 0.0, off: 0.097 },
    FloorPoint { lux: 25.0, on: 0.0, off: 0.054 },
    FloorPoint { lux: 100.0, on: 0.0, off: 0.0 },
];

/// Noise of a DAVIS in bright and in dim light: a leak of 0.2 Hz, and shot noise of 10 Hz with equal
/// shares of both polarities (Guo and Delbruck, DND21). The publication gives no lights.
const DAVIS346_NOISE: [NoiseAnchor; 2] =
    [NoiseAnchor { lux: 0.1, on: 5.0, off: 5.0 }, NoiseAnchor { lux: 250.0, on: 0.2, off: 0.0 }];
/// The shot noise of the DAVIS. Its fall between dim and bright light is chosen.
const DAVIS346_FLOOR: [FloorPoint; 5] = [
    FloorPoint { lux: 0.1, on: 5.0, off: 5.0 },
    FloorPoint { lux: 1.0, on: 2.5, off: 2.5 },
    FloorPoint { lux: 10.0, on: 0.25, off: 0.25 },
    FloorPoint { lux: 100.0, on: 0.01, off: 0.01 },
    FloorPoint { lux: 250.0, on: 0.002, off: 0.002 },
];
/// Contrast of light for which half of the pixels of a DAVIS346 make an ON and an OFF event, as
/// differences of natural logarithms: `ln 1.143` and `-ln(1 - 0.225)`.
const DAVIS346_CONTRAST: [f64; 2] = [0.133_656, 0.254_892];

/// Contrasts of a DVXplorer: 13 % for half of the pixels, `ln 1.13` and `-ln(1 - 0.13)`.
const DVXPLORER_CONTRAST: [f64; 2] = [0.122_218, 0.139_262];
/// Noise of a DVXplorer at an unknown light, without the hot pixels: that of a Poisson process.
const DVXPLORER_NOISE: [NoiseAnchor; 1] = [NoiseAnchor { lux: 250.0, on: 0.229, off: 0.198 }];
/// Its hot pixels: of those above 5 Hz, 49 % have more than 20 Hz, 15 % more than 100 Hz and 2.6 % more than
/// 500 Hz.
const DVXPLORER_HOT: HotPixelNoise = HotPixelNoise { share: 0.001_8, rate: 18.5, spread: 0.72 };

impl VoltmeterPreset {
    /// Every preset.
    pub const ALL: [Self; 6] =
        [Self::Davis346, Self::Evk4, Self::Dvxplorer, Self::Dvs346, Self::Dvs240, Self::Gs2eSi];
    /// The preset of a recipe that names none.
    pub const DEFAULT: Self = Self::Davis346;

    /// The preset of this name, as a recipe writes it. `dvs346`, the name in the published program, is
    /// `dvs346-paper`.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        if name == "dvs346" {
            return Some(Self::Dvs346);
        }
        Self::ALL.into_iter().find(|preset| preset.name() == name)
    }

    /// Its name in recipes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Dvs346 => "dvs346-paper",
            Self::Dvs240 => "dvs240",
            Self::Gs2eSi => "gs2e-si",
            Self::Evk4 => "evk4",
            Self::Davis346 => "davis346",
            Self::Dvxplorer => "dvxplorer",
        }
    }

    /// k1 to k6 in microseconds, and in grey where white is 250 lux.
    #[must_use]
    pub fn k(self) -> [f64; 6] {
        match self.k_in_lux() {
            Some(k) => lux_to_grey(k, WHITE_LUX),
            None => self.k_in_grey(),
        }
    }

    /// k1 to k6 of the sets without a statement of light, in official units.
    fn k_in_grey(self) -> [f64; 6] {
        match self {
            Self::Dvs240 => [4.42411, 23.0, 2e-4, 1e-7, 5e-8, 1e-5],
            Self::Gs2eSi => ConstantUnits { time: TimeUnit::S, brightness: WhiteBrightness::Unit }
                .to_official([0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5]),
            _ => [5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5],
        }
    }

    /// k1 to k6 of an anchored set, in microseconds and lux.
    fn k_in_lux(self) -> Option<[f64; 6]> {
        // k3: the variance of the voltage is 1 per second, times `lux / (lux + k2)^2`.
        match self {
            Self::Evk4 => Some([1.0 / 0.15, 1.0, 0.0, 0.0, 0.0, 0.0]),
            Self::Davis346 => Some([1.0 / DAVIS346_CONTRAST[0], 1.0, 1e-3, 1e-7, 4e-10, 0.0]),
            Self::Dvxplorer => Some([1.0 / DVXPLORER_CONTRAST[0], 1.0, 0.0, 0.0, 0.0, 0.0]),
            Self::Dvs346 | Self::Dvs240 | Self::Gs2eSi => None,
        }
    }

    /// The preset with the constants of a sensor, at the sensor's light.
    #[must_use]
    pub fn with_constants_of(sensor: &VoltmeterModel) -> Option<Self> {
        let lux = sensor.settings.front_end.white_lux();
        let equal = |preset: &Self| preset.model_at(lux).k.map(f64::to_bits) == sensor.k.map(f64::to_bits);
        Self::ALL.into_iter().find(equal)
    }

    /// Returns true if the set follows the light on the sensor.
    #[must_use]
    pub fn is_in_lux(self) -> bool {
        self.k_in_lux().is_some()
    }

    /// The sensor, where white is 250 lux.
    #[must_use]
    pub fn model(self) -> VoltmeterModel {
        self.model_at(WHITE_LUX)
    }

    /// The sensor, where white is `lux`. The sets of the published program do not depend on it.
    #[must_use]
    pub fn model_at(self, lux: f64) -> VoltmeterModel {
        let Some(k) = self.k_in_lux() else { return VoltmeterModel::new(self.k()) };
        let front_end = FrontEnd { lux: Some(lux), ..FrontEnd::default() };
        let settings = SensorSettings { front_end, ..SensorSettings::default() };
        let plain = VoltmeterModel { settings, ..VoltmeterModel::new(lux_to_grey(k, lux)) };
        let dead = |period_us| RefractoryPeriod { period_us, reference: ReferenceRule::Passing };
        match self {
            Self::Davis346 => VoltmeterModel {
                threshold_off: DAVIS346_CONTRAST[1] / DAVIS346_CONTRAST[0],
                // 2.1 % contrast.
                threshold_spread: 0.021 / DAVIS346_CONTRAST[0],
                floor: NoiseFloor(DAVIS346_FLOOR.to_vec()),
                ..plain
            },
            Self::Dvxplorer => VoltmeterModel {
                threshold_off: DVXPLORER_CONTRAST[1] / DVXPLORER_CONTRAST[0],
                // As that of the DAVIS: its maker's second contrast is too far for a normal spread.
                threshold_spread: 0.021 / DVXPLORER_CONTRAST[0],
                floor: NoiseFloor(DVXPLORER_NOISE.to_vec()),
                // The time of a scan, in which a pixel is read once.
                settings: SensorSettings { refractory: dead(195.0), hot_pixels: DVXPLORER_HOT, ..settings },
                ..plain
            },
            _ => {
                let point =
                    |[lux, deviation, cutoff_hz]: [f64; 3]| ReceptorPoint { lux, deviation, cutoff_hz };
                let points = EVK4_RECEPTOR.map(point).to_vec();
                VoltmeterModel {
                    threshold_spread: 0.00651 / 0.15,
                    floor: NoiseFloor(EVK4_FLOOR.to_vec()),
                    photoreceptor_noise: PhotoreceptorNoise { spread: 0.0, points },
                    // A reset at the first frame would make the noise of that moment the reference.
                    initial: InitialVoltage::Stationary,
                    settings: SensorSettings { refractory: dead(79.0), ..settings },
                    ..plain
                }
            }
        }
    }

    /// The published rates of noise that the set is anchored in.
    #[must_use]
    pub fn noise_anchors(self) -> &'static [NoiseAnchor] {
        match self {
            Self::Evk4 => &EVK4_NOISE,
            Self::Davis346 => &DAVIS346_NOISE,
            Self::Dvxplorer => &DVXPLORER_NOISE,
            Self::Dvs346 | Self::Dvs240 | Self::Gs2eSi => &[],
        }
    }
}

/// Constants in microseconds and grey, from constants in microseconds and lux.
fn lux_to_grey([k1, k2, k3, k4, k5, k6]: [f64; 6], white_lux: f64) -> [f64; 6] {
    // As between two scales of brightness in `units.rs`: greys per lux.
    let greys = crate::WHITE / white_lux;
    [k1, k2 * greys, k3 * greys.sqrt(), k4, k5 / greys, k6]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorParameters as _;

    #[test]
    fn names_lead_back() {
        for preset in VoltmeterPreset::ALL {
            assert_eq!(VoltmeterPreset::by_name(preset.name()), Some(preset));
        }
        assert_eq!(VoltmeterPreset::by_name("dvs346"), Some(VoltmeterPreset::Dvs346));
        assert_eq!(VoltmeterPreset::by_name("dvs128"), None);
    }

    #[test]
    fn the_printed_set_of_gs2e_in_official_units() {
        // The figures of an independent conversion, to the digits given.
        let wanted = [0.5, 0.255, 1.596872e-3, 1e-8, 3.921569e-10, 1e-8];
        for (found, wanted) in VoltmeterPreset::Gs2eSi.k().into_iter().zip(wanted) {
            assert!((found - wanted).abs() <= 5e-7 * wanted, "{found:e}, wanted {wanted:e}");
        }
    }

    #[test]
    fn the_same_light_has_the_same_noise_whatever_white_is() {
        for preset in [VoltmeterPreset::Evk4, VoltmeterPreset::Davis346] {
            for lux in [0.2, 3.0, 40.0] {
                let [bright, dim] = [250.0, 60.0].map(|white| {
                    let noise = preset.model_at(white).array_noise(255.0 * lux / white);
                    [noise.leak_hz, noise.total_hz, noise.on_share.unwrap()]
                });
                let alike = bright.iter().zip(dim).all(|(a, b)| (a - b).abs() <= 1e-9 * a.abs());
                assert!(alike, "{preset:?} at {lux} lux: {bright:?} and {dim:?}");
            }
        }
    }

    #[test]
    fn predicted_noise_lies_on_the_anchors() {
        for preset in [VoltmeterPreset::Evk4, VoltmeterPreset::Davis346] {
            for NoiseAnchor { lux, on, off } in preset.noise_anchors() {
                let noise = preset.model().array_noise(255.0 * lux / 250.0);
                let share = noise.on_share.unwrap();
                let found = [noise.total_hz * share, noise.total_hz * (1.0 - share)];
                println!("{preset:?} {lux} lux: {found:.4?}, anchor {on} {off}");
                // Absolute where the anchor is 0: the leak of a bright DAVIS has no OFF events.
                let near = |found: f64, wanted: f64| (found - wanted).abs() <= 0.1 * wanted + 5e-3;
                assert!(near(found[0], *on) && near(found[1], *off));
            }
        }
    }
}
