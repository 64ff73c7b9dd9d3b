//! `gs2e plan`: what `build` would run, may run and leave alone, each with its reason.

use super::build::{option_tag, store_options};
use super::console::{Console, path};
use super::problem::{Exit, Problem};
use super::{Common, Targets};
use crate::plan::Plan;
use crate::plan::assess::{Action, Assessment, Reason, assess_plan};
use crate::plan::past::past_costs;
use crate::plan::survey::{Settled, Survey, survey_recipes};
use crate::store::record::Output;
use crate::store::{Access, Digest, Key, Opening, Store};
use serde::Serialize;
use serde_json::json;

/// Arguments of `plan`.
#[derive(Debug, clap::Args)]
pub(super) struct Show {
    #[command(flatten)]
    targets: Targets,
    /// Read every up-to-date file, instead of trusting its metadata
    #[arg(long)]
    verify: bool,
    /// Show time, disk and memory of what would run, estimated from earlier runs
    #[arg(long)]
    estimate: bool,
}

/// A step as it is shown.
#[derive(Serialize)]
struct Row<'a> {
    scene: &'a str,
    step: &'a str,
    action: Action,
    reason: &'a Reason,
    key: Option<Key>,
    outputs: Vec<File<'a>>,
}

/// A file of a step as programs are told of it.
#[derive(Debug, Serialize)]
pub(super) struct File<'a> {
    role: &'a str,
    digest: Digest,
    path: String,
}

impl Show {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        let opening = Opening { verify: self.verify, ..store_options(common, Access::Read) };
        let store = Store::open(&common.store, opening, &mut |_| {})?;
        let chosen = common.renderers()?;
        let surveyed =
            survey_recipes(&self.targets.recipes, &chosen.knowing(&store), &store, &option_tag(&chosen));
        let Survey { settled, plan, taken_down } = surveyed?;
        let assessed = assess_plan(&plan, &store)?;
        // What goes to programs is one array.
        super::build::tell_notices(&store, &console.for_people());
        super::takedown::show_takedown(taken_down, &console.for_people());
        if self.estimate {
            estimate_run(&plan, &assessed, &store, common, console)?;
            return Ok(Exit::Done);
        }
        let rows = plan_rows(&plan, &assessed, &settled, &store);
        if console.json {
            console.large_result(&rows);
        } else {
            show_rows(&rows, console);
        }
        Ok(Exit::Done)
    }
}

/// All steps, sorted by scene.
fn plan_rows<'a>(
    plan: &'a Plan,
    assessed: &'a [Assessment],
    settled: &'a [Settled],
    store: &Store,
) -> Vec<Row<'a>> {
    let known = settled.iter().flat_map(|scene| {
        scene.steps.iter().map(|step| Row {
            scene: &scene.scene,
            step: &step.name,
            action: Action::Keep,
            reason: &Reason::UpToDate,
            key: Some(step.key),
            outputs: output_files(store, &step.outputs),
        })
    });
    let others = plan.steps().iter().zip(assessed).map(|(step, a)| Row {
        scene: plan.scene_of(step),
        step: &step.name,
        action: a.action,
        reason: &a.reason,
        key: a.key,
        outputs: output_files(store, a.outputs.as_deref().unwrap_or_default()),
    });
    let mut rows: Vec<Row<'a>> = known.chain(others).collect();
    // Stable: the steps of a scene stay in the order of the plan.
    rows.sort_by(|a, b| a.scene.cmp(b.scene));
    rows
}

/// Files of a step as programs are told of them.
pub(super) fn output_files<'a>(store: &Store, outputs: &'a [Output]) -> Vec<File<'a>> {
    let file = |o: &'a Output| File { role: &o.name, digest: o.digest, path: path(store.path_of(&o.digest)) };
    outputs.iter().map(file).collect()
}

fn show_rows(rows: &[Row<'_>], console: &Console) {
    let line = |row: &Row<'_>| {
        let action = match row.action {
            Action::Run => "run",
            Action::MayRun => "may run",
            Action::Keep => "keep",
        };
        format!("{action:7}  {}/{}  {}", row.scene, row.step, reason_words(row.reason))
    };
    rows.iter().for_each(|row| console.print(&line(row)));
    let count = |action| rows.iter().filter(|row| row.action == action).count();
    let [run, may, keep] = [Action::Run, Action::MayRun, Action::Keep].map(count);
    console.say(&format!("{run} to run, {may} may run, {keep} up to date"));
}

/// What would run, in sum.
#[derive(Debug, Default, Serialize)]
struct Estimate {
    /// Steps that will run, and those that may.
    steps: usize,
    /// Those of which nothing like them ran before: they are in none of the sums.
    unknown: usize,
    core_seconds: f64,
    /// Wall time at best: the work shared evenly among the cores.
    seconds: f64,
    bytes: f64,
    /// Of the step that needs most.
    memory: f64,
}

fn estimate_run(
    plan: &Plan,
    assessed: &[Assessment],
    store: &Store,
    common: &Common,
    console: &Console,
) -> Result<(), Problem> {
    let mut sum = Estimate::default();
    let past = past_costs(plan, store)?;
    for (a, past) in assessed.iter().zip(past) {
        if a.action == Action::Keep {
            continue;
        }
        sum.steps += 1;
        let Some(past) = past else {
            sum.unknown += 1;
            continue;
        };
        sum.core_seconds += past.core_seconds;
        sum.bytes += past.bytes;
        sum.memory = sum.memory.max(past.memory);
    }
    let cores = common.cores();
    sum.seconds = sum.core_seconds / cores as f64;
    if console.json {
        console.result(&json!(sum));
        return Ok(());
    }
    let Estimate { steps, unknown, core_seconds, seconds, bytes, memory } = sum;
    console.print(&format!("{steps} steps would run, or may: about {core_seconds:.1} core seconds, {seconds:.1} s on {cores} cores"));
    console.print(&format!(
        "{:.1} MB of outputs; {:.0} MB of memory for the largest step",
        bytes * 1e-6,
        memory * 1e-6
    ));
    if unknown > 0 {
        console.print(&format!("{unknown} of them not counted: no step of their kind ran before"));
    }
    Ok(())
}

/// A reason for people.
pub(super) fn reason_words(reason: &Reason) -> String {
    let was = |text: &str| if text.is_empty() { "absent".to_owned() } else { text.to_owned() };
    match reason {
        Reason::UpToDate => "up to date".to_owned(),
        Reason::InputMayChange { step } => format!("behind {step}"),
        Reason::NotAsked { program } => format!("the version of {program} is not known: a build asks it"),
        Reason::NoRecord => "never made".to_owned(),
        Reason::InputChanged { name, old, new } => {
            let brief = |digest: &str| was(&digest.chars().take(12).collect::<String>());
            format!("input `{name}` changed: {} -> {}", brief(old), brief(new))
        }
        Reason::ParamChanged { name, old, new } => format!("`{name}` changed: {} -> {}", was(old), was(new)),
        Reason::Revision { old, new } => format!("revision {} -> {}", was(old), was(new)),
        Reason::Class { old, new } => format!("numerical class {} -> {}", was(old), was(new)),
        Reason::BlobMissing { digest } => format!("output {} is gone", &digest[..12]),
        Reason::BlobAltered { digest } => format!("output {} was altered", &digest[..12]),
    }
}
