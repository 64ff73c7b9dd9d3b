//! `gs2e release`: the whole job, from recipes to the tree that people download.

use super::build::{Building, Care, exit, open, tell_end};
use super::console::{Console, path};
use super::problem::{Exit, FULL, Problem};
use super::{Common, Targets, check};
use crate::plan::Plan;
use crate::plan::assess::{Action, assess};
use crate::recipe;
use crate::release::{self, Beside, GatherError, Options, ReleaseError};
use crate::run::Summary;
use crate::store::space::is_full;
use crate::store::{Root, Store};
use serde_json::json;
use std::path::{Path, PathBuf};
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
    /// Replace a folder that is no release, or holds what its release does not list
    #[arg(long)]
    replace: bool,
    /// Copy files instead of linking them to the store
    #[arg(long)]
    copy: bool,
    #[command(flatten)]
    care: Care,
}

impl Release {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        let chosen = &common.renderers()?;
        let recipes = recipe::read_all(&self.targets.recipes)?;
        let mut beside = Beside::read(&self.targets.recipes)?;
        let (recipes, taken_down) = beside.takedown.keep(recipes);
        beside.taken_down = taken_down.scenes;
        super::takedown::tell(taken_down, console);
        let started = Instant::now();
        let store = open(common, &self.care, console)?;
        self.keep_ours(common)?;
        let plan = Plan::new(recipes, &chosen.asking(&store));
        if self.no_build {
            refuse_stale(&plan, &store)?;
        }
        let building =
            Building { settled: 0, targets: &self.targets, chosen, common, care: &self.care, console };
        let (plan, summary) = building.build(plan, &store)?;
        tell_end(&summary, started.elapsed().as_secs_f64(), console);
        let built = exit(&summary);
        if built != Exit::Done {
            return Ok(built);
        }
        let options = Options { replace: self.replace, copy: self.copy };
        let written = release::write(&self.to, &plan, &summary, &store, &beside, options);
        store.flush()?;
        let written = written.map_err(|error| problem(error, console))?;
        self.keep_its_steps(&summary, &store)?;
        for warning in &written.warnings {
            console.say(&format!("warning: {warning}"));
        }
        let to = self.to.display();
        let [mb, files] = [written.bytes as f64 * 1e-6, written.files as f64];
        console.say(&format!("released {} scene(s) to {to}: {files} files, {mb:.1} MB", written.scenes));
        if console.json {
            console.result(
                &json!({ "release": path(&self.to), "files": written.files, "bytes": written.bytes }),
            );
        }
        Ok(Exit::Done)
    }
}

impl Release {
    /// Has `gc` leave what the release was made from.
    fn keep_its_steps(&self, summary: &Summary, store: &Store) -> Result<(), Problem> {
        let release = self
            .to
            .canonicalize()
            .map_err(|e| Problem::failed("release", format!("failed to find {}: {e}", self.to.display())))?;
        let keys = summary.products.values().map(|product| product.key).collect();
        Ok(store.write_root(&Root { release, keys })?)
    }

    /// Refuses a target that holds the store or the place we work in: replacing it would delete them.
    fn keep_ours(&self, common: &Common) -> Result<(), Problem> {
        let Ok(target) = self.to.canonicalize() else { return Ok(()) };
        for (what, path) in [("the store", common.store.as_path()), ("the current folder", Path::new("."))] {
            if path.canonicalize().is_ok_and(|path| path.starts_with(&target)) {
                let message =
                    format!("{} holds {what}, and a release replaces its folder", self.to.display());
                return Err(Problem::usage("foreign-folder", message).help("choose another folder"));
            }
        }
        Ok(())
    }
}

fn refuse_stale(plan: &Plan, store: &Store) -> Result<(), Problem> {
    let assessed = assess(plan, store)?;
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

fn problem(error: ReleaseError, console: &Console) -> Problem {
    let message = error.to_string();
    match error {
        ReleaseError::Checks(findings) => {
            check::show_failed(&findings, console);
            Problem::fault("check-failed", format!("{message}; nothing was released"))
                .help("mend it, or accept it in the recipe: checks: { waive: [{ check, because }] }")
        }
        ReleaseError::Foreign { .. } => {
            Problem::usage("foreign-folder", message).help("choose another folder, or say --replace")
        }
        ReleaseError::Leaks(_) => Problem::fault("split-leak", format!("{message}; nothing was released"))
            .help("have the recipes of what belongs together name one `group:`, with splits by object"),
        ReleaseError::Nothing => Problem::usage("nothing-to-release", message)
            .help("every scene is on the takedown list; a release that is there is left as it is, and may hold them"),
        ReleaseError::Gather(GatherError::NotBuilt { .. }) => Problem::failed("not-built", message),
        ReleaseError::Store(error) => error.into(),
        _ if is_full(&error) => Problem::failed("disk-full", format!("no space: {message}")).help(FULL),
        _ => Problem::failed("release", message),
    }
}
