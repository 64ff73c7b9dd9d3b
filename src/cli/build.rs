//! `gs2e build`: makes the stale steps, and no others.

mod end;
mod store;

use end::report_evicted;
pub(super) use end::{exit_kind, report_end};

pub(super) use store::{lock_claim, open_store, option_tag, read_store, report_notices, store_options};

use super::progress::{EndSummary, Progress, ProgressRun};
use super::renderers::report_gpu;
use super::verdicts::{findings_of_steps, report_count, report_findings};
use super::{
    CommonArgs, Console, ExitKind, RecipeTargets, UserMessage, VerbError, commands, failure, left_out,
    machine, on_interrupt, output, path, plan, takedown,
};
use gs2e_build::cluster::submission::read_shard;
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepAction, StepAssessment, assess_plan};
use gs2e_build::plan::lens::{UnfitLens, unfit_lens};
use gs2e_build::plan::past::past_costs;
use gs2e_build::plan::shard::SceneShard;
use gs2e_build::plan::size::expected_bytes;
use gs2e_build::plan::survey::{CurrentScene, PlanSurvey, plan_all, survey_recipes};
use gs2e_build::run::backends::RendererChoice;
use gs2e_build::run::{self, RecheckPolicy, ResourceBudget, RunOptions, RunSummary};
use gs2e_build::stage::StepId;
use gs2e_files::{PathError, escape, is_there};
use gs2e_num::units::Hertz;
use gs2e_recipe as recipe;
use gs2e_sensor::SensorChoice;
use gs2e_store::link_tree::LinkTree;
use gs2e_store::record::StoredOutput;
use gs2e_store::space::DiskSpace;
use gs2e_store::{Digest, Store};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Arguments of `build`.
#[derive(Debug, clap::Args)]
pub(super) struct BuildArgs {
    #[command(flatten)]
    targets: RecipeTargets,
    /// Link every output into this folder, as SCENE/TRAJECTORY/STEP/FILE
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
    /// Build a share of the scenes only: the I-th of N, whose expected costs are about equal
    #[arg(long, value_name = "I/N")]
    shard: Option<SceneShard>,
    /// Build the scenes of a task: FILE is a shard of a plan that `gs2e submit` wrote
    #[arg(long, value_name = "FILE", conflicts_with_all = ["shard", "recipes"], requires = "plan_digest")]
    shard_file: Option<PathBuf>,
    /// BLAKE3 of the plan of the shard: files that were altered are refused
    #[arg(long, value_name = "DIGEST", requires = "shard_file", value_parser = parse_digest)]
    plan_digest: Option<Digest>,
    /// Remove files that the shared store has where the own store exceeds this size, as 50GB
    #[arg(long, value_name = "BYTES", value_parser = machine::parse_bytes, requires = "shared_store")]
    #[arg(conflicts_with = "to")]
    cache_size: Option<u64>,
    #[command(flatten)]
    trust: TrustOptions,
}

/// Checks of stored data, and resources for the steps.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct TrustOptions {
    /// Read every up-to-date file, instead of trusting its metadata
    #[arg(long)]
    verify: bool,
    /// Make this share of the up-to-date steps again, and of those that the shared store has, and compare the
    /// bytes: 0.01 or 1% [default: 1% of the steps of the shared store, without trainings and steps of other
    /// programs]
    #[arg(long, value_name = "SHARE", value_parser = parse_share)]
    recheck: Option<f64>,
    /// Sync of files to disk: in batches, or each before the next
    #[arg(long, value_enum, default_value_t = SyncArg::Batch)]
    sync: SyncArg,
    /// Copy steps from and to this folder, or s3://BUCKET/PREFIX, which the builds of several machines share
    #[arg(long, value_name = "DIR")]
    pub(super) shared_store: Option<PathBuf>,
    /// Space in the store for rendered frames, as 20GB, so that a sensor can be changed without a renderer;
    /// or off [default: 2GB for a single scene, else off]
    #[arg(long, value_name = "BYTES", value_parser = parse_keep_frames)]
    keep_frames: Option<KeepFrames>,
    /// Treat a warning of a check as a fault: exit 3, and release nothing
    #[arg(long)]
    pub(super) strict: bool,
    /// Memory for all steps together, as 8GB or 500MB [default: 80 % of the free memory]
    #[arg(long, value_name = "BYTES", value_parser = machine::parse_bytes)]
    memory: Option<u64>,
}

