//! From one recipe to the steps of its scene. A scene pays only for what it needs: no step exists
//! without an output that uses its product.

use super::{RendererPolicy, SceneWiring};
use crate::artifact::{DisparityPictures, EventStreams, ImuRecording, PictureSet, TrajectoryProduct};
use crate::stage::StepTarget;
use crate::stage::blur::BlurStage;
use crate::stage::capture::{CaptureStage, SolvingInputs};
use crate::stage::checks::{CheckedPair, ChecksStage};
use crate::stage::disparity::DisparityStage;
use crate::stage::events::EventsStage;
use crate::stage::fidelity::FidelityStage;
use crate::stage::foreign::ExternalToolsStage;
use crate::stage::frames::FramesStage;
use crate::stage::geometry::{DepthQuantity, FlowQuantity, GeometryStage};
use crate::stage::imu::ImuStage;
use crate::stage::mount::MountStage;
use crate::stage::objects::ObjectsStage;
use crate::stage::poses::PosesStage;
use crate::stage::reconstruct::ReconstructStage;
use crate::stage::scene_checks::CheckingScene;
use crate::stage::segmentation::SegmentationStage;
use crate::stage::sharp::SharpStage;
use crate::stage::shot::ShotParameters;
use crate::stage::trajectory::{TrajectoryStage, ViewingSetup};
use gs2e_num::seed::{Seed, StreamPurpose};
use gs2e_recipe::{OutputKind, Recipe, ReconstructMethod, SceneSource, TrajectoryRecipe};
use gs2e_render::OmissionPolicy;
use gs2e_render::backend::Backend;
use gs2e_scene::Gaussians;
use gs2e_source::Capture;
use gs2e_source::foreign::versions::VersionQuery;
use gs2e_train::fidelity::HeldOutViews;
use gs2e_trajectory::speed::SpeedChoice;
use std::collections::BTreeMap;

/// Adds the steps of one scene.
pub(super) fn wire_scene(recipe: &Recipe, renderers: &dyn RendererPolicy, wiring: &mut SceneWiring<'_>) {
    let (backend, omit) = (&renderers.of(recipe), renderers.omit());
    let asking =
        ExternalToolsStage::for_limits(&recipe.checks, recipe.camera, &|program| renderers.version(program));
    let solving = wire_poses(recipe, renderers, wiring);
    let capture = wiring.add("capture".into(), capture_stage(recipe), solving);
    let gaussians = wire_gaussians(recipe).map(|reconstructing| {
        // An input enters the key. A scene file that is given must not be read again when the
        // capture changes.
        let trained_on = reconstructing.is_trained().then_some(capture);
        let solving = solving.filter(|_| trained_on.is_some());
        wiring.add("reconstruct".into(), reconstructing, (trained_on, solving))
    });
    let moving = (!recipe.objects.is_empty()).then(|| ObjectsStage { objects: recipe.objects.clone() });
    // Only renderings of trajectories see the objects; photos and speeds are those of the scene at rest.
    let seen =
        gaussians.map(|scene| moving.map_or(scene, |moving| wiring.add("objects".into(), moving, scene)));
    let ground = SceneGround { capture, solving, gaussians, seen, backend, omit };
    // Trajectories that others are drawn from come first; otherwise the order of the recipe is
    // kept.
    let (drawn, own): (Vec<_>, Vec<_>) = recipe.trajectories.iter().partition(|t| t.base.is_some());
    let mut motions = BTreeMap::new();
    for trajectory in own.into_iter().chain(drawn) {
        let motion = match &trajectory.mounted {
            Some(mounted) => {
                let mounting = MountStage { mount: mounted.camera.mount };
                wiring.add(
                    format!("{}/trajectory", trajectory.name),
                    mounting,
                    motions[mounted.body.as_str()],
                )
            }
            None => {
                let base = trajectory.base.as_deref().map(|base| motions[base]);
                wire_motion(recipe, trajectory, base, ground, wiring)
            }
        };
        motions.insert(trajectory.name.as_str(), motion);
        let camera = recipe.camera_along(&trajectory.name);
        let asking = asking.clone().map(|asking| ExternalToolsStage { camera, ..asking });
        wire_outputs(recipe, &trajectory.name, (motion, asking), ground, wiring);
    }
    if recipe.source.has_photos() {
        wire_photo_checks(recipe, ground, wiring);
    }
}

