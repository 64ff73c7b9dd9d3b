//! The choice of steps that are made again, so that their bytes can be compared with a record.
//!
//! Two kinds of steps have bytes that this run did not make: those that are up to date in the own store, and
//! those that another machine made. A step of another machine that is drawn here is made instead of copied,
//! and the shared store compares the outputs. The draw depends on the key and on a seed that no other member
//! of the shared store knows beforehand, so a wrong record cannot avoid it.

use crate::stage::AnyStep;
use gs2e_store::{Digest, Key};

/// Share of the steps of other machines that are made again where the user names no share. `docs/cluster.md`
/// has its cost, and its chance to find wrong records.
const ADOPTED_SHARE: f64 = 0.01;

/// The steps that are made again although their outputs exist.
#[derive(Debug, Clone, Copy, Default)]
pub struct RecheckPolicy {
    /// Share of the steps, 0 to 1, as the user asked for it. `None`: no step that is up to date, and
    /// one percent of the steps of other machines.
    pub share: Option<f64>,
    /// Seed of the choice.
    pub seed: u64,
}

impl RecheckPolicy {
    /// Returns true if this step is chosen, which is up to date.
    pub(super) fn chooses(self, key: &Key) -> bool {
        self.draws(key, self.share.unwrap_or(0.0))
    }

    /// Returns true if this step is chosen, which another machine may have made.
    pub(super) fn chooses_adopted(self, key: &Key, step: &dyn AnyStep) -> bool {
        // A training may take hours, and one that `minutes` ended has other bytes each time. Versions of
        // other programs may differ in their bytes. Only the user decides to make these again.
        let is_default_product = !step.facts().is_training()
            && !step.facts().runs_known_programs()
            && step.facts().programs().is_empty();
        let share = self.share.unwrap_or(if is_default_product { ADOPTED_SHARE } else { 0.0 });
        self.draws(key, share)
    }

    fn draws(self, key: &Key, share: f64) -> bool {
        // Drawn from the key, so the choice does not depend on the order of the steps.
        let bytes = [&key.0.as_bytes()[..], &self.seed.to_le_bytes()].concat();
        let drawn = Digest::of_bytes(&bytes).as_bytes().first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
        // 2^64: a share of 1 is above every draw.
        (drawn as f64) < share * 18_446_744_073_709_551_616.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of keys that `policy` draws with this share.
    fn drawn(policy: RecheckPolicy, share: f64) -> u32 {
        let key = |n: u32| Key(Digest::of_bytes(&n.to_le_bytes()));
        (0..100_000).map(|n| u32::from(policy.draws(&key(n), share))).sum()
    }

    #[test]
    fn a_share_of_the_keys_is_drawn_and_another_one_by_another_seed() {
        let [one, other] = [1, 2].map(|seed| RecheckPolicy { share: None, seed });
        // Binomial, of 100,000 keys: the standard deviation of 1% is 31, and 5 of them are 157.
        for policy in [one, other] {
            assert!(drawn(policy, ADOPTED_SHARE).abs_diff(1000) < 157);
            assert_eq!((drawn(policy, 0.0), drawn(policy, 1.0)), (0, 100_000));
        }
        let both = |n: &u32| {
            let key = Key(Digest::of_bytes(&n.to_le_bytes()));
            one.draws(&key, ADOPTED_SHARE) && other.draws(&key, ADOPTED_SHARE)
        };
        // 10 are expected in both; Poisson exceeds 30 with a probability below 1e-7.
        assert!((0..100_000).filter(both).count() < 30);
    }

    #[test]
    fn without_a_wish_only_steps_of_others_are_made_again() {
        let key = |n: u32| Key(Digest::of_bytes(&n.to_le_bytes()));
        let usual = RecheckPolicy::default();
        assert!((0..10_000).all(|n| !usual.chooses(&key(n))));
        let all = RecheckPolicy { share: Some(1.0), seed: 1 };
        assert!((0..100).all(|n| all.chooses(&key(n))));
    }
}
