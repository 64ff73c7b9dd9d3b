//! `gs2e release`: builds the recipes, checks the results, and writes the tree that people
//! download.

use super::build::{BuildRequest, TrustOptions, exit_kind, lock_claim, open_store, report_end};
use super::export::BarProgress;
use super::problem::FULL;
use super::verdicts::{report_count, report_findings};
use super::words::{Word, one_of};
use super::{
    CommonArgs, Console, ExitKind, RecipeTargets, UserMessage, VerbError, check, on_interrupt, path,
};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepAction, assess_plan};
use gs2e_build::run::RunSummary;
use gs2e_check::{Finding, REASON, is_waivable};
use gs2e_export::{IncludedExporter, SilentProgress};
use gs2e_files::escape;
use gs2e_publish::{
    BuiltPlan, GuardedPath, JudgedRelease, LinkMode, ReleaseContext, ReleaseError, ReleaseTarget,
    TargetClaim, WrittenRelease,
};
use gs2e_recipe::{self as recipe, Recipe, ReconstructMethod};
use gs2e_release::GatherError;
use gs2e_release::include::{IncludeFailure, IncludeRefusal, foresee_exports};
use gs2e_release::signature::SigningKey;
use gs2e_store::space::is_full;
use gs2e_store::{ReleaseRoot, Store};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Arguments of `release`.
#[derive(Debug, clap::Args)]
pub(super) struct ReleaseArgs {
    #[command(flatten)]
    targets: RecipeTargets,
    /// Folder of the release
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    /// Refuse to release stale steps, instead of building them
    #[arg(long)]
    no_build: bool,
    /// Also replace a changed release or another folder; files that gs2e did not write are kept
    /// next to it
    #[arg(long)]
    replace: bool,
    /// Transfer of file contents from the store to the release
    #[arg(long, value_parser = one_of(&LINKS), value_name = "HOW", default_value = "reflink")]
    link: LinkMode,
    /// Alias of `--link copy`.
    #[arg(long, hide = true, conflicts_with = "link")]
    copy: bool,
    /// Sign the release with this secret key of minisign
    #[arg(long, value_name = "KEY")]
    sign: Option<PathBuf>,
    /// Hold back scenes with a failed check, write the others, and exit with 3
    #[arg(long, conflicts_with = "strict")]
    partial: bool,
    #[command(flatten)]
    trust: TrustOptions,
}

const LINKS: [Word<LinkMode>; 2] = [
    (
        "reflink",
        "Share blocks until one side is changed, if the file system can; else copy",
        LinkMode::Reflink,
    ),
    ("copy", "Copy every byte", LinkMode::Copy),
];