/// Adds the steps that find the poses of a source without poses.
fn wire_poses(
    recipe: &Recipe,
    renderers: &dyn RendererPolicy,
    wiring: &mut SceneWiring<'_>,
) -> SolvingInputs {
    let captured = recipe.source.captured()?;
    let solving = captured.solving.clone()?;
    let frames = solving.frames.map(|picking| {
        let version = renderers.version(VersionQuery::Ffmpeg);
        let taking = FramesStage { picking, capturing: captured.clone(), version };
        wiring.add("frames".into(), taking, ())
    });
    let version = renderers.version(VersionQuery::Colmap);
    let finding = PosesStage { solving, capturing: captured.clone(), version };
    Some((wiring.add("poses".into(), finding, frames), frames))
}

/// The stage that makes or reads the Gaussians, if a step uses them.
fn wire_gaussians(recipe: &Recipe) -> Option<ReconstructStage> {
    match (&recipe.reconstruct, &recipe.source) {
        (Some(ReconstructMethod::Given(file)), _) => Some(ReconstructStage::from_file(file)),
        (Some(ReconstructMethod::Changing(path, time)), _) => Some(ReconstructStage::changing(path, *time)),
        (Some(ReconstructMethod::Newest(model)), _) => Some(ReconstructStage::newest_of(model)),
        (Some(ReconstructMethod::Command(command)), _) => {
            Some(ReconstructStage::from_command(command, capture_stage(recipe), recipe.render.of_views()))
        }
        (Some(ReconstructMethod::Builtin(training)), _) => {
            Some(ReconstructStage::builtin(training.with_render(&recipe.render), capture_stage(recipe)))
        }
        (None, SceneSource::Procedural(still_life)) => Some(ReconstructStage::procedural(still_life)),
        (None, _) => None,
    }
}

/// The comparison of the scene with its photos, and of its capture with itself.
fn wire_photo_checks(recipe: &Recipe, ground: SceneGround<'_>, wiring: &mut SceneWiring<'_>) {
    let SceneGround { capture, solving, gaussians, backend, .. } = ground;
    let fidelity = gaussians.map(|gaussians| {
        let comparing = FidelityStage {
            render: recipe.render.of_views(),
            held_out: held_out_views(recipe),
            capturing: capture_stage(recipe),
            backend: backend.clone(),
        };
        wiring.add("fidelity".into(), comparing, (capture, gaussians, solving))
    });
    let checking = CheckingScene { limits: recipe.checks.of_scene(), capturing: capture_stage(recipe) };
    wiring.add("checks".into(), checking, (capture, fidelity, solving));
}

/// The views that the training of the recipe's scene does not see. A program that gets all views may
/// hold some out itself.
fn held_out_views(recipe: &Recipe) -> HeldOutViews {
    match &recipe.reconstruct {
        Some(ReconstructMethod::Builtin(training)) => HeldOutViews::by_training(training.hold_out),
        Some(ReconstructMethod::Command(command)) => {
            command.hold_out.map_or(HeldOutViews::Unknown, HeldOutViews::by_training)
        }
        Some(
            ReconstructMethod::Given(_) | ReconstructMethod::Changing(..) | ReconstructMethod::Newest(_),
        )
        | None => HeldOutViews::Unknown,
    }
}

fn capture_stage(recipe: &Recipe) -> CaptureStage {
    match &recipe.source {
        SceneSource::Procedural(still_life) => CaptureStage::procedural(still_life),
        SceneSource::Captured(captured, _) => CaptureStage::Captured(captured.clone()),
        SceneSource::None => CaptureStage::None,
    }
}

