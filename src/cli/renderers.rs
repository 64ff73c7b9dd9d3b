//! The back ends of a command as users hear of them. The policy is [`gs2e_build::run::backends`].

use super::Console;
use gs2e_build::run::backends::RendererChoice;

/// Reports a GPU that is needed and cannot be used.
pub(super) fn report_gpu(chosen: &RendererChoice, console: &Console) {
    if let Some(because) = chosen.gpu_error() {
        console.note(&format!("rendering on the CPU, because {because}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::build::{BuildRequest, TrustOptions, open_store};
    use crate::cli::{Cli, RecipeTargets};
    use clap::Parser as _;
    use gs2e_build::plan::Plan;
    use gs2e_build::run::RunSummary;
    use gs2e_build::run::backends::{AutoRenderers, RendererKind};
    use gs2e_files::programs::ProgramFinder;
    use gs2e_gpu::{DeviceChoice, GpuDevice, GpuPool};
    use gs2e_render::OmissionPolicy;
    use gs2e_render::backend::{Backend, GpuBackend};
    use std::collections::BTreeSet;
    use std::path::Path;
    use std::sync::Arc;

    const RECIPE: &str = "version: 1\nscene: tiny\nseed: 1\n\
        source: { procedural: { kind: still-life, gaussians: 200, views: 4, seed: 1 } }\n\
        camera: { width: 32, height: 24 }\n\
        trajectories: [{ name: base, refine: { window: 2, factor: 2, curve: cubic }, speed: { function: \"1\" } }]\n\
        outputs: [events, sharp]\nlicence: { expression: CC0-1.0, holder: Nobody }\n";

    /// Builds a scene in `dir` on a GPU that `spoil` makes unusable. Returns the result and the
    /// classes of the steps.
    fn built(dir: &Path, spoil: impl FnOnce(GpuDevice) -> GpuPool) -> Option<(RunSummary, BTreeSet<String>)> {
        let pool = match GpuDevice::open(&DeviceChoice::Any) {
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
        let pool: Arc<dyn GpuBackend> = Arc::new(pool);
        let auto = AutoRenderers::new(move || Ok(Arc::clone(&pool)));
        let console = Console::new(crate::cli::ConsoleStreams::of_process(), false, true);
        let trust = TrustOptions::default();
        let chosen = RendererChoice::new(
            RendererKind::Auto(auto),
            OmissionPolicy::default(),
            ProgramFinder::default(),
        );
        let targets = RecipeTargets { recipes: vec![recipe] };
        let store = open_store(&common, &trust, &console).unwrap();
        let plan = Plan::new(gs2e_recipe::read_all(&targets.recipes).unwrap(), &chosen.knowing(&store));
        let building = BuildRequest {
            settled: 0,
            targets: &targets,
            chosen: &chosen,
            common: &common,
            trust: &trust,
            console: &console,
        };
        let (plan, summary) = building.build(plan, &store).unwrap();
        let class = |step: &gs2e_build::plan::PlannedStep| {
            let key = store.last_key("tiny", &step.name)?;
            let lines = store.full_record(&key).unwrap()?.description;
            lines.into_iter().find(|line| line.path == "class").map(|line| line.text)
        };
        Some((summary, plan.steps().iter().filter_map(class).collect()))
    }

    #[test]
    fn what_a_gpu_has_no_room_for_is_lost_at_or_spoils_is_rendered_on_the_cpu() {
        let lost = |device: GpuDevice| {
            device.destroy();
            device.into()
        };
        let full = |device: GpuDevice| device.with_room(100).into();
        // The first picture is not finite, so no step is made of it.
        let faulty = |device: GpuDevice| device.with_spoilt_pictures().into();
        let spoils: [&dyn Fn(GpuDevice) -> GpuPool; 3] = [&lost, &full, &faulty];
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
    fn a_lost_gpu_leaves_its_scenes_to_the_others() {
        let dir = tempfile::tempdir().unwrap();
        let with_another = |device: GpuDevice| {
            let other = GpuDevice::open(&DeviceChoice::Any).unwrap();
            device.destroy();
            GpuPool::new(vec![device, other])
        };
        let Some((summary, classes)) = built(dir.path(), with_another) else { return };
        assert_eq!((summary.made, summary.failures.len()), (6, 0));
        assert!(classes.iter().all(|class| Backend::is_gpu(class)), "{classes:?}");
    }

    #[test]
    fn renderers_spread_over_the_gpus_of_a_pool() {
        let opened = GpuDevice::open(&DeviceChoice::Any);
        assert!(opened.is_ok() || std::env::var("REQUIRE_GPU").as_deref() != Ok("1"), "{opened:?}");
        let Ok(device) = opened else { return };
        let second = GpuDevice::open(&DeviceChoice::Any).unwrap();
        let pool = GpuPool::new(vec![device.with_room(1), second.with_room(2)]);
        let rooms =
            |taken: &[GpuDevice]| taken.iter().map(|device| device.room().unwrap()).collect::<Vec<_>>();
        let mut taken: Vec<GpuDevice> = (0..4).map(|_| pool.take().unwrap()).collect();
        assert_eq!(rooms(&taken), [1, 2, 1, 2]);
        // A clone keeps the place until it is dropped too.
        let clone = taken[1].clone();
        taken.remove(1);
        assert_eq!(pool.take().unwrap().room(), Some(1));
        drop(clone);
        assert_eq!(pool.take().unwrap().room(), Some(2));
    }

    #[test]
    fn what_a_gpu_has_room_for_it_renders() {
        let dir = tempfile::tempdir().unwrap();
        let Some((summary, classes)) = built(dir.path(), GpuPool::from) else { return };
        assert_eq!((summary.made, summary.failures.len()), (6, 0));
        assert!(classes.len() == 1 && classes.iter().all(|class| Backend::is_gpu(class)), "{classes:?}");
    }
}
