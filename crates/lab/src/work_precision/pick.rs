//! The cheapest setting at a given error.

use super::SettingRow;
use serde::Serialize;

/// A measure of error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorMeasure {
    /// RMS of k1 V at interval middles, in thresholds.
    Rms,
    /// Difference of the numbers of events, relative to all events.
    Count,
    /// Absolute differences summed over pixels and polarities, relative to all events.
    Miscount,
    /// Median time between matched events, us.
    Median,
    /// The 99 % quantile of these times, us.
    P99,
    /// 1 - F1 of events within 100 us.
    F1,
}

impl ErrorMeasure {
    /// All measures.
    pub const ALL: [Self; 6] = [Self::Rms, Self::Count, Self::Miscount, Self::Median, Self::P99, Self::F1];

    /// The error of a row; `None` if there are too few events.
    #[must_use]
    pub fn of(self, row: &SettingRow) -> Option<f64> {
        let value = match self {
            Self::Rms => Some(row.rms_th),
            Self::Count => Some(row.errors.count),
            Self::Miscount => Some(row.errors.miscount),
            Self::Median => row.errors.median_us,
            Self::P99 => row.errors.p99_us,
            Self::F1 => Some(1.0 - row.errors.f1[1]),
        };
        value.filter(|value| value.is_finite())
    }

    /// Name with unit.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Rms => "RMS of k1 V at interval middles, thresholds",
            Self::Count => "events too many or too few, share of all",
            Self::Miscount => "events miscounted by pixel and polarity, share of all",
            Self::Median => "median time error, us",
            Self::P99 => "99 % of time errors, us",
            Self::F1 => "1 - F1 of events within 100 us",
        }
    }

    /// An error in this measure, as part of a sentence.
    #[must_use]
    pub fn says(self, error: &str) -> String {
        match self {
            Self::Rms => format!("RMS of {error} thresholds"),
            Self::Count => format!("share of {error} events too many or too few"),
            Self::Miscount => format!("share of {error} events miscounted by pixel and polarity"),
            Self::Median => format!("median time error of {error} us"),
            Self::P99 => format!("99 % of time errors within {error} us"),
            Self::F1 => format!("1 - F1 of {error} within 100 us"),
        }
    }

    /// Name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rms => "rms",
            Self::Count => "count",
            Self::Miscount => "miscount",
            Self::Median => "time_median",
            Self::P99 => "time_p99",
            Self::F1 => "f1",
        }
    }
}

/// A point on a curve of error over cost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CostPlace {
    /// Core seconds.
    pub core_s: f64,
    /// Frames.
    pub frames: f64,
    /// True if the curve is below the error already at its start: a cheaper setting might be
    /// sufficient.
    pub at_most: bool,
}

/// A method at the requested error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodOffer {
    /// Name of the rule set.
    pub rules: String,
    /// Rules, interpolation and steps.
    pub method: String,
    /// The point at which its curve reaches the error; `None` if it does not.
    pub place: Option<CostPlace>,
    /// Its lowest error.
    pub lowest: f64,
    /// Cost of its lowest error, core seconds.
    pub lowest_core_s: f64,
}

/// The cost of all methods at one error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodComparison {
    /// The measure.
    pub measure: ErrorMeasure,
    /// The error.
    pub error: f64,
    /// Core seconds of the reference setting, which has this error.
    pub base_core_s: f64,
    /// The methods, the cheapest first; those that do not reach the error come last.
    pub offers: Vec<MethodOffer>,
}

impl MethodComparison {
    /// Compares `rows` at the error of `base`; `None` if it has none.
    #[must_use]
    pub(crate) fn at_error(measure: ErrorMeasure, base: &SettingRow, rows: &[SettingRow]) -> Option<Self> {
        // An error of 0 cannot be reached by interpolation in logarithms.
        let error = measure.of(base).filter(|error| *error > 0.0)?;
        let mut names: Vec<[String; 2]> = Vec::new();
        for row in rows.iter().map(|row| [row.rules.clone(), row.method()]) {
            if !names.contains(&row) {
                names.push(row);
            }
        }
        let mut offers: Vec<MethodOffer> = Vec::new();
        for name in names {
            let of_method = rows.iter().filter(|row| row.method() == name[1]);
            let curve =
                of_method.filter_map(|row| Some(CostPoint::from_row(row, measure.of(row)?))).collect();
            offers.extend(best_offer(name, curve, error));
        }
        // A method that does not reach the error comes last.
        let cost = |offer: &MethodOffer| offer.place.map_or(f64::INFINITY, |place| place.core_s);
        offers.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
        Some(Self { measure, error, base_core_s: base.core_s(), offers })
    }

