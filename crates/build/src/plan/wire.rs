//! From one recipe to the steps of its scene. A scene pays only for what it needs: no step exists
//! without an output that uses its product.

use super::{RendererPolicy, SceneWiring};
use crate::artifact::{DisparityPictures, EventStreams, ImuRecording, PictureSet, TrajectoryProduct};
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
use crate::stage::pass::PassInputs;
use crate::stage::poses::PosesStage;
use crate::stage::reconstruct::ReconstructStage;
use crate::stage::scene_checks::CheckingScene;
use crate::stage::segmentation::SegmentationStage;
use crate::stage::sharp::SharpStage;
use crate::stage::shot::ShotParameters;
use crate::stage::trajectory::{TrajectoryStage, ViewingSetup};
use crate::stage::{Stage, StepTarget};
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
    let external =
        ExternalToolsStage::for_limits(&recipe.checks, recipe.camera, &|program| renderers.version(program));
    let solving = wire_poses(recipe, renderers, wiring);
    let capture = wiring.add("capture".into(), capture_stage(recipe), solving);
    let gaussians = gaussians_stage(recipe).map(|stage| {
        // An input enters the key. A scene file that is given must not be read again when the
        // capture changes.
        let trained_on = stage.is_trained().then_some(capture);
        let solving = solving.filter(|_| trained_on.is_some());
        wiring.add("reconstruct".into(), stage, (trained_on, solving))
    });
    let objects = (!recipe.objects.is_empty()).then(|| ObjectsStage { objects: recipe.objects.clone() });
    // Only renderings of trajectories see the objects; photos and speeds are those of the scene at rest.
    let rendered =
        gaussians.map(|scene| objects.map_or(scene, |stage| wiring.add("objects".into(), stage, scene)));
    let ground = SceneGround { recipe, capture, solving, gaussians, rendered, backend, omit };
    // Trajectories that others are drawn from come first; otherwise the order of the recipe is
    // kept.
    let (drawn, own): (Vec<_>, Vec<_>) = recipe.trajectories.iter().partition(|t| t.base.is_some());
    let mut motions = BTreeMap::new();
    for trajectory in own.into_iter().chain(drawn) {
        let motion = match &trajectory.mounted {
            Some(mounted) => {
                let stage = MountStage { mount: mounted.camera.mount };
                wiring.add(format!("{}/trajectory", trajectory.name), stage, motions[mounted.body.as_str()])
            }
            None => {
                let base = trajectory.base.as_deref().map(|base| motions[base]);
                wire_motion(trajectory, base, ground, wiring)
            }
        };
        motions.insert(trajectory.name.as_str(), motion);
        let made = TrajectoryOutputs::default();
        let mut outputs = OutputWiring { trajectory: &trajectory.name, motion, ground, made, wiring };
        recipe.outputs_of(&trajectory.name).into_iter().for_each(|output| outputs.add_output(output));
        outputs.add_checks(external.clone());
    }
    if recipe.source.has_photos() {
        wire_photo_checks(ground, wiring);
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
        wiring.add("frames".into(), FramesStage { picking, capturing: captured.clone(), version }, ())
    });
    let version = renderers.version(VersionQuery::Colmap);
    let stage = PosesStage { solving, capturing: captured.clone(), version };
    Some((wiring.add("poses".into(), stage, frames), frames))
}

