//! A recipe: the source of a scene and the products made from it, parsed and validated.
//!
//! Each section becomes the settings of the crate that does the work: `gs2e-source`, `gs2e-demo`,
//! `gs2e-train`, `gs2e-scene`, `gs2e-trajectory`, `gs2e-render`, `gs2e-sampling`, `gs2e-sensor` and
//! `gs2e-check`. Units come from `gs2e-num`, image sizes from `gs2e-image`, and `gs2e-files` opens the
//! files. `gs2e-build` plans a recipe. `gs2e-release`, `gs2e-audit`, `gs2e-publish` and `gs2e-export`
//! use the recipes of a release.
//!
//! # Examples
//!
//! ```
//! use gs2e_recipe::read_recipe_text;
//!
//! let text = "version: 1
//! scene: demo/table
//! seed: 7
//! source: { procedural: { gaussians: 300 } }
//! trajectories: [{ name: base, refine: { duration: 1 } }]";
//! let recipe = read_recipe_text(text.to_owned(), "table.yaml".as_ref())?;
//! assert_eq!((recipe.scene.as_str(), recipe.seed), ("demo/table", 7));
//! // A fault has its file, line and column.
//! let faults = read_recipe_text(text.replace("7", "seven"), "table.yaml".as_ref()).err();
//! assert_eq!(faults.map(|faults| faults.listed()[0].location()).as_deref(), Some("table.yaml:3:7"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod canonical;
mod clash;
mod context;
pub mod draft;
mod drawn;
mod edits;
mod fault;
mod field;
mod find;
mod forms;
mod fragment;
mod keys;
mod load;
mod merge;
mod names;
mod nearest;
mod output;
mod preset;
mod problem;
mod reader;
mod resolve;
mod rig;
mod schema;
mod source;
mod text;
mod tree;
mod upstream;

pub use context::{
    EXPORT_FORMATS, HELD_OUT_EVERY, IncludedExport, RedistributionStatement, ReleaseInfo, SourceTerms,
    SplitPlan, SplitUnit, TakedownEffect, TakedownList, read_release, read_sources, read_takedown,
    takedown_of,
};
pub use drawn::DrawnSensors;
pub use edits::{RecipeEdit, find_edits};
pub use fault::{LISTED, RecipeFault, RecipeFaults};
pub use find::{RecipeFile, find_all, read_all, read_files, read_named, read_recipe_text};
pub use fragment::{
    ChainError, TrajectoryChain, TrajectoryFragment, draw_sensor, fragment_from_text, read_fragment,
    read_sensor, sensor_from_text,
};
pub use output::{OutputKind, PictureSpacing};
pub use rig::{MountedPath, RigCamera, StereoPartner};
pub use source::SceneSource;
pub use upstream::UpstreamOrigin;

use gs2e_check::Limits;
use gs2e_files::stat::StatSighting;
use gs2e_num::units::Hertz;
use gs2e_render::RenderChoice;
use gs2e_render::lights::SceneLights;
use gs2e_sampling::ErrorTolerance;
use gs2e_sampling::exposure::ShutterSettings;
use gs2e_scene::camera::CameraChoice;
use gs2e_scene::dynamic::SceneTime;
use gs2e_scene::objects::ObjectSettings;
use gs2e_sensor::SensorSet;
use gs2e_source::licence::UpstreamGrant;
use gs2e_source::reconstruct::TrainerCommand;
use gs2e_train::TrainingSettings;
use gs2e_trajectory::imu::ImuModel;
use gs2e_trajectory::path::CameraPath;
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::speed::SpeedChoice;
use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;

/// The JSON Schema (draft 2020-12) of a recipe, with the words of `docs/recipe.md`.
pub const JSON_SCHEMA: &str = include_str!("recipe.schema.json");

/// A scene and everything that is made of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// The files that it was read from, and its full form.
    pub meta: RecipeMeta,
    /// Scene id: the path of the scene in the release, `/`-separated.
    pub scene: String,
    /// Seed that all streams derive from.
    pub seed: u64,
    /// The source of poses.
    pub source: SceneSource,
    /// Name of the subject. Recipes with the same group show the same subject and must not be
    /// split.
    pub group: Option<String>,
    /// The source of the Gaussians. `None` for procedural sources, which bring their own, and for
    /// recipes that render nothing.
    pub reconstruct: Option<ReconstructMethod>,
    /// The camera, if it differs from the camera of the source. Of a rig, it is the first one.
    pub camera: Option<CameraChoice>,
    /// The cameras on the body that follows the trajectories; empty for one camera.
    pub rig: Vec<RigCamera>,
    /// The trajectories, in recipe order and with unique names. Each group of a novel trajectory is
    /// a trajectory, and so is the path of each camera of a rig, after that of its body.
    pub trajectories: Vec<TrajectoryRecipe>,
    /// Frame rate.
    pub rate: Hertz,
    /// Summation of the speed laws.
    pub law: SummationRule,
    /// Error between frames that the events may have, if the recipe asks for one. The frame rate
    /// then applies to poses and pictures only.
    pub tolerance: Option<ErrorTolerance>,
    /// Rendering.
    pub render: RenderChoice,
    /// The sensors. A number with a law has its median here; [`Recipe::sensors_of`] has the drawn
    /// numbers.
    pub sensors: SensorSet,
    /// Products of each trajectory.
    pub outputs: BTreeSet<OutputKind>,
    /// Number of poses per picture.
    pub every: PictureSpacing,
    /// Time from the first row of a sharp frame to the last, us, if the shutter rolls.
    pub readout_us: Option<u32>,
    /// Exposure of the blurred frames.
    pub shutter: ShutterSettings,
    /// Inertial sensor, if the recipe asks for its data.
    pub imu: Option<ImuModel>,
    /// Light that changes, if the recipe has it.
    pub lights: Option<SceneLights>,
    /// Things that move on paths of their own.
    pub objects: Vec<ObjectSettings>,
    /// Scale of the scene, if the recipe states it.
    pub scale: Option<SceneScale>,
    /// Limits and waivers.
    pub checks: Limits,
    /// The owner's part of the licence.
    pub licence: Option<LicenceChoice>,
}

