//! `gs2e release`: the whole job, from recipes to the tree that people download.

use super::build::{Building, Care, exit_kind, open_store, tell_end};
use super::console::{Console, path};
use super::message::{Level, Message};
use super::problem::{Exit, FULL, Problem};
use super::{Common, Targets, check, clock, on_interrupt};
use crate::plan::Plan;
use crate::plan::assess::{Action, assess_plan};
use crate::recipe::{self, Recipe, Reconstruct, Source};
use crate::release::{
    self, Beside, BuiltPlan, GatherError, GuardedPath, Link, ReleaseError, ReleaseTarget, TargetClaim,
    Written,
};
use crate::run::Summary;
use crate::store::space::is_full;
use crate::store::{Claim, Root, Store};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Arguments of `release`.
#[derive(Debug, clap::Args)]
pub(super) struct Release {
    #[command(flatten)]
    targets: Targets,
    /// Folder of the release
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    /// Refuse, instead of building what is stale
    #[arg(long)]
    no_build: bool,
    /// Replace a changed release or another folder too; what gs2e did not write is kept next to it
    #[arg(long)]
    replace: bool,
    /// How the release's files get their bytes from the store
    #[arg(long, value_enum, value_name = "HOW", default_value_t = Linking::Reflink)]
    link: Linking,
    /// The same as `--link copy`.
    #[arg(long, hide = true, conflicts_with = "link")]
    copy: bool,
    #[command(flatten)]
    care: Care,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Linking {
    /// Share blocks until one side is changed, where the file system can; else copy
    Reflink,
    /// Second names of the store's files: a change to one changes both
    Hard,
    /// Copy every byte
    Copy,
}

impl Release {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        let chosen = &common.renderers()?;
        let recipes = recipe::read_all(&self.targets.recipes)?;
        let mut beside = Beside::read(&self.targets.recipes)?;
        let guarded = self.guarded(&recipes, common);
        let (recipes, taken_down) = beside.takedown.keep(recipes);
        beside.taken_down = taken_down.scenes;
        super::takedown::show_takedown(taken_down, console);
        let started = Instant::now();
        let store = open_store(common, &self.care, console)?;
        let cancel = &on_interrupt()?;
        let mut target = self.claim(&guarded, common, cancel, console)?;
        let plan = Plan::new(recipes, &chosen.asking(&store));
        if self.no_build {
            refuse_stale(&plan, &store)?;
        }
        let building =
            Building { settled: 0, targets: &self.targets, chosen, common, care: &self.care, console };
        let (plan, summary) = building.build(plan, &store)?;
        tell_end(&summary, started.elapsed().as_secs_f64(), console);
        let built = exit_kind(&summary);
        if built != Exit::Done {
            return Ok(built);
        }
        let built = BuiltPlan { plan: &plan, summary: &summary, store: &store, beside: &beside };
        let written = release::write_release(&mut target, built, self.linking(), cancel);
        store.flush()?;
        let written = written.map_err(|error| release_problem(error, console))?;
        store.write_root(&root(&target, &summary))?;
        self.tell(&written, &mut target, console);
        Ok(Exit::Done)
    }

    fn linking(&self) -> Link {
        match self.link {
            _ if self.copy => Link::Copy,
            Linking::Reflink => Link::Reflink,
            Linking::Hard => Link::Hard,
            Linking::Copy => Link::Copy,
        }
    }

    /// Claims the target, waiting for another process that writes there.
    fn claim(
        &self,
        guarded: &[GuardedPath],
        common: &Common,
        cancel: &AtomicBool,
        console: &Console,
    ) -> Result<ReleaseTarget, Problem> {
        let claim = Claim { command: common.command.clone(), since: clock::utc_now(), ..Claim::default() };
        let claim = TargetClaim { replace: self.replace, guarded, claim, wait: !common.no_wait, cancel };
        let target = ReleaseTarget::claim(&self.to, claim, &mut |holder| {
            let what = format!("{} is in use by {holder}", self.to.display());
            console.tell(&Message::new(Level::Waiting, "locked", what));
        });
        let mut target = target.map_err(|error| release_problem(error, console))?;
        tell_notes(&mut target, console);
        Ok(target)
    }

    /// What the target may neither be nor hold.
    fn guarded(&self, recipes: &[Recipe], common: &Common) -> Vec<GuardedPath> {
        let guard =
            |what: &str, path: &Path, whole| GuardedPath { what: what.into(), path: path.into(), whole };
        let mut guarded =
            vec![guard("the store", &common.store, true), guard("the current folder", Path::new("."), false)];
        guarded
            .extend(std::env::var_os("HOME").map(|home| guard("your home folder", Path::new(&home), false)));
        // What is not there yet holds nothing.
        let is_there = self.to.symlink_metadata().is_ok();
        for recipe in recipes {
            if let Source::Captured(captured, _) = &recipe.source {
                let whole =
                    !holds(&captured.path, &recipe.file.path) && !holds(&captured.path, Path::new("."));
                guarded.push(guard("the source of a scene", &captured.path, whole));
            }
            let named = if is_there { named_by(recipe) } else { Vec::new() };
            guarded.extend(named.into_iter().map(|(what, path)| guard(what, &path, false)));
        }
        guarded
    }

