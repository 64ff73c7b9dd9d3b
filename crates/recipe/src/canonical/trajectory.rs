//! Trajectories in the merged recipe: one entry per written trajectory, however many groups it has.

use super::{fields_without, ratio_value, written_text};
use crate::resolve::trajectory::{CONSTANT_SPEED, PAPERS_SPEED};
use crate::{TrajectoryRecipe, schema};
use gs2e_trajectory::keyframes::{CameraFacing, Keyframe, KeyframePath};
use gs2e_trajectory::novel::{GroupCurve, NovelGroup};
use gs2e_trajectory::path::CameraPath;
use gs2e_trajectory::refine::{RefinePath, TranslationScale};
use gs2e_trajectory::speed::SpeedChoice;
use gs2e_trajectory::travel::PoseCount;
use serde_json::{Value, json};

/// Returns the list, each trajectory as written. The first group of a novel trajectory represents
/// all its groups.
pub(super) fn trajectory_values(raw: &schema::RecipeSchema, list: &[TrajectoryRecipe]) -> Vec<Value> {
    let Some((items, _)) = raw.trajectories.given() else { return Vec::new() };
    let mut rest = list;
    let mut values = Vec::with_capacity(items.len());
    for (raw, _) in items.iter().filter_map(|item| item.given()) {
        let Some(first) = rest.first() else { break };
        // The groups of a novel trajectory, and the cameras of a rig, follow each other and share the written
        // name.
        let groups = rest.iter().take_while(|t| t.written == first.written).count();
        rest = &rest[groups..];
        values.push(trajectory_value(raw, first));
    }
    values
}

fn trajectory_value(raw: &schema::TrajectorySection, trajectory: &TrajectoryRecipe) -> Value {
    let (kind, path) = match &trajectory.path {
        CameraPath::Refine(path) => ("refine", refine_value(path)),
        CameraPath::Novel(path) => ("novel", novel_value(path, trajectory.base.as_deref())),
        CameraPath::Orbit(path) => ("orbit", counted_value(fields_without(path, &["count"]), path.count)),
        CameraPath::Keyframes(path) => ("keyframes", keyframes_value(path)),
    };
    json!({ "name": trajectory.written, kind: path, "speed": speed_value(raw, trajectory) })
}

/// Formulae are shown as written.
fn speed_value(raw: &schema::TrajectorySection, trajectory: &TrajectoryRecipe) -> Value {
    let function = match raw.speed.given() {
        Some((schema::SpeedSection::Function(text), _)) => written_text(text),
        Some((schema::SpeedSection::Flow(flow), _)) => {
            flow.given().and_then(|(flow, _)| written_text(&flow.function))
        }
        _ => None,
    };
    match &trajectory.speed {
        SpeedChoice::Function(_) => {
            let default = if raw.refine.is_absent() { CONSTANT_SPEED } else { PAPERS_SPEED };
            json!({ "function": function.unwrap_or(default) })
        }
        SpeedChoice::List(list) => json!({ "list": list }),
        SpeedChoice::Flow(flow) => {
            json!({ "flow": { "px_s": flow.px_s, "function": function.unwrap_or(CONSTANT_SPEED) } })
        }
    }
}

fn refine_value(refine: &RefinePath) -> Value {
    let mut path = fields_without(refine, &["count", "scale"]);
    path["metric"] = json!({ "scale": scale_value(refine.scale) });
    counted_value(path, refine.count)
}

fn novel_value(novel: &NovelGroup, base: Option<&str>) -> Value {
    let mut path = fields_without(novel, &["count", "group", "keyframes_seed", "curve_seed"]);
    path["base"] = json!(base);
    if let GroupCurve::Fixed(curve) = novel.curve {
        path["curve"] = json!(curve);
    }
    counted_value(path, novel.count)
}

fn keyframes_value(keyframes: &KeyframePath) -> Value {
    let mut path = fields_without(keyframes, &["count", "scale"]);
    path["poses"] = keyframes.poses.iter().map(keyframe_value).collect();
    path["metric"] = json!({ "scale": scale_value(keyframes.scale) });
    counted_value(path, keyframes.count)
}

fn keyframe_value(keyframe: &Keyframe) -> Value {
    let position = keyframe.position;
    match keyframe.facing {
        CameraFacing::Rotation(rotation) => json!({ "position": position, "rotation": rotation }),
        CameraFacing::Towards { target, up } => json!({ "position": position, "look_at": target, "up": up }),
    }
}

/// Adds the number of poses to a path, if it is a choice.
fn counted_value(mut path: Value, count: PoseCount) -> Value {
    let (key, value) = match count {
        PoseCount::Factor(factor) => ("factor", ratio_value(factor)),
        PoseCount::Frames(frames) => ("frames", json!(frames)),
        PoseCount::Duration(seconds) => ("duration", ratio_value(seconds)),
        PoseCount::Flow => return path,
    };
    path[key] = value;
    path
}

fn scale_value(scale: TranslationScale) -> Value {
    match scale {
        TranslationScale::Scene => json!("scene"),
        TranslationScale::None => json!("none"),
        TranslationScale::Fixed(units) => json!(units),
    }
}
