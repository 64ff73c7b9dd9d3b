//! Lengths of the paths of one scene: as the recipe states them, as built, or made from the poses and the
//! points of the source.

use super::PlanState;
use crate::artifact::{Artifact, ArtifactFiles, SolvedModel, TrajectoryProduct};
use crate::stage::PathLength;
use glam::DVec3;
use gs2e_demo as procedural;
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_recipe::{Recipe, ReconstructMethod, SceneSource, TrajectoryRecipe};
use gs2e_render::points::PointFlowMeter;
use gs2e_scene as scene;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::{Camera, choose_camera};
use gs2e_scene::survey::SceneSurvey;
use gs2e_source::Capture;
use gs2e_source::colmap::ColmapModel;
use gs2e_trajectory::flow::FlowMeter;
use gs2e_trajectory::novel::BaseTrajectory;
use gs2e_trajectory::path::{PathInputs, SceneFraming};
use gs2e_trajectory::speed::{FlowSpeed, SpeedChoice};
use gs2e_trajectory::twist::pose_twists;
use gs2e_trajectory::{NamedPose, PoseTiming};
use std::collections::BTreeMap;

/// Largest number of poses that are made to learn their motion.
const MADE: f64 = 1e6;
/// Number of places at which the motion of a path is measured.
const PLACES: usize = 9;
/// Motion of the pixels of a rendering over that of the points of a scene. Hidden points are farther than
/// what hides them, and slow the median. Over eight paths along five scenes it was 1.01 to 1.22.
const IN_FRONT: f64 = 1.1;
/// Opacity logit from which on a Gaussian counts as a point of a surface: an opacity of a half.
const SOLID: f32 = 0.0;

/// The length of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TrajectoryLength {
    pub(super) path: PathLength,
    /// Motion of the picture over the whole path, px, if the source tells.
    pub(super) moved_px: Option<f64>,
    /// Size of the pictures.
    pub(super) size: Size,
}

/// The poses of a trajectory, with the scale from which novel ones are drawn.
struct KnownPath {
    poses: Vec<Se3>,
    seconds: f64,
    scale: f64,
}

/// The trajectories of one scene.
pub(super) struct SceneLengths<'a> {
    recipe: &'a Recipe,
    /// Poses of the trajectories that are built.
    built: BTreeMap<&'a str, KnownPath>,
    capture: Option<Capture>,
    meter: Option<PointFlowMeter>,
    framing: Option<SceneFraming>,
}

impl<'a> SceneLengths<'a> {
    pub(super) fn new(state: PlanState<'a>, scene: usize) -> Self {
        let recipe = &state.plan.scenes()[scene];
        let built = recipe.trajectories.iter().filter_map(|own| {
            let motion: TrajectoryProduct = opened(state, scene, &format!("{}/trajectory", own.name))?;
            let TrajectoryProduct { trajectory, report } = motion;
            let seconds = trajectory.stamps_us.last().map_or(0.0, |us| *us as f64 * 1e-6);
            let (poses, scale) = (trajectory.world_from_camera, report.scale_distance);
            Some((own.name.as_str(), KnownPath { poses, seconds, scale }))
        });
        let built: BTreeMap<&str, KnownPath> = built.collect();
        let is_open = recipe.trajectories.iter().any(|own| !built.contains_key(own.name.as_str()));
        let capture = opened(state, scene, "capture").or_else(|| capture_of(recipe));
        let own = capture.as_ref().and_then(Capture::camera).map(|(camera, _)| camera);
        let camera = choose_camera(recipe.camera, own.as_ref());
        // A scene may be large, and is only looked at where a path is not known without it.
        let gaussians = if is_open { gaussians_of(recipe) } else { None };
        let solved = opened::<SolvedModel>(state, scene, "poses").map(|solved| solved.model);
        let points = if is_open {
            solved.or_else(|| model_of(recipe)).and_then(|model| points_of(&model))
        } else {
            None
        };
        let points = points.or_else(|| gaussians.as_ref().map(solid_points));
        let meter = points.zip(camera).map(|(points, camera)| PointFlowMeter { points, camera });
        // Only without views is an orbit laid about the scene.
        let gaussians = gaussians.filter(|scene| !scene.is_empty() && !recipe.source.has_views());
        let framing = gaussians
            .zip(camera)
            .map(|(scene, camera)| SceneFraming { survey: SceneSurvey::measure_scene(&scene), camera });
        Self { recipe, built, capture, meter, framing }
    }

    /// The size of the pictures along a trajectory, if it is known.
    fn size_along(&self, trajectory: &str) -> Option<Size> {
        let own = self.capture.as_ref().and_then(Capture::camera).map(|(camera, _)| camera);
        let choice = self.recipe.camera_along(trajectory);
        let stated = choice.map(|choice| Size { width: choice.width, height: choice.height });
        stated.or_else(|| own.map(|Camera { size, .. }| size))
    }

