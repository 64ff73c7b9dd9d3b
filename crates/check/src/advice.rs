//! Remedies for findings, one per check: the first thing to try.

use super::table::check_table;

macro_rules! advice_of {
    ($($name:ident ($($limits:tt)*) ($($subject:tt)*) $advice:literal;)+) => {
        /// Each check with its remedy.
        const ADVICE: &[(&str, &str)] = &[$((stringify!($name), $advice)),+];
    };
}

check_table!(advice_of);

/// Returns what to do about a finding of this check that is not a pass; empty for an unknown name.
#[must_use]
pub fn advice(check: &str) -> &'static str {
    ADVICE.iter().find(|(name, _)| *name == check).map_or("", |(_, advice)| advice)
}
