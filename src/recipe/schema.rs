//! The recipe as it is written, version 1: every key, those of features to come included.
//!
//! Nothing here is checked beyond its kind; [`super::resolve`] knows what is required, the ranges and the defaults.
//! [`Later`] marks a key whose feature is not built yet: it has its place, and is refused by name.
//!
//! An enumeration whose choices hold mappings stands in `ENUMERATIONS` of [`super::merge`] too, unless it is in a list.

mod reconstruct;
mod sensor;
mod trajectory;

pub(super) use reconstruct::{Command, Count, Reconstruct};
pub(super) use sensor::{Esim, FrontEnd, HotPixels, Leak, Luminance, Range, Refractory, Threshold, V2e};
pub(super) use trajectory::{
    Bezier, Curve, Ends, Flow, Gaps, Keyframes, List, Meaning, Metric, Novel, NovelCurve, Orbit, Order, Pose,
    Refine, Rotation, Speed, Trajectory,
};

use super::field::{Field, Later, Literal};
use crate::check::Limits;
use crate::sensor::voltmeter::Units;
use crate::source::PoseFile;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The whole file.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Recipe {
    /// Always 1; required.
    pub version: Field<u64>,
    /// Scene id; required.
    pub scene: Field<String>,
    /// Seed of every stream; default 0.
    pub seed: Field<u64>,
    /// Where poses come from; required.
    pub source: Field<Source>,
    /// What it shows, where other recipes show the same.
    pub group: Field<String>,
    /// Where the Gaussians come from.
    pub reconstruct: Field<Reconstruct>,
    /// Default: the source's own camera.
    pub camera: Field<Camera>,
    /// At least one.
    pub trajectories: Field<Vec<Field<Trajectory>>>,
    /// Frames in time.
    pub sampling: Field<Sampling>,
    /// Rendering.
    pub render: Field<Render>,
    /// The one sensor; default: `voltmeter` with the preset `dvs346`.
    pub sensor: Field<Sensor>,
    /// Several sensors fed from one rendering, by name.
    pub sensors: Field<BTreeMap<String, Field<Sensor>>>,
    /// Default: events and sharp.
    pub outputs: Field<Vec<Field<Output>>>,
    /// Sharp frames.
    pub sharp: Field<Every>,
    /// Blurred frames.
    pub blur: Field<Blur>,
    /// Depth images.
    pub depth: Field<Every>,
    /// Images of optical flow.
    pub flow: Field<Every>,
    /// Limits that differ from the defaults, and waivers.
    pub checks: Field<Limits>,
    /// The owner's part of the licence.
    pub licence: Field<Licence>,
    /// What a release holds beside its products: `include`.
    pub release: Field<Later>,
    /// What the tool cannot know, for catalogues.
    pub attributes: Field<Attributes>,
}

/// Where poses come from.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Source {
    Procedural(Field<Procedural>),
    Colmap(Field<Folder>),
    Nerfstudio(Field<Folder>),
    Mvimgnet(Field<Folder>),
    Dl3dv(Field<Folder>),
    Model(Field<Folder>),
    /// A scene file without a capture: `source: none`.
    None,
}

/// The embedded scene.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Procedural {
    /// Which; there is one.
    pub kind: Field<Kind>,
    pub gaussians: Field<u64>,
    pub views: Field<u64>,
    /// Degrees.
    pub arc: Field<f64>,
    pub seed: Field<u64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Kind {
    StillLife,
}

/// A captured dataset.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Folder {
    /// Required.
    pub path: Field<String>,
    /// How many views are used; default: all.
    pub views: Field<u64>,
    /// Patterns of the names of photos that are left out.
    pub exclude: Field<Vec<Field<String>>>,
    /// Of DL3DV alone: the COLMAP model's poses or those of `transforms.json`.
    pub poses: Field<PoseFile>,
    /// What the dataset calls the scene.
    pub upstream_id: Field<String>,
    /// Where it was downloaded.
    pub upstream_url: Field<String>,
    /// When: `YYYY-MM-DD`.
    pub accessed: Field<String>,
    /// Whether its terms were accepted.
    pub terms_accepted: Field<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Camera {
    /// Required.
    pub width: Field<u64>,
    /// Required.
    pub height: Field<u64>,
    /// Default: what keeps the source's horizontal field of view; required without a source.
    pub fx: Field<f64>,
    /// Default `fx`.
    pub fy: Field<f64>,
    /// Default: the middle.
    pub cx: Field<f64>,
    /// Default: the middle.
    pub cy: Field<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Sampling {
    pub rate: Field<Literal>,
    pub between: Field<Between>,
    /// How speed laws are summed; default `sum`, as the paper does.
    pub law: Field<Summation>,
    /// RMS of the error between frames, in thresholds: frames are then where they are needed, not at the rate.
    pub tolerance: Field<f64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Between {
    Linear,
    Catmull,
    Hermite,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Summation {
    Sum,
    Integral,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Render {
    pub rules: Field<Rules>,
    pub antialiased: Field<Antialiased>,
    pub background: Field<[Field<f64>; 3]>,
    /// Of the rules `soft` alone.
    pub order: Field<Layering>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Rules {
    Official,
    Exact,
    Gsplat,
    Soft,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Layering {
    Depth,
    Blended,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) enum Antialiased {
    #[serde(rename = "auto")]
    Auto,
    #[serde(rename = "true")]
    On,
    #[serde(rename = "false")]
    Off,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Sensor {
    Voltmeter(Field<Box<Voltmeter>>),
    Esim(Field<Box<Esim>>),
    V2e(Field<Box<V2e>>),
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Voltmeter {
    /// A named set of `k`; default dvs346.
    pub preset: Field<String>,
    /// In place of a preset: k1 to k6, in `units`.
    pub k: Field<[Field<f64>; 6]>,
    pub units: Field<Units>,
    pub threshold: Field<Threshold>,
    pub law: Field<Law>,
    pub gain: Field<Gain>,
    pub initial: Field<Initial>,
    pub max_events_per_pixel_frame: Field<u64>,
    /// Whether events beyond that are left out and counted.
    pub allow_cap: Field<bool>,
    pub front_end: Field<FrontEnd>,
    pub hot_pixels: Field<HotPixels>,
    /// Whether each event is labelled as signal or noise.
    pub labels: Field<bool>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Law {
    Exact,
    Official,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Gain {
    Log,
    Midpoint,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Initial {
    Zero,
    Stationary,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Output {
    Events,
    Sharp,
    Blur,
    Depth,
    Flow,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Every {
    /// Default: 1, each pose.
    pub every: Field<u64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Blur {
    /// Of an exposure, odd. Default: 15.
    pub frames: Field<u64>,
    /// Default: `auto`.
    pub subframes: Field<Subframes>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Subframes {
    Auto,
    Literal,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Attributes {
    /// Default: what is known of the source.
    pub scene_scale: Field<SceneScale>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum SceneScale {
    Object,
    Medium,
    Large,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Licence {
    /// SPDX; required.
    pub expression: Field<String>,
    /// Required.
    pub holder: Field<String>,
    /// SPDX: what the upstream granted instead of what it states for everybody.
    pub upstream: Field<String>,
    /// Of that; required with it.
    pub evidence: Field<Evidence>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Evidence {
    /// Who granted it, and what. Required.
    pub granted_by: Field<String>,
    /// Where that can be read. Required.
    pub url: Field<String>,
    /// `YYYY-MM-DD`. Required.
    pub date: Field<String>,
}
