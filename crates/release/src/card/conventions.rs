//! The scenes, cameras and sensors that differ from the others in a convention.

use super::built_trajectories;
use crate::markdown::markup;
use crate::published::PublishedScene;
use crate::scene::TrajectoryPart;
use minijinja::{Value, context};
use std::collections::BTreeSet;

pub(super) fn conventions_values(scenes: &[PublishedScene]) -> Value {
    let included = || scenes.iter().filter(|scene| !scene.is_withheld());
    let id = |scene: &PublishedScene| markup(&scene.recipe.scene);
    let encoded = included().filter(|scene| {
        !scene.recipe.shutter.mean.is_linear()
            && scene.file.trajectories.iter().any(|part| part.blur.is_some())
    });
    let encoded: BTreeSet<&str> = encoded.map(|scene| scene.recipe.scene.as_str()).collect();
    let lights =
        included().filter_map(|scene| Some([id(scene), markup(scene.recipe.lights.as_ref()?.to_string())]));
    let rolling = included().filter(|scene| scene.recipe.has_sharp());
    let readouts = rolling.filter_map(|scene| Some([id(scene), scene.recipe.readout_us?.into()]));
    let sensors = scenes.iter().flat_map(|scene| scene.recipe.every_sensor().map(move |each| (scene, each)));
    let front_ends = sensors
        .map(|(scene, (name, sensor))| (scene, name, sensor.as_model().front_end()))
        .filter(|(.., front_end)| !front_end.is_plain())
        .map(|(scene, name, front_end)| [id(scene), name.map(markup).into(), markup(front_end.to_string())]);
    context! {
        encoded => markup(Vec::from_iter(encoded).join(", ")), lenses => lens_cameras(scenes),
        lights => lights.collect::<Value>(), readouts => readouts.collect::<Value>(),
        front_ends => front_ends.collect::<Value>(),
    }
}

/// The cameras with a lens that distorts: scene, camera and lens.
fn lens_cameras(scenes: &[PublishedScene]) -> Value {
    let row = |scene: &PublishedScene, part: &TrajectoryPart| {
        let lens = scene.file.camera_of(part).lens?;
        let camera = scene.recipe.mounted(&part.name).map_or("", |mounted| &mounted.camera.name);
        Some([scene.recipe.scene.clone(), camera.to_owned(), lens.to_string()])
    };
    let included = built_trajectories(scenes).filter(|(scene, _)| !scene.is_withheld());
    // Trajectories share their cameras.
    let rows: BTreeSet<[String; 3]> = included.filter_map(|(scene, part)| row(scene, part)).collect();
    rows.into_iter().map(|row| row.map(markup)).collect()
}
