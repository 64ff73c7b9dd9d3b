//! From one recipe to the steps of its scene. A scene pays only for what it needs: a step whose product no output
//! asks for does not exist.

use super::Wiring;
use crate::recipe::{Output, Recipe, Reconstruct, Source, TrajectoryRecipe};
use crate::scene::Gaussians;
use crate::seed::{Purpose, Seed};
use crate::source::Capture;
use crate::stage::Target;
use crate::stage::capture::Capturing;
use crate::stage::checks::Checking;
use crate::stage::events::Simulating;
use crate::stage::reconstruct::Reconstructing;
use crate::stage::sharp::Photographing;
use crate::stage::trajectory::Moving;
use crate::trajectory::path::Path;
use crate::trajectory::sample::Summation;

/// Adds the steps of one scene.
pub(super) fn scene(recipe: &Recipe, wiring: &mut Wiring<'_>) {
    let (capturing, reconstructing) = match (&recipe.source, &recipe.reconstruct) {
        (Source::Procedural(still_life), _) => {
            (Capturing::procedural(still_life), Reconstructing::procedural(still_life))
        }
        (Source::Colmap(dir), Some(Reconstruct::Given(file))) => {
            (Capturing::Colmap { dir: dir.clone() }, Reconstructing::given(file))
        }
        (Source::Nerfstudio(path), Some(Reconstruct::Given(file))) => {
            (Capturing::Nerfstudio { path: path.clone() }, Reconstructing::given(file))
        }
        (_, None) => unreachable!("recipes of captured sources say where the Gaussians come from"),
    };
    let capture = wiring.add("capture".into(), capturing, ());
    let gaussians = wiring.add("reconstruct".into(), reconstructing, ());
    for trajectory in &recipe.trajectories {
        self::trajectory(recipe, trajectory, capture, gaussians, wiring);
    }
}

fn trajectory(
    recipe: &Recipe,
    trajectory: &TrajectoryRecipe,
    capture: Target<Capture>,
    gaussians: Target<Gaussians>,
    wiring: &mut Wiring<'_>,
) {
    let name = |step: &str| format!("{}/{step}", trajectory.name);
    let moving = Moving {
        path: Path::Refine(trajectory.refine.clone()),
        speed: trajectory.speed.clone(),
        law: Summation::Sum,
        rate: recipe.rate,
        seeing: None,
    };
    let motion = wiring.add(name("trajectory"), moving, (Some(capture), None, None));
    let events = recipe.outputs.contains(&Output::Events).then(|| {
        let seed = Seed::derive(recipe.seed, &recipe.scene, &trajectory.name, Purpose::Sensor);
        let simulating =
            Simulating { camera: recipe.camera, render: recipe.render, sensor: recipe.sensor.clone(), seed };
        wiring.add(name("events"), simulating, (capture, gaussians, motion))
    });
    if recipe.outputs.contains(&Output::Sharp) {
        let sharp = Photographing { camera: recipe.camera, render: recipe.render, every: recipe.sharp_every };
        wiring.add(name("sharp"), sharp, (capture, gaussians, motion));
    }
    let checking = Checking { limits: recipe.checks.clone() };
    wiring.add(name("checks"), checking, (motion, events));
}
