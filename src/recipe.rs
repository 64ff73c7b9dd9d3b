//! A recipe: what a scene is made from and what is made of it, parsed and valid.

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
mod problem;
mod reader;
mod resolve;
mod schema;
mod text;
mod tree;

pub use beside::{
    By, Redistribution, ReleaseInfo, SourceTerms, Splits, Takedown, TakenDown, read_release, read_sources,
    read_takedown, takedown_of,
};
pub use edits::{Edit, edits};
pub use fault::{Fault, Faults, LISTED};
pub use find::{RecipeFile, find_all, read_all, read_files};
pub use fragment::{Fragment, read_fragment, read_sensor};

use crate::camera::CameraChoice;
use crate::check::Limits;
use crate::licence::{Grant, ledger};
use crate::reconstruct::Command;
use crate::render::RenderChoice;
use crate::sampling::Tolerance;
use crate::sampling::exposure::Shutter;
use crate::scene::procedural::StillLife;
use crate::sensor::Sensors;
use crate::source::Captured;
use crate::source::kind::Kind;
use crate::speed::Speed;
use crate::store::stat_cache::Sighting;
use crate::trajectory::path::Path;
use crate::trajectory::sample::Summation;
use crate::units::Hertz;
use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;

/// One scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// The file it was read from, and the one under it.
    pub file: RecipeFile,
    /// That file and the defaults under it, as they were before they were read.
    pub seen: Vec<(PathBuf, Sighting)>,
    /// Where it names what may turn out to be missing.
    pub named_at: NamedAt,
    /// Scene id: the path of the scene in the release, `/`-separated.
    pub scene: String,
    /// Seed that all streams derive from.
    pub seed: u64,
    /// Where poses come from.
    pub source: Source,
    /// What it shows, where other recipes show the same and no split may part them.
    pub group: Option<String>,
    /// Where the Gaussians come from; `None` for procedural sources, which bring their own, and where nothing is rendered.
    pub reconstruct: Option<Reconstruct>,
    /// The camera, where it differs from the source's own.
    pub camera: Option<CameraChoice>,
    /// The trajectories, in recipe order, names unique; each group of a novel one is a trajectory.
    pub trajectories: Vec<TrajectoryRecipe>,
    /// Frame rate.
    pub rate: Hertz,
    /// How speed laws are summed.
    pub law: Summation,
    /// The error between frames that the events may have, where the recipe asks for one: the frame rate is then that of poses
    /// and pictures alone.
    pub tolerance: Option<Tolerance>,
    /// Rendering.
    pub render: RenderChoice,
    /// The sensors.
    pub sensors: Sensors,
    /// What is made for each trajectory.
    pub outputs: BTreeSet<Output>,
    /// Every how many poses there is a picture.
    pub every: Spacing,
    /// How blurred frames are exposed.
    pub shutter: Shutter,
    /// How large the scene is, where the recipe says.
    pub scale: Option<SceneScale>,
    /// Limits and waivers.
    pub checks: Limits,
    /// The owner's part of the licence.
    pub licence: Option<LicenceChoice>,
    /// The merged recipe in full, defaults filled, as `scene.json` shows it. Paths are as written.
    pub merged: serde_json::Value,
}

/// Places in the recipe's files, for messages about what is named there; they enter no key.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NamedAt {
    /// The scene id.
    pub scene: Option<Position>,
    /// The source.
    pub source: Option<Position>,
    /// The reconstruction.
    pub reconstruct: Option<Position>,
}

/// A place in a file of recipes; it shows as `file:line:column`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Position {
    /// The file, as the user named it.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1, in characters.
    pub column: usize,
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}", self.file, self.line, self.column)
    }
}

/// Where poses come from. Paths are resolved against the recipe's folder.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// The embedded scene.
    Procedural(StillLife),
    /// A capture on disk, and what the recipe says of where it is from.
    Captured(Captured, Upstream),
    /// Nowhere: trajectories are written in the recipe, over a scene file.
    None,
}

impl Source {
    /// Its kind, as recipes and releases name it.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Procedural(_) => "procedural",
            Self::Captured(captured, _) => captured.kind.name(),
            Self::None => "none",
        }
    }

    /// What its upstream is, by the kind of source, and what that calls it.
    #[must_use]
    pub fn origin(&self) -> (&'static str, Option<&str>) {
        match self {
            Self::Captured(captured, upstream) => {
                let kind = ledger::origin(captured.kind.name(), upstream.url.as_deref());
                (kind, upstream.id.as_deref())
            }
            Self::Procedural(_) | Self::None => (self.kind(), None),
        }
    }

    /// Whether its views were photographed.
    #[must_use]
    pub fn has_photos(&self) -> bool {
        matches!(self, Self::Captured(..))
    }

    /// Whether it has views, and so a camera.
    #[must_use]
    pub fn has_views(&self) -> bool {
        !matches!(self, Self::None)
    }
}

/// Where a capture was taken from; what is not known is `None`. It enters no key.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Upstream {
    /// What the dataset calls it.
    pub id: Option<String>,
    /// Where the dataset is.
    pub url: Option<String>,
    /// The date of the download, `YYYY-MM-DD`.
    pub accessed: Option<String>,
    /// Whether its terms were accepted.
    pub terms_accepted: Option<bool>,
}

impl Upstream {
    /// What the layout of a dataset says by itself.
    #[must_use]
    pub fn of(captured: &Captured) -> Self {
        let url = match captured.kind {
            Kind::Mvimgnet => "https://github.com/GAP-LAB-CUHK-SZ/MVImgNet",
            Kind::Dl3dv => "https://github.com/DL3DV-10K/Dataset",
            Kind::Colmap | Kind::Nerfstudio | Kind::Model => return Self::default(),
        };
        Self { id: captured.upstream_id(), url: Some(url.to_owned()), ..Self::default() }
    }
}

/// Where the Gaussians come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Reconstruct {
    /// A scene file.
    Given(PathBuf),
    /// The newest scene of the source's own 3DGS model folder.
    Newest(PathBuf),
    /// A program that trains it on the source's photos.
    Command(Box<Command>),
}

/// One trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryRecipe {
    /// Its name, and its folder in the release.
    pub name: String,
    /// Its name as the recipe has it, which all groups of a novel trajectory share.
    pub written: String,
    /// How its path is made.
    pub path: Path,
    /// The trajectory that the key poses of a novel one are drawn from.
    pub base: Option<String>,
    /// How fast it is followed.
    pub speed: Speed,
}

/// Something made for each trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Output {
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

/// Every how many poses there is a picture of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Spacing {
    /// A sharp frame; those in the middle of an exposure are kept beside.
    pub sharp: u32,
    /// A depth image.
    pub depth: u32,
    /// An image of optical flow.
    pub flow: u32,
}

/// How large a scene is, by the axes of the paper's appendix D.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneScale {
    /// One thing.
    Object,
    /// A room, or a few things.
    Medium,
    /// A building, a street, a landscape.
    Large,
}

impl SceneScale {
    /// Its name in recipes and in `scene.json`.
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
    /// Who holds the rights.
    pub holder: String,
    /// What the upstream granted, with the evidence.
    pub grant: Option<Grant>,
}
