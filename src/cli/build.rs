//! `gs2e build`: makes what is stale, and nothing else.

use super::console::Console;
use super::problem::{Exit, Problem};
use super::progress::Progress;
use super::{Common, Targets, on_interrupt};
use crate::plan::Plan;
use crate::plan::assess::assess;
use crate::run::{self, Options, Summary};
use crate::store::{Access, Store};
use crate::{recipe, sensor};
use std::num::NonZero;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `build`.
#[derive(Debug, clap::Args)]
pub(super) struct Build {
    #[command(flatten)]
    targets: Targets,
}

impl Build {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        let plan = read_plan(&self.targets.recipes, console)?;
        let store = open(common, console)?;
        let (summary, seconds) = build(&plan, &store, common, console)?;
        console.say(&last_line(&summary, seconds));
        Ok(exit(&summary))
    }
}

/// Reads recipes into a plan, and says what they make a careful reader wonder at.
pub(super) fn read_plan(recipes: &[PathBuf], console: &Console) -> Result<Plan, Problem> {
    let recipes = recipe::find::read_all(recipes)?;
    for recipe in &recipes {
        for warning in sensor::warnings(&recipe.sensor, recipe.rate) {
            console.say(&format!("warning: {}: {warning}", recipe.scene));
        }
    }
    Ok(Plan::new(recipes))
}

/// Opens the store for writing, waiting for another process where there is one.
pub(super) fn open(common: &Common, console: &Console) -> Result<Store, Problem> {
    let access = if common.no_wait { Access::WriteNow } else { Access::Write };
    let store = Store::open(&common.store, access, &mut |holder| {
        console.insist(&format!("waiting: {} is in use by {holder}", common.store.display()));
    })?;
    for notice in store.notices() {
        console.insist(&format!("warning: {notice}"));
    }
    Ok(store)
}

/// Builds what is stale; the seconds are for people.
pub(super) fn build(
    plan: &Plan,
    store: &Store,
    common: &Common,
    console: &Console,
) -> Result<(Summary, f64), Problem> {
    let started = Instant::now();
    // What is missing or unreadable shall be known before anything runs, unless the user wants the rest done first.
    if !common.keep_going {
        assess(plan, store)?;
    }
    let cores = common.jobs.map_or_else(all_cores, usize::from);
    let options = Options { cores, keep_going: common.keep_going };
    let cancel = on_interrupt()?;
    let progress = Progress::new(plan, console);
    let summary = run::run(plan, store, options, &cancel, &progress);
    progress.close();
    Ok((summary?, started.elapsed().as_secs_f64()))
}

fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(1, NonZero::get)
}

pub(super) fn last_line(summary: &Summary, seconds: f64) -> String {
    let Summary { made, kept, failures, unreached, interrupted, .. } = summary;
    if *interrupted {
        let (finished, all) = (made + kept, made + kept + failures.len() + unreached);
        return format!(
            "interrupted: {finished} of {all} steps are finished and kept; run the same command to go on"
        );
    }
    let mut text = format!("made {made}, up to date {kept}, failed {}", failures.len());
    if *unreached > 0 {
        text.push_str(&format!(", not reached {unreached}"));
    }
    format!("{text}; {seconds:.2} s")
}

pub(super) fn exit(summary: &Summary) -> Exit {
    if summary.interrupted {
        Exit::Interrupted
    } else if summary.failures.is_empty() {
        Exit::Done
    } else {
        Exit::Failed
    }
}
