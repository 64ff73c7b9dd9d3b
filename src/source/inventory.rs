//! Inventory of a dataset tree: the folders that are scenes of a kind, and the reasons why some
//! cannot be used.

use super::kind::CaptureKind;
use super::photo::{self, PhotoScrutiny};
use super::photos;
use super::{Capture, DiskCapture, SourceError, SourceWarning, ViewSelection, natural};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use walkdir::WalkDir;

/// Maximum depth of scenes below the root of the tree. DL3DV groups scenes in folders of a
/// thousand; private captures have their own folder structure.
const DEEPEST: usize = 3;

/// Requirements on a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AcceptanceRules {
    /// Minimum of the shorter side of every view, px.
    pub min_side: u32,
    /// Minimum number of registered views.
    pub min_views: usize,
    /// The views in use.
    pub selection: ViewSelection,
    /// The classes to search, if scenes have classes; all classes if empty.
    pub classes: BTreeSet<String>,
}

/// A scene of the tree.
#[derive(Debug)]
pub struct InventoryScene {
    /// Id within the dataset: `class/instance`, 64 hexadecimal digits, or the path in the tree.
    pub name: String,
    /// Its folder.
    pub path: PathBuf,
    /// Warnings for the user, or the reason why the scene cannot be used.
    pub verdict: Result<Vec<SourceWarning>, RejectionReason>,
}

/// The reason why a scene cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RejectionReason {
    /// The scene cannot be read.
    #[error(transparent)]
    Unreadable(#[from] SourceError),
    /// The scene has too few views.
    #[error("{found} registered views, wanted at least {wanted}")]
    FewViews {
        /// Number of views.
        found: usize,
        /// Required number of views.
        wanted: usize,
    },
    /// The scene has too few photos.
    #[error("{found} photos, wanted at least {wanted}")]
    FewPhotos {
        /// Number of photos.
        found: usize,
        /// Required number of photos.
        wanted: usize,
    },
    /// A picture is too small.
    #[error("`{image}` is {found} px on its shorter side, wanted at least {wanted}")]
    Small {
        /// The first view with this fault.
        image: String,
        /// Its shorter side, px.
        found: u32,
        /// The required length, px.
        wanted: u32,
    },
    /// The folder's name does not follow the dataset's naming.
    #[error("the folder's name does not follow the dataset's naming: wanted {0}")]
    Name(&'static str),
    /// The dataset contains the scene twice.
    #[error("the scene is also in {}", .0.display())]
    Twice(PathBuf),
}

impl RejectionReason {
    /// Stable name of the reason, for programs.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Unreadable(SourceError::Absent { .. }) => "incomplete",
            Self::Unreadable(_) => "unreadable",
            Self::FewViews { .. } | Self::FewPhotos { .. } => "few-views",
            Self::Small { .. } => "small",
            Self::Name(_) => "name",
            Self::Twice(_) => "twice",
        }
    }
}

/// Lists the scenes of this kind in the tree at `root`, sorted by name in natural order.
///
/// # Errors
/// The tree cannot be listed.
pub fn take_inventory(
    kind: CaptureKind,
    root: &Path,
    rules: &AcceptanceRules,
) -> Result<Vec<InventoryScene>, SourceError> {
    let mut found = kind.as_layout().scenes(root, &rules.classes)?;
    // Scenes of the same name sort by path, so that the same one is kept on every machine.
    found.sort_by(|a, b| natural::compare_names(&a.name, &b.name).then_with(|| a.path.cmp(&b.path)));
    let mut entries: Vec<InventoryScene> =
        found.into_par_iter().map(|found| found.judged(kind, rules)).collect();
    for i in 1..entries.len() {
        if entries[i].name == entries[i - 1].name {
            entries[i].verdict = Err(RejectionReason::Twice(entries[i - 1].path.clone()));
        }
    }
    Ok(entries)
}

/// A folder that may be a scene.
pub(super) struct ScenePath {
    /// Id within the dataset.
    pub(super) name: String,
    pub(super) path: PathBuf,
    /// The fault of its name, if there is one.
    pub(super) misnamed: Option<RejectionReason>,
}

