//! The rules by which a scene of a dataset is accepted, and the reasons against it.

use super::InventoryScene;
use crate::kind::CaptureKind;
use crate::photo::PhotoScrutiny;
use crate::{Capture, DiskCapture, SourceError, ViewSelection, photo, photos};
use std::collections::BTreeSet;
use std::path::PathBuf;

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

/// A folder that may be a scene.
pub(crate) struct ScenePath {
    /// Id within the dataset.
    pub(crate) name: String,
    pub(crate) path: PathBuf,
    /// The fault of its name, if there is one.
    pub(crate) misnamed: Option<RejectionReason>,
}

impl ScenePath {
    pub(super) fn judged(self, kind: CaptureKind, rules: &AcceptanceRules) -> InventoryScene {
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
        files.retain(|(name, _)| is_given(photos::base_name(name)));
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
            capture.unused.iter().filter(|photo| photo.why == crate::UnusedReason::NotPicked).count();
        let found = capture.views.len() + others;
        if found < self.min_views {
            return Err(RejectionReason::FewViews { found, wanted: self.min_views });
        }
        let side = |view: &crate::CapturedView| view.camera.size.width.min(view.camera.size.height);
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
