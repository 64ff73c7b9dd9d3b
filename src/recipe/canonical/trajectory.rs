//! Trajectories in the merged recipe: one entry per written trajectory, however many groups it has.

use super::{ratio_value, written_text};
use crate::recipe::resolve::trajectory::{CONSTANT_SPEED, PAPERS_SPEED};
use crate::recipe::{TrajectoryRecipe, schema};
use crate::speed::Speed;
use crate::trajectory::keyframes::{Facing, Keyframe, Keyframes};
use crate::trajectory::novel::{Novel, NovelCurve};
use crate::trajectory::orbit::Orbit;
use crate::trajectory::path::Path;
use crate::trajectory::refine::{Refine, Scale};
use crate::trajectory::travel::Count;
use serde_json::{Value, json};

/// Returns the list, each trajectory as written. The first group of a novel trajectory represents
/// all its groups.
pub(super) fn trajectory_values(raw: &schema::Recipe, list: &[TrajectoryRecipe]) -> Vec<Value> {
    let Some((items, _)) = raw.trajectories.given() else { return Vec::new() };
    let mut rest = list;
    let mut shown = Vec::with_capacity(items.len());
    for (raw, _) in items.iter().filter_map(|item| item.given()) {
        let Some(first) = rest.first() else { break };
        let groups = rest.iter().take_while(|t| t.written == first.written).count();
        rest = &rest[groups..];
        shown.push(trajectory_value(raw, first));
    }
    shown
}

fn trajectory_value(raw: &schema::Trajectory, trajectory: &TrajectoryRecipe) -> Value {
    let (kind, path) = match &trajectory.path {
        Path::Refine(path) => ("refine", refine_value(path)),
        Path::Novel(path) => ("novel", novel_value(path, trajectory.base.as_deref())),
        Path::Orbit(path) => ("orbit", orbit_value(path)),
        Path::Keyframes(path) => ("keyframes", keyframes_value(path)),
    };
    json!({ "name": trajectory.written, kind: path, "speed": speed_value(raw, trajectory) })
}

/// Formulae are shown as written.
fn speed_value(raw: &schema::Trajectory, trajectory: &TrajectoryRecipe) -> Value {
    let function = match raw.speed.given() {
        Some((schema::Speed::Function(text), _)) => written_text(text),
        Some((schema::Speed::Flow(flow), _)) => {
            flow.given().and_then(|(flow, _)| written_text(&flow.function))
        }
        _ => None,
    };
    match &trajectory.speed {
        Speed::Function(_) => {
            let usual = if raw.refine.is_absent() { CONSTANT_SPEED } else { PAPERS_SPEED };
            json!({ "function": function.unwrap_or(usual) })
        }
        Speed::List(list) => json!({ "list": list }),
        Speed::Flow(flow) => {
            json!({ "flow": { "px_s": flow.px_s, "function": function.unwrap_or(CONSTANT_SPEED) } })
        }
    }
}

fn refine_value(refine: &Refine) -> Value {
    let path = json!({
        "window": refine.window,
        "order": refine.order,
        "rotation": refine.rotation,
        "ends": refine.ends,
        "metric": { "scale": scale_value(refine.scale) },
        "gaps": refine.gaps,
        "curve": refine.curve,
        "literal": refine.literal,
    });
    counted_value(path, refine.count)
}

fn novel_value(novel: &Novel, base: Option<&str>) -> Value {
    let path = json!({
        "base": base,
        "groups": novel.groups,
        "keyframes": novel.keyframes,
        "curve": match novel.curve {
            NovelCurve::Any => json!("any"),
            NovelCurve::Fixed(curve) => json!(curve),
        },
        "literal": novel.literal,
    });
    counted_value(path, novel.count)
}

fn orbit_value(orbit: &Orbit) -> Value {
    let mut path = json!({ "arc": orbit.arc });
    for (key, value) in [("centre", orbit.centre), ("from", orbit.from), ("up", orbit.up)] {
        if let Some(value) = value {
            path[key] = json!(value);
        }
    }
    counted_value(path, orbit.count)
}

fn keyframes_value(keyframes: &Keyframes) -> Value {
    let path = json!({
        "poses": keyframes.poses.iter().map(keyframe_value).collect::<Vec<_>>(),
        "metric": { "scale": scale_value(keyframes.scale) },
        "curve": keyframes.curve,
        "literal": keyframes.literal,
    });
    counted_value(path, keyframes.count)
}

fn keyframe_value(keyframe: &Keyframe) -> Value {
    let position = keyframe.position;
    match keyframe.facing {
        Facing::Rotation(rotation) => json!({ "position": position, "rotation": rotation }),
        Facing::Towards { target, up } => json!({ "position": position, "look_at": target, "up": up }),
    }
}

/// Adds the number of poses to a path, if it is a choice.
fn counted_value(mut path: Value, count: Count) -> Value {
    let (key, value) = match count {
        Count::Factor(factor) => ("factor", ratio_value(factor)),
        Count::Frames(frames) => ("frames", json!(frames)),
        Count::Duration(seconds) => ("duration", ratio_value(seconds)),
        Count::Flow => return path,
    };
    path[key] = value;
    path
}

fn scale_value(scale: Scale) -> Value {
    match scale {
        Scale::Scene => json!("scene"),
        Scale::None => json!("none"),
        Scale::Fixed(units) => json!(units),
    }
}
