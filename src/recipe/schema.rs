//! The recipe as written, version 1: every key, including the keys of features that are not built
//! yet.
//!
//! This file defines types only. [`super::resolve`] knows the required keys, their ranges and their
//! defaults. [`UnsupportedField`] marks a key of a feature that is not built yet: the key is
//! reserved, and refused by name.
//!
//! An enumeration with choices that hold mappings is also listed in `ENUMERATIONS` of
//! [`super::merge`], unless it is in a list.
//!
//! The comments of the fields are the text of `docs/recipe.md`, which `cargo xtask docs` writes. A
//! field's comment ends with `Unit: …`, and with `Required.` or `Default: …`. A default in
//! backticks is YAML, and a test compares a recipe that writes it with one that leaves the key out.
//! Ranges of numbers are not repeated here: the test reads them off the messages of the loader.
//! `Range: …` is for ranges that no single number shows.

mod reconstruct;
mod sensor;
mod trajectory;

pub(super) use reconstruct::{BuiltinSection, CommandSection, CountSection, ReconstructSection};
pub(super) use sensor::{
    EsimSection, FrontEndSection, HotPixelsSection, LeakSection, LuminanceSection, RangeSection,
    RefractorySection, ThresholdSection, V2eSection,
};
pub(super) use trajectory::{
    BezierSection, CurveSection, EndsKey, FlowSection, GapsKey, KeyframesSection, ListSection, MeaningKey,
    MetricSection, NovelCurveSection, NovelSection, OrbitSection, OrderKey, PoseSection, RefineSection,
    RotationSection, SpeedSection, TrajectorySection,
};

use super::field::{Field, NumberLiteral, UnsupportedField};
use crate::check::Limits;
use crate::sensor::voltmeter::ConstantUnits;
use crate::source::PoseFile;
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
    pub outputs: Field<Vec<Field<OutputKey>>>,
    /// Spacing of the sharp frames. A frame in the middle of an exposure is kept in any case.
    /// Default: `{}`.
    pub sharp: Field<EverySection>,
    /// Exposure of the blurred frames. Default: `{}`.
    pub blur: Field<BlurSection>,
    /// Spacing of the depth images. Default: `{}`.
    pub depth: Field<EverySection>,
    /// Spacing of the optical flow images. Default: `{}`.
    pub flow: Field<EverySection>,
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

/// Kind of the source, with its parameters.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PresetKey {
    /// The trajectories, frame rate, renderer and sensor of the paper (GS2E, arXiv 2505.15287). The
    /// picture moves by several pixels per frame, so events between frames are inexact.
    Paper,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum SourceSection {
    /// The embedded scene, which needs no data: its own camera has 640x360 pixels.
    Procedural(Field<ProceduralSection>),
    /// A COLMAP model, binary or text.
    Colmap(Field<FolderSection>),
    /// A nerfstudio `transforms.json`.
    Nerfstudio(Field<FolderSection>),
    /// An instance of MVImgNet.
    Mvimgnet(Field<FolderSection>),
    /// A scene of DL3DV-10K.
    Dl3dv(Field<FolderSection>),
    /// A 3DGS model folder with a `cameras.json`.
    Model(Field<FolderSection>),
    /// No capture: `source: none`. The scene file, the camera, and an orbit or key poses come from
    /// the recipe.
    None,
}

/// Parameters of the embedded scene.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct ProceduralSection {
    /// Embedded scene to use. Default: `still-life`.
    pub kind: Field<KindKey>,
    /// Number of Gaussians. Default: `20000`.
    pub gaussians: Field<u64>,
    /// Number of captured views. Default: `30`.
    pub views: Field<u64>,
    /// Extent of the capture's arc; beyond about 80 the outer views see the ends of the room. Unit:
    /// degrees. Default: `20`.
    pub arc: Field<f64>,
    /// Seed of the scene and of its capture. Default: `1`.
    pub seed: Field<u64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum KindKey {
    /// Fruit, flowers, books and brass on a table.
    StillLife,
}

