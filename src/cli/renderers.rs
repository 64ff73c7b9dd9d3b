//! The choice of the back end for each scene, and of the programs that may be started.
//!
//! With `--backend auto`, a scene is rendered by the back end that rendered it before, so that a
//! new GPU or driver does not make it stale. A new scene is rendered by a hardware GPU if there is
//! one. The GPU is opened when something must be rendered. A scene that it has no room for, or
//! during which it is lost, goes to the CPU.

use super::console::Console;
use super::problem::VerbError;
use crate::foreign::versions::VersionQuery;
use crate::plan::asked;
use crate::plan::assess::{StepAction, assess_plan};
use crate::plan::{Plan, RendererPolicy, past};
use crate::programs::ProgramFinder;
use crate::recipe::Recipe;
use crate::render::OmissionPolicy;
use crate::render::backend::Backend;
use crate::render::gpu::{self, DeviceChoice, GpuDevice, GpuError};
use crate::run::RunSummary;
use crate::store::Store;
use std::cell::RefCell;
use std::collections::BTreeSet;

/// The back ends of a command, and the work that they leave out.
#[derive(Debug)]
pub(super) struct RendererChoice {
    by: RendererKind,
    omit: OmissionPolicy,
    programs: ProgramFinder,
}

/// The kind of the choice.
#[derive(Debug)]
pub(super) enum RendererKind {
    /// The back end that the user requested, for all scenes.
    One(Backend),
    /// A suitable back end for each scene.
    Auto(AutoRenderers),
}

impl RendererChoice {
    /// Creates a choice. `omit` is the work to leave out, and `programs` are those that a run may
    /// start.
    pub(super) fn new(by: RendererKind, omit: OmissionPolicy, programs: ProgramFinder) -> Self {
        Self { by, omit, programs }
    }

    /// The programs that a run may start.
    pub(super) fn programs(&self) -> &ProgramFinder {
        &self.programs
    }

    /// The parts of the choice that may change a key, as a name. The result of a survey under
    /// another name does not count.
    pub(super) fn name(&self) -> String {
        let by = match &self.by {
            RendererKind::One(backend) => backend.class(),
            RendererKind::Auto(_) => "auto".to_owned(),
        };
        if self.omit.is_needless() { by } else { format!("{by} whole") }
    }

    /// Adds the knowledge of scenes and programs in a store, for a verb that runs nothing.
    pub(super) fn knowing<'a>(&'a self, store: &'a Store) -> InformedRenderers<'a> {
        InformedRenderers { chosen: self, store, asks: false }
    }

    /// Adds the knowledge of scenes in a store, for a run. Programs that recipes name are asked for
    /// their versions.
    pub(super) fn asking<'a>(&'a self, store: &'a Store) -> InformedRenderers<'a> {
        InformedRenderers { chosen: self, store, asks: true }
    }

    /// Returns true if a step that fails on the GPU is rendered on the CPU next.
    pub(super) fn falls_back(&self) -> bool {
        matches!(self.by, RendererKind::Auto(_))
    }

    /// Reports a GPU that is needed and cannot be used.
    pub(super) fn tell(&self, console: &Console) {
        let RendererKind::Auto(auto) = &self.by else { return };
        if let Some(Err(because)) = &*auto.gpu.borrow() {
            console.say(&format!("rendering on the CPU, because {because}"));
        }
    }

    /// Assigns the scenes that the GPU failed in a run to the CPU. Returns true if there are any.
    pub(super) fn give_up(&self, plan: &Plan, summary: &RunSummary) -> bool {
        let RendererKind::Auto(auto) = &self.by else { return false };
        // A second run would ignore the interrupt of the first.
        if summary.interrupted {
            return false;
        }
        let mut any = false;
        for failure in &summary.failures {
            let Some(because) = failure.of_gpu() else { continue };
            let scene = plan.scene_of(&plan.steps()[failure.step.0]);
            auto.on_cpu.borrow_mut().insert(scene.to_owned());
            // A lost device fails every later scene too. A device without room for one scene may
            // have room for the others.
            if matches!(because, GpuError::Lost { .. }) {
                *auto.gpu.borrow_mut() = Some(Err(because.clone()));
            }
            any = true;
        }
        any
    }
}

