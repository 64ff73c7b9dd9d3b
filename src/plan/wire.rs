//! From one recipe to the steps of its scene. A scene pays only for what it needs: no step exists
//! without an output that uses its product.

use super::{Renderers, Wiring};
use crate::artifact::{Motion, Pictures};
use crate::recipe::{Output, Recipe, Reconstruct, Source, TrajectoryRecipe};
use crate::render::Omit;
use crate::render::backend::Backend;
use crate::scene::Gaussians;
use crate::seed::{Purpose, Seed};
use crate::source::Capture;
use crate::speed::Speed;
use crate::stage::Target;
use crate::stage::blur::Exposing;
use crate::stage::capture::Capturing;
use crate::stage::checks::Checking;
use crate::stage::events::Simulating;
use crate::stage::fidelity::Comparing;
use crate::stage::foreign::Asking;
use crate::stage::geometry::{Depth, Flow, Measuring};
use crate::stage::reconstruct::Reconstructing;
use crate::stage::scene_checks::CheckingScene;
use crate::stage::sharp::Photographing;
use crate::stage::shot::Shot;
use crate::stage::trajectory::{Moving, Seeing};
use std::collections::BTreeMap;

/// Adds the steps of one scene.
pub(super) fn wire_scene(recipe: &Recipe, renderers: &dyn Renderers, wiring: &mut Wiring<'_>) {
    let (backend, omit) = (&renderers.of(recipe), renderers.omit());
    let asking = Asking::for_limits(&recipe.checks, recipe.camera, &|program| renderers.version(program));
    let capture = wiring.add("capture".into(), capture_stage(recipe), ());
    let gaussians = wire_gaussians(recipe).map(|reconstructing| {
        let trained_on = matches!(reconstructing, Reconstructing::Command(_)).then_some(capture);
        wiring.add("reconstruct".into(), reconstructing, trained_on)
    });
    let ground = Ground { capture, gaussians, backend, omit, asking: asking.as_ref() };
    // Those that others are drawn from come first, wherever the recipe has them; else its order is kept.
    let (drawn, own): (Vec<_>, Vec<_>) = recipe.trajectories.iter().partition(|t| t.base.is_some());
    let mut motions = BTreeMap::new();
    for trajectory in own.into_iter().chain(drawn) {
        let base = trajectory.base.as_deref().map(|base| motions[base]);
        let motion = self::wire_trajectory(recipe, trajectory, base, ground, wiring);
        motions.insert(trajectory.name.as_str(), motion);
    }
    if recipe.source.has_photos() {
        wire_photo_checks(recipe, ground, wiring);
    }
}

/// The Gaussians, if a step uses them.
fn wire_gaussians(recipe: &Recipe) -> Option<Reconstructing> {
    match (&recipe.reconstruct, &recipe.source) {
        (Some(Reconstruct::Given(file)), _) => Some(Reconstructing::from_file(file)),
        (Some(Reconstruct::Newest(model)), _) => Some(Reconstructing::newest_of(model)),
        (Some(Reconstruct::Command(command)), _) => {
            Some(Reconstructing::from_command(command, capture_stage(recipe), recipe.render))
        }
        (None, Source::Procedural(still_life)) => Some(Reconstructing::procedural(still_life)),
        (None, _) => None,
    }
}

/// The comparison of the scene with its photos, and of its capture with itself.
fn wire_photo_checks(recipe: &Recipe, ground: Ground<'_>, wiring: &mut Wiring<'_>) {
    let Ground { capture, gaussians, backend, .. } = ground;
    let fidelity = gaussians.map(|gaussians| {
        let comparing =
            Comparing { render: recipe.render, capturing: capture_stage(recipe), backend: backend.clone() };
        wiring.add("fidelity".into(), comparing, (capture, gaussians))
    });
    let checking = CheckingScene { limits: recipe.checks.of_scene(), capturing: capture_stage(recipe) };
    wiring.add("checks".into(), checking, (capture, fidelity));
}

fn capture_stage(recipe: &Recipe) -> Capturing {
    match &recipe.source {
        Source::Procedural(still_life) => Capturing::procedural(still_life),
        Source::Captured(captured, _) => Capturing::Captured(captured.clone()),
        Source::None => Capturing::None,
    }
}

/// Common inputs of the steps of all trajectories, and their renderer.
#[derive(Debug, Clone, Copy)]
struct Ground<'a> {
    capture: Target<Capture>,
    /// Present if something is rendered.
    gaussians: Option<Target<Gaussians>>,
    backend: &'a Backend,
    omit: Omit,
    /// The other programs that trajectories are held against.
    asking: Option<&'a Asking>,
}

const RENDERED: &str = "recipes that have something rendered say where the Gaussians come from";

fn wire_trajectory(
    recipe: &Recipe,
    trajectory: &TrajectoryRecipe,
    base: Option<Target<Motion>>,
    ground: Ground<'_>,
    wiring: &mut Wiring<'_>,
) -> Target<Motion> {
    let Ground { capture, gaussians, backend, omit, asking } = ground;
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
    let motion = wiring.add(name("trajectory"), moving, (captured, base, gaussians.filter(|_| sees)));
    let events = recipe.outputs.contains(&Output::Events).then(|| {
        let seed = Seed::for_stream(recipe.seed, &recipe.scene, &trajectory.name, Purpose::Sensor);
        let simulating = Simulating {
            omit,
            backend: backend(),
            tolerance: recipe.tolerance,
            ..Simulating::new(&recipe.sensors, seed, (recipe.camera, recipe.render))
        };
        wiring.add(name("events"), simulating, (capture, gaussians.expect(RENDERED), motion))
    });
    let sharp = wire_pictures(recipe, &trajectory.name, motion, ground, wiring);
    let foreign =
        asking.map(|asking| wiring.add(name("foreign"), asking.clone(), (capture, motion, sharp, events)));
    let checking = Checking { limits: recipe.checks.of_trajectory() };
    wiring.add(name("checks"), checking, (motion, events, foreign));
    motion
}

/// The requested steps that render the pictures of a release. Other steps read the sharp ones.
fn wire_pictures(
    recipe: &Recipe,
    trajectory: &str,
    motion: Target<Motion>,
    ground: Ground<'_>,
    wiring: &mut Wiring<'_>,
) -> Option<Target<Pictures>> {
    let Ground { capture, gaussians, backend, omit, .. } = ground;
    let shot = || Shot { camera: recipe.camera, render: recipe.render, omit, backend: backend.clone() };
    let name = |step: &str| format!("{trajectory}/{step}");
    let inputs = || (capture, gaussians.expect(RENDERED), motion);
    let asks = |output: Output| recipe.outputs.contains(&output);
    let sharp = asks(Output::Sharp).then(|| {
        // If every frame is kept, those in the middle of exposures are.
        let exposed = (asks(Output::Blur) && recipe.every.sharp > 1).then_some(recipe.shutter.frames);
        let sharp = Photographing { shot: shot(), every: recipe.every.sharp, exposed };
        wiring.add(name("sharp"), sharp, inputs())
    });
    if asks(Output::Blur) {
        wiring.add(name("blur"), Exposing { shot: shot(), shutter: recipe.shutter }, inputs());
    }
    if asks(Output::Depth) {
        wiring.add(name("depth"), Measuring::<Depth>::new(shot(), recipe.every.depth), inputs());
    }
    if asks(Output::Flow) {
        wiring.add(name("flow"), Measuring::<Flow>::new(shot(), recipe.every.flow), inputs());
    }
    sharp
}
