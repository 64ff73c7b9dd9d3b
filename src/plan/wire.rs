//! From one recipe to the steps of its scene. A scene pays only for what it needs: a step whose product no output
//! asks for does not exist.

use super::Wiring;
use crate::artifact::Motion;
use crate::recipe::{Output, Recipe, Reconstruct, Source, TrajectoryRecipe};
use crate::render::Omit;
use crate::render::backend::Backend;
use crate::scene::Gaussians;
use crate::seed::{Purpose, Seed};
use crate::source::Capture;
use crate::speed::Speed;
use crate::stage::Target;
use crate::stage::capture::Capturing;
use crate::stage::checks::Checking;
use crate::stage::events::Simulating;
use crate::stage::fidelity::Comparing;
use crate::stage::reconstruct::Reconstructing;
use crate::stage::scene_checks::CheckingScene;
use crate::stage::sharp::Photographing;
use crate::stage::trajectory::{Moving, Seeing};
use std::collections::BTreeMap;

/// Adds the steps of one scene.
pub(super) fn scene(recipe: &Recipe, (backend, omit): (&Backend, Omit), wiring: &mut Wiring<'_>) {
    let capturing = match &recipe.source {
        Source::Procedural(still_life) => Capturing::procedural(still_life),
        Source::Colmap(dir) => Capturing::Colmap { dir: dir.clone() },
        Source::Nerfstudio(path) => Capturing::Nerfstudio { path: path.clone() },
        Source::Model(path) => Capturing::Model { path: path.clone() },
        Source::None => Capturing::None,
    };
    let reconstructing = match (&recipe.reconstruct, &recipe.source) {
        (Some(Reconstruct::Given(file)), _) => Reconstructing::given(file),
        (Some(Reconstruct::Newest(model)), _) => Reconstructing::newest_of(model),
        (None, Source::Procedural(still_life)) => Reconstructing::procedural(still_life),
        (None, _) => unreachable!("recipes of other sources say where the Gaussians come from"),
    };
    let photographed = recipe.source.has_photos().then(|| capturing.clone());
    let ground = Ground {
        capture: wiring.add("capture".into(), capturing, ()),
        gaussians: wiring.add("reconstruct".into(), reconstructing, ()),
        backend,
        omit,
    };
    // Those that others are drawn from come first, wherever the recipe has them; else its order is kept.
    let (drawn, own): (Vec<_>, Vec<_>) = recipe.trajectories.iter().partition(|t| t.base.is_some());
    let mut motions = BTreeMap::new();
    for trajectory in own.into_iter().chain(drawn) {
        let base = trajectory.base.as_deref().map(|base| motions[base]);
        let motion = self::trajectory(recipe, trajectory, base, ground, wiring);
        motions.insert(trajectory.name.as_str(), motion);
    }
    if let Some(capturing) = photographed {
        self::photographed(recipe, capturing, ground, wiring);
    }
}

/// The scene held against its photos, and its capture against itself.
fn photographed(recipe: &Recipe, capturing: Capturing, ground: Ground<'_>, wiring: &mut Wiring<'_>) {
    let Ground { capture, gaussians, backend, .. } = ground;
    let comparing =
        Comparing { render: recipe.render, capturing: capturing.clone(), backend: backend.clone() };
    let fidelity = wiring.add("fidelity".into(), comparing, (capture, gaussians));
    let checking = CheckingScene { limits: recipe.checks.of_scene(), capturing };
    wiring.add("checks".into(), checking, (capture, fidelity));
}

/// What the steps of all trajectories may take, and what renders them.
#[derive(Debug, Clone, Copy)]
struct Ground<'a> {
    capture: Target<Capture>,
    gaussians: Target<Gaussians>,
    backend: &'a Backend,
    omit: Omit,
}

fn trajectory(
    recipe: &Recipe,
    trajectory: &TrajectoryRecipe,
    base: Option<Target<Motion>>,
    ground: Ground<'_>,
    wiring: &mut Wiring<'_>,
) -> Target<Motion> {
    let Ground { capture, gaussians, backend, omit } = ground;
    let backend = || backend.clone();
    let name = |step: &str| format!("{}/{step}", trajectory.name);
    let seeing = matches!(trajectory.speed, Speed::Flow(_)).then(|| Seeing {
        camera: recipe.camera,
        render: recipe.render,
        backend: backend(),
    });
    let sees = seeing.is_some();
    let moving = Moving {
        path: trajectory.path.clone(),
        speed: trajectory.speed.clone(),
        law: recipe.law,
        rate: recipe.rate,
        seeing,
    };
    let captured = (sees || trajectory.path.needs_views()).then_some(capture);
    let motion = wiring.add(name("trajectory"), moving, (captured, base, sees.then_some(gaussians)));
    let events = recipe.outputs.contains(&Output::Events).then(|| {
        let seed = Seed::derive(recipe.seed, &recipe.scene, &trajectory.name, Purpose::Sensor);
        let simulating = Simulating {
            omit,
            backend: backend(),
            tolerance: recipe.tolerance,
            ..Simulating::new(&recipe.sensors, seed, (recipe.camera, recipe.render))
        };
        wiring.add(name("events"), simulating, (capture, gaussians, motion))
    });
    if recipe.outputs.contains(&Output::Sharp) {
        let sharp = Photographing {
            camera: recipe.camera,
            render: recipe.render,
            every: recipe.sharp_every,
            omit,
            backend: backend(),
        };
        wiring.add(name("sharp"), sharp, (capture, gaussians, motion));
    }
    let checking = Checking { limits: recipe.checks.of_trajectory() };
    wiring.add(name("checks"), checking, (motion, events));
    motion
}