/// Chooses a suitable back end for each scene.
#[derive(Debug)]
pub(super) struct AutoRenderers {
    choice: DeviceChoice,
    /// The GPU, or the error of opening it; `None` if it was not opened yet.
    gpu: RefCell<Option<Result<GpuDevice, GpuError>>>,
    /// Scenes that the GPU failed.
    on_cpu: RefCell<BTreeSet<String>>,
}

impl AutoRenderers {
    /// Renders by one of these GPUs, or else by the CPU.
    pub(super) fn new(choice: DeviceChoice) -> Self {
        Self { choice, gpu: RefCell::default(), on_cpu: RefCell::default() }
    }

    /// The GPU, opened if necessary, or else the CPU.
    fn best(&self) -> Backend {
        let mut gpu = self.gpu.borrow_mut();
        match gpu.get_or_insert_with(|| GpuDevice::open(&self.choice)) {
            Ok(device) => Backend::Gpu(device.clone()),
            Err(_) => Backend::Cpu,
        }
    }

    /// The back end of a scene that was last rendered in the class `last`.
    fn of(&self, scene: &str, last: Option<String>) -> Backend {
        let is_opened = self.gpu.borrow().is_some();
        match last {
            _ if self.on_cpu.borrow().contains(scene) => Backend::Cpu,
            Some(class) if Backend::is_cpu(&class) => Backend::Cpu,
            // The recorded class is enough for the keys. The GPU is opened in `at_hand` if a step
            // must run.
            Some(class) if Backend::is_gpu(&class) && !is_opened => Backend::Unopened(class),
            _ => self.best(),
        }
    }
}

/// A [`RendererChoice`] with the knowledge of a store.
pub(super) struct InformedRenderers<'a> {
    chosen: &'a RendererChoice,
    store: &'a Store,
    /// True if programs may be run to learn their versions.
    asks: bool,
}

impl RendererPolicy for InformedRenderers<'_> {
    fn of(&self, recipe: &Recipe) -> Backend {
        match &self.chosen.by {
            RendererKind::One(backend) => backend.clone(),
            RendererKind::Auto(_) if !gpu::supports_order(recipe.render.order) => Backend::Cpu,
            // A record that cannot be read is reported where it is needed.
            RendererKind::Auto(auto) => {
                auto.of(&recipe.scene, past::last_class(recipe, self.store).unwrap_or_default())
            }
        }
    }

    fn omit(&self) -> OmissionPolicy {
        self.chosen.omit
    }

    fn version(&self, program: VersionQuery) -> Option<String> {
        let programs = &self.chosen.programs;
        if self.asks {
            Some(asked::ask(program, programs, self.store))
        } else {
            asked::recall(program, programs, self.store)
        }
    }
}