impl ReleaseArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.targets.resolve()?;
        let chosen = &common.renderers()?;
        let recipes = recipe::read_all(&self.targets.recipes)?;
        let mut context = ReleaseContext::read(&self.targets.recipes)?;
        // Before the takedown: the sources of a scene that is taken down are guarded too.
        let guarded = self.guarded(&recipes, common);
        let (recipes, taken_down) = context.takedown.keep(recipes);
        context.taken_down = taken_down.scenes;
        context.partial = self.partial;
        super::takedown::report_takedown(taken_down, console);
        // An export that no build can have is refused before hours of work.
        let exporter = IncludedExporter { progress: &SilentProgress };
        foresee_exports(&recipes, &context.info.include, &exporter).map_err(include_problem)?;
        // So is a wrong key or password.
        let key = self.sign.as_deref().map(read_key).transpose()?;
        let started = Instant::now();
        let store = open_store(common, &self.trust, console)?;
        let cancel = &on_interrupt()?;
        // The target is claimed before the build, so that a wrong target is refused before hours of
        // work.
        let mut target = self.claim(&guarded, common, cancel, console)?;
        let plan = Plan::new(recipes, &chosen.asking(&store));
        if self.no_build {
            refuse_stale(&plan, &store)?;
        }
        let building =
            BuildRequest { settled: 0, targets: &self.targets, chosen, common, trust: &self.trust, console };
        let (plan, summary) = building.build(plan, &store)?;
        report_end(&summary, started.elapsed().as_secs_f64(), console);
        let built = exit_kind(&summary);
        // An incomplete build is only released as a partial one; else the existing tree stays as it is.
        let goes_on = self.partial && common.keep_going && built == ExitKind::Failed;
        if built != ExitKind::Done && !goes_on {
            return Ok(built);
        }
        let progress = BarProgress::new(console, Arc::clone(cancel));
        let exporter = &IncludedExporter { progress: &progress };
        let ready = BuiltPlan { plan: &plan, summary: &summary, store: &store, context: &context, exporter };
        let written = self.write(ready, &mut target, &progress, console)?;
        // From here on, `gc` keeps the steps of this release.
        store.write_root(&root(&target, &summary, &written))?;
        self.report(&written, &mut target, console);
        if let Some(key) = key {
            self.sign(&key, console)?;
        }
        Ok(if built == ExitKind::Done && !written.held_back.is_empty() { ExitKind::Fault } else { built })
    }

    /// Writes the scenes that passed their checks.
    fn write(
        &self,
        built: BuiltPlan<'_>,
        target: &mut ReleaseTarget,
        progress: &BarProgress,
        console: &Console,
    ) -> Result<WrittenRelease, VerbError> {
        let (store, cancel) = (built.store, &progress.cancel);
        let judged = JudgedRelease::new(built, cancel).map_err(|error| release_problem(error, console))?;
        let mut findings: Vec<Finding> = judged.findings().cloned().collect();
        let faults = report_findings(&findings, console);
        if self.trust.strict && faults > 0 {
            let message = format!("{faults} findings did not pass and --strict is set; nothing was released");
            return Err(VerbError::fault("check-warned", message));
        }
        let link = if self.copy { LinkMode::Copy } else { self.link };
        let written = judged.write(target, link, cancel);
        progress.finish();
        // Before the error is returned: the exports and verdicts that were made spare the next try their
        // time.
        store.flush()?;
        findings.extend(written.iter().flat_map(|written| written.agreement.iter().cloned()));
        report_count(&findings, [0; 2], console);
        written.map_err(|error| release_problem(error, console))
    }

    fn sign(&self, key: &SigningKey, console: &Console) -> Result<(), VerbError> {
        let written = key.sign_release(&self.to).map_err(|e| VerbError::failed("sign", e.to_string()))?;
        let (to, id) = (self.to.display(), key.id());
        console.note(&if written {
            format!("signed {to} with the key {id}")
        } else {
            format!("{to} is already signed with the key {id}")
        });
        Ok(())
    }

    /// Claims the target, and waits while another process writes there.
    fn claim(
        &self,
        guarded: &[GuardedPath],
        common: &CommonArgs,
        cancel: &AtomicBool,
        console: &Console,
    ) -> Result<ReleaseTarget, VerbError> {
        let (claim, wait) = (lock_claim(common), !common.no_wait);
        let claim = TargetClaim { replace: self.replace, guarded, claim, wait, cancel };
        let target = ReleaseTarget::claim(&self.to, claim, &mut |holder| {
            let what = format!("{} is in use by {holder}", self.to.display());
            console.report(&UserMessage::waiting("locked", what));
        });
        let mut target = target.map_err(|error| release_problem(error, console))?;
        report_notes(&mut target, console);
        Ok(target)
    }

    /// The paths that the target must not be and must not contain.
    fn guarded(&self, recipes: &[Recipe], common: &CommonArgs) -> Vec<GuardedPath> {
        let guard =
            |what: &str, path: &Path, whole| GuardedPath { what: what.into(), path: path.into(), whole };
        let mut guarded =
            vec![guard("the store", &common.store, true), guard("the current folder", Path::new("."), false)];
        guarded.extend(common.environment.home().map(|home| guard("your home folder", home, false)));
        // What is not there yet holds nothing.
        let is_there = self.to.symlink_metadata().is_ok();
        for recipe in recipes {
            if let Some(captured) = recipe.source.captured() {
                // A source that contains its recipe or the current folder may contain the release
                // too: users often work inside their dataset.
                let whole =
                    !holds(&captured.path, &recipe.meta.file.path) && !holds(&captured.path, Path::new("."));
                guarded.push(guard("the source of a scene", &captured.path, whole));
            }
            let named = if is_there { named_by(recipe) } else { Vec::new() };
            guarded.extend(named.into_iter().map(|(what, path)| guard(what, &path, false)));
        }
        guarded
    }

    /// Prints what was written.
    fn report(&self, written: &WrittenRelease, target: &mut ReleaseTarget, console: &Console) {
        report_notes(target, console);
        for warning in &written.warnings {
            console.note(&format!("warning: {warning}"));
        }
        for scene in &written.held_back {
            let message = UserMessage::error("held-back", format!("{} is held back", scene.id));
            console.report(&scene.reasons().into_iter().fold(message, UserMessage::because));
        }
        let (to, mb) = (self.to.display(), written.bytes as f64 * 1e-6);
        let WrittenRelease { scenes, files, .. } = written;
        console.note(&if written.stood {
            format!("{to} is up to date: {scenes} scene(s), {files} files, {mb:.1} MB")
        } else {
            format!("released {scenes} scene(s) to {to}: {files} files, {mb:.1} MB")
        });
        console.result(&json!({
            "release": path(&self.to), "files": written.files, "bytes": written.bytes, "written": !written.stood,
            "held_back": written.held_back.iter().map(|scene| &scene.id).collect::<Vec<_>>(),
        }));
    }
}