    /// Says what was written.
    fn tell(&self, written: &Written, target: &mut ReleaseTarget, console: &Console) {
        tell_notes(target, console);
        for warning in &written.warnings {
            console.say(&format!("warning: {warning}"));
        }
        let (to, mb) = (self.to.display(), written.bytes as f64 * 1e-6);
        let Written { scenes, files, .. } = written;
        console.say(&if written.stood {
            format!("{to} is up to date: {scenes} scene(s), {files} files, {mb:.1} MB")
        } else {
            format!("released {scenes} scene(s) to {to}: {files} files, {mb:.1} MB")
        });
        if console.json {
            console.result(&json!({
                "release": path(&self.to), "files": written.files, "bytes": written.bytes, "written": !written.stood,
            }));
        }
    }
}

/// Whether `path` is or lies in `folder`.
fn holds(folder: &Path, path: &Path) -> bool {
    let folder = folder.canonicalize();
    folder.is_ok_and(|folder| path.canonicalize().is_ok_and(|path| path.starts_with(folder)))
}

/// The files and folders that a recipe is and names: itself, its defaults, the files of its source, its
/// Gaussians.
fn named_by(recipe: &Recipe) -> Vec<(&'static str, PathBuf)> {
    let mut named = vec![("a recipe", recipe.file.path.clone())];
    named.extend(recipe.file.defaults.iter().map(|path| ("a recipe's defaults", path.clone())));
    if let Source::Captured(captured, _) = &recipe.source {
        named.extend(captured.folders().into_iter().map(|path| ("files of a scene's source", path)));
    }
    match &recipe.reconstruct {
        Some(Reconstruct::Given(path)) => named.push(("the Gaussians of a scene", path.clone())),
        Some(Reconstruct::Newest(path)) => named.push(("the model of a scene", path.clone())),
        Some(Reconstruct::Command(command)) => {
            named.extend(command.files.values().map(|path| ("a file of a training", path.clone())));
        }
        None => {}
    }
    named
}

/// What `gc` leaves for a release: the steps that it was made from.
fn root(target: &ReleaseTarget, summary: &Summary) -> Root {
    let keys = summary.products.values().map(|product| product.key).collect();
    Root { release: target.path().to_owned(), keys }
}

fn tell_notes(target: &mut ReleaseTarget, console: &Console) {
    for note in target.take_notes() {
        console.tell(&Message::new(Level::Warning, "kept", note));
    }
}

fn refuse_stale(plan: &Plan, store: &Store) -> Result<(), Problem> {
    let assessed = assess_plan(plan, store)?;
    let stale: Vec<String> = plan
        .steps()
        .iter()
        .zip(&assessed)
        .filter(|(_, a)| a.action != Action::Keep)
        .map(|(step, _)| format!("{}/{}", plan.scene_of(step), step.name))
        .collect();
    match stale.first() {
        None => Ok(()),
        Some(first) => {
            let message = format!("{} steps are not up to date, the first is {first}", stale.len());
            Err(Problem::failed("stale", message).help("gs2e build, or leave out --no-build"))
        }
    }
}

fn release_problem(error: ReleaseError, console: &Console) -> Problem {
    let message = error.to_string();
    match error {
        ReleaseError::Checks(findings) => {
            check::show_failed(&findings, console);
            Problem::fault("check-failed", format!("{message}; nothing was released"))
                .help("mend it, or accept it in the recipe: checks: { waive: [{ check, because }] }")
        }
        ReleaseError::Foreign { .. } => {
            Problem::usage("foreign-folder", message).help(
                "choose another folder; --replace moves this one aside, and keeps what gs2e did not write",
            )
        }
        ReleaseError::Leaks(_) => Problem::fault("split-leak", format!("{message}; nothing was released"))
            .help("have the recipes of what belongs together name one `group:`, with splits by object"),
        ReleaseError::Nothing => Problem::usage("nothing-to-release", message)
            .help("every scene is on the takedown list; a release that is there is left as it is, and may hold them"),
        ReleaseError::Gather(GatherError::NotBuilt { .. }) => Problem::failed("not-built", message),
        ReleaseError::Interrupted => {
            Problem::from_message(Exit::Interrupted, Message::new(Level::Error, "interrupted", message))
        }
        ReleaseError::Store(error) => error.into(),
        _ if is_full(&error) => Problem::failed("disk-full", format!("no space: {message}")).help(FULL),
        _ => Problem::failed("release", message),
    }
}