    /// The length of a trajectory, if it is known with the size of its pictures.
    pub(super) fn of(&mut self, name: &str) -> Option<TrajectoryLength> {
        let trajectory = self.recipe.trajectories.iter().find(|own| own.name == name)?;
        let followed = trajectory.mounted.as_ref().map_or(name, |mounted| mounted.body.as_str());
        let body = self.recipe.trajectories.iter().find(|own| own.name == followed)?;
        let rate = self.recipe.rate;
        let stated = body.path.stated_poses(rate);
        let known = if stated.is_some_and(|poses| poses > MADE) { None } else { self.poses_of(body) };
        let path = match (&known, stated) {
            (Some(known), _) => PathLength { poses: known.poses.len() as f64, seconds: known.seconds },
            (None, Some(poses)) => PathLength::at_rate(poses, rate.to_f64()),
            (None, None) => return None,
        };
        let moved_px = match &body.speed {
            SpeedChoice::Flow(flow) => Some(flow.px_s * path.seconds),
            _ => known.and_then(|known| self.moved_px(&known)),
        };
        Some(TrajectoryLength { path, moved_px, size: self.size_along(name)? })
    }

    /// The poses of a trajectory as built, or made from the source.
    fn poses_of(&mut self, trajectory: &TrajectoryRecipe) -> Option<KnownPath> {
        if let Some(known) = self.built.get(trajectory.name.as_str()) {
            let KnownPath { poses, seconds, scale } = known;
            return Some(KnownPath { poses: poses.clone(), seconds: *seconds, scale: *scale });
        }
        let base = match &trajectory.base {
            Some(name) => {
                let base = self.recipe.trajectories.iter().find(|own| own.name == *name)?;
                Some(self.poses_of(base)?)
            }
            None => None,
        };
        let base = base.as_ref().map(|base| BaseTrajectory { poses: &base.poses, scale: base.scale });
        let views = self.capture.as_ref().map_or(&[][..], |capture| &capture.views);
        let views = views.iter();
        let views = views.map(|v| NamedPose { name: &v.name, world_from_camera: v.world_from_camera });
        let views: Vec<NamedPose<'_>> = views.collect();
        let speed = match trajectory.speed.clone() {
            // The recipe states the speed in renderings, and the meter sees the points, which move less.
            SpeedChoice::Flow(flow) => SpeedChoice::Flow(FlowSpeed { px_s: flow.px_s / IN_FRONT, ..flow }),
            other => other,
        };
        let timing = PoseTiming { speed: &speed, rate: self.recipe.rate, law: self.recipe.law };
        let mut meter = self.meter.clone();
        let meter = meter.as_mut().map(|meter| meter as &mut dyn FlowMeter);
        let inputs = PathInputs { views: &views, base, scene: self.framing };
        let made = trajectory.path.make(inputs, timing, meter).ok()?;
        let seconds = made.trajectory.stamps_us.last().map_or(0.0, |us| *us as f64 * 1e-6);
        Some(KnownPath {
            poses: made.trajectory.world_from_camera,
            seconds,
            scale: made.report.scale_distance,
        })
    }

    /// Motion of the picture along poses at equal times.
    fn moved_px(&self, path: &KnownPath) -> Option<f64> {
        let (meter, last) = (self.meter.as_ref()?, path.poses.len().checked_sub(1).filter(|last| *last > 0)?);
        let places = PLACES.min(last);
        let speed = |place: usize| {
            // The last place is one pose before the end, because a velocity takes two poses.
            let at = if places > 1 { place * (last - 1) / (places - 1) } else { 0 };
            let step = path.seconds / last as f64;
            let [twist, _] = pose_twists(&path.poses[at..at + 2], &[0.0, step])[..] else { return None };
            meter.speed_px(&path.poses[at], &twist)
        };
        let speeds: Vec<f64> = (0..places).filter_map(speed).collect();
        (!speeds.is_empty())
            .then(|| IN_FRONT * speeds.iter().sum::<f64>() / speeds.len() as f64 * path.seconds)
    }
}

/// The capture, if its poses are known before a build.
fn capture_of(recipe: &Recipe) -> Option<Capture> {
    match &recipe.source {
        SceneSource::Procedural(still_life) => Some(procedural::still_capture(still_life)),
        SceneSource::Captured(captured, _) => captured.glance().ok().map(|(capture, _)| capture),
        SceneSource::None => None,
    }
}

/// The product of a step that is up to date.
fn opened<T: Artifact>(state: PlanState<'_>, scene: usize, step: &str) -> Option<T> {
    let (id, _) = state.plan.steps_of(scene).find(|(_, planned)| planned.name == step)?;
    let outputs = state.assessed[id.0].outputs.as_deref()?;
    T::open(&ArtifactFiles::from_outputs(outputs, state.store)).ok()
}

/// The COLMAP model of a source on disk.
fn model_of(recipe: &Recipe) -> Option<ColmapModel> {
    let SceneSource::Captured(captured, _) = &recipe.source else { return None };
    captured.model()
}

fn points_of(model: &ColmapModel) -> Option<Vec<DVec3>> {
    let points = model.points().ok()?;
    (!points.is_empty()).then(|| points.into_values().map(|point| point.xyz).collect())
}

/// The Gaussians, where the recipe has them already.
fn gaussians_of(recipe: &Recipe) -> Option<Gaussians> {
    match (&recipe.reconstruct, &recipe.source) {
        (Some(ReconstructMethod::Given(path)), _) => scene::read_file(path).ok(),
        (None, SceneSource::Procedural(still_life)) => Some(procedural::still_life(still_life)),
        _ => None,
    }
}

fn solid_points(scene: &Gaussians) -> Vec<DVec3> {
    let solid = (0..scene.len()).filter(|i| scene.opacity_logits[*i] >= SOLID);
    solid.map(|i| scene.position(i)).collect()
}