/// Common inputs of the steps of all trajectories, and their renderer.
#[derive(Debug, Clone, Copy)]
struct SceneGround<'a> {
    capture: StepTarget<Capture>,
    /// The steps that find the poses, if the source has none.
    solving: SolvingInputs,
    /// Present if something is rendered.
    gaussians: Option<StepTarget<Gaussians>>,
    /// The same with the objects, if there are any.
    seen: Option<StepTarget<Gaussians>>,
    backend: &'a Backend,
    omit: OmissionPolicy,
}

const RENDERED: &str = "recipes that have something rendered say where the Gaussians come from";

/// Adds the step of the path of a trajectory.
fn wire_motion(
    recipe: &Recipe,
    trajectory: &TrajectoryRecipe,
    base: Option<StepTarget<TrajectoryProduct>>,
    ground: SceneGround<'_>,
    wiring: &mut SceneWiring<'_>,
) -> StepTarget<TrajectoryProduct> {
    let SceneGround { capture, gaussians, .. } = ground;
    // Only a speed in image flow needs renderings to make the trajectory.
    let seeing = matches!(trajectory.speed, SpeedChoice::Flow(_)).then(|| ViewingSetup {
        camera: recipe.camera,
        render: recipe.render.of_views(),
        mount: recipe.rig.first().map(|first| first.mount),
        backend: ground.backend.clone(),
    });
    // Without a capture, an orbit that leaves something open is laid about the scene.
    let framing = recipe.camera.filter(|_| trajectory.path.needs_views() && !recipe.source.has_views());
    let sees = seeing.is_some();
    let moving = TrajectoryStage {
        path: trajectory.path.clone(),
        speed: trajectory.speed.clone(),
        law: recipe.law,
        rate: recipe.rate,
        seeing,
        framing,
    };
    // Inputs that the path does not use stay out of the key, so a change of them makes no new
    // trajectory.
    let captured = (sees || trajectory.path.needs_views()).then_some(capture);
    wiring.add(
        format!("{}/trajectory", trajectory.name),
        moving,
        (captured, base, gaussians.filter(|_| sees || framing.is_some())),
    )
}

/// Adds the steps of the products of a trajectory, and of its checks.
fn wire_outputs(
    recipe: &Recipe,
    trajectory: &str,
    (motion, asking): (StepTarget<TrajectoryProduct>, Option<ExternalToolsStage>),
    ground: SceneGround<'_>,
    wiring: &mut SceneWiring<'_>,
) {
    let name = |step: &str| format!("{trajectory}/{step}");
    let mut made = MadeOutputs::default();
    for output in recipe.outputs_of(trajectory) {
        wire_output(output, (recipe, trajectory), (motion, ground), &mut made, wiring);
    }
    let MadeOutputs { events, sharp, imu, disparity, depth } = made;
    let asking = asking.filter(|_| !recipe.is_of_body(trajectory));
    let foreign =
        asking.map(|asking| wiring.add(name("foreign"), asking, (ground.capture, motion, sharp, events)));
    let checking = ChecksStage {
        limits: recipe.checks.of_trajectory(),
        light_changes: recipe.lights.is_some(),
        own_motion: recipe.moves_by_itself(),
        imu: recipe.imu.clone().filter(|_| imu.is_some()),
        pair: disparity.and_then(|_| checked_pair(recipe, trajectory)),
        render: recipe.render,
    };
    // Depth and the capture serve the disparity alone.
    let products = (imu, disparity, depth.filter(|_| disparity.is_some()), disparity.map(|_| ground.capture));
    let sharp = sharp.filter(|_| recipe.lights.is_none()).map(|sharp| StepTarget::new(sharp.step));
    // Events and the scene together say which Gaussian made a flash.
    let scene = ground.seen.filter(|_| events.is_some()).map(|seen| StepTarget::new(seen.step));
    wiring.add(name("checks"), checking, (motion, events, foreign, (products, (sharp, scene))));
}

/// The stereo pair whose first camera sees along a trajectory.
fn checked_pair(recipe: &Recipe, trajectory: &str) -> Option<CheckedPair> {
    let first = &recipe.mounted(trajectory)?.camera;
    let (second, second_from_first) = (first.second.as_ref()?, first.second_from_first()?);
    let mounts = [first.mount, second.mount];
    Some(CheckedPair {
        first: recipe.camera_along(trajectory),
        second: second.camera,
        mounts,
        second_from_first,
    })
}

