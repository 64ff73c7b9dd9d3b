//! Facts about a release for card and datasheet, counted and gathered once, so that the two cannot
//! differ.

use super::provenance::Provenance;
use super::published::PublishedScene;
use super::scene::{TrajectoryPart, TrajectoryStatistics};
use crate::check::Verdict;
use crate::escape;
use crate::licence::{ComposedTerms, HolderTerms, LedgerAsset, LicenceObligation, ledger};
use crate::recipe::{ReconstructMethod, ReleaseInfo, SceneSource};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// The streams of a trajectory, by their statistics.
fn streams(part: &TrajectoryPart) -> impl Iterator<Item = &TrajectoryStatistics> {
    let one = part.sensor.iter().map(|_| &part.statistics);
    one.chain(part.sensors.values().map(|sensor| &sensor.statistics))
}

/// A release, as described to people.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReleaseFacts<'a> {
    pub(super) scenes: &'a [PublishedScene],
    pub(super) info: &'a ReleaseInfo,
    /// Number of scenes left out because they are taken down.
    pub(super) taken_down: usize,
    /// The terms of the whole release.
    pub(super) licence: &'a ComposedTerms,
}

/// Contents of the tree by number. Withheld files do not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FileCounts {
    pub(super) scenes: usize,
    pub(super) trajectories: usize,
    pub(super) poses: usize,
    pub(super) streams: usize,
    pub(super) events: u64,
    /// Sharp frames.
    pub(super) frames: usize,
    /// Blurred frames.
    pub(super) blurred: usize,
    /// Images of depth and of flow.
    pub(super) geometry: [usize; 2],
    /// Scenes without any file that shows them, because the upstream forbids redistribution.
    pub(super) withheld: usize,
}

