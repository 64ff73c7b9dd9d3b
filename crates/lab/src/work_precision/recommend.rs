//! The setting that a study recommends, as lines of a recipe.
//!
//! Only settings that were measured are recommended: a point between two measured ones has an
//! estimated cost and no events of its own.

use super::grid::StepRule;
use super::report::short_number;
use super::{SettingRow, StudyResult};
use gs2e_sensor::voltmeter::BetweenFrames;
use serde::Serialize;

/// A measured setting, and the reason for it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecommendedSetting {
    /// Lines of a recipe. They replace its `sampling` and its `render`.
    pub recipe: String,
    /// One sentence.
    pub because: String,
}

impl RecommendedSetting {
    /// The cheapest setting whose RMS, miscounts and median time error are at most those of
    /// [`StudyResult::base`]; `None` without rows. A sensor that takes only linear interpolation has
    /// `linear_only`.
    #[must_use]
    pub fn from_study(study: &StudyResult, linear_only: bool) -> Option<Self> {
        let base = study.base()?;
        let allowed = |row: &&SettingRow| {
            !linear_only || (row.between == BetweenFrames::Linear && !needs_tolerance(row))
        };
        let good = study.rows.iter().filter(allowed).filter(|row| is_as_good(row, base));
        let best = good.min_by(|a, b| a.core_s().total_cmp(&b.core_s()))?;
        Some(Self { recipe: recipe_lines(best), because: reason(best, base) })
    }
}

/// True if no error of `row` that a recipe would be judged by exceeds that of `base`.
fn is_as_good(row: &SettingRow, base: &SettingRow) -> bool {
    // Streams without matched events have no time error; they are equal if their counts are.
    let median = |row: &SettingRow| row.errors.median_us.unwrap_or(0.0);
    row.rms_th <= base.rms_th && row.errors.miscount <= base.errors.miscount && median(row) <= median(base)
}

/// Flow steps are what a recipe gets with a tolerance.
fn needs_tolerance(row: &SettingRow) -> bool {
    row.steps == StepRule::Flow
}

fn recipe_lines(row: &SettingRow) -> String {
    let between = row.between.name();
    let sampling = if needs_tolerance(row) {
        // A build aims below its tolerance, so the measured error itself can be asked for.
        format!("sampling: {{ tolerance: {}, between: {between} }}", rounded_up(row.rms_th))
    } else {
        format!("sampling: {{ rate: {}, between: {between} }}", row.rate)
    };
    let rules = match row.rules.as_str() {
        "blended" => "soft, order: blended",
        rules => rules,
    };
    format!("{sampling}\nrender: {{ rules: {rules} }}")
}

/// Two significant digits, rounded up, within the range of the key.
fn rounded_up(error: f64) -> f64 {
    let unit = libm::pow(10.0, libm::floor(libm::log10(error.max(1e-9))) - 1.0);
    // The quotient may exceed a whole number by rounding.
    let steps = libm::ceil(error / unit - 1e-9);
    // Two digits again: the product of the two may not be the nearest number to its decimals.
    format!("{:.1e}", (steps * unit).min(1.0)).parse().unwrap_or(1.0)
}

fn reason(row: &SettingRow, base: &SettingRow) -> String {
    let named = |row: &SettingRow| format!("`{}` at {} frames a second", row.method(), row.rate);
    let cost = short_number(row.core_s());
    if std::ptr::eq(row, base) {
        return format!(
            "no other measured setting has at most the errors of {} for fewer than its {cost} core-seconds",
            named(base)
        );
    }
    format!(
        "{} has an RMS of {} thresholds and {:.2} % miscounted events, at most those of {}, for {cost} core-seconds in \
         place of {}",
        named(row),
        short_number(row.rms_th),
        100.0 * row.errors.miscount,
        named(base),
        short_number(base.core_s())
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tolerance_is_not_below_the_error() {
        let t =
            |error: f64, wanted: f64| assert_eq!(rounded_up(error).to_bits(), wanted.to_bits(), "{error}");
        t(0.00765, 0.0077);
        t(0.0100, 0.01);
        t(0.0999, 0.1);
        t(0.031, 0.031);
        t(3.0, 1.0);
        t(0.995, 1.0);
    }
}
