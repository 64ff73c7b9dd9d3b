//! The choice of the back end for each scene, and of the programs that may be started.
//!
//! With `--backend auto`, a scene is rendered by the back end that rendered it before, so that a
//! new GPU or driver does not make it stale. A new scene is rendered by a hardware GPU if there is
//! one. The GPU is opened when something must be rendered. A scene that it has no room for, or
//! during which it is lost, goes to the CPU.

use super::RunSummary;
use crate::foreign::versions::VersionQuery;
use crate::plan::asked;
use crate::plan::assess::{PlanError, StepAction, assess_plan};
use crate::plan::{Plan, RendererPolicy, past};
use crate::programs::ProgramFinder;
use crate::recipe::Recipe;
use crate::render::OmissionPolicy;
use crate::render::backend::Backend;
use crate::render::gpu::{self, DeviceChoice, GpuDevice, GpuError};
use crate::store::Store;
use std::cell::RefCell;
use std::collections::BTreeSet;

/// The back ends of a command, and the work that they leave out.
#[derive(Debug)]
pub struct RendererChoice {
    by: RendererKind,
    omit: OmissionPolicy,
    programs: ProgramFinder,
}

/// The kind of the choice.
#[derive(Debug)]
pub enum RendererKind {
    /// The back end that the user requested, for all scenes.
    One(Backend),
    /// A suitable back end for each scene.
    Auto(AutoRenderers),
}

impl RendererChoice {
    /// Creates a choice. `omit` is the work to leave out, and `programs` are those that a run may
    /// start.
    #[must_use]
    pub fn new(by: RendererKind, omit: OmissionPolicy, programs: ProgramFinder) -> Self {
        Self { by, omit, programs }
    }

    /// The programs that a run may start.
    #[must_use]
    pub fn programs(&self) -> &ProgramFinder {
        &self.programs
    }

    /// The parts of the choice that may change a key, as a name. The result of a survey under
    /// another name does not count.
    #[must_use]
    pub fn name(&self) -> String {
        let by = match &self.by {
            RendererKind::One(backend) => backend.class(),
            RendererKind::Auto(_) => "auto".to_owned(),
        };
        if self.omit.is_needless() { by } else { format!("{by} whole") }
    }

    /// Adds the knowledge of scenes and programs in a store, for a verb that runs nothing.
    #[must_use]
    pub fn knowing<'a>(&'a self, store: &'a Store) -> InformedRenderers<'a> {
        InformedRenderers { chosen: self, store, asks: false }
    }

    /// Adds the knowledge of scenes in a store, for a run. Programs that recipes name are asked for
    /// their versions.
    #[must_use]
    pub fn asking<'a>(&'a self, store: &'a Store) -> InformedRenderers<'a> {
        InformedRenderers { chosen: self, store, asks: true }
    }

    /// Returns true if a step that fails on the GPU is rendered on the CPU next.
    #[must_use]
    pub fn falls_back(&self) -> bool {
        matches!(self.by, RendererKind::Auto(_))
    }

    /// The error of a GPU that is needed and cannot be used.
    #[must_use]
    pub fn gpu_error(&self) -> Option<GpuError> {
        let RendererKind::Auto(auto) = &self.by else { return None };
        auto.gpu.borrow().as_ref()?.as_ref().err().cloned()
    }

    /// Assigns the scenes that the GPU failed in a run to the CPU. Returns true if there are any.
    pub fn give_up(&self, plan: &Plan, summary: &RunSummary) -> bool {
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
pub struct AutoRenderers {
    choice: DeviceChoice,
    /// The GPU, or the error of opening it; `None` if it was not opened yet.
    gpu: RefCell<Option<Result<GpuDevice, GpuError>>>,
    /// Scenes that the GPU failed.
    on_cpu: RefCell<BTreeSet<String>>,
}

impl AutoRenderers {
    /// Renders by one of these GPUs, or else by the CPU.
    #[must_use]
    pub fn new(choice: DeviceChoice) -> Self {
        Self { choice, gpu: RefCell::default(), on_cpu: RefCell::default() }
    }

    /// Renders by a GPU that is open already.
    #[cfg(test)]
    pub(crate) fn with_device(device: GpuDevice) -> Self {
        Self { gpu: RefCell::new(Some(Ok(device))), ..Self::new(DeviceChoice::Any) }
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
            // The recorded class is enough for the keys. The GPU is opened in `opened` if a step
            // must run.
            Some(class) if Backend::is_gpu(&class) && !is_opened => Backend::Unopened(class),
            _ => self.best(),
        }
    }
}

/// A [`RendererChoice`] with the knowledge of a store.
#[derive(Debug)]
pub struct InformedRenderers<'a> {
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
    ///
    /// # Errors
    /// The plan cannot be compared with the store.
    pub fn opened(&self, plan: Plan) -> Result<Plan, PlanError> {
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
