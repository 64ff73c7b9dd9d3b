//! `manifest.json`: what a release holds, from which keys, with which digests. Committed beside the recipes, it is
//! what a later build is held against.

use super::built::{BuiltScene, BuiltStep};
use super::left_out::Row;
use crate::check::{Finding, Verdict};
use crate::recipe::Splits;
use crate::render::Work;
use crate::store::Digest;
use crate::store::description::Line;
use crate::store::record::Output;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name of the file.
pub(super) const NAME: &str = "manifest.json";

/// The file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// 1.
    pub format: u32,
    /// Name of the release.
    pub name: String,
    /// Version of the release.
    pub version: String,
    /// Program and version that wrote it.
    pub tool: String,
    /// SPDX expression of the whole: the sorted AND of its scenes.
    pub licence: String,
    /// Number of scenes that were left out because a takedown list names them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub taken_down: usize,
    /// How scenes are dealt into splits, where they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub splits: Option<Splits>,
    /// The scenes, sorted by id.
    pub scenes: Vec<ManifestScene>,
    /// Files that belong to no scene, sorted by path; this file and the sums are not listed.
    pub files: Vec<ManifestFile>,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl Manifest {
    /// The paths of all files that it lists.
    pub(super) fn paths(&self) -> impl Iterator<Item = &str> {
        let of_scenes = self.scenes.iter().flat_map(|scene| &scene.files);
        of_scenes.chain(&self.files).map(|file| file.path.as_str())
    }
}

/// A scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestScene {
    /// Scene id.
    pub id: String,
    /// Kind of its source.
    pub source: String,
    /// SPDX expression.
    pub licence: String,
    /// Its steps, with keys and outputs.
    pub steps: Vec<ManifestStep>,
    /// Number of verdicts of each kind.
    pub checks: BTreeMap<String, usize>,
    /// Faults that its recipe accepts, with the reason.
    pub waivers: Vec<Finding>,
    /// What was left out of rendering for the events of each trajectory, over all frames.
    pub left_out: BTreeMap<String, Work>,
    /// The same in words, and what sensors and sharp frames left out beside it, with the proof that nothing is lost by
    /// it; absent in a release of a program that did not write it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub omitted: BTreeMap<String, Vec<Row>>,
    /// Its files, sorted by path.
    pub files: Vec<ManifestFile>,
}

/// A step.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestStep {
    /// Its name within the scene.
    pub step: String,
    /// Name of the stage.
    pub stage: String,
    /// Its key.
    pub key: Digest,
    /// What the key is made of; absent in a release of a program that did not write it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub made_of: Option<Ingredients>,
    /// Its outputs.
    pub outputs: Vec<Output>,
}

/// What a step's key is made of, so that two releases can say why a step was made anew.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ingredients {
    /// Revision of the stage.
    pub revision: u32,
    /// Numerical class, where the stage has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<String>,
    /// Digest of the parameters as `gs2e why` lists them.
    pub params: Digest,
    /// Digest of each input by its role; a file of the source is `file NAME`.
    pub inputs: BTreeMap<String, Digest>,
}

impl Ingredients {
    /// From the description on a step's record; `None` where that is none of a step.
    pub(super) fn of(description: &[Line]) -> Option<Self> {
        let text = |path: &str| description.iter().find(|line| line.path == path).map(|line| &line.text);
        let input =
            |line: &Line| Some((line.path.strip_prefix("inputs.")?.to_owned(), line.text.parse().ok()?));
        let params = description.iter().filter(|l| l.path == "params" || l.path.starts_with("params."));
        let params: String = params.map(|line| format!("{} = {}\n", line.path, line.text)).collect();
        Some(Self {
            revision: text("revision")?.parse().ok()?,
            class: text("class").cloned(),
            params: Digest::of(params.as_bytes()),
            inputs: description.iter().filter_map(input).collect(),
        })
    }
}

/// A file of the tree.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestFile {
    /// Path below the release folder, `/`-separated.
    pub path: String,
    /// Length in bytes.
    pub size: u64,
    /// BLAKE3 of its bytes.
    pub blake3: Digest,
}

/// Describes a scene; its files are added when the tree is known.
pub(super) fn scene(built: &BuiltScene<'_>, files: Vec<ManifestFile>) -> ManifestScene {
    let findings: Vec<&Finding> = built.trajectories.iter().flat_map(|t| &t.findings).collect();
    let mut checks = BTreeMap::new();
    for finding in &findings {
        *checks.entry(finding.verdict.name().to_owned()).or_default() += 1;
    }
    let left_out = built.trajectories.iter().filter_map(|t| Some((t.name.clone(), t.simulation()?.work)));
    let omitted = built.trajectories.iter().map(|t| (t.name.clone(), t.left_out.clone()));
    ManifestScene {
        id: built.recipe.scene.clone(),
        source: built.recipe.source.kind().to_owned(),
        licence: built.licence.expression.clone(),
        steps: built.steps.iter().map(step).collect(),
        checks,
        waivers: findings.into_iter().filter(|f| f.verdict == Verdict::Waived).cloned().collect(),
        left_out: left_out.collect(),
        omitted: omitted.collect(),
        files,
    }
}

fn step(built: &BuiltStep) -> ManifestStep {
    ManifestStep {
        step: built.name.clone(),
        stage: built.stage.to_owned(),
        key: built.key.0,
        made_of: Ingredients::of(&built.description),
        outputs: built.outputs.clone(),
    }
}
