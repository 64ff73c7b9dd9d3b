//! The release: the tree that users download, and its audit.
//!
//! A release is composed in memory as a list of paths and the sources of their bytes. It is written
//! to a folder of its own next to the target, audited there, and put in place by one rename.
//! Therefore the release's name always leads to a whole release. Two releases of the same records
//! are equal byte for byte. Only files that this program wrote and that have not changed since are
//! removed.

pub mod audit;
mod built;
mod card;
mod checksum;
mod croissant;
mod datasheet;
pub mod diff;
mod facts;
mod index;
mod layout;
pub mod left_out;
mod loader;
mod manifest;
mod markdown;
mod path_picture;
mod products;
mod provenance;
mod published;
pub mod recheck;
mod removal;
mod report;
mod reuse;
mod scene;
pub mod signature;
mod split;
mod standing;
pub mod summary;
mod target;
mod tree;
mod work;

pub use built::GatherError;
pub use manifest::{KeyIngredients, ManifestFile, ManifestScene, ManifestStep, Publisher, ReleaseManifest};
pub use report::dataset::{CaptionedPicture, compose_dataset_page};
pub use scene::SceneRecord;
pub use split::SplitLeak;
pub use target::{GuardedPath, ReleaseTarget, TargetClaim};

use crate::artifact::TrajectoryProduct;
use crate::camera::Camera;
use crate::check::{Finding, Verdict};
use crate::licence::{ComposedTerms, Redistributability};
use crate::plan::Plan;
use crate::recipe::{self, RecipeFaults, ReleaseInfo, SourceTerms, TakedownList};
use crate::run::RunSummary;
use crate::store::record::StoredOutput;
use crate::store::{Store, StoreError};
use crate::trajectory::transforms;
use built::{BuiltScene, BuiltTrajectory};
use croissant::DescribedRelease;
use facts::ReleaseFacts;
use published::{PublishedScene, PublishedTrajectory, StoredPlaces};
use scene::{SplitPart, TrajectoryPart};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use tree::{FileContent, ReleaseTree};

/// Name and version of the program, as written in the files of a release.
const TOOL: &str = concat!("gs2e ", env!("CARGO_PKG_VERSION"));

/// Way in which the files of a release get their bytes from the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LinkMode {
    /// They share blocks with the store until one of them is written to, if the file system can do
    /// that. Otherwise they are copies.
    #[default]
    Reflink,
    /// They are the store's files under a second name: a write to one changes both.
    Hard,
    /// Copies.
    Copy,
}

/// Contents of the files next to the recipes that concern the release as a whole.
#[derive(Debug, Clone, Default)]
pub struct ReleaseContext {
    /// Name, version and publisher's statements.
    pub info: ReleaseInfo,
    /// Permissions to redistribute, by source.
    pub terms: SourceTerms,
    /// Scenes that are no longer redistributed.
    pub takedown: TakedownList,
    /// Number of scenes that are missing in the plan for that reason.
    pub taken_down: usize,
}

impl ReleaseContext {
    /// Reads the files next to the recipes of these paths. The number of scenes taken down is left
    /// at 0.
    ///
    /// # Errors
    /// Every fault of one of the files.
    pub fn read(paths: &[PathBuf]) -> Result<Self, RecipeFaults> {
        Ok(Self {
            info: recipe::read_release(paths)?,
            terms: recipe::read_sources(paths)?,
            takedown: recipe::read_takedown(paths)?,
            taken_down: 0,
        })
    }
}

/// Summary of a written release.
#[derive(Debug)]
pub struct WrittenRelease {
    /// Number of scenes.
    pub scenes: usize,
    /// Number of files, including the sums.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// True if the same release was already at the target; then nothing was written.
    pub stood: bool,
    /// Warnings about licences and empty splits.
    pub warnings: Vec<String>,
}