impl TrustOptions {
    /// The defaults, with a shared store.
    pub(super) fn sharing(shared_store: Option<PathBuf>) -> Self {
        Self { shared_store, ..Self::default() }
    }
}

/// Space for rendered frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum KeepFrames {
    /// As many as are useful while one works on a scene; none where many scenes are built.
    #[default]
    Auto,
    Off,
    Bytes(u64),
}

impl KeepFrames {
    /// Bytes for the frames of a build with this number of scenes.
    fn limit(self, scenes: usize) -> Option<u64> {
        /// Space for the frames of a single scene: those of a few trajectories.
        const SINGLE: u64 = 2_000_000_000;
        match self {
            Self::Auto => (scenes == 1).then_some(SINGLE),
            Self::Off => None,
            Self::Bytes(bytes) => Some(bytes),
        }
    }
}

fn parse_keep_frames(text: &str) -> Result<KeepFrames, String> {
    if text == "off" { Ok(KeepFrames::Off) } else { machine::parse_bytes(text).map(KeepFrames::Bytes) }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
enum SyncArg {
    #[default]
    Batch,
    Always,
}

fn parse_digest(text: &str) -> Result<Digest, String> {
    text.parse().map_err(|_| "wanted 64 hexadecimal digits".to_owned())
}

/// A share, as `0.01` or `1%`.
fn parse_share(text: &str) -> Result<f64, String> {
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |number| (number, 0.01));
    let share = number.trim().parse::<f64>().map(|n| n * unit).map_err(|e| e.to_string())?;
    if (0.0..=1.0).contains(&share) { Ok(share) } else { Err(format!("{text} is not between 0 and 100%")) }
}

impl BuildArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let started = Instant::now();
        self.to.iter().try_for_each(|to| output::refuse_inside(to, &common.store, "the store"))?;
        let chosen = common.renderers()?;
        let task = match (&self.shard_file, &self.plan_digest) {
            (Some(file), Some(plan)) => Some(recipe::read_files(&read_shard(file, plan)?)?),
            _ => None,
        };
        if task.is_none() {
            self.targets.resolve()?;
            if !is_there(&common.store) {
                // The recipes are read first, so that a faulty recipe leaves no store behind.
                recipe::read_all(&self.targets.recipes)?;
            }
        }
        let store = store::open_cache(common, &self.trust, self.cache_size, console)?;
        let surveyed = match task {
            Some(recipes) => PlanSurvey::of_plan(Plan::new(recipes, &chosen.asking(&store))),
            None => self.survey(&chosen, &store, console)?,
        };
        let PlanSurvey { settled, plan, taken_down } = surveyed;
        takedown::report_takedown(taken_down, console);
        report_settled(&settled, &store, console);
        let mut steps: Vec<StepOutputs<'_>> = settled.iter().flat_map(StepOutputs::of_settled).collect();
        let (count, targets, trust) = (steps.len(), &self.targets, &self.trust);
        let (plan, mut summary) = if plan.steps().is_empty() {
            (plan, RunSummary::default())
        } else {
            let request = BuildRequest { settled: count, targets, chosen: &chosen, common, trust, console };
            request.build(plan, &store)?
        };
        summary.kept += count;
        steps.extend(StepOutputs::of_run(&plan, &summary));
        let (findings, sound) = findings_of_steps(&steps, &store)?;
        let faults = report_findings(&findings, console);
        report_count(&findings, sound, console);
        match &self.to {
            Some(to) => link_outputs(to, &store, &steps, console)?,
            None if exit_kind(&summary) == ExitKind::Done && summary.made > 0 => console.note(
                "`gs2e build --to DIR` links the files there; `gs2e release --to DIR` writes them as a dataset",
            ),
            None => {}
        }
        if self.cache_size.is_some() {
            // Also where every scene was up to date at a glance.
            store.make_room();
            store.flush()?;
            report_evicted(store.evicted(), console);
        }
        report_end(&summary, started.elapsed().as_secs_f64(), console);
        Ok(match exit_kind(&summary) {
            ExitKind::Done if self.trust.strict && faults > 0 => ExitKind::Fault,
            exit => exit,
        })
    }

    /// Surveys the recipes that the user names, or a share of them.
    fn survey(
        &self,
        chosen: &RendererChoice,
        store: &Store,
        console: &Console,
    ) -> Result<PlanSurvey, VerbError> {
        let (paths, renderers) = (&self.targets.recipes, chosen.asking(store));
        // Memos would settle scenes without planning them, and only planned steps can be made
        // again.
        let mut surveyed = if self.trust.recheck.is_some() {
            plan_all(paths, &renderers)?
        } else {
            let tag = option_tag(chosen, self.trust.shared_store.as_deref());
            survey_recipes(paths, &renderers, store, &tag)?
        };
        if let Some(shard) = self.shard {
            let recipes = recipe::read_all(paths)?;
            let chosen = shard.choose(&recipes).into_iter().map(|recipe| recipe.scene.as_str()).collect();
            surveyed.keep_scenes(&chosen, &renderers);
            let SceneShard { number, of } = shard;
            console.note(&format!("shard {number} of {of}: {} of {} scenes", chosen.len(), recipes.len()));
        }
        Ok(surveyed)
    }
}

