//! `manifest.json`: the content of a release, with the keys that it was made from and its digests.
//! Committed next to the recipes, it is compared with later builds.

use super::built::{BuiltScene, BuiltStep};
use super::held_back::HeldBackScene;
use super::left_out::OmissionRow;
use gs2e_check::{Finding, Verdict};
use gs2e_recipe::{IncludedExport, ReleaseInfo, SplitPlan};
use gs2e_render::RenderWork;
use gs2e_store::description::DescribedValue;
use gs2e_store::record::StoredOutput;
use gs2e_store::{Digest, Key};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name of the file.
pub const NAME: &str = "manifest.json";

/// The file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReleaseManifest {
    /// Format version: 1.
    pub format: u32,
    /// Name of the release.
    pub name: String,
    /// Version of the release.
    pub version: String,
    /// The publisher's statements, from which card, datasheet and catalogue entry are composed;
    /// absent in releases of programs that did not write it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub publisher: Option<Publisher>,
    /// Program and version that wrote it.
    pub tool: String,
    /// SPDX expression of the whole: the sorted AND of its scenes.
    pub licence: String,
    /// Number of scenes left out because a takedown list names them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub taken_down: usize,
    /// Scenes left out because a check failed, sorted by id.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held_back: Vec<HeldBackScene>,
    /// Rule that deals scenes into splits, if there are splits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub splits: Option<SplitPlan>,
    /// Exports of trajectories, in `exports/<format>/` of each; absent if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub include: Vec<IncludedExport>,
    /// The scenes, sorted by id.
    pub scenes: Vec<ManifestScene>,
    /// Files that belong to no scene, sorted by path; this file and the sums are not listed.
    pub files: Vec<ManifestFile>,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl ReleaseManifest {
    /// The paths of all files that it lists.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
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
    /// Number of verdicts of each kind in the checks of its trajectories.
    pub checks: BTreeMap<String, usize>,
    /// Faults of trajectories that its recipe accepts, with the reason.
    pub waivers: Vec<Finding>,
    /// Work that rendering for events left out, for each trajectory over all frames.
    pub left_out: BTreeMap<String, RenderWork>,
    /// `left_out` in words, with the work that sensors and sharp frames left out, and the proof
    /// that nothing is lost; absent in releases of programs that did not write it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub omitted: BTreeMap<String, Vec<OmissionRow>>,
    /// Its files, sorted by path.
    pub files: Vec<ManifestFile>,
}

/// The scenes of a manifest by id, to find the scene of a file.
#[derive(Debug)]
pub struct FileOwners<'m>(BTreeMap<&'m str, &'m ManifestScene>);

impl<'m> FileOwners<'m> {
    /// The scenes of a manifest.
    #[must_use]
    pub fn new(manifest: &'m ReleaseManifest) -> Self {
        Self(manifest.scenes.iter().map(|scene| (scene.id.as_str(), scene)).collect())
    }

    /// The scene that contains a path: the one with the longest id that the path begins with.
    pub fn of(&self, path: &str) -> Option<&'m ManifestScene> {
        path.rmatch_indices('/').find_map(|(end, _)| self.0.get(&path[..end]).copied())
    }

    /// The scene with an id.
    pub fn scene(&self, id: &str) -> Option<&'m ManifestScene> {
        self.0.get(id).copied()
    }
}

impl ManifestScene {
    /// The outputs of a step of a trajectory; empty if there is no step of that name.
    pub fn outputs(&self, trajectory: &str, step: &str) -> &[StoredOutput] {
        self.scene_outputs(&format!("{trajectory}/{step}"))
    }

    /// The outputs of a step of the scene, by its whole name.
    pub fn scene_outputs(&self, name: &str) -> &[StoredOutput] {
        self.steps.iter().find(|step| step.step == name).map_or(&[], |step| &step.outputs)
    }
}

/// A step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestStep {
    /// Its name within the scene.
    pub step: String,
    /// Name of the stage.
    pub stage: String,
    /// Its key.
    pub key: Digest,
    /// Ingredients of the key; absent in releases of programs that did not write it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub made_of: Option<KeyIngredients>,
    /// Its outputs.
    pub outputs: Vec<StoredOutput>,
}

/// The ingredients of a step's key. A reader can compute the key from them, and two releases can
/// show why it differs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyIngredients {
    /// Revision of the stage.
    pub revision: u32,
    /// Numerical class, if the stage has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<String>,
    /// The parameters in the key.
    pub params: DescribedValue,
    /// Digest of each input by its role; a file of the source is `file NAME`.
    pub inputs: BTreeMap<String, Digest>,
}

impl KeyIngredients {
    /// Extracts the ingredients from the description of a step; `None` for any other value.
    pub(super) fn from_lines(description: &DescribedValue) -> Option<Self> {
        let DescribedValue::Record(fields) = description else { return None };
        let (DescribedValue::Unsigned(revision), DescribedValue::Record(inputs)) =
            (fields.get("revision")?, fields.get("inputs")?)
        else {
            return None;
        };
        let input = |(role, digest): (&String, &DescribedValue)| match digest {
            DescribedValue::Digest(digest) => Some((role.clone(), *digest)),
            _ => None,
        };
        let class = match fields.get("class") {
            Some(DescribedValue::Text(class)) => Some(class.clone()),
            _ => None,
        };
        Some(Self {
            revision: u32::try_from(*revision).ok()?,
            class,
            params: fields.get("params")?.clone(),
            inputs: inputs.iter().filter_map(input).collect(),
        })
    }