impl ReleaseFacts<'_> {
    pub(super) fn counts(&self) -> FileCounts {
        let shown = || self.scenes.iter().filter(|scene| !scene.is_withheld());
        let streams = || shown().flat_map(|scene| &scene.file.trajectories).flat_map(streams);
        // Of withheld scenes too: their poses are released, unlike their events and pictures.
        let paths = || self.scenes.iter().flat_map(|scene| &scene.file.trajectories);
        let pictures = |kind: &str| -> usize {
            let of = |scene: &PublishedScene| -> usize {
                let paths = scene.file.trajectories.iter();
                paths.map(|part| scene.in_folder(&part.name, kind).count()).sum()
            };
            shown().map(of).sum()
        };
        FileCounts {
            scenes: self.scenes.len(),
            trajectories: paths().count(),
            poses: paths().map(|part| part.poses).sum(),
            streams: streams().count(),
            events: streams().filter_map(|counted| counted.events).sum(),
            frames: pictures("sharp"),
            blurred: pictures("blur"),
            geometry: [pictures("depth"), pictures("flow")],
            withheld: self.scenes.len() - shown().count(),
        }
    }

    /// Number of scenes of each kind of source.
    pub(super) fn sources(&self) -> BTreeMap<&'static str, usize> {
        tally_names(self.scenes.iter().map(|scene| scene.recipe.source.kind()))
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

    /// How the data were made.
    pub(super) fn provenance(&self) -> Provenance {
        Provenance::of(self.scenes.iter().map(|scene| &scene.file))
    }

    /// The contents in words, each kind with its number: `12 events, 3 sharp frames`.
    pub(super) fn contents(&self) -> String {
        let FileCounts { poses, streams, events, frames, blurred, geometry: [depth, flow], .. } =
            self.counts();
        let pictures = [
            (frames, "sharp frames"),
            (blurred, "blurred frames"),
            (depth, "depth images"),
            (flow, "flow images"),
        ];
        let pictures = pictures.into_iter().filter(|(count, _)| *count > 0);
        let mut words = vec![format!("{poses} poses")];
        words.extend((streams > 0).then(|| format!("{events} events in {streams} streams")));
        words.extend(pictures.map(|(count, what)| format!("{count} {what}")));
        words.join(", ")
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
        if self.trained().is_some() {
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
                Some(ReconstructMethod::Given(_) | ReconstructMethod::Newest(_)) => {
                    how.insert("a program that the scene files do not name".to_owned());
                }
                None => {}
            }
        }
        let how: Vec<String> = how.iter().map(|text| plain_text(text)).collect();
        (!how.is_empty()).then(|| how.join("; "))
    }

    /// Returns true if every scene is procedural.
    pub(super) fn made_up(&self) -> bool {
        self.scenes.iter().all(|scene| matches!(scene.recipe.source, SceneSource::Procedural(_)))
    }

    /// The ledger's rows on the material of this release, as a table.
    pub(super) fn ledger(&self) -> String {
        let assets = self.assets();
        if assets.is_empty() {
            return String::new();
        }
        let mut text = String::from(
            "| dataset or program | terms | obligations | source of the terms | statement there | verified |\n\
             |---|---|---|---|---|---|\n",
        );
        for asset in assets {
            let LedgerAsset { name, evidence, obligations, .. } = asset;
            let asked: Vec<&str> = obligations.iter().map(|obligation| obligation.words()).collect();
            let read: Vec<String> = evidence.iter().map(|evidence| format!("<{}>", evidence.url)).collect();
            let said: Vec<&str> = evidence.iter().map(|evidence| evidence.says).collect();
            let verified = if asset.verified { "yes" } else { "**no**" };
            let _ = writeln!(
                text,
                "| {name} | `{}` | {} | {} | {} | {verified} |",
                asset.expression(),
                asked.join(", "),
                read.join(", "),
                said.join("; ")
            );
        }
        text
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

/// Text of a user on one line of Markdown. Nothing in it acts as markup or is hidden, wherever it
/// is put.
pub(super) fn plain_text(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.trim().chars() {
        match c {
            c if breaks_line(c) || c == '\t' => out.push(' '),
            // Two backslashes, which Markdown shows as one.
            c if escape::is_hidden(c) => out.push_str(&format!("\\{}", c.escape_unicode())),
            '\\' | '`' | '*' | '_' | '<' | '>' | '[' | ']' | '|' | '~' | '&' | '$' => out.extend(['\\', c]),
            c => out.push(c),
        }
    }
    if let Some(at) = opens_block(&out) {
        out.insert(at, '\\');
    }
    out
}

/// Returns true if readers of text take the character for the end of a line (Unicode UAX 14:
/// mandatory breaks).
pub(super) fn breaks_line(c: char) -> bool {
    matches!(c, '\n' | '\r' | '\u{b}' | '\u{c}' | '\u{85}' | '\u{2028}' | '\u{2029}')
}

/// Position at which a backslash keeps a line from opening a block: before the sign of a heading, a
/// list, a rule or an underline, or before the dot of `1. `.
fn opens_block(line: &str) -> Option<usize> {
    if line.starts_with(['#', '+', '-', '=']) {
        return Some(0);
    }
    let digits = line.bytes().take_while(u8::is_ascii_digit).count();
    let mut rest = line[digits..].chars();
    let marks = digits > 0 && rest.next().is_some_and(|c| c == '.' || c == ')');
    (marks && rest.next().is_none_or(char::is_whitespace)).then_some(digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_users_are_no_markup() {
        let t = |text: &str, wanted: &str| assert_eq!(plain_text(text), wanted);
        t("Example Lab, 2025", "Example Lab, 2025");
        t(" a|b\n## Licence ", "a\\|b ## Licence");
        t("<img src=x> [a](b) `c` **d**", "\\<img src=x\\> \\[a\\](b) \\`c\\` \\*\\*d\\*\\*");
        t("~~~", "\\~\\~\\~");
        t("# X", "\\# X");
        t("- x", "\\- x");
        t("1. x 2. y", "1\\. x 2. y");
        t("12)", "12\\)");
        t("1.2.0", "1.2.0");
        t("===", "\\===");
        t("_x_ &lt; $y$", "\\_x\\_ \\&lt; \\$y\\$");
        t("a\r# X\u{2028}\u{1b}[31m\u{202e}", "a # X \\\\u{1b}\\[31m\\\\u{202e}");
    }
}
