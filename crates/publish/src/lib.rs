//! Writes a release: composes it, judges its files, and puts it in place.
//!
//! A release is written to a folder of its own next to the target, audited there, and put in place
//! by one rename. Therefore the release's name always leads to a whole release. Only files that
//! this program wrote and that have not changed since are removed.
//!
//! It takes the plan of `gs2e-build` with the recipes of `gs2e-recipe` and the files in `gs2e-store`,
//! composes the tree with `gs2e-release`, and audits it with `gs2e-audit`. Verdicts are findings of
//! `gs2e-check`, the terms of `gs2e-source` decide what is withheld, and `gs2e-files` reads and removes
//! files. Only the program uses it.
//!
//! # Examples
//!
//! ```
//! use gs2e_publish::{ReleaseError, ReleaseTarget, TargetClaim};
//! use std::sync::atomic::AtomicBool;
//!
//! // A folder with a file of someone else is refused.
//! let folder = tempfile::tempdir()?;
//! let target = folder.path().join("out");
//! std::fs::create_dir(&target)?;
//! std::fs::write(target.join("notes.txt"), "not of a release")?;
//! let (claim, cancel) = (Default::default(), AtomicBool::new(false));
//! let options = TargetClaim { replace: false, guarded: &[], claim, wait: false, cancel: &cancel };
//! let refused = ReleaseTarget::claim(&target, options, &mut |_| {});
//! assert!(matches!(refused, Err(ReleaseError::Foreign { path, .. }) if path == target));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod compose;
mod exports;
mod file_checks;
mod made_once;
mod removal;
mod sorted;
mod standing;
mod target;
mod tree;
mod work;

use compose::{ComposedTree, JudgedScene, compose_tree, empty_splits, judge_scenes};

pub use target::{GuardedPath, ReleaseTarget, TargetClaim};

use exports::ReleaseExports;
use gs2e_audit as audit;
use gs2e_audit::recheck;
use gs2e_build::plan::Plan;
use gs2e_build::run::RunSummary;
use gs2e_check::Finding;
use gs2e_files::PathError;
use gs2e_recipe as recipe;
use gs2e_recipe::{RecipeFaults, ReleaseInfo, SourceTerms, TakedownList};
use gs2e_release::{GatherError, HeldBackScene, SplitLeak, built, include};
use gs2e_store::{Key, Store, StoreError};
use sorted::SortedScenes;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Way in which the files of a release get their bytes from the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LinkMode {
    /// They share blocks with the store until one of them is written to, if the file system can do
    /// that. Otherwise they are copies.
    #[default]
    Reflink,
    /// They are the store's files under a second name: a write to one changes both. For a release that is
    /// deleted together with its store.
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
    /// True if scenes with a failed check are held back; otherwise they stop the release.
    pub partial: bool,
}