    /// The key of a step of this stage.
    #[must_use]
    pub fn key(&self, stage: &str) -> Digest {
        Key::of_description(&self.description(stage)).0
    }

    /// The description whose hash is the key.
    pub fn description(&self, stage: &str) -> DescribedValue {
        let inputs = self
            .inputs
            .iter()
            .map(|(role, digest)| (role.clone(), DescribedValue::Digest(*digest)))
            .collect();
        // The fields and their names must stay those of a stage's description, or keys differ.
        let mut fields = BTreeMap::from([
            ("stage".to_owned(), DescribedValue::Text(stage.to_owned())),
            ("revision".to_owned(), DescribedValue::Unsigned(self.revision.into())),
            ("params".to_owned(), self.params.clone()),
            ("inputs".to_owned(), DescribedValue::Record(inputs)),
        ]);
        if let Some(class) = &self.class {
            fields.insert("class".to_owned(), DescribedValue::Text(class.clone()));
        }
        DescribedValue::Record(fields)
    }
}

/// The publisher's statements on a release, except for name, version and splits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Publisher {
    /// Page of the release.
    pub url: String,
    /// Maker of the release.
    pub creator: String,
    /// Day of publication, `YYYY-MM-DD`.
    pub date_published: String,
    /// Citation.
    pub cite_as: String,
    /// Its description.
    pub description: String,
    /// Contact for questions and requests for removal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<String>,
    /// The purpose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub purpose: Option<String>,
    /// Source of funding.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub funding: Option<String>,
    /// Plan of maintenance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub maintenance: Option<String>,
}

impl Publisher {
    /// Takes the statements of a `release.yaml`.
    pub fn of(info: &ReleaseInfo) -> Self {
        Self {
            url: info.url.clone(),
            creator: info.creator.clone(),
            date_published: info.date_published.clone(),
            cite_as: info.cite_as.clone(),
            description: info.description.clone(),
            contact: info.contact.clone(),
            purpose: info.purpose.clone(),
            funding: info.funding.clone(),
            maintenance: info.maintenance.clone(),
        }
    }
}

impl ReleaseManifest {
    /// The `release.yaml` of the release; `None` if the publisher's statements are absent.
    pub fn info(&self) -> Option<ReleaseInfo> {
        let publisher = self.publisher.clone()?;
        Some(ReleaseInfo {
            name: self.name.clone(),
            version: self.version.clone(),
            url: publisher.url,
            creator: publisher.creator,
            date_published: publisher.date_published,
            cite_as: publisher.cite_as,
            description: publisher.description,
            contact: publisher.contact,
            purpose: publisher.purpose,
            funding: publisher.funding,
            maintenance: publisher.maintenance,
            splits: self.splits.clone(),
            include: self.include.clone(),
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

/// Describes a scene. `files` are its files in the tree.
pub fn manifest_scene(built: &BuiltScene<'_>, files: Vec<ManifestFile>) -> ManifestScene {
    // Findings on the capture and its photos are in `checks.json` of the scene, not here.
    let findings: Vec<&Finding> = built.trajectories.iter().flat_map(|t| &t.findings).collect();
    let left_out = built.trajectories.iter().filter_map(|t| Some((t.name.clone(), t.simulation()?.work)));
    let omitted = built.trajectories.iter().map(|t| (t.name.clone(), t.left_out.clone()));
    ManifestScene {
        id: built.recipe.scene.clone(),
        source: built.recipe.source.kind().name().to_owned(),
        licence: built.licence.expression.clone(),
        steps: built.steps.iter().map(manifest_step).collect(),
        checks: verdicts(findings.iter().copied()),
        waivers: waivers(findings.into_iter()),
        left_out: left_out.collect(),
        omitted: omitted.collect(),
        files,
    }
}

/// Number of verdicts of each kind among the findings on trajectories.
pub fn verdicts<'f>(findings: impl Iterator<Item = &'f Finding>) -> BTreeMap<String, usize> {
    findings.fold(BTreeMap::new(), |mut counts, finding| {
        *counts.entry(finding.verdict.name().to_owned()).or_default() += 1;
        counts
    })
}

/// The accepted faults among the findings on trajectories.
pub fn waivers<'f>(findings: impl Iterator<Item = &'f Finding>) -> Vec<Finding> {
    findings.filter(|finding| finding.verdict == Verdict::Waived).cloned().collect()
}

fn manifest_step(built: &BuiltStep) -> ManifestStep {
    ManifestStep {
        step: built.name.clone(),
        stage: built.stage.to_owned(),
        key: built.key.0,
        made_of: KeyIngredients::from_lines(&built.description),
        outputs: built.outputs.clone(),
    }
}
