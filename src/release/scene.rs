//! `scene.json`, schema version 1: what a scene is, where it comes from and how it was made. Photos are named and
//! hashed, never copied; nothing here is a guess: what is not known is `null`.

mod again;
mod licence;
mod trajectory;

pub(super) use again::again;

pub(super) use licence::{LicencePart, LicensedTool, OWNER};

use super::built::BuiltScene;
use crate::camera::Camera;
use crate::licence::{ComposedTerms, Redistributability};
use crate::recipe::{OutputKind, Recipe, ReconstructMethod, SceneScale, SceneSource, UpstreamOrigin};
use crate::reconstruct::TrainerCommand;
use crate::render::fidelity::PsnrFigures;
use crate::seed::{Seed, StreamPurpose};
use crate::source::kind::CaptureKind;
use crate::source::{Capture, CapturedView, UnusedPhoto, natural};
use crate::speed::SpeedMeaning;
use crate::trajectory::path::CameraPath;
use crate::trajectory::report::SpeedReport;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneRecord {
    /// 1.
    pub schema: u32,
    /// Scene id.
    pub id: String,
    /// Version of the program that wrote the release.
    pub gs2e_version: String,
    /// Where the poses come from.
    pub source: SourcePart,
    /// The photos, by name and hash.
    pub images: Vec<ImagePart>,
    /// The camera that was rendered.
    pub camera: CameraPart,
    /// How numbers are to be read.
    pub conventions: SceneConventions,
    /// Where the Gaussians come from.
    /// Null where nothing is rendered.
    pub reconstruction: Option<ReconstructionPart>,
    /// Under which terms the scene is passed on.
    pub licence: LicencePart,
    /// The recipe's seed.
    pub seed: u64,
    /// Every derived stream seed, `trajectory/purpose` to a decimal number.
    pub seeds: BTreeMap<String, String>,
    /// The merged recipe, defaults filled.
    pub recipe: Value,
    /// SHA-256 of that recipe as compact JSON.
    pub recipe_sha256: String,
    /// The split that it belongs to, where the release has splits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<SplitPart>,
    /// The trajectories, in recipe order.
    pub trajectories: Vec<TrajectoryPart>,
    /// The axes of the paper's appendix D.
    pub attributes: SceneAttributes,
}

/// The split of a scene.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitPart {
    /// Its name.
    pub name: String,
    /// What keeps the scene together with others: the key that was dealt.
    pub group: String,
}

/// Where the poses come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourcePart {
    /// `procedural`, `colmap`, `nerfstudio`, `model`, `mvimgnet`, `dl3dv` or `none`.
    pub kind: String,
    /// The upstream dataset's own id.
    pub upstream_id: Option<String>,
    /// Where the upstream dataset is.
    pub upstream_url: Option<String>,
    /// When it was accessed.
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
    /// SHA-256 of its bytes, where the photo was there.
    pub sha256: Option<String>,
    /// Width in pixels, where it is known.
    pub width: Option<u32>,
    /// Height in pixels, likewise.
    pub height: Option<u32>,
    /// True if its pose was used.
    pub used: bool,
    /// Why not.
    pub why_not: Option<String>,
}

/// The camera that was rendered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPart {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Focal length, px.
    pub fx: f64,
    /// Focal length, px.
    pub fy: f64,
    /// Principal point, px.
    pub cx: f64,
    /// Principal point, px.
    pub cy: f64,
    /// The distortion that the capture's photos have and the rendered camera has not.
    pub undistorted_from: Option<Value>,
}

/// How numbers are to be read.
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
    /// Those of a scene of this recipe: its sensors see brightness as it is encoded for a display, or in proportion to
    /// light (`front_end: { decode: srgb }`), or some this way and some that.
    #[must_use]
    pub fn for_brightness(recipe: &Value) -> Self {
        let sensors = recipe.get("sensors").and_then(Value::as_object).map(|named| named.values().collect());
        let sensors: Vec<&Value> = sensors.unwrap_or_else(|| recipe.get("sensor").into_iter().collect());
        let models = sensors.into_iter().filter_map(Value::as_object).flat_map(|sensor| sensor.values());
        let decoded: Vec<bool> =
            models.map(|model| model.pointer("/front_end/decode") == Some(&json!("srgb"))).collect();
        let brightness = match (decoded.contains(&true), decoded.contains(&false)) {
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

/// Where the Gaussians come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReconstructionPart {
    /// `procedural`, `given` or `command`.
    pub kind: String,
    /// SHA-256 of the scene as the store keeps it, a `.ply`.
    pub scene_sha256: String,
    /// Number of Gaussians.
    pub gaussians: u64,
    /// Degree of their harmonics.
    pub sh_degree: u8,
    /// True if the scene file says that it was trained with the antialiased rule.
    pub antialiased: Option<bool>,
    /// Gaussians of the file that were left out, because a field was not finite.
    pub dropped: u64,
    /// Training iterations.
    pub iterations: Option<u64>,
    /// Training command, the places of a training in braces.
    pub command: Option<String>,
    /// PSNR against photos.
    pub psnr: Option<PsnrFigures>,
    /// Mean SSIM against photos.
    pub ssim: Option<f64>,
    /// LPIPS against photos.
    pub lpips: Option<f64>,
}

/// A trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryPart {
    /// Its name.
    pub name: String,
    /// `refine`, `novel`, `orbit` or `keyframes`.
    pub kind: String,
    /// Path, by its kind, and speed as the recipe has them.
    pub parameters: Value,
    /// Poses of another trajectory that were drawn as its key poses, by number from 0.
    pub keyframes: Vec<u64>,
    /// Number of poses.
    pub poses: usize,
    /// Last stamp, microseconds.
    pub duration_us: i64,
    /// Frames a second, `p/q`.
    pub rate: String,
    /// How brightness is taken between frames.
    pub sampling: Value,
    /// How frames are rendered.
    pub render_rules: Value,
    /// The sensor, where there are events.
    pub sensor: Option<Value>,
    /// The sensors by name, where several saw one rendering; then `sensor` is null, and so are the counts of `statistics`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sensors: BTreeMap<String, SensorPart>,
    /// Blur, where there is any.
    pub blur: Option<Value>,
    /// What was counted.
    pub statistics: TrajectoryStatistics,
}

