//! The choice between CPU and GPU for a scene.

use super::{RendererChoice, RendererKind};
use crate::plan::assess::{PlanError, StepAction, assess_plan};
use crate::plan::{Plan, RendererPolicy, asked, past};
use gs2e_recipe::Recipe;
use gs2e_render::backend::{Backend, GpuBackend};
use gs2e_render::{GpuError, OmissionPolicy};
use gs2e_source::foreign::versions::VersionQuery;
use gs2e_store::Store;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

/// Open GPUs, or the error of opening them.
pub type OpenedGpus = Result<Arc<dyn GpuBackend>, GpuError>;

/// Chooses a suitable back end for each scene.
pub struct AutoRenderers {
    open: Box<dyn Fn() -> OpenedGpus>,
    /// The GPUs; `None` if they were not opened yet.
    pub(super) gpu: RefCell<Option<OpenedGpus>>,
    /// Scenes that the GPU failed.
    pub(super) on_cpu: RefCell<BTreeSet<String>>,
}

impl fmt::Debug for AutoRenderers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { gpu, on_cpu, .. } = self;
        f.debug_struct("AutoRenderers").field("gpu", gpu).field("on_cpu", on_cpu).finish_non_exhaustive()
    }
}

impl AutoRenderers {
    /// Renders by the GPUs that `open` opens, or else by the CPU. They are opened once, when something must
    /// be rendered.
    #[must_use]
    pub fn new(open: impl Fn() -> OpenedGpus + 'static) -> Self {
        Self { open: Box::new(open), gpu: RefCell::default(), on_cpu: RefCell::default() }
    }

    /// The GPU, opened if necessary, or else the CPU.
    fn best(&self) -> Backend {
        let mut gpu = self.gpu.borrow_mut();
        match gpu.get_or_insert_with(|| (self.open)()) {
            Ok(gpus) => Backend::Gpu(Arc::clone(gpus)),
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
    pub(super) chosen: &'a RendererChoice,
    pub(super) store: &'a Store,
    /// True if programs may be run to learn their versions.
    pub(super) asks: bool,
}

impl RendererPolicy for InformedRenderers<'_> {
    fn of(&self, recipe: &Recipe) -> Backend {
        match &self.chosen.by {
            RendererKind::One(backend) => backend.clone(),
            RendererKind::Auto(_) if !Backend::gpu_supports_order(recipe.render.order) => Backend::Cpu,
            // Nor moving objects, nor scenes that change with time.
            RendererKind::Auto(_) if !recipe.objects.is_empty() || recipe.scene_time().is_some() => {
                Backend::Cpu
            }
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
