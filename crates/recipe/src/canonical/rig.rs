//! The cameras of a rig in the merged recipe.

use super::{camera_value, sensor_value};
use crate::rig::RigCamera;
use crate::schema;
use serde_json::{Value, json};

/// The rig; `None` without one.
pub(super) fn rig_value(raw: &schema::RecipeSchema, rig: &[RigCamera]) -> Option<Value> {
    let items = raw.rig.given().and_then(|(rig, _)| rig.cameras.given()).map_or(&[][..], |(items, _)| items);
    let written = items.iter().filter_map(|item| item.given());
    let cameras: Value = written.zip(rig).map(|((raw, _), camera)| rig_camera_value(raw, camera)).collect();
    let pairs = rig.iter().filter_map(|first| Some([&first.name, &first.second.as_ref()?.name]));
    let pairs: Vec<[&String; 2]> = pairs.collect();
    (!rig.is_empty()).then(|| json!({ "cameras": cameras, "stereo": pairs }))
}

fn rig_camera_value(raw: &schema::RigCameraSection, camera: &RigCamera) -> Value {
    let mut value = json!({
        "name": camera.name,
        "extrinsic": camera.mount,
        "outputs": camera.outputs,
    });
    if let Some(camera) = camera.camera {
        value["camera"] = camera_value(camera);
    }
    for (_, sensor) in camera.sensors.iter().flat_map(|set| set.iter()) {
        value["sensor"] = sensor_value(raw.sensor.given().map(|(raw, _)| raw), sensor);
    }
    value
}
