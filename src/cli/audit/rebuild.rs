//! `gs2e audit --rebuild N`: builds some scenes of a release again from their recipes, in a
//! separate store, and compares every byte.

use crate::cli::build::{BuildRequest, TrustOptions, exit_kind};
use crate::cli::{CommonArgs, Console, ExitKind, RecipeTargets, VerbError, on_interrupt};
use gs2e_audit::{AuditFault, rebuilt};
use gs2e_build::plan::Plan;
use gs2e_build::run::backends::{RendererChoice, RendererKind};
use gs2e_export::{IncludedExporter, SilentProgress};
use gs2e_gpu::DeviceChoice;
use gs2e_publish::{BuiltPlan, JudgedRelease, LinkMode, ReleaseContext, ReleaseTarget, TargetClaim};
use gs2e_recipe::{self as recipe, Recipe};
use gs2e_release::ReleaseManifest;
use gs2e_render::backend::Backend;
use gs2e_store::{Digest, LockClaim, Store, StoreAccess, StoreOptions};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Options of `audit --rebuild`.
#[derive(Debug, clap::Args)]
pub(super) struct RebuildArgs {
    /// Rebuild this many scenes, drawn at random, and compare every byte
    #[arg(long, value_name = "N")]
    rebuild: Option<usize>,
    /// Recipes from which the scenes are rebuilt
    #[arg(long, value_name = "RECIPE or DIR", default_value = RecipeTargets::DEFAULT)]
    recipes: Vec<PathBuf>,
    /// Seed of the draw
    #[arg(long, value_name = "SEED", default_value_t = 0, requires = "rebuild")]
    seed: u64,
}

/// The result of a rebuild.
pub(super) struct RebuildOutcome {
    /// Ids of the rebuilt scenes.
    pub(super) scenes: Vec<String>,
    pub(super) faults: Vec<AuditFault>,
}

impl RebuildArgs {
    /// Rebuilds the scenes, or all if `full` is set; `None` if no rebuild is requested.
    pub(super) fn run(
        &self,
        dir: &Path,
        full: bool,
        common: &CommonArgs,
        console: &Console,
    ) -> Result<Option<RebuildOutcome>, VerbError> {
        let Some(count) = self.rebuild.or(full.then_some(usize::MAX)) else { return Ok(None) };
        let manifest = rebuilt::read_manifest(dir);
        let manifest = manifest.map_err(|e| VerbError::failed("input-unreadable", e.to_string()))?;
        let chosen = draw_scenes(&manifest, count, self.seed);
        let recipes = self.recipes_of(&chosen)?;
        let mut found = RebuildOutcome { scenes: chosen, faults: Vec::new() };
        // Bytes depend on the numerical class. So each class is rebuilt by its own back end, in its
        // own store.
        let mut classes: BTreeMap<String, Vec<Recipe>> = BTreeMap::new();
        for recipe in recipes {
            classes.entry(class_of(&manifest, &recipe.scene)).or_default().push(recipe);
        }
        for (class, recipes) in classes {
            let scenes: Vec<String> = recipes.iter().map(|recipe| recipe.scene.clone()).collect();
            let help = "a rebuild needs a folder for temporary files; TMPDIR names another one";
            let folder = tempfile::tempdir().map_err(|e| not_rebuilt(e).help(help))?;
            let common = CommonArgs { store: folder.path().join("store"), ..common.clone() };
            let rebuilt_tree = self.make(open_backend(&class, &common)?, recipes, &common, console)?;
            found.faults.extend(rebuilt::compare_tops(dir, &rebuilt_tree).map_err(not_rebuilt)?);
            for scene in &scenes {
                found.faults.extend(rebuilt::compare_scenes(dir, &rebuilt_tree, scene).map_err(not_rebuilt)?);
            }
        }
        // The top of the release is compared once per class, so its faults may repeat.
        found.faults.sort();
        found.faults.dedup();
        Ok(Some(found))
    }

    fn recipes_of(&self, scenes: &[String]) -> Result<Vec<Recipe>, VerbError> {
        let mut recipes = recipe::read_all(&self.recipes)?;
        if let Some(absent) = scenes.iter().find(|id| recipes.iter().all(|recipe| recipe.scene != **id)) {
            let message = format!("no recipe makes the scene `{absent}`, so it cannot be rebuilt");
            return Err(VerbError::usage("no-scene", message)
                .help("pass --recipes DIR with the recipes of the release"));
        }
        recipes.retain(|recipe| scenes.contains(&recipe.scene));
        Ok(recipes)
    }