/// One of several sensors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorPart {
    /// Model and parameters.
    pub sensor: Value,
    /// The sensor that it is without that one's noise, where there is such: poses, frames and stamps are the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub twin_of: Option<String>,
    /// What was counted of its stream; what is the trajectory's is null.
    pub statistics: TrajectoryStatistics,
}

/// What was counted on a trajectory.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryStatistics {
    /// Events.
    pub events: Option<u64>,
    /// Brighter.
    pub on: Option<u64>,
    /// Darker.
    pub off: Option<u64>,
    /// Events per pixel and second.
    pub rate_ev_px_s: Option<f64>,
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
    /// Half.
    pub p50: f32,
    /// 95 %.
    pub p95: f32,
}

/// The axes of the paper's appendix D.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneAttributes {
    /// `sharp`, `blurry`: what is in the tree.
    pub data_type: Vec<String>,
    /// `object`, `medium`, `large` or `unknown`.
    pub scene_scale: String,
    /// Poses are exact.
    pub gt_poses: bool,
    /// `uniform` where the speed varies by at most 1 %.
    pub speed_profile: String,
    /// True if there is more than one trajectory.
    pub multi_trajectory: bool,
    /// What stands in for a device.
    pub device: String,
    /// The source.
    pub data_source: String,
}

/// Composes the file.
///
/// # Errors
/// When a blob cannot be read to be hashed.
pub(super) fn compose_scene(scene: &BuiltScene<'_>) -> std::io::Result<SceneRecord> {
    let recipe = scene.recipe;
    let compact = serde_json::to_vec(&recipe.merged).expect("a JSON value is writable");
    Ok(SceneRecord {
        schema: 1,
        id: recipe.scene.clone(),
        gs2e_version: env!("CARGO_PKG_VERSION").into(),
        source: source_part(recipe),
        images: capture_images(scene),
        camera: camera_part(scene),
        conventions: SceneConventions::for_brightness(&recipe.merged),
        reconstruction: reconstruction_part(scene)?,
        licence: licence::licence_part(recipe, &scene.licence),
        seed: recipe.seed,
        seeds: draw_seeds(recipe),
        recipe: recipe.merged.clone(),
        recipe_sha256: super::checksum::sha256_hex(&compact),
        split: None,
        trajectories: scene.trajectories.iter().map(|t| trajectory::trajectory_part(recipe, t)).collect(),
        attributes: scene_attributes(
            recipe,
            &scene.licence,
            scene.trajectories.iter().map(|t| &t.motion.report),
        ),
    })
}

fn source_part(recipe: &Recipe) -> SourcePart {
    let upstream = match &recipe.source {
        SceneSource::Captured(_, upstream) => upstream.clone(),
        SceneSource::Procedural(_) | SceneSource::None => UpstreamOrigin::default(),
    };
    SourcePart {
        kind: recipe.source.kind().into(),
        upstream_id: upstream.id,
        upstream_url: upstream.url,
        accessed: upstream.accessed,
        terms_accepted: upstream.terms_accepted,
    }
}