/// Reads a secret key, and asks for its password on the terminal if it has one.
fn read_key(path: &Path) -> Result<SigningKey, VerbError> {
    let mut password = || {
        rpassword::prompt_password(format!("Password of {}: ", escape::path(path)))
            .map_err(|e| format!("it has a password, and there is no terminal to ask on ({e})"))
    };
    SigningKey::read(path, &mut password).map_err(|e| {
        VerbError::usage("sign", e.to_string())
            .help("minisign -G makes a pair of keys; with -W the secret key has no password")
    })
}

/// Returns true if `path` is `folder` or lies in it.
fn holds(folder: &Path, path: &Path) -> bool {
    let folder = folder.canonicalize();
    folder.is_ok_and(|folder| path.canonicalize().is_ok_and(|path| path.starts_with(folder)))
}

/// The files and folders of a recipe: its own file, its defaults, the files of its source, and its
/// Gaussians.
fn named_by(recipe: &Recipe) -> Vec<(&'static str, PathBuf)> {
    let mut named = vec![("a recipe", recipe.meta.file.path.clone())];
    named.extend(recipe.meta.file.defaults.iter().map(|path| ("a recipe's defaults", path.clone())));
    if let Some(captured) = recipe.source.captured() {
        named.extend(captured.folders().into_iter().map(|path| ("files of a scene's source", path)));
        let tree = captured.solving.iter().filter_map(|solving| solving.vocabulary.clone());
        named.extend(tree.map(|path| ("the vocabulary tree of a scene", path)));
    }
    match &recipe.reconstruct {
        Some(ReconstructMethod::Given(path) | ReconstructMethod::Changing(path, _)) => {
            named.push(("the Gaussians of a scene", path.clone()))
        }
        Some(ReconstructMethod::Newest(path)) => named.push(("the model of a scene", path.clone())),
        Some(ReconstructMethod::Command(command)) => {
            named.extend(command.files.values().map(|path| ("a file of a training", path.clone())));
        }
        Some(ReconstructMethod::Builtin(_)) | None => {}
    }
    named
}