/// A step with its outputs.
pub(super) struct StepOutputs<'a> {
    pub(super) scene: &'a str,
    /// The name within the scene.
    pub(super) step: &'a str,
    pub(super) outputs: &'a [StoredOutput],
    /// Numbers of its findings that passed and that were not run, if it is known that all are of these.
    pub(super) sound: Option<[usize; 2]>,
}

impl<'a> StepOutputs<'a> {
    fn of_settled(scene: &'a CurrentScene) -> impl Iterator<Item = Self> {
        let CurrentScene { scene, steps, .. } = scene;
        steps.iter().map(move |step| Self {
            scene,
            step: &step.name,
            outputs: &step.outputs,
            sound: step.sound,
        })
    }

    fn of_run(plan: &'a Plan, summary: &'a RunSummary) -> impl Iterator<Item = Self> {
        summary.products.iter().map(|(id, product)| {
            let step = &plan.steps()[id.0];
            Self { scene: plan.scene_of(step), step: &step.name, outputs: &product.outputs, sound: None }
        })
    }
}

/// Makes the folder of links that the user asked for.
fn link_outputs(
    to: &Path,
    store: &Store,
    steps: &[StepOutputs<'_>],
    console: &Console,
) -> Result<(), VerbError> {
    let link = || {
        let tree = LinkTree::new(store, to)?;
        steps.iter().try_for_each(|s| tree.link_step(&format!("{}/{}", s.scene, s.step), s.outputs))
    };
    link().map_err(|e: PathError| {
        VerbError::failed("not-linked", format!("failed to link: {e}"))
            .help("choose an empty folder, or one that an earlier `gs2e build --to` filled")
    })?;
    let (to, files) = (path(to), steps.iter().map(|step| step.outputs.len()).sum::<usize>());
    console
        .note(&format!("{to} has links to {files} files of the store: read them, and do not write to them"));
    Ok(())
}

/// Prints one line for programs per step of the scenes that are up to date at a glance.
fn report_settled(settled: &[CurrentScene], store: &Store, console: &Console) {
    for scene in settled.iter().filter(|_| console.json) {
        for step in &scene.steps {
            let name = format!("{}/{}", scene.scene, step.name);
            let outputs = plan::output_files(store, &step.outputs);
            console.result(&json!({
                "scene": scene.scene, "step": name, "state": "kept", "key": step.key, "outputs": outputs,
                "seconds": null,
            }));
        }
    }
}

/// Prints the contrast and the noise of each sensor once, and the twins of each scene.
fn report_sensors(plan: &Plan, verbose: bool, console: &Console) -> Result<(), VerbError> {
    let mut reported: Vec<&SensorChoice> = Vec::new();
    for recipe in plan.scenes() {
        for (name, sensor) in recipe.every_sensor() {
            if !reported.contains(&sensor) {
                reported.push(sensor);
                let of = name.map_or_else(|| recipe.scene.clone(), |name| format!("{}/{name}", recipe.scene));
                report_sensor(&of, sensor, recipe.rate, verbose, console)?;
            }
        }
        if recipe.trajectories.iter().any(|trajectory| trajectory.drawn.is_some()) {
            console.note(&format!(
                "sensor of {}: numbers are drawn for each trajectory; their medians are shown",
                recipe.scene
            ));
        }
        super::screening::report_twins(&recipe.scene, &recipe.sensors, console);
    }
    Ok(())
}

fn report_sensor(
    scene: &str,
    sensor: &SensorChoice,
    rate: Hertz,
    verbose: bool,
    console: &Console,
) -> Result<(), VerbError> {
    let screening = sensor.screen(rate);
    let screening = screening.map_err(|e| VerbError::usage("sensor", format!("{scene}: {e}")))?;
    super::screening::report_screening(&format!("sensor of {scene}"), scene, &screening, verbose, console);
    if verbose {
        super::screening::report_front_end(&sensor.as_model().front_end(), console);
    }
    Ok(())
}

/// A build as the user requested it.
pub(super) struct BuildRequest<'a> {
    /// Number of steps that were up to date at a glance.
    pub(super) settled: usize,
    pub(super) targets: &'a RecipeTargets,
    pub(super) chosen: &'a RendererChoice,
    pub(super) common: &'a CommonArgs,
    pub(super) trust: &'a TrustOptions,
    pub(super) console: &'a Console,
}