/// A capture on disk.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct FolderSection {
    /// Folder or file of the capture, relative to the recipe. Required.
    pub path: Field<String>,
    /// Number of views to use, picked evenly in natural order of the image names. Default: all.
    pub views: Field<u64>,
    /// Glob patterns of photos to leave out, compared with the whole name and with its last part.
    /// Default: `[]`, for `mvimgnet` `["*_bg_removed.png"]`.
    pub exclude: Field<Vec<Field<String>>>,
    /// Source of the poses; `dl3dv` only. Default: the COLMAP model if there is one.
    pub poses: Field<PoseFile>,
    /// Name of the scene in its dataset; enters `scene.json`, and no key. Default: read from the
    /// folders for `mvimgnet` and `dl3dv`.
    pub upstream_id: Field<String>,
    /// Web address of the dataset; decides which upstream terms apply. Range: a URL. Default: known
    /// for `mvimgnet` and `dl3dv`.
    pub upstream_url: Field<String>,
    /// Day of the download. Range: `YYYY-MM-DD`. Default: none.
    pub accessed: Field<String>,
    /// True if you accepted the dataset's terms; recorded in `scene.json`. Default: none.
    pub terms_accepted: Field<bool>,
}

/// Camera of the renderings. With width and height alone it keeps the source's horizontal field of
/// view.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct CameraSection {
    /// Width of the image. Unit: px. Required.
    pub width: Field<u64>,
    /// Height of the image. Unit: px. Required.
    pub height: Field<u64>,
    /// Focal length in x. Unit: px. Default: keeps the source's horizontal field of view; required
    /// without a capture, or with `fy`, `cx` or `cy`.
    pub fx: Field<f64>,
    /// Focal length in y. Unit: px. Default: that of `fx`.
    pub fy: Field<f64>,
    /// Principal point, x. Unit: px. Default: half the width.
    pub cx: Field<f64>,
    /// Principal point, y. Unit: px. Default: half the height.
    pub cy: Field<f64>,
}