impl InformedRenderers<'_> {
    /// The plan with back ends that can run: opens the GPU if a step must run on a GPU that was not
    /// opened.
    pub(super) fn at_hand(&self, plan: Plan) -> Result<Plan, VerbError> {
        let RendererKind::Auto(auto) = &self.chosen.by else { return Ok(plan) };
        let unopened = auto.gpu.borrow().is_none()
            && plan.scenes().iter().any(|recipe| matches!(self.of(recipe), Backend::Unopened(_)));
        // Opening takes time and may pick another GPU, which would make a finished plan stale.
        if !unopened || assess_plan(&plan, self.store)?.iter().all(|a| a.action == StepAction::Keep) {
            return Ok(plan);
        }
        auto.best();
        // The opened GPU may have another class than the recorded one, so the keys are computed
        // again.
        Ok(Plan::new(plan.into_scenes(), self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::build::{BuildRequest, TrustOptions, open_store};
    use crate::cli::{Cli, RecipeTargets};
    use clap::Parser as _;
    use std::path::Path;

    const RECIPE: &str = "version: 1\nscene: tiny\nseed: 1\n\
        source: { procedural: { kind: still-life, gaussians: 200, views: 4, seed: 1 } }\n\
        camera: { width: 32, height: 24 }\n\
        trajectories: [{ name: base, refine: { window: 2, factor: 2, curve: cubic }, speed: { function: \"1\" } }]\n\
        outputs: [events, sharp]\nlicence: { expression: CC0-1.0, holder: Nobody }\n";

    /// Builds a scene in `dir` on a GPU that `spoil` makes unusable. Returns the result and the
    /// classes of the steps.
    fn built(
        dir: &Path,
        spoil: impl FnOnce(GpuDevice) -> GpuDevice,
    ) -> Option<(RunSummary, BTreeSet<String>)> {
        let device = match GpuDevice::open(&DeviceChoice::Any) {
            Ok(device) => spoil(device),
            Err(because) => {
                assert!(std::env::var("REQUIRE_GPU").as_deref() != Ok("1"), "{because}");
                return None;
            }
        };
        let recipe = dir.join("tiny.yaml");
        std::fs::write(&recipe, RECIPE).unwrap();
        let store = dir.join("store").display().to_string();
        let common = Cli::try_parse_from(["gs2e", "build", "--store", &store]).unwrap().common;
        let auto =
            AutoRenderers { gpu: RefCell::new(Some(Ok(device))), ..AutoRenderers::new(DeviceChoice::Any) };
        let console = Console::new(crate::cli::ConsoleStreams::of_process(), false, true);
        let care = TrustOptions::default();
        let chosen = RendererChoice::new(
            RendererKind::Auto(auto),
            OmissionPolicy::default(),
            ProgramFinder::default(),
        );
        let targets = RecipeTargets { recipes: vec![recipe] };
        let store = open_store(&common, &care, &console).unwrap();
        let plan = Plan::new(crate::recipe::read_all(&targets.recipes).unwrap(), &chosen.knowing(&store));
        let building = BuildRequest {
            settled: 0,
            targets: &targets,
            chosen: &chosen,
            common: &common,
            care: &care,
            console: &console,
        };
        let (plan, summary) = building.build(plan, &store).unwrap();
        let class = |step: &crate::plan::PlannedStep| {
            let key = store.last_key("tiny", &step.name)?;
            let lines = store.full_record(&key).unwrap()?.description;
            lines.into_iter().find(|line| line.path == "class").map(|line| line.text)
        };
        Some((summary, plan.steps().iter().filter_map(class).collect()))
    }

    #[test]
    fn what_a_gpu_has_no_room_for_or_is_lost_at_is_rendered_on_the_cpu() {
        let lost = |device: GpuDevice| {
            device.destroy();
            device
        };
        let full = |device: GpuDevice| device.with_room(100);
        let spoils: [&dyn Fn(GpuDevice) -> GpuDevice; 2] = [&lost, &full];
        for spoil in spoils {
            let dir = tempfile::tempdir().unwrap();
            let Some((summary, classes)) = built(dir.path(), spoil) else { return };
            assert!(summary.failures.is_empty() && summary.unreached == 0);
            assert_eq!(summary.made, 6, "each step once");
            assert_eq!(summary.kept, 0);
            assert_eq!(classes, BTreeSet::from(["cpu/1".to_owned()]));
        }
    }

    #[test]
    fn what_a_gpu_has_room_for_it_renders() {
        let dir = tempfile::tempdir().unwrap();
        let Some((summary, classes)) = built(dir.path(), |device| device) else { return };
        assert_eq!((summary.made, summary.failures.len()), (6, 0));
        assert!(classes.len() == 1 && classes.iter().all(|class| Backend::is_gpu(class)), "{classes:?}");
    }
}
