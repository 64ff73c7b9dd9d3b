//! Parameter sets by name.

use super::units::{ConstantUnits, TimeUnit, WhiteBrightness};

/// A named parameter set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VoltmeterPreset {
    /// DAVIS346, as published with DVS-Voltmeter; the default.
    Dvs346,
    /// DAVIS240, as published with DVS-Voltmeter.
    Dvs240,
    /// The set printed in the GS2E paper, which gives no units, read as seconds and brightness
    /// 0..1. That is the only reading with plausible noise, and it is far too insensitive to the
    /// signal.
    Gs2eSi,
}

impl VoltmeterPreset {
    /// Every preset.
    pub const ALL: [Self; 3] = [Self::Dvs346, Self::Dvs240, Self::Gs2eSi];

    /// The preset of this name, as a recipe writes it.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.name() == name)
    }

    /// Its name in recipes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Dvs346 => "dvs346",
            Self::Dvs240 => "dvs240",
            Self::Gs2eSi => "gs2e-si",
        }
    }

    /// k1 to k6 in official units.
    #[must_use]
    pub fn k(self) -> [f64; 6] {
        match self {
            Self::Dvs346 => [5.265, 20.0, 1e-4, 1e-7, 5e-9, 1e-5],
            Self::Dvs240 => [4.42411, 23.0, 2e-4, 1e-7, 5e-8, 1e-5],
            Self::Gs2eSi => ConstantUnits { time: TimeUnit::S, brightness: WhiteBrightness::Unit }
                .to_official([0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back() {
        for preset in VoltmeterPreset::ALL {
            assert_eq!(VoltmeterPreset::by_name(preset.name()), Some(preset));
        }
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
}