/// Reason why there is no release.
#[derive(Debug, thiserror::Error)]
pub enum ReleaseError {
    /// Something is not built.
    #[error(transparent)]
    Gather(#[from] GatherError),
    /// Checks failed.
    #[error("{} checks failed", .0.len())]
    Checks(Vec<Finding>),
    /// Splits have something in common.
    #[error("splits overlap: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Leaks(Vec<SplitLeak>),
    /// There is no scene.
    #[error("there is no scene to release")]
    Nothing,
    /// The target is not a folder that a release may replace.
    #[error("{} {because}", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// The reason why it may not be replaced.
        because: String,
    },
    /// The user stopped it.
    #[error("interrupted: nothing was released")]
    Interrupted,
    /// A file cannot be written or read.
    #[error("failed to write {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The content of a stored file does not match its name.
    #[error("{path}: stored bytes do not match their digest; run the same command again to rebuild them")]
    Altered {
        /// Its path in the tree.
        path: String,
    },
    /// The written tree does not pass the audit: a defect of this program.
    #[error("the written tree fails its audit: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Audit(Vec<audit::AuditFault>),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
}

fn failed(path: &Path) -> impl FnOnce(std::io::Error) -> ReleaseError {
    let path = path.to_owned();
    move |source| ReleaseError::Io { path, source }
}

/// Input of a release.
#[derive(Debug, Clone, Copy)]
pub struct BuiltPlan<'a> {
    /// The plan, which was run to its end.
    pub plan: &'a Plan,
    /// Result of the run.
    pub summary: &'a RunSummary,
    /// The store that holds its products.
    pub store: &'a Store,
    /// Contents of the files next to its recipes.
    pub context: &'a ReleaseContext,
}

/// Writes the release of the built scenes, unless it already stands at the target.
///
/// # Errors
/// A step is not built, a check failed without a waiver, the target changed since it was claimed,
/// the disk fails, or `cancel` is set. Nothing of an existing release is touched before the last
/// rename.
pub fn write_release(
    target: &mut ReleaseTarget,
    built: BuiltPlan<'_>,
    link: LinkMode,
    cancel: &AtomicBool,
) -> Result<WrittenRelease, ReleaseError> {
    let BuiltPlan { plan, summary, store, context } = built;
    let scenes =
        (0..plan.scenes().len()).map(|i| built::gather_scene(plan, i, summary, (store, &context.terms)));
    let scenes: Vec<BuiltScene<'_>> = scenes.collect::<Result<_, _>>()?;
    // Before anything is composed: a failed check must not cost the time of a whole tree.
    let findings = scenes.iter().flat_map(BuiltScene::findings);
    let failed: Vec<Finding> = findings.filter(|f| f.verdict == Verdict::Fail).cloned().collect();
    if !failed.is_empty() {
        return Err(ReleaseError::Checks(failed));
    }
    if scenes.is_empty() {
        return Err(ReleaseError::Nothing);
    }
    let (tree, scenes) = compose_tree(scenes, store, context)?;
    let tree::TreeOutcome { files, bytes, stood } =
        tree::write_tree(target, &tree, (store, &context.takedown), link, cancel)?;
    let warnings = scenes.iter().flat_map(|s| s.licence.warnings.iter().cloned());
    // A set, because all scenes of one source have the same warning.
    let warnings: BTreeSet<String> = warnings.chain(empty_splits(&scenes, &context.info)).collect();
    Ok(WrittenRelease { scenes: scenes.len(), files, bytes, stood, warnings: warnings.into_iter().collect() })
}

/// Composes the tree without the sums. Also returns the scenes as their files describe them.
fn compose_tree(
    scenes: Vec<BuiltScene<'_>>,
    store: &Store,
    context: &ReleaseContext,
) -> Result<(ReleaseTree, Vec<PublishedScene>), ReleaseError> {
    let info = &context.info;
    let described = describe_all(&scenes, info)?;
    let (mut tree, mut listed, mut published) = (ReleaseTree::default(), Vec::new(), Vec::new());
    for (scene, file) in scenes.into_iter().zip(described) {
        let files = scene_files(&scene, &file, store);
        let described = manifest::manifest_scene(&scene, files.listing());
        published.push(PublishedScene::of(scene, file, described.files.clone()));
        listed.push(described);
        tree.extend(files);
    }
    let licence = terms_of(&published);
    let facts = ReleaseFacts { scenes: &published, info, taken_down: context.taken_down, licence: &licence };
    let top = compose_top(&facts, &|path| tree.place(path).map(Path::to_owned));
    let manifest = ReleaseManifest {
        format: standing::FORMAT,
        name: info.name.clone(),
        version: info.version.clone(),
        publisher: Some(Publisher::of(info)),
        tool: TOOL.into(),
        licence: licence.expression,
        taken_down: context.taken_down,
        splits: info.splits.clone(),
        scenes: listed,
        // The manifest is not among them: it cannot contain its own digest.
        files: top.listing(),
    };
    tree.extend(top);
    tree.add(manifest::NAME.into(), FileContent::json(&manifest));
    Ok((tree, published))
}

