//! The reasons why a training fails.

use gs2e_render::RenderError;
use gs2e_source::SourceError;
use std::path::PathBuf;

/// The reason why a training failed. The texts complete the phrase "failed to ".
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// The training was asked to stop.
    #[error("finish: it was interrupted")]
    Stopped,
    /// Too few views are left to train on.
    #[error(
        "find photos to train on: of {views} views, {without_photo} have no photo and {held_out} are held out, \
         wanted at least {wanted} others"
    )]
    FewViews {
        /// Number of all views.
        views: usize,
        /// Number of views without a photo.
        without_photo: usize,
        /// Number of held-out views.
        held_out: usize,
        /// Smallest number.
        wanted: usize,
    },
    /// A photo cannot be used.
    #[error("read the photo {}: {because}", path.display())]
    Photo {
        /// The photo.
        path: PathBuf,
        /// The problem.
        because: String,
    },
    /// The points of the capture cannot be read.
    #[error("read the points: {0}")]
    Points(#[source] Box<SourceError>),
    /// No view sees a point.
    #[error(
        "find a point in front of a camera: none of {points} points is in any photo; do poses and points share a world?"
    )]
    PointsUnseen {
        /// Number of points.
        points: usize,
    },
    /// The views have nothing in common, and the capture has no points.
    #[error(
        "place the first Gaussians: the capture has no points, and its {views} views show nothing in common"
    )]
    NoCommonView {
        /// Number of views.
        views: usize,
    },
    /// A value is not finite.
    #[error("train: iteration {iteration}, view `{view}`: the {what} is not finite")]
    NotFinite {
        /// The iteration, from 1.
        iteration: u32,
        /// Name of the view.
        view: String,
        /// The loss, or the gradient of a Gaussian.
        what: String,
    },
    /// A view cannot be rendered.
    #[error("render `{view}`: {cause}")]
    Render {
        /// Name of the view.
        view: String,
        /// The reason.
        cause: RenderError,
    },
    /// The settings cannot be trained.
    #[error("start: {0}")]
    Settings(String),
    /// A checkpoint cannot be read or written.
    #[error("use the checkpoint {}: {because}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The problem.
        because: String,
    },
}
