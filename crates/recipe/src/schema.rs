//! The recipe as written, version 1: every key, including the keys of features that are not built
//! yet.
//!
//! This file defines types only. [`super::resolve`] knows the required keys, their ranges and their
//! defaults. [`UnsupportedField`] marks a key of a feature that is not built yet: the key is
//! reserved, and refused by name.
//!
//! Enumerations of plain words are the domain's own, whose comments are then part of the page.
//!
//! The comments of the fields are the text of `docs/recipe.md`, which `cargo xtask docs` writes. A
//! field's comment ends with `Unit: …`, and with `Required.` or `Default: …`. A default in
//! backticks is YAML, and a test compares a recipe that writes it with one that leaves the key out.
//! Ranges of numbers are not repeated here: the test reads them off the messages of the loader.
//! `Range: …` is for ranges that no single number shows.

mod objects;
mod reconstruct;
mod rig;
mod sensor;
mod source;
mod trajectory;

pub(super) use objects::{ObjectKeySection, ObjectPathSection, ObjectSection, PlacedSection, SelectSection};
pub(super) use reconstruct::{
    BuiltinSection, CommandSection, CountSection, ReconstructSection, TimeSection, UntilSection,
};
pub(super) use rig::{ExtrinsicSection, RigCameraSection, RigSection};
pub(super) use sensor::{
    BandwidthPointSection, BandwidthSection, ContrastSection, EsimSection, FloorPointSection,
    FrontEndSection, HotPixelsSection, LatencySection, LeakSection, LuminanceSection,
    PhotoreceptorNoiseSection, RangeSection, ReadoutSection, ReceptorPointSection, RefractorySection,
    SensorSection, ThresholdSection, V2eSection, VoltmeterSection,
};
pub(super) use source::{
    CaptureSection, FolderSection, FountainSection, KindKey, ProceduralSection, SourceSection, UnposedSection,
};
pub(super) use trajectory::{
    BezierSection, CurveSection, FlowSection, KeyframesSection, ListSection, MetricSection,
    NovelCurveSection, NovelSection, OrbitSection, PoseSection, RefineSection, SpeedSection,
    TrajectorySection,
};

use super::field::{Field, NumberLiteral, UnsupportedField};
use crate::{OutputKind, SceneScale};
use gs2e_check::Limits;
use gs2e_image::light::MeanScale;
use gs2e_render::lights::Waveform;
use gs2e_render::{LayerOrder, RenderRules};
use gs2e_sampling::exposure::SubframeRule;
use gs2e_scene::camera::{NamedSize, PrincipalPoint};
use gs2e_sensor::voltmeter::BetweenFrames;
use gs2e_trajectory::imu::ImuPreset;
use gs2e_trajectory::sample::SummationRule;
use serde::Deserialize;
use std::collections::BTreeMap;

