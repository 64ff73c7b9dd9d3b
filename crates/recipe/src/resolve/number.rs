//! Numbers and their ranges.

use super::Resolver;
use crate::field::{Field, NumberLiteral};
use crate::problem::{FieldProblem, bare_text};
use crate::text::TextSpan;
use gs2e_num::units::{Ratio, brief};
use std::fmt;

/// The accepted reals of a field.
#[derive(Debug, Clone, Copy)]
pub(super) struct RealRange {
    low: f64,
    high: f64,
    /// True if the lower end is excluded.
    open: bool,
}

impl RealRange {
    /// The closed range from `low` to `high`.
    pub(super) const fn new(low: f64, high: f64) -> Self {
        Self { low, high, open: false }
    }

    /// The range above `low` and at most `high`.
    pub(super) const fn above(low: f64, high: f64) -> Self {
        Self { low, high, open: true }
    }

    /// Returns true if the range contains a value.
    pub(super) fn holds(self, value: f64) -> bool {
        value <= self.high && if self.open { value > self.low } else { value >= self.low }
    }
}

impl fmt::Display for RealRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = [self.low, self.high].map(brief);
        if self.open {
            write!(f, "a number above {low} and at most {high}")
        } else {
            write!(f, "a number from {low} to {high}")
        }
    }
}

/// The accepted whole numbers of a field, both ends included.
#[derive(Debug, Clone, Copy)]
pub(super) struct WholeRange {
    low: u64,
    high: u64,
}

impl WholeRange {
    /// The closed range from `low` to `high`.
    pub(super) const fn new(low: u64, high: u64) -> Self {
        Self { low, high }
    }
}

impl Resolver<'_> {
    /// Resolves a real within its range.
    pub(super) fn real(&self, field: &Field<f64>, default: f64, range: RealRange) -> Option<f64> {
        let Some((value, place)) = field.given() else { return field.is_absent().then_some(default) };
        if range.holds(*value) { Some(*value) } else { self.out_of_range(&brief(*value), &range, place) }
    }

    /// Resolves a whole number within its range, whose upper end is below 2^32.
    pub(super) fn small(&self, field: &Field<u64>, default: u32, range: WholeRange) -> Option<u32> {
        let value = self.whole(field, default.into(), range)?;
        Some(u32::try_from(value).expect("the range ends below 2^32"))
    }

    /// Resolves a whole number within its range.
    pub(super) fn whole(&self, field: &Field<u64>, default: u64, range: WholeRange) -> Option<u64> {
        let Some((value, place)) = field.given() else { return field.is_absent().then_some(default) };
        if (range.low..=range.high).contains(value) {
            return Some(*value);
        }
        self.out_of_range(value, &format_args!("a whole number from {} to {}", range.low, range.high), place)
    }

    /// Resolves a positive rational within its range, exactly as written.
    pub(super) fn ratio(
        &self,
        field: &Field<NumberLiteral>,
        default: u64,
        range: RealRange,
    ) -> Option<Ratio> {
        let Some((NumberLiteral(text), place)) = field.given() else {
            let default = Ratio::new(default, 1).expect("defaults are positive");
            return field.is_absent().then_some(default);
        };
        match text.parse::<Ratio>() {
            Ok(ratio) if range.holds(ratio.to_f64()) => Some(ratio),
            Ok(_) => self.out_of_range(&bare_text(text), &range, place),
            // As a float the number is in range, so only its length is wrong.
            Err(_) if text.parse().is_ok_and(|value| range.holds(value)) => self.refuse(
                FieldProblem::of_field(format!("is {}, wanted at most 18 digits", bare_text(text))).at(place),
            ),
            Err(_) => {
                let wanted = format!("is {}, wanted {range}, such as 5, 1.1 or 11/10", bare_text(text));
                let number = text.trim_end_matches(|c: char| c.is_alphabetic() || c == ' ');
                let problem = FieldProblem::of_field(wanted).at(place);
                self.refuse(match number.parse::<Ratio>() {
                    Ok(_) => problem.help(format!("write the number without its unit: {number}")),
                    Err(_) => problem,
                })
            }
        }
    }

    fn out_of_range<T>(
        &self,
        found: &dyn fmt::Display,
        wanted: &dyn fmt::Display,
        place: TextSpan,
    ) -> Option<T> {
        self.refuse(FieldProblem::of_field(format!("is {found}, wanted {wanted}")).at(place))
    }
}
