//! The choice between CPU and GPU for a scene.

use super::{RendererChoice, RendererKind};
use crate::foreign::versions::VersionQuery;
use crate::plan::asked;
use crate::plan::assess::{PlanError, StepAction, assess_plan};
use crate::plan::{Plan, RendererPolicy, past};
use crate::recipe::Recipe;
use crate::render::OmissionPolicy;
use crate::render::backend::Backend;
use crate::render::gpu::{self, DeviceChoice, FeatureSet, GpuError, GpuPool};
use crate::store::Store;
use std::cell::RefCell;
use std::collections::BTreeSet;

/// Chooses a suitable back end for each scene.
#[derive(Debug)]
pub struct AutoRenderers {
    choice: DeviceChoice,
    without: FeatureSet,
    /// The GPUs, or the error of opening them; `None` if they were not opened yet.
    pub(super) gpu: RefCell<Option<Result<GpuPool, GpuError>>>,
    /// Scenes that the GPU failed.
    pub(super) on_cpu: RefCell<BTreeSet<String>>,
}

impl AutoRenderers {
    /// Renders by one of these GPUs without some of its features, or else by the CPU.
    #[must_use]
    pub fn new(choice: DeviceChoice, without: FeatureSet) -> Self {
        Self { choice, without, gpu: RefCell::default(), on_cpu: RefCell::default() }
    }

    /// Renders by GPUs that are open already.
    #[cfg(test)]
    pub(crate) fn with_pool(pool: GpuPool) -> Self {
        Self { gpu: RefCell::new(Some(Ok(pool))), ..Self::new(DeviceChoice::Any, FeatureSet::NONE) }
    }

    /// The GPU, opened if necessary, or else the CPU.
    fn best(&self) -> Backend {
        let mut gpu = self.gpu.borrow_mut();
        match gpu.get_or_insert_with(|| GpuPool::open(&self.choice, self.without)) {
            Ok(pool) => Backend::Gpu(pool.clone()),
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
            RendererKind::Auto(_) if !gpu::supports_order(recipe.render.order) => Backend::Cpu,
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