/// The combined terms of all scenes.
fn terms_of(scenes: &[PublishedScene]) -> ComposedTerms {
    crate::licence::compose_all(scenes.iter().map(|scene| &scene.licence))
}

/// Composes the files at the top of the tree, except for the manifest and the sums.
fn compose_top(facts: &ReleaseFacts<'_>, places: StoredPlaces<'_>) -> ReleaseTree {
    let ReleaseFacts { scenes, info, licence, .. } = *facts;
    let mut top = ReleaseTree::default();
    top.add(layout::CARD.into(), FileContent::Bytes(card::compose_card(facts).into_bytes()));
    top.add(datasheet::NAME.into(), FileContent::Bytes(datasheet::compose_datasheet(facts).into_bytes()));
    let files: Vec<&SceneRecord> = scenes.iter().map(|scene| &scene.file).collect();
    let reuse = reuse::compose_reuse(&files, &licence.expression);
    top.add(reuse::NAME.into(), FileContent::Bytes(reuse.into_bytes()));
    // The loader has terms of its own, which no scene brings.
    for id in licence.ids.iter().cloned().chain(loader::licence_ids()).collect::<BTreeSet<_>>() {
        let text = crate::licence::licence_text(&id, &sorted_holders(scenes));
        top.add(layout::licence_text(&id), FileContent::Bytes(text.into_bytes()));
    }
    top.add(loader::NAME.into(), FileContent::Bytes(loader::TEXT.into()));
    let index = index_of(scenes);
    let paths = scenes.iter().flat_map(|scene| &scene.files).map(|file| file.path.clone()).collect();
    let release =
        DescribedRelease { info, licence: &licence.expression, scenes: &files, paths, index: &index };
    top.add(croissant::NAME.into(), FileContent::json(&croissant::compose_croissant(&release)));
    top.add(index::NAME.into(), FileContent::Bytes(index));
    // Last, because it links to every other file.
    let others = [manifest::NAME, checksum::NAME, checksum::B3_NAME].map(str::to_owned);
    let linked = top.paths().map(str::to_owned).chain(others).collect();
    top.add(
        report::NAME.into(),
        FileContent::Bytes(report::compose_page(facts, linked, places).into_bytes()),
    );
    top
}

/// The holders of the owners' parts, sorted.
fn sorted_holders(scenes: &[PublishedScene]) -> Vec<String> {
    let licences = scenes.iter().filter_map(|scene| scene.recipe.licence.as_ref());
    let holders: BTreeSet<&String> = licences.map(|licence| &licence.holder).collect();
    holders.into_iter().cloned().collect()
}