/// The root that keeps the steps, the exports and the verdicts of a release from `gc`.
fn root(target: &ReleaseTarget, summary: &RunSummary, written: &WrittenRelease) -> ReleaseRoot {
    let steps = summary.products.values().map(|product| product.key);
    let keys = steps.chain(written.records.iter().copied()).collect();
    ReleaseRoot { release: target.path().to_owned(), keys }
}

fn report_notes(target: &mut ReleaseTarget, console: &Console) {
    for note in target.take_notes() {
        console.report(&UserMessage::warning("kept", note));
    }
}

fn refuse_stale(plan: &Plan, store: &Store) -> Result<(), VerbError> {
    let assessed = assess_plan(plan, store)?;
    let mut stale = plan.steps().iter().zip(&assessed).filter(|(_, a)| a.action != StepAction::Keep);
    let Some((first, _)) = stale.next() else { return Ok(()) };
    let (count, scene, step) = (stale.count() + 1, plan.scene_of(first), &first.name);
    let message = format!("{count} steps are not up to date, the first is {scene}/{step}");
    Err(VerbError::failed("stale", message).help("run gs2e build, or leave out --no-build"))
}

/// The ways out after failed checks; `sound` is the number of scenes without one.
fn check_help(failed: &[Finding], sound: usize) -> String {
    let checks: BTreeSet<&str> = failed.iter().map(|finding| finding.check.as_str()).collect();
    let waiver = |check: &str| format!("{{ check: {check}, because: \"{REASON}\" }}");
    let waivers: Vec<String> = checks.into_iter().filter(|check| is_waivable(check)).map(waiver).collect();
    let mut ways = vec!["fix the cause that each finding names".to_owned()];
    if sound > 0 {
        let scenes = if sound == 1 { "scene".to_owned() } else { format!("{sound} scenes") };
        ways.push(format!("or release the other {scenes} with --partial"));
    }
    if !waivers.is_empty() {
        ways.push(format!("or accept it in the recipe: checks: {{ waive: [{}] }}", waivers.join(", ")));
    }
    ways.join("; ")
}

/// An export of `release.yaml` that cannot be made.
fn include_problem(refusal: IncludeRefusal) -> VerbError {
    let said = format!("{refusal}; nothing was released");
    let problem = match refusal.kind {
        IncludeFailure::Refused => {
            VerbError::usage("unmet", said).help("change `include:` in release.yaml, or the recipe")
        }
        IncludeFailure::Failed | IncludeFailure::Unwritten => VerbError::failed("not-written", said),
        IncludeFailure::Interrupted => VerbError::interrupted(said),
    };
    problem.details(refusal.details)
}

fn release_problem(error: ReleaseError, console: &Console) -> VerbError {
    let message = error.to_string();
    match error {
        ReleaseError::Checks { failed, sound } => {
            // People have seen these findings at the end of the build.
            check::records(&failed, console);
            VerbError::fault("check-failed", format!("not released: {message}")).help(check_help(&failed, sound))
        }
        ReleaseError::Foreign { .. } => {
            VerbError::usage("foreign-folder", message).help(
                "choose another folder; --replace moves this one aside and keeps the files that gs2e did not write",
            )
        }
        ReleaseError::Leaks(_) => VerbError::fault("split-leak", format!("{message}; nothing was released"))
            .help("give the recipes of related scenes the same `group:`, with splits by object"),
        ReleaseError::Nothing => VerbError::usage("nothing-to-release", message)
            .help("every scene is on the takedown list; an existing release is left unchanged and may still contain them"),
        ReleaseError::Gather(GatherError::NotBuilt { .. }) => VerbError::failed("not-built", message),
        ReleaseError::Include(refusal) => include_problem(refusal),
        ReleaseError::Interrupted => VerbError::interrupted(message),
        ReleaseError::Recheck(_) => VerbError::failed("unreadable", message),
        ReleaseError::Store(error) => error.into(),
        _ if is_full(&error) => VerbError::failed("disk-full", format!("no space: {message}")).help(FULL),
        _ => VerbError::failed("release", message),
    }
}
