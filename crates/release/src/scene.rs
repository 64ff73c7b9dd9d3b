//! `scene.json`, schema version 1: contents, origin and making of a scene. Photos are named and
//! hashed, never copied. Nothing here is a guess: unknown values are `null`.

mod attributes;
mod compose;
mod licence;
mod recompose;
mod trajectory;
use compose::{
    draw_seeds, kind_of_gaussians, sensor_seed, source_part, training_command, training_iterations,
};

pub use compose::compose_scene;

pub(super) use attributes::SceneAttributes;
use attributes::scene_attributes;
pub use recompose::recompose;

pub use gs2e_tree::CameraPart;
pub use licence::{LicencePart, LicensedTool, OWNER};

use gs2e_recipe::MountedPath;
use gs2e_sensor::latency::LatencyAccount;
use gs2e_sensor::readout::ReadoutAccount;
use gs2e_train::TrainingRecord;
use gs2e_train::fidelity::PsnrFigures;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneRecord {
    /// Schema version: 1.
    pub schema: u32,
    /// Scene id.
    pub id: String,
    /// Version of the program that wrote the release.
    pub gs2e_version: String,
    /// Source of the poses.
    pub source: SourcePart,
    /// The photos, by name and hash.
    pub images: Vec<ImagePart>,
    /// The camera that was rendered; of a rig, the first one.
    pub camera: CameraPart,
    /// Conventions for reading the numbers.
    pub conventions: SceneConventions,
    /// Source of the Gaussians; null if nothing is rendered.
    pub reconstruction: Option<ReconstructionPart>,
    /// Licence terms of the scene.
    pub licence: LicencePart,
    /// The recipe's seed.
    pub seed: u64,
    /// Every derived stream seed, `trajectory/purpose` to a decimal number.
    pub seeds: BTreeMap<String, String>,
    /// The merged recipe, with defaults filled in.
    pub recipe: Value,
    /// SHA-256 of that recipe as compact JSON.
    pub recipe_sha256: String,
    /// The split that it belongs to, if the release has splits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<SplitPart>,
    /// The trajectories, in recipe order.
    pub trajectories: Vec<TrajectoryPart>,
    /// The axes of appendix D of the paper.
    pub attributes: SceneAttributes,
}

/// The split of a scene.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitPart {
    /// Its name.
    pub name: String,
    /// The key that was dealt to a split. Scenes with the same key stay together.
    pub group: String,
}

/// Source of the poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourcePart {
    /// `procedural`, `colmap`, `nerfstudio`, `model`, `mvimgnet`, `dl3dv` or `none`.
    pub kind: String,
    /// The upstream dataset's own id.
    pub upstream_id: Option<String>,
    /// Address of the upstream dataset.
    pub upstream_url: Option<String>,
    /// Day of access.
    pub accessed: Option<String>,
    /// True if its terms were accepted.
    pub terms_accepted: Option<bool>,
}

/// A photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImagePart {
    /// File name.
    pub name: String,
    /// SHA-256 of its bytes, if the photo was available.
    pub sha256: Option<String>,
    /// Width in pixels, if known.
    pub width: Option<u32>,
    /// Height in pixels, if known.
    pub height: Option<u32>,
    /// True if its pose was used.
    pub used: bool,
    /// The reason why it was not used.
    pub why_not: Option<String>,
}

impl SceneRecord {
    /// The camera that sees along a trajectory.
    #[must_use]
    pub fn camera_of<'a>(&'a self, part: &'a TrajectoryPart) -> &'a CameraPart {
        part.mounted.as_ref().map_or(&self.camera, |mounted| &mounted.camera)
    }
}

/// Conventions for reading the numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneConventions {
    camera_axes: String,
    pose: String,
    quaternion: String,
    pixel_center: f64,
    time_unit: String,
    length_unit: String,
    polarity: [u8; 2],
    brightness: String,
}

impl SceneConventions {
    /// Conventions of a scene of this recipe. Its sensors see brightness as encoded for a display,
    /// or proportional to light (`front_end: { decode: srgb }`); or its sensors differ in this.
    #[must_use]
    pub fn for_brightness(recipe: &Value) -> Self {
        let sensors = recipe.get("sensors").and_then(Value::as_object).map(|named| named.values().collect());
        // A recipe has one `sensor`, or several named `sensors`.
        let sensors: Vec<&Value> = sensors.unwrap_or_else(|| recipe.get("sensor").into_iter().collect());
        let cameras = recipe.pointer("/rig/cameras").and_then(Value::as_array);
        let own = cameras.into_iter().flatten().filter_map(|camera| camera.get("sensor"));
        let models =
            sensors.into_iter().chain(own).filter_map(Value::as_object).flat_map(|sensor| sensor.values());
        let decoded: Vec<bool> =
            models.map(|model| model.pointer("/front_end/decode") == Some(&json!("srgb"))).collect();
        let brightness = match (decoded.contains(&true), decoded.contains(&false)) {
            // Also for a recipe without a sensor.
            (false, _) => "srgb-encoded",
            (true, false) => "linear",
            (true, true) => "per-sensor",
        };
        Self {
            camera_axes: "opencv".into(),
            pose: "c2w".into(),
            quaternion: "xyzw".into(),
            pixel_center: 0.5,
            time_unit: "us".into(),
            length_unit: "source".into(),
            polarity: [0, 1],
            brightness: brightness.into(),
        }
    }
}

