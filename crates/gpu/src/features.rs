//! Features that some devices have, and that can be left out.

use std::fmt;
use std::str::FromStr;

/// A feature that the renderer uses where a device has it. None of them changes a bit of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GpuFeature {
    /// Sums over threads that run in step, without workgroup memory.
    Subgroups,
    /// A clock that tells the time of each stage of a frame.
    Timestamps,
}

impl GpuFeature {
    /// All features.
    pub const ALL: [Self; 2] = [Self::Subgroups, Self::Timestamps];

    /// Name of the feature.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Subgroups => "subgroups",
            Self::Timestamps => "timestamps",
        }
    }
}

/// Several features.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FeatureSet([bool; GpuFeature::ALL.len()]);

impl FeatureSet {
    /// No feature.
    pub const NONE: Self = Self([false; GpuFeature::ALL.len()]);

    /// These features, and this one if `wanted`.
    #[must_use]
    pub fn with(mut self, feature: GpuFeature, wanted: bool) -> Self {
        self.0[feature as usize] |= wanted;
        self
    }

    /// These features without those of another set.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] && !other.0[k]))
    }

    /// Returns true if the feature is in the set.
    #[must_use]
    pub fn has(self, feature: GpuFeature) -> bool {
        self.0[feature as usize]
    }
}

impl fmt::Display for FeatureSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> =
            GpuFeature::ALL.into_iter().filter(|feature| self.has(*feature)).map(GpuFeature::name).collect();
        f.write_str(&names.join(","))
    }
}

impl FromStr for FeatureSet {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut set = Self::NONE;
        for name in text.split(',').map(str::trim) {
            let known = GpuFeature::ALL.into_iter().find(|feature| feature.name() == name);
            let feature = known.ok_or_else(|| {
                let names = GpuFeature::ALL.map(GpuFeature::name).join(", ");
                format!("found `{name}`, wanted one or more of {names}, separated by commas")
            })?;
            set = set.with(feature, true);
        }
        Ok(set)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_read_by_name_and_unknown_ones_refused() {
        let both: FeatureSet = "timestamps, subgroups".parse().unwrap();
        assert_eq!(both.to_string(), "subgroups,timestamps");
        let one: FeatureSet = "timestamps".parse().unwrap();
        assert_eq!(both.without(one).to_string(), "subgroups");
        assert_eq!(FeatureSet::NONE.to_string(), "");
        for text in ["f16", "", "subgroups,", "Subgroups"] {
            let error = text.parse::<FeatureSet>().unwrap_err();
            assert!(error.ends_with("wanted one or more of subgroups, timestamps, separated by commas"));
        }
        assert!("subgroups,f16".parse::<FeatureSet>().unwrap_err().starts_with("found `f16`"));
    }
}