impl BuildRequest<'_> {
    /// Builds the stale steps. Returns the plan as it was run last, and the summary of all runs.
    pub(super) fn build(&self, plan: Plan, store: &Store) -> Result<(Plan, RunSummary), VerbError> {
        let Self { common, console, chosen, .. } = self;
        let renderers = chosen.asking(store);
        let mut plan = renderers.opened(plan)?;
        // Missing or unreadable input is reported before anything runs, unless the user wants all
        // other steps done first.
        let mut idle = false;
        if !common.keep_going {
            let assessed = assess_plan(&plan, store)?;
            idle = assessed.iter().all(|a| a.action == StepAction::Keep);
            commands::refuse_commands(&plan, &assessed, common)?;
            refuse_lens(&plan)?;
            plan::refuse_no_scene(&plan)?;
            self.warn_of_space(&plan, &assessed, store)?;
        }
        if !idle {
            report_sensors(&plan, common.verbose, console)?;
            report_gpu(chosen, console);
        }
        let mut summary = self.run(&plan, store)?;
        // A scene that the GPU failed has other keys on the CPU, so the plan is made again.
        while chosen.give_up(&plan, &summary) {
            plan = Plan::new(plan.into_scenes(), &renderers);
            summary = summary.then(self.run(&plan, store)?);
        }
        Ok((plan, summary))
    }

    /// Warns if the outputs of the steps that run are expected to exceed the free space.
    fn warn_of_space(
        &self,
        plan: &Plan,
        assessed: &[StepAssessment],
        store: &Store,
    ) -> Result<(), VerbError> {
        let Ok(space) = DiskSpace::holding_path(&self.common.store) else { return Ok(()) };
        let expected = expected_bytes(plan, &past_costs(plan, store)?).into_iter().zip(assessed);
        let stale = expected.filter(|(_, assessed)| assessed.action != StepAction::Keep);
        let bytes: f64 = stale.filter_map(|(bytes, _)| bytes).sum();
        // A warning and no refusal: the sizes are estimates, and `gc` in another shell may free space.
        if bytes > space.free as f64 {
            let [needed, free] = [bytes, space.free as f64].map(|bytes| bytes * 1e-9);
            let mount = escape::path(&space.mount);
            let what = format!("the outputs take about {needed:.1} GB, and {mount} has {free:.1} GB free");
            let warning = UserMessage::warning("disk-space", what);
            self.console.report(&warning.help("gs2e gc, or another --store"));
        }
        Ok(())
    }

    /// Runs a plan once.
    fn run(&self, plan: &Plan, store: &Store) -> Result<RunSummary, VerbError> {
        let Self { common, console, chosen, .. } = self;
        if store.is_due() {
            // What was learned by reading files is kept even if the run is killed.
            store.flush()?;
        }
        let options = run_options(common, self.trust, chosen, plan.scenes().len());
        // Only the bars show the remaining time, and the past costs take a query per step.
        let past = if console.is_live() { past_costs(plan, store)? } else { Vec::new() };
        let expected = |step: StepId| past.get(step.0).copied().flatten().map(|past| past.core_seconds);
        let cancel = on_interrupt()?;
        let (settled, falls_back, environment) = (self.settled, chosen.falls_back(), &common.environment);
        let shown = ProgressRun { plan, settled, falls_back, store, console, environment };
        let progress = Progress::new(shown, options.budget.cores, &expected);
        let summary = run::run_plan(plan, store, options, &cancel, &progress);
        // The bars must be gone before the first line, or they would overwrite it.
        let EndSummary { failed, left_out } = progress.close();
        if common.verbose {
            left_out::report_left_out(&left_out, console);
        }
        if common.keep_going && !failed.is_empty() {
            failure::retry_commands(&failed, &self.to_find()).iter().for_each(|line| console.note(line));
        }
        // After the lines above: failed steps are shown even if the store can no longer be written.
        let summary = summary?;
        let tag = option_tag(self.chosen, self.trust.shared_store.as_deref());
        match run::settle_run(plan, &summary, store, &tag) {
            // This error was already reported with its step. Complete records count even without
            // the database.
            Err(error) if summary.is_full() && error.is_full() => {}
            settled => settled?,
        }
        report_notices(store, console);
        Ok(summary)
    }

    /// The options with which another verb finds the same recipes and store.
    fn to_find(&self) -> String {
        let mut options = String::new();
        let recipes = &self.targets.recipes;
        if *recipes != [Path::new(RecipeTargets::DEFAULT)] {
            recipes.iter().for_each(|path| options.push_str(&format!(" --recipes {}", path.display())));
        }
        if self.common.store != Path::new(CommonArgs::STORE) {
            options.push_str(&format!(" --store {}", self.common.store.display()));
        }
        if self.common.no_omit {
            options.push_str(" --no-omit");
        }
        options
    }
}