/// [sampling.md](sampling.md) explains the choice between a rate and a tolerance.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct SamplingSection {
    /// Frames per second rendered for the sensor, and poses per second in the release. Unit: Hz.
    /// Default: `2400`.
    pub rate: Field<NumberLiteral>,
    /// Interpolation of brightness between two frames, in `ln(L + k2)`. Sensors `esim` and `v2e`
    /// and the law `official` take `linear` only. Default: `linear`; with a tolerance, the cheapest
    /// that meets it.
    pub between: Field<BetweenKey>,
    /// Summation of speed laws along the path. Default: `sum`; `integral` with a tolerance.
    pub law: Field<SummationKey>,
    /// Target of the RMS interpolation error of the sensor's brightness. Frames are then placed
    /// where the error needs them. For `voltmeter` with the law `exact` only. Unit: contrast
    /// thresholds. Default: none.
    pub tolerance: Field<f64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum BetweenKey {
    /// A straight line.
    Linear,
    /// A cubic through four frames.
    Catmull,
    /// A cubic through two frames and their rendered rates of change.
    Hermite,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum SummationKey {
    /// A sum over the poses, as in the paper.
    Sum,
    /// The integral of the law.
    Integral,
}

/// Conventions of the renderer.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct RenderSection {
    /// Extents, culling and stopping rules. Default: `official`; `soft` with a tolerance.
    pub rules: Field<RulesKey>,
    /// Compensation of opacity for the screen-space dilation. Default: `auto`.
    pub antialiased: Field<AntialiasedKey>,
    /// Colour behind the scene: red, green, blue. Default: `[0, 0, 0]`.
    pub background: Field<[Field<f64>; 3]>,
    /// Order of layers of nearly the same depth. Default: `depth`.
    pub order: Field<LayeringKey>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum RulesKey {
    /// The published CUDA rasteriser: 3-sigma extents, rounded out to tiles.
    Official,
    /// Every pixel at which a layer's opacity reaches 1/255.
    Exact,
    /// The conventions of gsplat.
    Gsplat,
    /// As `exact`, but layers fade in, so that opacity is a continuous function of the view.
    Soft,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum LayeringKey {
    /// By the depth of their means.
    Depth,
    /// Layers cover each other in part; with the rules `soft` only.
    Blended,
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

/// Model of the sensor, with its parameters; [sensors.md](sensors.md) describes the models.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum SensorSection {
    /// The stochastic process of DVS-Voltmeter.
    Voltmeter(Field<Box<VoltmeterSection>>),
    /// The threshold model of ESIM.
    Esim(Field<Box<EsimSection>>),
    /// The pixel model of v2e.
    V2e(Field<Box<V2eSection>>),
    /// Name of another of `sensors`: the same sensor without its noise and its labels.
    #[serde(rename = "twin_of")]
    TwinOf(Field<String>),
}

/// Brightness is `k1 ln(L + k2)`, `L` the grey from 0 to 255. A threshold divided by `k1` is a
/// contrast in `ln(L + k2)`.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct VoltmeterSection {
    /// Named set of `k1` to `k6`: `dvs346`, `dvs240` or `gs2e-si`. Default: `dvs346`.
    pub preset: Field<String>,
    /// The values `k1` to `k6` in `units`, instead of a preset. Range: `k1`, `k2` above 0; `k3`,
    /// `k6` at least 0; at most 1e12 in size. Default: the preset's.
    pub k: Field<[Field<f64>; 6]>,
    /// Units of `k`. Default: required with `k`, refused with a preset.
    pub units: Field<ConstantUnits>,
    /// Contrast thresholds, in units of the preset. Default: `{ on: 1, off: 1, spread: 0 }`.
    pub threshold: Field<ThresholdSection>,
    /// Sampler of the process. Default: `exact`.
    pub law: Field<LawKey>,
    /// Brightness that drives the drift. Default: `log`.
    pub gain: Field<GainKey>,
    /// Voltages at the first frame. Default: `zero`.
    pub initial: Field<InitialKey>,
    /// Maximum number of events of one pixel between two frames; the step fails beyond it. Default:
    /// `1000`.
    pub max_events_per_pixel_frame: Field<u64>,
    /// True if events beyond that limit are dropped and counted, instead of failing the step.
    /// Default: `false`.
    pub allow_cap: Field<bool>,
    /// Conversion of colours to the brightness that the pixels see. Default: `{}`.
    pub front_end: Field<FrontEndSection>,
    /// Pixels that fire by themselves. Default: none.
    pub hot_pixels: Field<HotPixelsSection>,
    /// True if each event has a label, signal (1) or noise (0). Default: `false`.
    pub labels: Field<bool>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum LawKey {
    /// First passages of the process, independent of the frame rate.
    Exact,
    /// The published program's sampler, whose noise depends on the frame rate; for comparisons.
    Official,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum GainKey {
    /// `k1 ln(L + k2)`.
    Log,
    /// The published program's midpoint form; for comparisons.
    Midpoint,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum InitialKey {
    /// All zero, as published; equal pixels then leak in step.
    Zero,
    /// As if every pixel had seen the first frame for a long time.
    Stationary,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum OutputKey {
    /// The event stream of each sensor.
    Events,
    /// Sharp frames, 8-bit sRGB PNG.
    Sharp,
    /// Blurred frames, 8-bit sRGB PNG.
    Blur,
    /// Depth images, float32 `.npy`.
    Depth,
    /// Optical flow images, float32 `.npy`.
    Flow,
}

/// Spacing of the pictures of `sharp`, `depth` or `flow`.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct EverySection {
    /// Number of poses from one picture to the next. Default: `1`.
    pub every: Field<u64>,
}

/// Exposures follow each other without a gap, each within the trajectory. A blurred frame is the
/// mean of its sub-frames in linear light.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct BlurSection {
    /// Number of dense frames per exposure; odd. Default: `15`.
    pub frames: Field<u64>,
    /// Sub-frames between the dense frames. Default: `auto`.
    pub subframes: Field<SubframesKey>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum SubframesKey {
    /// An odd number per dense frame, at most 33, so that the picture moves by at most 1 px between
    /// two. Motion beyond that draws a warning. It is measured at pixels with a depth.
    Auto,
    /// No sub-frames.
    Literal,
}

/// Facts for catalogues.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct AttributesSection {
    /// Size of the scene. Default: `object` for `mvimgnet`, `large` for `dl3dv`, otherwise unknown.
    pub scene_scale: Field<SceneScaleKey>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum SceneScaleKey {
    /// One thing.
    Object,
    /// A room, or a few things.
    Medium,
    /// A building, a street, a landscape.
    Large,
}

/// The program adds the terms of the source. [releases.md](releases.md) explains both.
#[derive(Debug, Default, Deserialize)]
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
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct EvidenceSection {
    /// Grantor, and extent of the grant. Required.
    pub granted_by: Field<String>,
    /// Address of the grant. Range: a URL. Required.
    pub url: Field<String>,
    /// Day of the grant. Range: `YYYY-MM-DD`. Required.
    pub date: Field<String>,
}