    /// The cheapest method at this error.
    #[must_use]
    pub fn cheapest(&self) -> Option<(&MethodOffer, CostPlace)> {
        self.offers.first().and_then(|offer| Some((offer, offer.place?)))
    }
}

/// Replaces an error of zero, which has no logarithm.
const MIN_ERROR: f64 = 1e-9;

#[derive(Debug, Clone, Copy)]
struct CostPoint {
    core_s: f64,
    frames: f64,
    error: f64,
}

impl CostPoint {
    fn from_row(row: &SettingRow, error: f64) -> Self {
        Self { core_s: row.core_s(), frames: row.frames as f64, error: error.max(MIN_ERROR) }
    }
}

fn best_offer([rules, method]: [String; 2], mut curve: Vec<CostPoint>, error: f64) -> Option<MethodOffer> {
    curve.sort_by(|a, b| a.frames.total_cmp(&b.frames));
    let lowest = curve.iter().min_by(|a, b| a.error.total_cmp(&b.error))?;
    let (lowest, lowest_core_s) = (lowest.error, lowest.core_s);
    Some(MethodOffer { rules, method, place: reaching_place(&curve, error), lowest, lowest_core_s })
}

/// The point from which on a curve has at most this error, linear in logarithms between its points.
/// A good point before worse ones is chance.
fn reaching_place(curve: &[CostPoint], error: f64) -> Option<CostPlace> {
    let at = curve.iter().rposition(|point| point.error > error).map_or(0, |worse| worse + 1);
    if at == curve.len() {
        return None;
    }
    let to = curve[at];
    // A curve that starts below the error has no point above it to interpolate from.
    let Some(from) = at.checked_sub(1).map(|before| curve[before]) else {
        return Some(CostPlace { core_s: to.core_s, frames: to.frames, at_most: true });
    };
    let share = libm::log(from.error / error) / libm::log(from.error / to.error);
    let along = |a: f64, b: f64| a * libm::pow(b / a, share);
    Some(CostPlace {
        core_s: along(from.core_s, to.core_s),
        frames: along(from.frames, to.frames),
        at_most: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Costs that rise with the frames, and errors that fall with a power of them down to a floor.
    fn curve(cost: f64, c: f64, p: f64, floor: f64) -> Vec<CostPoint> {
        let frames = [100.0, 200.0, 400.0, 800.0, 1600.0];
        frames
            .map(|frames| CostPoint {
                core_s: cost * frames,
                frames,
                error: c / libm::pow(frames, p) + floor,
            })
            .to_vec()
    }

    #[test]
    fn planted_curves_are_met_between_their_points() {
        // 1e4/n^2 is 0.04 at 500 frames, which lies on the straight line in logarithms.
        let place = reaching_place(&curve(0.5, 1e4, 2.0, 0.0), 0.04).unwrap();
        assert!((place.frames - 500.0).abs() < 1e-9 && (place.core_s - 250.0).abs() < 1e-9, "{place:?}");
        assert!(!place.at_most);
        let at_once = reaching_place(&curve(0.5, 1e4, 2.0, 0.0), 2.0).unwrap();
        assert!(at_once.at_most && (at_once.frames - 100.0).abs() < 1e-12);
        assert_eq!(reaching_place(&curve(0.5, 1e4, 2.0, 0.1), 0.1), None, "it stalls above");
        let mut lucky = curve(0.5, 1e4, 2.0, 0.0);
        lucky[0].error = 1e-3;
        assert_eq!(reaching_place(&lucky, 0.04), Some(place), "what is worse again later does not count");
    }

    #[test]
    fn an_offer_says_how_low_its_curve_goes() {
        let offer = best_offer(["soft", "soft hermite"].map(str::to_owned), curve(2.0, 1e4, 2.0, 0.01), 1e-3)
            .unwrap();
        assert_eq!(offer.place, None);
        assert!((offer.lowest - (1e4 / 1600.0 / 1600.0 + 0.01)).abs() < 1e-15);
        assert!((offer.lowest_core_s - 3200.0).abs() < 1e-9);
    }
}
