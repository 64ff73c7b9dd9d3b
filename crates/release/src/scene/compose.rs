//! The record of a scene, composed from what was built.

use super::attributes::scene_attributes;
use super::{
    CameraPart, ImagePart, ReconstructionPart, SceneConventions, SceneRecord, SourcePart, TrajectoryPart,
    licence, trajectory,
};
use crate::built::BuiltScene;
use gs2e_files::natural;
use gs2e_num::seed::{Seed, StreamPurpose};
use gs2e_recipe::{Recipe, ReconstructMethod};
use gs2e_scene::camera::Camera;
use gs2e_source::reconstruct::TrainerCommand;
use gs2e_source::{Capture, CapturedView, UnusedPhoto};
use gs2e_trajectory::path::CameraPath;
use serde_json::json;
use std::collections::BTreeMap;

/// Composes the file.
///
/// # Errors
/// A blob that must be hashed cannot be read.
pub fn compose_scene(scene: &BuiltScene<'_>) -> std::io::Result<SceneRecord> {
    let recipe = scene.recipe;
    let compact = serde_json::to_vec(&recipe.meta.merged).expect("a JSON value is writable");
    let trajectories: Vec<TrajectoryPart> =
        scene.trajectories.iter().map(|t| trajectory::trajectory_part(scene, t)).collect();
    Ok(SceneRecord {
        schema: 1,
        id: recipe.scene.clone(),
        gs2e_version: env!("CARGO_PKG_VERSION").into(),
        source: source_part(recipe),
        images: capture_images(scene),
        camera: camera_part(scene, scene.camera()),
        conventions: SceneConventions::for_brightness(&recipe.meta.merged),
        reconstruction: reconstruction_part(scene)?,
        licence: licence::licence_part(recipe, &scene.licence),
        seed: recipe.seed,
        seeds: draw_seeds(recipe),
        recipe: recipe.meta.merged.clone(),
        recipe_sha256: super::super::checksum::sha256_hex(&compact),
        // Splits are a rule of the release, which deals them when all scenes are composed.
        split: None,
        attributes: scene_attributes(
            recipe,
            &scene.licence,
            scene.trajectories.iter().map(|t| &t.motion.report),
            &trajectories,
        ),
        trajectories,
    })
}

pub(super) fn source_part(recipe: &Recipe) -> SourcePart {
    let upstream = recipe.source.upstream().cloned().unwrap_or_default();
    SourcePart {
        kind: recipe.source.kind().name().into(),
        upstream_id: upstream.id,
        upstream_url: upstream.url,
        accessed: upstream.accessed,
        terms_accepted: upstream.terms_accepted,
    }
}

/// All photos of the source, used and unused, in natural order of the names.
fn capture_images(scene: &BuiltScene<'_>) -> Vec<ImagePart> {
    if !scene.recipe.source.has_photos() {
        // The embedded scene has views but no photos.
        return Vec::new();
    }
    let image = |view: &CapturedView| ImagePart {
        name: view.name.clone(),
        sha256: view.sha256.clone(),
        width: Some(view.camera.size.width),
        height: Some(view.camera.size.height),
        used: true,
        why_not: None,
    };
    let other = |photo: &UnusedPhoto| ImagePart {
        name: photo.name.clone(),
        sha256: photo.sha256.clone(),
        width: photo.size.map(|size| size.width),
        height: photo.size.map(|size| size.height),
        used: false,
        why_not: Some(photo.why.words().to_owned()),
    };
    let Capture { views, unused } = &scene.capture;
    let mut images: Vec<ImagePart> = views.iter().map(image).chain(unused.iter().map(other)).collect();
    images.sort_by(|a, b| natural::compare_names(&a.name, &b.name));
    images
}

pub(super) fn camera_part(scene: &BuiltScene<'_>, camera: Camera) -> CameraPart {
    let lens =
        scene.capture.views.iter().map(|v| &v.lens).find(|lens| **lens != gs2e_source::LensModel::Pinhole);
    CameraPart::new(camera, lens.map(|lens| json!(lens)))
}

fn reconstruction_part(scene: &BuiltScene<'_>) -> std::io::Result<Option<ReconstructionPart>> {
    let Some(summary) = &scene.gaussians else { return Ok(None) };
    let command = training_command(scene.recipe);
    let fidelity = scene.photographed.as_ref().and_then(|photographed| photographed.fidelity.as_ref());
    Ok(Some(ReconstructionPart {
        kind: kind_of_gaussians(scene.recipe).into(),
        scene_sha256: super::super::checksum::sha256_of_file(&summary.path)?,
        gaussians: summary.count,
        sh_degree: summary.sh_degree,
        antialiased: summary.antialiased,
        dropped: summary.screening.non_finite,
        iterations: training_iterations(scene.recipe),
        command: command.map(TrainerCommand::written),
        psnr: fidelity.and_then(|fidelity| fidelity.psnr()),
        ssim: fidelity.and_then(|fidelity| fidelity.ssim()),
        lpips: None,
        training: summary.training.clone(),
    }))
}

/// Kind of the source of a recipe's Gaussians.
pub(super) fn kind_of_gaussians(recipe: &Recipe) -> &'static str {
    match &recipe.reconstruct {
        _ if recipe.source.kind().is_made_up() => recipe.source.kind().name(),
        Some(ReconstructMethod::Command(_)) => "command",
        Some(ReconstructMethod::Builtin(_)) => "builtin",
        Some(
            ReconstructMethod::Given(_) | ReconstructMethod::Changing(..) | ReconstructMethod::Newest(_),
        )
        | None => "given",
    }
}

/// Number of training iterations, if the recipe states it.
pub(super) fn training_iterations(recipe: &Recipe) -> Option<u64> {
    match &recipe.reconstruct {
        Some(ReconstructMethod::Command(command)) => command.iterations,
        Some(ReconstructMethod::Builtin(training)) => Some(training.iterations.into()),
        Some(
            ReconstructMethod::Given(_) | ReconstructMethod::Changing(..) | ReconstructMethod::Newest(_),
        )
        | None => None,
    }
}

/// The program that trained the scene, if the recipe names one.
pub(super) fn training_command(recipe: &Recipe) -> Option<&TrainerCommand> {
    match &recipe.reconstruct {
        Some(ReconstructMethod::Command(command)) => Some(command),
        Some(_) | None => None,
    }
}

/// Every derived stream seed. The groups of a novel trajectory share the seeds of its draws, which
/// derive from its name in the recipe.
pub(super) fn draw_seeds(recipe: &Recipe) -> BTreeMap<String, String> {
    let mut seeds = BTreeMap::new();
    let mut add = |name: &str, purpose: StreamPurpose, seed: Seed| {
        seeds.insert(format!("{name}/{}", purpose.name()), seed.0.to_string());
    };
    for asked in &recipe.trajectories {
        // Cameras of a rig share the draws of their body.
        if let CameraPath::Novel(novel) = &asked.path {
            add(&asked.written, StreamPurpose::Keyframes, novel.keyframes_seed);
            add(&asked.written, StreamPurpose::Curve, novel.curve_seed);
        }
        if recipe.has_events_along(&asked.name) {
            add(&asked.name, StreamPurpose::Sensor, sensor_seed(recipe, &asked.name));
        }
    }
    seeds
}

/// The seed of the sensors' noise along a trajectory.
pub(super) fn sensor_seed(recipe: &Recipe, trajectory: &str) -> Seed {
    Seed::for_stream(recipe.seed, &recipe.scene, trajectory, StreamPurpose::Sensor)
}