/// A recipe is one YAML mapping with these keys.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct RecipeSchema {
    /// Version of the recipe language. Range: `1`. Required.
    pub version: Field<u64>,
    /// Scene id, which is also the scene's folder in the release: parts of letters, digits, `.`,
    /// `_` and `-`, separated by `/`. Range: at most 200 bytes. Required.
    pub scene: Field<String>,
    /// Named group of settings, which the other keys of the recipe override. The settings of
    /// `defaults.yaml` for the same keys do not apply. Default: none.
    pub preset: Field<PresetKey>,
    /// Seed of every random draw of the scene. Default: `0`.
    pub seed: Field<u64>,
    /// Source of the camera poses, the camera and the photos. Required.
    pub source: Field<SourceSection>,
    /// Name of the photographed object, the same in each recipe that shows it. Release splits with
    /// `by: object` keep a group together. Default: none.
    pub group: Field<String>,
    /// Source of the Gaussians. A procedural source brings its own; a `model` source takes the
    /// newest of its folder. Default: required for the other sources, unless nothing is rendered.
    pub reconstruct: Field<ReconstructSection>,
    /// Camera that renders. Default: the source's own; required where `source` is `none`.
    pub camera: Field<CameraSection>,
    /// Trajectories to make, at least one. Required.
    pub trajectories: Field<Vec<Field<TrajectorySection>>>,
    /// Times at which frames are rendered for the sensor. Default: `{}`.
    pub sampling: Field<SamplingSection>,
    /// Settings of the renderer. Default: `{}`.
    pub render: Field<RenderSection>,
    /// Sensor and its parameters. Default: `{ voltmeter: {} }`.
    pub sensor: Field<SensorSection>,
    /// Several sensors that see the same rendering, by name, instead of `sensor`. Each has its own
    /// event file and its own checks. Default: none.
    pub sensors: Field<BTreeMap<String, Field<SensorSection>>>,
    /// Products to make for each trajectory. Steps that no product needs do not run. Default:
    /// `[events, sharp]`.
    pub outputs: Field<Vec<Field<OutputKind>>>,
    /// Spacing and shutter of the sharp frames. A frame in the middle of an exposure is kept in any case.
    /// Default: `{}`.
    pub sharp: Field<SharpSection>,
    /// Exposure of the blurred frames. Default: `{}`.
    pub blur: Field<BlurSection>,
    /// Spacing of the depth images. Default: `{}`.
    pub depth: Field<EverySection>,
    /// Spacing of the optical flow images. Default: `{}`.
    pub flow: Field<EverySection>,
    /// Spacing of the disparity images. Default: `{}`.
    pub disparity: Field<EverySection>,
    /// Spacing of the masks of the output `segmentation`. Default: `{}`.
    pub segmentation: Field<EverySection>,
    /// Things that move on paths of their own. Default: `[]`.
    pub objects: Field<Vec<Field<ObjectSection>>>,
    /// Cameras on one body, which follows the trajectories. Default: none, for one camera.
    pub rig: Field<RigSection>,
    /// Inertial sensor of the output `imu`. Default: `{}`.
    pub imu: Field<ImuSection>,
    /// Size of the scene's unit, which inertial data need. Default: none.
    pub scale: Field<ScaleSection>,
    /// Light of the scene that changes with time. Default: none.
    pub lights: Field<LightsSection>,
    /// Limits that differ from the defaults, requests for optional checks, and waivers. Default:
    /// `{}`.
    pub checks: Field<Limits>,
    /// Licence of the owner's contribution. Default: none.
    pub licence: Field<LicenceSection>,
    /// Contents of a release. Default: none.
    pub release: Field<UnsupportedField>,
    /// Facts for catalogues that the program cannot know. Default: `{}`.
    pub attributes: Field<AttributesSection>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PresetKey {
    /// The trajectories, frame rate, renderer and sensor of the paper (GS2E, arXiv 2505.15287). The
    /// picture moves by several pixels per frame, so events between frames are inexact.
    Paper,
}

/// Camera of the renderings. With width and height alone it keeps the source's horizontal field of
/// view.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct CameraSection {
    /// Size by name, instead of `width` and `height`. Default: none.
    pub size: Field<NamedSize>,
    /// Width of the image. Unit: px. Default: required without `size`.
    pub width: Field<u64>,
    /// Height of the image. Unit: px. Default: required without `size`.
    pub height: Field<u64>,
    /// Horizontal angle of view, instead of `fx` and the keys after it. Unit: degrees. Default: that of the
    /// source; 60 without a capture.
    pub fov: Field<f64>,
    /// Focal length in x. Unit: px. Default: that of the angle of view; required with `fy`, `cx` or `cy`.
    pub fx: Field<f64>,
    /// Focal length in y. Unit: px. Default: that of `fx`.
    pub fy: Field<f64>,
    /// Principal point, x. Unit: px. Default: half the width.
    pub cx: Field<f64>,
    /// Principal point, y. Unit: px. Default: half the height.
    pub cy: Field<f64>,
    /// Principal point by name, for `gs2e export`. Other than `given`, it excludes `cx` and `cy`. Default:
    /// `given`.
    pub principal: Field<PrincipalPoint>,
    /// Lens that distorts the pictures and the events. [scene.md](scene.md#lenses) describes it. Default:
    /// none, a pinhole.
    pub lens: Field<LensSection>,
}

