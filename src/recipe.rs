//! A recipe: the source of a scene and the products made from it, parsed and validated.

mod beside;
mod canonical;
mod clash;
pub mod draft;
mod edits;
mod fault;
mod field;
mod find;
mod forms;
mod fragment;
mod load;
mod merge;
mod names;
mod nearest;
mod preset;
mod problem;
mod reader;
mod resolve;
mod schema;
mod text;
mod tree;

pub use beside::{
    RedistributionStatement, ReleaseInfo, SourceTerms, SplitPlan, SplitUnit, TakedownList, TakenDown,
    read_release, read_sources, read_takedown, takedown_of,
};
pub use edits::{RecipeEdit, find_edits};
pub use fault::{LISTED, RecipeFault, RecipeFaults};
pub use find::{RecipeFile, find_all, read_all, read_files};
pub use fragment::{TrajectoryFragment, read_fragment, read_sensor};

use crate::camera::CameraChoice;
use crate::check::Limits;
use crate::licence::{UpstreamGrant, ledger};
use crate::reconstruct::TrainerCommand;
use crate::render::RenderChoice;
use crate::sampling::ErrorTolerance;
use crate::sampling::exposure::ShutterSettings;
use crate::scene::procedural::StillLife;
use crate::sensor::SensorSet;
use crate::source::DiskCapture;
use crate::source::kind::CaptureKind;
use crate::speed::SpeedChoice;
use crate::store::stat_cache::StatSighting;
use crate::training::TrainingSettings;
use crate::trajectory::path::CameraPath;
use crate::trajectory::sample::SummationRule;
use crate::units::Hertz;
use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;

/// A scene and everything that is made of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// The recipe file and its defaults file.
    pub file: RecipeFile,
    /// Both files as they were before they were read.
    pub seen: Vec<(PathBuf, StatSighting)>,
    /// Places where the recipe names things that may turn out to be missing.
    pub named_at: NamedAt,
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
    /// The camera, if it differs from the camera of the source.
    pub camera: Option<CameraChoice>,
    /// The trajectories, in recipe order and with unique names. Each group of a novel trajectory is
    /// a trajectory.
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
    /// The sensors.
    pub sensors: SensorSet,
    /// Products of each trajectory.
    pub outputs: BTreeSet<OutputKind>,
    /// Number of poses per picture.
    pub every: PictureSpacing,
    /// Exposure of the blurred frames.
    pub shutter: ShutterSettings,
    /// Scale of the scene, if the recipe states it.
    pub scale: Option<SceneScale>,
    /// Limits and waivers.
    pub checks: Limits,
    /// The owner's part of the licence.
    pub licence: Option<LicenceChoice>,
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

/// The source of poses. Paths are resolved against the recipe's folder.
#[derive(Debug, Clone, PartialEq)]
pub enum SceneSource {
    /// The built-in procedural scene.
    Procedural(StillLife),
    /// A capture on disk, with the recipe's statements about its origin.
    Captured(DiskCapture, UpstreamOrigin),
    /// No source: the recipe itself contains the trajectories, and the Gaussians come from a scene
    /// file.
    None,
}

impl SceneSource {
    /// Kind of the source, as recipes and releases name it.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Procedural(_) => "procedural",
            Self::Captured(captured, _) => captured.kind.name(),
            Self::None => "none",
        }
    }

    /// The kind of the source, and the id that the upstream gives to this capture.
    #[must_use]
    pub fn origin(&self) -> (&'static str, Option<&str>) {
        match self {
            Self::Captured(captured, upstream) => {
                let kind = ledger::find_origin(captured.kind.name(), upstream.url.as_deref());
                (kind, upstream.id.as_deref())
            }
            Self::Procedural(_) | Self::None => (self.kind(), None),
        }
    }

    /// Returns true if the views of the source are photographs.
    #[must_use]
    pub fn has_photos(&self) -> bool {
        matches!(self, Self::Captured(..))
    }

    /// Returns true if the source has views, and therefore a camera.
    #[must_use]
    pub fn has_views(&self) -> bool {
        !matches!(self, Self::None)
    }
}

/// Origin of a capture; unknown fields are `None`. It enters no key.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct UpstreamOrigin {
    /// Id of the capture in the dataset.
    pub id: Option<String>,
    /// Address of the dataset.
    pub url: Option<String>,
    /// The date of the download, `YYYY-MM-DD`.
    pub accessed: Option<String>,
    /// True if the terms of the dataset were accepted.
    pub terms_accepted: Option<bool>,
}

impl UpstreamOrigin {
    /// Origin of a capture as far as the layout of its dataset reveals it.
    #[must_use]
    pub fn from_capture(captured: &DiskCapture) -> Self {
        let url = match captured.kind {
            CaptureKind::Mvimgnet => "https://github.com/GAP-LAB-CUHK-SZ/MVImgNet",
            CaptureKind::Dl3dv => "https://github.com/DL3DV-10K/Dataset",
            CaptureKind::Colmap | CaptureKind::Nerfstudio | CaptureKind::Model => return Self::default(),
        };
        Self { id: captured.upstream_id(), url: Some(url.to_owned()), ..Self::default() }
    }
}

/// The source of the Gaussians.
#[derive(Debug, Clone, PartialEq)]
pub enum ReconstructMethod {
    /// A scene file.
    Given(PathBuf),
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
    /// Name of the trajectory, which is also its folder in the release.
    pub name: String,
    /// Name of the trajectory in the recipe. All groups of a novel trajectory share it.
    pub written: String,
    /// The path of the camera.
    pub path: CameraPath,
    /// The trajectory from which the key poses of a novel trajectory are drawn.
    pub base: Option<String>,
    /// Speed along the path.
    pub speed: SpeedChoice,
}

/// A product of each trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum OutputKind {
    /// Event stream.
    Events,
    /// Sharp frames.
    Sharp,
    /// Blurred frames.
    Blur,
    /// Depth images.
    Depth,
    /// Images of optical flow.
    Flow,
}

/// Number of poses per picture, for each kind of picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureSpacing {
    /// Poses per sharp frame. Frames in the middle of an exposure are kept in addition.
    pub sharp: u32,
    /// Poses per depth image.
    pub depth: u32,
    /// Poses per image of optical flow.
    pub flow: u32,
}

/// Scale of a scene, after the axes of the paper's appendix D.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneScale {
    /// A single object.
    Object,
    /// A room, or a few objects.
    Medium,
    /// A building, a street or a landscape.
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