/// The stage that makes or reads the Gaussians, if a step uses them.
fn gaussians_stage(recipe: &Recipe) -> Option<ReconstructStage> {
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
fn wire_photo_checks(ground: SceneGround<'_>, wiring: &mut SceneWiring<'_>) {
    let SceneGround { recipe, capture, solving, gaussians, backend, .. } = ground;
    let fidelity = gaussians.map(|gaussians| {
        let stage = FidelityStage {
            render: recipe.render.of_views(),
            held_out: held_out_views(recipe),
            capturing: capture_stage(recipe),
            backend: backend.clone(),
        };
        wiring.add("fidelity".into(), stage, (capture, gaussians, solving))
    });
    let stage = CheckingScene { limits: recipe.checks.of_scene(), capturing: capture_stage(recipe) };
    wiring.add("checks".into(), stage, (capture, fidelity, solving));
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

/// A recipe, the common inputs of the steps of all its trajectories, and their renderer.
#[derive(Debug, Clone, Copy)]
struct SceneGround<'a> {
    recipe: &'a Recipe,
    capture: StepTarget<Capture>,
    /// The steps that find the poses, if the source has none.
    solving: SolvingInputs,
    /// Present if something is rendered.
    gaussians: Option<StepTarget<Gaussians>>,
    /// The same with the objects, if there are any.
    rendered: Option<StepTarget<Gaussians>>,
    backend: &'a Backend,
    omit: OmissionPolicy,
}

const RENDERED: &str = "recipes that have something rendered say where the Gaussians come from";

/// Adds the step of the path of a trajectory.
fn wire_motion(
    trajectory: &TrajectoryRecipe,
    base: Option<StepTarget<TrajectoryProduct>>,
    ground: SceneGround<'_>,
    wiring: &mut SceneWiring<'_>,
) -> StepTarget<TrajectoryProduct> {
    let SceneGround { recipe, capture, gaussians, .. } = ground;
    // Only a speed in image flow needs renderings to make the trajectory.
    let seeing = matches!(trajectory.speed, SpeedChoice::Flow(_)).then(|| ViewingSetup {
        camera: recipe.camera,
        render: recipe.render.of_views(),
        mount: recipe.rig.first().map(|first| first.mount),
        backend: ground.backend.clone(),
    });
    // Without a capture, an orbit that leaves something open is laid about the scene.
    let framing = recipe.camera.filter(|_| trajectory.path.needs_views() && !recipe.source.has_views());
    // Inputs that the path does not use stay out of the key, so a change of them makes no new
    // trajectory.
    let capture = (seeing.is_some() || trajectory.path.needs_views()).then_some(capture);
    let gaussians = gaussians.filter(|_| seeing.is_some() || framing.is_some());
    let (path, speed) = (trajectory.path.clone(), trajectory.speed.clone());
    let stage = TrajectoryStage { path, speed, law: recipe.law, rate: recipe.rate, seeing, framing };
    wiring.add(format!("{}/trajectory", trajectory.name), stage, (capture, base, gaussians))
}

/// The outputs of a trajectory that other steps read.
#[derive(Default, Clone, Copy)]
struct TrajectoryOutputs {
    events: Option<StepTarget<EventStreams>>,
    sharp: Option<StepTarget<PictureSet>>,
    imu: Option<StepTarget<ImuRecording>>,
    disparity: Option<StepTarget<DisparityPictures>>,
    depth: Option<StepTarget<PictureSet>>,
}

/// Adds the steps of the products of one trajectory, and of their checks.
struct OutputWiring<'a, 'p> {
    trajectory: &'a str,
    motion: StepTarget<TrajectoryProduct>,
    ground: SceneGround<'a>,
    made: TrajectoryOutputs,
    wiring: &'a mut SceneWiring<'p>,
}

impl OutputWiring<'_, '_> {
    fn add<S>(&mut self, step: &str, stage: S, inputs: S::Inputs) -> StepTarget<S::Output>
    where
        S: Stage + std::fmt::Debug + Send + Sync + 'static,
        S::Inputs: std::fmt::Debug + Send + Sync,
    {
        self.wiring.add(format!("{}/{step}", self.trajectory), stage, inputs)
    }

    /// The inputs of a product of rendered poses.
    fn rendered(&self) -> PassInputs {
        let SceneGround { capture, rendered, .. } = self.ground;
        (capture, rendered.expect(RENDERED), self.motion)
    }

    fn shot(&self) -> ShotParameters {
        let SceneGround { recipe, omit, backend, .. } = self.ground;
        let camera = recipe.camera_along(self.trajectory);
        ShotParameters { camera, render: recipe.render, omit, backend: backend.clone() }
    }

    // From names alone: a trajectory that is added changes no other one.
    fn seed(&self, purpose: StreamPurpose) -> Seed {
        let recipe = self.ground.recipe;
        Seed::for_stream(recipe.seed, &recipe.scene, self.trajectory, purpose)
    }

    /// Adds the step of one output.
    fn add_output(&mut self, output: OutputKind) {
        let (recipe, name) = (self.ground.recipe, output.name());
        let every = recipe.every.poses(output);
        match output {
            OutputKind::Events => {
                let sensors = recipe.sensors_of(self.trajectory);
                let stage = EventsStage {
                    tolerance: recipe.tolerance,
                    lights: recipe.lights.clone(),
                    ..EventsStage::new(sensors, self.seed(StreamPurpose::Sensor), self.shot())
                };
                self.made.events = Some(self.add(name, stage, self.rendered()));
            }
            OutputKind::Sharp => {
                // If every frame is kept, the middle frames of exposures are among them.
                let exposed = recipe.exposed_along(self.trajectory).filter(|_| every > 1);
                let (lights, readout_us) = (recipe.lights.clone(), recipe.readout_us);
                let stage = SharpStage { shot: self.shot(), every, lights, readout_us, exposed };
                self.made.sharp = Some(self.add(name, stage, self.rendered()));
            }
            OutputKind::Blur => {
                let (shutter, lights) = (recipe.shutter, recipe.lights.clone());
                self.add(name, BlurStage { shot: self.shot(), shutter, lights }, self.rendered());
            }
            OutputKind::Depth => {
                let stage = GeometryStage::<DepthQuantity>::new(self.shot(), every);
                self.made.depth = Some(self.add(name, stage, self.rendered()));
            }
            OutputKind::Flow => {
                self.add(name, GeometryStage::<FlowQuantity>::new(self.shot(), every), self.rendered());
            }
            OutputKind::Disparity => {
                let Some(pair) = self.stereo_pair() else { return };
                let CheckedPair { second, mounts, second_from_first, .. } = pair;
                let stage = DisparityStage { shot: self.shot(), every, second, mounts, second_from_first };
                self.made.disparity = Some(self.add(name, stage, self.rendered()));
            }
            OutputKind::Segmentation => {
                self.add(name, SegmentationStage { shot: self.shot(), every }, self.rendered());
            }
            OutputKind::Imu => {
                let Some(model) = recipe.imu.clone() else { return };
                // Without a direction of its own, the sensor needs the views.
                let views = model.up.is_none().then_some(self.ground.capture);
                let stage = ImuStage { model, seed: self.seed(StreamPurpose::Imu) };
                self.made.imu = Some(self.add(name, stage, (self.motion, views)));
            }
        }
    }

    /// Adds the step of the checks, and that of other programs if the recipe asks for them.
    fn add_checks(&mut self, external: Option<ExternalToolsStage>) {
        let SceneGround { recipe, capture, rendered, .. } = self.ground;
        let TrajectoryOutputs { events, sharp, imu, disparity, depth } = self.made;
        let foreign = external.filter(|_| !recipe.is_of_body(self.trajectory)).map(|external| {
            let camera = recipe.camera_along(self.trajectory);
            let stage = ExternalToolsStage { camera, ..external };
            self.add("foreign", stage, (capture, self.motion, sharp, events))
        });
        let stage = ChecksStage {
            limits: recipe.checks.of_trajectory(),
            light_changes: recipe.lights.is_some(),
            moves_by_itself: recipe.moves_by_itself(),
            imu: recipe.imu.clone().filter(|_| imu.is_some()),
            pair: disparity.and_then(|_| self.stereo_pair()),
            render: recipe.render,
        };
        // Depth and the capture serve the disparity alone.
        let products = (imu, disparity, depth.filter(|_| disparity.is_some()), disparity.map(|_| capture));
        let sharp = sharp.filter(|_| recipe.lights.is_none()).map(|sharp| StepTarget::new(sharp.step));
        // Events and the scene together say which Gaussian made a flash.
        let scene = rendered.filter(|_| events.is_some()).map(|rendered| StepTarget::new(rendered.step));
        self.add("checks", stage, (self.motion, events, foreign, (products, (sharp, scene))));
    }

    /// The stereo pair whose first camera sees along the trajectory.
    fn stereo_pair(&self) -> Option<CheckedPair> {
        let recipe = self.ground.recipe;
        let first = &recipe.mounted(self.trajectory)?.camera;
        let (second, second_from_first) = (first.second.as_ref()?, first.second_from_first()?);
        Some(CheckedPair {
            first: recipe.camera_along(self.trajectory),
            second: second.camera,
            mounts: [first.mount, second.mount],
            second_from_first,
        })
    }
}