/// Model of a lens with its coefficients, as in OpenCV. [scene.md](scene.md#lenses) describes it.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum LensSection {
    /// Radial and tangential: k1, k2, p1, p2, with k3 or with k3, k4, k5, k6 after them.
    Opencv(Field<Vec<Field<f64>>>),
    /// Fisheye, by Kannala and Brandt: k1, k2, k3, k4.
    Fisheye(Field<Vec<Field<f64>>>),
}

/// [sampling.md](sampling.md) explains the choice between a rate and a tolerance.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct SamplingSection {
    /// Frames per second rendered for the sensor, and poses per second in the release. Unit: Hz.
    /// Default: `2400`.
    pub rate: Field<NumberLiteral>,
    /// Interpolation of brightness between two frames, in `ln(L + k2)`. Sensors `esim` and `v2e`
    /// and the law `official` take `linear` only. Default: `linear`; with a tolerance, the cheapest
    /// that meets it.
    pub between: Field<BetweenFrames>,
    /// Summation of speed laws along the path. Default: `sum`; `integral` with a tolerance.
    pub law: Field<SummationRule>,
    /// Target of the RMS interpolation error of the sensor's brightness. Frames are then placed
    /// where the error needs them. For `voltmeter` with the law `exact` only. Unit: contrast
    /// thresholds. Default: none.
    pub tolerance: Field<f64>,
}

/// Conventions of the renderer.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct RenderSection {
    /// Extents, culling and stopping rules. Default: `official`; `soft` with a tolerance.
    pub rules: Field<RenderRules>,
    /// Compensation of opacity for the screen-space dilation. Default: `auto`.
    pub antialiased: Field<AntialiasedKey>,
    /// Colour behind the scene: red, green, blue. Default: `[0, 0, 0]`.
    pub background: Field<[Field<f64>; 3]>,
    /// Order of layers of nearly the same depth. Default: `depth`.
    pub order: Field<LayerOrder>,
    /// Depth of a plane before the camera, in scale distances of the path; the near plane of the rules where
    /// that is deeper. Gaussians that pass it within the picture are hidden along the whole path: see
    /// [checks.md](checks.md#flashes). Default: none; `0` for a scene that `reconstruct: builtin` trains.
    pub near: Field<f64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) enum AntialiasedKey {
    /// The setting of the scene file; off if it has none.
    #[serde(rename = "auto")]
    Auto,
    /// On.
    #[serde(rename = "true")]
    On,
    /// Off.
    #[serde(rename = "false")]
    Off,
}

/// Spacing and shutter of the sharp frames.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct SharpSection {
    /// Number of poses from one picture to the next. Default: `1`.
    pub every: Field<u64>,
    /// Pictures per second, instead of `every`: the nearest whole number of poses is taken. Unit: Hz.
    /// Default: none.
    pub fps: Field<f64>,
    /// Time from the first row of a frame to the last: a rolling shutter, whose middle row is at the time of
    /// the pose. Unit: us. Default: none, for a shutter that sees all rows at once.
    pub readout_us: Field<u64>,
}

/// Spacing of the pictures of `depth`, `flow`, `disparity` or `segmentation`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct EverySection {
    /// Number of poses from one picture to the next. Default: `1`.
    pub every: Field<u64>,
    /// Pictures per second, instead of `every`: the nearest whole number of poses is taken. Unit: Hz.
    /// Default: none.
    pub fps: Field<f64>,
}

/// Exposures follow each other without a gap, each within the trajectory. A blurred frame is the
/// mean of its sub-frames.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct BlurSection {
    /// Number of dense frames per exposure; odd. Default: `15`.
    pub frames: Field<u64>,
    /// Pictures per second, instead of `frames`: the nearest odd number of dense frames is taken. Unit: Hz.
    /// Default: none.
    pub fps: Field<f64>,
    /// Sub-frames between the dense frames. Default: `auto`.
    pub subframes: Field<SubframeRule>,
    /// Values that are averaged. Default: `linear`.
    pub mean: Field<MeanScale>,
}

