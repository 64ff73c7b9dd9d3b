//! Source of the Gaussians, as written.

use crate::field::{Field, UnsupportedField};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Source of the Gaussians, with its parameters.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ReconstructSection {
    /// A trained scene file.
    Given(Field<GivenSection>),
    /// Training on the photos, inside the program. See [training.md](training.md).
    Builtin(Field<BuiltinSection>),
    /// A program that trains the scene; runs only with `--allow-commands`. See
    /// [training.md](training.md#training-with-another-program).
    Command(Field<Box<CommandSection>>),
}

/// A scene file: `.ply`, compressed `.ply`, `.splat`, `.spz` or `.sog`; with `time`, one that changes with
/// time.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct GivenSection {
    /// Path of the scene file, relative to the recipe. Required.
    pub path: Field<String>,
    /// Time of a scene that changes by itself: a file with tracks, or a folder with a sequence of scene
    /// files. See [scene.md](scene.md#scenes-that-change-with-time). Default: none, a scene at rest.
    pub time: Field<TimeSection>,
    /// True if the scene was trained on undistorted photos. Default: none.
    pub undistorted: Field<UnsupportedField>,
}

/// The time of a scene that changes by itself, at each time of a trajectory.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct TimeSection {
    /// Moment of the scene at the first pose. Unit: s. Default: `0`.
    pub start: Field<f64>,
    /// Seconds of the scene in a second of the trajectory. Default: `1`.
    pub speed: Field<f64>,
    /// Time from the beginning to the end of a scene with tracks. Unit: s. Default: `1`.
    pub duration: Field<f64>,
    /// Frames of a sequence per second, instead of `duration`. Unit: Hz. Default: none.
    pub rate: Field<f64>,
}

/// The training fits what `render` renders: its rules, antialiasing and background.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct BuiltinSection {
    /// Number of Gaussians, at most. Default: `200000`.
    pub gaussians: Field<u64>,
    /// Number of iterations; each shows one photo. Default: `7000`.
    pub iterations: Field<u64>,
    /// Width of the photos; wider ones are scaled down to it. Unit: px. Default: `640`.
    pub resolution: Field<u64>,
    /// Seed of all draws. Default: the recipe's `seed`.
    pub seed: Field<u64>,
    /// Spacing of the photos that are held out from training: every n-th view, the first included;
    /// 0 holds out none. Default: `8`.
    pub hold_out: Field<u64>,
    /// Reasons to end before the last iteration. Default: `{}`.
    pub until: Field<UntilSection>,
}

/// The first reason that holds ends the training.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct UntilSection {
    /// Mean PSNR of the held-out photos that is enough; compared at each of about twenty reports.
    /// Unit: dB. Default: none.
    pub psnr: Field<f64>,
    /// Time that is enough. It enters the key, but a step that it ends may have other bytes on
    /// another machine. Unit: minutes. Default: none.
    pub minutes: Field<f64>,
}

/// Arguments, `probe` and `program` may contain names in braces;
/// [training.md](training.md#training-with-another-program) lists the names.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct CommandSection {
    /// Name of the program, searched for in `PATH`, or `"{name}"` of `files`. Required.
    pub program: Field<String>,
    /// Arguments of the program; no shell reads them. Default: `[]`.
    pub arguments: Field<Vec<Field<String>>>,
    /// Version of the program. It is part of the key, so another version trains again. Required.
    pub version: Field<String>,
    /// Arguments that make the program print its version; the output must contain `version`.
    /// Default: none.
    pub probe: Field<Vec<Field<String>>>,
    /// Terms of the program. Range: SPDX expression. Required.
    pub licence: Field<String>,
    /// Scene file that the program writes, below `{out}`. Default: the newest
    /// `point_cloud/iteration_N/point_cloud.ply`.
    pub scene: Field<String>,
    /// Training iterations; fills `{iterations}` and is recorded in `scene.json`. Default: none.
    pub iterations: Field<u64>,
    /// Environment variables, in addition to those of `gs2e` itself. Default: `{}`.
    pub environment: Field<BTreeMap<String, Field<String>>>,
    /// Files that arguments refer to by name; their content is part of the key. Default: `{}`.
    pub files: Field<BTreeMap<String, Field<String>>>,
    /// Spacing of the views that are held out from training: every n-th view, the first included.
    /// Default: no view.
    pub hold_out: Field<u64>,
    /// Number of Gaussians that the result must have. Default: `{}`.
    pub gaussians: Field<CountSection>,
    /// Minimum mean PSNR over every 8th view; a result below it is refused. The default is the PSNR
    /// of plain grey against uniformly distributed greys. Unit: dB. Default: `10.79`.
    pub min_psnr: Field<f64>,
}

/// Bounds, both included.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct CountSection {
    /// Minimum number of Gaussians. Default: no bound.
    pub min: Field<u64>,
    /// Maximum number of Gaussians. Default: no bound.
    pub max: Field<u64>,
}
