//! Named parameter sets, as in the program's `--dvs_params`.

use super::{FilterSteps, LeakNoise, V2eModel};
use crate::SensorSettings;
use crate::noise::{ReferenceRule, RefractoryPeriod, ThresholdMismatch};

/// Ranges of the preset `randomised`: those of the randomised simulator of Prophesee's OpenEB
/// (commit 0499c95, `metavision_core_ml/event_to_video/gpu_esim.py`, `randomize_noises`).
///
/// Thresholds of 0.05 to 0.2 with a deviation of 1e-4 to 1e-2 and a refractory period of 10 to 200
/// us are uniform there too. The source switches the other three parameters: each is on in a tenth
/// of the clips, with a cutoff of 70 Hz, a leak of 0.1 Hz and shot noise of 10 Hz, and off in the
/// others, with a cutoff of 1e6 Hz and rates of 0. Here they are ranges with these ends.
pub(super) const RANGES: &str = "\
threshold:
  on: { uniform: [0.05, 0.2] }
  off: { uniform: [0.05, 0.2] }
  spread: { uniform: [1.0e-4, 1.0e-2] }
cutoff: { log_uniform: [70, 1.0e+6] }
leak: { rate: { uniform: [0, 0.1] } }
shot: { uniform: [0, 10] }
refractory: { period_us: { uniform: [10, 200] } }
";

/// A named parameter set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum V2ePreset {
    /// Only a threshold spread of 0.02; the default.
    Clean,
    /// A threshold spread of 0.05, a cutoff of 30 Hz, shot noise of 5 Hz, and a leak of 0.1 Hz that
    /// varies by a tenth over time and by a tenth of a decade over pixels. (Some versions of the
    /// program add a refractory period of 10 ms.)
    Noisy,
}

impl V2ePreset {
    /// All presets.
    pub const ALL: [Self; 2] = [Self::Clean, Self::Noisy];

    /// The preset with this name, as written in a recipe.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.name() == name)
    }

    /// The name of the preset in recipes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Clean => "clean",
            Self::Noisy => "noisy",
        }
    }
}

impl From<V2ePreset> for V2eModel {
    /// The parameters of the preset, with thresholds of 0.2, no dead time, no hot pixels and a cap
    /// of 1000.
    fn from(preset: V2ePreset) -> Self {
        let refractory = RefractoryPeriod { reference: ReferenceRule::AtEvent, ..Default::default() };
        let clean = Self {
            threshold: ThresholdMismatch { on: 0.2, off: 0.2, spread: 0.02 },
            cutoff: 0.0,
            filter: FilterSteps::Exact,
            leak: LeakNoise::default(),
            shot: 0.0,
            settings: SensorSettings { refractory, ..SensorSettings::default() },
        };
        match preset {
            V2ePreset::Clean => clean,
            V2ePreset::Noisy => Self {
                threshold: ThresholdMismatch { spread: 0.05, ..clean.threshold },
                cutoff: 30.0,
                leak: LeakNoise { rate: 0.1, jitter: 0.1, cov: 0.1 },
                shot: 5.0,
                ..clean
            },
        }
    }
}