/// The outputs of a trajectory that other steps read.
#[derive(Default)]
struct MadeOutputs {
    events: Option<StepTarget<EventStreams>>,
    sharp: Option<StepTarget<PictureSet>>,
    imu: Option<StepTarget<ImuRecording>>,
    disparity: Option<StepTarget<DisparityPictures>>,
    depth: Option<StepTarget<PictureSet>>,
}

/// Adds the step of one output of a trajectory.
fn wire_output(
    output: OutputKind,
    (recipe, trajectory): (&Recipe, &str),
    (motion, ground): (StepTarget<TrajectoryProduct>, SceneGround<'_>),
    made: &mut MadeOutputs,
    wiring: &mut SceneWiring<'_>,
) {
    let SceneGround { capture, seen, backend, omit, .. } = ground;
    let backend = || backend.clone();
    let camera = recipe.camera_along(trajectory);
    let shot = || ShotParameters { camera, render: recipe.render, omit, backend: backend() };
    let name = format!("{trajectory}/{}", output.name());
    let every = recipe.every.poses(output);
    if output == OutputKind::Imu {
        let Some(model) = recipe.imu.clone() else { return };
        let seed = Seed::for_stream(recipe.seed, &recipe.scene, trajectory, StreamPurpose::Imu);
        // Without a direction of its own, the sensor needs the views.
        let views = model.up.is_none().then_some(capture);
        made.imu = Some(wiring.add(name, ImuStage { model, seed }, (motion, views)));
        return;
    }
    let inputs = (capture, seen.expect(RENDERED), motion);
    match output {
        OutputKind::Events => {
            // From names alone: a trajectory that is added changes no other one.
            let seed = Seed::for_stream(recipe.seed, &recipe.scene, trajectory, StreamPurpose::Sensor);
            let simulating = EventsStage {
                omit,
                backend: backend(),
                tolerance: recipe.tolerance,
                lights: recipe.lights.clone(),
                ..EventsStage::new(recipe.sensors_of(trajectory), seed, (camera, recipe.render))
            };
            made.events = Some(wiring.add(name, simulating, inputs));
        }
        OutputKind::Sharp => {
            // If every frame is kept, the middle frames of exposures are among them.
            let exposed = recipe.exposed_along(trajectory).filter(|_| every > 1);
            let (lights, readout_us) = (recipe.lights.clone(), recipe.readout_us);
            let stage = SharpStage { shot: shot(), every, lights, readout_us, exposed };
            made.sharp = Some(wiring.add(name, stage, inputs));
        }
        OutputKind::Blur => {
            let lights = recipe.lights.clone();
            wiring.add(name, BlurStage { shot: shot(), shutter: recipe.shutter, lights }, inputs);
        }
        OutputKind::Depth => {
            made.depth = Some(wiring.add(name, GeometryStage::<DepthQuantity>::new(shot(), every), inputs));
        }
        OutputKind::Flow => {
            wiring.add(name, GeometryStage::<FlowQuantity>::new(shot(), every), inputs);
        }
        OutputKind::Disparity => {
            let Some(stage) = disparity_stage(recipe, trajectory, (shot(), every)) else { return };
            made.disparity = Some(wiring.add(name, stage, inputs));
        }
        OutputKind::Segmentation => {
            wiring.add(name, SegmentationStage { shot: shot(), every }, inputs);
        }
        OutputKind::Imu => unreachable!("it was wired above"),
    }
}

/// The stage of the disparity of the stereo pair whose first camera sees along a trajectory.
fn disparity_stage(
    recipe: &Recipe,
    trajectory: &str,
    (shot, every): (ShotParameters, u32),
) -> Option<DisparityStage> {
    let first = &recipe.mounted(trajectory)?.camera;
    let (second, second_from_first) = (first.second.as_ref()?, first.second_from_first()?);
    let mounts = [first.mount, second.mount];
    Some(DisparityStage { shot, every, second: second.camera, mounts, second_from_first })
}