    /// Builds these scenes by a back end, and releases them next to the store. Returns the folder.
    fn make(
        &self,
        backend: Backend,
        recipes: Vec<Recipe>,
        common: &CommonArgs,
        console: &Console,
    ) -> Result<PathBuf, VerbError> {
        let chosen = &RendererChoice::new(RendererKind::One(backend), common.omit(), common.programs());
        let context = ReleaseContext::read(&self.recipes)?;
        // No other process knows this new store, so there is no holder to report.
        let store = Store::open(&common.store, StoreOptions::from(StoreAccess::Write), &mut |_| {})?;
        let (targets, trust) = (&RecipeTargets { recipes: self.recipes.clone() }, &TrustOptions::default());
        let plan = Plan::new(recipes, &chosen.asking(&store));
        let building = BuildRequest { settled: 0, targets, chosen, common, trust, console };
        let (plan, summary) = building.build(plan, &store)?;
        match exit_kind(&summary) {
            ExitKind::Done => {}
            ExitKind::Interrupted => return Err(VerbError::interrupted("nothing was compared")),
            _ => return Err(not_rebuilt("failed to rebuild a scene")),
        }
        let cancel = &on_interrupt()?;
        let claim =
            TargetClaim { replace: false, guarded: &[], claim: LockClaim::default(), wait: false, cancel };
        let exporter = &IncludedExporter { progress: &SilentProgress };
        let built = BuiltPlan { plan: &plan, summary: &summary, store: &store, context: &context, exporter };
        // The store is deleted together with the release, so hard links are safe here and no byte
        // is copied.
        let to = common.store.with_file_name("release");
        let released = ReleaseTarget::claim(&to, claim, &mut |_| {}).and_then(|mut target| {
            JudgedRelease::new(built, cancel)?.write(&mut target, LinkMode::Hard, cancel)
        });
        released.map(|_| to).map_err(not_rebuilt)
    }
}

fn not_rebuilt(error: impl Display) -> VerbError {
    VerbError::failed("rebuild", error.to_string())
}

/// Draws `count` scenes, or all if there are fewer. The ids with the lowest hashes of seed and id
/// are drawn, so that nothing but the seed decides and the draw can be repeated.
fn draw_scenes(manifest: &ReleaseManifest, count: usize, seed: u64) -> Vec<String> {
    let mut ids: Vec<String> = manifest.scenes.iter().map(|scene| scene.id.clone()).collect();
    ids.sort_by_key(|id| Digest::of_bytes(format!("{seed} {id}").as_bytes()));
    ids.truncate(count);
    ids.sort();
    ids
}

/// The class in which a scene was rendered; empty if nothing of it was rendered.
fn class_of(manifest: &ReleaseManifest, scene: &str) -> String {
    let steps = manifest.scenes.iter().filter(|listed| listed.id == scene).flat_map(|listed| &listed.steps);
    let mut classes = steps.filter_map(|step| step.made_of.as_ref()?.class.clone());
    // The class of a back end has a slash, as in `cpu/1`. A list of program versions is a class
    // too.
    classes.find(|class| class.contains('/')).unwrap_or_default()
}

/// The back end of a class.
fn open_backend(class: &str, common: &CommonArgs) -> Result<Backend, VerbError> {
    let backend = match class {
        class if class.is_empty() || Backend::is_cpu(class) => Backend::Cpu,
        class if Backend::is_gpu(class) => {
            let refused = |e| VerbError::failed("no-adapter", format!("{class} rendered the release: {e}"));
            common.device(&DeviceChoice::Any).map_err(refused)?.into()
        }
        _ => Backend::Reference,
    };
    // Only the bytes of a GPU depend on the machine.
    if backend.takes_gpu() && backend.class() != class {
        let own = backend.class();
        let what =
            format!("{class} rendered the release, but this machine has {own}: bytes cannot be compared");
        return Err(VerbError::failed("no-adapter", what));
    }
    Ok(backend)
}