impl ReleaseContext {
    /// Reads the files next to the recipes of these paths. The number of scenes taken down is left
    /// at 0, and the release is not partial.
    ///
    /// # Errors
    /// Every fault of one of the files.
    pub fn read(paths: &[PathBuf]) -> Result<Self, RecipeFaults> {
        Ok(Self {
            info: recipe::read_release(paths)?,
            terms: recipe::read_sources(paths)?,
            takedown: recipe::read_takedown(paths)?,
            taken_down: 0,
            partial: false,
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
    /// The findings on the agreement of its files.
    pub agreement: Vec<Finding>,
    /// Keys of the records of its exports and of the verdicts on its files.
    pub records: Vec<Key>,
    /// Scenes that a partial release holds back.
    pub held_back: Vec<HeldBackScene>,
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
    #[error("{}", sorted::failure_line(failed))]
    Checks {
        /// Their findings.
        failed: Vec<Finding>,
        /// Number of scenes in which no check failed.
        sound: usize,
    },
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
    /// An export of `release.yaml` cannot be made.
    #[error(transparent)]
    Include(#[from] include::IncludeRefusal),
    /// The user stopped it.
    #[error("interrupted: nothing was released")]
    Interrupted,
    /// A file cannot be written or read.
    #[error("failed to write {0}")]
    Io(#[source] PathError),
    /// The content of a stored file does not match its name.
    #[error("{path}: stored bytes do not match their digest; run the same command again to rebuild them")]
    Altered {
        /// Its path in the tree.
        path: String,
    },
    /// The written tree does not pass the audit: a defect of this program.
    #[error("the written tree fails its audit: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Audit(Vec<audit::AuditFault>),
    /// A file of a scene cannot be judged.
    #[error("cannot judge {0}")]
    Recheck(#[from] recheck::RecheckError),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
}

fn failed(path: &Path) -> impl FnOnce(std::io::Error) -> ReleaseError {
    move |source| ReleaseError::Io(PathError::new(path, source))
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
    /// Makes the exports that the release includes.
    pub exporter: &'a dyn include::ReleaseExporter,
}

/// A built release whose files were judged, before any of them is written.
#[derive(Debug)]
pub struct JudgedRelease<'a> {
    built: BuiltPlan<'a>,
    scenes: Vec<JudgedScene<'a>>,
    /// Scenes that are not built, if the release is partial.
    unbuilt: Vec<HeldBackScene>,
}

impl<'a> JudgedRelease<'a> {
    /// Composes the files of the built scenes, and judges them as `gs2e check --tree` does. Verdicts on the
    /// same files are taken from the store.
    ///
    /// # Errors
    /// A step is not built and the release is not partial, there is no scene, splits overlap, a product
    /// cannot be read, or `cancel` is set.
    pub fn new(built: BuiltPlan<'a>, cancel: &AtomicBool) -> Result<Self, ReleaseError> {
        let BuiltPlan { plan, summary, store, context, .. } = built;
        let gather = |index| built::gather_scene(plan, index, summary, store, &context.terms);
        let gathered = (0..plan.scenes().len()).map(gather);
        // Before the files are judged, which takes much longer: a scene that is not built ends a release that
        // is not partial.
        let (scenes, unbuilt) = sorted::part_unbuilt(gathered, context.partial)?;
        Ok(Self { built, scenes: judge_scenes(scenes, context, store, cancel)?, unbuilt })
    }

    /// All findings on the scenes: those of the build, joined with those on the files.
    pub fn findings(&self) -> impl Iterator<Item = &Finding> {
        self.scenes.iter().flat_map(|judged| judged.scene.findings())
    }

    /// Writes the release, unless it already stands at the target.
    ///
    /// # Errors
    /// A check failed without a waiver and the release is not partial, no scene is sound, an included export
    /// cannot be made, the target changed since it was claimed, the disk fails, or `cancel` is set. Nothing
    /// of an existing release is touched before the last rename.
    pub fn write(
        self,
        target: &mut ReleaseTarget,
        link: LinkMode,
        cancel: &AtomicBool,
    ) -> Result<WrittenRelease, ReleaseError> {
        // Before anything else is composed: a failed check must not cost the time of a whole tree.
        let BuiltPlan { store, context, exporter, .. } = self.built;
        let SortedScenes { sound, held_back } =
            SortedScenes::sort(self.scenes, self.unbuilt, context.partial)?;
        if sound.is_empty() {
            return Err(ReleaseError::Nothing);
        }
        let release = [context.info.name.as_str(), &context.info.version];
        let exports = ReleaseExports { include: &context.info.include, exporter, store, release };
        let ComposedTree { tree, scenes, agreement, pictures, records } =
            compose_tree(sound, &held_back, exports, context)?;
        let options = audit::AuditOptions {
            takedown: Some(&context.takedown),
            // This program has just made the exports, or has taken them from the store by their keys.
            exporter: None,
            composed: Some(&pictures),
        };
        let tree::TreeOutcome { files, bytes, stood } =
            tree::write_tree(target, &tree, options, link, cancel)?;
        let warnings = scenes.iter().flat_map(|s| s.licence.warnings.iter().cloned());
        // A set, because all scenes of one source have the same warning.
        let warnings: BTreeSet<String> = warnings.chain(empty_splits(&scenes, &context.info)).collect();
        let (scenes, warnings) = (scenes.len(), warnings.into_iter().collect());
        Ok(WrittenRelease { scenes, files, bytes, stood, agreement, records, held_back, warnings })
    }
}