/// Describes the scenes, and deals them into splits if the release has splits.
fn describe_all(scenes: &[BuiltScene<'_>], info: &ReleaseInfo) -> Result<Vec<SceneRecord>, ReleaseError> {
    let mut described: Vec<SceneRecord> = scenes.iter().map(describe_release).collect::<Result<_, _>>()?;
    // Afterwards, because the split follows from the description.
    if let Some(splits) = &info.splits {
        for file in &mut described {
            file.split = Some(split::split_part(file, splits));
        }
    }
    let leaks = split::find_leaks(&described);
    if leaks.is_empty() { Ok(described) } else { Err(ReleaseError::Leaks(leaks)) }
}

/// Warnings for splits without a scene.
fn empty_splits(scenes: &[PublishedScene], info: &ReleaseInfo) -> Vec<String> {
    // Groups are dealt by a hash, so a small release may leave a split empty.
    let names = info.splits.iter().flat_map(|splits| splits.shares.keys());
    let splits: Vec<&SplitPart> = scenes.iter().filter_map(|scene| scene.file.split.as_ref()).collect();
    let has = |name: &str| splits.iter().any(|split| split.name == name);
    names.filter(|name| !has(name)).map(|name| format!("no scene is in the split {name}")).collect()
}

fn describe_release(scene: &BuiltScene<'_>) -> Result<SceneRecord, ReleaseError> {
    // Only the file of the Gaussians is read for it.
    let path = || scene.gaussians.as_ref().map(|gaussians| gaussians.path.clone()).unwrap_or_default();
    scene::compose_scene(scene).map_err(|source| ReleaseError::Io { path: path(), source })
}

fn index_of(scenes: &[PublishedScene]) -> Vec<u8> {
    let sources_of = |t: &PublishedTrajectory| index::IndexSources::from_files(&t.motion.report, &t.findings);
    let rows = scenes.iter().flat_map(|scene| {
        let sources: Vec<index::IndexSources> = scene.trajectories.iter().map(sources_of).collect();
        index::scene_rows(&scene.file, &sources)
    });
    index::compose_index(rows.collect())
}

fn scene_files(scene: &BuiltScene<'_>, file: &SceneRecord, store: &Store) -> ReleaseTree {
    let id = &scene.recipe.scene;
    let mut tree = ReleaseTree::default();
    // These two show nothing of the scene, and are written for withheld scenes as well.
    tree.add(format!("{id}/{}", layout::SCENE), FileContent::json(file));
    if let Some(photographed) = &scene.photographed {
        tree.add(format!("{id}/{}", layout::CHECKS), FileContent::json(&photographed.findings));
    }
    let shown =
        |name: &str| scene.licence.passing != Redistributability::Withheld || products::is_metadata(name);
    if let Some((name, output)) =
        layout::made_of_scene(|step| scene.own_outputs(step)).filter(|of| shown(of.0))
    {
        tree.add(format!("{id}/{name}"), stored_file(output, store));
    }
    for (trajectory, part) in scene.trajectories.iter().zip(&file.trajectories) {
        let at = |name: &str| format!("{id}/{}/{name}", trajectory.name);
        for (name, content) in trajectory_files(scene, (trajectory, part), store) {
            if shown(&name) {
                tree.add(at(&name), content);
            }
        }
    }
    tree
}

/// An output of a step as a file of the tree.
fn stored_file(output: &StoredOutput, store: &Store) -> FileContent {
    let StoredOutput { digest, size, .. } = *output;
    FileContent::Blob { path: store.path_of(&digest), digest, size }
}

/// The files of a trajectory by their names in its folder. Internal files of the store (the
/// brightness that the sensor saw, the counts of the simulation) stay there.
fn trajectory_files(
    scene: &BuiltScene<'_>,
    (trajectory, part): (&BuiltTrajectory, &TrajectoryPart),
    store: &Store,
) -> BTreeMap<String, FileContent> {
    let outputs = |step: &str| scene.outputs(&trajectory.name, step);
    let made = layout::made(outputs, &published::stream_names(part));
    let mut files: BTreeMap<String, FileContent> =
        made.into_iter().map(|(name, output)| (name, stored_file(output, store))).collect();
    files.insert(layout::CHECKS.into(), FileContent::json(&trajectory.findings));
    let path = path_picture::compose_picture(&trajectory.motion).map(FileContent::Bytes);
    files.extend(path.map(|picture| (path_picture::NAME.to_owned(), picture)));
    let sharp: Vec<&str> = outputs(products::SHARP.name()).iter().map(|o| o.name.as_str()).collect();
    let transforms = transforms_of(&scene.camera(), part, &trajectory.motion, &sharp);
    files.insert(layout::TRANSFORMS.into(), FileContent::json(&transforms));
    files
}

/// `transforms.json` of a trajectory; `sharp` are the names of its sharp frames, sorted.
fn transforms_of(
    camera: &Camera,
    part: &TrajectoryPart,
    motion: &TrajectoryProduct,
    sharp: &[&str],
) -> serde_json::Value {
    let blurred = &published::exposures(part, motion);
    transforms::compose_transforms(camera, &motion.trajectory, &transforms::PictureLinks { sharp, blurred })
}