/// [scene.md](scene.md#inertial-data) describes the measurements.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct ImuSection {
    /// Sensor by name, which the other keys override. Default: `bmi088`.
    pub preset: Field<ImuPreset>,
    /// Samples per second. Unit: Hz. Default: `1000`.
    pub rate: Field<NumberLiteral>,
    /// Direction against gravity, in the scene's axes and of any length. Default: the mean of the up
    /// directions of the captured views; required where `source` is `none`.
    pub up: Field<[Field<f64>; 3]>,
    /// Strength of gravity. Unit: m/s². Default: `9.80665`.
    pub gravity: Field<f64>,
    /// Errors of the gyroscope, whose unit u is rad/s. Default: those of the preset.
    pub gyroscope: Field<ImuAxisSection>,
    /// Errors of the accelerometer, whose unit u is m/s². Default: those of the preset.
    pub accelerometer: Field<ImuAxisSection>,
}

/// Errors of each axis of a sensor in its unit u.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct ImuAxisSection {
    /// Density of the white noise. Unit: u/√Hz. Default: that of the preset.
    pub noise: Field<f64>,
    /// Density of the random walk of the bias. Unit: u/s/√Hz. Default: that of the preset.
    pub walk: Field<f64>,
    /// Standard deviation of the bias at the start, drawn for each axis. Unit: u. Default: that of the
    /// preset.
    pub bias: Field<f64>,
    /// Largest value that the sensor shows. Unit: u. Default: that of the preset.
    pub range: Field<f64>,
}

/// Size of the scene's unit.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct ScaleSection {
    /// Metres per unit of the scene. Unit: m. Required.
    pub metres_per_unit: Field<f64>,
}

/// Light that changes with time. It lights the whole scene alike, in all events and pictures.
/// [scene.md](scene.md#light-that-changes) describes it.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct LightsSection {
    /// Lamps that flicker. Default: none.
    pub flicker: Field<FlickerSection>,
    /// Level at moments, in order of time. It is linear in stops between them, and constant before the first
    /// and after the last. Default: none.
    pub level: Field<Vec<Field<LevelSection>>>,
}

/// Flicker of the light: one factor with a mean of 1.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct FlickerSection {
    /// Frequency of the light, which for lamps on the mains is twice that of the mains. Unit: Hz. Required.
    pub hz: Field<f64>,
    /// Depth of modulation: 1 is dark once in each period. Required.
    pub depth: Field<f64>,
    /// Form of a period. Default: `sine`.
    pub waveform: Field<Waveform>,
    /// Part of a period that is over at the first pose. Default: `0`.
    pub phase: Field<f64>,
}

/// Level of the light at a moment.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct LevelSection {
    /// Time after the first pose. Unit: s. Required.
    pub t: Field<f64>,
    /// Level, which doubles with each stop. Unit: stops. Required.
    pub stops: Field<f64>,
}

/// Facts for catalogues.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct AttributesSection {
    /// Size of the scene. Default: `object` for `mvimgnet`, `large` for `dl3dv`, otherwise unknown.
    pub scene_scale: Field<SceneScale>,
}

/// The program adds the terms of the source. [publish.md](publish.md) explains both.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct LicenceSection {
    /// Terms of your own contribution. Range: SPDX expression. Required.
    pub expression: Field<String>,
    /// Rights holder. Required.
    pub holder: Field<String>,
    /// Terms that the upstream granted to you, instead of its public terms. Range: SPDX expression.
    /// Default: none.
    pub upstream: Field<String>,
    /// Evidence of that grant. Default: required with `upstream`.
    pub evidence: Field<EvidenceSection>,
}

/// Evidence of terms that an upstream granted.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct EvidenceSection {
    /// Grantor, and extent of the grant. Required.
    pub granted_by: Field<String>,
    /// Address of the grant. Range: a URL. Required.
    pub url: Field<String>,
    /// Day of the grant. Range: `YYYY-MM-DD`. Required.
    pub date: Field<String>,
}