/// Refuses a lens that does not fit the camera of its source, which its steps would find out late.
pub(super) fn refuse_lens(plan: &Plan) -> Result<(), VerbError> {
    let Some(UnfitLens { scene, because }) = unfit_lens(plan) else { return Ok(()) };
    let what = format!("the camera of {scene} {because}");
    Err(VerbError::usage("recipe-invalid", what).help("fx in `camera` is a focal length of its own"))
}

fn run_options(
    common: &CommonArgs,
    trust: &TrustOptions,
    chosen: &RendererChoice,
    scenes: usize,
) -> RunOptions {
    let cores = common.cores();
    let kept_frames = trust.keep_frames.unwrap_or_default().limit(scenes);
    let memory = trust.memory.unwrap_or_else(machine::free_memory);
    // The steps that are made again differ from run to run, and no other member of a shared store knows them
    // before. The seed enters no file.
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let seed = since.as_secs() ^ u64::from(since.subsec_nanos()).rotate_right(32);
    RunOptions {
        budget: ResourceBudget {
            cores,
            memory,
            // Each GPU serves one step at a time.
            gpus: chosen.gpu_count(),
        },
        keep_going: common.keep_going,
        recheck: RecheckPolicy { share: trust.recheck, seed },
        allow_commands: common.allow_commands,
        programs: chosen.programs().clone(),
        kept_frames,
    }
}
