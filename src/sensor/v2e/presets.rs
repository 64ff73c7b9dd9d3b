//! Named parameter sets, as in the program's `--dvs_params`.

use super::{Filter, Leak, V2e};
use crate::sensor::front_end::FrontEnd;
use crate::sensor::noise::{HotPixels, Reference, Refractory, Threshold};

/// A named parameter set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Only a threshold spread of 0.02; the default.
    Clean,
    /// A threshold spread of 0.05, a cutoff of 30 Hz, shot noise of 5 Hz, and a leak of 0.1 Hz that
    /// varies by a tenth over time and by a tenth of a decade over pixels. (Some versions of the
    /// program add a refractory period of 10 ms.)
    Noisy,
}

impl Preset {
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

impl From<Preset> for V2e {
    /// The parameters of the preset, with thresholds of 0.2, no dead time, no hot pixels and a cap
    /// of 1000.
    fn from(preset: Preset) -> Self {
        let clean = Self {
            threshold: Threshold { on: 0.2, off: 0.2, spread: 0.02 },
            cutoff: 0.0,
            filter: Filter::Exact,
            leak: Leak::default(),
            shot: 0.0,
            refractory: Refractory { period_us: 0.0, reference: Reference::AtEvent },
            hot_pixels: HotPixels::default(),
            max_events_per_pixel_frame: 1000,
            allow_cap: false,
            front_end: FrontEnd::default(),
            labels: false,
        };
        match preset {
            Preset::Clean => clean,
            Preset::Noisy => Self {
                threshold: Threshold { spread: 0.05, ..clean.threshold },
                cutoff: 30.0,
                leak: Leak { rate: 0.1, jitter: 0.1, cov: 0.1 },
                shot: 5.0,
                ..clean
            },
        }
    }
}