/// Source of the Gaussians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReconstructionPart {
    /// `procedural`, `given`, `builtin` or `command`.
    pub kind: String,
    /// SHA-256 of the scene file in the store, a `.ply`.
    pub scene_sha256: String,
    /// Number of Gaussians.
    pub gaussians: u64,
    /// Degree of their spherical harmonics.
    pub sh_degree: u8,
    /// True if the scene file declares that it was trained with the antialiased rule.
    pub antialiased: Option<bool>,
    /// Gaussians of the file that were left out because a field was not finite.
    pub dropped: u64,
    /// Training iterations.
    pub iterations: Option<u64>,
    /// Training command, with placeholders in braces.
    pub command: Option<String>,
    /// PSNR against photos.
    pub psnr: Option<PsnrFigures>,
    /// Mean SSIM against photos.
    pub ssim: Option<f64>,
    /// LPIPS against photos.
    pub lpips: Option<f64>,
    /// The training, if the program made it: its course, and PSNR and SSIM of each held-out photo at
    /// the size of training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingRecord>,
}

/// A trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryPart {
    /// Its name.
    pub name: String,
    /// `refine`, `novel`, `orbit`, `keyframes`, or `mounted` for a camera of a rig.
    pub kind: String,
    /// Names of the cameras of the rig, if the path is that of a body.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<String>,
    /// The camera of a rig, if the path is that of one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounted: Option<MountedPart>,
    /// Path, by its kind, and speed, as in the recipe.
    pub parameters: Value,
    /// Poses of another trajectory that were drawn as key poses, by number from 0.
    pub keyframes: Vec<u64>,
    /// Number of poses.
    pub poses: usize,
    /// Last stamp, microseconds.
    pub duration_us: i64,
    /// Frames per second, `p/q`.
    pub rate: String,
    /// Interpolation of brightness between frames.
    pub sampling: Value,
    /// Rules of rendering.
    pub render_rules: Value,
    /// The sensor, if there are events.
    pub sensor: Option<Value>,
    /// The numbers of the sensor that were drawn for this trajectory, by their path in the recipe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawn: Option<BTreeMap<String, f64>>,
    /// The sensors by name, if several saw one rendering. Then `sensor` and the counts of
    /// `statistics` are null.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sensors: BTreeMap<String, SensorPart>,
    /// Blur, if there are blurred frames.
    pub blur: Option<Value>,
    /// Statistics.
    pub statistics: TrajectoryStatistics,
}

/// A camera of a rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountedPart {
    /// The trajectory of its body.
    pub body: String,
    /// Its name.
    pub name: String,
    /// The camera.
    pub camera: CameraPart,
    /// Rows of the matrix that maps points of the body to points of the camera, scene units.
    pub camera_from_body: [[f64; 4]; 4],
}

impl MountedPart {
    /// The part of a camera.
    pub(super) fn new(mounted: &MountedPath, camera: CameraPart) -> Self {
        Self {
            body: mounted.body.clone(),
            name: mounted.camera.name.clone(),
            camera,
            camera_from_body: mounted.camera.mount.body_from_camera().inverse().matrix_rows(),
        }
    }
}

/// One of several sensors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorPart {
    /// Model and parameters.
    pub sensor: Value,
    /// A sensor with noise that otherwise equals this one, if there is one. Poses, frames and
    /// stamps are the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub twin_of: Option<String>,
    /// The numbers of it that were drawn for this trajectory, by their path in the recipe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawn: Option<BTreeMap<String, f64>>,
    /// Statistics of its stream. Values of the whole trajectory are null.
    pub statistics: TrajectoryStatistics,
}

/// Statistics of a trajectory.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryStatistics {
    /// Number of events.
    pub events: Option<u64>,
    /// Number of brighter events.
    pub on: Option<u64>,
    /// Number of darker events.
    pub off: Option<u64>,
    /// Events per pixel and second.
    pub rate_ev_px_s: Option<f64>,
    /// Counts and delays of the readout, if a bus limits the rate of events.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readout: Option<ReadoutAccount>,
    /// Counts of the delays, if events are late.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<LatencyAccount>,
    /// Most events in one millisecond.
    pub peak_ev_per_ms: Option<u64>,
    /// Pixels with an event.
    pub active_pixels: Option<u64>,
    /// Largest optical flow between neighbouring poses, px, over sampled poses.
    pub max_step_px: Option<f32>,
    /// Linear speed, units per second.
    pub linear_unit_s: Option<QuantityExtent>,
    /// Angular speed, radians per second.
    pub angular_rad_s: Option<QuantityExtent>,
    /// Depth, units: 5 %, 50 % and 95 % quantile over sampled poses.
    pub depth_unit: Option<DepthQuantiles>,
}

/// Extent of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuantityExtent {
    /// Smallest.
    pub min: f64,
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

impl QuantityExtent {
    pub(super) fn from_values(values: &[f64]) -> Option<Self> {
        let (min, max) =
            values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        // Without values this is NaN and the range is infinite. The next line drops both.
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (!values.is_empty()).then_some(Self { min, mean, max })
    }
}

/// Depth quantiles, units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthQuantiles {
    /// 5 %.
    pub p5: f32,
    /// 50 %.
    pub p50: f32,
    /// 95 %.
    pub p95: f32,
}
