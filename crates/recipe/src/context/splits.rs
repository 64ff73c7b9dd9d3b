//! `splits:` of `release.yaml`: assignment of scenes to training and test splits, by subject and
//! never by trajectory.
//!
//! The split of a group depends on its own key and the salt alone, so adding a scene moves no other
//! scene. `u` is the first 53 bits of SHA-256(salt, a NUL, key) as a fraction. The split is the
//! first, in the order of names, at which the cumulative share exceeds `u`. Shares are therefore
//! reached only in the long run.

use crate::field::Field;
use crate::names;
use crate::problem::{FieldProblem, quote_text};
use crate::resolve::Resolver;
use crate::text::TextSpan;
use gs2e_num::units::brief;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;

/// Assignment of scenes to splits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitPlan {
    /// The unit that stays together.
    pub by: SplitUnit,
    /// Share of each split; each is positive and the sum is 1.
    pub shares: BTreeMap<String, f64>,
    /// Salt of the hash. Another salt gives another assignment.
    pub salt: String,
}

/// The unit that stays together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplitUnit {
    /// Scenes of one capture.
    Capture,
    /// Scenes of one capture, and scenes whose recipes name the same `group`.
    Object,
}

/// Tolerance of the sum of shares, for the rounding of decimal fractions in binary.
const TOLERANCE: f64 = 1e-9;

impl SplitPlan {
    /// Returns the split of the group with this key.
    ///
    /// # Panics
    /// There is no split. [`SplitPlan`] that were read have at least one.
    #[must_use]
    pub fn of(&self, key: &str) -> &str {
        let mut hash = Sha256::new();
        hash.update(self.salt.as_bytes());
        // Without the NUL, another salt and another key could be the same bytes.
        hash.update([0]);
        hash.update(key.as_bytes());
        let first = hash.finalize().iter().take(8).fold(0_u64, |bits, byte| bits << 8 | u64::from(*byte));
        // 53 bits are exact in a double.
        let u = (first >> 11) as f64 / (1_u64 << 53) as f64;
        let mut below = 0.0;
        let reached = self.shares.iter().find(|(_, share)| {
            below += **share;
            u < below
        });
        // The cumulative share may end a little below 1 because of rounding.
        let (name, _) = reached.or_else(|| self.shares.iter().next_back()).expect("there is a split");
        name
    }

    /// Returns the reason why these splits are invalid, if there is one.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        if self.shares.is_empty() {
            return Some("there is no split".into());
        }
        // Negated, so that NaN is refused too.
        if let Some((name, share)) = self.shares.iter().find(|(_, share)| !(**share > 0.0 && **share <= 1.0))
        {
            return Some(format!("the share of {name} is {}, wanted above 0 and at most 1", brief(*share)));
        }
        let sum: f64 = self.shares.values().sum();
        ((sum - 1.0).abs() > TOLERANCE).then(|| format!("the shares sum to {}, wanted 1", brief(sum)))
    }
}

/// The section as written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct RawSplits {
    by: Field<SplitUnit>,
    shares: Field<BTreeMap<String, Field<f64>>>,
    salt: Field<String>,
}

const HELP: &str = "write splits: { by: object, shares: { train: 0.8, val: 0.1, test: 0.1 } }";

/// Resolves the section; `Some(None)` if it is absent.
pub(super) fn resolve_splits(field: &Field<RawSplits>, resolver: &Resolver<'_>) -> Option<Option<SplitPlan>> {
    let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
    let by = resolver.required(&raw.by, "by", place, HELP).map(|(by, _)| *by);
    let shares = resolver.required(&raw.shares, "shares", place, HELP);
    let shares = shares.and_then(|(raw, place)| shares_of(raw, place, resolver));
    let salt = raw.salt.or_default();
    let (shares, place) = shares?;
    let splits = SplitPlan { by: by?, shares, salt: salt? };
    match splits.fault() {
        None => Some(Some(splits)),
        Some(because) => resolver.refuse(FieldProblem::new(because).help(HELP).at(place)),
    }
}

fn shares_of(
    raw: &BTreeMap<String, Field<f64>>,
    place: TextSpan,
    resolver: &Resolver<'_>,
) -> Option<(BTreeMap<String, f64>, TextSpan)> {
    let share = |(name, share): (&String, &Field<f64>)| {
        let (share, place) = share.given()?;
        if let Err(because) = names::check_sensor(name) {
            return resolver.refuse(
                FieldProblem::new(format!("the split name is {}, {because}", quote_text(name))).at(place),
            );
        }
        Some((name.clone(), *share))
    };
    let shares: Option<BTreeMap<String, f64>> = raw.iter().map(share).collect();
    Some((shares?, place))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolve_splits(shares: &[(&str, f64)], salt: &str) -> SplitPlan {
        let shares = shares.iter().map(|(name, share)| ((*name).to_owned(), *share)).collect();
        SplitPlan { by: SplitUnit::Object, shares, salt: salt.into() }
    }

    #[test]
    fn a_group_lies_where_its_hash_says() {
        // By sha256sum of "\0a": 022a6979…, a fraction of 0.008; of "\0b" 0.343, "\0f" 0.959,
        // "s\0a" 0.301.
        let t = |salt, key, wanted| {
            assert_eq!(resolve_splits(&[("train", 0.8), ("val", 0.1), ("test", 0.1)], salt).of(key), wanted);
        };
        t("", "a", "test");
        t("", "b", "train");
        t("", "f", "val");
        t("s", "a", "train");
    }

    #[test]
    fn shares_are_reached_in_the_long_run_and_salts_deal_anew() {
        let [a, b] = ["", "again"].map(|salt| resolve_splits(&[("train", 0.7), ("test", 0.3)], salt));
        let keys: Vec<String> = (0..10_000).map(|i| format!("dl3dv/{i}")).collect();
        let tests = |splits: &SplitPlan| keys.iter().filter(|key| splits.of(key) == "test").count();
        // The standard deviation of the binomial distribution is 46; the bound is 4 of them.
        for splits in [&a, &b] {
            assert!((2_816..=3_184).contains(&tests(splits)), "{}", tests(splits));
        }
        assert!(keys.iter().any(|key| a.of(key) != b.of(key)));
    }

    #[test]
    fn shares_are_parts_of_one() {
        assert_eq!(resolve_splits(&[("train", 0.8), ("val", 0.1), ("test", 0.1)], "").fault(), None);
        assert_eq!(resolve_splits(&[("all", 1.0)], "").fault(), None);
        for shares in [&[][..], &[("a", 0.5), ("b", 0.4)], &[("a", 1.5), ("b", -0.5)], &[("a", f64::NAN)]] {
            assert!(resolve_splits(shares, "").fault().is_some(), "{shares:?}");
        }
    }
}
