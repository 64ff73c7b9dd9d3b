//! `scene.json` composed again from a tree: from the recipe in it, and from other files of the
//! scene.

use super::trajectory::{
    blur_value, carried, drawn_numbers, kind_name, parameter_values, rate_ev_px_s, sampling_value,
    sensor_value,
};
use super::{
    CameraPart, MountedPart, QuantityExtent, ReconstructionPart, SceneRecord, SensorPart, TrajectoryPart,
    TrajectoryStatistics, draw_seeds, kind_of_gaussians, licence, scene_attributes, sensor_seed, source_part,
    training_command, training_iterations,
};
use crate::checksum;
use crate::published::PublishedScene;
use gs2e_build::artifact::TrajectoryProduct;
use gs2e_image::Size;
use gs2e_recipe::Recipe;
use gs2e_scene::camera;
use gs2e_scene::camera::CameraChoice;
use gs2e_sensor::twin::twin_of;
use gs2e_source::reconstruct::TrainerCommand;
use serde_json::Value;

/// Composes the file from the recipe and the other files. Some values are copied, because no other
/// file of the tree has them: photos, a capture's own camera, the facts about the Gaussians, the
/// rate and error that a tolerance led to, and counts of the simulation that the events do not
/// show.
pub fn recompose(scene: &PublishedScene) -> SceneRecord {
    let (recipe, found) = (&scene.recipe, &scene.file);
    let compact = serde_json::to_vec(&recipe.meta.merged).expect("a JSON value is writable");
    let reports = scene.trajectories.iter().map(|trajectory| &trajectory.motion.report);
    let trajectories: Vec<TrajectoryPart> =
        scene.paths().map(|(part, of)| trajectory(scene, part, &of.motion)).collect();
    let photos = found.images.iter().filter(|_| recipe.source.has_photos());
    SceneRecord {
        schema: 1,
        id: recipe.scene.clone(),
        gs2e_version: env!("CARGO_PKG_VERSION").into(),
        source: source_part(recipe),
        images: photos.cloned().collect(),
        camera: camera(recipe.camera, &found.camera),
        conventions: super::SceneConventions::for_brightness(&recipe.meta.merged),
        reconstruction: found.reconstruction.as_ref().map(|found| reconstruction(recipe, found)),
        licence: licence::licence_part(recipe, &scene.licence),
        seed: recipe.seed,
        seeds: draw_seeds(recipe),
        recipe: recipe.meta.merged.clone(),
        recipe_sha256: checksum::sha256_hex(&compact),
        // Copied, because the audit compares the splits of all scenes by themselves.
        split: found.split.clone(),
        attributes: scene_attributes(recipe, &scene.licence, reports, &trajectories),
        trajectories,
    }
}

fn camera(choice: Option<CameraChoice>, found: &CameraPart) -> CameraPart {
    // A recipe without a whole camera takes the rest from the capture, which the tree does not
    // have.
    camera::choose_camera(choice, None)
        .map_or_else(|| found.clone(), |camera| CameraPart::new(camera, found.undistorted_from.clone()))
}

fn reconstruction(recipe: &Recipe, found: &ReconstructionPart) -> ReconstructionPart {
    let command = training_command(recipe);
    ReconstructionPart {
        kind: kind_of_gaussians(recipe).into(),
        iterations: training_iterations(recipe),
        command: command.map(TrainerCommand::written),
        ..found.clone()
    }
}

fn trajectory(scene: &PublishedScene, found: &TrajectoryPart, motion: &TrajectoryProduct) -> TrajectoryPart {
    let recipe = &scene.recipe;
    let asked = recipe.trajectories.iter().find(|asked| asked.name == found.name);
    let stamps = &motion.trajectory.stamps_us;
    let last_us = stamps.last().copied().unwrap_or(0);
    let seen = scene.file.camera_of(found);
    let mounted = recipe.mounted(&found.name);
    let seen = mounted.map_or_else(|| seen.clone(), |mounted| camera(mounted.camera.camera, seen));
    let size = seen.camera().size;
    // A tolerance chooses the interpolation between frames, which is a parameter of some sensors.
    let chosen = recipe.tolerance.is_some();
    let simulated = recipe.has_events_along(&found.name);
    let seed = sensor_seed(recipe, &found.name);
    let all = recipe.sensors_of(&found.name);
    let sensors = || all.iter().filter(|_| simulated);
    let one = sensors().find(|(name, _)| name.is_none());
    let several = sensors().filter_map(|(name, own)| Some((name?.to_owned(), own)));
    let trajectory = &found.name;
    let several = several.map(|(name, own)| {
        let found = found.sensors.get(&name);
        let stated = found.map(|part| part.sensor.clone()).filter(|_| chosen);
        let part = SensorPart {
            sensor: stated.unwrap_or_else(|| sensor_value(seed, own)),
            twin_of: twin_of(own, all.iter()).map(str::to_owned),
            drawn: drawn_numbers(recipe, trajectory, Some(&name)),
            statistics: found.map(|part| counted(&part.statistics, size, last_us)).unwrap_or_default(),
        };
        (name, part)
    });
    TrajectoryPart {
        name: found.name.clone(),
        kind: kind_name(motion.report.kind).into(),
        cameras: carried(recipe, &found.name),
        mounted: mounted.map(|mounted| MountedPart::new(mounted, seen)),
        parameters: asked.map(|asked| parameter_values(recipe, asked)).unwrap_or_default(),
        keyframes: motion.report.keyframes.iter().map(|k| *k as u64).collect(),
        poses: stamps.len(),
        duration_us: last_us,
        rate: recipe.rate.0.to_string(),
        sampling: if chosen { found.sampling.clone() } else { sampling_value(recipe, None) },
        render_rules: rules(recipe, simulated, &found.render_rules),
        sensor: one.map(|(_, own)| {
            found.sensor.clone().filter(|_| chosen).unwrap_or_else(|| sensor_value(seed, own))
        }),
        drawn: drawn_numbers(recipe, &found.name, None).filter(|_| simulated),
        sensors: several.collect(),
        blur: recipe.exposed_along(&found.name).map(|_| {
            blur_value(recipe, found.blur.as_ref().map_or(&Value::Null, |found| &found["subframes"]))
        }),
        statistics: TrajectoryStatistics {
            linear_unit_s: QuantityExtent::from_values(&motion.report.linear_unit_s),
            angular_rad_s: QuantityExtent::from_values(&motion.report.angular_rad_s),
            ..counted(&found.statistics, size, last_us)
        },
    }
}

/// Render rules as in the recipe. If a scene file declares itself antialiased, only the simulation
/// knows it, so this value is copied.
fn rules(recipe: &Recipe, simulated: bool, found: &Value) -> Value {
    let mut rules = super::trajectory::render_rules(recipe.render, None);
    if simulated && found["antialiased"].is_boolean() {
        rules["antialiased"] = found["antialiased"].clone();
    }
    rules
}

/// Statistics in which the values that follow from others are recomputed.
fn counted(found: &TrajectoryStatistics, size: Size, last_us: i64) -> TrajectoryStatistics {
    TrajectoryStatistics {
        // Checked: the numbers come from a file that may be damaged.
        off: found.events.zip(found.on).and_then(|(events, on)| events.checked_sub(on)),
        rate_ev_px_s: found.events.and_then(|events| rate_ev_px_s(events, size, last_us)),
        ..found.clone()
    }
}
