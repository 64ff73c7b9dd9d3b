//! The part of `scene.json` on one trajectory.

use super::compose::camera_part;
use super::{DepthQuantiles, MountedPart, QuantityExtent, SensorPart, TrajectoryPart, TrajectoryStatistics};
use crate::built::{BuiltScene, BuiltTrajectory};
use gs2e_build::artifact::{BlurredFrames, EventStream, SimulationRecord};
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use gs2e_recipe::{Recipe, TrajectoryRecipe};
use gs2e_render::RenderChoice;
use gs2e_sensor::SensorChoice;
use gs2e_sensor::twin::twin_of;
use gs2e_trajectory::CourseKind;
use gs2e_trajectory::flow::FlowQuantiles;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Composes the part of a trajectory.
pub(super) fn trajectory_part(scene: &BuiltScene<'_>, built: &BuiltTrajectory) -> TrajectoryPart {
    let recipe = scene.recipe;
    let seen = || camera_part(scene, scene.camera_along(&built.name));
    let asked = recipe.trajectories.iter().find(|t| t.name == built.name);
    let stamps = &built.motion.trajectory.stamps_us;
    TrajectoryPart {
        name: built.name.clone(),
        kind: kind_name(built.motion.report.kind).into(),
        cameras: carried(recipe, &built.name),
        mounted: recipe.mounted(&built.name).map(|mounted| MountedPart::new(mounted, seen())),
        parameters: asked.map(|asked| parameter_values(recipe, asked)).unwrap_or_default(),
        keyframes: built.motion.report.keyframes.iter().map(|k| *k as u64).collect(),
        poses: stamps.len(),
        duration_us: stamps.last().copied().unwrap_or(0),
        rate: recipe.rate.0.to_string(),
        sampling: sampling_value(recipe, built.simulation()),
        render_rules: render_rules(recipe.render, built.simulation()),
        sensor: the_one(built).map(|(simulation, stream)| sensor_value(simulation.seed, &stream.sensor)),
        drawn: drawn_numbers(recipe, &built.name, None).filter(|_| built.simulation().is_some()),
        sensors: sensor_statistics(recipe, built),
        blur: built.blur.as_ref().map(|blurred| blur_value(recipe, &json!(most_subframes(blurred)))),
        statistics: trajectory_statistics(built),
    }
}

/// Names of the cameras that a trajectory carries.
pub(super) fn carried(recipe: &Recipe, trajectory: &str) -> Vec<String> {
    let cameras = recipe.rig.iter().filter(|_| recipe.is_of_body(trajectory));
    cameras.map(|camera| camera.name.clone()).collect()
}

/// Name of a kind of path in recipes.
pub(super) fn kind_name(kind: CourseKind) -> &'static str {
    match kind {
        CourseKind::Refine => "refine",
        CourseKind::Novel => "novel",
        CourseKind::Orbit => "orbit",
        CourseKind::Keyframes => "keyframes",
        CourseKind::Mounted => "mounted",
    }
}

/// Numbers of dense frames of an exposure and from one exposure to the next, the largest number of
/// sub-frames of a dense frame, and the scale of the mean if it is not linear light.
pub(super) fn blur_value(recipe: &Recipe, most: &Value) -> Value {
    let shutter = recipe.shutter;
    let mut value = json!({ "frames": shutter.frames, "stride": shutter.frames, "subframes": most });
    if !shutter.mean.is_linear() {
        value["mean"] = json!(shutter.mean);
    }
    value
}

fn most_subframes(blurred: &BlurredFrames) -> Option<u32> {
    blurred.exposures.iter().map(|exposure| exposure.subframes).max()
}

/// Frames per second, and the interpolation of brightness between frames, in full as in the recipe.
/// For a tolerance also the choice that was made, and the expected and the measured error.
pub(super) fn sampling_value(recipe: &Recipe, simulation: Option<&SimulationRecord>) -> Value {
    let between = recipe.meta.merged.pointer("/sampling/between").cloned().unwrap_or_default();
    let mut out = json!({ "rate": recipe.rate.0.to_string(), "between": between });
    if let (Some(chosen), Some(out)) = (simulation.and_then(|s| s.chosen.as_ref()), out.as_object_mut()) {
        // The recipe leaves the interpolation to the tolerance, so its own value is not the one
        // used.
        out.insert("between".into(), json!(chosen.between));
        out.insert("tolerance".into(), json!(chosen));
    }
    out
}

/// Path, speed, and the base of a novel path. The seeds of draws are written as text elsewhere,
/// because many readers of JSON would round large numbers.
pub(super) fn parameter_values(recipe: &Recipe, asked: &TrajectoryRecipe) -> Value {
    let mut parameters = json!(asked.path);
    if let Some(novel) = parameters.get_mut("novel").and_then(Value::as_object_mut) {
        novel.retain(|key, _| !key.ends_with("_seed"));
        novel.insert("base".into(), json!(asked.base));
    }
    parameters["speed"] = speed(recipe, asked);
    parameters
}