impl Recipe {
    /// The time of a scene that changes by itself.
    #[must_use]
    pub fn scene_time(&self) -> Option<SceneTime> {
        match (&self.reconstruct, &self.source) {
            (Some(ReconstructMethod::Changing(_, time)), _) => Some(*time),
            (None, SceneSource::Procedural(scene)) => scene.fountain.map(|fountain| fountain.time),
            _ => None,
        }
    }

    /// Returns true if things move on paths of their own, or the scene changes with time.
    #[must_use]
    pub fn moves_by_itself(&self) -> bool {
        self.scene_time().is_some() || !self.objects.is_empty()
    }

    /// The sensors of a trajectory, with the numbers that were drawn for it.
    #[must_use]
    pub fn sensors_of(&self, trajectory: &str) -> &SensorSet {
        let named = self.trajectories.iter().find(|own| own.name == trajectory);
        let own = self.mounted(trajectory).and_then(|mounted| mounted.camera.sensors.as_ref());
        let drawn = named.and_then(|own| own.drawn.as_ref()).map(|drawn| &drawn.sensors);
        drawn.or(own).unwrap_or(&self.sensors)
    }
}

/// Facts about a recipe that is read: they enter no key.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecipeMeta {
    /// The recipe file and its defaults file.
    pub file: RecipeFile,
    /// Both files as they were before they were read.
    pub sightings: Vec<(PathBuf, StatSighting)>,
    /// Places where the recipe names things that may turn out to be missing.
    pub named_at: NamedAt,
    /// Sections of the recipe's own file for outputs that it does not ask for.
    pub unused: Vec<String>,
    /// The merged recipe in full with all defaults, as `scene.json` shows it. Paths are as written.
    pub merged: serde_json::Value,
}

/// Places in the recipe's files, for error messages. They enter no key.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NamedAt {
    /// The scene id.
    pub scene: Option<RecipePosition>,
    /// The source.
    pub source: Option<RecipePosition>,
    /// The reconstruction.
    pub reconstruct: Option<RecipePosition>,
}

/// A place in a recipe file; displayed as `file:line:column`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipePosition {
    /// The file, as the user named it.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1, in characters.
    pub column: usize,
}

impl fmt::Display for RecipePosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}", self.file, self.line, self.column)
    }
}

/// The source of the Gaussians.
#[derive(Debug, Clone, PartialEq)]
pub enum ReconstructMethod {
    /// A scene file.
    Given(PathBuf),
    /// A scene that changes with time: a file, or a folder with a sequence of files.
    Changing(PathBuf, SceneTime),
    /// The newest scene in the source's own 3DGS model folder.
    Newest(PathBuf),
    /// A program that trains the scene on the source's photos.
    Command(Box<TrainerCommand>),
    /// Training on the source's photos. The rendering is that of the recipe.
    Builtin(TrainingSettings),
}

/// One trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryRecipe {
    /// Name of the trajectory, which is also its folder in the release: `base`, or `base/left` for a camera
    /// of a rig.
    pub name: String,
    /// Name of the trajectory in the recipe. All groups of a novel trajectory share it, and all cameras of a
    /// rig.
    pub written: String,
    /// The path of the camera.
    pub path: CameraPath,
    /// The trajectory from which the key poses of a novel trajectory are drawn.
    pub base: Option<String>,
    /// The camera of a rig whose path it is, on a body that follows `path`.
    pub mounted: Option<Box<MountedPath>>,
    /// Speed along the path.
    pub speed: SpeedChoice,
    /// The sensors of this trajectory, if numbers of them are drawn.
    pub drawn: Option<DrawnSensors>,
}

impl TrajectoryRecipe {
    /// A trajectory with the name that the recipe writes.
    fn new(written: String, path: CameraPath, speed: SpeedChoice) -> Self {
        Self { name: written.clone(), written, path, base: None, mounted: None, speed, drawn: None }
    }
}

/// Scale of a scene, after the axes of the paper's appendix D.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneScale {
    /// One thing.
    Object,
    /// A room, or a few things.
    Medium,
    /// A building, a street, a landscape.
    Large,
}

impl SceneScale {
    /// Name of the scale in recipes and in `scene.json`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Object => "object",
            Self::Medium => "medium",
            Self::Large => "large",
        }
    }
}

/// The owner's part of the licence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LicenceChoice {
    /// SPDX expression.
    pub expression: String,
    /// Holder of the rights.
    pub holder: String,
    /// Terms granted by the upstream, with the evidence.
    pub grant: Option<UpstreamGrant>,
}
