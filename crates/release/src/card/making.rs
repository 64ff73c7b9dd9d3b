//! The making of the data: paths, sensors, and one row per stream.

use super::built_trajectories;
use crate::markdown::markup;
use crate::published::PublishedScene;
use crate::scene::{TrajectoryPart, TrajectoryStatistics};
use gs2e_sensor::SensorChoice;
use gs2e_sensor::voltmeter::BetweenFrames;
use minijinja::{Value, context};
use std::collections::BTreeSet;

/// Ways in which paths of each kind are made.
const PATHS: [[&str; 2]; 4] = [
    ["refine", "captured poses, smoothed"],
    ["novel", "key poses drawn from another trajectory, joined by a curve"],
    ["orbit", "a circle about a point, which the camera looks at"],
    ["keyframes", "poses given by hand, joined by a curve"],
];

pub(super) fn making_values(scenes: &[PublishedScene]) -> Value {
    let kinds: Vec<&str> = built_trajectories(scenes).map(|(_, part)| part.kind.as_str()).collect();
    let paths = PATHS.into_iter().filter(|[kind, _]| kinds.contains(kind));
    let streams = built_trajectories(scenes).flat_map(|(scene, part)| stream_rows(scene, part));
    context! {
        paths => paths.collect::<Value>(), sensors => sensors_made(scenes),
        streams => streams.map(markup).collect::<Value>(),
    }
}

/// One item per kind of sensor: its model, what it compares, and its interpolation between frames.
fn sensors_made(scenes: &[PublishedScene]) -> Value {
    let mut items = BTreeSet::new();
    for (scene, part) in built_trajectories(scenes) {
        for (_, sensor) in scene.streams(part) {
            let (name, between) = (sensor.name(), between_words(sensor));
            // A rate of no meaning would be refused by the recipe, which the release holds.
            let screened = sensor.screen(scene.recipe.rate);
            let quantity =
                screened.map_or_else(|_| "brightness".to_owned(), |found| found.quantity.to_owned());
            items.insert(format!("`{name}`: compares `{quantity}`; {between} interpolation between frames"));
        }
    }
    items.into_iter().map(markup).collect()
}

/// Interpolation of brightness between frames by a sensor.
fn between_words(sensor: &SensorChoice) -> &'static str {
    match sensor.between() {
        BetweenFrames::Linear => "linear",
        BetweenFrames::Catmull => "cubic (Catmull-Rom)",
        BetweenFrames::Hermite => "cubic (Hermite, with rendered rates of change)",
    }
}

/// One row per stream, or one row for a trajectory without a stream.
fn stream_rows(scene: &PublishedScene, part: &TrajectoryPart) -> Vec<String> {
    let size = scene.file.camera_of(part).camera().size;
    let gaussians = scene.file.reconstruction.as_ref().map(|it| it.gaussians.to_string());
    let row = |name: &str, counted: &str| {
        format!(
            "| {}/{}{name} | {} | {} | {} | {size} | {} | {:.1} | {counted} |",
            scene.file.id,
            part.name,
            scene.file.source.kind,
            part.kind,
            gaussians.as_deref().unwrap_or("-"),
            part.poses,
            part.duration_us as f64 * 1e-3,
        )
    };
    let counted = |name: Option<&str>, sensor: &SensorChoice, statistics: &TrajectoryStatistics| {
        let (events, on) = (statistics.events.unwrap_or(0), statistics.on.unwrap_or(0));
        let pixel_seconds = size.pixels() as f64 * part.duration_us as f64 * 1e-6;
        // A stream without events or duration has no rate and no share.
        let ratio = |of: f64, to: f64| if to > 0.0 { format!("{:.3}", of / to) } else { "-".to_owned() };
        let (rate, share) = (ratio(events as f64, pixel_seconds), ratio(on as f64, events as f64));
        let (on, off) = sensor.as_model().contrast();
        let name = name.map_or_else(String::new, |name| format!("/{name}"));
        row(&name, &format!("{events} | {rate} | {share} | {on:.4}, {off:.4}"))
    };
    let streams = scene.streams(part).into_iter().map(|(name, sensor)| {
        let named = name.and_then(|name| part.sensors.get(name));
        counted(name, sensor, named.map_or(&part.statistics, |named| &named.statistics))
    });
    let rows: Vec<String> = streams.collect();
    if rows.is_empty() { vec![row("", "- | - | - | -")] } else { rows }
}