/// The speed as in the merged recipe, where a formula is text. Its syntax tree can nest deeper than
/// readers of JSON follow.
fn speed(recipe: &Recipe, asked: &TrajectoryRecipe) -> Value {
    let all = recipe.meta.merged.get("trajectories").and_then(Value::as_array);
    let of_it = all.into_iter().flatten().find(|written| written["name"] == asked.written.as_str());
    of_it.map(|written| written["speed"].clone()).unwrap_or_default()
}

pub(super) fn render_rules(asked: RenderChoice, simulation: Option<&SimulationRecord>) -> Value {
    let antialiased = simulation.map(|s| s.antialiased);
    let mut rules =
        json!({ "rules": asked.rules, "antialiased": antialiased, "background": asked.background });
    if let Some(near) = asked.near {
        rules["near"] = json!(near);
    }
    rules
}

/// The only stream, if it has no name.
fn the_one(built: &BuiltTrajectory) -> Option<(&SimulationRecord, &EventStream)> {
    let stream = built.streams().first().filter(|stream| stream.name.is_none());
    built.simulation().zip(stream)
}

pub(super) fn sensor_value(seed: Seed, sensor: &SensorChoice) -> Value {
    let model = sensor.as_model();
    let (c_on, c_off) = model.contrast();
    let mut out = json!({
        "model": sensor.name(), "law_version": model.law_version(), "c_on": c_on, "c_off": c_off,
        "seed": seed.0.to_string(),
    });
    if let (Value::Object(out), Value::Object(parameters)) = (&mut out, model.released()) {
        out.extend(parameters);
    }
    out
}

/// The numbers that were drawn for a sensor along a trajectory, by path.
pub(super) fn drawn_numbers(
    recipe: &Recipe,
    trajectory: &str,
    sensor: Option<&str>,
) -> Option<BTreeMap<String, f64>> {
    let asked = recipe.trajectories.iter().find(|asked| asked.name == trajectory)?;
    asked.drawn.as_ref()?.numbers.get(sensor.unwrap_or_default()).cloned()
}

/// Each of several sensors with the statistics of its stream.
fn sensor_statistics(recipe: &Recipe, built: &BuiltTrajectory) -> BTreeMap<String, SensorPart> {
    let Some(simulation) = built.simulation() else { return BTreeMap::new() };
    let named = built.streams().iter().enumerate().filter_map(|(i, s)| Some((i, s, s.name.clone()?)));
    let part = |(i, stream, name): (usize, &EventStream, String)| {
        let counted = stream_statistics(built, simulation, i);
        let others = simulation.streams.iter().map(|other| (other.name.as_deref(), &other.sensor));
        let twin_of = twin_of(&stream.sensor, others).map(str::to_owned);
        let drawn = drawn_numbers(recipe, &built.name, Some(&name));
        (
            name,
            SensorPart {
                sensor: sensor_value(simulation.seed, &stream.sensor),
                twin_of,
                drawn,
                statistics: counted,
            },
        )
    };
    named.map(part).collect()
}

/// Statistics of stream `i`.
fn stream_statistics(
    built: &BuiltTrajectory,
    simulation: &SimulationRecord,
    i: usize,
) -> TrajectoryStatistics {
    let account = &simulation.streams[i].account;
    let last_us = built.motion.trajectory.stamps_us.last().copied().unwrap_or(0);
    TrajectoryStatistics {
        events: Some(account.events),
        on: Some(account.on),
        off: Some(account.off),
        readout: account.readout,
        latency: account.latency,
        rate_ev_px_s: rate_ev_px_s(account.events, simulation.camera.size, last_us),
        peak_ev_per_ms: built.peaks_ev_per_ms.get(i).copied(),
        active_pixels: Some(account.active_pixels),
        ..TrajectoryStatistics::default()
    }
}

/// Events per pixel and second; `None` if the duration is 0.
pub(super) fn rate_ev_px_s(events: u64, size: Size, last_us: i64) -> Option<f64> {
    let pixel_seconds = size.pixels() as f64 * (last_us as f64 * 1e-6);
    (pixel_seconds > 0.0).then(|| events as f64 / pixel_seconds)
}

fn trajectory_statistics(built: &BuiltTrajectory) -> TrajectoryStatistics {
    let report = &built.motion.report;
    let simulation = built.simulation();
    let depth = simulation.and_then(|s| s.depth_unit);
    TrajectoryStatistics {
        linear_unit_s: QuantityExtent::from_values(&report.linear_unit_s),
        angular_rad_s: QuantityExtent::from_values(&report.angular_rad_s),
        max_step_px: simulation.and_then(|s| s.flow_px).map(|FlowQuantiles { max, .. }| max),
        depth_unit: depth.map(|[p5, p50, p95]| DepthQuantiles { p5, p50, p95 }),
        // With several streams these counts belong to each of them, and stay null here.
        ..the_one(built).map(|(simulation, _)| stream_statistics(built, simulation, 0)).unwrap_or_default()
    }
}