impl ScenePath {
    fn judged(self, kind: CaptureKind, rules: &AcceptanceRules) -> InventoryScene {
        let Self { name, path, misnamed } = self;
        let selection = rules.selection.clone();
        let captured = DiskCapture { selection, ..DiskCapture::all_views(kind, path.clone()) };
        let verdict = match misnamed {
            Some(rejection) => Err(rejection),
            None if kind.needs_poses() => rules.hold_photos(&captured).map(|()| Vec::new()),
            None => captured.glance().map_err(RejectionReason::from).and_then(|(capture, warnings)| {
                rules.hold(&capture)?;
                Ok(warnings)
            }),
        };
        InventoryScene { name, path, verdict }
    }
}

impl AcceptanceRules {
    /// Checks photos that have no poses yet against the rules: each of them may become a view.
    fn hold_photos(&self, captured: &DiskCapture) -> Result<(), RejectionReason> {
        let mut files = captured.files()?;
        let is_given = captured.is_given();
        files.retain(|(name, _)| is_given(photos::own_name(name)));
        let wanted = self.min_views.max(photos::MIN_PHOTOS);
        if files.len() < wanted {
            return Err(RejectionReason::FewPhotos { found: files.len(), wanted });
        }
        for (name, path) in files {
            let size = photo::read_photo(&path, PhotoScrutiny::Sizes)?.size;
            let side = size.map(|size| size.width.min(size.height));
            if let Some(found) = side.filter(|side| *side < self.min_side) {
                return Err(RejectionReason::Small { image: name, found, wanted: self.min_side });
            }
        }
        Ok(())
    }

    /// Checks a capture against the rules.
    fn hold(&self, capture: &Capture) -> Result<(), RejectionReason> {
        // Views that the selection dropped are registered too.
        let others =
            capture.unused.iter().filter(|photo| photo.why == super::UnusedReason::NotPicked).count();
        let found = capture.views.len() + others;
        if found < self.min_views {
            return Err(RejectionReason::FewViews { found, wanted: self.min_views });
        }
        let side = |view: &super::CapturedView| view.camera.size.width.min(view.camera.size.height);
        match capture.views.iter().find(|view| side(view) < self.min_side) {
            None => Ok(()),
            Some(view) => Err(RejectionReason::Small {
                image: view.name.clone(),
                found: side(view),
                wanted: self.min_side,
            }),
        }
    }
}

/// Finds folders that contain a capture, without descending into them. The root itself may be one.
pub(super) fn capture_folders(
    root: &Path,
    is_scene: &dyn Fn(&Path) -> bool,
) -> Result<Vec<ScenePath>, SourceError> {
    // The walk below skips folders that cannot be read, but the root itself must be readable.
    std::fs::read_dir(root).map_err(SourceError::io_error(root))?;
    let mut found = Vec::new();
    let mut walk =
        WalkDir::new(root).max_depth(DEEPEST).same_file_system(true).sort_by_file_name().into_iter();
    while let Some(entry) = walk.next() {
        let Some(entry) = entry.ok().filter(|entry| entry.file_type().is_dir()) else { continue };
        if !is_scene(entry.path()) {
            continue;
        }
        // A capture may contain folders that look like captures of their own.
        walk.skip_current_dir();
        let below = entry.path().strip_prefix(root).unwrap_or(Path::new(""));
        // A root may be given as `.` or `..`, which is no name.
        let own = root.canonicalize().ok().and_then(|root| root.file_name().map(PathBuf::from));
        let named = if below.as_os_str().is_empty() { own.unwrap_or_default() } else { below.to_owned() };
        let parts: Vec<_> = named.iter().map(|part| part.to_string_lossy()).collect();
        found.push(ScenePath { name: parts.join("/"), path: entry.into_path(), misnamed: None });
    }
    Ok(found)
}

/// Lists the subfolders of a folder by name. Names that are not UTF-8 are skipped; no dataset has
/// them.
pub(super) fn list_subfolders(dir: &Path) -> Result<Vec<(String, PathBuf)>, SourceError> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(SourceError::io_error(dir))? {
        let path = entry.map_err(SourceError::io_error(dir))?.path();
        let name = path.file_name().and_then(|name| name.to_str()).map(str::to_owned);
        found.extend(name.filter(|_| path.is_dir()).map(|name| (name, path)));
    }
    Ok(found)
}
