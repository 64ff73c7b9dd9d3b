//! `gs2e build`: makes what is stale, and nothing else.

use super::console::Console;
use super::message::{Level, Message};
use super::problem::{Exit, Problem};
use super::progress::Progress;
use super::{Common, Targets, clock, failure, on_interrupt};
use crate::plan::Plan;
use crate::plan::assess::{Action, assess};
use crate::recipe::{self, Recipe};
use crate::run::{self, Options, Summary};
use crate::sensor::Sensor;
use crate::sensor::voltmeter::screen::Noise;
use crate::stage::StepId;
use crate::store::{Access, Claim, Opening, Store};
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `build`.
#[derive(Debug, clap::Args)]
pub(super) struct Build {
    #[command(flatten)]
    targets: Targets,
}

impl Build {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        let plan = read_plan(&self.targets.recipes)?;
        let store = open(common, console)?;
        let (summary, seconds) = build(&plan, &self.targets, &store, common, console)?;
        tell_end(&summary, seconds, console);
        Ok(exit(&summary))
    }
}

/// Reads recipes into a plan.
pub(super) fn read_plan(recipes: &[PathBuf]) -> Result<Plan, Problem> {
    Ok(Plan::new(recipe::read_all(recipes)?))
}

/// Says once for each sensor what it does by itself.
fn tell_sensors(plan: &Plan, console: &Console) -> Result<(), Problem> {
    let mut told: Vec<&Sensor> = Vec::new();
    for recipe in plan.scenes() {
        if !told.contains(&&recipe.sensor) {
            told.push(&recipe.sensor);
            tell_sensor(recipe, console)?;
        }
    }
    Ok(())
}

fn tell_sensor(recipe: &Recipe, console: &Console) -> Result<(), Problem> {
    let scene = &recipe.scene;
    let screening = recipe.sensor.screen(recipe.rate);
    let screening = screening.map_err(|e| Problem::usage("sensor", format!("{scene}: {e}")))?;
    let [on, off] = screening.contrast;
    console
        .say(&format!("sensor of {scene}: one event is a step of ln(L + k2) by {on:.4} up, {off:.4} down"));
    for n in screening.noise {
        let share = n.on_share.map_or(String::new(), |share| format!(", {:.1} % ON", 100.0 * share));
        let Noise { grey, leak_hz, total_hz, .. } = n;
        console.say(&format!(
            "  at grey {grey:3}: leak {leak_hz:.4} Hz, leak and noise {total_hz:.4} Hz{share}"
        ));
    }
    for warning in &screening.warnings {
        console.say(&format!("warning: {scene}: {warning}"));
    }
    Ok(())
}

/// Opens the store for writing, waiting for another process where there is one.
pub(super) fn open(common: &Common, console: &Console) -> Result<Store, Problem> {
    let access = if common.no_wait { Access::WriteNow } else { Access::Write };
    let claim = Claim { command: common.command.clone(), since: clock::now(), ..Claim::default() };
    let store = Store::open(&common.store, Opening { claim, ..access.into() }, &mut |holder| {
        let what = format!("{} is in use by {holder}", common.store.display());
        console.tell(&Message::new(Level::Waiting, "locked", what));
    })?;
    tell_notices(&store, console);
    Ok(store)
}

/// What the store had to mend since it was last asked.
pub(super) fn tell_notices(store: &Store, console: &Console) {
    for notice in store.take_notices() {
        console.tell(&Message::new(Level::Warning, "state-rebuilt", notice));
    }
}

/// Builds what is stale; the seconds are for people.
pub(super) fn build(
    plan: &Plan,
    targets: &Targets,
    store: &Store,
    common: &Common,
    console: &Console,
) -> Result<(Summary, f64), Problem> {
    let started = Instant::now();
    // What is missing or unreadable shall be known before anything runs, unless the user wants the rest done first.
    let idle = !common.keep_going && assess(plan, store)?.iter().all(|a| a.action == Action::Keep);
    if !idle {
        tell_sensors(plan, console)?;
    }
    let cores = common.jobs.map_or_else(all_cores, usize::from);
    let options = Options { cores, keep_going: common.keep_going };
    let cancel = on_interrupt()?;
    let progress = Progress::new(plan, store, console, cores);
    let summary = run::run(plan, store, options, &cancel, &progress);
    let failed = progress.close();
    tell_notices(store, console);
    if common.keep_going && !failed.is_empty() {
        console.say(&failure::again(&failed, &to_find(targets, common)));
    }
    let summary = summary?;
    note_recipes(plan, store, &summary)?;
    Ok((summary, started.elapsed().as_secs_f64()))
}

/// The options by which another verb finds the same recipes and store.
fn to_find(targets: &Targets, common: &Common) -> String {
    let mut options = String::new();
    if targets.recipes != [Path::new(Targets::DEFAULT)] {
        targets.recipes.iter().for_each(|path| options.push_str(&format!(" --recipes {}", path.display())));
    }
    if common.store != Path::new(Common::STORE) {
        options.push_str(&format!(" --store {}", common.store.display()));
    }
    options
}

/// Remembers with which recipe each scene was built that now is whole.
fn note_recipes(plan: &Plan, store: &Store, summary: &Summary) -> Result<(), Problem> {
    let mut whole = vec![true; plan.scenes().len()];
    for (id, step) in plan.steps().iter().enumerate() {
        whole[step.scene] &= summary.outputs.contains_key(&StepId(id));
    }
    for (recipe, _) in plan.scenes().iter().zip(whole).filter(|(_, whole)| *whole) {
        store.note_recipe(&recipe.scene, &recipe.merged.to_string());
    }
    Ok(store.flush()?)
}

fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(1, NonZero::get)
}

fn last_line(summary: &Summary, seconds: f64) -> String {
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

/// The last line, and for programs that a run was cut short.
pub(super) fn tell_end(summary: &Summary, seconds: f64, console: &Console) {
    let line = last_line(summary, seconds);
    if summary.interrupted && console.json {
        console.result(&Message::new(Level::Error, "interrupted", line.as_str()).to_json());
    }
    console.say(&line);
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
