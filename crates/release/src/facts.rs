//! Facts about a release for card and datasheet, counted and gathered once, so that the two cannot
//! differ.

mod counts;
mod words;

use super::held_back::HeldBackScene;
use super::markdown::plain_text;
use super::provenance::Provenance;
use super::published::PublishedScene;
use gs2e_check::Verdict;
use gs2e_recipe::{ReconstructMethod, ReleaseInfo};
use gs2e_source::licence::{ComposedTerms, HolderTerms, LedgerAsset, LicenceObligation, ledger};
use std::collections::{BTreeMap, BTreeSet};

/// A release, as described to people.
#[derive(Debug, Clone, Copy)]
pub struct ReleaseFacts<'a> {
    /// Its scenes, sorted by id.
    pub scenes: &'a [PublishedScene],
    /// The statements of `release.yaml`.
    pub info: &'a ReleaseInfo,
    /// Number of scenes left out because they are taken down.
    pub taken_down: usize,
    /// Scenes left out because a check failed.
    pub held_back: &'a [HeldBackScene],
    /// The terms of the whole release.
    pub licence: &'a ComposedTerms,
}

impl ReleaseFacts<'_> {
    /// Number of scenes of each kind of source.
    pub(super) fn sources(&self) -> BTreeMap<&'static str, usize> {
        tally_names(self.scenes.iter().map(|scene| scene.recipe.source.kind().name()))
    }

    /// Number of scenes in each split; empty if there are no splits.
    pub(super) fn splits(&self) -> BTreeMap<&str, usize> {
        // Splits without a scene are listed with 0.
        let named = self.info.splits.iter().flat_map(|splits| splits.shares.keys());
        let mut counts: BTreeMap<&str, usize> = named.map(|name| (name.as_str(), 0)).collect();
        for part in self.scenes.iter().filter_map(|scene| scene.file.split.as_ref()) {
            *counts.entry(&part.name).or_default() += 1;
        }
        counts
    }

    /// Number of photos that are named and hashed. They are not in the tree.
    pub(super) fn photos(&self) -> usize {
        self.scenes.iter().map(|scene| scene.file.images.len()).sum()
    }

    /// Number of verdicts of each kind over all checks.
    pub(super) fn verdicts(&self) -> BTreeMap<&'static str, usize> {
        let findings = self.scenes.iter().flat_map(PublishedScene::all_findings);
        tally_names(findings.map(|finding| finding.verdict.name()))
    }

    pub(super) fn passed(&self) -> usize {
        self.verdicts().get(Verdict::Pass.name()).copied().unwrap_or_default()
    }

    /// All obligations of receivers.
    pub(super) fn obligations(&self) -> BTreeSet<LicenceObligation> {
        self.parts().flat_map(|part| part.obligations.iter().copied()).collect()
    }

    /// The making of the data.
    pub(super) fn provenance(&self) -> Provenance {
        Provenance::of(self.scenes.iter().map(|scene| &scene.file))
    }

    fn parts(&self) -> impl Iterator<Item = &HolderTerms> {
        self.scenes.iter().flat_map(|scene| &scene.licence.parts)
    }

    /// Names for attribution, without repeats.
    pub(super) fn attributions(&self) -> BTreeSet<&str> {
        self.parts().map(|part| part.attribution.as_str()).filter(|name| !name.is_empty()).collect()
    }

    /// The datasets of the scenes, and the programs that are related to their making, in the order
    /// of the ledger.
    pub(super) fn assets(&self) -> Vec<&'static LedgerAsset> {
        let datasets = self.parts().filter_map(|part| part.asset).map(|asset| asset.name);
        let mut names: BTreeSet<&str> = datasets.collect();
        if self.trained_elsewhere() {
            // A scene file does not name its trainer, so the official program, which has terms of its own, is
            // listed.
            names.insert("3D Gaussian Splatting");
        }
        names.extend(self.provenance().models().map(|(name, _)| name));
        ledger::LEDGER.iter().filter(|asset| names.contains(asset.name)).collect()
    }

    /// Known facts about the programs that trained the scenes; `None` if no scene was trained.
    pub(super) fn trained(&self) -> Option<String> {
        let mut how = BTreeSet::new();
        for scene in self.scenes {
            match &scene.recipe.reconstruct {
                Some(ReconstructMethod::Command(command)) => {
                    how.insert(format!("{} {} ({})", command.name(), command.version, command.licence));
                }
                Some(ReconstructMethod::Builtin(_)) => {
                    how.insert(format!("gs2e {}", env!("CARGO_PKG_VERSION")));
                }
                Some(
                    ReconstructMethod::Given(_)
                    | ReconstructMethod::Changing(..)
                    | ReconstructMethod::Newest(_),
                ) => {
                    how.insert("a program that the scene files do not name".to_owned());
                }
                None => {}
            }
        }
        let how: Vec<String> = how.iter().map(|text| plain_text(text)).collect();
        (!how.is_empty()).then(|| how.join("; "))
    }

    /// Returns true if another program trained a scene, so that it may be the official one.
    pub(super) fn trained_elsewhere(&self) -> bool {
        let mut ways = self.scenes.iter().filter_map(|scene| scene.recipe.reconstruct.as_ref());
        ways.any(|way| !matches!(way, ReconstructMethod::Builtin(_)))
    }

    /// Returns true if every scene is procedural.
    pub(super) fn made_up(&self) -> bool {
        self.scenes.iter().all(|scene| scene.recipe.source.kind().is_made_up())
    }

    /// The days on which captures were downloaded, of the scenes that state it.
    pub(super) fn accessed(&self) -> impl Iterator<Item = &str> {
        self.scenes.iter().filter_map(|scene| scene.file.source.accessed.as_deref())
    }

    /// Returns true if a trajectory has several sensors.
    pub(super) fn has_several_sensors(&self) -> bool {
        let mut parts = self.scenes.iter().flat_map(|scene| &scene.file.trajectories);
        parts.any(|part| !part.sensors.is_empty())
    }

    /// Grants of upstreams that differ from their public terms, one sentence each.
    pub(super) fn grants(&self) -> Vec<String> {
        let granted = self.scenes.iter().flat_map(|scene| {
            let grants =
                scene.licence.parts.iter().filter_map(|part| Some((part.asset?, part.grant.as_ref()?)));
            grants.map(move |(asset, grant)| {
                format!(
                    "{}: for {}, `{}` was granted by {} on {}; evidence: <{}>",
                    scene.recipe.scene,
                    asset.name,
                    grant.expression,
                    plain_text(&grant.granted_by),
                    grant.date,
                    // Nothing is escaped between angle brackets. The form of addresses excludes
                    // markup.
                    grant.url
                )
            })
        });
        granted.collect()
    }
}

fn tally_names<'t>(names: impl Iterator<Item = &'t str>) -> BTreeMap<&'t str, usize> {
    names.fold(BTreeMap::new(), |mut counts, name| {
        *counts.entry(name).or_default() += 1;
        counts
    })
}
