//! The choice of the back end for each scene, and of the programs that may be started.
//!
//! With `--backend auto`, a scene is rendered by the back end that rendered it before, so that a
//! new GPU or driver does not make it stale. A new scene is rendered by a hardware GPU if there is
//! one. The GPU is opened when something must be rendered. A scene that it has no room for, or
//! during which it is lost, goes to the CPU.

mod auto;

pub use auto::{AutoRenderers, InformedRenderers, OpenedGpus};

use super::RunSummary;
use crate::plan::Plan;
use gs2e_files::programs::ProgramFinder;
use gs2e_render::backend::Backend;
use gs2e_render::{GpuError, OmissionPolicy};
use gs2e_store::Store;

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

    /// Number of GPUs that may render at once.
    #[must_use]
    pub fn gpu_count(&self) -> usize {
        match &self.by {
            RendererKind::One(Backend::Gpu(pool)) => pool.device_count(),
            RendererKind::One(_) => 0,
            // A recorded class may be rendered by a GPU that is opened later.
            RendererKind::Auto(auto) => match auto.gpu.borrow().as_ref() {
                Some(Ok(pool)) => pool.device_count(),
                _ => 1,
            },
        }
    }

    /// The error of a GPU that is needed and cannot be used.
    #[must_use]
    pub fn gpu_error(&self) -> Option<GpuError> {
        let RendererKind::Auto(auto) = &self.by else { return None };
        auto.gpu.borrow().as_ref()?.as_ref().err().cloned()
    }

    /// Assigns the scenes that the GPU failed in a run to the CPU, or to the GPUs that are left. Returns true
    /// if there are any.
    pub fn give_up(&self, plan: &Plan, summary: &RunSummary) -> bool {
        let RendererKind::Auto(auto) = &self.by else { return false };
        // A second run would ignore the interrupt of the first.
        if summary.interrupted {
            return false;
        }
        let mut any = false;
        for failure in &summary.failures {
            let Some(because) = failure.of_gpu() else { continue };
            any = true;
            let mut gpu = auto.gpu.borrow_mut();
            if matches!(because, GpuError::Lost { .. }) {
                // The lost device serves no step again, so there is an end to this.
                if gpu.as_ref().is_some_and(|pool| pool.as_ref().is_ok_and(|pool| !pool.is_lost())) {
                    continue;
                }
                // Without a device that is sound, every later scene fails too.
                *gpu = Some(Err(because.clone()));
            }
            // A device without room for one scene may have room for the others.
            let scene = plan.scene_of(&plan.steps()[failure.step.0]);
            auto.on_cpu.borrow_mut().insert(scene.to_owned());
        }
        any
    }
}