/// Every photo that the source has, in natural order of the names: those that are used and those that are not.
fn capture_images(scene: &BuiltScene<'_>) -> Vec<ImagePart> {
    if !scene.recipe.source.has_photos() {
        // The embedded scene has views, but there are no photos.
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

fn camera_part(scene: &BuiltScene<'_>) -> CameraPart {
    let Camera { size, fx, fy, cx, cy } = scene.camera();
    let lens =
        scene.capture.views.iter().map(|v| &v.lens).find(|lens| **lens != crate::source::LensModel::Pinhole);
    let undistorted_from = lens.map(|lens| json!(lens));
    CameraPart { width: size.width, height: size.height, fx, fy, cx, cy, undistorted_from }
}

fn reconstruction_part(scene: &BuiltScene<'_>) -> std::io::Result<Option<ReconstructionPart>> {
    let Some(summary) = &scene.gaussians else { return Ok(None) };
    let command = training_command(scene.recipe);
    let fidelity = scene.photographed.as_ref().and_then(|photographed| photographed.fidelity.as_ref());
    Ok(Some(ReconstructionPart {
        kind: kind_of_gaussians(scene.recipe).into(),
        scene_sha256: super::checksum::sha256_of_file(&summary.path)?,
        gaussians: summary.count,
        sh_degree: summary.sh_degree,
        antialiased: summary.antialiased,
        dropped: summary.screening.non_finite,
        iterations: command.and_then(|command| command.iterations),
        command: command.map(TrainerCommand::written),
        psnr: fidelity.and_then(|fidelity| fidelity.psnr()),
        ssim: fidelity.and_then(|fidelity| fidelity.ssim()),
        lpips: None,
    }))
}

/// Where the Gaussians of a recipe come from.
fn kind_of_gaussians(recipe: &Recipe) -> &'static str {
    match (&recipe.source, training_command(recipe)) {
        (SceneSource::Procedural(_), _) => "procedural",
        (_, Some(_)) => "command",
        (_, None) => "given",
    }
}

/// The program that trained the scene.
fn training_command(recipe: &Recipe) -> Option<&TrainerCommand> {
    match &recipe.reconstruct {
        Some(ReconstructMethod::Command(command)) => Some(command),
        Some(ReconstructMethod::Given(_) | ReconstructMethod::Newest(_)) | None => None,
    }
}

/// The groups of a novel trajectory share the seeds of its draws, which derive from its name as the recipe has it.
fn draw_seeds(recipe: &Recipe) -> BTreeMap<String, String> {
    let mut seeds = BTreeMap::new();
    let mut add = |name: &str, purpose: StreamPurpose, seed: Seed| {
        seeds.insert(format!("{name}/{}", purpose.name()), seed.0.to_string());
    };
    for asked in &recipe.trajectories {
        if let CameraPath::Novel(novel) = &asked.path {
            add(&asked.written, StreamPurpose::Keyframes, novel.keyframes_seed);
            add(&asked.written, StreamPurpose::Curve, novel.curve_seed);
        }
        if recipe.outputs.contains(&OutputKind::Events) {
            add(&asked.name, StreamPurpose::Sensor, sensor_seed(recipe, &asked.name));
        }
    }
    seeds
}

/// The seed of the sensors' noise along a trajectory.
fn sensor_seed(recipe: &Recipe, trajectory: &str) -> Seed {
    Seed::for_stream(recipe.seed, &recipe.scene, trajectory, StreamPurpose::Sensor)
}

fn scene_attributes<'r>(
    recipe: &Recipe,
    licence: &ComposedTerms,
    mut reports: impl Iterator<Item = &'r SpeedReport>,
) -> SceneAttributes {
    let shown = licence.passing != Redistributability::Withheld;
    let has = |output| shown && recipe.outputs.contains(&output);
    let data_type = [("sharp", has(OutputKind::Sharp)), ("blurry", has(OutputKind::Blur))];
    // Where the frame rate varies in the speed's place, steps are as short as they are quick.
    let is_uniform = |report: &SpeedReport| {
        report.meaning == SpeedMeaning::FrameRate
            || QuantityExtent::from_values(&report.u).is_none_or(|range| range.max <= UNIFORM * range.min)
    };
    let captured = match &recipe.source {
        SceneSource::Captured(captured, _) => Some(captured.kind),
        SceneSource::Procedural(_) | SceneSource::None => None,
    };
    // Scales of captures are arbitrary: only what a dataset is of says how large things are.
    let (scale, data_source) = match captured {
        Some(CaptureKind::Mvimgnet) => ("object", "MVImgNet"),
        Some(CaptureKind::Dl3dv) => ("large", "DL3DV-10K"),
        _ => ("unknown", recipe.source.kind()),
    };
    let uniform = reports.all(is_uniform);
    SceneAttributes {
        data_type: data_type.into_iter().filter(|(_, has)| *has).map(|(name, _)| name.into()).collect(),
        scene_scale: recipe.scale.map_or(scale, SceneScale::name).into(),
        gt_poses: true,
        speed_profile: if uniform { "uniform" } else { "non-uniform" }.into(),
        multi_trajectory: recipe.trajectories.len() > 1,
        device: "3DGS + DVS-Voltmeter".into(),
        data_source: data_source.into(),
    }
}

/// Speeds whose extremes differ by no more than this factor are called uniform.
const UNIFORM: f64 = 1.01;
